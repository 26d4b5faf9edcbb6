"""Random walk of the offset within a recording, as a test whether a calibration stayed valid.

The shape is fixed, and the offset changes by q per root of a second,

    b(t + dt) = b(t) + w,   cov w = q² dt · 1,        s_k = n_k · (b(t_k) − b) + noise

with s and n the Sampson distance and the normal of each reading. Readings of a short span are summed to normal
equations, Σ n nᵀ and Σ n s. A Kalman filter runs over the spans, and a smoother back. q maximises the likelihood of the
recording. The test statistic is twice the logarithm of the likelihood ratio of q and of q = 0, a constant offset. As q
cannot be negative, chance gives more than 2.7 in one recording of twenty. Correlated residuals count as the equivalent
number of independent ones; otherwise residuals of a body near iron would be mistaken for a walk.

When to use it: for a recording over minutes or hours in which the sensor warms up or cargo moves. Do not correct with
the last offset, which is as uncertain as an offset from a few readings. A single step also appears as a walk;
`RandomWalk.path` shows its time.

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

from flinders.core.durations import duration_text
from flinders.core.joining import single_recordings
from flinders.errors import NeedsSamples, TooFewSamples, figures
from flinders.estimators.covariance import Residuals, correlation_length
from flinders.estimators.in_plane import equator_ellipsoid
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.geometry.plane import PlaneEllipse, axis_order
from flinders.likelihood import magnitude
from flinders.likelihood.robust import robust_sigma
from flinders.summary.coverage import corrected_directions

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.geometry.plane import Plane

SPANS: Final = 200
"""Count of spans that a recording is cut into."""

MIN_READINGS: Final = 100
"""Smallest count of readings; with fewer a walk cannot be distinguished from noise."""

MAX_RESIDUAL_SIGMAS: Final = 4.0
"""Largest residual in standard deviations; larger residuals, those of outliers, are clipped to it."""

MIN_LIKELIHOOD_GAIN: Final = 2.7
"""Smallest test statistic of a proven walk, which chance exceeds in one recording of twenty."""

TRIAL_SIZES: Final = 25
"""Count of tried sizes of a walk, from none to one field strength over the recording."""

BARS: Final = "▁▂▃▄▅▆▇█"


@dataclass(frozen=True, slots=True, eq=False)
class RandomWalk:
    """Random walk of the offset in a recording."""

    random_walk_per_root_s: float  #: most likely q, in the unit of the readings per √s; 0 for a constant offset
    random_walk_upper_bound: float  #: upper limit of q with a probability of 95 %
    log_likelihood_gain: float  #: twice the logarithm of the likelihood ratio of the walk and a constant offset
    time: Floats  #: (K,), s: middle of each span
    path: Floats  #: (K, 3): offset at `time` minus that of the fit; constant if no walk is proven
    #: (K, 3): standard deviation of `path`; if no walk is proven, rms distance of a walk with the upper bound
    #: from `path`
    sigma: Floats
    field: float  #: radius of the ellipsoid, in the unit of the readings

    @property
    def is_proven(self) -> bool:
        """Whether the offset moved significantly."""
        return self.log_likelihood_gain > MIN_LIKELIHOOD_GAIN

    @property
    def offset_change(self) -> float:
        """Largest distance of the offset from its start, in the unit of the readings."""
        return float(np.linalg.norm(self.path - self.path[0], axis=1).max())

    @property
    def seconds(self) -> float:
        """Duration of the recording."""
        return float(self.time[-1] - self.time[0])

    def valid_for_s(self, level_deg: float, *, dip_deg: float = 60.0) -> float:
        """Time in s until the walk causes a heading error of `level_deg` (1 σ).

        A walk changes the heading by q √t / (F cos dip). If no walk is proven, q is its upper bound.

        >>> walk = RandomWalk(0.0, 0.01, 0.0, np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)), 50.0)
        >>> round(walk.valid_for_s(1.0) / 60.0)
        32
        """
        q = self.random_walk_per_root_s if self.is_proven else self.random_walk_upper_bound
        level = np.deg2rad(level_deg) * self.field * np.cos(np.deg2rad(dip_deg))
        return float((level / q) ** 2) if q > 0.0 else np.inf

    @property
    def max_undetected_change(self) -> float:
        """Change of the offset (1 σ) over the recording by a walk with the upper bound, in the unit of the readings."""
        return float(self.random_walk_upper_bound * np.sqrt(self.seconds))

    def is_determined(self, level_deg: float, *, dip_deg: float = 60.0) -> bool:
        """Whether the test would detect a walk that causes a heading error of `level_deg` within the recording."""
        return self.is_proven or self.valid_for_s(level_deg, dip_deg=dip_deg) >= self.seconds

    def words(self, unit: str, *, level_deg: float = 1.0, dip_deg: float = 60.0) -> str:
        """Sentence on the change of the offset, and on how long a calibration stays within `level_deg`."""
        lifetime = duration_text(self.valid_for_s(level_deg, dip_deg=dip_deg))
        least = "" if self.is_proven else "at least "
        story = self.story(unit, level_deg=level_deg, dip_deg=dip_deg)
        return f"{story}; {level_deg:g}° of heading (1 σ, dip {dip_deg:.0f}°) takes {least}{lifetime}"

    def story(self, unit: str, *, level_deg: float = 1.0, dip_deg: float = 60.0) -> str:
        """Sentence on the change of the offset; it says so if the change is not determined to `level_deg`."""
        over = duration_text(self.seconds)
        if not self.is_determined(level_deg, dip_deg=dip_deg):
            return (
                f"cannot determine whether the offset moved: {figures(self.max_undetected_change)} {unit} over {over} "
                "would not show in this recording"
            )
        if not self.is_proven:
            return f"the offset did not move over {over}, as far as this recording shows"
        return (
            f"the offset moved by up to {figures(self.offset_change)} {unit} over {over}, as in a "
            f"random walk of {figures(self.random_walk_per_root_s)} {unit}/√s"
        )

    def to_bars(self, width: int = 60) -> str:
        """Line of bars that shows the distance of the offset from its start over time.

        >>> path = np.outer(np.linspace(0.0, 7.0, 8), [1.0, 0.0, 0.0])
        >>> RandomWalk(1.0, 1.0, 9.0, np.arange(8.0), path, np.ones((8, 3)), 50.0).to_bars(8)
        '▁▂▃▄▅▆▇█'
        """
        far = np.linalg.norm(self.path - self.path[0], axis=1)
        rows = np.array_split(far, min(width, len(far)))
        heights = np.array([row.mean() for row in rows])
        most = max(float(heights.max()), np.finfo(float).tiny)
        return "".join(BARS[round(float(height / most) * (len(BARS) - 1))] for height in heights)

    def as_dict(self, *, level_deg: float = 1.0, dip_deg: float = 60.0) -> dict[str, Any]:
        """JSON-ready; `valid_for_s` is None if unlimited."""
        valid_for_s = self.valid_for_s(level_deg, dip_deg=dip_deg)
        return {
            "limit_deg": level_deg,  # heading error (1 σ) for `valid_for_s`
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
    """Normal equations of the offset for each span, in standard deviations."""

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
    """Estimate the random walk of the offset in a recording.

    Readings in one plane determine the offset in that plane alone; across it the offset is constant.

    Raises `NeedsSamples` without increasing times; `TooFewSamples` for fewer than 100 readings.

    Parameters
    ----------
    readings : (N, 3) float
        Readings in the order of recording.
    time : (N,) float, s
        Times of the readings.
    ellipsoid : Ellipsoid
        Ellipsoid of a fit.
    plane : str, optional
        Plane of a fit to readings in one plane.
    dip_deg : float
        Inclination of the field of such a fit.
    is_own : bool
        Whether the ellipsoid was fitted to these readings, so that their residuals are noise. For another ellipsoid,
        noise is what remains after subtracting a constant offset in each of twelve pieces.
    """
    if time is None or not bool(np.all(np.diff(time) >= 0.0)) or time[-1] <= time[0]:
        raise NeedsSamples("walk")
    if len(readings) < MIN_READINGS:
        raise TooFewSamples(found=len(readings), needed=MIN_READINGS, method="walk")
    laid = (readings, ellipsoid) if plane is None else _flatten(readings, ellipsoid, plane, dip_deg)
    spans = _spans(*laid, time, is_own=is_own)
    sizes = np.append(0.0, np.geomspace(1e-6, 1.0, TRIAL_SIZES - 1) * ellipsoid.radius / np.sqrt(time[-1] - time[0]))
    likelihoods = _run_filter(spans, sizes, ellipsoid.radius).likelihood
    gain = 2.0 * float(likelihoods.max() - likelihoods[0])
    q = _refine_size(sizes, likelihoods, int(np.argmax(likelihoods)))
    at_most = float(sizes[likelihoods > likelihoods.max() - MIN_LIKELIHOOD_GAIN / 2.0].max())
    path, sigma = (
        _smoothed_path(spans, q, ellipsoid.radius)
        if gain > MIN_LIKELIHOOD_GAIN
        else _constant_path(spans, at_most, ellipsoid.radius)
    )
    return RandomWalk(q, at_most, gain, spans.time, path, sigma, ellipsoid.radius)


def _smoothed_path(spans: _Spans, q: float, radius: float) -> tuple[Floats, Floats]:
    """Path (K, 3) of a walk of size q, and its standard deviation (K, 3)."""
    path, covariance = _run_smoother(_run_filter(spans, np.array([q]), radius))
    return path[:, 0], _sigma(covariance[:, 0])


def _constant_path(spans: _Spans, at_most: float, radius: float) -> tuple[Floats, Floats]:
    """Constant path (K, 3), and rms distance (K, 3) of a walk of size `at_most` from it."""
    paths, covariances = _run_smoother(_run_filter(spans, np.array([0.0, at_most]), radius))
    path = np.tile(paths[-1, 0], (len(paths), 1))  # the same in all spans except for rounding
    return path, np.hypot(paths[:, 1] - path, _sigma(covariances[:, 1]))


def _sigma(covariance: Floats) -> Floats:
    """(K, 3) standard deviations of (K, 3, 3) covariances."""
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
    """Estimate the random walk of the offset in a recording, or in the first of several.

    Times between recordings are unknown. Other parameters are as for `random_walk_of`.

    Raises `NeedsSamples` or `TooFewSamples` as `random_walk_of`.
    """
    single = next(iter(single_recordings(recording)))
    blocks = [block for block in single.blocks() if len(block)]
    if not blocks:
        raise TooFewSamples(found=0, needed=MIN_READINGS, method="walk")
    times = [block.time for block in blocks if block.time is not None]
    time = np.concatenate(times) if len(times) == len(blocks) else None
    field = np.concatenate([block.field for block in blocks])
    return random_walk_of(field, time, ellipsoid, plane=plane, dip_deg=dip_deg, is_own=is_own)


def _flatten(readings: Floats, ellipsoid: Ellipsoid, plane: Plane, dip_deg: float) -> tuple[Floats, Ellipsoid]:
    """Readings projected into their plane, and the ellipsoid whose equator is the ellipse in it."""
    first, second, third = axis_order(plane)
    seen, dip = [first, second], np.deg2rad(dip_deg)
    centre = ellipsoid.centre[seen] + np.sin(dip) * ellipsoid.shape[seen, third]
    level = equator_ellipsoid(PlaneEllipse(centre, np.cos(dip) * ellipsoid.shape[np.ix_(seen, seen)]))
    there = np.argsort([first, second, third])
    flat = readings.copy()
    flat[:, third] = 0.0
    return flat, Ellipsoid(level.centre[there], level.shape[np.ix_(there, there)])


def _spans(readings: Floats, ellipsoid: Ellipsoid, time: Floats, *, is_own: bool = True) -> _Spans:
    """Sum readings to the normal equations of spans, with residuals clipped."""
    distances = magnitude.distances(readings, ellipsoid)
    jacobian = magnitude.information(corrected_directions(readings, ellipsoid), ellipsoid)
    residuals = distances if is_own else distances - _piecewise_effect(distances, jacobian, time)
    noise = max(robust_sigma(residuals), 1e-9 * ellipsoid.radius)
    weights = np.minimum(1.0, MAX_RESIDUAL_SIGMAS * noise / np.maximum(np.abs(residuals), np.finfo(float).tiny)) ** 2
    left = distances * np.sqrt(weights)
    alike = _correlation_length(left, jacobian, time)
    normals = jacobian[:, :3] * (weights / (noise**2 * alike))[:, np.newaxis]
    edges = np.linspace(time[0], time[-1], min(SPANS, len(time) // 10) + 1)
    span = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(edges) - 2)
    count = len(edges) - 1
    information, gradient = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(information, span, np.einsum("ni,nj->nij", normals, jacobian[:, :3]))
    np.add.at(gradient, span, normals * distances[:, np.newaxis])
    return _Spans((edges[:-1] + edges[1:]) / 2.0, information, gradient)


def _correlation_length(left: Floats, jacobian: Floats, time: Floats) -> float:
    """Count of readings equivalent to one independent reading, after subtracting a walk over few spans."""
    residuals = Residuals(left - _piecewise_effect(left, jacobian, time), jacobian, [np.arange(len(left))])
    return max(1.0, correlation_length(residuals.autocovariance()))


def _piecewise_effect(left: Floats, jacobian: Floats, time: Floats) -> Floats:
    """(N,) part of the distances that offsets explain, each constant in one twelfth of the recording."""
    slow = np.clip(((time - time[0]) / (time[-1] - time[0]) * 12.0).astype(int), 0, 11)
    smooth = np.zeros(len(left))
    for part in range(12):
        rows = slow == part
        if np.count_nonzero(rows) > 12:
            normals = jacobian[rows, :3]
            smooth[rows] = normals @ np.linalg.lstsq(normals, left[rows], rcond=1e-6)[0]
    return smooth


class _FilterRun(NamedTuple):
    """States of T Kalman filters, one for each size of a walk, before and after each of K spans."""

    likelihood: Floats  #: (T,): logarithm of the likelihood, up to a constant
    before: Floats  #: (K, T, 3): offset before the update by each span
    after: Floats  #: (K, T, 3): offset after the update by each span
    covariance_before: Floats  #: (K, T, 3, 3): covariance of `before`
    covariance_after: Floats  #: (K, T, 3, 3): covariance of `after`


def _run_filter(spans: _Spans, sizes: Floats, radius: float) -> _FilterRun:
    """Run Kalman filters over the spans in information form.

    With g = Σ n s / σ² and N = Σ n nᵀ / σ², g − N b has the covariance N.

    Parameters
    ----------
    sizes : (T,) float
        Sizes q of a walk, with one filter for each.
    radius : float
        Radius of the ellipsoid; 1 σ of the initial offset is a tenth of it.
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
        likelihood += state @ gradient - 0.5 * np.einsum("ti,ti->t", predicted, state)  # of the predicted state
        likelihood += 0.5 * (np.einsum("ti,ti->t", innovation, moved) - np.linalg.slogdet(wider)[1])
        state = state + moved
        covariance = (gained + gained.swapaxes(1, 2)) / 2.0
        after[place], covariance_after[place] = state, covariance
    return _FilterRun(likelihood, before, after, covariance_before, covariance_after)


