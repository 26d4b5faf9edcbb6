"""Tests of the instruments recorded with a magnetometer: unit, axes, rotation about one axis, site, source of yaw.

Each fault is a `Mistake`, whose finding has a number, a limit and a remedy. A fit leaves instruments with a fault out.
``python -m benchmarks.wrong_use`` measures how often each fault is found, and how often one is reported wrongly.

>>> from dataclasses import replace
>>> from flinders import simulate
>>> from flinders.geometry.ellipsoid import Ellipsoid
>>> true = simulate.tumble(seed=1, motion="swayed", n=500)
>>> ellipsoid = Ellipsoid(true.sensor.offset, true.field_strength * true.sensor.matrix)
>>> in_degrees = replace(true.samples, rate=np.rad2deg(true.samples.rate))
>>> [(one.code, one.drops) for one in instrument_mistakes(in_degrees, ellipsoid, ("rate", "dip"))[1]]
[('gyro-unit', True)]
>>> instrument_mistakes(true.samples, ellipsoid, ("rate", "dip"))
(None, [])
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.samples import Samples
from flinders.estimators.accelerometer import rest_scatter
from flinders.estimators.aiding import AidedFit, fit_aided
from flinders.estimators.mounting import (
    MAX_RATE_RESIDUAL,
    RAD_S,
    REVERSED_AXES,
    MountingFit,
    fit_accelerometer_axes,
    fit_gyro_axes,
    second_axis_ratio,
)
from flinders.findings import Finding, certain_finding, finding_in
from flinders.geometry.rotation import lengths
from flinders.heading.attitude import magnetic_heading_deg, tilt_error_deg
from flinders.heading.error_propagation import direction_error_deg, level_error
from flinders.heading.harmonics import design
from flinders.likelihood import attitude, dip, gyro
from flinders.likelihood.gyro import SCALE_SIGMA
from flinders.likelihood.magnitude import distances
from flinders.summary.quality import DataQuality

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.core.axes import Axes
    from flinders.core.calibration import Calibration
    from flinders.estimators import Estimate
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.likelihood.site_field import Site

CIRCULAR_DEG, CIRCULAR_SIGMAS, CIRCULAR_SHARE = 0.5, 3.0, 0.5
"""Limits of the yaw error that shows a yaw from a compass: degrees, ratio to the claim, share that is a deviation."""

MIN_ATTITUDES: Final = 12
"""Smallest count of known attitudes for the test of the source of a yaw."""

MAX_READINGS: Final = 5000
"""Largest count of readings for the tests of the source of a yaw and of a shaken accelerometer."""

MAX_ROUNDS: Final = 3
"""Count of rounds in which, in turn, an offset and the direction of the remaining field are found."""

VERTICAL_SENSORS: Final = ("dip", "tilt", "attitude")
"""Aiding sensors that show the vertical, of which a fit uses one."""

NEAR_END_SHARE, MIN_CLIPPED_RATIO = 0.05, 1.0
"""Limits of a saturated gyro axis.

The first is the share of the range that counts as near its end. The second is the smallest ratio of the readings at the
end to those near it.
"""

MIN_STILL_READINGS, MAX_STILL_SCATTER = 100, 0.02
"""Conditions for a tilt by an accelerometer: smallest count of readings, largest relative scatter of |g| at rest."""

MIN_TILT_ERROR_DEG: Final = 0.5
"""Smallest reported heading error from tilt; of 1,000 simulated accelerometers without errors none reached 0.3°."""

FAR_SITE_DEG, FAR_SITE_SIGMAS = 2.0, 3.0
"""Limits of the dip's difference from that of the site: in degrees, and in standard deviations of both."""


LEAN_DEG, LEAN_SIGMAS = 1.5, 3.0
"""Limits of the lean of a vertical in turns: in degrees, and as a ratio to the claimed heading error.

Of 1,002 recordings without a lean none exceeds them (``python -m benchmarks.wrong_use --cases leaning --seeds 167``).
"""

MIN_SIGNED_DIP_DEG: Final = 10.0
"""Smallest dip in degrees that cannot change its sign because of iron nearby."""


