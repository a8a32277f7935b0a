"""A server of its own on a free port."""

import json
import os
import re
import subprocess
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self


class Service:
    """Runs from `with` to its end."""

    def __init__(self, program: Path, *flags: str, keys: str = "") -> None:
        environment = {**os.environ, **({"SLIPDRIVE_API_KEYS": keys} if keys else {})}
        command = [program, "serve", "--http", "127.0.0.1:0", "--grpc", "127.0.0.1:0", "--log-format", "json", *flags]
        # A pipe that nobody reads would fill up.
        self._log = tempfile.NamedTemporaryFile("r")
        with open(self._log.name, "w") as log:
            self._process = subprocess.Popen(command, env=environment, stderr=log)
        self.wait_until(lambda: '"listening"' in self._said(), "the service listens")
        address = re.search(r'"http.address":"([^"]*)"', self._said())
        assert address
        self.url = f"http://{address[1]}"

    def _said(self) -> str:
        return Path(self._log.name).read_text()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()

    def post(self, path: str, body: object) -> Any:
        request = urllib.request.Request(self.url + path, json.dumps(body).encode(), {"content-type": "application/json"})
        with urllib.request.urlopen(request) as answer:
            return json.load(answer)

    def try_to_solve(self, body: object) -> None:
        """Keeps a worker busy; what comes of it does not matter."""
        try:
            self.post("/solve", body)
        except OSError:
            pass

    def busy(self) -> float:
        """Workers that run a job of their own."""
        return self.metric('slipdrive_workers{state="busy"}')

    def metric(self, name: str) -> float:
        with urllib.request.urlopen(f"{self.url}/metrics") as answer:
            lines = answer.read().decode().splitlines()
        return next(float(line.rpartition(" ")[2]) for line in lines if line.startswith(f"{name} "))

    def wait_until(self, holds: Callable[[], bool], what: str) -> None:
        for _ in range(600):
            if holds():
                return
            time.sleep(0.05)
        raise AssertionError(f"not within 30 s: {what}")
