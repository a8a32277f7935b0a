"""What the README shows works as it stands."""

import re
from pathlib import Path

import pytest
from conftest import Server

README = Path(__file__).parents[1] / "README.md"


def test_commands_of_the_readme_work(server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pandas")
    monkeypatch.chdir(tmp_path)
    code = "\n".join(re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL))
    names: dict[str, object] = {}
    exec(code.replace("http://127.0.0.1:8080", server.url), names)
    assert len((tmp_path / "results.ndjson").read_text().splitlines()) == 20
