"""What is wrong with what stands beside a magnetometer: unit, axes, turning about one axis, another site, its own yaw.

Each is a `Mistake` with its number, its limit and what to do; what cannot be trusted is left out of a fit. How often
each is named, and how often wrongly, is measured by ``python -m benchmarks.wrong_use``.

>>> from dataclasses import replace
>>> from flinders import simulate
>>> from flinders.geometry.ellipsoid import Ellipsoid
>>> true = simulate.tumble(seed=1, motion="swayed", n=500)
>>> ellipsoid = Ellipsoid(true.sensor.offset, true.field_strength * true.sensor.matrix)
>>> in_degrees = replace(true.samples, rate=np.rad2deg(true.samples.rate))
>>> [(one.code, one.drops) for one in of_instruments(in_degrees, ellipsoid, ("rate", "dip"))[1]]
[('gyro-unit', True)]
>>> of_instruments(true.samples, ellipsoid, ("rate", "dip"))
(None, [])
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.core.samples import Samples
from flinders.estimators.accelerometer import scatter_at_rest
from flinders.estimators.aiding import Aided, solve
from flinders.estimators.mounting import (
    EXPLAINED,
    RAD_S,
    REVERSED,
    Mounted,
    by_rate,
    by_vertical,
    second_axis,
)
from flinders.findings import Finding, certain, finding_in
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
"""A yaw that is off by so much, so far beyond what is claimed without it, and mostly as a compass, is a compass's."""

FEWEST_ATTITUDES: Final = 12
"""Known ones; fewer tell nothing of where a yaw comes from."""

FOLLOWED: Final = 5000
"""Readings that tell where a yaw comes from, or whether an accelerometer was shaken."""

ROUNDS: Final = 3
"""Of finding an offset and where the rest points."""

UPRIGHT: Final = ("dip", "tilt", "attitude")
"""Aiding that tell the vertical: one of them at a time."""

JUST_BEFORE, MANY_MORE = 0.05, 1.0
"""Of the range of a gyro's axis, what is just before its end; and how many times as many readings are at a limit."""

FEWEST_STILL, STILL = 100, 0.02
"""Readings that tell how an accelerometer tilts, and the scatter of |g| up to which they are of a body at rest."""

LEAST_TILT_DEG: Final = 0.5
"""Heading error below which the tilt is noise: of a thousand clean accelerometers none came to 0.3°."""

FAR_SITE_DEG, FAR_SITE_SIGMAS = 2.0, 3.0
"""A dip that is off by more, and by more of what both are known to, is another place's."""


LEAN_DEG, LEAN_SIGMAS = 1.5, 3.0
"""A vertical that leans by more, and by more of what a fit claims of headings, is none in turns.

Of 1,002 that do not lean none is named (``python -m benchmarks.wrong_use --cases leaning --seeds 167``).
"""

STEEP_DEG: Final = 10.0
"""A steeper dip has a sign that no iron near it turns round."""


@dataclass(frozen=True, slots=True)
class Mistake:
    """What does not fit together in a recording: a finding, which sensor it is about, and whether that was left out."""

    aid: str
    finding: Finding
    drops: bool = False

    @property
    def code(self) -> str:
        """Of the finding."""
        return self.finding.code

    @property
    def number(self) -> float:
        """Of the finding."""
        return self.finding.number

    @property
    def words(self) -> str:
        """Of the finding."""
        return self.finding.advice


def _mistake(code: str, aid: str, values: dict[str, Any], *, drops: bool = True) -> Mistake | None:
    """What the catalogue makes of some values."""
    finding = finding_in({**values, "aid": aid}, code)
    return None if finding is None else Mistake(aid, finding, drops)


def _certain(code: str, aid: str, values: dict[str, Any], *, drops: bool = True) -> Mistake:
    """The same, where it was decided already."""
    return Mistake(aid, certain({**values, "aid": aid}, code), drops)


