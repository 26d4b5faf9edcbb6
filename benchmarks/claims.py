"""Truth of claims: errors of fits compared with the uncertainty that the fits state. Prints Markdown.

    python -m benchmarks.claims [--trials 400] [--tables noise,time,outliers] [--processes 2]

``noise``       white noise: mean of dᵀP⁻¹d/9, with d the error of (b, F·A) and P the covariance that the fit claims
``time``        correlated noise, AR(1) at 50 Hz, on a tumble by hand
``slow``        the same with time constants of up to seconds, plus white noise, also in short recordings
``distortion``  a smooth distortion that depends on the direction, and a field with a gradient along the hand's path
``outliers``    efficiency (bound ÷ rms angle error) with outliers; for clusters, the centre error over that without
``confidence``  motions with incomplete coverage: shares of good verdicts, and of headings far beyond the claim
``few``         10 to 40 readings, one an attitude: share of wrong fits that only ``few-samples`` limits, and expected
``shrunk``      short turns of uncorrected sensors: number of fits with shrinkage, and their errors
``doubt``       residuals in runs of rejected readings, in rejection limits: noise near steel, and passing magnets
``halves``      real recordings cut in two: difference of the halves' calibrations divided by its claim

A refusal counts with the fit that it contains. The recordings of ``halves`` are those of `benchmarks.recordings`.
`benchmarks.windows` has smaller parts, and the recordings of one board.
"""

from __future__ import annotations

import argparse
import math
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import repeat
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from benchmarks import adversary
from benchmarks.accuracy import fitted, score
from benchmarks.datasets import FIELD, FIELD_STRENGTH, SEED, bound, dataset, heading_error_deg, parameter_error
from benchmarks.recordings import FOLDER, text_recordings
from flinders import simulate
from flinders.core.joining import Joined
from flinders.core.samples import Samples
from flinders.errors import FlindersError
from flinders.estimators import Readings
from flinders.estimators.auto import Auto
from flinders.fitting.result import Refused
from flinders.simulate import Sensor, Simulated, angle_error_deg

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from concurrent.futures import Executor

    from numpy.random import Generator

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

WHITE_NOISE_SETS: Final = ("S1", "S2", "S3", "S4", "S5", "S6", "S8")
NOISES: Final = (0.1, 0.5, 2.0)
MEMORIES: Final = (0.0, 0.5, 0.8, 0.95)
SLOW_NOISES: Final = ((0.2, 10.0), (1.0, 10.0), (0.2, 60.0), (1.0, 60.0), (4.0, 30.0), (4.0, 60.0))
"""Pairs of a time constant of noise and a duration of the recording, in s."""
DISTORTION_SHARE: Final = 0.01
"""Distortion as a fraction of the field, root mean square."""

MEDIAN_CHI_SQUARE: Final = 8.343
"""Median of chi-square with nine degrees of freedom."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One recording with its fit, compared with the truth.

    Attributes
    ----------
    weighed, textbook : float
        dᵀP⁻¹d/9 with the covariance that the fit states, and with that for independent residuals.
    bound_deg, error_deg, centre : float
        Smallest possible and measured angle error in degrees; error of the offset in µT.
    heading_deg, claimed_deg : float
        Rms heading error of a level vehicle in degrees, minus the mean error: true and claimed.
    verdict, method : str
        Verdict and method of the fit; ``error`` and empty if there is no fit.
    """

    weighed: float = math.nan
    textbook: float = math.nan
    bound_deg: float = math.nan
    error_deg: float = math.nan
    centre: float = math.nan
    heading_deg: float = math.nan
    claimed_deg: float = math.nan
    verdict: str = "error"
    method: str = ""


def judged(field: Floats) -> Fit | None:
    """Fit of readings, even a refused one; None if there is no fit."""
    try:
        return flinders.fit(field, site=flinders.Site(strength=FIELD_STRENGTH))
    except Refused as refusal:
        return refusal.fit
    except FlindersError:
        return None


