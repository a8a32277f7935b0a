"""Solves a maneuver over REST, with the standard library only: python examples/rest_client.py [http://127.0.0.1:8080]"""

import json
import sys
import time
import urllib.error
import urllib.request


def solve(base: str, body: dict, attempts: int = 5) -> dict:
    """The answer of POST /solve; comes back when the server says so."""
    data = json.dumps(body).encode()
    headers = {"content-type": "application/json", "request-timeout-ms": "10000"}
    for attempt in range(attempts):
        request = urllib.request.Request(f"{base}/solve", data, headers)
        try:
            with urllib.request.urlopen(request) as response:
                return json.load(response)
        except urllib.error.HTTPError as error:
            problem = json.load(error)
            if not problem["retryable"] or attempt == attempts - 1:
                faults = [f"  {fault['pointer']}: {fault['message']}" for fault in problem["errors"]]
                raise SystemExit("\n".join([f"{problem['code']}: {problem['detail']}", *faults]))
            time.sleep((problem["retry_after_ms"] or 1000) / 1000)
    raise AssertionError("the last attempt returns or raises")


def main() -> None:
    base = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8080"
    plan = solve(base, {"maneuver": {"goal": {"y_m": 5}}, "view": "plan"})
    print(f"{plan['status']}: {plan['final_time_s']:.3f} s, replay confirmed: {plan['replay_confirmed']}")
    schedule = plan["torque_schedule"]
    for index, (left, right) in enumerate(zip(schedule["left_n_m"], schedule["right_n_m"])):
        print(f"{index * schedule['interval_s']:6.3f} s  {left:+.3f} N m  {right:+.3f} N m")


if __name__ == "__main__":
    main()