@dataclass(frozen=True, slots=True)
class Mistake:
    """A fault of an aiding sensor in a recording."""

    aid: str  # name of the aiding sensor
    finding: Finding  # finding on the fault
    drops: bool = False  # whether the fit leaves the sensor out

    @property
    def code(self) -> str:
        """Code of the finding."""
        return self.finding.code

    @property
    def number(self) -> float:
        """Number of the finding."""
        return self.finding.number

    @property
    def words(self) -> str:
        """Sentence of the finding."""
        return self.finding.advice


def _mistake(code: str, aid: str, values: dict[str, Any], *, drops: bool = True) -> Mistake | None:
    """Mistake of the finding `code`, if the catalogue's rule applies to `values`; else None."""
    finding = finding_in({**values, "aid": aid}, code)
    return None if finding is None else Mistake(aid, finding, drops)


def _certain_mistake(code: str, aid: str, values: dict[str, Any], *, drops: bool = True) -> Mistake:
    """Mistake of the finding `code` without a test by a rule."""
    return Mistake(aid, certain_finding({**values, "aid": aid}, code), drops)


def instrument_mistakes(
    samples: Samples, alone: Ellipsoid, wanted: Sequence[str], *, is_signed: bool = False
) -> tuple[Axes | None, list[Mistake]]:
    """Find mistakes in the unit and the axes of gyro and accelerometer.

    An instrument is left out if its axes cannot be determined. If gyro and accelerometer have different axes, the one
    that agrees with the magnetometer is used.

    `alone` is the ellipsoid of the magnetometer alone. Of the sensors `wanted`, only ``rate`` and ``dip`` are tested.
    `is_signed` states that the sign of the dip is known, by which a mirrored axis is later distinguished from half a
    turn.

    Returns
    -------
    axes : Axes, optional
        Axes of the magnetometer relative to the usable instruments, if they differ from the recorded ones; else None.
    mistakes : list of Mistake
    """
    empty = [
        mistake for aid in wanted if (mistake := _empty_column(samples, aid) or _clipped_gyro(samples, aid)) is not None
    ]
    wanted = [aid for aid in wanted if aid not in {mistake.aid for mistake in empty}]
    turned = fit_gyro_axes(samples, alone) if "rate" in wanted else MountingFit()
    felt = fit_accelerometer_axes(samples, alone) if "dip" in wanted else MountingFit()
    mistakes = []
    if turned.residual > MAX_RATE_RESIDUAL:
        turned, mistakes = MountingFit(), [_unrelated_gyro(turned)]
    if not turned.is_as_recorded:
        contradicted = felt.is_as_recorded and not felt.is_allowed(turned.axes)
        mistakes.append(_wrong_axes("rate", turned, contradicted=contradicted, is_signed=is_signed))
    is_used = "rate" in wanted and not any(mistake.drops for mistake in mistakes)
    if not felt.is_as_recorded:
        contradicted = is_used and not felt.is_allowed(turned.axes)
        mistakes.append(_wrong_axes("dip", felt, contradicted=contradicted, is_signed=is_signed))
    used = [mistake.aid for mistake in mistakes if not mistake.drops]
    return (None if not used else turned.axes if "rate" in used else felt.axes), [*empty, *mistakes]


def fill_gyro_gaps(samples: Samples, wanted: Sequence[str]) -> tuple[Samples, list[Mistake]]:
    """Fill short gaps of the gyro by `flinders.likelihood.gyro.bridge_gaps`; a finding states the share of readings.

    >>> from dataclasses import replace
    >>> from flinders import simulate
    >>> samples = simulate.tumble(seed=1, motion="swayed", n=500).samples
    >>> samples.rate[::5] = np.nan
    >>> [(one.code, round(one.number, 3)) for one in fill_gyro_gaps(samples, ["rate"])[1]]
    [('gyro-gaps', 0.198)]
    """
    if "rate" not in wanted:
        return samples, []
    rate, count = gyro.bridge_gaps(samples.time, samples.rate)
    if not count:
        return samples, []
    gaps = {
        "gaps": count,
        "samples": len(samples),
        "gap_share": count / len(samples),
        "longest_gap": gyro.MAX_BRIDGED_READINGS,
    }
    return replace(samples, rate=rate), [_certain_mistake("gyro-gaps", "rate", gaps, drops=False)]


def gyro_scale_mistake(off: float) -> Mistake:
    """Mistake of a gyro whose scale error is implausibly large.

    >>> gyro_scale_mistake(0.2).words[:71]
    'for this recording the scales of the gyro would have to be off by 20%; '
    """
    return _certain_mistake(
        "gyro-scales", "rate", {"scales_off": min(off, 1.0), "scale_error": off, "usual": SCALE_SIGMA}
    )


