"""The samples of `slipdrive assess`, drawn again.

Its random numbers are counted from seed, sample and parameter alone, as `src/assessment/draw.rs` has it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

# Changes of one sample by their parameters, in the units of the request.
Changes = dict[str, float]

# What the random numbers count a parameter by: its place in `ChangedParameter` of `src/motion/disturbed.rs`.
PARAMETER_NUMBERS = {
    "friction": 0,
    "mass": 1,
    "center_of_mass_right": 2,
    "center_of_mass_forward": 3,
    "torque": 4,
    "torque_left": 5,
    "start_heading": 6,
    "torque_right": 7,
}
MASK = (1 << 64) - 1


def drawn(seed: int, count: int, uncertain: Sequence[dict[str, Any]]) -> list[Changes]:
    """The first samples under what is `uncertain` in a request."""
    return [{of["parameter"]: draw(seed, sample, of) for of in uncertain} for sample in range(count)]


def draw(seed: int, sample: int, uncertain: dict[str, Any]) -> float:
    """One change in one sample."""
    number = 2 * PARAMETER_NUMBERS[uncertain["parameter"]]
    first, second = share(seed, sample, number), share(seed, sample, number + 1)
    if "low" in uncertain:
        return uncertain["low"] + first * (uncertain["high"] - uncertain["low"])
    # Box and Muller.
    radius = math.sqrt(-2.0 * math.log(first))
    return uncertain["mean"] + uncertain["standard_deviation"] * radius * math.cos(math.tau * second)


def share(seed: int, *counters: int) -> float:
    """Uniform in (0, 1), of 53 bits."""
    bits = mixed(seed)
    for counter in counters:
        bits = mixed(bits ^ mixed(counter))
    return ((bits >> 11) + 0.5) / (1 << 53)


def mixed(state: int) -> int:
    """A step of SplitMix64."""
    bits = (state + 0x9E3779B97F4A7C15) & MASK
    bits = ((bits ^ (bits >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    bits = ((bits ^ (bits >> 27)) * 0x94D049BB133111EB) & MASK
    return bits ^ (bits >> 31)


def check_drawn(samples: list[Changes], answer: dict[str, Any]) -> None:
    """Raises RuntimeError where the samples are not those of an assessment, whose answer states one of them."""
    worst = answer["worst"]
    for change in worst["changes"]:
        name, known, here = change["parameter"], change["change"], samples[worst["sample"]][change["parameter"]]
        # Logarithm and cosine may round otherwise.
        if not math.isclose(here, known, rel_tol=1e-12):
            raise RuntimeError(f"{name} of sample {worst['sample']} is {known}, drawn here as {here}")
