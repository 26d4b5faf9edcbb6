"""Check of the calibration that was in force on board when a log was made, by a fit of that log.

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

from flinders.comparison.comparison import common_dip_deg
from flinders.comparison.level_plane import compare_on
from flinders.core.joining import single_recordings
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

ONBOARD_NAME: Final = "the calibration on board"
"""Name of the calibration on board in messages."""


@dataclass(frozen=True, slots=True, eq=False)
class OnboardCheck:
    """Comparison of the calibration on board with a fit of its log."""

    calibration: Calibration  #: on board, at the end of the log
    words: str  #: names of its parameters on the vehicle; empty if the log is in memory
    changes: int  #: count of its changes in the log
    #: roll, pitch and yaw of the compass's mounting in degrees; None if it is mounted with the board, or unknown. It is
    #: not part of the calibration.
    mounting: tuple[float, float, float] | None
    strength: float  #: mean length of the readings corrected with it, in the unit of the calibration
    spread: float  #: standard deviation of these lengths, as a fraction of `strength`
    comparison: Comparison  #: of the calibration on board and the fit

    @property
    def answer(self) -> Answer:
        """Whether the calibration on board is good enough, as `Comparison.answer`.

        ``holds``: it is. ``fails``: a change improves headings. ``cannot-tell``: the fit is too uncertain.
        """
        return self.comparison.answer

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            **self.comparison.as_dict(),
            "words": self.words,  # names of its parameters on the vehicle
            "changes": self.changes,  # count of its changes in the log
            "mounting_deg": self.mounting,  # roll, pitch and yaw of the compass, not part of the calibration
            "strength": self.strength,  # mean length of the readings corrected with it, in the unit of the calibration
            "spread": self.spread,  # standard deviation of these lengths, as a fraction of `strength`
            "calibration": self.calibration.as_dict(),
        }

    def __repr__(self) -> str:
        return f"OnboardCheck({self.answer}, {self.comparison!r})"


def judge_onboard(recording: Recording, fit: Fit) -> OnboardCheck | None:
    """Compare the calibration on board with a fit of the log, to decide on a change.

    Parameters
    ----------
    recording : Recording
        The log of the fit, without the calibration that was in force.
    fit : Fit
        Fit of the log; the numbers on board count as exact.

    Returns
    -------
    OnboardCheck or None
        None if the log states no calibration in force, or several logs state different ones.
    """
    onboard = onboard_of(recording)
    if onboard is None:
        return None
    plain, steady = (
        with_calibration(fit, fit.calibration.affine),
        _at_disturbances_of(onboard, fit.calibration, recording),
    )
    known, target_deg = bare_fit(steady, name=ONBOARD_NAME), fit.claim.target_deg
    ellipsoid = fit.calibration.ellipsoid
    strength, spread = fit.evidence.coverage.corrected_strength(ellipsoid, steady)
    stored = _stored_calibrations(recording)
    return OnboardCheck(
        onboard,
        stored[-1].words if stored else "",
        sum(each.changes for each in stored),
        getattr(_parts(recording)[-1], "mounting", None),
        strength,
        math.hypot(spread, fit.evidence.noise / ellipsoid.radius),
        compare_on(recording, known, plain, dip_deg=common_dip_deg(fit), target_deg=target_deg),
    )


def onboard_fit(recording: Recording) -> Fit:
    """The calibration on board as a `Fit` without a claim.

    Raises `NoOnboardCalibration` if a log states none.
    """
    onboard = onboard_of(recording)
    if onboard is None:
        _refuse_unknown(recording)
    return bare_fit(onboard, name=ONBOARD_NAME)


def _refuse_unknown(recording: Recording) -> NoReturn:
    """Raise `NoOnboardCalibration` with the reason and a remedy."""
    parts, stored = _parts(recording), _stored_calibrations(recording)
    name = str(getattr(parts[0], "name", ""))
    if len(parts) > 1 and stored:
        raise NoOnboardCalibration(f"{recording.source} were made with different calibrations on board: give one log")
    if stored and stored[0].applied and getattr(parts[0], "as_logged", False):
        raise NoOnboardCalibration(
            f"the logged readings of {name} in {recording.source} are already corrected by {stored[0].words}: read the "
            "log without the option for readings as logged",
            hint={"as_logged": None},
        )
    is_vehicle = getattr(parts[0], "autopilot", None) is not None
    found = f"{name} had no calibration in force" if is_vehicle else "no calibration in force is stated"
    raise NoOnboardCalibration(
        f"{recording.source}: {found}; make a calibration from it (flinders calibrate), or check another calibration "
        "on it (flinders check CALIBRATION RECORDING)"
    )


def _parts(recording: Recording) -> list[Recording]:
    """The single recordings of a recording, as opened."""
    return [getattr(part, "recording", part) for part in single_recordings(recording)]


def _stored_calibrations(recording: Recording) -> list[Stored]:
    """The calibration that each log states to be in force, without logs that state none."""
    return [stored for part in _parts(recording) if (stored := getattr(part, "stored", None)) is not None]


def _at_disturbances_of(onboard: Calibration, fitted: Calibration, recording: Recording) -> Calibration:
    """The calibration on board at the disturbances of the fit, and at the means of other disturbances."""
    references = {disturbance.name: disturbance.reference for disturbance in fitted.disturbances}
    names = [disturbance.name for disturbance in onboard.disturbances]
    means = _means([name for name in names if name not in references], recording)
    return onboard.at(**{name: references.get(name, means.get(name, 0.0)) for name in names})


def _means(names: Iterable[str], recording: Recording) -> dict[str, float]:
    """Means of recorded disturbances over the readings, without disturbances that were not recorded."""
    means = {}
    for name in names:
        columns = [block.disturbance_values(name) for block in recording.blocks()]
        known = [column[np.isfinite(column)] for column in columns if column is not None]
        values = np.concatenate([np.empty(0), *known])
        if len(values):
            means[name] = float(values.mean())
    return means
