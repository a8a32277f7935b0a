"""Solves with the client that openapi-python-client made: python openapi_python.py URL"""

import sys

from slipdrive_client import Client
from slipdrive_client.api.default import limits, solve
from slipdrive_client.models import (
    Goal,
    Maneuver,
    Problem,
    Robot,
    Solution,
    SolveGrid,
    SolveRequest,
    Solver,
    Status,
    View,
)


def main() -> None:
    client = Client(sys.argv[1], timeout=60, raise_on_unexpected_status=True)
    maneuver = Maneuver(goal=Goal(y_m=5))

    answer = solve.sync(client=client, body=SolveRequest(maneuver=maneuver), request_timeout_ms=5000)
    assert isinstance(answer, Solution), answer
    assert isinstance(answer.final_time_s, float) and 2 < answer.final_time_s < 10, answer.final_time_s
    assert answer.trajectory, "the full view is the default"

    quick = SolveRequest(maneuver=maneuver, grid=SolveGrid(steps=200), solver=Solver(starts=1), view=View.PLAN)
    plan = solve.sync(client=client, body=quick)
    assert isinstance(plan, Solution) and plan.status == Status.CONVERGED and plan.reason is None, plan
    assert plan.report.steps == 200 and not plan.trajectory, plan

    robot = Robot(wheel_radius_m=0, chassis_mass_kg=-1)
    refused = solve.sync_detailed(client=client, body=SolveRequest(robot=robot))
    problem = refused.parsed
    assert refused.status_code == 422 and isinstance(problem, Problem), refused
    assert problem.code == "invalid_value" and problem.retry_after_ms is None, problem
    assert problem.errors[0].pointer in ("#/robot/chassis_mass_kg", "#/robot/wheel_radius_m"), problem.errors

    rules = limits.sync(client=client)
    assert rules and rules.max_steps > 0, rules
    print(f"final time: {answer.final_time_s:.3f} s; refused: {problem.errors[0].pointer}")


if __name__ == "__main__":
    main()
