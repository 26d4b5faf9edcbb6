"""Truth of claims on disturbances, and what their correction gains in a real flight. Prints Markdown.

    python -m benchmarks.disturbances [--trials 200] [--tables nees,bench,flight,onboard]

``nees``    squared errors divided by claimed variances, in simulated tumbles by hand of a minute at 50 Hz: of P for
            each axis, of the growth a with the temperature, of the lag, and of offset and shape at the reference; also
            of four motors that are compensated one by one, and with meters that are noisy, slow, or coarse
``bench``   the same of P for a sensor at rest
``flight``  three compasses of a drone, with every other block of 5 s left out of the fit: spread of the field strength
            in these blocks, also without the last 10 s, in which the drone is upside down with motors at 22 to 25 A
``onboard`` its external compass compared with the onboard calibration, in the air: blocks of 5 s, and offsets

The recording for ``flight`` and ``onboard`` is found by `benchmarks.recordings`. 200 trials take about ten minutes on
one core.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from benchmarks.datasets import parameter_error
from benchmarks.recordings import FOLDER
from flinders import simulate
from flinders.core.calibration import Calibration
from flinders.core.compensation import Compensator
from flinders.core.disturbance import lagged_values, motor_names
from flinders.core.samples import Samples
from flinders.estimators import Readings
from flinders.estimators.disturbance import fit_disturbances
from flinders.estimators.likelihood import Likelihood
from flinders.estimators.static_bench import fit_still
from flinders.fitting.result import Refused
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.likelihood import magnitude

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flinders.arrays import Floats
    from flinders.estimators.static_bench import StillSensor
    from flinders.fitting.result import Fit
    from flinders.simulate import Simulated

FIRST, SECOND = np.array([0.5, 0.0, -0.3]), np.array([-0.2, 0.4, 0.1])
"""µT/A of two motors on one vehicle."""

ARMS: Final = np.array([[0.5, 0.1, -0.3], [-0.4, 0.2, 0.3], [0.1, -0.5, 0.2], [0.2, 0.4, -0.4]])
"""µT/A of four motors on one vehicle."""

HOLD_READINGS: Final = 25
"""Number of readings during which a meter repeats its value."""

FULL_THROTTLE_A: Final = 20.0
"""Current at full throttle in A."""

WARM: Final = np.array([0.3, -0.2, 0.1])
"""Growth of the offset with temperature in µT/°C."""

GROWTH: Final = 0.002
"""Growth of the scale per °C, as a fraction of 1."""

LAG_S: Final = 0.13

MAX_SINGLE_RATIOS: Final = 6
"""Largest number of ratios that are printed one by one."""

Truth = dict[str, "Floats"]
"""Change of the offset per unit of each disturbance."""


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """A recording with its true disturbances.

    Attributes
    ----------
    recording : Simulated
    samples : Samples
        Readings with the effect of the disturbance, and the column of the disturbance.
    per_unit : dict of str to (3,) float
    growth : float
    lag_s : float
    """

    recording: Simulated
    samples: Samples
    per_unit: Truth
    growth: float = 0.0
    lag_s: float = 0.0


def flown(
    seed: int,
    names: tuple[str, ...] = (),
    *,
    lag_s: float = 0.0,
    warm: bool = False,
) -> Flown:
    """Simulate a minute of flight: each motor changes every three seconds, and the sensor warms up by 16 °C."""
    recording = simulate.tumble(seed=seed)
    rng = np.random.default_rng([2026, seed])
    time, field = recording.samples.time, recording.samples.field
    assert time is not None
    columns: dict[str, Floats] = {}
    per_unit: Truth = {}
    if warm:  # first, since its gain acts on the earth's field alone
        effect = simulate.ThermalDrift(WARM, kelvin=20.0, seconds=40.0).on(time, rng)
        assert effect.temperature is not None
        departure = effect.temperature - effect.temperature[0]
        field = recording.sensor.offset + (field - recording.sensor.offset) * (1.0 + GROWTH * departure)[:, np.newaxis]
        field, columns["temperature"], per_unit["temperature"] = field + effect.shift, effect.temperature, WARM
    for name, vector in zip(names, (FIRST, SECOND), strict=False):
        size = FULL_THROTTLE_A if name == "throttle" else 1.0
        effect = simulate.MotorCurrent(vector, amperes=FULL_THROTTLE_A).on(time, rng)
        assert effect.current is not None
        columns[name], per_unit[name] = effect.current / size, vector * size
        field = field + np.stack([lagged_values(axis, time, lag_s) for axis in effect.shift.T], axis=1)
    current, throttle, temperature = (columns.get(name) for name in ("current", "throttle", "temperature"))
    samples = replace(recording.samples, field=field, current=current, throttle=throttle, temperature=temperature)
    return Flown(recording, samples, per_unit, GROWTH if warm else 0.0, lag_s)


def parted(seed: int, apart: float) -> Flown:
    """Simulate a minute of flight with four motors whose throttles differ by up to `apart`."""
    recording = simulate.tumble(seed=seed, disturbances=[simulate.Motors(ARMS, apart=apart)])
    per_unit = dict(zip(motor_names("current", len(ARMS)), ARMS, strict=True))
    return Flown(recording, recording.samples, per_unit)


def metered(seed: int, meter: Callable[[Floats, np.random.Generator], Floats], lag_s: float = 0.0) -> Flown:
    """Simulate a minute of flight with a current that a meter measures."""
    one = flown(seed, ("current",), lag_s=lag_s)
    assert one.samples.current is not None
    told = meter(one.samples.current, np.random.default_rng([2028, seed]))
    return replace(one, samples=replace(one.samples, current=told))


def metered_motors(seed: int, lag_s: float = 0.0) -> Flown:
    """Simulate a minute of flight with four motors; each current has a meter with noise of 1 A and a lag."""
    one = parted(seed, 0.1)
    time, currents = one.samples.time, one.samples.currents
    assert time is not None
    assert currents is not None
    early = np.stack([lagged_values(column, time, -lag_s) for column in currents.T], axis=1)
    return replace(
        one, samples=replace(one.samples, currents=noisy(early, np.random.default_rng([2029, seed]))), lag_s=lag_s
    )


def noisy(current: Floats, rng: np.random.Generator) -> Floats:
    """Current as measured by a meter with noise of 1 A."""
    return current + rng.normal(size=current.shape)


def holding(current: Floats, _rng: np.random.Generator) -> Floats:
    """Current as measured by a meter that updates twice per second."""
    return np.repeat(current[::HOLD_READINGS], HOLD_READINGS)[: len(current)]


def rounded(current: Floats, _rng: np.random.Generator) -> Floats:
    """Current as measured by a meter in whole amperes."""
    whole: Floats = np.round(current)
    return whole


CASES: Final[dict[str, Callable[[int], Flown]]] = {
    "current": partial(flown, names=("current",)),
    "throttle": partial(flown, names=("throttle",)),
    "current, lag 0.13 s": partial(flown, names=("current",), lag_s=LAG_S),
    "current and throttle, each a motor of its own": partial(flown, names=("current", "throttle")),
    "temperature, offset and scale": partial(flown, warm=True),
    "current and temperature": partial(flown, names=("current",), warm=True),
    "four motors, 10 % apart": partial(parted, apart=0.1),
    "four motors, 2 % apart": partial(parted, apart=0.02),
    "current, meter with noise of 1 A": partial(metered, meter=noisy),
    "the same, lag 0.13 s": partial(metered, meter=noisy, lag_s=LAG_S),
    "four motors, 10 % apart, meters with noise of 1 A": metered_motors,
    "the same with a lag of 0.13 s": partial(metered_motors, lag_s=LAG_S),
    "current, meter that tells twice a second": partial(metered, meter=holding),
    "current, in whole amperes": partial(metered, meter=rounded),
}


def fitted(one: Flown) -> Fit:
    """Fit of a recording, even a refused one."""
    try:
        return flinders.fit(one.samples, disturbances=tuple(one.per_unit))
    except Refused as refused:
        return refused.fit


def errors_of(one: Flown) -> tuple[Floats, Floats, list[str]]:
    """(9 + K + lags,) errors, their claimed variances, and names: ``b``, ``S``, a disturbance, ``a``, ``lag``."""
    fit = fitted(one)
    calibration, sensor = fit.calibration, one.recording.sensor
    assert fit.evidence.disturbances.covariance is not None
    offset, grown = np.array(sensor.offset), 1.0
    error: list[Floats] = []
    names, lags = ["b"] * 3 + ["S"] * 6, []
    for disturbance, told in zip(calibration.disturbances, fit.evidence.disturbances.estimates, strict=True):
        error.append(disturbance.per_unit - one.per_unit[disturbance.name])
        names += [f"P of {disturbance.name}"] * 3
        if disturbance.name == "temperature":
            away = disturbance.reference - 20.0
            offset, grown = offset + away * WARM, 1.0 + GROWTH * away
        elif np.isfinite(told.lag_sigma_s) and one.lag_s:
            lags.append(((disturbance.lag_s - one.lag_s), told.lag_sigma_s**2))
    moved = replace(sensor, offset=offset, matrix=np.asarray(sensor.matrix) * grown)
    matrix = calibration.matrix / calibration.field_strength * one.recording.field_strength
    level = parameter_error(matrix, calibration.offset, replace(one.recording, sensor=moved))
    if one.growth:
        error.append(np.array([calibration.disturbances[-1].gain_per_unit - one.growth / grown]))
        names.append("a")
    squares = np.concatenate([level, *error, [lag for lag, _ in lags]])
    variances = np.concatenate([np.diag(fit.evidence.disturbances.covariance), [variance for _, variance in lags]])
    return squares, variances, names + ["lag"] * len(lags)


def nees_table(trials: int) -> Iterator[str]:
    """Yield rows of squared errors divided by claimed variances, by parameter."""
    yield "| disturbance | b | S | P, each axis | a | lag | all, least … most |"
    yield "|---|---:|---:|---|---:|---:|---:|"
    for title, case in CASES.items():
        found = [errors_of(case(seed)) for seed in range(trials)]
        names = np.array(found[0][2])
        ratios = np.mean([error**2 / variance for error, variance, _ in found], axis=0)
        each = ratios[np.char.startswith(names, "P")]
        driven = ", ".join(f"{ratio:.2f}" for ratio in each)
        if len(each) > MAX_SINGLE_RATIOS:
            driven = f"{each.mean():.2f} ({each.min():.2f} … {each.max():.2f})"
        yield (
            f"| {title} | {_mean(ratios[names == 'b'])} | {_mean(ratios[names == 'S'])} | {driven} "
            f"| {_mean(ratios[names == 'a'])} | {_mean(ratios[names == 'lag'])} "
            f"| {ratios.min():.2f} … {ratios.max():.2f} |"
        )


# a sensor on the bench


def bench_table(trials: int) -> Iterator[str]:
    """Yield the same for tests at rest of twelve seconds, with two ramps of the motor or with three steps."""
    yield "| bench | P, each axis | refused |"
    yield "|---|---|---:|"
    courses = {
        "up and down twice": 10.0 - 10.0 * np.cos(np.arange(600) / 600 * 4.0 * np.pi),
        "off and on three times": np.tile(np.repeat([0.0, 15.0], 100), 3),
    }
    for title, drawn in courses.items():
        found = [lain(drawn, seed) for seed in range(trials)]
        kept = [one for one in found if one is not None]
        ratios = np.mean(
            [(one.disturbances[0].per_unit - FIRST) ** 2 / np.diag(one.covariance) for one in kept], axis=0
        )
        yield f"| {title} | {', '.join(f'{ratio:.2f}' for ratio in ratios)} | {len(found) - len(kept)} |"


def lain(drawn: Floats, seed: int) -> StillSensor | None:
    """Result of a test at rest, with noise of 0.3 µT and 0.05 A at 50 Hz."""
    rng = np.random.default_rng([2027, seed])
    field = np.array([20.0, -5.0, 43.0]) + np.outer(drawn, FIRST) + rng.normal(scale=0.3, size=(len(drawn), 3))
    current = drawn + rng.normal(scale=0.05, size=len(drawn))
    return fit_still([Samples.of(field, unit="uT", time=np.arange(len(drawn)) / 50.0, current=current)], ["current"])


# a real flight

FLIGHT: Final = "dronekit_log171_3mags/log171.bin"
BLOCKS: Final = 48
INVERTED_BLOCKS: Final = 2
"""Number of blocks at the end in which the drone is upside down."""
AIR_S: Final = (84.0, 230.0)
"""Start and end of the time in the air and upright, in s of the log."""
BLOCK_S: Final = 5.0
ONBOARD: Final = ([-97.79, 118.11, 213.18], [0.995731, 1.008149, 1.002741], [0.018288, -0.002727, -0.004213])
"""COMPASS_OFS in mG, DIA and ODI of the external compass, from the log."""


def compass(name: str) -> Samples:
    """Readings of one compass of the flight, with the current."""
    blocks = list(flinders.open_recording(str(FOLDER / FLIGHT), sensor=name).blocks())
    time, current = (np.concatenate([getattr(block, column) for block in blocks]) for column in ("time", "current"))
    return Samples.of(np.concatenate([block.field for block in blocks]), unit="uT", time=time, current=current)


def strength(samples: Samples, calibration: Calibration) -> Floats:
    """(N,) lengths of corrected readings, divided by their mean."""
    length = np.linalg.norm(calibration.affine.apply(Compensator(calibration)(samples).field), axis=1)
    found: Floats = length / length.mean()
    return found


def plain(field: Floats) -> Calibration:
    """Best calibration that has no disturbances."""
    ellipsoid = Likelihood().estimate(Readings.of(field)).ellipsoid
    return Calibration.from_ellipsoid(ellipsoid.centre, ellipsoid.shape)


def best_line(lengths: Floats, samples: Samples, calibration: Calibration) -> Floats:
    """Lengths after subtraction of a straight line in the current, fitted to the same readings for each axis."""
    directions = calibration.affine.apply(Compensator(calibration)(samples).field)
    ellipsoid = Ellipsoid(calibration.offset, calibration.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = magnitude.information(directions, ellipsoid)[:, :3]
    assert samples.current is not None
    line = np.column_stack([normals * samples.current[:, np.newaxis], np.ones(len(lengths))])
    left: Floats = lengths - line @ np.linalg.lstsq(line, lengths, rcond=None)[0]
    return left


def flight_table() -> Iterator[str]:
    """Yield rows with the spread of the field strength in blocks that the fit did not use."""
    yield "| compass | held out | without | following the current | best line on these blocks | more than that |"
    yield "|---|---|---:|---:|---:|---:|"
    for name, title in (("1", "external"), ("2", "second (internal)"), ("3", "third (internal)")):
        samples = compass(name)
        block = np.arange(len(samples)) * BLOCKS // len(samples)
        for half in (0, 1):
            learnt = [samples[block == place] for place in range(half, BLOCKS, 2)]
            found = fit_disturbances(learnt, ("current",)).calibration
            without = plain(np.concatenate([part.field for part in learnt]))
            for upright in (False, True):
                kept = (block % 2 != half) & (block < BLOCKS - INVERTED_BLOCKS * upright)
                others = samples[kept]
                lengths = strength(others, found)
                before, after = strength(others, without).std(), lengths.std()
                best = best_line(lengths, others, found).std()
                yield (
                    f"| {title} | {('even', 'odd')[1 - half]} blocks{', upright' if upright else ''} "
                    f"| {before:.2%} | {after:.2%} | {best:.2%} | {after / best - 1:.1%} |"
                )


def onboard_table() -> Iterator[str]:
    """Yield rows with the spread of the field strength in the air, for the onboard calibration and for ours."""
    samples = compass("1")
    assert samples.time is not None
    air = samples[(samples.time >= AIR_S[0]) & (samples.time < AIR_S[1])]
    assert air.time is not None
    block = ((air.time - AIR_S[0]) // BLOCK_S).astype(int)
    board = on_board()
    yield "| held out | on board | its offset, scale and current fitted to these blocks | plain | ours |"
    yield "|---|---:|---:|---:|---:|"
    for half in (0, 1):
        learnt = [air[block == place] for place in np.unique(block[block % 2 == half])]
        others = air[block % 2 != half]
        calm = plain(np.concatenate([part.field for part in learnt]))
        spreads = [
            strength(others, one).std() for one in (board, calm, fit_disturbances(learnt, ("current",)).calibration)
        ]
        told = " | ".join(f"{spread:.2%}" for spread in (spreads[0], moved_spread(others, board), *spreads[1:]))
        yield f"| {('even', 'odd')[1 - half]} blocks | {told} |"
    yield ""
    yield "| ours, of | offset at the median current, µT | 1 σ | on board less that | leaning, 1 σ |"
    yield "|---|---|---|---|---|"
    for title, part in (("the air", air), ("all but the last 15 s", samples[samples.time < samples.time[-1] - 15.0])):
        yield f"| {title} | {_onboard_row(part, board)} |"


def on_board() -> Calibration:
    """The onboard calibration, for readings from which nothing was removed."""
    offset, diagonal, (xy, xz, yz) = ONBOARD
    matrix = np.diag(diagonal) + np.array([[0.0, xy, xz], [xy, 0.0, yz], [xz, yz, 0.0]])
    return Calibration(matrix, -0.1 * np.array(offset), 50.0)


def moved_spread(samples: Samples, calibration: Calibration) -> float:
    """Spread of the field strength for a given matrix, with the best offset, scale and current for these readings."""
    radius = float(np.median(np.linalg.norm(calibration.apply(samples.field), axis=1)))
    ellipsoid = Ellipsoid(calibration.offset, np.linalg.inv(calibration.matrix) * radius)
    directions = calibration.apply(samples.field)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = magnitude.information(directions, ellipsoid)[:, :3]
    scale = np.einsum("ij,ij->i", normals, directions @ ellipsoid.shape)
    assert samples.current is not None
    design = np.column_stack([normals, scale, normals * samples.current[:, np.newaxis]])
    distances = magnitude.distances(samples.field, ellipsoid)
    left = distances - design @ np.linalg.lstsq(design, distances, rcond=None)[0]
    return float(left.std()) / radius


def _onboard_row(samples: Samples, board: Calibration) -> str:
    """Cells: offset at the median current with uncertainty, difference of the onboard one, and attitude dependence."""
    try:
        fit = flinders.fit(samples, disturbances=("current",))
    except Refused as refused:
        fit = refused.fit
    assert samples.current is not None
    assert fit.evidence.disturbances.covariance is not None
    drawn = float(np.median(samples.current))
    carried = np.hstack([np.eye(3), np.zeros((3, 6)), drawn * np.eye(3)])
    sigma = np.sqrt(np.diag(carried @ fit.evidence.disturbances.covariance @ carried.T))
    offset = fit.calibration.at(current=drawn).offset
    leaning = np.sqrt(np.diag(fit_disturbances([samples], ("current",)).leverage_covariance)[:3])
    return " | ".join(
        ", ".join(f"{value:.2f}" for value in values) for values in (offset, sigma, board.offset - offset, leaning)
    )


def _mean(ratios: Floats) -> str:
    return f"{ratios.mean():.2f}" if len(ratios) else "–"


def main() -> None:
    """Print the requested tables."""
    options = _parser().parse_args()
    tables: dict[str, Callable[[], Iterator[str]]] = {
        "nees": partial(nees_table, options.trials),
        "bench": partial(bench_table, options.trials),
        "flight": flight_table,
        "onboard": onboard_table,
    }
    unknown = [name for name in options.tables or tables if name not in tables]
    if unknown:
        sys.exit(f"no table {', '.join(unknown)}: there are {', '.join(tables)}")
    for name in options.tables or tables:
        if name in {"flight", "onboard"} and not (FOLDER / FLIGHT).is_file():
            print(f"\nno {FLIGHT} in {FOLDER}: set FLINDERS_DATA to the folder that holds it")
            continue
        print(f"\n## {name}\n")
        for line in tables[name]():
            print(line, flush=True)


def _parser() -> argparse.ArgumentParser:
    """Describe the command line."""
    parser = argparse.ArgumentParser("python -m benchmarks.disturbances", description="What is known of drivers.")
    parser.add_argument("--tables", type=lambda text: text.split(","), metavar="NAME,…", help="all by default")
    parser.add_argument("--trials", type=int, default=200, help="of nees and bench")
    return parser


if __name__ == "__main__":
    main()
