"""Calls a server with the stubs that grpcio-tools made: python grpcio_tools.py HOST:PORT"""

import sys

import grpc
from google.rpc import error_details_pb2
from grpc_status import rpc_status

from slipdrive.v1 import maneuver_pb2 as maneuvers
from slipdrive.v1 import maneuver_service_pb2 as pb
from slipdrive.v1 import maneuver_service_pb2_grpc as services
from slipdrive.v1 import solution_pb2 as solutions

MANEUVER = maneuvers.Maneuver(goal=maneuvers.Goal(y_m=5))
# Quick, and the same at each call.
EFFORT = {"grid": maneuvers.SolveGrid(steps=200), "solver": maneuvers.Solver(starts=1)}
WITHOUT_RADIUS = maneuvers.Robot(wheel_radius_m=0)


def reason_and_fields(details) -> tuple[str, list[str]]:
    """What the details of an error say."""
    info, request = error_details_pb2.ErrorInfo(), error_details_pb2.BadRequest()
    assert any(detail.Unpack(info) for detail in details) and any(detail.Unpack(request) for detail in details)
    return info.reason, [violation.field for violation in request.field_violations]


def jobs():
    """One of each kind, and one that is refused."""
    solve = pb.SolveRequest(maneuver=MANEUVER, view=maneuvers.VIEW_PLAN, **EFFORT)
    yield pb.BatchRequest(request_id="solve", timeout_ms=60_000, solve=solve)
    torques = maneuvers.TorqueSchedule(interval_s=0.1, left_n_m=[0.5] * 4, right_n_m=[0.5] * 4)
    yield pb.BatchRequest(request_id="simulate", simulate=pb.SimulateRequest(torque_schedule=torques))
    yield pb.BatchRequest(request_id="refused", solve=pb.SolveRequest(robot=WITHOUT_RADIUS))


def main() -> None:
    with grpc.insecure_channel(sys.argv[1]) as channel:
        planner = services.ManeuverServiceStub(channel)

        solution = planner.Solve(pb.SolveRequest(maneuver=MANEUVER, **EFFORT), timeout=60).solution
        assert solution.status == solutions.STATUS_CONVERGED, solution.status
        assert 2 < solution.final_time_s < 10 and len(solution.trajectory.time_s) == 201, solution.final_time_s

        events = list(planner.SolveStream(pb.SolveStreamRequest(maneuver=MANEUVER, **EFFORT), timeout=60))
        kinds = [event.WhichOneof("event") for event in events]
        assert kinds[0] == "queued" and kinds[-1] == "solution", kinds
        assert events[-1].solution.final_time_s == solution.final_time_s, events[-1].solution.final_time_s

        answers = {answer.request_id: answer for answer in planner.Batch(jobs(), timeout=60)}
        assert answers.keys() == {"solve", "simulate", "refused"}, answers.keys()
        assert answers["solve"].solve.final_time_s == solution.final_time_s, answers["solve"]
        assert abs(answers["simulate"].simulate.trajectory.time_s[-1] - 0.4) < 1e-9, answers["simulate"]
        expected = ("INVALID_VALUE", ["robot.wheel_radius_m"])
        assert reason_and_fields(answers["refused"].error.details) == expected, answers["refused"]

        try:
            planner.Solve(pb.SolveRequest(robot=WITHOUT_RADIUS), timeout=60)
            raise AssertionError("the robot is refused")
        except grpc.RpcError as error:
            assert error.code() == grpc.StatusCode.INVALID_ARGUMENT, error
            assert reason_and_fields(rpc_status.from_call(error).details) == expected, error

        finest = maneuvers.SolveGrid(steps=planner.GetLimits(pb.GetLimitsRequest(), timeout=60).max_steps)
        solver = maneuvers.Solver(starts=1, rollout_limit=1)
        largest = planner.Solve(pb.SolveRequest(maneuver=MANEUVER, grid=finest, solver=solver), timeout=60)
        assert len(largest.solution.contacts.left.normal_force_n) == finest.steps, "a full answer"
    print(f"final time: {solution.final_time_s:.3f} s; {finest.steps} steps: {largest.ByteSize()} bytes")


if __name__ == "__main__":
    main()
