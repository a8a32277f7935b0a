"""Asks the program `slipdrive` by its command line."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any


def ask(slipdrive: Path, kind: str, request: dict[str, Any]) -> dict[str, Any]:
    """The answer of a kind of job, such as `solve`, to a request; raises RuntimeError where there is none."""
    command = [str(slipdrive), kind, "-", "--json", "-"]
    done = subprocess.run(command, input=json.dumps(request), capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"slipdrive {kind} ended with {done.returncode}: {done.stderr.strip()}")
    return json.loads(done.stdout)
