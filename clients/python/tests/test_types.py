"""The types are those of the contract."""

import subprocess
import sys
from pathlib import Path

import pytest
from conftest import REPOSITORY

PACKAGE = Path(__file__).parents[1]


@pytest.mark.skipif(not (REPOSITORY / "tests/data/openapi.json").exists(), reason="not in the repository")
def test_types_are_those_of_the_schema() -> None:
    subprocess.run([sys.executable, PACKAGE / "make_types.py", "--check"], check=True)


def test_code_made_from_proto_has_its_place_beside_the_package(tmp_path: Path) -> None:
    made = tmp_path / "slipdrive/v1"
    made.mkdir(parents=True)
    (made / "solution_pb2.py").touch()
    code = f"import sys; sys.path.append({str(tmp_path)!r}); import slipdrive.v1.solution_pb2; slipdrive.Client"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.skipif(not (REPOSITORY / "LICENSE-MIT").exists(), reason="not in the repository")
@pytest.mark.parametrize("name", ["LICENSE-MIT", "LICENSE-APACHE"])
def test_licenses_are_those_of_the_repository(name: str) -> None:
    assert (PACKAGE / name).read_text() == (REPOSITORY / name).read_text()
