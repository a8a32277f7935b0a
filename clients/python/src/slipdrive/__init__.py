"""Client of slipdrive: time-optimal maneuvers of a differential-drive robot whose wheels stick or slip.

`requests` and `answers` have the types of the contract; SI units, each field's unit is in its name.
"""

from pkgutil import extend_path

from . import answers, requests
from .client import Client
from .errors import AnswerLost, ProblemError, SlipdriveError
from .exports import Exported
from .figures import Figure, Figures, PlanInWords
from .many import Result, Results, load_results
from .solutions import Simulation, Solution, Validated

# Code that is made from proto/ is `slipdrive.v1`, in a folder of its own on the path.
__path__ = extend_path(__path__, __name__)

__all__ = [
    "AnswerLost",
    "Client",
    "Exported",
    "Figure",
    "Figures",
    "PlanInWords",
    "ProblemError",
    "Result",
    "Results",
    "Simulation",
    "SlipdriveError",
    "Solution",
    "Validated",
    "answers",
    "load_results",
    "requests",
]