def of_instruments(
    samples: Samples, alone: Ellipsoid, wanted: Sequence[str], *, is_signed: bool = False
) -> tuple[Axes | None, list[Mistake]]:
    """Look for mistakes in the unit and the axes of gyro and accelerometer.

    An instrument is left out where it cannot be told how it sits, and where the two do not sit alike: then the one
    that sits as the magnetometer is right.

    `alone`: what the magnetometer finds by itself, well or badly; `wanted`: ``rate`` and ``dip`` are looked at;
    `is_signed`: the sign of the dip is known, by which a mirrored axis is told from half a turn afterwards.

    Returns
    -------
    axes : Axes, optional
        How the magnetometer sits among those that can be used, where that is not as recorded.
    mistakes : list of Mistake
    """
    empty = [mistake for aid in wanted if (mistake := _empty(samples, aid) or _clipped(samples, aid)) is not None]
    wanted = [aid for aid in wanted if aid not in {mistake.aid for mistake in empty}]
    turned = by_rate(samples, alone) if "rate" in wanted else Mounted()
    felt = by_vertical(samples, alone) if "dip" in wanted else Mounted()
    mistakes = []
    if turned.left > EXPLAINED:
        turned, mistakes = Mounted(), [_strange(turned)]
    if not turned.is_as_recorded:
        contradicted = felt.is_as_recorded and not felt.allows(turned.axes)
        mistakes.append(_misread("rate", turned, contradicted=contradicted, is_signed=is_signed))
    is_used = "rate" in wanted and not any(mistake.drops for mistake in mistakes)
    if not felt.is_as_recorded:
        contradicted = is_used and not felt.allows(turned.axes)
        mistakes.append(_misread("dip", felt, contradicted=contradicted, is_signed=is_signed))
    used = [mistake.aid for mistake in mistakes if not mistake.drops]
    return (None if not used else turned.axes if "rate" in used else felt.axes), [*empty, *mistakes]


def without_gaps(samples: Samples, wanted: Sequence[str]) -> tuple[Samples, list[Mistake]]:
    """Fill short gaps of the gyro, see `flinders.likelihood.gyro.bridged`, and say how many readings that was.

    >>> from dataclasses import replace
    >>> from flinders import simulate
    >>> samples = simulate.tumble(seed=1, motion="swayed", n=500).samples
    >>> samples.rate[::5] = np.nan
    >>> [(one.code, round(one.number, 3)) for one in without_gaps(samples, ["rate"])[1]]
    [('gyro-gaps', 0.198)]
    """
    if "rate" not in wanted:
        return samples, []
    rate, count = gyro.bridged(samples.time, samples.rate)
    if not count:
        return samples, []
    gaps = {"gaps": count, "samples": len(samples), "gap_share": count / len(samples), "longest_gap": gyro.BRIDGED}
    return replace(samples, rate=rate), [_certain("gyro-gaps", "rate", gaps, drops=False)]


def of_scales(off: float) -> Mistake:
    """Say that a gyro's scales are farther off than those of gyros are.

    >>> of_scales(0.2).words[:76]
    "the gyro's scales would be off by 20%, and those of gyros are by 2% or so: c"
    """
    return _certain("gyro-scales", "rate", {"scales_off": min(off, 1.0), "scale_error": off, "usual": SCALE_SIGMA})


def of_aid_and_gyro(aid: str, off: float) -> Mistake:
    """Say that an aid does not go with a gyro that by itself goes with the magnetometer."""
    return _certain("aids-disagree", aid, {"scales_off": min(off, 1.0), "scale_error": off})