def gyro_contradiction(aid: str, off: float) -> Mistake:
    """Mistake of an aiding sensor that contradicts a gyro which agrees with the magnetometer."""
    return _certain_mistake("aids-disagree", aid, {"scales_off": min(off, 1.0), "scale_error": off})


def lean_mistake(samples: Samples, aided: AidedFit, claimed_deg: float = 0.0) -> Mistake | None:
    """Mistake of an accelerometer whose vertical leans in turns by more than the claim explains; None without one.

    `aided` should be a fit without the accelerometer, because a fit with it absorbs most of the lean.

    >>> from flinders import simulate
    >>> flown = simulate.tumble(seed=1, motion="flight", n=1500).samples
    >>> mistake = lean_mistake(flown, fit_aided(flown, ()))
    >>> mistake is not None and mistake.code
    'leans-in-turns'
    """
    limit = max(LEAN_DEG, LEAN_SIGMAS * claimed_deg)
    numbers = {"lean_deg": lean_in_turns_deg(samples, aided), "lean_limit_deg": limit}
    return _mistake("leans-in-turns", "dip", numbers)


def divergence(aid: str, before_deg: float, after_deg: float) -> Mistake | None:
    """Mistake of an aiding sensor with which the fit claims a many times larger heading error; None without one.

    >>> mistake = divergence("dip", 2.1, 180.0)
    >>> mistake is not None and mistake.words[:75]
    "the fit claims a heading error of 180° with 'dip' and 2.1° without 'dip': t"
    """
    numbers = {"times_claim": after_deg / max(before_deg, 1e-9), "with_deg": after_deg, "without_deg": before_deg}
    return _mistake("aid-diverged", aid, numbers)


def implausible_vertical(aided: AidedFit, aid: str) -> Mistake | None:
    """Mistake of a vertical or attitude that contradicts the readings with any mounting; None without one.

    >>> from flinders.geometry.quaternions import inverse, from_angles, rotate_vectors
    >>> attitude = from_angles(np.random.default_rng(1).uniform(-1.5, 1.5, (300, 3)))
    >>> field = rotate_vectors(inverse(attitude), np.tile([25.0, 0.0, 43.0], (300, 1)))
    >>> implausible_vertical(fit_aided(Samples.of(field, attitude=attitude), ("tilt",)), "tilt")
    >>> mistake = implausible_vertical(fit_aided(Samples.of(field, attitude=inverse(attitude)), ("tilt",)), "tilt")
    >>> mistake is not None and mistake.code
    'aid-astray'
    """
    off = aided.vertical_noise
    if aid not in VERTICAL_SENSORS or off is None:
        return None
    return _mistake("aid-astray", aid, {"astray_rad": off, "astray_deg": float(np.rad2deg(off))})


def one_axis_mistakes(rate: Floats) -> list[Mistake]:
    """Mistakes of a recording in which all rotation is about one axis; empty for others.

    `rate` is (N, 3), rad/s, without the gyro's bias.

    >>> one_axis_mistakes(np.outer(np.linspace(-1.0, 1.0, 50), [0.0, 0.0, 1.0]))[0].code
    'one-axis'
    """
    mistake = _mistake("one-axis", "rate", {"second_axis": second_axis_ratio(rate)}, drops=False)
    return [] if mistake is None else [mistake]


def is_at_another_site(aided: AidedFit, site: Site | None) -> bool:
    """Whether the fitted dip contradicts that of the site, which the fit assumed."""
    if site is None or site.inclination_deg is None or aided.dip_difference is None:
        return False
    return is_other_dip(dip_of(aided), site) and abs(aided.dip_difference) > FAR_SITE_SIGMAS


def is_other_dip(seen_deg: float, site: Site, sigma_deg: float = 0.0) -> bool:
    """Whether a dip, with its 1 σ, differs from that of the site by more than iron or rock can cause."""
    beyond = max(FAR_SITE_DEG, FAR_SITE_SIGMAS * sigma_deg)
    return site.inclination_deg is not None and abs(seen_deg - site.inclination_deg) > beyond


