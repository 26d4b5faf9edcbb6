"""Check of the onboard calibration that a log states, by a fit of the log.

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
"""Name of the onboard calibration in messages."""


@dataclass(frozen=True, slots=True, eq=False)
class OnboardCheck:
    """Comparison of the onboard calibration with a fit of its log."""

    calibration: Calibration  #: onboard calibration at the end of the log
    words: str  #: names of its parameters on the vehicle; empty if the log is in memory
    changes: int  #: number of its changes within the log
    #: Roll, pitch and yaw of the compass's mounting in degrees; None if the compass is on the board, or if it is
    #: unknown. The mounting is not part of the calibration.
    mounting: tuple[float, float, float] | None
    strength: float  #: mean length of the readings after correction with it, in the unit of the calibration
    spread: float  #: standard deviation of these lengths, as a fraction of `strength`
    comparison: Comparison  #: comparison of the onboard calibration with the fit

    @property
    def answer(self) -> Answer:
        """Whether the onboard calibration is good enough, as in `Comparison.answer`.

        ``holds``: it is good enough. ``fails``: a change improves headings. ``cannot-tell``: the fit is too uncertain.
        """
        return self.comparison.answer

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
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
    """Compare the onboard calibration with a fit of the log, to decide whether to replace it.

    Parameters
    ----------
    recording : Recording
        The log of the fit; its onboard calibration was removed from the readings.
    fit : Fit
        Fit of the log. The numbers of the onboard calibration count as exact.

    Returns
    -------
    OnboardCheck or None
        None if the log states no onboard calibration, or if several logs state different ones.
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
    """The onboard calibration as a `Fit` without a claim.

    Raises `NoOnboardCalibration` if the log states none.
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
            f"{recording.source} was read with the option for readings as logged, and {stored[0].words} is in the "
            f"readings of {name}: read the log without this option",
            hint={"as_logged": None},
        )
    is_vehicle = getattr(parts[0], "autopilot", None) is not None
    found = f"{name} had no calibration in force" if is_vehicle else "no calibration in force is stated"
    raise NoOnboardCalibration(
        f"{recording.source}: {found}; make a calibration from it (flinders calibrate), or check another calibration "
        "on it (flinders check CALIBRATION RECORDING)"
    )


def _parts(recording: Recording) -> list[Recording]:
    """The single recordings of which a recording consists, as they were opened."""
    return [getattr(part, "recording", part) for part in single_recordings(recording)]


def _stored_calibrations(recording: Recording) -> list[Stored]:
    """The onboard calibration of each log; logs that state none are left out."""
    return [stored for part in _parts(recording) if (stored := getattr(part, "stored", None)) is not None]


def _at_disturbances_of(onboard: Calibration, fitted: Calibration, recording: Recording) -> Calibration:
    """The onboard calibration with the disturbances of the fit, and with other disturbances at their means."""
    references = {disturbance.name: disturbance.reference for disturbance in fitted.disturbances}
    names = [disturbance.name for disturbance in onboard.disturbances]
    means = _means([name for name in names if name not in references], recording)
    return onboard.at(**{name: references.get(name, means.get(name, 0.0)) for name in names})


def _means(names: Iterable[str], recording: Recording) -> dict[str, float]:
    """Mean of each disturbance over the readings; disturbances that were not recorded are left out."""
    means = {}
    for name in names:
        columns = [block.disturbance_values(name) for block in recording.blocks()]
        known = [column[np.isfinite(column)] for column in columns if column is not None]
        values = np.concatenate([np.empty(0), *known])
        if len(values):
            means[name] = float(values.mean())
    return means