def of_turns(samples: Samples, aided: Aided, claimed_deg: float = 0.0) -> Mistake | None:
    """Whether the vertical of an accelerometer leans in turns, by more than what a fit claims explains.

    A fit without the accelerometer shows it best: one with it bends until little of the lean is left.

    >>> from flinders import simulate
    >>> flown = simulate.tumble(seed=1, motion="flight", n=1500).samples
    >>> mistake = of_turns(flown, solve(flown, ()))
    >>> mistake is not None and mistake.code
    'leans-in-turns'
    """
    limit = max(LEAN_DEG, LEAN_SIGMAS * claimed_deg)
    numbers = {"lean_deg": lean_in_turns_deg(samples, aided), "lean_limit_deg": limit}
    return _mistake("leans-in-turns", "dip", numbers)


def is_diverged(aid: str, before_deg: float, after_deg: float) -> Mistake | None:
    """Whether a fit has gone astray with an aid: it claims many times the heading error of the fit without it.

    >>> mistake = is_diverged("dip", 2.1, 180.0)
    >>> mistake is not None and mistake.words[:75]
    "the fit claims a heading error of 180° with 'dip', 2.1° without: what it me"
    """
    numbers = {"times_claim": after_deg / max(before_deg, 1e-9), "with_deg": after_deg, "without_deg": before_deg}
    return _mistake("aid-diverged", aid, numbers)


def is_implausible(aided: Aided, aid: str) -> Mistake | None:
    """Whether a vertical, or an attitude, does not go with the readings however the magnetometer sits.

    >>> from flinders.geometry.quaternions import inverse, of_angles, rotated
    >>> attitude = of_angles(np.random.default_rng(1).uniform(-1.5, 1.5, (300, 3)))
    >>> field = rotated(inverse(attitude), np.tile([25.0, 0.0, 43.0], (300, 1)))
    >>> is_implausible(solve(Samples.of(field, attitude=attitude), ("tilt",)), "tilt")
    >>> mistake = is_implausible(solve(Samples.of(field, attitude=inverse(attitude)), ("tilt",)), "tilt")
    >>> mistake is not None and mistake.code
    'aid-astray'
    """
    off = aided.vertical_noise
    if aid not in UPRIGHT or off is None:
        return None
    return _mistake("aid-astray", aid, {"astray_rad": off, "astray_deg": float(np.rad2deg(off))})


def one_axis(rate: Floats) -> list[Mistake]:
    """Say where all turning is about one axis.

    `rate`: (N, 3), rad/s, without the gyro's bias.

    >>> one_axis(np.outer(np.linspace(-1.0, 1.0, 50), [0.0, 0.0, 1.0]))[0].code
    'one-axis'
    """
    mistake = _mistake("one-axis", "rate", {"second_axis": second_axis(rate)}, drops=False)
    return [] if mistake is None else [mistake]


def is_at_another_site(aided: Aided, site: Site | None) -> bool:
    """Whether the dip that was found cannot be that of the site, which the fit took it for."""
    if site is None or site.inclination_deg is None or aided.site_off is None:
        return False
    return is_far(dip_of(aided), site) and abs(aided.site_off) > FAR_SITE_SIGMAS


def is_far(seen_deg: float, site: Site, sigma_deg: float = 0.0) -> bool:
    """Whether a dip, known to so much, is farther from that of the site than iron and rock and chance make it."""
    beyond = max(FAR_SITE_DEG, FAR_SITE_SIGMAS * sigma_deg)
    return site.inclination_deg is not None and abs(seen_deg - site.inclination_deg) > beyond


def wrong_dip(seen_deg: float, site: Site) -> Mistake:
    """Say that the dip is not the site's; an accelerometer with all signs reversed has that of the other side.

    >>> from flinders.likelihood.site_field import Site
    >>> wrong_dip(-59.6, Site(inclination_deg=60.0)).words
    'the field dips by -59.6°, at the site it should by 60.0°: the vertical seems to be upside down, as an \
accelerometer that lies level reads −g on z; the site was not used'
    """
    there = site.inclination_deg or 0.0
    if abs(seen_deg + there) <= FAR_SITE_DEG:
        fault = "reversed"
    elif seen_deg * there < 0.0 and min(abs(seen_deg), abs(there)) > STEEP_DEG:
        fault = "turned"
    else:
        fault = "elsewhere"
    numbers = {"dip_deg": seen_deg, "site_dip_deg": there, "dip_off_deg": abs(seen_deg - there)}
    return _certain("site-differs", "site", {**numbers, "site_fault": fault})


