#!/usr/bin/env python3
"""Slipdrive and the CasADi + IPOPT peer side by side on a sample of maneuvers, in one table.

Both answers are judged by the same physics: the torques of either are simulated by `slipdrive simulate` on the grid of
the request, and the goal miss, the use of the limits and slip are read from that rollout.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import statistics
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from maneuver import STATE_FIELDS, Maneuver, Refusal, maneuver_from_request, state_scale
from suite import request_of

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parents[1]
# Cases of the suite that the peer covers, one of each kind.
SAMPLE = (
    "reference/forward-1m",
    "reference/diagonal-2m-1m",
    "reference/forward-5m",
    "warehouse/forward-5m",
    "reference/rolling-start",
    "reference/reverse-2m",
    "slippery/forward-3m",
    "reference/turn-90deg",
)
# Maneuvers with limits; slipdrive may take its largest time limit for each.
LIMITED = HERE / "limited"
# Exit code of `slipdrive solve` for a plan that misses its goal; the answer is there all the same.
EXIT_NO_PLAN = 2


class RunFailure(Exception):
    """A program that gave no answer."""


@dataclass(frozen=True)
class Run:
    """One solver on one maneuver.

    `solve_s`: what the solver reports for the solve alone (slipdrive: wall time, the peer: CPU time). `process_cpu_s`:
    user and system time of the whole process. `goal_miss`: magnitude of each constrained component of the simulated
    end minus the goal, in the request's units. `separations`: steps in which a contact would lift. `limit_excess`: what
    is used above each limit, as a share of it (the motor's of its stall torque). `slip_s`: how long a wheel slips.
    """

    status: str
    final_time_s: float
    solve_s: float
    process_cpu_s: float
    goal_miss: dict[str, float]
    separations: int
    limit_excess: dict[str, float]
    slip_s: float

    @property
    def largest_excess(self) -> float:
        """Largest excess of a limit, NaN without limits."""
        return max(self.limit_excess.values(), default=math.nan)

    @property
    def largest_miss(self) -> float:
        """Largest goal miss (m, rad, m/s, rad/s), the measure of slipdrive's `goal_tolerance`."""
        return max(self.goal_miss.values(), default=math.nan)


@dataclass(frozen=True)
class Comparison:
    """Both solvers on one maneuver; slipdrive from one start, and with its default search."""

    maneuver: str
    one_start: Run
    slipdrive: Run
    peer: Run

    def cpu_ratio(self, ours: Run) -> float:
        """How many times as much CPU the peer takes."""
        return ratio(self.peer.solve_s, ours.process_cpu_s)


def compare(name: str, slipdrive: Path, cpu_limit: float) -> Comparison:
    """Both solvers on a case of the suite, or on a file."""
    with tempfile.TemporaryDirectory() as directory:
        body = request_of(name)
        request = write_body(Path(directory) / "request.json", body)
        solver = body.get("solver", {}) | {"starts": 1}
        one_start = write_body(Path(directory) / "one_start.json", body | {"solver": solver})
        return Comparison(
            name,
            run_slipdrive(slipdrive, one_start),
            run_slipdrive(slipdrive, request),
            run_peer(slipdrive, request, cpu_limit),
        )


def write_body(path: Path, body: dict[str, Any]) -> Path:
    """Writes a request."""
    path.write_text(json.dumps(body))
    return path


def run_for_answer(command: list[str], accepted: tuple[int, ...] = (0,)) -> tuple[dict[str, Any], float]:
    """The JSON that `command --json OUT` writes, and the CPU seconds of its process."""
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "answer.json"
        before = children_cpu()
        done = subprocess.run([*command, "--json", str(path)], capture_output=True, text=True, check=False)
        cpu = children_cpu() - before
        if done.returncode not in accepted or not path.exists():
            raise RunFailure(f"{' '.join(command)} ended with {done.returncode}: {done.stderr.strip()}")
        return json.loads(path.read_text()), cpu


def children_cpu() -> float:
    """User and system time of all processes that have ended, s."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def run_slipdrive(slipdrive: Path, request: Path) -> Run:
    """Solves with slipdrive, on one thread as the peer."""
    command = [str(slipdrive), "solve", str(request), "--threads", "1"]
    answer, cpu = run_for_answer(command, accepted=(0, EXIT_NO_PLAN))
    simulated = simulate(slipdrive, request, answer["torque_schedule"])
    return Run(answer["status"], answer["final_time_s"], answer["report"]["solve_time_s"], cpu, *simulated)


def run_peer(slipdrive: Path, request: Path, cpu_limit: float) -> Run:
    """Solves with CasADi and IPOPT."""
    command = [sys.executable, str(HERE / "peer.py"), str(request), "--cpu-limit", str(cpu_limit)]
    answer, cpu = run_for_answer(command)
    left, right = answer["torque_left_n_m"], answer["torque_right_n_m"]
    schedule = {"interval_s": answer["final_time_s"] / len(left), "left_n_m": left, "right_n_m": right}
    simulated = simulate(slipdrive, request, schedule)
    return Run(answer["status"], answer["final_time_s"], answer["cpu_s"], cpu, *simulated)


def simulate(
    slipdrive: Path, request: Path, schedule: dict[str, Any]
) -> tuple[dict[str, float], int, dict[str, float], float]:
    """Goal miss, separations, excesses of limits and time of slip of a schedule on slipdrive's exact rollout."""
    asked = json.loads(request.read_text())
    maneuver = maneuver_from_request(asked)
    body = {
        "robot": asked.get("robot", {}),
        "start": asked["maneuver"].get("start", {}),
        "torque_schedule": schedule,
        "grid": {"steps": maneuver.step_count},
        "contact_solver": "exact",
    }
    body |= {name: asked[name] for name in ("payload",) if name in asked}
    body |= {name: asked["maneuver"][name] for name in ("limits", "reference_point") if name in asked["maneuver"]}
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        json.dump(body, file)
        file.flush()
        answer, _ = run_for_answer([str(slipdrive), "simulate", file.name])
    excess: dict[str, float] = {}
    for limit in answer.get("limits", []):
        excess[limit["limit"]] = max(limit["excess"], excess.get(limit["limit"], -math.inf))
    return goal_miss(maneuver, answer["trajectory"]), len(answer["separations"]), excess, slip_time(answer)


def slip_time(answer: dict[str, Any]) -> float:
    """How long a wheel slips, s."""
    spans = [span for span in answer["contact_modes"] if "slip" in (span["left"], span["right"])]
    return sum(span["end_s"] - span["start_s"] for span in spans)


def goal_miss(maneuver: Maneuver, trajectory: dict[str, list[float]]) -> dict[str, float]:
    """Magnitude of the end minus the goal by constrained field; headings modulo whole turns."""
    goal = maneuver.goal_asked / state_scale(maneuver.robot)
    miss = {}
    for field, target in zip(STATE_FIELDS, goal, strict=True):
        if math.isnan(target):
            continue
        difference = trajectory[field][-1] - target
        miss[field] = abs(math.remainder(difference, math.tau) if field == "heading_rad" else difference)
    return miss


def limited_maneuvers() -> list[str]:
    """The files of the maneuvers with limits."""
    return [str(path) for path in sorted(LIMITED.glob("*.json"))]


def build_slipdrive() -> Path:
    """Builds the release binary of this repository and gives its path."""
    command = ["cargo", "build", "--release", "--bin", "slipdrive", "--message-format", "json-render-diagnostics"]
    done = subprocess.run(command, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True, check=True)
    messages = [json.loads(line) for line in done.stdout.splitlines()]
    return Path(next(path for message in messages if (path := message.get("executable"))))


RUN_COLUMNS = f"{'t_f s':>9}{'CPU s':>8}{'miss':>9}{'excess':>9} {'status':<10}"
COLUMNS = (
    f"{'':32}{'slipdrive, one start':^46}{'slipdrive, default search':^46}{'peer (CasADi + IPOPT)':^46}"
    f"{'time over peer, %':>19}{'CPU, peer / slipdrive':>22}\n"
    f"{'maneuver':32}{RUN_COLUMNS}{RUN_COLUMNS}{RUN_COLUMNS}"
    f"{'one start':>10}{'default':>9}{'one start':>12}{'default':>10}"
)


def table_row(comparison: Comparison) -> str:
    """One line of the table."""
    ours, peers = [comparison.one_start, comparison.slipdrive], comparison.peer
    columns = "".join(run_columns(run, run.process_cpu_s) for run in ours) + run_columns(peers, peers.solve_s)
    over = [100.0 * (run.final_time_s / peers.final_time_s - 1.0) for run in ours]
    one_start, default = (comparison.cpu_ratio(run) for run in ours)
    ratios = f"{over[0]:10.3f}{over[1]:9.3f}{one_start:11.1f}x{default:9.1f}x"
    return f"{Path(comparison.maneuver).stem:32}{columns}{ratios}"


def run_columns(run: Run, cpu_s: float) -> str:
    """The columns of one solver."""
    return f"{run.final_time_s:9.4f}{cpu_s:8.3f}{run.largest_miss:9.1e}{run.largest_excess:9.1e} {run.status:<10}"


def median_row(comparisons: list[Comparison]) -> str:
    """The medians of the ratios."""
    one_start = statistics.median(each.cpu_ratio(each.one_start) for each in comparisons)
    default = statistics.median(each.cpu_ratio(each.slipdrive) for each in comparisons)
    return f"{'median':32}{'':157}{one_start:11.1f}x{default:9.1f}x"


def ratio(numerator: float, denominator: float) -> float:
    """The quotient; NaN over zero."""
    return numerator / denominator if denominator > 0.0 else math.nan


LEGEND = (
    "CPU s: slipdrive's whole process (user + system); the peer's formulation and solves, without Python's start.\n"
    "miss: largest goal error (m, rad, m/s, rad/s) after slipdrive's exact rollout of the torques.\n"
    "excess: largest use of a limit above it in that rollout, as a share of the limit."
)


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("requests", nargs="*", help="cases of the suite or .json files, default: a sample of the suite")
    parser.add_argument("--limits", action="store_true", help="the maneuvers with limits in place of the sample")
    parser.add_argument("--slipdrive", type=Path, help="the binary; default: built from this repository by cargo")
    parser.add_argument("--cpu-limit", type=float, default=300.0, metavar="S", help="of the peer, default %(default)g")
    parser.add_argument("--json", type=Path, metavar="OUT", help="where all figures are written")
    return parser.parse_args()


def main() -> int:
    """Exit code 0, or 1 if a program gave no answer on some maneuver."""
    asked = arguments()
    slipdrive = asked.slipdrive.resolve() if asked.slipdrive else build_slipdrive()
    comparisons, failed = [], False
    print(COLUMNS, flush=True)
    for name in asked.requests or (limited_maneuvers() if asked.limits else SAMPLE):
        try:
            comparisons.append(compare(name, slipdrive, asked.cpu_limit))
        except (RunFailure, Refusal) as error:
            failed = True
            print(f"{Path(name).stem:32}no answer: {error}", flush=True)
            continue
        print(table_row(comparisons[-1]), flush=True)
    if comparisons:
        print(median_row(comparisons))
    print(LEGEND)
    if asked.json:
        asked.json.write_text(json.dumps([asdict(comparison) for comparison in comparisons], indent=2) + "\n")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
