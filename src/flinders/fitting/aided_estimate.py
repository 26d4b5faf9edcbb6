"""Estimate with aiding sensors; for a level turn they are used only if they show that the body leaned.

>>> from flinders import simulate
>>> from flinders.estimators import Readings
>>> from flinders.fitting.request import Request
>>> aided_estimate(Readings.of(simulate.tumble(seed=1, n=500, motion="uniform").samples), Request.of())
(None, None)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, cast

from flinders.core.joining import read_into_memory
from flinders.errors import FitError, UsageError
from flinders.estimators.level import Level, is_level_turn
from flinders.fitting.aiding import AUTO, Aiding, AidingSensor
from flinders.geometry.plane import down_direction
from flinders.heading.error_propagation import level_error
from flinders.likelihood.prior import SOFT_IRON_SPREAD
from flinders.summary.summary import is_flat

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.samples import Samples
    from flinders.estimators import Estimate, Readings
    from flinders.fitting.request import Request

MIN_LEANING_RATIO: Final = 10.0
"""Smallest heading error claimed by an aided fit of a level body, as a multiple of the error of a level turn.

The ratio is up to 8 in drives of half a minute and more than 100 in level turns. If the body leans, the error of the
fit as a level turn is up to 5 times its claim.
"""


def aided_estimate(readings: Readings, request: Request) -> tuple[Estimate | None, Aiding | None]:
    """Fit with aiding sensors; the estimate is None if no sensor was requested or used.

    Raises
    ------
    UsageError
        For a summary, which has no columns of aiding sensors.
    """
    if not request.instruments:
        return None, None
    asked = request.instruments.request
    if readings.recording is None:
        raise UsageError("aiding sensors need the columns of a recording, found only its summary: give the recording")
    samples = read_into_memory(readings.recording)
    is_thin = len(samples) >= Level.unknowns and is_level_turn(samples.field)
    turn = _level_turn(readings, request) if is_thin else None
    if turn is not None and _is_white(turn):
        return None, _report_unused(samples, asked)
    from flinders.fitting.aid_selection import fit_with_aids

    aided, result = fit_with_aids(
        samples,
        asked,
        site=request.site,
        dip_deg=request.dip_deg,
        spread=request.prior or SOFT_IRON_SPREAD,
        **cast("dict[str, Any]", request.instruments.sigmas),
    )
    estimate = aided.estimate() if aided.aiding else None
    if is_thin or is_flat(readings.summary.moments.principal_variances, aided.noise):
        turn = turn or _level_turn(readings, request)
        if turn is None or estimate is None or _is_level(turn, estimate, request.dip_deg):
            return None, _report_unused(samples, asked)
    return estimate, result


def _level_turn(readings: Readings, request: Request) -> Estimate | None:
    """Estimate as a level turn, for readings in one plane; None for other readings."""
    try:
        estimate = request.likelihood.estimate(readings)
    except FitError:
        return None
    return estimate if estimate.plane else None


def _is_white(estimate: Estimate) -> bool:
    """Whether residuals are uncorrelated."""
    return estimate.correlation is None or estimate.correlation.is_white


def _is_level(turn: Estimate, aided: Estimate, dip_deg: float) -> bool:
    """Whether the body stayed level: residuals of the turn are white, or the aided fit claims far more error.

    Residuals are not white if the body leaned, because leaning also moves readings off the ellipse within the plane.
    """
    worst = level_error(turn.ellipsoid, turn.covariance, dip_deg=dip_deg, down=down_direction(turn.plane)).worst
    return (
        _is_white(turn)
        or level_error(aided.ellipsoid, aided.covariance, dip_deg=dip_deg).worst > MIN_LEANING_RATIO * worst
    )


def _report_unused(samples: Samples, aiding: str | Sequence[str]) -> Aiding:
    """Report that each aiding sensor is unused because a level turn gives it no information.

    Raises
    ------
    UsageError
        For a sensor that is unknown or was not recorded.
    """
    from flinders.estimators.aiding import refuse_missing_columns
    from flinders.fitting.aid_selection import available

    names = available(samples) if aiding == AUTO else (aiding,) if isinstance(aiding, str) else tuple(aiding)
    refuse_missing_columns(samples, names)
    words = "the readings lie in one plane, as in a level turn, and it gives no information across that plane"
    return Aiding(tuple(AidingSensor(name, is_used=False, reason=words) for name in names))