def wrong_dip_mistake(seen_deg: float, site: Site) -> Mistake:
    """Mistake of a dip that is not the site's; a negated dip suggests an accelerometer with all signs reversed.

    >>> from flinders.likelihood.site_field import Site
    >>> wrong_dip_mistake(-59.6, Site(inclination_deg=60.0)).words
    'the field dips by -59.6° in the readings and by 60.0° at the site: the vertical seems to be upside down (level \
and at rest, an accelerometer reads −g on z); the site was not used'
    """
    there = site.inclination_deg or 0.0
    if abs(seen_deg + there) <= FAR_SITE_DEG:
        fault = "reversed"
    elif seen_deg * there < 0.0 and min(abs(seen_deg), abs(there)) > MIN_SIGNED_DIP_DEG:
        fault = "turned"
    else:
        fault = "elsewhere"
    numbers = {"dip_deg": seen_deg, "site_dip_deg": there, "dip_off_deg": abs(seen_deg - there)}
    return _certain_mistake("site-differs", "site", {**numbers, "site_fault": fault})


def dip_of(aided: AidedFit) -> float:
    """The fitted dip in degrees."""
    sine = aided.parameters.sine if "sine" in aided.layout else float(aided.parameters.direction[2])
    return float(np.rad2deg(np.arcsin(np.clip(sine, -1.0, 1.0))))


def compass_yaw_mistake(samples: Samples, reference: AidedFit, dip_deg: float) -> Mistake | None:
    """Mistake of a logged yaw that comes from an uncalibrated compass, such as this one; None without one.

    The field is corrected by a fit without that yaw, and rotated into the world by the logged attitude. It has a
    constant direction if the attitude is right. There are two signs of a yaw from a compass: the direction is much more
    constant after another offset is subtracted; or the error depends on the heading like a deviation,
    A + B sin ψ + C cos ψ + D sin 2ψ + E cos 2ψ. The mounting of the magnetometer comes from the logged vertical, which
    does not depend on yaw.

    Parameters
    ----------
    samples : Samples
        Readings with an attitude.
    reference : AidedFit
        A fit that does not use the yaw.
    dip_deg : float
        Inclination of the field, for the heading error that `reference` claims.
    """
    if samples.attitude is None:
        return None
    each = 1 if "rate" in reference.aiding else max(1, len(samples) // MAX_READINGS)
    matrices, samples = attitude.body_to_world(samples.attitude[::each]), samples[::each]
    known = np.isfinite(matrices[:, 0, 0])
    if np.count_nonzero(known) < MIN_ATTITUDES:
        return None
    if "tilt" not in reference.aiding:
        terms = (*(aid for aid in reference.aiding if aid == "rate"), "tilt")
        reference = fit_aided(samples, terms, near=reference, is_rough=True)
    matrices, field = matrices[known], samples.field[known]
    turned = _angles_from_mean(matrices, reference.correct(field))
    off = float(np.rad2deg(np.std(turned)))
    claimed = level_error(reference.ellipsoid, reference.covariance[:9, :9], dip_deg=dip_deg).rms
    limit = max(CIRCULAR_DEG, CIRCULAR_SIGMAS * claimed)
    columns = design(np.rad2deg(np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])))
    follows = columns[:, 1:] @ np.linalg.lstsq(columns, turned, rcond=None)[0][1:]
    deviation = float(np.rad2deg(np.std(follows)))
    shaped = reference.correct(field), field @ reference.parameters.rotation.T
    by_offset = min(float(np.rad2deg(np.std(_angles_with_offset(matrices, seated)))) for seated in shaped)
    if deviation > limit and np.var(follows) > CIRCULAR_SHARE * np.var(turned):
        amount = deviation
    elif off > limit and by_offset < CIRCULAR_SHARE * off:
        amount = off
    else:
        return None
    return _mistake("circular-attitude", "attitude", {"deviation_deg": amount, "deviation_limit_deg": limit})


