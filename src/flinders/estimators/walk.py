"""Whether a calibration stayed what it was: a random walk of the offset, followed through a recording.

The shape is kept, and the offset may wander by q per root of a second,

    b(t + dt) = b(t) + w,   cov w = q² dt · 1,        s_k = n_k · (b(t_k) − b) + noise

with s and n the Sampson distance and the normal of each reading. Readings of a short span are put together to
their normal equations, Σ n nᵀ and Σ n s; a Kalman filter goes over the spans, and a smoother back. q is that which
makes the recording most likely; without a walk (q = 0) it is the fit that it began with, and the gain in twice the
logarithm of the likelihood says which of both is true: as q cannot be negative, chance alone makes more than 2.7 in
one recording of twenty. Residuals that hang together count for as many as are independent, else a body near iron
would pass for a walk.

When to use it: for a recording over minutes or hours, whose sensor warms up, whose cargo moves. Not to correct with:
the offset that it ends with is as uncertain as few readings make it. A single step looks like a walk as well, and
`path` shows when it came.

Source: Kalman (1960); smoothing after Rauch, Tung, Striebel (1965); the variance of a walk by its innovations as in
Harvey, "Forecasting, Structural Time Series Models and the Kalman Filter" (1989), §3.4.

>>> from flinders.quadric import Ellipsoid
>>> rng = np.random.default_rng(1)
>>> directions = rng.normal(size=(6000, 3))
>>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
>>> moved = np.cumsum(rng.normal(scale=0.02, size=(6000, 3)), axis=0)
>>> still = 50.0 * directions + rng.normal(scale=0.5, size=directions.shape)
>>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
>>> seconds = np.arange(6000) / 50.0
>>> walk_of(still, seconds, sphere).is_proven, walk_of(still + moved, seconds, sphere).is_proven
(False, True)
>>> bool(0.1 < walk_of(still + moved, seconds, sphere).per_root_second < 0.2)       # 0.02 · √50 = 0.14
True
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flinders.coverage import directions_of
from flinders.errors import NeedsSamples, TooFewSamples, figures
from flinders.estimators.correlation import Residuals, time_of
from flinders.estimators.settling import spread_of
from flinders.samples import singles
from flinders.terms import magnitude

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.quadric import Ellipsoid
    from flinders.samples import Recording

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
class Walk:
    """How the offset moved over a recording.

    Attributes
    ----------
    per_root_second : float
        q, in the unit of the readings; the most likely one, 0 for a constant offset.
    at_most : float
        What q could be with nineteen chances of twenty.
    gain : float
        Twice the logarithm of how much likelier the walk is than a constant offset.
    time : (K,) float, s
        Middle of each span.
    path : (K, 3) float
        Offset there, less that of the fit.
    sigma : (K, 3) float
        Its standard deviation.
    field : float
        Radius of the ellipsoid, in the same unit.
    """

    per_root_second: float
    at_most: float
    gain: float
    time: Floats
    path: Floats
    sigma: Floats
    field: float

    @property
    def is_proven(self) -> bool:
        """It is no chance that the offset moved."""
        return self.gain > PROVEN

    @property
    def moved(self) -> float:
        """How far the offset went at the most from where it began, in the unit of the readings."""
        return float(np.linalg.norm(self.path - self.path[0], axis=1).max())

    @property
    def seconds(self) -> float:
        """How long the recording is."""
        return float(self.time[-1] - self.time[0])

    def valid_for_s(self, level_deg: float, *, dip_deg: float = 60.0) -> float:
        """For how long a calibration holds to a heading error (1 σ), in s, if the offset goes on as it did.

        A walk turns the heading by q √t / (F cos dip); where none is proven, the largest that it could be counts.

        >>> walk = Walk(0.0, 0.01, 0.0, np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)), 50.0)
        >>> round(walk.valid_for_s(1.0) / 60.0)
        32
        """
        q = self.per_root_second if self.is_proven else self.at_most
        level = np.deg2rad(level_deg) * self.field * np.cos(np.deg2rad(dip_deg))
        return float((level / q) ** 2) if q > 0.0 else np.inf

    def words(self, unit: str, *, level_deg: float = 1.0, dip_deg: float = 60.0) -> str:
        """Say how far the offset moved, and for how long a calibration holds."""
        over, held = _duration(self.seconds), _duration(self.valid_for_s(level_deg, dip_deg=dip_deg))
        if not self.is_proven:
            return (
                f"the offset stayed where it was over {over}, as far as this recording tells: valid for at least "
                f"{held} at this level ({level_deg:g}° of heading, 1 σ, dip {dip_deg:.0f}°)"
            )
        return (
            f"the offset moved by up to {figures(self.moved)} {unit} over {over}, as by "
            f"{figures(self.per_root_second)} {unit} per root of a second: valid for {held} at this level "
            f"({level_deg:g}° of heading, 1 σ, dip {dip_deg:.0f}°)"
        )

    def drawn(self, width: int = 60) -> str:
        """Draw how far the offset was from where it began, in a line of bars.

        >>> path = np.outer(np.linspace(0.0, 7.0, 8), [1.0, 0.0, 0.0])
        >>> Walk(1.0, 1.0, 9.0, np.arange(8.0), path, np.ones((8, 3)), 50.0).drawn(8)
        '▁▂▃▄▅▆▇█'
        """
        far = np.linalg.norm(self.path - self.path[0], axis=1)
        rows = np.array_split(far, min(width, len(far)))
        heights = np.array([row.mean() for row in rows])
        most = max(float(heights.max()), np.finfo(float).tiny)
        return "".join(BARS[round(float(height / most) * (len(BARS) - 1))] for height in heights)

    def as_dict(self, *, level_deg: float = 1.0, dip_deg: float = 60.0) -> dict[str, Any]:
        """JSON-ready; `valid_for_s` is None for any time."""
        held = self.valid_for_s(level_deg, dip_deg=dip_deg)
        return {
            "level_deg": level_deg,
            "valid_for_s": held if np.isfinite(held) else None,
            "per_root_second": self.per_root_second,
            "at_most": self.at_most,
            "gain": self.gain,
            "proven": self.is_proven,
            "moved": self.moved,
            "seconds": self.seconds,
            "time_s": self.time.tolist(),
            "path": self.path.tolist(),
            "sigma": self.sigma.tolist(),
        }


class _Spans(NamedTuple):
    """What the readings of each span say of the offset, in standard deviations.

    Attributes
    ----------
    time : (K,) float, s
    information : (K, 3, 3) float
        Σ n nᵀ / σ².
    gradient : (K, 3) float
        Σ n s / σ².
    """

    time: Floats
    information: Floats
    gradient: Floats


def walk_of(readings: Floats, time: Floats | None, ellipsoid: Ellipsoid) -> Walk:
    """Follow the offset through a recording.

    Parameters
    ----------
    readings : (N, 3) float
        In the order of recording.
    time : (N,) float, s
    ellipsoid : Ellipsoid
        The fit to them.

    Raises
    ------
    NeedsSamples
        Without times that go forward.
    TooFewSamples
        For fewer than a hundred readings.
    """
    if time is None or not bool(np.all(np.diff(time) >= 0.0)) or time[-1] <= time[0]:
        raise NeedsSamples("walk")
    if len(readings) < FEWEST:
        raise TooFewSamples(found=len(readings), needed=FEWEST, method="walk")
    spans = _spans(readings, time, ellipsoid)
    sizes = np.append(0.0, np.geomspace(1e-6, 1.0, TRIED - 1) * ellipsoid.radius / np.sqrt(time[-1] - time[0]))
    likelihoods = np.array([_filtered(spans, q, ellipsoid.radius).likelihood for q in sizes])
    best = int(np.argmax(likelihoods))
    q = _refined(sizes, likelihoods, best)
    path, sigma = _smoothed(_filtered(spans, q, ellipsoid.radius), spans, q)
    likely = likelihoods > likelihoods.max() - PROVEN / 2.0
    gain = 2.0 * float(likelihoods.max() - likelihoods[0])
    return Walk(q, float(sizes[likely].max()), gain, spans.time, path, sigma, ellipsoid.radius)


def walk_through(recording: Recording, ellipsoid: Ellipsoid) -> Walk:
    """Follow the offset through a recording, or through the first of several: nobody knows what was between two.

    Raises
    ------
    NeedsSamples, TooFewSamples
        As `walk_of`.
    """
    single = next(iter(singles(recording)))
    blocks = [block for block in single.blocks() if len(block)]
    if not blocks:
        raise TooFewSamples(found=0, needed=FEWEST, method="walk")
    times = [block.time for block in blocks if block.time is not None]
    time = np.concatenate(times) if len(times) == len(blocks) else None
    return walk_of(np.concatenate([block.field for block in blocks]), time, ellipsoid)


def _spans(readings: Floats, time: Floats, ellipsoid: Ellipsoid) -> _Spans:
    """Put readings together, a reading that is far off with no more weight than one at the limit."""
    distances = magnitude.distances(readings, ellipsoid)
    jacobian = magnitude.information(directions_of(readings, ellipsoid), ellipsoid)
    noise = max(spread_of(distances), 1e-9 * ellipsoid.radius)
    weights = np.minimum(1.0, NEAR * noise / np.maximum(np.abs(distances), np.finfo(float).tiny)) ** 2
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
    """Readings that say as much as one independent one, once a walk of a few spans was taken off them."""
    slow = np.clip(((time - time[0]) / (time[-1] - time[0]) * 12.0).astype(int), 0, 11)
    smooth = np.zeros(len(left))
    for part in range(12):
        rows = slow == part
        if np.count_nonzero(rows) > 12:
            normals = jacobian[rows, :3]
            smooth[rows] = normals @ np.linalg.lstsq(normals, left[rows], rcond=1e-6)[0]
    residuals = Residuals(left - smooth, jacobian, [np.arange(len(left))])
    return max(1.0, time_of(residuals.autocovariance()))


class _Filtered(NamedTuple):
    """What a Kalman filter knew after each span, and before it.

    Attributes
    ----------
    likelihood : float
        Logarithm of the recording's, but for a constant.
    before, after : (K, 3) float
    covariance_before, covariance_after : (K, 3, 3) float
    """

    likelihood: float
    before: Floats
    after: Floats
    covariance_before: Floats
    covariance_after: Floats


def _filtered(spans: _Spans, q: float, radius: float) -> _Filtered:
    """Go over the spans, in information form: of g = Σ n s / σ² with N = Σ n nᵀ / σ², g − N b has the covariance N."""
    count = len(spans.time)
    steps = np.diff(spans.time, prepend=spans.time[0])
    state, covariance = np.zeros(3), (0.1 * radius) ** 2 * np.eye(3)
    before, after = np.empty((count, 3)), np.empty((count, 3))
    covariance_before, covariance_after = np.empty((count, 3, 3)), np.empty((count, 3, 3))
    likelihood = 0.0
    for place in range(count):
        covariance = covariance + q**2 * steps[place] * np.eye(3)
        before[place], covariance_before[place] = state, covariance
        information, gradient = spans.information[place], spans.gradient[place]
        innovation = gradient - information @ state
        wider = np.eye(3) + covariance @ information
        gained = np.linalg.solve(wider, covariance)  # (P⁻¹ + N)⁻¹
        likelihood += float(state @ gradient) - 0.5 * float(state @ information @ state)  # of what was predicted
        likelihood += 0.5 * float(innovation @ gained @ innovation) - 0.5 * float(np.linalg.slogdet(wider)[1])
        state = state + gained @ innovation
        covariance = (gained + gained.T) / 2.0
        after[place], covariance_after[place] = state, covariance
    return _Filtered(likelihood, before, after, covariance_before, covariance_after)


def _smoothed(found: _Filtered, spans: _Spans, q: float) -> tuple[Floats, Floats]:
    """Path (K, 3) and its standard deviation (K, 3), knowing the whole recording; Rauch, Tung and Striebel."""
    path, covariance = found.after.copy(), found.covariance_after.copy()
    for place in range(len(spans.time) - 2, -1, -1):
        ahead = found.covariance_before[place + 1]
        gain = np.linalg.solve(ahead, found.covariance_after[place]).T
        path[place] = found.after[place] + gain @ (path[place + 1] - found.before[place + 1])
        covariance[place] = found.covariance_after[place] + gain @ (covariance[place + 1] - ahead) @ gain.T
    if q == 0.0:  # one offset, and rounding apart the same all along
        path[:] = path[-1]
    return path, np.sqrt(np.maximum(np.einsum("kii->ki", covariance), 0.0))


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


def _duration(seconds: float) -> str:
    """Write a time in the unit that suits it.

    >>> _duration(42.0), _duration(600.0), _duration(7200.0), _duration(1e6), _duration(np.inf)
    ('42 s', '10 min', '2.0 hours', '12 days', 'any time')
    """
    if not np.isfinite(seconds):
        return "any time"
    for size, least, name in ((86400.0, 2.0, "days"), (3600.0, 2.0, "hours"), (60.0, 2.0, "min"), (1.0, 0.0, "s")):
        if seconds >= least * size:
            return f"{figures(seconds / size)} {name}"
    return f"{figures(seconds)} s"
