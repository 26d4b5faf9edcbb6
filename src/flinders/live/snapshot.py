"""What a session gives to be fitted, and what comes back; `evaluation` makes the one of the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from flinders.core.samples import Samples
    from flinders.fitting.judged import Judged
    from flinders.fitting.result import Fit
    from flinders.heading.guidance import Frame, Goal
    from flinders.live.messages import PreviousState, Reason
    from flinders.report.view import View


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """What is fitted.

    Attributes
    ----------
    key : int
        Comes back with the result.
    samples : Samples
    numbers : (N,) int, optional
        Which reading of the session each is.
    target_deg, dip_deg : float
    goal, frame : str
        As in `flinders.heading.guidance`.
    previous : Judged, optional
    is_followed : bool
        Somebody turns the sensor just now, and may be led.
    """

    key: int
    samples: Samples
    numbers: NDArray[np.intp] | None = None
    target_deg: float = 1.0
    dip_deg: float = 60.0
    goal: Goal = "heading"
    frame: Frame = "sensor"
    previous: Judged | None = None
    is_followed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Evaluated:
    """What follows from a snapshot.

    Attributes
    ----------
    key : int
    fit : Fit, optional
        Good, limited or refused; None where there is none.
    view : View, optional
    refusal : str
        Why there is no fit.
    reasons : tuple of Reason
    used, rejected : int
        Readings.
    previous : PreviousState, optional
    """

    key: int
    fit: Fit | None = None
    view: View | None = None
    refusal: str = ""
    reasons: tuple[Reason, ...] = ()
    used: int = 0
    rejected: int = 0
    previous: PreviousState | None = None
