"""Asks a server by gRPC as tools do: python tests/clients/probe.py HOST:PORT [KEY]"""

import pathlib
import sys

import grpc
from google.rpc import error_details_pb2
from grpc_health.v1 import health_pb2, health_pb2_grpc
from grpc_reflection.v1alpha.proto_reflection_descriptor_database import ProtoReflectionDescriptorDatabase
from grpc_status import rpc_status

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent.parent / "proto"))
pb, services = grpc.protos_and_services("slipdrive/v1/maneuver_service.proto")
maneuvers = grpc.protos("slipdrive/v1/maneuver.proto")
SERVICE = "slipdrive.v1.ManeuverService"


class WithKey(grpc.StreamStreamClientInterceptor):
    """Sends the key with calls that pass no metadata of their own, as reflection does."""

    def __init__(self, metadata):
        self.metadata = metadata

    def intercept_stream_stream(self, continuation, details, requests):
        return continuation(details._replace(metadata=self.metadata), requests)


def main() -> None:
    address, key = sys.argv[1], sys.argv[2:3]
    metadata = [("authorization", f"Bearer {key[0]}")] if key else []
    with grpc.insecure_channel(address) as channel:
        health = health_pb2_grpc.HealthStub(channel)
        for name in ["", SERVICE]:
            status = health.Check(health_pb2.HealthCheckRequest(service=name), timeout=10).status
            assert status == health_pb2.HealthCheckResponse.SERVING, status

        described = grpc.intercept_channel(channel, WithKey(metadata)) if key else channel
        reflection = ProtoReflectionDescriptorDatabase(described)
        assert SERVICE in reflection.get_services(), reflection.get_services()
        file = reflection.FindFileContainingSymbol(SERVICE)
        methods = {method.name for service in file.service for method in service.method}
        assert methods == {"Batch", "Solve", "SolveStream", "SolveBatch", "Simulate", "Present", "Export", "Assess", "Validate", "GetLimits"}, methods

        planner = services.ManeuverServiceStub(channel)
        robot = maneuvers.Robot(wheel_radius_m=0, chassis_mass_kg=-1)
        try:
            planner.Solve(pb.SolveRequest(robot=robot), metadata=metadata, timeout=10)
            raise AssertionError("the robot is refused")
        except grpc.RpcError as error:
            assert error.code() == grpc.StatusCode.INVALID_ARGUMENT, error
            details = rpc_status.from_call(error).details
        info, request = error_details_pb2.ErrorInfo(), error_details_pb2.BadRequest()
        assert any(detail.Unpack(info) for detail in details) and any(detail.Unpack(request) for detail in details)
        assert (info.reason, info.domain) == ("INVALID_VALUE", "slipdrive"), info
        fields = sorted(violation.field for violation in request.field_violations)
        assert fields == ["robot.chassis_mass_kg", "robot.wheel_radius_m"], fields
        if key:
            try:
                planner.GetLimits(pb.GetLimitsRequest(), timeout=10)
                raise AssertionError("a key is asked for")
            except grpc.RpcError as error:
                assert error.code() == grpc.StatusCode.UNAUTHENTICATED, error
    print("health, reflection and rich errors are as they should be")


if __name__ == "__main__":
    main()
