"""What goes wrong between a caller and a server."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import httpx

from . import answers
from .wire import decode

T = TypeVar("T")
# What a proxy in front of the server answers while the server cannot.
_PASSING = {429, 502, 503, 504}
# What reading raises where JSON is broken, or another's.
_MISREAD = (ValueError, TypeError, KeyError)


class SlipdriveError(Exception):
    """Any error of this package."""


class AnswerLost(SlipdriveError):
    """No answer came: the server cannot be reached, the connection was cut, nothing came for too long, or what came is
    no answer, such as the page of a proxy.

    A solve has no effect but its answer, so it may be asked for again.
    """

    def __init__(self, message: str, *, was_sent: bool, timed_out: bool) -> None:
        super().__init__(message)
        self.was_sent = was_sent
        """Whether the server may have had the request, in any attempt of a call."""
        self.timed_out = timed_out
        """Whether waiting for the server ended it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(AnswerLost, was_sent=self.was_sent, timed_out=self.timed_out), self.args

    @classmethod
    def by(cls, error: httpx.RequestError) -> AnswerLost:
        """The same as an error of the library for HTTP, which is its cause."""
        unsent = (
            httpx.ConnectError,
            httpx.ConnectTimeout,
            httpx.PoolTimeout,
            httpx.ProxyError,
            httpx.UnsupportedProtocol,
        )
        url = error.request.url
        text = str(error) or type(error).__name__
        timed_out = isinstance(error, httpx.TimeoutException)
        lost = cls(f"{url}: {text}", was_sent=not isinstance(error, unsent), timed_out=timed_out)
        lost.__cause__ = error
        return lost


def read_answer(read: Callable[[bytes], T], text: bytes, url: str) -> T:
    """What the server at `url` said with status 200; raises AnswerLost for what is no answer."""
    try:
        return read(text)
    except _MISREAD as error:
        message = f"{url} answered 200, not as slipdrive does: {error}"
        raise AnswerLost(message, was_sent=True, timed_out=False) from error


class ProblemError(SlipdriveError):
    """The server answered with a problem."""

    def __init__(self, problem: answers.Problem, document: dict[str, Any]) -> None:
        self.problem = problem
        self.document = document
        """The problem as JSON."""
        violations = [f"  {violation.pointer}: {violation.message}" for violation in problem.errors]
        super().__init__("\n".join([f"{problem.code}: {problem.detail}", *violations]))

    def __reduce__(self) -> tuple[Any, ...]:
        return ProblemError, (self.problem, self.document)

    @property
    def code(self) -> str:
        """What kind of problem it is, such as `invalid_value`; `http_502` and the like where a proxy answered."""
        return self.problem.code

    @property
    def status(self) -> int:
        """The status of HTTP."""
        return self.problem.status

    @property
    def violations(self) -> list[answers.FieldError]:
        """The faults of single fields."""
        return self.problem.errors

    @property
    def retryable(self) -> bool:
        """Whether the same request may succeed later."""
        return self.problem.retryable

    @property
    def retry_after_s(self) -> float | None:
        """When it is worth trying again, where that is known, s."""
        return None if self.problem.retry_after_ms is None else self.problem.retry_after_ms / 1000

    @property
    def request_id(self) -> str:
        """The id of the request, which the log of the server has too."""
        return self.problem.request_id

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> ProblemError:
        return cls(decode(answers.Problem, document), document)

    @classmethod
    def read(cls, text: bytes) -> ProblemError:
        return cls.from_json(json.loads(text))

    @classmethod
    def from_response(cls, response: httpx.Response) -> ProblemError:
        """The problem of a response whose body was read."""
        if response.headers.get("content-type", "").startswith("application/problem+json"):
            # That of another product is as any other page.
            with contextlib.suppress(*_MISREAD):
                return cls.read(response.content)
        seconds = response.headers.get("retry-after", "")
        return cls.from_json(
            {
                "type": "about:blank",
                "title": response.reason_phrase,
                "status": response.status_code,
                "detail": f"{response.url} answered {response.status_code}, not as slipdrive does",
                "instance": response.url.path,
                "code": f"http_{response.status_code}",
                "retryable": response.status_code in _PASSING,
                "retry_after_ms": int(seconds) * 1000 if seconds.isdecimal() else None,
                "request_id": response.headers.get("x-request-id", ""),
                "errors": [],
            }
        )
