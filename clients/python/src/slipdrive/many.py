"""Many solves at once, with one line of a file for each answer."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import queue
import random
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import httpx

from . import answers, requests
from .errors import AnswerLost, ProblemError, read_answer
from .solutions import Solution
from .wire import deadline_header, encode, reader

if TYPE_CHECKING:
    import pandas as pd

if sys.platform != "win32":
    import fcntl

Key = int | str
_log = logging.getLogger("slipdrive")

# Waits where no time was named: a server that was restarted is found soon, one that is away is not flooded.
FIRST_WAIT_S, LONGEST_WAIT_S = 0.1, 2.0
# A request whose answer is lost as often may be what kills the server.
_LOST_AT_MOST = 20
# A request that misses its deadline as often does not miss it by bad luck.
_LATE_AT_MOST = 3
# Statuses of problems that lie in one request. The others, such as a wrong API key or address, all requests would have.
_OF_THE_REQUEST = {400, 413, 422, 500, 504}
# How often the caller's thread looks whether it was interrupted, where waiting cannot be.
_LOOK_S = 0.2


@dataclass(frozen=True, eq=False)
class Result:
    """One line of a results file: a request and its solution, or the problem that it ended with."""

    key: Key
    """The place of the request, or its key in the mapping."""
    line: bytes = field(repr=False)
    """The line as it is in the file."""

    @cached_property
    def _parsed(self) -> dict[str, Any]:
        parsed: dict[str, Any] = json.loads(self.line)
        return parsed

    @property
    def request(self) -> requests.SolveRequest:
        """The request."""
        request: requests.SolveRequest = self._parsed["request"]
        return request

    @cached_property
    def solution(self) -> Solution | None:
        """The solution, if there is one."""
        if "answer" not in self._parsed:
            return None
        return Solution.read(encode(self.request), encode(self._parsed["answer"]))

    @cached_property
    def problem(self) -> ProblemError | None:
        """Why there is no solution."""
        return ProblemError.from_json(self._parsed["problem"]) if "problem" in self._parsed else None


class ResultsFile:
    """A file with one line of JSON per request: its key, the request, and `answer` or `problem`.

    Lines are only ever appended, whole. A last line without its end, as a killed client leaves it, is cut off.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.places: dict[Key, tuple[int, int]] = {}
        """Where the lines are: offset and length."""
        self._file = open(path, "a+b", buffering=0)
        try:
            self._lock()
            self._read()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> ResultsFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.fsync(self._file.fileno())
        self._file.close()

    def _lock(self) -> None:
        if sys.platform != "win32":
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise BlockingIOError(f"{self.path} is in use by another client") from error

    def _read(self) -> None:
        for number, offset, line in lines_of(self.path):
            if not line.endswith(b"\n"):
                _log.warning("%s: line %d has no end and is cut off", self.path, number)
                self._file.truncate(offset)
                return
            key = key_of(self.path, number, line)
            if key in self.places:
                raise ValueError(f"{self.path}: line {number} is a second one for request {key!r}")
            self.places[key] = (offset, len(line))

    def append(self, key: Key, line: bytes) -> None:
        """Adds a line, whose place it notes."""
        offset = os.fstat(self._file.fileno()).st_size
        rest = memoryview(line)
        while rest:
            rest = rest[self._file.write(rest) :]
        self.places[key] = (offset, len(line))


def lines_of(path: Path) -> Iterator[tuple[int, int, bytes]]:
    """Number, offset and text of each line; the last one may lack its end."""
    offset = 0
    with open(path, "rb") as file:
        for number, line in enumerate(file, 1):
            yield number, offset, line
            offset += len(line)


def key_of(path: Path, number: int, line: bytes) -> Key:
    """The key of a line."""
    try:
        key: Key = json.loads(line)["key"]
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: line {number} is no result") from error
    return key