def tried(recipe: Callable[[int], Simulated], seed: int, *, textbook: bool = False) -> Trial:
    """Simulate a recording, fit it, and compare the fit with the truth."""
    recording = recipe(seed)
    fit = judged(recording.samples.field)
    if fit is None:
        return Trial()
    matrix, offset = fit.calibration.matrix, fit.calibration.offset
    off = parameter_error(matrix, offset, recording)
    plain = Auto().estimate(Readings.of(recording.samples.field)).textbook if textbook else None
    return Trial(
        weighed=_weighed(off, fit.claim.covariance),
        textbook=math.nan if plain is None else _weighed(off, plain),
        bound_deg=bound(recording).angle_deg,
        error_deg=angle_error_deg(matrix, offset, recording),
        centre=float(np.linalg.norm(off[:3])),
        heading_deg=heading_error_deg(matrix, offset, recording),
        claimed_deg=fit.heading_error_deg.rms,
        verdict=fit.verdict,
        method=fit.evidence.method,
    )


def by_hand(
    seed: int,
    *,
    memory: float = 0.0,
    sigma: float = 0.5,
    distorted: float = 0.0,
    gradient: float = 0.0,
    walk_s: float = 1.0,
    magnet: str = "",
    beside: float = 0.0,
    seconds: float = 60.0,
) -> Simulated:
    """Recording of a tumble by hand.

    Parameters
    ----------
    seed : int
    memory : float
        Correlation of the noise of consecutive readings.
    sigma : float, µT
    distorted : float
        Distortion as a fraction of the field, rms: harmonics of degree 3 and 4 of the direction, along the field.
    gradient : float
        Variation of the field along the path of the hand, as a fraction of the field, rms about the mean.
    walk_s : float
        Time constant of the path of the hand, in s.
    magnet : str
        ``cut``: it acts within 3 s only; ``tails``: the whole field of a passing dipole.
    beside : float, µT
        Further white noise.
    seconds : float
        Duration of the recording, in s.
    """
    of_sensor, of_motion, of_noise, of_field = np.random.default_rng([SEED, 100, seed]).spawn(4)
    sensor = Sensor.random(of_sensor, noise=sigma)
    turning = simulate.hand_tumble(of_motion, seconds=seconds)
    directions = simulate.in_body_axes(turning.attitudes, FIELD)
    strength = np.ones(len(directions))
    if distorted:
        strength += distorted * harmonics(directions, of_field)
    if gradient:
        strength += gradient * wandering(of_field, len(directions), walk_s)
    true = FIELD_STRENGTH * directions * strength[:, np.newaxis]
    outliers = np.zeros(len(directions), dtype=np.bool_)
    if magnet:
        pulse, outliers = passing(turning.time, of_field, cut=magnet == "cut")
        true += (
            simulate.in_body_axes(turning.attitudes, simulate.uniform_directions(of_field, 1)[0]) * pulse[:, np.newaxis]
        )
    raw = replace(sensor, noise=beside).read(true, of_noise) + sigma * remembering(of_noise, true.shape, memory)
    return Simulated(Samples.of(raw, unit="uT", time=turning.time), sensor, directions, FIELD_STRENGTH, outliers)


def remembering(rng: Generator, shape: tuple[int, int], memory: float) -> Floats:
    """AR(1) noise of unit variance."""
    noise = rng.standard_normal(shape)
    for row in range(1, shape[0]):
        noise[row] = memory * noise[row - 1] + math.sqrt(1.0 - memory**2) * noise[row]
    return noise


