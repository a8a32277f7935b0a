"""Tries the toy kind of job on a server with one worker and no queue: python tests/toy_kind.py URL HOST:PORT"""

import json
import sys
import threading
import time
import urllib.error
import urllib.request

import grpc
from google.rpc import error_details_pb2
from grpc_status import rpc_status

sys.path.insert(0, "proto")
pb, services = grpc.protos_and_services("slipdrive/v1/maneuver_service.proto")
maneuvers = grpc.protos("slipdrive/v1/maneuver.proto")


def ask(url: str, body: object = None, media_type: str = "application/json") -> tuple[int, str]:
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url, data, {"content-type": media_type})
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as refusal:
        return refusal.code, refusal.read().decode()


def try_rest(url: str) -> None:
    status, answer = ask(f"{url}/envelope", {"robot": {"wheel_friction_coefficient": 0.5, "gravity_m_s2": 10}})
    assert (status, json.loads(answer)) == (200, {"acceleration_m_s2": 5.0}), answer
    status, answer = ask(f"{url}/envelope", {"robot": {"wheel_radius_m": 0}})
    error = json.loads(answer)["errors"][0]
    assert (status, error["pointer"], error["code"]) == (422, "#/robot/wheel_radius_m", "invalid_value"), answer
    robot = {"wheel_friction_coefficient": 0.5, "gravity_m_s2": 10}
    status, answer = ask(f"{url}/batch", {"request_id": "one", "envelope": {"robot": robot}}, "application/x-ndjson")
    [line, end] = map(json.loads, answer.splitlines())
    assert (status, line) == (200, {"request_id": "one", "envelope": {"acceleration_m_s2": 5.0}}), answer
    assert end == {"end": {"answered": 1, "problems": 0}}, answer
    status, answer = ask(f"{url}/envelope", {"rabot": {}})
    assert (status, json.loads(answer)["code"]) == (422, "invalid_field"), answer


def try_grpc(address: str) -> None:
    robot = maneuvers.Robot(wheel_friction_coefficient=0.5, gravity_m_s2=10)
    with grpc.insecure_channel(address) as channel:
        planner = services.ManeuverServiceStub(channel)
        assert planner.Envelope(pb.EnvelopeRequest(robot=robot), timeout=60).acceleration_m_s2 == 5
        try:
            planner.Envelope(pb.EnvelopeRequest(robot=maneuvers.Robot(wheel_radius_m=0)), timeout=60)
            raise AssertionError("the robot is refused")
        except grpc.RpcError as error:
            request = error_details_pb2.BadRequest()
            assert any(detail.Unpack(request) for detail in rpc_status.from_call(error).details)
        assert request.field_violations[0].field == "robot.wheel_radius_m", request
        items = [pb.BatchRequest(request_id="one", envelope=pb.EnvelopeRequest(robot=robot))]
        [answer] = planner.Batch(iter(items), timeout=60)
        assert (answer.request_id, answer.envelope.acceleration_m_s2) == ("one", 5), answer


def try_descriptions(url: str) -> None:
    document = json.loads(ask(f"{url}/openapi.json")[1])
    operation = document["paths"]["/envelope"]["post"]
    assert operation["operationId"] == "envelope" and "429" in operation["responses"], operation
    field = document["components"]["schemas"]["EnvelopeResponse"]["properties"]["acceleration_m_s2"]
    assert field["description"] == "Straight ahead, m/s2.", field
    rules = json.loads(ask(f"{url}/limits")[1])["rules"]
    radius = [rule for rule in rules if (rule["job"], rule["field"]) == ("envelope", "robot.wheel_radius_m")]
    assert [(rule["minimum"], rule["maximum"]) for rule in radius] == [(0.001, 10)], radius
    metrics = ask(f"{url}/metrics")[1].splitlines()
    assert 'slipdrive_jobs_total{job="envelope",outcome="finished"} 4' in metrics, metrics
    assert any(line.startswith('slipdrive_http_request_duration_seconds_count{code="200",route="/envelope"}') for line in metrics)
    assert any(line.startswith('slipdrive_grpc_request_duration_seconds_count{code="OK",method="Envelope"}') for line in metrics)


def try_admission(url: str) -> None:
    """While a long solve holds the only worker, the kind is refused as any other."""
    long = {"maneuver": {"goal": {"y_m": 5}}, "grid": {"steps": 10000}, "solver": {"starts": 64, "time_limit_s": 5}}
    solving = threading.Thread(target=ask, args=(f"{url}/solve", long))
    solving.start()
    while 'slipdrive_workers{state="busy"} 1' not in ask(f"{url}/metrics")[1]:
        assert solving.is_alive(), "the solve runs for seconds"
        time.sleep(0.01)
    status, answer = ask(f"{url}/envelope", {})
    assert (status, json.loads(answer)["code"]) == (429, "queue_full"), answer
    solving.join()


if __name__ == "__main__":
    try_rest(sys.argv[1])
    try_grpc(sys.argv[2])
    try_descriptions(sys.argv[1])
    try_admission(sys.argv[1])
    print("the toy kind works over REST and gRPC, in descriptions, metrics, limits and admission")
