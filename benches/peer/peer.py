#!/usr/bin/env python3
"""Solves the maneuver of a slipdrive request with CasADi and IPOPT, at its best case.

A homotopy over the friction law: smooth with a slip scale from 0.3 to 0.01 m/s, then exact Coulomb with its
complementarity relaxed from 0.1 m/s down. Every stage starts from the last one's iterate. Where slip is forbidden the
wheels stick by equations, and one stage does.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

# One thread, since CPU seconds are compared; read when numpy and casadi are imported.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import casadi as ca
import numpy as np

from maneuver import Guess, Maneuver, Refusal, maneuver_from_request, turn_drive_turn
from mechanics import Mechanics
from self_check import self_check
from suite import request_of
from transcription import Law, Program, Values

# Slip scales of the smooth law, m/s.
SLIP_SCALES = (0.3, 0.1, 0.03, 0.01)
# Relaxations tau of exact Coulomb friction, m/s.
RELAXATIONS = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)

# A stage that takes longer than this is stuck, s of CPU.
STAGE_CPU_LIMIT = 60.0
IPOPT_OPTIONS = {
    "linear_solver": "mumps",
    "mu_strategy": "adaptive",
    # Two sticking wheels share one lateral slip, so their rows depend on each other at every such step. Without this
    # option exact stages fail or take many times as long (README.md).
    "perturb_always_cd": "yes",
    # At 1e-6, or with a tighter `constr_viol_tol`, the sample takes up to four times as long and is not faster driven.
    "tol": 1e-5,
    "max_iter": 1000,
    "print_level": 0,
    "sb": "yes",
}
# Barrier at the start of a stage. The smooth law starts from a rough guess; exact stages follow a path, where a large
# barrier would throw away what the last stage found.
FIRST_BARRIER = {Law.SMOOTH: 1e-2, Law.COULOMB: 1e-4, Law.STICKING: 1e-2}
SUCCESS = ("Solve_Succeeded", "Solved_To_Acceptable_Level")

DEFAULT_CPU_LIMIT = 300.0


@dataclass(frozen=True)
class Stage:
    """One solve; `parameter` is the slip scale or the relaxation, m/s, or the grip that sticking wheels may use."""

    law: str
    parameter: float
    status: str
    iterations: int
    cpu_s: float
    final_time_s: float

    @property
    def succeeded(self) -> bool:
        """Whether IPOPT met its tolerance, or its acceptable one."""
        return self.status in SUCCESS


@dataclass(frozen=True)
class Outcome:
    """What the peer found.

    `status`: `solved` (at the last relaxation, or sticking), `relaxed` (only at a larger one), `failed` (no exact stage
    succeeded; torques and final time are those of the last iterate), or `time_limit` (the CPU limit came before the
    last stage; `relaxation_m_s` tells what the answer is worth). `relaxation_m_s` is that of the answer, None if no
    exact stage succeeded and 0 for sticking wheels. `cpu_s` covers formulation and all solves.
    """

    status: str
    final_time_s: float
    relaxation_m_s: float | None
    cpu_s: float
    torque_left_n_m: list[float]
    torque_right_n_m: list[float]
    stages: list[Stage]


class StageSolver:
    """IPOPT on one program; multipliers pass from one successful stage to the next."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._solver = self._build(STAGE_CPU_LIMIT)
        self._multipliers: dict[str, ca.DM] = {}

    def _build(self, cpu_limit: float) -> ca.Function:
        ipopt = IPOPT_OPTIONS | {"mu_init": FIRST_BARRIER[self._program.law], "max_cpu_time": cpu_limit}
        options = {"expand": True, "print_time": False, "ipopt": ipopt}
        return ca.nlpsol("peer", "ipopt", self._program.problem, options)

    def run(self, values: Values, parameter: float, cpu_left: float) -> tuple[Values, Stage]:
        """One stage from `values` in at most `cpu_left` s."""
        begin = time.process_time()
        program = self._program
        # The limit is fixed when a solver is built, which takes a few tenths of a second: done anew only near the end.
        solver = self._solver if cpu_left >= STAGE_CPU_LIMIT else self._build(cpu_left)
        answer = solver(
            x0=program.pack(values),
            p=parameter,
            lbx=program.lower,
            ubx=program.upper,
            lbg=program.row_lower,
            ubg=0.0,
            **self._multipliers,
        )
        statistics = solver.stats()
        stage = Stage(
            law=program.law.value,
            parameter=parameter,
            status=statistics["return_status"],
            iterations=statistics["iter_count"],
            cpu_s=time.process_time() - begin,
            final_time_s=float(answer["f"]),
        )
        if stage.succeeded:
            self._multipliers = {"lam_x0": answer["lam_x"], "lam_g0": answer["lam_g"]}
        return program.unpack(answer["x"].full().ravel()), stage


def first_values(maneuver: Maneuver, guess: Guess) -> Values:
    """The unknowns of the smooth law at the guess: loads at rest, no friction."""
    load = Mechanics(maneuver.robot).static_load / maneuver.robot.weight
    return {
        "state": guess.state,
        "direction": np.zeros((4, maneuver.step_count)),
        "load": np.tile(load[:, None], (1, maneuver.step_count)),
        "effort": guess.effort,
        "final_time": np.array([[guess.final_time]]),
    }