class Results:
    """Results in the order of their requests, read from their file when they are asked for."""

    def __init__(
        self, path: Path, places: Mapping[Key, tuple[int, int]], *, skipped: int = 0, lost: int = 0, refused: int = 0
    ) -> None:
        self.path = path
        self._places = places
        self.skipped = skipped
        """How many the file had before."""
        self.lost = lost
        """How many answers were lost on the way, and asked for again."""
        self.refused = refused
        """How often the server had no room."""

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[Result]:
        return (self[key] for key in self._places)

    def __getitem__(self, key: Key) -> Result:
        offset, length = self._places[key]
        with open(self.path, "rb") as file:
            file.seek(offset)
            return Result(key, file.read(length))

    def to_pandas(self) -> pd.DataFrame:
        """One row per request: what became of it."""
        try:
            import pandas as pd
        except ImportError as error:
            raise ImportError("pandas is missing: pip install 'slipdrive[pandas]'") from error
        names = ("status", "stop_reason", "replay_confirmed", "final_time_s", "input_hash")
        rows = []
        for result in self:
            solution, problem = result.solution, result.problem
            row = {name: getattr(solution, name, None) for name in names}
            row["lower_bound_s"] = solution.report.lower_bound_s if solution else None
            row["problem"] = problem.code if problem else None
            rows.append(row)
        frame: pd.DataFrame = pd.DataFrame(rows, index=pd.Index(list(self._places), name="key"))
        return frame


def load_results(results_file: str | Path) -> Results:
    """What a file has, in the order of its lines; one that is being written may be read too."""
    path = Path(results_file)
    whole = ((number, offset, line) for number, offset, line in lines_of(path) if line.endswith(b"\n"))
    return Results(path, {key_of(path, number, line): (offset, len(line)) for number, offset, line in whole})


