"""Single calls, against a server."""

from __future__ import annotations

import copy
import itertools
import math
import pickle
import subprocess
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import LONG, PROGRAM, QUICK, Server

from slipdrive import AnswerLost, Client, ProblemError, SlipdriveError, answers
from slipdrive.requests import Goal, Maneuver, SolveGrid, Solver, SolveRequest

FORWARD = SolveRequest(
    maneuver=Maneuver(goal=Goal(y_m=5)), grid=SolveGrid(steps=200), solver=Solver(starts=1, seed=np.int64(7).item())
)


def test_solution_has_arrays(client: Client) -> None:
    plan = client.solve(FORWARD)
    assert plan.status == "converged" and abs(plan.final_time_s - 2.930) < 0.001
    assert plan.trajectory is not None and plan.contacts is not None
    assert plan.trajectory.y_m.shape == (201,) and plan.contacts.left.normal_force_n.shape == (200,)
    assert plan.torque_schedule.left_n_m.dtype == np.float64
    assert plan.report.replay is not None and plan.report.replay.steps == 3200
    assert plan.answer["final_time_s"] == plan.final_time_s and plan.request["maneuver"]["goal"]["y_m"] == 5


def test_simulation_repeats_the_plan(client: Client) -> None:
    plan = client.solve(FORWARD)
    assert plan.trajectory is not None
    # A part of an answer is part of a request; so are arrays.
    for left in (plan.torque_schedule.left_n_m, list(plan.torque_schedule.left_n_m)):
        schedule = {**vars(plan.torque_schedule), "left_n_m": left}
        motion = client.simulate({"torque_schedule": schedule, "grid": {"steps": 200}})  # type: ignore[arg-type]
        np.testing.assert_array_equal(motion.trajectory.y_m, plan.trajectory.y_m)
    again = client.simulate({"torque_schedule": plan.torque_schedule, "grid": {"steps": 200}})
    assert again.end_state.y_m == plan.end_state.y_m


def test_frames_have_a_row_per_node(client: Client) -> None:
    pd = pytest.importorskip("pandas")
    plan = client.solve(FORWARD)
    frame = plan.to_pandas()
    assert plan.trajectory is not None and plan.contacts is not None
    assert frame.index.name == "time_s" and len(frame) == 201
    np.testing.assert_array_equal(frame["y_m"], plan.trajectory.y_m)
    np.testing.assert_array_equal(frame["left_normal_force_n"].iloc[:-1], plan.contacts.left.normal_force_n)
    # 200 steps of 40 intervals.
    np.testing.assert_array_equal(frame["torque_right_n_m"].iloc[:-1], np.repeat(plan.torque_schedule.right_n_m, 5))
    assert np.isnan(frame["torque_right_n_m"].iloc[-1])
    motion = client.simulate({"torque_schedule": plan.torque_schedule, "grid": {"steps": 200}})
    pd.testing.assert_frame_equal(motion.to_pandas(), frame)
    with pytest.raises(ValueError, match="no trajectory"):
        client.solve({**FORWARD, "view": "plan"}).to_pandas()


def test_plans_without_motion_are_read(client: Client) -> None:
    rest = client.solve({"maneuver": {"goal": {"y_m": 0}}})
    assert rest.status == "converged" and rest.final_time_s == 0 and rest.torque_schedule.left_n_m.size == 0
    stuck = client.solve({"maneuver": {"goal": {"y_m": 5}, "torque_limit_left_n_m": 0, "torque_limit_right_n_m": 0}})
    assert stuck.status == "infeasible" and stuck.reason is not None and stuck.reason.code == "no_torque"


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_answers_and_errors_are_copied_and_pickled(client: Client, copied: Callable[[Any], Any]) -> None:
    plan = client.solve(FORWARD)
    motion = client.simulate({"torque_schedule": plan.torque_schedule})
    for one in (plan, motion):
        again = copied(one)
        assert repr(again) == repr(one) and again.answer == one.answer and again.request == one.request
        with pytest.raises(ValueError, match="give it to Client.figures"):
            again.figures()
    assert client.export(copied(plan), format="csv", rate_hz=50).files
    with pytest.raises(ProblemError) as refused:
        client.solve({"robot": {"wheel_radius_m": 0}})
    assert str(copied(refused.value)) == str(refused.value) and copied(refused.value).violations[0].limit == 0.001
    lost = copied(AnswerLost("cut", was_sent=True, timed_out=False))
    assert (str(lost), lost.was_sent, lost.timed_out) == ("cut", True, False)