def lifted(values: Values, slip_scale: float) -> Values:
    """Unknowns of the smooth law as those of the exact law; the smooth law has |gamma| = eps |n| / sqrt(1 - n.n)."""
    squared = values["direction"] ** 2
    length_squared = np.minimum(squared[[0, 2]] + squared[[1, 3]], 1.0)
    margin = np.maximum(1.0 - length_squared, 1e-12)
    return values | {"sliding": slip_scale * np.sqrt(length_squared / margin), "margin": margin}


def solve(maneuver: Maneuver, cpu_limit: float, observe: Callable[[Stage], None]) -> Outcome:
    """Solves to the end or to `cpu_limit` (s); `observe` is told of every stage."""
    grip = maneuver.limits.grip_utilization
    if grip is not None:
        return solve_sticking(maneuver, grip, cpu_limit, observe)
    return solve_sliding(maneuver, cpu_limit, observe)


def solve_sticking(maneuver: Maneuver, grip: float, cpu_limit: float, observe: Callable[[Stage], None]) -> Outcome:
    """One stage with sticking wheels that use at most `grip` of their friction."""
    begin = time.process_time()
    solver = StageSolver(Program(maneuver, Law.STICKING))
    values, stage = solver.run(first_values(maneuver, turn_drive_turn(maneuver)), grip, cpu_limit)
    observe(stage)
    cpu_s = time.process_time() - begin
    status = "solved" if stage.succeeded else "failed" if cpu_s < cpu_limit else "time_limit"
    return outcome(maneuver, values, status, 0.0 if stage.succeeded else None, [stage], cpu_s)


def solve_sliding(maneuver: Maneuver, cpu_limit: float, observe: Callable[[Stage], None]) -> Outcome:
    """Follows the homotopy over the friction law."""
    begin = time.process_time()
    values = answer = first_values(maneuver, turn_drive_turn(maneuver))
    relaxation, stages, in_time = None, [], True
    for law, parameters in ((Law.SMOOTH, SLIP_SCALES), (Law.COULOMB, RELAXATIONS)):
        if law is Law.COULOMB:
            values = lifted(values, SLIP_SCALES[-1])
        solver = StageSolver(Program(maneuver, law))
        for parameter in parameters:
            cpu_left = cpu_limit - (time.process_time() - begin)
            in_time = cpu_left > 0.0
            if not in_time:
                break
            # A failed stage still hands on its iterate: the next one often recovers.
            values, stage = solver.run(values, parameter, cpu_left)
            stages.append(stage)
            observe(stage)
            if law is Law.COULOMB and stage.succeeded:
                answer, relaxation = values, parameter
    if relaxation is None:
        answer = values
    status = status_of(relaxation, in_time)
    return outcome(maneuver, answer, status, relaxation, stages, time.process_time() - begin)


def status_of(relaxation: float | None, in_time: bool) -> str:
    """The status of an answer at a relaxation."""
    if relaxation == RELAXATIONS[-1]:
        return "solved"
    if not in_time:
        return "time_limit"
    return "failed" if relaxation is None else "relaxed"


def outcome(
    maneuver: Maneuver, answer: Values, status: str, relaxation: float | None, stages: list[Stage], cpu_s: float
) -> Outcome:
    """The outcome with torques within their limits, which IPOPT relaxes by 1e-8."""
    effort = np.clip(answer["effort"], -1.0, 1.0)
    left, right = (effort * maneuver.torque_limit[:, None]).tolist()
    return Outcome(status, float(answer["final_time"][0, 0]), relaxation, cpu_s, left, right, stages)


def print_stage(stage: Stage) -> None:
    """One line per stage, to standard error."""
    print(
        f"{stage.law:8}{stage.parameter:7.0e} m/s  {stage.final_time_s:9.5f} s  {stage.iterations:4} iterations"
        f"  {stage.cpu_s:6.2f} s CPU  {stage.status}",
        file=sys.stderr,
        flush=True,
    )


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("request", nargs="?", help="a case of the suite, or a .json file with a solve request")
    parser.add_argument("--json", metavar="OUT", default="-", help="where the answer goes; - is standard output")
    parser.add_argument("--cpu-limit", type=float, default=DEFAULT_CPU_LIMIT, metavar="S", help="default %(default)g")
    parser.add_argument("--self-check", action="store_true", help="hold the discretisation to the reference rollouts")
    return parser.parse_args()


def main() -> int:
    """Exit code 0, 1 for a failed self-check, 64 for a request that is not covered."""
    asked = arguments()
    if asked.self_check:
        return 0 if self_check() else 1
    if asked.request is None:
        print("error: a request file or --self-check is needed", file=sys.stderr)
        return 64
    try:
        maneuver = maneuver_from_request(request_of(asked.request))
    except Refusal as refusal:
        print(f"error: {refusal}", file=sys.stderr)
        return 64
    answer = json.dumps(asdict(solve(maneuver, asked.cpu_limit, print_stage)))
    if asked.json == "-":
        print(answer)
    else:
        Path(asked.json).write_text(answer)
    return 0


if __name__ == "__main__":
    sys.exit(main())
