"""Between JSON and Python: bodies of requests, answers, server-sent events."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import types
from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

T = TypeVar("T")
# 32 years: sockets wait no more than some centuries.
_LONGEST_DEADLINE_S = 1e9


def encode(request: Any) -> bytes:
    """A request as JSON on one line. Arrays of numpy become lists, parts of answers become objects."""
    return json.dumps(request, default=_plain, allow_nan=False, separators=(",", ":")).encode()


def _plain(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        members = ((field.name, getattr(value, field.name)) for field in dataclasses.fields(value))
        return {name: member for name, member in members if member is not None}
    raise TypeError(f"{type(value).__name__} cannot be sent as JSON")


def decode(kind: type[T], value: Any) -> T:
    """An object of JSON as this data class."""
    return kind(**members(kind, value))


def reader(kind: type[T]) -> Callable[[bytes], T]:
    """Reads JSON as this data class."""
    return lambda text: decode(kind, json.loads(text))


def _decode(kind: Any, value: Any) -> Any:
    origin = get_origin(kind)
    if value is None:
        return None
    if origin is np.ndarray:
        # A null becomes nan.
        return np.array(value, dtype=np.float64)
    if origin is list:
        (item,) = get_args(kind)
        return [_decode(item, one) for one in value]
    if origin in (Union, types.UnionType):
        (some,) = (one for one in get_args(kind) if one is not type(None))
        return _decode(some, value)
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        return decode(kind, value)
    return value


def members(kind: Any, value: dict[str, Any]) -> dict[str, Any]:
    """The fields of a data class out of an object; what it does not know is ignored, since answers may grow.

    Raises ValueError for a field that must be there and is not.
    """
    found = {}
    for name, hint, is_required in _fields(kind):
        if name in value:
            found[name] = _decode(hint, value[name])
        elif is_required:
            raise ValueError(f"`{name}` is missing in {kind.__name__}: this is no answer of this version of slipdrive")
    return found


@functools.cache
def _fields(kind: Any) -> list[tuple[str, Any, bool]]:
    hints = get_type_hints(kind)
    return [(one.name, hints[one.name], one.default is dataclasses.MISSING) for one in dataclasses.fields(kind)]


def events(chunks: Iterable[bytes]) -> Iterator[tuple[str, bytes]]:
    """The name and data of each server-sent event; the server sends the data on one line."""
    rest, name, data = b"", "message", b""
    for chunk in chunks:
        *lines, rest = (rest + chunk).split(b"\n")
        for line in lines:
            field, _, value = line.rstrip(b"\r").partition(b":")
            if field == b"event":
                name = value.strip().decode()
            elif field == b"data":
                data = value.strip()
            elif not field and not value and data:
                yield name, data
                name, data = "message", b""


def deadline_of(deadline_s: float | None) -> float | None:
    """The deadline of a call, if it has one: infinity is none. Raises ValueError for what is no time to wait."""
    if deadline_s is None or deadline_s == math.inf:
        return None
    if not 0 <= deadline_s <= _LONGEST_DEADLINE_S:
        longest = f"{_LONGEST_DEADLINE_S:g} s"
        raise ValueError(f"`deadline_s` is {deadline_s}, must be 0 to {longest}; infinity or None for no deadline")
    return deadline_s


def deadline_header(deadline_s: float) -> dict[str, str]:
    """The header that tells the server how long the caller waits."""
    return {"request-timeout-ms": str(max(1, round(deadline_s * 1000)))}
