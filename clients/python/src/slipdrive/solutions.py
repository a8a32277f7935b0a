"""Answers with the request that they belong to."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from . import answers, requests
from .wire import decode, members

if TYPE_CHECKING:
    import pandas as pd

    from .client import Client
    from .exports import Exported
    from .figures import Figures


@dataclass(frozen=True, kw_only=True, eq=False)
class Validated:
    """A request that the server accepts."""

    request: requests.SolveRequest
    """The completed request: absent fields have the values that they mean."""
    input_hash: str
    """SHA-256 of the completed request, which the solution has too."""

    @classmethod
    def read(cls, answer_json: bytes) -> Validated:
        completed: Any = dict(json.loads(answer_json))
        input_hash = completed.pop("input_hash")
        return cls(request=completed, input_hash=input_hash)


@dataclass(frozen=True, kw_only=True, eq=False)
class Asked:
    """What an answer has beside its fields."""

    kind: ClassVar[str]
    """What was asked for: `solve` or `simulate`."""
    request_json: bytes = field(repr=False)
    """The request as it was sent."""
    answer_json: bytes = field(repr=False)
    """The answer as it came."""
    client: Client | None = field(repr=False, default=None)

    def __getstate__(self) -> dict[str, Any]:
        """Copies and pickles have no client: its connections are those of one process."""
        return {**vars(self), "client": None}

    @property
    def answer(self) -> dict[str, Any]:
        """The answer as plain dictionaries and lists."""
        return cast("dict[str, Any]", json.loads(self.answer_json))

    def save(self, file: str | Path) -> None:
        """Writes request and answer as `slipdrive solve --save` does, for the page and for its commands."""
        parts = (b'{"', self.kind.encode(), b'":{"request":', self.request_json, b',"answer":', self.answer_json, b"}}")
        Path(file).write_bytes(b"".join(parts))

    def _server(self, method: str) -> Client:
        """The server that gave this answer, for a method of its client."""
        if self.client is None:
            raise ValueError(f"this answer was copied or read from a file: give it to Client.{method}")
        return self.client

    def figures(self) -> Figures:
        """The figures of this answer, drawn by the server that gave it."""
        return self._server("figures").figures(self)  # type: ignore[arg-type]  # Only the two below are made.

    def export(
        self,
        *,
        format: requests.ExportFormat,
        rate_hz: float,
        frame_id: str | None = None,
        start_time: requests.StartTime | None = None,
        joint_names: Sequence[str] | None = None,
    ) -> Exported:
        """This plan as files for a controller, written by the server that gave it; see `Client.export`."""
        return self._server("export").export(
            self,  # type: ignore[arg-type]  # Only the two below are made.
            format=format,
            rate_hz=rate_hz,
            frame_id=frame_id,
            start_time=start_time,
            joint_names=joint_names,
        )

    def assess(
        self,
        *,
        uncertain: Sequence[requests.Uncertainty],
        tolerances: requests.Tolerances,
        samples: int | None = None,
        seed: int = 0,
        robot: requests.Robot | None = None,
        payload: requests.Payload | None = None,
        deadline_s: float | None = None,
    ) -> answers.AssessResponse:
        """How often this plan succeeds, by the server that gave it; see `Client.assess`."""
        return self._server("assess").assess(
            self,  # type: ignore[arg-type]  # Only the two below are made.
            uncertain=uncertain,
            tolerances=tolerances,
            samples=samples,
            seed=seed,
            robot=robot,
            payload=payload,
            deadline_s=deadline_s,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution(answers.Solution, Asked):
    """A plan and what it is worth."""

    kind: ClassVar[str] = "solve"

    @property
    def request(self) -> requests.SolveRequest:
        """The request as it was sent."""
        return cast("requests.SolveRequest", json.loads(self.request_json))

    @classmethod
    def read(cls, request_json: bytes, answer_json: bytes, client: Client | None = None) -> Solution:
        answer = members(answers.Solution, json.loads(answer_json))
        return cls(**answer, request_json=request_json, answer_json=answer_json, client=client)

    def to_pandas(self) -> pd.DataFrame:
        """The motion by time; see `Simulation.to_pandas`. Raises ValueError for plans without trajectory."""
        if self.trajectory is None or self.contacts is None:
            raise ValueError("this answer has no trajectory: `view` was `plan`, or there is no motion")
        return _frame(self.trajectory, self.contacts, self.torque_schedule)


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulation(answers.SimulateResponse, Asked):
    """The motion under given torques."""

    kind: ClassVar[str] = "simulate"

    @property
    def request(self) -> requests.SimulateRequest:
        """The request as it was sent."""
        return cast("requests.SimulateRequest", json.loads(self.request_json))

    @classmethod
    def read(cls, request_json: bytes, answer_json: bytes, client: Client | None = None) -> Simulation:
        answer = members(answers.SimulateResponse, json.loads(answer_json))
        return cls(**answer, request_json=request_json, answer_json=answer_json, client=client)

    def to_pandas(self) -> pd.DataFrame:
        """The motion by time, one row per node.

        Torques, forces and slips are those of the step that begins at the node, nan in the last row.
        """
        schedule = decode(answers.TorqueSchedule, json.loads(self.request_json)["torque_schedule"])
        return _frame(self.trajectory, self.contacts, schedule)


def _frame(trajectory: answers.Trajectory, contacts: answers.Contacts, torques: answers.TorqueSchedule) -> pd.DataFrame:
    try:
        import pandas as pd
    except ImportError as error:
        raise ImportError("pandas is missing: pip install 'slipdrive[pandas]'") from error
    columns = dict(vars(trajectory))
    time = columns.pop("time_s")
    steps, intervals = max(len(time) - 1, 0), len(torques.left_n_m)
    # The interval that the middle of a step is in, as the server takes it.
    interval = (2 * np.arange(steps) + 1) * intervals // (2 * max(steps, 1))
    by_step = {"torque_left_n_m": torques.left_n_m[interval], "torque_right_n_m": torques.right_n_m[interval]}
    for contact in ("left", "right", "front"):
        by_step |= {f"{contact}_{name}": values for name, values in vars(getattr(contacts, contact)).items()}
    # Without motion there is one node and no step.
    last = np.full(len(time) - steps, np.nan)
    columns |= {name: np.append(values, last) for name, values in by_step.items()}
    frame: pd.DataFrame = pd.DataFrame(columns, index=pd.Index(time, name="time_s"))
    return frame
