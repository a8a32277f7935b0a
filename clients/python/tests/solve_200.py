"""Solves 200 maneuvers into a file: solve_200.py URL FILE. Prints what happened on the way."""

from __future__ import annotations

import json
import sys

from conftest import QUICK

from slipdrive import Client
from slipdrive.requests import SolveRequest

# Long enough for the client to keep the server's queue filled.
MANY: SolveRequest = {**QUICK, "grid": {"steps": 200}}
REQUESTS: list[SolveRequest] = [{**MANY, "maneuver": {"goal": {"y_m": 1 + place / 100}}} for place in range(200)]

if __name__ == "__main__":
    with Client(sys.argv[1]) as client:
        results = client.solve_many(REQUESTS, sys.argv[2], concurrency=32, outage_s=30)
    print(json.dumps({"results": len(results), "skipped": results.skipped, "lost": results.lost}))
