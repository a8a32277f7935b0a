"""Figures of plans, drawn by the server."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from .solutions import Simulation, Solution

# What the server does not need: the motion is rolled out again.
_STRIPPED = ("trajectory", "contacts")


@dataclass(frozen=True, kw_only=True, eq=False)
class Figure:
    """A figure, complete by itself."""

    name: str
    """Its name, such as `path`."""
    title: str
    """Its title."""
    caption: str
    """What it shows."""
    width_px: float
    """Width of its viewBox, px."""
    height_px: float
    """Height of its viewBox, px."""
    svg: str
    """A document of SVG without style and script."""

    def _repr_svg_(self) -> str:
        """Notebooks show this."""
        return self.svg


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanInWords:
    """What is said of a plan."""

    label: str
    """Its name in the figures: A, B, C or D."""
    headline: str
    """The answer in one sentence."""
    details: list[str]
    """The answer in further sentences."""
    certificate: list[str]
    """Why to trust the plan; empty where its motion does not end where the answer says."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Figures:
    """Plans, drawn and in words."""

    figures: list[Figure]
    """Figures in the order in which they are read."""
    plans: list[PlanInWords]
    """What is said of each plan."""
    report_html: str
    """All of it as one page that needs nothing beside it; empty where no report was asked for."""

    def __iter__(self) -> Iterator[Figure]:
        """The figures in their order."""
        return iter(self.figures)

    def __len__(self) -> int:
        """How many figures there are."""
        return len(self.figures)

    def __getitem__(self, name: str) -> Figure:
        """The figure of this name."""
        for figure in self.figures:
            if figure.name == name:
                return figure
        raise KeyError(f"no figure {name!r}, but {', '.join(figure.name for figure in self.figures)}")

    def save(self, folder: str | Path) -> list[Path]:
        """Writes NAME.svg for each figure."""
        Path(folder).mkdir(parents=True, exist_ok=True)
        paths = []
        for figure in self.figures:
            paths.append(Path(folder) / f"{figure.name}.svg")
            paths[-1].write_text(figure.svg, encoding="utf-8")
        return paths


def body_of(plans: tuple[Solution | Simulation, ...]) -> dict[str, Any]:
    """What is asked of the server: one to four plans, drawn over each other."""
    return {"plans": [plan_of(plan) for plan in plans]}


def plan_of(plan: Solution | Simulation) -> dict[str, Any]:
    """A request with its answer, without what the server rolls out again."""
    answer = {name: value for name, value in plan.answer.items() if name not in _STRIPPED}
    return {plan.kind: {"request": json.loads(plan.request_json), "answer": answer}}