def dip_of(aided: Aided) -> float:
    """The dip in degrees, of a fit that looked for it."""
    sine = aided.parameters.sine if "sine" in aided.layout else float(aided.parameters.direction[2])
    return float(np.rad2deg(np.arcsin(np.clip(sine, -1.0, 1.0))))


def circular(samples: Samples, reference: Aided, dip_deg: float) -> Mistake | None:
    """Whether a logged yaw comes from a compass that was not calibrated, such as this one.

    The field, corrected without that yaw and turned into the world by the logged attitude, points the same way at all
    times if the attitude is right. Two things give a compass away. Readings less some other offset point the same way,
    and much better so. Or the error goes with the heading, A + B sin ψ + C cos ψ + D sin 2ψ + E cos 2ψ, as a deviation
    does. How the magnetometer sits comes from the logged vertical, which no yaw disturbs.

    Parameters
    ----------
    samples : Samples
        With an attitude.
    reference : Aided
        A fit that knows nothing of that yaw.
    dip_deg : float
        Inclination at which what it claims is taken.
    """
    if samples.attitude is None:
        return None
    each = 1 if "rate" in reference.aiding else max(1, len(samples) // FOLLOWED)
    matrices, samples = attitude.body_to_world(samples.attitude[::each]), samples[::each]
    known = np.isfinite(matrices[:, 0, 0])
    if np.count_nonzero(known) < FEWEST_ATTITUDES:
        return None
    if "tilt" not in reference.aiding:
        terms = (*(aid for aid in reference.aiding if aid == "rate"), "tilt")
        reference = solve(samples, terms, near=reference, is_rough=True)
    matrices, field = matrices[known], samples.field[known]
    turned = _from_the_middle(matrices, reference.corrected(field))
    off = float(np.rad2deg(np.std(turned)))
    claimed = level_error(reference.ellipsoid, reference.covariance[:9, :9], dip_deg=dip_deg).rms
    limit = max(CIRCULAR_DEG, CIRCULAR_SIGMAS * claimed)
    columns = design(np.rad2deg(np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])))
    follows = columns[:, 1:] @ np.linalg.lstsq(columns, turned, rcond=None)[0][1:]
    deviation = float(np.rad2deg(np.std(follows)))
    shaped = reference.corrected(field), field @ reference.parameters.rotation.T
    by_offset = min(float(np.rad2deg(np.std(_less_an_offset(matrices, seated)))) for seated in shaped)
    if deviation > limit and np.var(follows) > CIRCULAR_SHARE * np.var(turned):
        amount = deviation
    elif off > limit and by_offset < CIRCULAR_SHARE * off:
        amount = off
    else:
        return None
    return _mistake("circular-attitude", "attitude", {"deviation_deg": amount, "deviation_limit_deg": limit})


