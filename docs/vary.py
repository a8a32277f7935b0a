#!/usr/bin/env python3
"""How much each number of a robot matters: docs/vary.py PROGRAM [REQUEST.json]

Changes each number of `robot` and `payload` by +10 %, and both torque limits, and solves again: the change of the final time.
Then drives the first plan's torques on the changed robot: how far from the goal it ends. Without a file, the forward drive.
"""

import json
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

MORE = 1.1
LIMITS = ("torque_limit_left_n_m", "torque_limit_right_n_m")


def ask(kind: str, request: dict) -> dict:
    """The answer of the command line; a refusal gives an empty one."""
    run = subprocess.run([sys.argv[1], kind, "-", "--json", "-"], input=json.dumps(request), capture_output=True, text=True)
    return json.loads(run.stdout) if run.returncode in (0, 2) else {}


def changed(request: dict) -> Iterator[tuple[str, dict]]:
    """Each number's name, with the request in which it is larger."""
    for group in ("robot", "payload"):
        for name, value in request.get(group, {}).items():
            if isinstance(value, float | int) and value:
                yield f"{group}.{name}", request | {group: request[group] | {name: MORE * value}}
    maneuver = request["maneuver"]
    if all(name in maneuver for name in LIMITS):
        yield "both torques", request | {"maneuver": maneuver | {name: MORE * maneuver[name] for name in LIMITS}}


def main() -> None:
    file = sys.argv[2] if len(sys.argv) > 2 else None
    example = [sys.argv[1], "example", "forward-drive"]
    text = Path(file).read_text() if file else subprocess.check_output(example, text=True)
    request = json.loads(text)
    plan = ask("solve", request)
    if not plan:
        sys.exit("the request is refused; `slipdrive solve` says why")
    print(f"{plan['status']}, {plan['final_time_s']:.4f} s")
    end, schedule = plan["end_state"], plan["torque_schedule"]
    for name, other in changed(request):
        # Motors that are stronger than thought drive the same commands further.
        gain = MORE if name == "both torques" else 1
        torques = schedule | {side: [gain * torque for torque in schedule[side]] for side in ("left_n_m", "right_n_m")}
        kept = {key: other[key] for key in ("robot", "payload") if key in other}
        kept |= {key: other["maneuver"][key] for key in ("start", "reference_point") if key in other["maneuver"]}
        motion = ask("simulate", kept | {"torque_schedule": torques, "grid": {"steps": plan["report"]["steps"]}})
        again = ask("solve", other)
        if not motion or not again:
            print(f"{name:42} refused")
            continue
        there = motion["end_state"]
        away = math.hypot(there["x_m"] - end["x_m"], there["y_m"] - end["y_m"])
        turned = math.degrees(there["heading_rad"] - end["heading_rad"])
        change = 100 * (again["final_time_s"] / plan["final_time_s"] - 1)
        print(f"{name:42} {change:+6.2f} %  {away:6.3f} m  {turned:+6.1f} deg  {again['status']}", flush=True)


main()
