"""Slow noise in NumPy, with all models of a grid at once: reference for slow_noise.c of the engine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats

MAX_AVERAGES: Final = 2048
"""Largest number of averages to which a recording is reduced."""

VARIANCE_RATIOS: Final = np.geomspace(1e-3, 3e3, 8)
"""Variances of the disturbance that are tried, relative to that of white noise."""

COARSE_MEMORIES, FINE_MEMORIES = 6, 5
"""Numbers of memories in the grid of all models, and in the finer grid about the best model."""

MAX_MEMORY_RATIO: Final = 1.5
"""Longest memory relative to the duration of the recording; longer memories cannot be told apart."""

MAX_LIKELIHOOD_LOSS_BITS: Final = 14.0
"""Base-2 logarithm of the likelihood ratio to the best model above which a model is not refined."""

MAX_RADIANS: Final = 20.0
"""Largest angle of turning in rad within a memory for which a change of the field can follow the attitude."""

MIN_PROBABILITY: Final = 1e-4
"""Smallest share of the probability of all models that counts."""


class Series(NamedTuple):
    """Averages of successive residuals: (n, 10) Jacobian and distance, number of readings, time since the previous."""

    rows: Floats
    counts: Floats
    steps: Floats

    @classmethod
    def of(cls, rows: Floats, moments: Floats, segments: Sequence[NDArray[np.int64]], *, has_parts: bool) -> Self:
        """Average rows of segments of consecutive readings; repeated readings count once."""
        most = -(-len(rows) // MAX_AVERAGES)
        averages, counts, steps = [], [], []
        last = None
        for segment in segments:
            for begin in range(0, len(segment), most):
                places = [
                    place
                    for at, place in enumerate(segment[begin : begin + most], begin)
                    if at == 0 or not np.array_equal(rows[place], rows[place - 1])
                ]
                if not places:
                    continue
                moment = float(np.mean(moments[places]))
                averages.append(rows[places].mean(axis=0))
                counts.append(float(len(places)))
                steps.append(np.inf if has_parts and begin == 0 else 0.0 if last is None else moment - last)
                last = moment
        return cls(np.array(averages), np.array(counts), np.array(steps))

    @property
    def span(self) -> float:
        """Time that the averages span."""
        return float(self.steps[np.isfinite(self.steps)].sum())


@dataclass(frozen=True)
class Models:
    """(G,) models: (G, 10, 10) sums of innovations, base-2 logarithms of likelihoods, variances of white noise."""

    sums: Floats
    likelihood: Floats
    variance: Floats
    ratio: Floats
    memory: Floats
    is_vector: bool


def filtered(series: Series, ratio: Floats, memory: Floats, *, is_vector: bool) -> tuple[Floats, Floats]:
    """(G, 10, 10) sums of innovations, and (G,) base-2 logarithms of their variances relative to white noise."""
    components = 3 if is_vector else 1
    normals = series.rows[:, :3] if is_vector else np.ones((len(series.rows), 1))
    state = np.zeros((len(ratio), components, 10))
    covariance = ratio[:, None, None] * np.eye(components)
    sums, logarithm = np.zeros((len(ratio), 10, 10)), np.zeros(len(ratio))
    for row, count, step, normal in zip(series.rows, series.counts, series.steps, normals, strict=True):
        with np.errstate(over="ignore"):
            x = step / memory
            decay = 1.0 / (1.0 + x * (1.0 + x / 2.0))
        state *= decay[:, None, None]
        covariance = covariance * decay[:, None, None] ** 2
        covariance += (ratio * (1.0 - decay**2))[:, None, None] * np.eye(components)
        across = covariance @ normal
        scatter = across @ normal + 1.0 / count
        innovation = row - np.einsum("d,gdc->gc", normal, state)
        gain = across / scatter[:, None]
        state += gain[:, :, None] * innovation[:, None, :]
        covariance = covariance - gain[:, :, None] * across[:, None, :]
        sums += innovation[:, :, None] * innovation[:, None, :] / scatter[:, None, None]
        logarithm += np.log2(scatter * count)
    return sums, logarithm


def taken_off(sums: Floats, step: Floats) -> Floats:
    """(G, 10, 10) sums of residuals after a step is subtracted."""
    onto = np.eye(10)
    onto[:9, 9] = -step
    taken: Floats = onto.T @ sums @ onto
    return taken


def judged(
    sums: Floats, logarithm: Floats, freedom: float, ratio: Floats, memory: Floats, *, is_vector: bool
) -> Models:
    """Models with their restricted likelihoods."""
    matrix = sums[:, :9, :9] + 1e-13 * sums[:, range(9), range(9)].max(axis=1)[:, None, None] * np.eye(9)
    rest = sums[:, 9, 9] - np.einsum("gi,gi->g", sums[:, :9, 9], np.linalg.solve(matrix, sums[:, :9, 9:])[:, :, 0])
    likelihood = -(logarithm + np.linalg.slogdet(matrix)[1] / np.log(2.0) + freedom * np.log2(rest)) / 2.0
    return Models(sums, likelihood, rest / freedom, ratio, memory, is_vector)


def run(series: Series, bent: Floats, ratios: Floats, memories: Floats, *, is_vector: bool) -> Models:
    """Models for all pairs of a ratio and a memory."""
    memory, ratio = (grid.ravel() for grid in np.meshgrid(memories, ratios, indexing="ij"))
    sums, logarithm = filtered(series, ratio, memory, is_vector=is_vector)
    return judged(taken_off(sums, bent), logarithm, len(series.rows) - 9.0, ratio, memory, is_vector=is_vector)


def models_of(series: Series, bent: Floats) -> list[Models]:
    """Models: white noise, and finer grids about the best vector and the best strength, if these are likely."""
    white = np.einsum("ni,n,nj->ij", series.rows, series.counts, series.rows)
    freedom, none = len(series.rows) - 9.0, np.zeros(1)
    models = [judged(taken_off(white[None], bent), none, freedom, none, np.ones(1), is_vector=False)]
    span = series.span
    memories = np.geomspace(2.0 * span / len(series.rows), MAX_MEMORY_RATIO * span, COARSE_MEMORIES)
    coarse = [run(series, bent, VARIANCE_RATIOS, memories, is_vector=is_vector) for is_vector in (True, False)]
    most = max(float(one.likelihood.max()) for one in (*models, *coarse))
    for kind, is_vector in zip(coarse, (True, False), strict=True):
        best = int(kind.likelihood.argmax())
        if not kind.likelihood[best] > most - MAX_LIKELIHOOD_LOSS_BITS:
            continue
        ratio_step, memory_step = VARIANCE_RATIOS[1] / VARIANCE_RATIOS[0], memories[1] / memories[0]
        ratios = np.geomspace(kind.ratio[best] / ratio_step, kind.ratio[best] * ratio_step, 8)
        longest = min(kind.memory[best] * memory_step, memories[-1])
        finer = np.geomspace(kind.memory[best] / memory_step, longest, FINE_MEMORIES)
        fine = run(series, bent, ratios, finer, is_vector=is_vector)
        share = np.log(ratios[1] / ratios[0]) * np.log(finer[1] / finer[0])
        share /= np.log(ratio_step) * len(VARIANCE_RATIOS) * np.log(memory_step) * COARSE_MEMORIES
        models.append(replace(fine, likelihood=fine.likelihood + np.log2(share)))
    return models


def scatter_of(series: Series, ratio: float, memory: float, *, is_vector: bool) -> Floats:
    """(9, 9) scatter of Σ J s by the noise of a model, in variances of white noise, from its dense covariance."""
    normals = series.rows[:, :3] if is_vector else np.ones((len(series.rows), 1))
    x = np.minimum(series.steps[1:] / memory, 1e100)
    passed = np.concatenate([[0.0], np.cumsum(np.log1p(x * (1.0 + x / 2.0)))])
    noise = ratio * (normals @ normals.T) * np.exp(-np.abs(passed[:, None] - passed))
    weighted = series.counts[:, None] * series.rows[:, :9]
    scatter: Floats = weighted.T @ noise @ weighted + weighted.T @ series.rows[:, :9]
    return scatter


def averaged(
    series: Series, bent: Floats, onto: Floats, prior_matrix: Floats, prior_gradient: Floats, square: float
) -> tuple[Floats, Floats, Floats, float, float]:
    """(9,) step and (9, 9) covariance, averaged over models, and the likeliest model's covariance without the step.

    Also the bits of likelihood that the likeliest gains over white noise, and the part of the mean `square` of
    residuals that the strength at the place makes.

    `onto` takes information to what is observed.
    """
    models = models_of(series, bent)
    likelihood = np.concatenate([one.likelihood for one in models])
    weights = np.exp2(likelihood - likelihood.max())
    weights = np.where(weights > MIN_PROBABILITY * weights.sum(), weights / weights.sum(), 0.0)
    variance = np.concatenate([one.variance for one in models])
    sums = np.concatenate([one.sums for one in models]) / variance[:, None, None]
    steps, covariances = [], []
    for one in sums:
        covariances.append(np.linalg.inv(onto @ one[:9, :9] @ onto.T + prior_matrix))
        steps.append(covariances[-1] @ (onto @ one[:9, 9] + prior_gradient))
    step = weights @ np.array(steps)
    off = np.array(steps) - step
    covariance = np.einsum("g,gij->ij", weights, np.array(covariances)) + np.einsum("g,gi,gj->ij", weights, off, off)
    best = int(weights.argmax())
    of_vectors = np.concatenate([np.full(len(one.ratio), one.is_vector) for one in models])
    ratio, memory = (np.concatenate([getattr(one, name) for one in models]) for name in ("ratio", "memory"))
    scatter = variance[best] * scatter_of(series, ratio[best], memory[best], is_vector=bool(of_vectors[best]))
    scatter = onto @ scatter @ onto.T / variance[0] ** 2 + prior_matrix
    gain = float(likelihood[best] - likelihood[0])
    radians = memory / radian_of(series)
    of_place = ~of_vectors & (radians >= 1.0) & (radians <= MAX_RADIANS) & (np.arange(len(memory)) > 0)
    strength = float(np.sum((weights * np.maximum(square - variance, 0.0))[of_place]))
    return step, covariance, covariances[0] @ scatter @ covariances[0], gain, strength


def radian_of(series: Series) -> float:
    """Time in which the surface's normal turns by a radian, on average."""
    normals = series.rows[:, :3] / np.linalg.norm(series.rows[:, :3], axis=1)[:, None]
    angles = np.arccos(np.clip(np.sum(normals[1:] * normals[:-1], axis=1), -1.0, 1.0))
    return series.span / float(np.sum(angles[np.isfinite(series.steps[1:])]))
