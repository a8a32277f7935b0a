"""Many solves into a file, with servers and clients that are killed on the way."""

from __future__ import annotations

import asyncio
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import LONG, Server
from solve_200 import REQUESTS

from slipdrive import AnswerLost, Client, ProblemError, Result, Solution, load_results
from slipdrive.requests import SolveRequest

HERE = Path(__file__).parent
FEW = REQUESTS[:5]


def wait_until(condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    for _ in range(6000):
        if condition():
            return
        assert process.poll() is None, "the client has ended too early"
        time.sleep(0.005)
    raise AssertionError("30 s have passed")


def lines(path: Path) -> int:
    return path.read_bytes().count(b"\n") if path.exists() else 0


def start_client(server: Server, file: Path) -> subprocess.Popen[str]:
    command = [sys.executable, str(HERE / "solve_200.py"), server.url, str(file)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def test_kills_lose_no_maneuver_and_double_none(tmp_path: Path) -> None:
    file = tmp_path / "results.ndjson"
    server = Server("--workers", "1")
    try:
        first = start_client(server, file)
        wait_until(lambda: lines(file) >= 40, first)
        first.kill()
        first.communicate()
        had = lines(file)
        # As if it had been killed while it wrote.
        with open(file, "ab") as torn:
            torn.write(b'{"key":199,"request":{"mane')

        second = start_client(server, file)
        wait_until(lambda: lines(file) >= had + 40 and server.open_jobs() >= 20, second)
        server.kill()
        at_kill = lines(file)
        time.sleep(0.3)
        server.start()
        printed, _ = second.communicate(timeout=60)
    finally:
        server.kill()
    assert second.returncode == 0
    counts = json.loads(printed)
    print(f"client killed at {had} results, server at {at_kill} with {counts['lost']} answers open; {counts}")
    assert counts["results"] == 200 and counts["skipped"] == had and counts["lost"] >= 20

    kept = [json.loads(line) for line in file.read_text().splitlines()]
    assert sorted(line["key"] for line in kept) == list(range(200))
    for line in kept:
        assert line["request"] == REQUESTS[line["key"]]
        assert line["answer"]["status"] in ("converged", "feasible")
        assert abs(line["answer"]["end_state"]["y_m"] - (1 + line["key"] / 100)) < 1e-5


def test_interrupt_ends_the_client_and_frees_the_server(tmp_path: Path) -> None:
    file = tmp_path / "results.ndjson"
    server = Server("--workers", "1")
    try:
        client = start_client(server, file)
        wait_until(lambda: lines(file) >= 5, client)
        client.send_signal(signal.SIGINT)
        assert client.wait(10) not in (0, None)
        for _ in range(200):
            if server.open_jobs() == 0:
                break
            time.sleep(0.01)
        assert server.open_jobs() == 0
        # Whole lines only.
        assert len(load_results(file)) == lines(file) < 200
    finally:
        server.kill()


def test_results_are_those_of_single_solves(client: Client, tmp_path: Path) -> None:
    seen: list[Result] = []
    results = client.solve_many(FEW, tmp_path / "results.ndjson", on_result=seen.append)
    assert [result.key for result in results] == list(range(5)) and len(seen) == 5
    for request, result in zip(FEW, results, strict=True):
        single = client.solve(request)
        assert isinstance(result.solution, Solution) and result.problem is None
        assert result.request == request and result.solution.input_hash == single.input_hash
        assert result.solution.final_time_s == single.final_time_s
    frame = results.to_pandas()
    assert list(frame.index) == list(range(5)) and frame["final_time_s"].is_monotonic_increasing


def test_repeated_call_asks_for_what_is_new(client: Client, tmp_path: Path) -> None:
    file = tmp_path / "results.ndjson"
    named = {f"robot-{place}": request for place, request in enumerate(FEW)}
    client.solve_many(dict(list(named.items())[:3]), file)
    results = client.solve_many(named, file)
    assert (len(results), results.skipped, lines(file)) == (5, 3, 5)
    assert results["robot-4"].request == FEW[4]
    # Without a server: nothing is asked.
    away = Server()
    away.kill()
    assert Client(away.url).solve_many(named, file).skipped == 5


def test_other_requests_are_not_mixed_up(client: Client, tmp_path: Path) -> None:
    file = tmp_path / "results.ndjson"
    client.solve_many(FEW, file)
    with pytest.raises(ValueError, match="another request"):
        client.solve_many(FEW[::-1], file)
    with pytest.raises(TypeError, match="must be strings"):
        client.solve_many({1: FEW[0]}, file)  # type: ignore[arg-type]
    file.write_bytes(file.read_bytes() + b"no result\n")
    with pytest.raises(ValueError, match="line 6 is no result"):
        client.solve_many(FEW, file)


@pytest.mark.skipif(sys.platform == "win32", reason="no locks")
def test_one_client_writes_a_file(client: Client, tmp_path: Path) -> None:
    def again(_: Result) -> None:
        client.solve_many(FEW, tmp_path / "results.ndjson")

    with pytest.raises(BlockingIOError, match="in use"):
        client.solve_many(FEW, tmp_path / "results.ndjson", on_result=again)


def test_refused_requests_are_kept_as_problems(client: Client, tmp_path: Path) -> None:
    spoiled: SolveRequest = {"robot": {"wheel_radius_m": 0}}
    results = client.solve_many([FEW[0], spoiled], tmp_path / "results.ndjson")
    problem = results[1].problem
    assert results[0].solution and results[1].solution is None
    assert problem and problem.code == "invalid_value" and problem.violations[0].limit == 0.001


def test_full_queue_slows_down_and_loses_nothing(tmp_path: Path) -> None:
    server = Server("--workers", "1", "--queue-length", "2")
    try:
        slow: list[SolveRequest] = [
            {**FEW[0], "grid": {"steps": 200}, "solver": {"starts": 2, "seed": n}} for n in range(8)
        ]
        results = Client(server.url).solve_many(slow, tmp_path / "results.ndjson", concurrency=8)
    finally:
        server.kill()
    assert results.refused > 0 and all(result.solution for result in results)


def test_deadlines_hold_in_each_attempt(client: Client, tmp_path: Path) -> None:
    long: list[SolveRequest] = [{**LONG, "solver": {"starts": 64, "seed": n}} for n in range(2)]
    results = client.solve_many(long, tmp_path / "results.ndjson", concurrency=1, deadline_s=0.5)
    assert [result.solution and result.solution.stop_reason for result in results] == ["deadline", "deadline"]


def test_absent_server_and_wrong_key_end_the_call(client: Client, tmp_path: Path) -> None:
    server = Server(keys="secret")
    try:
        with pytest.raises(ProblemError, match="unauthenticated"):
            Client(server.url, "wrong").solve_many(FEW, tmp_path / "results.ndjson")
    finally:
        server.kill()
    with pytest.raises(ProblemError, match="not_found"):
        Client(f"{client.url}/elsewhere").solve_many(FEW, tmp_path / "results.ndjson", concurrency=1)
    with pytest.raises(AnswerLost):
        Client(server.url).solve_many(FEW, tmp_path / "results.ndjson", outage_s=0.5)
    assert lines(tmp_path / "results.ndjson") == 0


def test_it_runs_within_asyncio(client: Client, tmp_path: Path) -> None:
    async def notebook() -> int:
        return len(client.solve_many(FEW, tmp_path / "results.ndjson"))

    assert asyncio.run(notebook()) == 5
