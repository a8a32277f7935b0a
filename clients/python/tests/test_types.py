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


@pytest.mark.skipif(not (REPOSITORY / "LICENSE-MIT").exists(), reason="not in the repository")
@pytest.mark.parametrize("name", ["LICENSE-MIT", "LICENSE-APACHE"])
def test_licenses_are_those_of_the_repository(name: str) -> None:
    assert (PACKAGE / name).read_text() == (REPOSITORY / name).read_text()
