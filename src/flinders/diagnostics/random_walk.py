"""Whether a calibration stayed what it was: a random walk of the offset, followed through a recording.

The shape is kept, and the offset may wander by q per root of a second,

    b(t + dt) = b(t) + w,   cov w = q² dt · 1,        s_k = n_k · (b(t_k) − b) + noise

with s and n the Sampson distance and the normal of each reading. Readings of a short span are put together to
their normal equations, Σ n nᵀ and Σ n s; a Kalman filter goes over the spans, and a smoother back. q is that which
makes the recording most likely; without a walk (q = 0) it is the fit that it began with, and the gain in twice the
logarithm of the likelihood says which of both is true: as q cannot be negative, chance alone makes more than 2.7 in
one recording of twenty. Correlated residuals count for as many as are independent, else a body near iron
would pass for a walk.

When to use it: for a recording over minutes or hours, whose sensor warms up, whose cargo moves. Not to correct with:
the offset that it ends with is as uncertain as few readings make it. A single step looks like a walk as well, and
`path` shows when it came.

Source: Kalman (1960); smoothing after Rauch, Tung, Striebel (1965); the variance of a walk by its innovations as in
Harvey, "Forecasting, Structural Time Series Models and the Kalman Filter" (1989), §3.4.

>>> from flinders.geometry.ellipsoid import Ellipsoid
>>> rng = np.random.default_rng(1)
>>> directions = rng.normal(size=(6000, 3))
>>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
>>> moved = np.cumsum(rng.normal(scale=0.02, size=(6000, 3)), axis=0)
>>> still = 50.0 * directions + rng.normal(scale=0.5, size=directions.shape)
>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> seconds = np.arange(6000) / 50.0
>>> random_walk_of(still, seconds, sphere).is_proven, random_walk_of(still + moved, seconds, sphere).is_proven
(False, True)
>>> bool(0.1 < random_walk_of(still + moved, seconds, sphere).random_walk_per_root_s < 0.2)       # 0.02 · √50 = 0.14
True
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flinders.core.durations import duration
from flinders.core.joining import singles
from flinders.errors import NeedsSamples, TooFewSamples, figures
from flinders.estimators.covariance import Residuals, time_of
from flinders.estimators.in_plane import equator
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.geometry.plane import PlaneEllipse, order_of
from flinders.likelihood import magnitude
from flinders.likelihood.robust import robust_sigma
from flinders.summary.coverage import directions_of

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.geometry.plane import Plane

SPANS: Final = 200
"""Spans that a recording is cut into."""

FEWEST: Final = 100
"""Readings below which a walk is not told from noise."""

NEAR: Final = 4.0
"""Standard deviations of a residual, beyond which it is one of a stray and counts as those at that distance."""

PROVEN: Final = 2.7
"""Twice the logarithm of a likelihood ratio that chance makes more of in one recording of twenty."""

TRIED: Final = 25
"""Sizes of a walk that are tried, from none to one field over the recording."""

BARS: Final = "▁▂▃▄▅▆▇█"


@dataclass(frozen=True, slots=True, eq=False)
class RandomWalk:
    """How the offset moved over a recording."""

    random_walk_per_root_s: float  #: q, in the unit of the readings; the most likely one, 0 for a constant offset
    random_walk_upper_bound: float  #: what q could be with nineteen chances of twenty
    log_likelihood_gain: float  #: twice the logarithm of how much likelier the walk is than a constant offset
    time: Floats  #: (K,), s: middle of each span
    path: Floats  #: (K, 3): offset there, less that of the fit; where no walk is proven, one and the same all along
    #: (K, 3): its standard deviation; where no walk is proven, how far from `path` the largest that it could be may
    #: have been, rms
    sigma: Floats
    field: float  #: radius of the ellipsoid, in the same unit

    @property
    def is_proven(self) -> bool:
        """It is no chance that the offset moved."""
        return self.log_likelihood_gain > PROVEN

    @property
    def offset_change(self) -> float:
        """How far the offset went at the most from where it began, in the unit of the readings."""
        return float(np.linalg.norm(self.path - self.path[0], axis=1).max())

    @property
    def seconds(self) -> float:
        """How long the recording is."""
        return float(self.time[-1] - self.time[0])

    def valid_for_s(self, level_deg: float, *, dip_deg: float = 60.0) -> float:
        """For how long a calibration holds to a heading error (1 σ), in s, if the offset goes on as it did.

        A walk turns the heading by q √t / (F cos dip); where none is proven, the largest that it could be counts.

        >>> walk = RandomWalk(0.0, 0.01, 0.0, np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)), 50.0)
        >>> round(walk.valid_for_s(1.0) / 60.0)
        32
        """
        q = self.random_walk_per_root_s if self.is_proven else self.random_walk_upper_bound
        level = np.deg2rad(level_deg) * self.field * np.cos(np.deg2rad(dip_deg))
        return float((level / q) ** 2) if q > 0.0 else np.inf

    @property
    def at_most_moved(self) -> float:
        """How far (1 σ) the largest walk that it could be goes over the recording, in the unit of the readings."""
        return float(self.random_walk_upper_bound * np.sqrt(self.seconds))

    def is_determined(self, level_deg: float, *, dip_deg: float = 60.0) -> bool:
        """Whether the recording tells if the offset stayed: a walk that goes beyond this level in it would show."""
        return self.is_proven or self.valid_for_s(level_deg, dip_deg=dip_deg) >= self.seconds

    def words(self, unit: str, *, level_deg: float = 1.0, dip_deg: float = 60.0) -> str:
        """Say how far the offset moved, and for how long a calibration holds."""
        lifetime = duration(self.valid_for_s(level_deg, dip_deg=dip_deg))
        least = "" if self.is_proven else "at least "
        story = self.story(unit, level_deg=level_deg, dip_deg=dip_deg)
        return f"{story}; {level_deg:g}° of heading (1 σ, dip {dip_deg:.0f}°) takes {least}{lifetime}"

    def story(self, unit: str, *, level_deg: float = 1.0, dip_deg: float = 60.0) -> str:
        """Say how far the offset moved, or that nobody can tell to this level."""
        over = duration(self.seconds)
        if not self.is_determined(level_deg, dip_deg=dip_deg):
            return (
                f"cannot tell whether the offset stayed where it was: {figures(self.at_most_moved)} {unit} over {over} "
                "would not show in this recording"
            )
        if not self.is_proven:
            return f"the offset stayed where it was over {over}, as far as this recording tells"
        return (
            f"the offset moved by up to {figures(self.offset_change)} {unit} over {over}, as in a "
            f"random walk of {figures(self.random_walk_per_root_s)} {unit}/√s"
        )

    def drawn(self, width: int = 60) -> str:
        """Draw how far the offset was from where it began, in a line of bars.

        >>> path = np.outer(np.linspace(0.0, 7.0, 8), [1.0, 0.0, 0.0])
        >>> RandomWalk(1.0, 1.0, 9.0, np.arange(8.0), path, np.ones((8, 3)), 50.0).drawn(8)
        '▁▂▃▄▅▆▇█'
        """
        far = np.linalg.norm(self.path - self.path[0], axis=1)
        rows = np.array_split(far, min(width, len(far)))
        heights = np.array([row.mean() for row in rows])
        most = max(float(heights.max()), np.finfo(float).tiny)
        return "".join(BARS[round(float(height / most) * (len(BARS) - 1))] for height in heights)

    def as_dict(self, *, level_deg: float = 1.0, dip_deg: float = 60.0) -> dict[str, Any]:
        """JSON-ready; `valid_for_s` is None for any time, ."""
        valid_for_s = self.valid_for_s(level_deg, dip_deg=dip_deg)
        return {
            "limit_deg": level_deg,  # heading error (1 σ) that `valid_for_s` is for
            "valid_for_s": valid_for_s if np.isfinite(valid_for_s) else None,
            "random_walk_per_root_s": self.random_walk_per_root_s,
            "random_walk_upper_bound": self.random_walk_upper_bound,
            "log_likelihood_gain": self.log_likelihood_gain,
            "is_proven": self.is_proven,
            "is_determined": self.is_determined(level_deg, dip_deg=dip_deg),
            "offset_change": self.offset_change,
            "seconds": self.seconds,
            "time_s": self.time.tolist(),  # (K,): middle of each span
            "path": self.path.tolist(),
            "sigma": self.sigma.tolist(),
        }


class _Spans(NamedTuple):
    """What the readings of each span say of the offset, in standard deviations."""

    time: Floats  #: (K,), s
    information: Floats  #: (K, 3, 3): Σ n nᵀ / σ²
    gradient: Floats  #: (K, 3): Σ n s / σ²


def random_walk_of(
    readings: Floats,
    time: Floats | None,
    ellipsoid: Ellipsoid,
    *,
    plane: Plane | None = None,
    dip_deg: float = 60.0,
    is_own: bool = True,
) -> RandomWalk:
    """Follow the offset through a recording.

    What was turned in one plane tells of the offset in that plane alone, and across it nothing is said to move.

    Raises `NeedsSamples` without times that go forward; `TooFewSamples` for fewer than a hundred readings.

    Parameters
    ----------
    readings : (N, 3) float
        In the order of recording.
    time : (N,) float, s
    ellipsoid : Ellipsoid
        The fit to them.
    plane : str, optional
        That of a fit to readings of one plane.
    dip_deg : float
        With a plane: the inclination that the fit was made with.
    is_own : bool
        The ellipsoid is the fit to these readings, and what they lie off it is noise. Of another one, noise is what is
        left beside a course of twelve pieces.
    """
    if time is None or not bool(np.all(np.diff(time) >= 0.0)) or time[-1] <= time[0]:
        raise NeedsSamples("walk")
    if len(readings) < FEWEST:
        raise TooFewSamples(found=len(readings), needed=FEWEST, method="walk")
    laid = (readings, ellipsoid) if plane is None else _laid_flat(readings, ellipsoid, plane, dip_deg)
    spans = _spans(*laid, time, is_own=is_own)
    sizes = np.append(0.0, np.geomspace(1e-6, 1.0, TRIED - 1) * ellipsoid.radius / np.sqrt(time[-1] - time[0]))
    likelihoods = _filtered(spans, sizes, ellipsoid.radius).likelihood
    gain = 2.0 * float(likelihoods.max() - likelihoods[0])
    q = _refined(sizes, likelihoods, int(np.argmax(likelihoods)))
    at_most = float(sizes[likelihoods > likelihoods.max() - PROVEN / 2.0].max())
    path, sigma = _followed(spans, q, ellipsoid.radius) if gain > PROVEN else _steady(spans, at_most, ellipsoid.radius)
    return RandomWalk(q, at_most, gain, spans.time, path, sigma, ellipsoid.radius)


def _followed(spans: _Spans, q: float, radius: float) -> tuple[Floats, Floats]:
    """Path (K, 3) of a walk, and its standard deviation (K, 3)."""
    path, covariance = _smoothed(_filtered(spans, np.array([q]), radius))
    return path[:, 0], _sigma(covariance[:, 0])


def _steady(spans: _Spans, at_most: float, radius: float) -> tuple[Floats, Floats]:
    """One offset (K, 3) all along, and how far (K, 3) from it a walk of this size may have been, rms."""
    paths, covariances = _smoothed(_filtered(spans, np.array([0.0, at_most]), radius))
    path = np.tile(paths[-1, 0], (len(paths), 1))  # rounding apart the same in all spans
    return path, np.hypot(paths[:, 1] - path, _sigma(covariances[:, 1]))


def _sigma(covariance: Floats) -> Floats:
    """(K, 3) standard deviations."""
    sigma: Floats = np.sqrt(np.maximum(np.einsum("kii->ki", covariance), 0.0))
    return sigma


def walk_through(
    recording: Recording,
    ellipsoid: Ellipsoid,
    *,
    plane: Plane | None = None,
    dip_deg: float = 60.0,
    is_own: bool = True,
) -> RandomWalk:
    """Follow the offset through a recording, or through the first of several: nobody knows what was between two.

    As `random_walk_of` otherwise.

    Raises `NeedsSamples` or `TooFewSamples` as `random_walk_of`.
    """
    single = next(iter(singles(recording)))
    blocks = [block for block in single.blocks() if len(block)]
    if not blocks:
        raise TooFewSamples(found=0, needed=FEWEST, method="walk")
    times = [block.time for block in blocks if block.time is not None]
    time = np.concatenate(times) if len(times) == len(blocks) else None
    field = np.concatenate([block.field for block in blocks])
    return random_walk_of(field, time, ellipsoid, plane=plane, dip_deg=dip_deg, is_own=is_own)


def _laid_flat(readings: Floats, ellipsoid: Ellipsoid, plane: Plane, dip_deg: float) -> tuple[Floats, Ellipsoid]:
    """Readings without what they are across their plane, and the ellipsoid whose equator is the ellipse in it."""
    first, second, third = order_of(plane)
    seen, dip = [first, second], np.deg2rad(dip_deg)
    centre = ellipsoid.centre[seen] + np.sin(dip) * ellipsoid.shape[seen, third]
    level = equator(PlaneEllipse(centre, np.cos(dip) * ellipsoid.shape[np.ix_(seen, seen)]))
    there = np.argsort([first, second, third])
    flat = readings.copy()
    flat[:, third] = 0.0
    return flat, Ellipsoid(level.centre[there], level.shape[np.ix_(there, there)])


def _spans(readings: Floats, ellipsoid: Ellipsoid, time: Floats, *, is_own: bool = True) -> _Spans:
    """Put readings together, a reading that is far off with no more weight than one at the limit."""
    distances = magnitude.distances(readings, ellipsoid)
    jacobian = magnitude.information(directions_of(readings, ellipsoid), ellipsoid)
    residuals = distances if is_own else distances - _in_pieces(distances, jacobian, time)
    noise = max(robust_sigma(residuals), 1e-9 * ellipsoid.radius)
    weights = np.minimum(1.0, NEAR * noise / np.maximum(np.abs(residuals), np.finfo(float).tiny)) ** 2
    left = distances * np.sqrt(weights)
    alike = _time_of_noise(left, jacobian, time)
    normals = jacobian[:, :3] * (weights / (noise**2 * alike))[:, np.newaxis]
    edges = np.linspace(time[0], time[-1], min(SPANS, len(time) // 10) + 1)
    span = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(edges) - 2)
    count = len(edges) - 1
    information, gradient = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(information, span, np.einsum("ni,nj->nij", normals, jacobian[:, :3]))
    np.add.at(gradient, span, normals * distances[:, np.newaxis])
    return _Spans((edges[:-1] + edges[1:]) / 2.0, information, gradient)


def _time_of_noise(left: Floats, jacobian: Floats, time: Floats) -> float:
    """Readings that say as much as one independent one, once a walk of a few spans was subtracted from them."""
    residuals = Residuals(left - _in_pieces(left, jacobian, time), jacobian, [np.arange(len(left))])
    return max(1.0, time_of(residuals.autocovariance()))


def _in_pieces(left: Floats, jacobian: Floats, time: Floats) -> Floats:
    """(N,) what offsets make of distances that stay the same for a twelfth of the recording each."""
    slow = np.clip(((time - time[0]) / (time[-1] - time[0]) * 12.0).astype(int), 0, 11)
    smooth = np.zeros(len(left))
    for part in range(12):
        rows = slow == part
        if np.count_nonzero(rows) > 12:
            normals = jacobian[rows, :3]
            smooth[rows] = normals @ np.linalg.lstsq(normals, left[rows], rcond=1e-6)[0]
    return smooth


class _Filtered(NamedTuple):
    """What a Kalman filter knew after each span, and before it, for each of T sizes of a walk."""

    likelihood: Floats  #: (T,): logarithm of the recording's, but for a constant
    before: Floats  #: (K, T, 3)
    after: Floats  #: (K, T, 3)
    covariance_before: Floats  #: (K, T, 3, 3)
    covariance_after: Floats  #: (K, T, 3, 3)


def _filtered(spans: _Spans, sizes: Floats, radius: float) -> _Filtered:
    """Go over the spans, in information form: of g = Σ n s / σ² with N = Σ n nᵀ / σ², g − N b has the covariance N.

    Parameters
    ----------
    sizes : (T,) float
        Of a walk, q; a filter for each of them goes along.
    radius : float
        Of the ellipsoid: the offset begins within a tenth of it.
    """
    count, unity = len(spans.time), np.eye(3)
    steps = np.diff(spans.time, prepend=spans.time[0])
    wandered = sizes[:, np.newaxis, np.newaxis] ** 2 * unity
    state, covariance = np.zeros((len(sizes), 3)), np.tile((0.1 * radius) ** 2 * unity, (len(sizes), 1, 1))
    before, after = np.empty((2, count, len(sizes), 3))
    covariance_before, covariance_after = np.empty((2, count, len(sizes), 3, 3))
    likelihood = np.zeros(len(sizes))
    for place in range(count):
        covariance = covariance + steps[place] * wandered
        before[place], covariance_before[place] = state, covariance
        information, gradient = spans.information[place], spans.gradient[place]
        predicted = state @ information  # N is symmetric
        innovation = gradient - predicted
        wider = unity + covariance @ information
        gained = np.linalg.solve(wider, covariance)  # (P⁻¹ + N)⁻¹
        moved = np.einsum("tij,tj->ti", gained, innovation)
        likelihood += state @ gradient - 0.5 * np.einsum("ti,ti->t", predicted, state)  # of what was predicted
        likelihood += 0.5 * (np.einsum("ti,ti->t", innovation, moved) - np.linalg.slogdet(wider)[1])
        state = state + moved
        covariance = (gained + gained.swapaxes(1, 2)) / 2.0
        after[place], covariance_after[place] = state, covariance
    return _Filtered(likelihood, before, after, covariance_before, covariance_after)


def _smoothed(filtered: _Filtered) -> tuple[Floats, Floats]:
    """Paths (K, T, 3) and their covariance (K, T, 3, 3), knowing the whole recording; Rauch, Tung and Striebel."""
    path, covariance = filtered.after.copy(), filtered.covariance_after.copy()
    ahead = filtered.covariance_before[1:]
    gains = np.linalg.solve(ahead, filtered.covariance_after[:-1]).swapaxes(2, 3)
    for place in range(len(path) - 2, -1, -1):
        gain = gains[place]
        path[place] += np.einsum("tij,tj->ti", gain, path[place + 1] - filtered.before[place + 1])
        covariance[place] += gain @ (covariance[place + 1] - ahead[place]) @ gain.swapaxes(1, 2)
    return path, covariance


def _refined(sizes: Floats, likelihoods: Floats, best: int) -> float:
    """The most likely size by a parabola in its logarithm; none where none is best."""
    if best == 0:
        return 0.0
    if not 1 < best < len(sizes) - 1:
        return float(sizes[best])
    low, middle, high = likelihoods[best - 1 : best + 2]
    bend = low - 2.0 * middle + high
    step = np.log(sizes[best + 1] / sizes[best])
    return float(sizes[best] * np.exp(0.5 * (low - high) / bend * step)) if bend < 0.0 else float(sizes[best])
