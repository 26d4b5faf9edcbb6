"""Estimate with aiding sensors; of a level turn only where they saw that the body leaned.

>>> from flinders import simulate
>>> from flinders.estimators import Readings
>>> from flinders.fitting.request import Request
>>> aided_estimate(Readings.of(simulate.tumble(seed=1, n=500, motion="uniform").samples), Request.of())
(None, None)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, cast

from flinders.core.joining import in_memory
from flinders.errors import FitError, UsageError
from flinders.estimators.level import Level, turned_level
from flinders.fitting.aiding import AUTO, Aiding, AidingSensor
from flinders.geometry.plane import down_of
from flinders.heading.error_propagation import level_error
from flinders.likelihood.prior import SPREAD
from flinders.summary.summary import is_flat

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.samples import Samples
    from flinders.estimators import Estimate, Readings
    from flinders.fitting.request import Request

LEANING: Final = 10.0
"""Times the heading error claimed of a level turn: a fit with aiding sensors that claims more saw no lean. Of drives of
half a minute it claims up to 8 times as much, of level turns more than 100 times; the turn errs by up to 5 times its
claim where the body leans."""


def aided_estimate(readings: Readings, request: Request) -> tuple[Estimate | None, Aiding | None]:
    """Fit with aiding sensors; no estimate where none was asked for, or none was used.

    Raises
    ------
    UsageError
        Where only sums are left.
    """
    if not request.instruments:
        return None, None
    asked = request.instruments.asked
    if readings.recording is None:
        raise UsageError("aids need what was recorded beside the readings: give the recording, not its summary")
    samples = in_memory(readings.recording)
    is_thin = len(samples) >= Level.unknowns and turned_level(samples.field)
    turn = _level_turn(readings, request) if is_thin else None
    if turn is not None and _is_white(turn):
        return None, _of_no_use(samples, asked)
    from flinders.fitting.aid_selection import aided_by

    aided, result = aided_by(
        samples,
        asked,
        site=request.site,
        dip_deg=request.dip_deg,
        spread=request.prior or SPREAD,
        **cast("dict[str, Any]", request.instruments.sigmas),
    )
    estimate = aided.estimate() if aided.aiding else None
    if is_thin or is_flat(readings.summary.moments.principal_variances, aided.noise):
        turn = turn or _level_turn(readings, request)
        if turn is None or estimate is None or _is_level(turn, estimate, request.dip_deg):
            return None, _of_no_use(samples, asked)
    return estimate, result


def _level_turn(readings: Readings, request: Request) -> Estimate | None:
    """What readings in one plane are as a level turn; None where they are none."""
    try:
        estimate = request.likelihood.estimate(readings)
    except FitError:
        return None
    return estimate if estimate.plane else None


def _is_white(estimate: Estimate) -> bool:
    """Residuals are not correlated."""
    return estimate.correlation is None or estimate.correlation.is_white


def _is_level(turn: Estimate, aided: Estimate, dip_deg: float) -> bool:
    """Whether the body stayed level: residuals of the turn are white, or a fit with aiding sensors knows far less.

    A body that leans moves the readings within the plane as well: they leave the ellipse, for as long as it leans.
    """
    worst = level_error(turn.ellipsoid, turn.covariance, dip_deg=dip_deg, down=down_of(turn.plane)).worst
    return _is_white(turn) or level_error(aided.ellipsoid, aided.covariance, dip_deg=dip_deg).worst > LEANING * worst


def _of_no_use(samples: Samples, aiding: str | Sequence[str]) -> Aiding:
    """Say of each aiding sensor that a level turn leaves it nothing to tell.

    Raises
    ------
    UsageError
        For one that is not known or was not recorded.
    """
    from flinders.estimators.aiding import refuse_without
    from flinders.fitting.aid_selection import available

    names = available(samples) if aiding == AUTO else (aiding,) if isinstance(aiding, str) else tuple(aiding)
    refuse_without(samples, names)
    words = "the readings lie in one plane, as in a level turn, across which it tells nothing"
    return Aiding(tuple(AidingSensor(name, is_used=False, reason=words) for name in names))