def test_progress_is_reported(client: Client) -> None:
    seen: list[answers.Queued | answers.Progress] = []
    plan = client.solve({"maneuver": {"goal": {"y_m": 1}}, "view": "plan"}, on_progress=seen.append)
    assert isinstance(seen[0], answers.Queued) and isinstance(seen[-1], answers.Progress)
    assert seen[-1].start_count == 36 and plan.trajectory is None
    assert plan.final_time_s == client.solve({"maneuver": {"goal": {"y_m": 1}}, "view": "plan"}).final_time_s


def test_exception_in_the_callback_stops_the_solve(client: Client, server: Server) -> None:
    def stop(_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        client.solve(LONG, on_progress=stop)
    # The only worker is free again.
    assert client.solve(FORWARD, deadline_s=10).status == "converged"


def test_deadline_gives_the_best_plan(client: Client) -> None:
    assert client.solve(LONG, deadline_s=1.0).stop_reason == "deadline"


def test_infinity_is_no_deadline_and_what_is_no_time_is_refused(client: Client, tmp_path: Path) -> None:
    assert client.solve(FORWARD, deadline_s=math.inf).status == "converged"
    (result,) = client.solve_many([FORWARD], tmp_path / "results.ndjson", deadline_s=math.inf)
    assert result.solution is not None and result.solution.status == "converged"
    for deadline_s in (math.nan, -math.inf, -20, 1e12):
        for on_progress in (None, print):
            with pytest.raises(ValueError, match="`deadline_s` is .*, must be 0 to 1e\\+09 s"):
                client.solve(FORWARD, deadline_s=deadline_s, on_progress=on_progress)
        with pytest.raises(ValueError, match="`deadline_s`"):
            client.solve_many([FORWARD], tmp_path / "none.ndjson", deadline_s=deadline_s)
    assert not (tmp_path / "none.ndjson").exists()


def test_validation_completes_the_request(client: Client) -> None:
    checked = client.validate(FORWARD)
    assert checked.request["robot"]["gravity_m_s2"] == 9.81
    assert client.solve(checked.request).input_hash == checked.input_hash
    assert client.validate(client.example()).request["grid"]["steps"] == 200


def test_refusal_has_all_violations(client: Client) -> None:
    with pytest.raises(ProblemError) as refused:
        client.solve({"robot": {"wheel_radius_m": 0, "chassis_mass_kg": -1}})
    problem = refused.value
    assert (problem.code, problem.status, problem.retryable) == ("invalid_value", 422, False)
    assert [one.pointer for one in problem.violations] == ["#/robot/chassis_mass_kg", "#/robot/wheel_radius_m"]
    assert problem.violations[1].limit == 0.001 and "#/robot/wheel_radius_m" in str(problem)
    with pytest.raises(ProblemError, match="invalid_field"):
        client.solve({"robots": {}}, on_progress=print)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="not JSON compliant"):
        client.solve({"robot": {"wheel_radius_m": float("nan")}})


def test_limits_have_rules(client: Client) -> None:
    rules = {(rule.job, rule.field): rule for rule in client.limits().rules}
    assert rules["solve", "robot.wheel_radius_m"].minimum == 0.001


def test_figures_are_drawn_or_the_server_is_too_old(client: Client, tmp_path: Path) -> None:
    plan = client.solve(FORWARD)
    motion = client.simulate({"torque_schedule": plan.torque_schedule, "grid": {"steps": 200}})
    try:
        figures = client.figures(plan, motion, report=True)
    except SlipdriveError as error:
        assert "draws no figures" in str(error)
        return
    assert figures["path"].svg.startswith("<svg") and len(figures.plans) == 2
    assert figures["path"].svg.strip() in figures.report_html and plan.figures().report_html == ""
    assert list(figures) == figures.figures and len(figures) == len(figures.figures)
    assert [path.name for path in plan.figures().save(tmp_path)][0] == f"{figures.figures[0].name}.svg"