class SolveMany:
    """One call of `solve_many`. Connections have a thread of their own: the caller may be within asyncio."""

    def __init__(
        self,
        *,
        settings: dict[str, Any],
        timeout_s: float,
        concurrency: int | None,
        deadline_s: float | None,
        outage_s: float,
    ) -> None:
        if concurrency is not None and concurrency < 1:
            raise ValueError(f"`concurrency` is {concurrency}, must be at least 1")
        self._settings = settings
        self._timeout_s = timeout_s
        self._concurrency = concurrency
        self._deadline_s = deadline_s
        self._outage_s = outage_s
        # Since when there is no server.
        self._out_since: float | None = None
        self._lost = 0
        self._refused = 0

    def run(
        self,
        requests: Iterable[Any] | Mapping[str, Any],
        path: Path,
        on_result: Callable[[Result], object] | None,
    ) -> Results:
        """Adds to the file what it lacks."""
        bodies = {key: encode(request) for key, request in keyed(requests)}
        with ResultsFile(path) as file:
            had = Results(path, file.places)
            for key in bodies.keys() & file.places.keys():
                if had[key].request != json.loads(bodies[key]):
                    raise ValueError(f"{path} has another request than this one for {key!r}")
            lacking = {key: body for key, body in bodies.items() if key not in file.places}
            if lacking:
                self._run_beside(lacking, file, on_result)
            places = {key: file.places[key] for key in bodies}
            skipped = len(bodies) - len(lacking)
            return Results(path, places, skipped=skipped, lost=self._lost, refused=self._refused)

    def _run_beside(
        self, bodies: dict[Key, bytes], file: ResultsFile, on_result: Callable[[Result], object] | None
    ) -> None:
        """Runs the solves on another thread, and gives the results to the caller on this one."""
        # None is the end.
        answered: queue.Queue[Result | None] = queue.Queue()
        loop = asyncio.new_event_loop()
        task = loop.create_task(self._solve_all(bodies, file, answered))
        thread = threading.Thread(target=self._run_loop, args=(loop, task, answered), name="slipdrive", daemon=True)
        thread.start()
        try:
            while True:
                try:
                    result = answered.get(timeout=_LOOK_S)
                except queue.Empty:
                    continue
                if result is None:
                    break
                if on_result is not None:
                    on_result(result)
        except BaseException:
            # The server is told by the ends of the connections.
            loop.call_soon_threadsafe(task.cancel)
            raise
        finally:
            thread.join()
            loop.close()
        task.result()

    @staticmethod
    def _run_loop(
        loop: asyncio.AbstractEventLoop, task: asyncio.Task[None], answered: queue.Queue[Result | None]
    ) -> None:
        asyncio.set_event_loop(loop)
        with contextlib.suppress(BaseException):
            # What it ended with is in the task.
            loop.run_until_complete(task)
        loop.run_until_complete(loop.shutdown_asyncgens())
        answered.put(None)

    async def _solve_all(
        self, bodies: dict[Key, bytes], file: ResultsFile, answered: queue.Queue[Result | None]
    ) -> None:
        unlimited = httpx.Limits(max_connections=None, max_keepalive_connections=None)
        async with httpx.AsyncClient(**self._settings, timeout=self._timeout_s, limits=unlimited) as http:
            concurrency = self._concurrency or await self._places_at(http)
            waiting = iter(bodies.items())

            async def solve_in_turn() -> None:
                for key, body in waiting:
                    outcome, document = await self._outcome(http, body)
                    if outcome == b"answer":
                        # What the file has is never asked for again; what is no answer all requests would get.
                        read_answer(reader(answers.Solution), document, f"{self._settings['base_url']}/solve")
                    parts = (b'{"key":', encode(key), b',"request":', body, b',"', outcome, b'":', document, b"}\n")
                    result = Result(key, b"".join(parts))
                    file.append(key, result.line)
                    answered.put(result)

            workers = [asyncio.create_task(solve_in_turn()) for _ in range(min(concurrency, len(bodies)))]
            try:
                await asyncio.gather(*workers)
            finally:
                for worker in workers:
                    worker.cancel()
                await asyncio.gather(*workers, return_exceptions=True)

    async def _places_at(self, http: httpx.AsyncClient) -> int:
        """As many requests as keep each worker of the server busy."""

        def places(text: bytes) -> int:
            limits = json.loads(text)
            return int(limits["workers"] + min(limits["workers"], limits["queue_length"]))

        outcome, document = await self._outcome(http, None)
        if outcome == b"problem":
            raise ProblemError.read(document)
        return read_answer(places, document, f"{self._settings['base_url']}/limits")

    async def _outcome(self, http: httpx.AsyncClient, body: bytes | None) -> tuple[bytes, bytes]:
        """What a request ends with, after as many attempts as it takes: `answer` or `problem`, and its JSON.

        Without a request, the limits of the server.
        """
        lost = late = 0
        wait_s = FIRST_WAIT_S
        while True:
            try:
                answer = await self._attempt(http, body)
                self._out_since = None
                return b"answer", answer
            except AnswerLost as error:
                lost += error.was_sent
                self._lost += error.was_sent
                _log.info("an answer was lost: %s", error)
                if lost == _LOST_AT_MOST:
                    raise
                self._note_outage(error)
                retry_after_s = None
            except ProblemError as problem:
                late += problem.code == "deadline_exceeded"
                if not problem.retryable or late == _LATE_AT_MOST:
                    if problem.status not in _OF_THE_REQUEST or problem.code.startswith("http_"):
                        raise
                    self._out_since = None
                    return b"problem", encode(problem.document)
                if problem.status == 429 or problem.code == "deadline_exceeded":
                    self._out_since = None
                    self._refused += 1
                else:
                    self._note_outage(problem)
                _log.info("to be asked again: %s", problem)
                retry_after_s = problem.retry_after_s
            if retry_after_s is None:
                wait_s, retry_after_s = min(2 * wait_s, LONGEST_WAIT_S), wait_s
            # Requests that were turned away together do not come back together.
            await asyncio.sleep(retry_after_s * random.uniform(1.0, 1.25))

    def _note_outage(self, error: Exception) -> None:
        """Raises the error if there has been no server for too long."""
        now = time.monotonic()
        self._out_since = self._out_since or now
        if now - self._out_since > self._outage_s:
            raise error

    async def _attempt(self, http: httpx.AsyncClient, body: bytes | None) -> bytes:
        """The answer as JSON on one line."""
        headers = {} if self._deadline_s is None else deadline_header(self._deadline_s)
        try:
            if body is None:
                response = await http.get("limits")
            else:
                response = await http.post("solve", content=body, headers=headers)
        except httpx.RequestError as error:
            raise AnswerLost.by(error) from error
        if response.status_code != 200:
            raise ProblemError.from_response(response)
        try:
            # What is not whole never enters the file.
            json.loads(response.content)
        except ValueError as error:
            message = f"{response.url} answered with what is no JSON"
            raise AnswerLost(message, was_sent=True, timed_out=False) from error
        return response.content if b"\n" not in response.content else encode(response.json())


def keyed(requests: Iterable[Any] | Mapping[str, Any]) -> Iterator[tuple[Key, Any]]:
    """Requests with the keys that they are known by."""
    if not isinstance(requests, Mapping):
        yield from enumerate(requests)
        return
    for key, request in requests.items():
        if not isinstance(key, str):
            raise TypeError(f"{key!r} is a {type(key).__name__}, but keys of requests must be strings")
        yield key, request
