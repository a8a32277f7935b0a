"""Servers for the tests: the program that SLIPDRIVE_PROGRAM names, or the repository's debug build."""

from __future__ import annotations

import os
import socket
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from slipdrive import Client
from slipdrive.requests import SolveRequest

REPOSITORY = Path(__file__).parents[3]
PROGRAM = os.environ.get("SLIPDRIVE_PROGRAM", str(REPOSITORY / "target/debug/slipdrive"))
# A plan in some 10 ms.
QUICK = SolveRequest(grid={"steps": 50, "control_intervals": 10}, solver={"starts": 1}, view="plan")
# A search of many seconds.
LONG = SolveRequest(maneuver={"goal": {"y_m": 5}}, grid={"steps": 2000}, solver={"starts": 64}, view="plan")


class Server:
    """A server on a port that it has again when it is started again."""

    def __init__(self, *flags: str, keys: str = "") -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"127.0.0.1:{free.getsockname()[1]}"
        self.url = f"http://{self.address}"
        self._flags = ["serve", "--http", self.address, "--grpc", "127.0.0.1:0", "--log", "warn", *flags]
        self._environment = {**os.environ, **({"SLIPDRIVE_API_KEYS": keys} if keys else {})}
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen([PROGRAM, *self._flags], env=self._environment)
        for _ in range(200):
            try:
                urllib.request.urlopen(f"{self.url}/readyz", timeout=5).close()
                return
            except OSError:
                assert self.process.poll() is None, "the server does not start"
                time.sleep(0.05)
        raise AssertionError("the server is not ready within 10 s")

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def open_jobs(self) -> int:
        """Jobs that wait or run."""
        with urllib.request.urlopen(f"{self.url}/metrics", timeout=5) as response:
            lines = response.read().decode().splitlines()
        names = ("slipdrive_queue_depth ", 'slipdrive_workers{state="busy"} ')
        return sum(int(line.rsplit(" ", 1)[1]) for line in lines if line.startswith(names))


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    server = Server("--workers", "1")
    yield server
    server.kill()


@pytest.fixture
def client(server: Server) -> Iterator[Client]:
    with Client(server.url) as client:
        yield client