def _run_smoother(filtered: _FilterRun) -> tuple[Floats, Floats]:
    """Smoothed paths (K, T, 3) and their covariance (K, T, 3, 3), after Rauch, Tung and Striebel."""
    path, covariance = filtered.after.copy(), filtered.covariance_after.copy()
    ahead = filtered.covariance_before[1:]
    gains = np.linalg.solve(ahead, filtered.covariance_after[:-1]).swapaxes(2, 3)
    for place in range(len(path) - 2, -1, -1):
        gain = gains[place]
        path[place] += np.einsum("tij,tj->ti", gain, path[place + 1] - filtered.before[place + 1])
        covariance[place] += gain @ (covariance[place + 1] - ahead[place]) @ gain.swapaxes(1, 2)
    return path, covariance


def _refine_size(sizes: Floats, likelihoods: Floats, best: int) -> float:
    """Most likely size of a walk, by a parabola in the logarithm of the size; 0 if a constant offset is most likely."""
    if best == 0:
        return 0.0
    if not 1 < best < len(sizes) - 1:
        return float(sizes[best])
    low, middle, high = likelihoods[best - 1 : best + 2]
    bend = low - 2.0 * middle + high
    step = np.log(sizes[best + 1] / sizes[best])
    return float(sizes[best] * np.exp(0.5 * (low - high) / bend * step)) if bend < 0.0 else float(sizes[best])
