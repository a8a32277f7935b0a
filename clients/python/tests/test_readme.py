"""What the README shows works as it stands."""

import re
from pathlib import Path

import pytest
from conftest import Server

README = Path(__file__).parents[1] / "README.md"
CODE = "\n".join(re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL))


def test_commands_of_the_readme_work(server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pandas")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(CODE.replace("http://127.0.0.1:8080", server.url), names)
    assert len((tmp_path / "results.ndjson").read_text().splitlines()) == 20


def test_code_of_the_readme_has_types(tmp_path: Path) -> None:
    mypy = pytest.importorskip("mypy.api")
    (tmp_path / "readme.py").write_text(CODE)
    said, _, exit_code = mypy.run(["--strict", "--cache-dir", str(tmp_path / "cache"), str(tmp_path / "readme.py")])
    assert exit_code == 0, said