def vertical_error_deg(field: Floats, acceleration: Floats, calibration: Calibration, estimate: Estimate) -> float:
    """Heading error (1 σ) by a vertical that leans with the attitude, as the dip of (N, 3) readings shows it.

    NaN where the accelerometer was shaken, and below `LEAST_TILT_DEG`.
    """
    if len(field) < FEWEST_STILL:
        return math.nan
    field, acceleration = field[: 10 * FOLLOWED], acceleration[: 10 * FOLLOWED]
    near = np.abs(distances(field, estimate.ellipsoid)) <= estimate.rejected_beyond
    field, acceleration = field[near], acceleration[near]
    own_deg = math.hypot(direction_error_deg(estimate.ellipsoid, estimate.covariance).worst, _lasting_deg(estimate))
    added = tilt_error_deg(calibration.apply(field), acceleration, own_deg=own_deg)
    if not added > LEAST_TILT_DEG:
        return math.nan
    felt = acceleration[:: max(1, len(acceleration) // FOLLOWED)]
    return added if scatter_at_rest(felt) < STILL else math.nan


def _lasting_deg(estimate: Estimate) -> float:
    """Angle by which residuals that last move a direction, 1 σ."""
    lasting = 0.0 if estimate.correlation is None else max(estimate.correlation.lag_one, 0.0)
    return math.degrees(estimate.noise * math.sqrt(lasting) / estimate.ellipsoid.radius)


def _empty(samples: Samples, aid: str) -> Mistake | None:
    """Say where a column is there and nothing is in it; one that is not there is no matter of this."""
    if aid == "rate" and samples.rate is not None and samples.time is not None:
        inside = gyro.windows(samples.time, samples.rate)
        usable = inside.size
    elif aid == "dip" and samples.acceleration is not None:
        usable = int(np.count_nonzero(dip.verticals(samples.acceleration)[1]))
    elif aid in ("tilt", "attitude") and samples.attitude is not None:
        usable = int(np.count_nonzero(np.isfinite(samples.attitude).all(axis=1)))
    else:
        return None
    return _mistake("aid-empty", aid, {"usable": usable, "samples": len(samples)})


def _clipped(samples: Samples, aid: str) -> Mistake | None:
    """Say where a gyro was at its limit: many readings share the end of an axis, many more than lie just before it."""
    if aid != "rate" or samples.rate is None:
        return None
    known = samples.rate[np.isfinite(samples.rate).all(axis=1)]
    for rail in DataQuality.of(Samples.of(known)).rails if len(known) else ():
        inside = np.abs(known[:, rail.axis] - rail.value)
        at_the_end = int(np.count_nonzero(inside == 0.0))
        width = JUST_BEFORE * float(np.ptp(known[:, rail.axis]))
        next_to_it = float(inside[inside > 0.0].min(initial=np.inf))
        before = int(np.count_nonzero((inside > 0.0) & (inside <= max(width, next_to_it))))
        if at_the_end > MANY_MORE * before:
            values = {"clipped_share": rail.share, "gyro_range": abs(rail.value), "axis": "xyz"[rail.axis]}
            return _mistake("gyro-clipped", "rate", values)
    return None


def _strange(mounted: Mounted) -> Mistake:
    """Say that a gyro does not tell how the field moves, in whatever unit and axes."""
    return _certain("gyro-differs", "rate", {"gyro_leaves": mounted.left})


def _misread(aid: str, mounted: Mounted, *, contradicted: bool, is_signed: bool) -> Mistake:
    """What is wrong with an instrument, and whether it can be used all the same."""
    if mounted.unit != RAD_S or (aid == "rate" and mounted.axes == REVERSED):
        rate_unit = "" if mounted.unit == RAD_S else mounted.unit
        axes = "" if mounted.axes.is_identity else str(mounted.axes)
        return _certain("gyro-unit", aid, {"times_better": mounted.better, "rate_unit": rate_unit, "axes": axes})
    drops = contradicted or not mounted.is_clear or mounted.axes.is_mirror
    is_half_turn = mounted.axes.order == (0, 1, 2) and not is_signed
    clear = "half-turned" if is_half_turn else "clear"
    seat = "contradicted" if contradicted else clear if mounted.is_clear else "unclear"
    seat = "mirrored" if mounted.axes.is_mirror else seat
    values = {"times_better": mounted.better, "axes": str(mounted.axes), "seat": seat}
    return _certain("swapped-axes", aid, values, drops=drops)


def _from_the_middle(matrices: Floats, corrected: Floats) -> Floats:
    """(N,) angle of a field (N, 3) in the world's plane from its mean direction, rad."""
    world = np.einsum("nij,nj->ni", matrices, corrected)
    across = world[:, 0] + 1j * world[:, 1]
    middle = np.sum(across)
    angles: Floats = np.angle(across * np.conj(middle / max(abs(middle), 1e-300)))
    return angles


def _less_an_offset(matrices: Floats, field: Floats) -> Floats:
    """(N,) angles from the mean direction that are left once the offset is removed with which they are least.

    What is left across the mean direction is linear in the offset; the direction follows in a few rounds.
    """
    offset = np.zeros(3)
    for _ in range(ROUNDS):
        north = np.einsum("nij,nj->i", matrices, field - offset)
        east = np.array([-north[1], north[0], 0.0]) / max(float(np.hypot(north[0], north[1])), 1e-300)
        rows = np.einsum("i,nij->nj", east, matrices)
        offset = np.linalg.lstsq(rows, np.einsum("nj,nj->n", rows, field), rcond=1e-6)[0]
    return _from_the_middle(matrices, field - offset)


MEAN_S: Final = 1.0
"""Over which noise is averaged; turns last longer."""

FEWEST: Final = 20
"""Means of nine unknowns."""


def lean_in_turns_deg(samples: Samples, aided: Aided) -> float:
    """Angle (rms) by which the vertical of an accelerometer leans with the rate of turning.

    A vehicle that turns at the rate ω at speed s is accelerated by sω to one side of its body, and its vertical v leans
    to the other, by ωw, with w at rest in the body. In the dip of a fit, |v| sin I − vᵀq, that leaves ω wᵀq: means over
    a second are regressed on the three products, and |w| times the rms rate is the lean. Where a fit knows nothing of
    the accelerometer, its rotation against the magnetometer leaves a multiple of each of v × q, and its bias one of
    each of q − (vᵀq)v: both are regressed on as well.

    `samples`: with times and an acceleration, or there is nothing to see; `aided`: a fit to them, best without ``dip``:
    that one bends until less of the lean is left. Returns degrees, 0 where nothing is seen.

    >>> from flinders import simulate
    >>> swayed, flown = (simulate.tumble(seed=1, motion=motion, n=1500).samples for motion in ("swayed", "flight"))
    >>> lean_in_turns_deg(swayed, solve(swayed, ())) < 0.2, lean_in_turns_deg(flown, solve(flown, ())) > 10.0
    (True, True)
    """
    if samples.acceleration is None or samples.time is None:
        return 0.0
    down, trust = dip.verticals(samples.acceleration)
    known = (trust > 0.0) & np.isfinite(samples.time)
    field, time = aided.corrected(samples.field[known]), samples.time[known]
    if not len(time) > 1 or not np.all(np.diff(time) > 0.0):
        return 0.0
    vertical, _ = dip.upright(down[known], aided.parameters.accelerometer)
    q = field / np.maximum(lengths(field), 1e-300)[:, np.newaxis]
    turning = np.gradient(np.unwrap(np.deg2rad(np.nan_to_num(magnetic_heading_deg(q, -vertical)))), time)
    left = dip.residuals(vertical[np.newaxis], q[np.newaxis], aided.parameters.sine)[0]
    across = q - np.einsum("ni,ni->n", vertical, q)[:, np.newaxis] * vertical
    others = () if "sine" in aided.layout else (np.cross(vertical, q), across)
    rows = _means(np.column_stack([left, turning, turning[:, np.newaxis] * q, *others]), time)
    if len(rows) < FEWEST:
        return 0.0
    rows -= rows.mean(axis=0)
    lean = np.linalg.lstsq(rows[:, 2:], rows[:, 0], rcond=1e-6)[0][:3]
    return float(np.rad2deg(np.linalg.norm(lean) * np.std(rows[:, 1])))


def _means(rows: Floats, time: Floats) -> Floats:
    """(M, K) means of (N, K) rows over `MEAN_S`."""
    each = max(1, round(MEAN_S / float(np.median(np.diff(time)))))
    whole = len(rows) // each * each
    means: Floats = rows[:whole].reshape(-1, each, rows.shape[1]).mean(axis=1)
    return means
