"""The calibration that was in force on board when a log was made, judged by a fit of that log.

>>> from dataclasses import replace
>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble = simulate.tumble(seed=1)
>>> fit = calibrate.fit(tumble.samples)
>>> judge_onboard(replace(tumble.samples, onboard=fit.calibration), fit).answer
'holds'
>>> stale = replace(fit.calibration, offset=fit.calibration.offset + [8.0, 0.0, 0.0])
>>> judge_onboard(replace(tumble.samples, onboard=stale), fit).answer
'fails'
>>> judge_onboard(tumble.samples, fit) is None
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NoReturn

import numpy as np

from flinders.comparison.comparison import judged_at
from flinders.comparison.level_plane import compare_on
from flinders.core.joining import singles
from flinders.core.samples import onboard_of
from flinders.errors import NoOnboardCalibration
from flinders.fitting.result import Fit, bare_fit, with_calibration

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.comparison.comparison import Comparison
    from flinders.core.calibration import Calibration
    from flinders.core.samples import Recording
    from flinders.native.faults import Answer
    from flinders.readers import Stored

NAME: Final = "the calibration on board"
"""What messages call it."""


@dataclass(frozen=True, slots=True, eq=False)
class OnboardCheck:
    """The calibration on board compared with a fit of the log that it was in force for."""

    calibration: Calibration  #: on board, at the end of the log
    words: str  #: as the vehicle calls its parameters; empty where the log is in memory
    changes: int  #: how often it changed in the log
    #: roll, pitch and yaw in degrees, in which the compass is mounted; None where it is turned with the board, or that
    #: is not known. No calibration has it.
    mounting: tuple[float, float, float] | None
    strength: float  #: mean length of the readings corrected with it, in the unit of the calibration
    spread: float  #: standard deviation of their lengths, as a fraction of that
    comparison: Comparison  #: of it and the fit

    @property
    def answer(self) -> Answer:
        """Whether it is good enough, as `Comparison.answer` says.

        ``holds``: it is. ``fails``: a change is worth while. ``cannot-tell``: the fit claims too little.
        """
        return self.comparison.answer

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            **self.comparison.as_dict(),
            "words": self.words,  # as the vehicle calls its parameters
            "changes": self.changes,  # how often it changed in the log
            "mounting_deg": self.mounting,  # roll, pitch and yaw of the compass, which are not in the calibration
            "strength": self.strength,  # mean length of the readings corrected with it, in the unit of the calibration
            "spread": self.spread,  # standard deviation of their lengths, as a fraction of that
            "calibration": self.calibration.as_dict(),
        }

    def __repr__(self) -> str:
        return f"OnboardCheck({self.answer}, {self.comparison!r})"


def judge_onboard(recording: Recording, fit: Fit) -> OnboardCheck | None:
    """Say whether the calibration on board is good enough, or that of a fit of the log is worth a change.

    Parameters
    ----------
    recording : Recording
        The log that was fitted, without the calibration that was in force.
    fit : Fit
        Its claim decides: the numbers on board are exact.

    Returns
    -------
    OnboardCheck or None
        None where the log tells of no calibration in force, or several logs of different ones.
    """
    onboard = onboard_of(recording)
    if onboard is None:
        return None
    plain, steady = with_calibration(fit, fit.calibration.affine), _at(onboard, fit.calibration, recording)
    known, target_deg = bare_fit(steady, name=NAME), fit.claim.target_deg
    ellipsoid = fit.calibration.ellipsoid
    strength, spread = fit.evidence.coverage.corrected_strength(ellipsoid, steady)
    stored = _stored(recording)
    return OnboardCheck(
        onboard,
        stored[-1].words if stored else "",
        sum(each.changes for each in stored),
        getattr(_parts(recording)[-1], "mounting", None),
        strength,
        math.hypot(spread, fit.evidence.noise / ellipsoid.radius),
        compare_on(recording, known, plain, dip_deg=judged_at(fit), target_deg=target_deg),
    )


def onboard_fit(recording: Recording) -> Fit:
    """The calibration on board as a `Fit`, which claims nothing of it.

    Raises `NoOnboardCalibration` where a log tells of none.
    """
    onboard = onboard_of(recording)
    if onboard is None:
        _refuse_unknown(recording)
    return bare_fit(onboard, name=NAME)


def _refuse_unknown(recording: Recording) -> NoReturn:
    """Say why there is no calibration on board, and what to do."""
    parts, stored = _parts(recording), _stored(recording)
    name = str(getattr(parts[0], "name", ""))
    if len(parts) > 1 and stored:
        raise NoOnboardCalibration(f"{recording.source} were made with different calibrations in force: give one log")
    if stored and stored[0].applied and getattr(parts[0], "as_logged", False):
        raise NoOnboardCalibration(
            f"readings of {name} in {recording.source} as they were logged are after {stored[0].words}: take them "
            "without it",
            hint={"as_logged": None},
        )
    is_vehicle = getattr(parts[0], "autopilot", None) is not None
    found = f"{name} had no calibration in force" if is_vehicle else "no calibration in force is told"
    raise NoOnboardCalibration(
        f"{recording.source}: {found}; make one from it (flinders calibrate), or check one that you have on it "
        "(flinders check CALIBRATION RECORDING)"
    )


def _parts(recording: Recording) -> list[Recording]:
    """The recordings that it is made of, as they were opened."""
    return [getattr(part, "recording", part) for part in singles(recording)]


def _stored(recording: Recording) -> list[Stored]:
    """What each of the logs says of the calibration in force."""
    return [stored for part in _parts(recording) if (stored := getattr(part, "stored", None)) is not None]


def _at(onboard: Calibration, fitted: Calibration, recording: Recording) -> Calibration:
    """The calibration on board as the fit sees it: at the disturbances of the fit, of others at their mean."""
    references = {disturbance.name: disturbance.reference for disturbance in fitted.disturbances}
    names = [disturbance.name for disturbance in onboard.disturbances]
    means = _means([name for name in names if name not in references], recording)
    return onboard.at(**{name: references.get(name, means.get(name, 0.0)) for name in names})


def _means(names: Iterable[str], recording: Recording) -> dict[str, float]:
    """Means of recorded disturbances over the readings; of what was not recorded none."""
    means = {}
    for name in names:
        columns = [block.driving(name) for block in recording.blocks()]
        known = [column[np.isfinite(column)] for column in columns if column is not None]
        values = np.concatenate([np.empty(0), *known])
        if len(values):
            means[name] = float(values.mean())
    return means