def test_plan_is_exported_as_files(client: Client, tmp_path: Path) -> None:
    plan = client.solve(FORWARD)
    table = plan.export(format="csv", rate_hz=50)
    rows = table["trajectory.csv"].decode().splitlines()
    assert rows[0].startswith("time_s,x_m,y_m,yaw_rad,") and rows[-1].startswith(f"{plan.final_time_s},")
    assert table.miss_m is not None and 0 <= table.miss_m < 0.01
    with pytest.raises(KeyError, match="but trajectory.csv"):
        table["plan.mcap"]
    bag = client.export(
        plan, format="ros2_mcap", rate_hz=50, frame_id="map", start_time={"sec": 9}, joint_names=("left", "right")
    )
    assert [path.name for path in bag.save(tmp_path / "bag")] == ["plan.mcap", "metadata.yaml"]
    assert "nanoseconds_since_epoch: 9000000000" in (tmp_path / "bag/metadata.yaml").read_text()
    with pytest.raises(ProblemError) as refused:
        client.export(plan, format="csv", rate_hz=0, frame_id="")
    assert [violation.pointer for violation in refused.value.violations] == ["#/rate_hz", "#/frame_id"]


def test_saved_plan_is_one_of_the_program(client: Client, tmp_path: Path) -> None:
    plan = client.solve(FORWARD)
    motion = client.simulate({"torque_schedule": plan.torque_schedule, "grid": {"steps": 200}})
    uncertain = '[{"parameter":"friction","low":-0.1,"high":0.1}]'
    for one in (plan, motion):
        one.save(tmp_path / "plan.json")
        for command in (
            "export plan.json --format csv --rate-hz 50 --out bag",
            "present plan.json --svg figures",
            f'assess plan.json --samples 10 --tolerances {{"distance_m":1}} --uncertain {uncertain}',
        ):
            subprocess.run([PROGRAM, *command.split()], cwd=tmp_path, check=True, stdout=subprocess.DEVNULL)
        assert (tmp_path / "bag/trajectory.csv").read_bytes() == one.export(format="csv", rate_hz=50)["trajectory.csv"]


def test_plan_is_assessed(client: Client) -> None:
    plan = client.solve(FORWARD)
    assessed = plan.assess(
        uncertain=[{"parameter": "friction", "low": -0.1, "high": 0.1}], tolerances={"distance_m": 0.1}, samples=100
    )
    assert assessed.samples == 100 and assessed.success_rate_low <= assessed.success_rate <= assessed.success_rate_high
    assert assessed.worst is not None
    assert client.simulate(assessed.worst.simulate).end_state.y_m is not None
    with pytest.raises(ProblemError) as refused:
        client.assess(plan, uncertain=[], tolerances={}, samples=0)
    assert len(refused.value.violations) == 3


def test_api_key_is_sent() -> None:
    server = Server(keys="secret")
    try:
        for key in ("secret", "secret\n"):
            assert Client(server.url, key).validate().input_hash
        for none in (None, "", "\n"):
            with pytest.raises(ProblemError) as refused:
                Client(server.url, none).validate()
            assert refused.value.code == "unauthenticated"
    finally:
        server.kill()


@pytest.mark.parametrize("key", ["two\nlines", "schlüssel"])
def test_api_key_that_cannot_be_sent_is_refused_and_not_shown(key: str) -> None:
    with pytest.raises(ValueError, match="`api_key` has characters") as refused:
        Client(api_key=key)
    assert key not in str(refused.value)


def test_unreachable_server_is_an_error_at_once() -> None:
    server = Server()
    server.kill()
    with pytest.raises(AnswerLost) as lost:
        Client(server.url).solve()
    assert not lost.value.was_sent
    with pytest.raises(ValueError, match="must begin with"):
        Client("localhost:8080")


