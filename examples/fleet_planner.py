"""Plans for a fleet over one gRPC batch; the stubs are made from proto/ on the fly.

pip install grpcio grpcio-tools grpcio-status
python examples/fleet_planner.py [127.0.0.1:50051]
"""

import math
import pathlib
import sys

import grpc
from google.rpc import error_details_pb2

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "proto"))
pb, services = grpc.protos_and_services("slipdrive/v1/maneuver_service.proto")
maneuvers = grpc.protos("slipdrive/v1/maneuver.proto")
solutions = grpc.protos("slipdrive/v1/solution.proto")

# Retries where the server invites them; its pushback in the trailers sets the pace.
SERVICE_CONFIG = (pathlib.Path(__file__).parent / "service_config.json").read_text()


def requests(robots: int):
    """One maneuver per robot: 3 m away, all around."""
    for robot in range(robots):
        angle = math.tau * robot / robots
        goal = maneuvers.Goal(x_m=3 * math.sin(angle), y_m=3 * math.cos(angle), free=["heading_rad"])
        yield pb.SolveBatchRequest(
            request_id=f"robot-{robot}", maneuver=maneuvers.Maneuver(goal=goal), view=maneuvers.VIEW_PLAN
        )


def reason(status) -> str:
    """The stable code in the details of an error."""
    info = error_details_pb2.ErrorInfo()
    for detail in status.details:
        if detail.Unpack(info):
            return info.reason
    return "no reason"


def main() -> None:
    address = sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1:50051"
    with grpc.insecure_channel(address, options=[("grpc.service_config", SERVICE_CONFIG)]) as channel:
        planner = services.ManeuverServiceStub(channel)
        limits = planner.GetLimits(pb.GetLimitsRequest())
        print(f"{limits.workers} workers, {limits.batch_window} items at once")
        for response in planner.SolveBatch(requests(8), timeout=120):
            if response.HasField("error"):
                print(f"{response.request_id}: {reason(response.error)}: {response.error.message}")
            else:
                plan = response.solution
                status = solutions.Status.Name(plan.status)
                print(f"{response.request_id}: {plan.final_time_s:.3f} s, {status}")


if __name__ == "__main__":
    main()
