"""The client of a server: one call, one answer."""

from __future__ import annotations

import json
import math
import random
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from ssl import SSLContext
from types import TracebackType
from typing import Any, TypeVar, cast

import httpx

from . import answers, requests
from .errors import AnswerLost, ProblemError, SlipdriveError, read_answer
from .exports import Exported
from .figures import Figures, body_of, plan_of
from .many import FIRST_WAIT_S, LONGEST_WAIT_S, Result, Results, SolveMany
from .solutions import Simulation, Solution, Validated
from .wire import deadline_header, deadline_of, encode, events, reader

T = TypeVar("T")
# What a server may need beside the time to solve: to send an answer over a slow line.
_GRACE_S = 10.0
# Refusals that pass even where a proxy names no time, or a date. A 504 comes after a wait, and so it would again.
_SOON_AGAIN = {429, 502, 503}


class Client:
    """A client of the server at `url`. Threads may share it; it is a context manager that closes its connections.

    What the server or a proxy refuses for now (429, 502, 503) is asked again after the time that it names, else soon,
    as is what is lost on the way, `attempts` times in all. A server that cannot be reached from the start is an error
    at once, as are `timeout_s` of silence.
    """

    def __init__(
        self,
        url: str = "http://127.0.0.1:8080",
        api_key: str | None = None,
        *,
        attempts: int = 5,
        timeout_s: float = 300.0,
        verify: bool | SSLContext = True,
    ) -> None:
        if httpx.URL(url).scheme not in ("http", "https"):
            raise ValueError(f"`url` is {url!r}, must begin with http:// or https://")
        self.url = url.rstrip("/")
        self.attempts = attempts
        self.timeout_s = timeout_s
        headers = {"content-type": "application/json", "user-agent": "slipdrive-python"}
        # A file that a key is read from ends its line.
        if api_key := (api_key or "").strip():
            if not (api_key.isascii() and api_key.isprintable()):
                raise ValueError(
                    "`api_key` has characters that no header can have, must be printable ASCII on one line"
                )
            headers["authorization"] = f"Bearer {api_key}"
        # For the client of `solve_many` too.
        self._settings: dict[str, Any] = {"base_url": self.url, "headers": headers, "verify": verify}
        self._http = httpx.Client(**self._settings)

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def solve(
        self,
        request: requests.SolveRequest | None = None,
        *,
        deadline_s: float | None = None,
        on_progress: Callable[[answers.Queued | answers.Progress], object] | None = None,
    ) -> Solution:
        """A plan for a maneuver. Absent fields take defaults; the outcome is a status, never an error.

        At the deadline, counted from this call, waiting included, the best plan so far is answered. `on_progress` gets
        the place in the queue, then the best plan so far as it comes; an exception in it stops the solve.
        """
        body = encode({} if request is None else request)

        def read(answer: bytes) -> Solution:
            return Solution.read(body, answer, self)

        if on_progress is None:
            return self._ask(read, "solve", body, deadline_s)
        show = on_progress
        answer = self._retried(lambda left_s: self._solve_events(body, left_s, show), deadline_s)
        return read_answer(read, answer, f"{self.url}/solve/events")

    def simulate(
        self, request: requests.SimulateRequest | answers.SimulateRequest, *, deadline_s: float | None = None
    ) -> Simulation:
        """The motion under given torques, such as those of the worst sample of an assessment."""
        body = encode(request)
        return self._ask(lambda answer: Simulation.read(body, answer, self), "simulate", body, deadline_s)

    def validate(self, request: requests.SolveRequest | None = None) -> Validated:
        """The completed request; raises ProblemError with all violations. Nothing is solved."""
        return self._ask(Validated.read, "validate", encode({} if request is None else request))

    def solve_many(
        self,
        requests: Iterable[requests.SolveRequest] | Mapping[str, requests.SolveRequest],
        results_file: str | Path,
        *,
        concurrency: int | None = None,
        deadline_s: float | None = None,
        outage_s: float = 300.0,
        on_result: Callable[[Result], object] | None = None,
    ) -> Results:
        """Solves all requests, `concurrency` at a time, and appends one line to the file for each as it is answered.

        Requests are known by their place, or in a mapping by their key. Those that the file already has are not solved
        again: a call that was interrupted is repeated as it was. Refusals are waited out, and lost answers are solved
        again; what the server will never accept is kept as a problem. `deadline_s` is for each attempt, from its
        arrival at the server. Raises AnswerLost or ProblemError after `outage_s` without a server, and at once if all
        requests would fail, as with a wrong API key. Without `concurrency` each worker of the server has one request,
        and one that waits.
        """
        deadline_s = deadline_of(deadline_s)
        many = SolveMany(
            settings=self._settings,
            timeout_s=self.timeout_s if deadline_s is None else deadline_s + _GRACE_S,
            concurrency=concurrency,
            deadline_s=deadline_s,
            outage_s=outage_s,
        )
        return many.run(requests, Path(results_file), on_result)

    def figures(self, *plans: Solution | Simulation, report: bool = False) -> Figures:
        """Figures of one to four plans, drawn over each other by the server; `report` asks for `report_html` too."""
        try:
            body = {**body_of(plans), "report": report}
            return self._ask(reader(Figures), "present", encode(body))
        except ProblemError as problem:
            if problem.code == "not_found":
                raise SlipdriveError(f"{self.url} draws no figures: its version has no /present") from problem
            raise

    def export(
        self,
        plan: Solution | Simulation,
        *,
        format: requests.ExportFormat,
        rate_hz: float,
        frame_id: str | None = None,
        start_time: requests.StartTime | None = None,
        joint_names: Sequence[str] | None = None,
    ) -> Exported:
        """A plan as files for a controller: the motion of base_link, wheel rates and torques at this rate."""
        asked = {"frame_id": frame_id, "start_time": start_time, "joint_names": joint_names}
        given = {name: value for name, value in asked.items() if value is not None}
        body = encode({**plan_of(plan), "format": format, "rate_hz": rate_hz, **given})
        return self._ask(reader(Exported), "export", body)

    def assess(
        self,
        plan: Solution | Simulation,
        *,
        uncertain: Sequence[requests.Uncertainty],
        tolerances: requests.Tolerances,
        samples: int | None = None,
        seed: int = 0,
        robot: requests.Robot | None = None,
        payload: requests.Payload | None = None,
        deadline_s: float | None = None,
    ) -> answers.AssessResponse:
        """How often a plan succeeds under what is not known, and how wrong its end is; the same request, the same answer."""
        asked = {"samples": samples, "robot": robot, "payload": payload}
        given = {name: value for name, value in asked.items() if value is not None}
        known = {"uncertain": list(uncertain), "tolerances": tolerances, "seed": seed}
        body = encode({**plan_of(plan), **known, **given})
        return self._ask(reader(answers.AssessResponse), "assess", body, deadline_s)

    def limits(self) -> answers.GetLimitsResponse:
        """The limits of the server, and the rules of all fields."""
        return self._ask(reader(answers.GetLimitsResponse), "limits")

    def example(self) -> requests.SolveRequest:
        """The paper's case, 5 m forward, with all fields."""
        return cast("requests.SolveRequest", self._ask(json.loads, "examples/forward-drive"))

    def _ask(
        self, read: Callable[[bytes], T], path: str, body: bytes | None = None, deadline_s: float | None = None
    ) -> T:
        """What `read` finds in the answer to a body, or without one in what is at this path."""

        def once(left_s: float | None) -> bytes:
            headers, timeout = self._call_settings(left_s)
            method = "GET" if body is None else "POST"
            response = self._http.request(method, path, content=body, headers=headers, timeout=timeout)
            if response.status_code != 200:
                raise ProblemError.from_response(response)
            return response.content

        return read_answer(read, self._retried(once, deadline_s), f"{self.url}/{path}")

    def _solve_events(self, body: bytes, left_s: float | None, show: Callable[[Any], object]) -> bytes:
        headers, timeout = self._call_settings(left_s)
        with self._http.stream("POST", "solve/events", content=body, headers=headers, timeout=timeout) as response:
            if response.status_code != 200:
                response.read()
                raise ProblemError.from_response(response)
            url = str(response.url)
            for name, data in events(response.iter_bytes()):
                if name == "queued":
                    show(read_answer(reader(answers.Queued), data, url))
                elif name == "progress":
                    show(read_answer(reader(answers.Progress), data, url))
                elif name == "problem":
                    raise read_answer(ProblemError.read, data, url)
                elif name == "result":
                    return data
        raise AnswerLost("the stream of events ended without a result", was_sent=True, timed_out=False)

    def _call_settings(self, left_s: float | None) -> tuple[dict[str, str], float]:
        """Headers and the longest silence of a call that has this much time."""
        if left_s is None:
            return {}, self.timeout_s
        return deadline_header(left_s), left_s + _GRACE_S

    def _retried(self, once: Callable[[float | None], T], deadline_s: float | None) -> T:
        """The answer of a call, which may be made several times."""
        deadline_s = deadline_of(deadline_s)
        end = math.inf if deadline_s is None else time.monotonic() + deadline_s
        was_sent, next_wait_s = False, FIRST_WAIT_S
        failure: AnswerLost | ProblemError
        for attempt in range(1, self.attempts + 1):
            try:
                return once(None if deadline_s is None else end - time.monotonic())
            except (httpx.RequestError, AnswerLost) as error:
                failure = AnswerLost.by(error) if isinstance(error, httpx.RequestError) else error
                failure.was_sent = was_sent = was_sent or failure.was_sent
                # Where an attempt was sent there was a server: one that cannot be reached now may be starting again.
                retryable, retry_after_s = was_sent and not failure.timed_out, None
            except ProblemError as problem:
                failure, was_sent = problem, True
                retry_after_s = problem.retry_after_s
                retryable = problem.retryable and (retry_after_s is not None or problem.status in _SOON_AGAIN)
            # Callers who were refused together do not come back together.
            wait_s = (next_wait_s if retry_after_s is None else retry_after_s) * random.uniform(1.0, 1.25)
            if not retryable or attempt == self.attempts or wait_s >= end - time.monotonic():
                raise failure
            time.sleep(wait_s)
            next_wait_s = min(2 * next_wait_s, LONGEST_WAIT_S)
        raise ValueError(f"`attempts` is {self.attempts}, must be at least 1")