class Proxy(BaseHTTPRequestHandler):
    """Answers with the head and body of its script, one after the other; None cuts the connection within an answer."""

    script: Iterator[tuple[int, dict[str, str], bytes] | None]
    asked: list[str] = []

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers.get("content-length", 0)))
        self.asked.append(self.headers.get("request-timeout-ms", ""))
        answer = next(self.script)
        status, headers, body = answer or (200, {}, b'{"status": "conv')
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name, value)
        self.send_header("content-length", str(len(body) if answer else 1000))
        self.end_headers()
        self.wfile.write(body)
        self.close_connection = answer is None

    do_GET = do_POST

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture
def proxy() -> Iterator[str]:
    Proxy.asked = []
    with ThreadingHTTPServer(("127.0.0.1", 0), Proxy) as proxy:
        threading.Thread(target=proxy.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{proxy.server_port}"
        proxy.shutdown()


def test_lost_answers_and_refusals_are_asked_again(proxy: str) -> None:
    Proxy.script = iter([None, (502, {"retry-after": "0"}, b"<html>"), (404, {}, b"<html>"), None])
    with pytest.raises(ProblemError) as refused:
        Client(proxy).solve(deadline_s=5)
    assert (refused.value.code, refused.value.retryable) == ("http_404", False)
    # The deadline is that of the call.
    first, second, third = map(int, Proxy.asked)
    assert 5000 >= first > second >= third > 4000
    with pytest.raises(AnswerLost) as lost:
        Client(proxy, attempts=1).solve()
    assert lost.value.was_sent


@pytest.mark.parametrize("status", [429, 502, 503])
@pytest.mark.parametrize("headers", [{}, {"retry-after": "Wed, 21 Oct 2026 07:28:00 GMT"}])
def test_refusals_that_name_no_time_are_asked_again(proxy: str, status: int, headers: dict[str, str]) -> None:
    Proxy.script = iter([(status, headers, b"<html>"), (404, {}, b"")])
    with pytest.raises(ProblemError, match="http_404"):
        Client(proxy).solve()
    # Not where the deadline would pass.
    Proxy.script = iter([(status, headers, b"<html>")])
    with pytest.raises(ProblemError, match=f"http_{status}"):
        Client(proxy).solve(deadline_s=0.05)


def test_timeout_of_a_proxy_is_not_asked_for_again(proxy: str) -> None:
    Proxy.script = iter([(504, {}, b"<html>")])
    with pytest.raises(ProblemError, match="http_504"):
        Client(proxy).solve()


@pytest.mark.parametrize("page", [b"<html>log in</html>", b"{}", b"[]", b"5", b"null", b"\xff"])
def test_page_in_place_of_an_answer_is_a_lost_answer(proxy: str, page: bytes, tmp_path: Path) -> None:
    calls: list[Callable[[Client], object]] = [
        Client.solve,
        Client.validate,
        Client.figures,
        Client.limits,
        lambda client: client.simulate({"torque_schedule": {"interval_s": 1, "left_n_m": [0], "right_n_m": [0]}}),
        lambda client: client.solve_many([{}], tmp_path / "results.ndjson", outage_s=0),
        lambda client: client.solve_many([{}], tmp_path / "results.ndjson", concurrency=1, outage_s=0),
    ]
    for call in calls:
        Proxy.script = itertools.repeat((200, {"content-type": "application/json"}, page))
        with pytest.raises(AnswerLost, match=f"{proxy}/[a-z]+ answered") as lost:
            call(Client(proxy))
        assert lost.value.was_sent
    assert (tmp_path / "results.ndjson").read_bytes() == b""


@pytest.mark.parametrize(
    "page", [b'{"type": "about:blank", "title": "x", "status": 401}', b"no JSON", b"[]", b"5", b"null"]
)
def test_problem_of_another_product_is_that_of_its_status(proxy: str, page: bytes) -> None:
    Proxy.script = iter([(401, {"content-type": "application/problem+json"}, page)])
    with pytest.raises(ProblemError) as refused:
        Client(proxy).solve()
    assert (refused.value.code, refused.value.retryable) == ("http_401", False)


def test_server_that_starts_again_is_waited_for() -> None:
    server = Server("--workers", "1")
    restart = threading.Timer(0.4, server.start)

    def kill_once(_: object) -> None:
        if restart.ident is None:
            server.kill()
            restart.start()

    try:
        request: SolveRequest = {**LONG, "solver": {"starts": 8}}
        assert Client(server.url, attempts=100).solve(request, on_progress=kill_once).status == "converged"
        restart.join()
        # The last attempt was not sent, the first was.
        with pytest.raises(AnswerLost, match="refused") as lost:
            Client(server.url, attempts=2).solve(LONG, on_progress=lambda _: server.kill())
        assert lost.value.was_sent
    finally:
        restart.join()
        server.kill()


def test_full_queue_is_waited_for() -> None:
    server = Server("--workers", "1", "--queue-length", "0")
    try:
        busy = Client(server.url)
        begun = threading.Event()
        solve = threading.Thread(target=lambda: busy.solve(LONG, deadline_s=2, on_progress=lambda _: begun.set()))
        solve.start()
        assert begun.wait(10)
        with pytest.raises(ProblemError) as refused:
            Client(server.url, attempts=1).solve(QUICK)
        assert refused.value.code == "queue_full" and refused.value.retry_after_s
        assert Client(server.url, attempts=100).solve(QUICK).status == "converged"
        solve.join()
    finally:
        server.kill()