def harmonics(directions: Floats, rng: Generator) -> Floats:
    """(N,) random sum of the sixteen harmonics of degrees 3 and 4, with unit variance over the sphere."""
    everywhere = simulate.fibonacci(2000)

    def powers(u: Floats, degree: int) -> Floats:
        return np.stack(
            [
                u[:, 0] ** i * u[:, 1] ** j * u[:, 2] ** (degree - i - j)
                for i in range(degree + 1)
                for j in range(degree + 1 - i)
            ],
            axis=1,
        )

    lower = np.concatenate([powers(everywhere, degree) for degree in (1, 2)], axis=1)  # 1 = x² + y² + z²
    upper_ones = np.concatenate([powers(everywhere, degree) for degree in (3, 4)], axis=1)
    coefficients = np.linalg.lstsq(lower, upper_ones, rcond=None)[0]
    _, values, turn = np.linalg.svd(upper_ones - lower @ coefficients, full_matrices=False)
    kept = values > 1e-3 * values[0]
    weights = (turn[kept].T / values[kept]) @ rng.standard_normal(int(kept.sum()))
    at = np.concatenate([powers(directions, degree) for degree in (3, 4)], axis=1)
    below = np.concatenate([powers(directions, degree) for degree in (1, 2)], axis=1)
    scale = float(np.sqrt(np.mean(((upper_ones - lower @ coefficients) @ weights) ** 2)))
    found: Floats = (at - below @ coefficients) @ weights / scale
    return found


def wandering(rng: Generator, count: int, seconds: float) -> Floats:
    """(N,) smooth random series of unit variance: white noise after two low-pass filters."""
    memory = math.exp(-1.0 / (simulate.RATE_HZ * seconds))
    settle = round(10 * seconds * simulate.RATE_HZ)
    walk, first, second = np.empty(count + settle), 0.0, 0.0
    for row, push in enumerate(rng.standard_normal(count + settle)):
        first = memory * first + push
        second = memory * second + (1.0 - memory) * first
        walk[row] = second
    walk = walk[settle:] - walk[settle:].mean()
    found: Floats = walk / walk.std()
    return found