def vertical_error_deg(field: Floats, acceleration: Floats, calibration: Calibration, estimate: Estimate) -> float:
    """Heading error (1 σ, degrees) from errors of the vertical that depend on the attitude, by the dip of readings.

    `field` and `acceleration` are (N, 3). NaN if the accelerometer was shaken, or below `MIN_TILT_ERROR_DEG`.
    """
    if len(field) < MIN_STILL_READINGS:
        return math.nan
    field, acceleration = field[: 10 * MAX_READINGS], acceleration[: 10 * MAX_READINGS]
    near = np.abs(distances(field, estimate.ellipsoid)) <= estimate.rejected_beyond
    field, acceleration = field[near], acceleration[near]
    own_deg = math.hypot(
        direction_error_deg(estimate.ellipsoid, estimate.covariance).worst, _correlated_error_deg(estimate)
    )
    added = tilt_error_deg(calibration.apply(field), acceleration, own_deg=own_deg)
    if not added > MIN_TILT_ERROR_DEG:
        return math.nan
    felt = acceleration[:: max(1, len(acceleration) // MAX_READINGS)]
    return added if rest_scatter(felt) < MAX_STILL_SCATTER else math.nan


def _correlated_error_deg(estimate: Estimate) -> float:
    """Error of a direction from correlated residuals, 1 σ, in degrees."""
    lasting = 0.0 if estimate.correlation is None else max(estimate.correlation.lag_one, 0.0)
    return math.degrees(estimate.noise * math.sqrt(lasting) / estimate.ellipsoid.radius)


def _empty_column(samples: Samples, aid: str) -> Mistake | None:
    """Mistake of a column without values; None for a column with values, and without such a column."""
    if aid == "rate" and samples.rate is not None and samples.time is not None:
        inside = gyro.window_rows(samples.time, samples.rate)
        usable = inside.size
    elif aid == "dip" and samples.acceleration is not None:
        usable = int(np.count_nonzero(dip.accelerometer_verticals(samples.acceleration)[1]))
    elif aid in ("tilt", "attitude") and samples.attitude is not None:
        usable = int(np.count_nonzero(np.isfinite(samples.attitude).all(axis=1)))
    else:
        return None
    return _mistake("aid-empty", aid, {"usable": usable, "samples": len(samples)})


def _clipped_gyro(samples: Samples, aid: str) -> Mistake | None:
    """Mistake of a saturated gyro: many readings at the end of an axis's range, many more than near the end."""
    if aid != "rate" or samples.rate is None:
        return None
    known = samples.rate[np.isfinite(samples.rate).all(axis=1)]
    for rail in DataQuality.of(Samples.of(known)).rails if len(known) else ():
        inside = np.abs(known[:, rail.axis] - rail.value)
        at_the_end = int(np.count_nonzero(inside == 0.0))
        width = NEAR_END_SHARE * float(np.ptp(known[:, rail.axis]))
        next_to_it = float(inside[inside > 0.0].min(initial=np.inf))
        before = int(np.count_nonzero((inside > 0.0) & (inside <= max(width, next_to_it))))
        if at_the_end > MIN_CLIPPED_RATIO * before:
            values = {"clipped_share": rail.share, "gyro_range": abs(rail.value), "axis": "xyz"[rail.axis]}
            return _mistake("gyro-clipped", "rate", values)
    return None


def _unrelated_gyro(mounted: MountingFit) -> Mistake:
    """Mistake of a gyro that does not explain the change of the field in any unit and axes."""
    return _certain_mistake("gyro-differs", "rate", {"gyro_leaves": mounted.residual})


def _wrong_axes(aid: str, mounted: MountingFit, *, contradicted: bool, is_signed: bool) -> Mistake:
    """Mistake of an instrument in wrong axes or a wrong unit, and whether it is left out."""
    if mounted.unit != RAD_S or (aid == "rate" and mounted.axes == REVERSED_AXES):
        rate_unit = "" if mounted.unit == RAD_S else mounted.unit
        axes = "" if mounted.axes.is_identity else str(mounted.axes)
        return _certain_mistake(
            "gyro-unit", aid, {"times_better": mounted.improvement, "rate_unit": rate_unit, "axes": axes}
        )
    drops = contradicted or not mounted.is_clear or mounted.axes.is_mirror
    is_half_turn = mounted.axes.order == (0, 1, 2) and not is_signed
    clear = "half-turned" if is_half_turn else "clear"
    seat = "contradicted" if contradicted else clear if mounted.is_clear else "unclear"
    seat = "mirrored" if mounted.axes.is_mirror else seat
    values = {"times_better": mounted.improvement, "axes": str(mounted.axes), "seat": seat}
    return _certain_mistake("swapped-axes", aid, values, drops=drops)


def _angles_from_mean(matrices: Floats, corrected: Floats) -> Floats:
    """(N,) horizontal angle in rad of each corrected field from the mean direction, after rotation into world axes."""
    world = np.einsum("nij,nj->ni", matrices, corrected)
    across = world[:, 0] + 1j * world[:, 1]
    middle = np.sum(across)
    angles: Floats = np.angle(across * np.conj(middle / max(abs(middle), 1e-300)))
    return angles


def _angles_with_offset(matrices: Floats, field: Floats) -> Floats:
    """(N,) angles from the mean direction, in rad, after subtracting the offset that minimises them.

    The component across the mean direction is linear in the offset; the direction converges in a few rounds.
    """
    offset = np.zeros(3)
    for _ in range(MAX_ROUNDS):
        north = np.einsum("nij,nj->i", matrices, field - offset)
        east = np.array([-north[1], north[0], 0.0]) / max(float(np.hypot(north[0], north[1])), 1e-300)
        rows = np.einsum("i,nij->nj", east, matrices)
        offset = np.linalg.lstsq(rows, np.einsum("nj,nj->n", rows, field), rcond=1e-6)[0]
    return _angles_from_mean(matrices, field - offset)


MEAN_S: Final = 1.0
"""Duration in s over which readings are averaged; turns last longer."""

MIN_MEANS: Final = 20
"""Smallest count of means over `MEAN_S`, for nine unknowns."""


def lean_in_turns_deg(samples: Samples, aided: AidedFit) -> float:
    """Angle (rms, degrees) by which the vertical of an accelerometer leans in proportion to the rate of rotation.

    A vehicle that turns at the rate ω with speed s is accelerated sideways by sω. Its vertical v then leans to the
    other side by ωw, with w constant in the body. The residual of the dip, |v| sin I − vᵀq, contains ω wᵀq. Means over
    1 s of the residual are regressed on the three components of ωq, and |w| times the rms rate is the lean. If the fit
    does not include the accelerometer, its rotation and its bias are unknown. They add multiples of the components of v
    × q and of q − (vᵀq)v, which are further regressors.

    `samples` need times and an acceleration. `aided` is a fit to them, best without ``dip``, because a fit with it
    absorbs part of the lean. The result is 0 if no lean can be determined.

    >>> from flinders import simulate
    >>> swayed, flown = (simulate.tumble(seed=1, motion=motion, n=1500).samples for motion in ("swayed", "flight"))
    >>> lean_in_turns_deg(swayed, fit_aided(swayed, ())) < 0.2, lean_in_turns_deg(flown, fit_aided(flown, ())) > 10.0
    (True, True)
    """
    if samples.acceleration is None or samples.time is None:
        return 0.0
    down, trust = dip.accelerometer_verticals(samples.acceleration)
    known = (trust > 0.0) & np.isfinite(samples.time)
    field, time = aided.correct(samples.field[known]), samples.time[known]
    if not len(time) > 1 or not np.all(np.diff(time) > 0.0):
        return 0.0
    vertical, _ = dip.correct_verticals(down[known], aided.parameters.accelerometer)
    q = field / np.maximum(lengths(field), 1e-300)[:, np.newaxis]
    turning = np.gradient(np.unwrap(np.deg2rad(np.nan_to_num(magnetic_heading_deg(q, -vertical)))), time)
    left = dip.dip_residuals(vertical[np.newaxis], q[np.newaxis], aided.parameters.sine)[0]
    across = q - np.einsum("ni,ni->n", vertical, q)[:, np.newaxis] * vertical
    others = () if "sine" in aided.layout else (np.cross(vertical, q), across)
    rows = _means(np.column_stack([left, turning, turning[:, np.newaxis] * q, *others]), time)
    if len(rows) < MIN_MEANS:
        return 0.0
    rows -= rows.mean(axis=0)
    lean = np.linalg.lstsq(rows[:, 2:], rows[:, 0], rcond=1e-6)[0][:3]
    return float(np.rad2deg(np.linalg.norm(lean) * np.std(rows[:, 1])))


def _means(rows: Floats, time: Floats) -> Floats:
    """(M, K) means of (N, K) rows over intervals of `MEAN_S`."""
    each = max(1, round(MEAN_S / float(np.median(np.diff(time)))))
    whole = len(rows) // each * each
    means: Floats = rows[:whole].reshape(-1, each, rows.shape[1]).mean(axis=1)
    return means
