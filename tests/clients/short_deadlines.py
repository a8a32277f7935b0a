"""Hooks of schemathesis: every request has a short deadline, so that random maneuvers are solved quickly; lines are texts."""

import json

import schemathesis

HEADER, SHORT_MS = "Request-Timeout-Ms", 300


@schemathesis.hook
def before_call(context, case, kwargs):
    given = str((case.headers or {}).get(HEADER, SHORT_MS))
    # What is no number stays: the server must refuse it.
    if given.isascii() and given.isdigit() and int(given) > 0:
        case.headers = {**(case.headers or {}), HEADER: str(min(int(given), SHORT_MS))}


@schemathesis.serializer("application/x-ndjson")
def lines(context, value):
    return value.encode(errors="replace") if isinstance(value, str) else json.dumps(value).encode()