def passing(time: Floats, rng: Generator, *, cut: bool) -> tuple[Floats, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """(N, 3) field of a passing magnet in µT, and (N,) booleans of the readings within 1.5 s of its passage."""
    middle = rng.uniform(5.0, float(time[-1]) - 5.0)
    pulse = rng.uniform(20.0, 60.0) * (1.0 + ((time - middle) / 0.5) ** 2) ** -1.5
    near = np.abs(time - middle) < 1.5
    return (np.where(near, pulse, 0.0) if cut else pulse), near


def clustered(seed: int, *, share: float, kind: str) -> Simulated:
    """Recording of 500 readings in all directions; a share of them is shifted by one vector or set to one value."""
    rng, of_cluster = np.random.default_rng([SEED, 101, seed]).spawn(2)
    sensor = Sensor.random(rng)
    directions = simulate.uniform_directions(rng, 500)
    raw = sensor.read(FIELD_STRENGTH * directions, rng)
    outliers = np.zeros(500, dtype=np.bool_)
    outliers[: round(500 * share)] = True
    moved = simulate.uniform_directions(of_cluster, 1)[0] * of_cluster.uniform(0.5, 1.5) * FIELD_STRENGTH
    if kind == "moved alike":
        raw[outliers] += moved
    elif kind == "one place":
        out = np.array([0.3, 0.5, 1.6, 2.5])[seed % 4]
        place = FIELD_STRENGTH * out * simulate.uniform_directions(of_cluster, 1) @ sensor.matrix + sensor.offset
        raw[outliers] = place + 0.5 * of_cluster.standard_normal((int(outliers.sum()), 3))
    return Simulated(Samples.of(raw, unit="uT"), sensor, directions, FIELD_STRENGTH, outliers)


def _ring(rng: Generator, count: int, height: float) -> Floats:
    angle = rng.uniform(0, 2 * np.pi, count)
    across = math.sqrt(1.0 - height * height)
    return np.stack([across * np.cos(angle), across * np.sin(angle), np.full(count, height)], axis=1)


MOTIONS: Final[Mapping[str, Callable[[Generator], Floats]]] = {
    "one level turn": lambda rng: simulate.in_body_axes(simulate.level_turn(rng, 1000), FIELD),
    "turns tilted by up to 5°": lambda rng: simulate.in_body_axes(simulate.tilted(rng, 2000, tilt_deg=5.0), FIELD),
    "two rings, one upside down": lambda rng: np.concatenate([_ring(rng, 500, FIELD[2]), _ring(rng, 500, -FIELD[2])]),
    "two rings, one on its side": lambda rng: np.concatenate(
        [_ring(rng, 500, FIELD[2]), np.roll(_ring(rng, 500, FIELD[2]), 1, axis=1)]
    ),
    "one hemisphere": lambda rng: simulate.hemisphere(rng, 1000),
}


def moving(seed: int, *, motion: str, sigma: float) -> Simulated:
    """Recording of a motion with incomplete coverage."""
    rng = np.random.default_rng([SEED, 102, seed])
    sensor = Sensor.random(rng, noise=sigma)
    directions = MOTIONS[motion](rng)
    raw = sensor.read(FIELD_STRENGTH * directions, rng)
    outliers = np.zeros(len(raw), dtype=np.bool_)
    return Simulated(Samples.of(raw, unit="uT"), sensor, directions, FIELD_STRENGTH, outliers)


def noise(pool: Executor, trials: int) -> Iterator[str]:
    """Yield the table of white noise; 0.85 to 1.2 is required."""
    yield from _head("white noise", "σ µT", "weighed/9", "its median", "robust")
    for name in WHITE_NOISE_SETS:
        for sigma in NOISES:
            done = _run(pool, partial(_set, name, sigma), trials)
            yield _row(name, f"{sigma:g}", _mean(done, "weighed"), _median(done), _share(done, "method", "robust"))


def time(pool: Executor, trials: int) -> Iterator[str]:
    """Yield the table of correlated noise; 0.7 to 1.4 is required."""
    yield from _head("AR(1) noise by hand", "weighed/9", "its median", "textbook", "robust")
    for memory in MEMORIES:
        done = _run(pool, partial(by_hand, memory=memory), trials, textbook=True)
        yield _row(
            f"ρ = {memory:g}",
            _mean(done, "weighed"), _median(done), _mean(done, "textbook"), _share(done, "method", "robust"),
        )  # fmt: skip


def slow(pool: Executor, trials: int) -> Iterator[str]:
    """Yield the table of slow noise, with few independent readings; 0.7 to 1.4 is required."""
    yield from _head(
        "0.5 µT that is correlated for", "recording", "weighed/9", "its median", "textbook", "good",
        "good, but off by > 2 × claim and > 1°", "refused",
    )  # fmt: skip
    for constant_s, seconds in SLOW_NOISES:
        memory = math.exp(-1.0 / (simulate.RATE_HZ * constant_s))
        done = _run(pool, partial(by_hand, memory=memory, beside=0.2, seconds=seconds), trials, textbook=True)
        good = [one for one in done if one.verdict == "good"]
        beyond = [one for one in good if one.heading_deg > max(2.0 * one.claimed_deg, 1.0)]
        yield _row(
            f"{constant_s:g} s", f"{seconds:g} s",
            _mean(done, "weighed"), _median(done), _mean(done, "textbook"), _share(done, "verdict", "good"),
            f"{len(beyond) / max(len(good), 1):.1%}", _share(done, "verdict", "refused"),
        )  # fmt: skip


def distortion(pool: Executor, trials: int) -> Iterator[str]:
    """Yield the table of model errors; 0.7 to 1.4 is required."""
    yield from _head("1 % of the field, by hand", "σ µT", "weighed/9", "its median", "textbook", "robust")
    for sigma in (0.1, 0.5):
        for name, recipe in (
            ("error that depends on the direction", partial(by_hand, distorted=DISTORTION_SHARE, sigma=sigma)),
            ("gradient, path of 1 s", partial(by_hand, gradient=DISTORTION_SHARE, sigma=sigma)),
            ("gradient, path of 3 s", partial(by_hand, gradient=DISTORTION_SHARE, walk_s=3.0, sigma=sigma)),
        ):
            done = _run(pool, recipe, trials, textbook=True)
            yield _row(
                name, f"{sigma:g}",
                _mean(done, "weighed"), _median(done), _mean(done, "textbook"), _share(done, "method", "robust"),
            )  # fmt: skip


def outliers(pool: Executor, trials: int) -> Iterator[str]:
    """Yield the table of outliers; required are 0.95 for S5, 0.9 for a magnet, a loss of 0.02, and 1.3 for clusters."""
    yield from _head("outliers", "σ µT", "efficiency", "of the likelihood", "failed")
    for name in ("S1", "S3", "S5"):
        for sigma in NOISES:
            auto, plain = (
                list(
                    pool.map(score, repeat(partial(fitted, method=method)), repeat(name), repeat(sigma), range(trials))
                )
                for method in ("auto", "likelihood")
            )
            good, also = ([one for one in scores if not one.failed] for scores in (auto, plain))
            yield _row(
                name, f"{sigma:g}",
                *(f"{_rms(o.bound_deg for o in some) / _rms(o.error_deg for o in some):.3f}" for some in (good, also)),
                str(len(auto) - len(good)),
            )  # fmt: skip
    for kind in ("cut", "tails"):
        done = _run(pool, partial(by_hand, magnet=kind), trials)
        efficiency = _rms(one.bound_deg for one in done) / _rms(one.error_deg for one in done)
        yield _row(f"a magnet passes ({kind})", "0.5", f"{efficiency:.3f}", "–", _share(done, "verdict", "error"))
    yield ""
    yield from _head("clusters", "centre µT", "÷ clean", "largest", "weighed/9", "not robust")
    clean = _run(pool, partial(clustered, share=0.0, kind=""), trials)
    for kind in ("moved alike", "one place"):
        for share in (0.05, 0.1, 0.2):
            done = _run(pool, partial(clustered, share=share, kind=kind), trials)
            centre = _rms(one.centre for one in done)
            missed = sum(one.method != "robust" for one in done)
            yield _row(
                f"{share:.0%}, {kind}", f"{centre:.3f}", f"{centre / _rms(one.centre for one in clean):.2f}",
                f"{max(one.centre for one in done):.2f}", _mean(done, "weighed"), f"{missed / len(done):.1%}",
            )  # fmt: skip


def confidence(pool: Executor, trials: int) -> Iterator[str]:
    """Yield the table of incomplete coverage; at most 2 % of heading errors may exceed three times the claim."""
    yield from _head(
        "motion",
        "σ µT",
        "good",
        "limited",
        "refused",
        "above 3 × claim",
        "the same, not refused",
        "rms true",
        "claimed",
    )
    for motion in MOTIONS:
        for sigma in (0.1, 0.5, 2.0):
            done = _run(pool, partial(moving, motion=motion, sigma=sigma), trials)
            given = [one for one in done if one.verdict in ("good", "limited")]
            yield _row(
                motion, f"{sigma:g}",
                *(_share(done, "verdict", verdict) for verdict in ("good", "limited", "refused")),
                _above(done), _above(given),
                f"{_rms(one.heading_deg for one in done):.3g}°", f"{_rms(one.claimed_deg for one in done):.3g}°",
            )  # fmt: skip


def few(pool: Executor, trials: int) -> Iterator[str]:
    """Yield the table of few readings, one for each attitude; *wrong* is defined in `benchmarks.adversary`."""
    yield from _head("readings", "good except for their number", "ratio 50 / 90 %", "wrong", "expected")
    for count in (10, 12, 15, 16, 18, 20, 24, 30, 40):
        done = [one for one in pool.map(partial(_one_an_attitude, count), range(trials)) if one is not None]
        fifty, ninety = np.quantile([one.true / one.claimed for one in done], [0.5, 0.9])
        yield _row(
            str(count), f"{len(done)} of {trials}", f"{fifty:.2f} / {ninety:.2f}",
            str(sum(one.is_wrong for one in done)), f"{sum(one.expected for one in done):.1f}",
        )  # fmt: skip


def _one_an_attitude(count: int, seed: int) -> adversary.Trial | None:
    """Trial with readings in random directions; None if anything other than their number limits the fit."""
    rng, of = adversary.stream(seed, f"rest {count}"), adversary.sensor(adversary.stream(seed, "sensor"))
    read = adversary.STRENGTH_UT * simulate.uniform_directions(rng, count) @ of.iron + of.offset
    fit = adversary.fitted(Samples.of(read + (0.05, 0.1, 0.2)[seed % 3] * rng.standard_normal((count, 3)), unit="uT"))
    if fit is None or any(one.code != "few-samples" for one in fit.findings if one.severity != "note"):
        return None
    level = adversary.level(seed, of, adversary.Effect())
    true = float(np.abs(adversary.headings(fit.calibration.apply(level))).max())
    return adversary.Trial("good", (), (), fit.heading_error_deg.worst, true, adversary.probability(fit))


def shrunk(pool: Executor, trials: int) -> Iterator[str]:
    """Yield the table of uncorrected sensors: offsets of up to two field strengths, turned for a few seconds."""
    yield from _head("turned for", "shrunk", "their largest offset, of the field", "largest ratio")
    for name, path in (("4 s, all axes", _tumbled), ("12 s, nearly one axis", _rolled)):
        done = [one for one in pool.map(partial(_fit_of_path, path), range(trials), chunksize=8) if one is not None]
        offset, ratio = np.max(done, axis=0) if done else (math.nan, math.nan)
        yield _row(name, f"{len(done)} of {trials}", f"{offset:.1%}", f"{ratio:.1f}")


def _tumbled(rng: Generator) -> adversary.Path:
    return adversary.tumble(rng, seconds=4.0)


def _rolled(rng: Generator) -> adversary.Path:
    step_s = 1.0 / (adversary.STEPS_PER_READING * adversary.RATE_HZ)
    rates = 0.08 * adversary.smooth(rng, round(12.0 / step_s), step_s, 1.0)
    rates[:, rng.integers(3)] += 2.0
    return adversary.turned(rng, rates, step_s)


def _fit_of_path(path: Callable[[Generator], adversary.Path], seed: int) -> tuple[float, float] | None:
    """Offset over field strength, and error over claim, of a fit with shrinkage; None for any other fit."""
    effect, of = adversary.Effect(), adversary.sensor(adversary.stream(seed, "sensor"))
    fit = adversary.fitted(adversary.recorded(seed, of, effect, path(adversary.stream(seed, "path 0"))))
    if fit is None or not fit.claim.is_shrunk:
        return None
    off = float(np.abs(adversary.headings(fit.calibration.apply(adversary.level(seed, of, effect)))).max())
    return float(np.linalg.norm(of.offset)) / adversary.STRENGTH_UT, off / fit.heading_error_deg.worst


def doubt(pool: Executor, trials: int) -> Iterator[str]:
    """Yield the table of rejected runs: a passing magnet must exceed the limit of doubt, and slow noise must not."""
    yield from _head("tumbles by hand", "with rejected runs", "runs", "limits 50 / 90 / 95 %", "beyond 2.5 limits")
    for name, effect in (
        ("steel desk, 1 µT", adversary.Effect(place=partial(adversary.desk, rms=1.0))),
        ("steel desk, 3 µT", adversary.EFFECTS["steel desk, 3 µT"]),
        ("magnet passes, 20 µT", adversary.EFFECTS["magnet passes, 20 µT"]),
    ):
        samples = [
            adversary.recorded(seed, adversary.sensor(adversary.stream(seed, "sensor")), effect,
                               adversary.tumble(adversary.stream(seed, "path 0")))
            for seed in range(trials)
        ]  # fmt: skip
        each = list(pool.map(_reach, samples))
        runs = np.array([reach for reaches in each for reach in reaches])
        quantiles = " / ".join(f"{reach:.2f}" for reach in np.quantile(runs, [0.5, 0.9, 0.95]))
        yield _row(
            name,
            f"{sum(bool(one) for one in each)} of {trials}",
            str(len(runs)),
            quantiles,
            f"{np.mean(runs > 2.5):.0%}",
        )


def _reach(samples: Samples) -> list[float]:
    """Largest residual of each run of several rejected readings, divided by the rejection limit."""
    estimate = Auto().estimate(Readings.of(samples))
    return [run.max_distance / estimate.rejected_beyond for run in estimate.outliers if run.readings > 1]


def halves(pool: Executor, trials: int) -> Iterator[str]:
    """Yield the table of real recordings cut in two, between which the field or the sensor may have changed.

    The largest of 72 heading differences is divided by the largest claim. For true claims the median is 1.0 to 1.6, as
    measured with simulated tumbles by hand with white noise, AR(1) noise and a gradient.
    """
    del pool, trials
    yield from _head("recording", "heading, worst", "difference of halves", "claimed difference", "ratio")
    ratios = []
    for path in text_recordings():
        try:
            samples = flinders.read(path)
            whole = flinders.fit(samples, target_deg=10.0)
            middle = len(samples) // 2
            cut = Joined((samples[:middle], samples[middle:]))
            parted = flinders.fit(cut, target_deg=90.0)
        except FlindersError:
            continue
        if parted.evidence.diagnosis.repeats is not None:
            half = parted.evidence.diagnosis.repeats.parts[0]
            ratios.append(half.difference_deg / half.difference_sigma_deg)
            yield _row(
                str(path.relative_to(FOLDER)), f"{whole.heading_error_deg.worst:.2f}°", f"{half.difference_deg:.2f}°",
                f"{half.difference_sigma_deg:.2f}°", f"{ratios[-1]:.1f}",
            )  # fmt: skip
    yield _row("median", "", "", "", f"{np.median(ratios):.1f}" if ratios else "no recordings: set FLINDERS_DATA")


TABLES: Final[Mapping[str, Callable[[Executor, int], Iterator[str]]]] = {
    "noise": noise,
    "time": time,
    "slow": slow,
    "distortion": distortion,
    "outliers": outliers,
    "confidence": confidence,
    "few": few,
    "shrunk": shrunk,
    "doubt": doubt,
    "halves": halves,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    options = _parser().parse_args(arguments)
    unknown = [name for name in options.tables if name not in TABLES]
    if unknown:
        sys.exit(f"no table {', '.join(unknown)}: there are {', '.join(TABLES)}")
    with ProcessPoolExecutor(options.processes) as pool:
        for name in options.tables:
            for line in TABLES[name](pool, options.trials):
                print(line, flush=True)
            print(flush=True)


def _parser() -> argparse.ArgumentParser:
    """Describe the command line."""
    parser = argparse.ArgumentParser("python -m benchmarks.claims", description="Errors beside the claimed ones.")
    parser.add_argument("--trials", type=int, default=400)
    parser.add_argument("--tables", type=lambda text: text.split(","), default=list(TABLES), metavar="noise,time,…")
    parser.add_argument("--processes", type=int, default=2)
    return parser


def _set(name: str, sigma: float, trial: int) -> Simulated:
    return dataset(name, trial, sigma)


def _run(pool: Executor, recipe: Callable[[int], Simulated], trials: int, *, textbook: bool = False) -> list[Trial]:
    job = partial(tried, recipe, textbook=textbook)
    return list(pool.map(job, range(trials), chunksize=max(1, trials // 8)))


def _weighed(off: Floats, covariance: Floats) -> float:
    """Squared error divided by its claimed variance, per component."""
    return float(off @ np.linalg.pinv(covariance, rcond=1e-14, hermitian=True) @ off) / len(off)


def _head(*titles: str) -> Iterator[str]:
    yield _row(*titles)
    yield "|---|" + "---:|" * (len(titles) - 1)


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _mean(done: Sequence[Trial], name: str) -> str:
    return f"{np.nanmean([getattr(one, name) for one in done]):.2f}"


def _median(done: Sequence[Trial]) -> str:
    """Median of dᵀP⁻¹d, divided by that of chi-square."""
    return f"{9 * np.nanmedian([one.weighed for one in done]) / MEDIAN_CHI_SQUARE:.2f}"


def _share(done: Sequence[Trial], name: str, value: str) -> str:
    return f"{np.mean([getattr(one, name) == value for one in done]):.1%}"


def _above(done: Sequence[Trial]) -> str:
    return f"{np.mean([one.heading_deg > 3.0 * one.claimed_deg for one in done]):.1%}" if done else "–"


def _rms(values: Iterator[float]) -> float:
    """Root mean square of those values that are not NaN."""
    return math.sqrt(float(np.nanmean(np.square(list(values)))))


if __name__ == "__main__":
    main()
