"""Accuracy of Tolles–Lawson compensations on other flights: errors compared with claims, and figures of merit.

    python -m benchmarks.tolles_lawson [--trials 200]

Each simulated aircraft makes a calibration flight, another flight of the same manoeuvres on the same headings, and two
on four headings between those. Errors are those of the compensation in the other flights, from 0.1 to 0.9 Hz, without
ground and noise, also of the vector magnetometer, which would add to the claim; a ratio to the claim is a root mean
square over the trials, and 1 for true claims. A figure of merit is the sum of the peak-to-peak interference of the
twelve manoeuvres on the headings between, with all noise; its reduction is compared with that of least squares fitted
to the same manoeuvres, with noise and ground. Refused fits count in the last column only.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.apps.survey.simulate_aircraft import Aircraft, calibration_flight, fluxgate
from flinders.apps.survey.tolles_lawson_fit import NO_RIDGE, Equations, fit_coefficients
from flinders.apps.survey.tolles_lawson_terms import Signal
from flinders.simulate import Sensor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from flinders.apps.survey.simulate_aircraft import Flight
    from flinders.arrays import Floats

BETWEEN_DEG: Final = (45.0, 135.0, 225.0, 315.0)
MANOEUVRES: Final = ("roll", "pitch", "yaw")

CASES: Final[Mapping[str, tuple[float, dict[str, Any]]]] = {
    "four headings": (1.0, {}),
    "a fifth of the iron": (0.2, {}),
    "four times the iron": (4.0, {}),
    "ground five times as rough": (1.0, {"geology": 0.1}),
    "a vector magnetometer with 20 nT of noise": (1.0, {"vector": Sensor(noise=0.02)}),
    "north and south": (1.0, {"headings_deg": (0.0, 180.0)}),
    "rolls alone": (1.0, {"manoeuvres": ("roll",)}),
    "north four times": (1.0, {"headings_deg": (0.0, 0.0, 0.0, 0.0)}),
}
"""Magnetic strength of the aircraft, and changed arguments of the calibration flight."""


@dataclass(frozen=True, slots=True)
class Trial:
    """Result of one aircraft."""

    verdict: str
    before: float  # nT, on the calibration flight
    cross_validated: float
    as_flown: float  # error over claim
    between: float
    merit: float  # nT, figure of merit before
    left: float  # and after
    of_optimum: float  # its reduction over that of the optimum


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=200)
    for line in lines(parser.parse_args().trials):
        print(line, flush=True)


def lines(count: int) -> Iterator[str]:
    """Yield the lines of the table."""
    yield (
        "| calibration flight | before, nT | held out, nT | error/claim as flown | on headings between "
        "| figure of merit, nT | after, nT | reduction/optimum | least of 95 % | good, limited, refused |"
    )
    yield "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|"
    for name, (iron, different) in CASES.items():
        yield f"| {name} | {_row([trial(seed, iron, **different) for seed in range(count)])} |"


def trial(seed: int, iron: float, **different: Any) -> Trial:
    """Result of one aircraft: its calibration flight, and the flights on the same headings and on those between."""
    rng = np.random.default_rng(seed)
    drawn = Aircraft.random(rng)
    aircraft = Aircraft(iron * drawn.permanent, iron * drawn.induced, iron * drawn.eddy)
    same = {"aircraft": aircraft, "vector": fluxgate(rng), **different}
    flight = calibration_flight(rng, **same)
    exact = {**same, "vector": replace(same["vector"], noise=0.0)}
    again = calibration_flight(rng, **exact)
    between = calibration_flight(rng, **{**exact, "headings_deg": BETWEEN_DEG, "manoeuvres": MANOEUVRES})
    survey = calibration_flight(rng, aircraft=aircraft, vector=same["vector"], headings_deg=BETWEEN_DEG)
    fit = fit_coefficients(flight.samples)
    left, optimum = survey.interference - fit.interference(survey.samples), _optimum(survey)
    merit, after = merit_of(survey, survey.interference), merit_of(survey, left)
    return Trial(
        fit.verdict,
        fit.before,
        fit.cross_validated,
        in_band(again, again.interference - fit.interference(again.samples)) / fit.as_flown,
        in_band(between, between.interference - fit.interference(between.samples)) / fit.on_any_heading,
        merit,
        after,
        (merit - after) / (merit - merit_of(survey, optimum)),
    )


def in_band(flight: Flight, values: Floats) -> float:
    """Standard deviation of (N,) values of a flight, nT, from 0.1 to 0.9 Hz."""
    runs = Signal.of(flight.samples).runs()
    cosines = np.concatenate([run.filter_band(values[run.rows]) for run in runs])
    return float(np.sqrt(np.sum(cosines**2) / sum(map(len, runs))))


def merit_of(flight: Flight, values: Floats) -> float:
    """Sum of the peak-to-peak values of the manoeuvres, each less its straight line."""
    return sum(float(np.ptp(_without_line(values[each.rows]))) for each in flight.manoeuvres)


def _without_line(values: Floats) -> Floats:
    line = np.column_stack([np.ones(len(values)), np.arange(len(values))])
    rest: Floats = values - line @ np.linalg.lstsq(line, values, rcond=None)[0]
    return rest


def _optimum(flight: Flight) -> Floats:
    """(N,) residuals of least squares fitted to the same readings."""
    signal = Signal.of(flight.samples)
    equations = Equations.of(signal.runs())
    coefficients = equations.fit(NO_RIDGE)
    return flight.interference - signal.interference(coefficients)


def _row(trials: Sequence[Trial]) -> str:
    """Cells of a row."""
    usable = [each for each in trials if each.verdict != "refused"]
    verdicts = Counter(each.verdict for each in trials)
    counts = ", ".join(str(verdicts[name]) for name in ("good", "limited", "refused"))
    if not usable:
        return " | ".join([*["–"] * 8, counts])
    columns = {
        name: np.array([getattr(each, name) for each in usable]) for name in Trial.__slots__ if name != "verdict"
    }
    numbers: dict[str, Callable[[Floats], float]] = {
        "before": np.median, "cross_validated": np.median, "as_flown": _rms, "between": _rms, "merit": np.median,
        "left": np.median, "of_optimum": np.median,
    }  # fmt: skip
    cells = [float(number(columns[name])) for name, number in numbers.items()]
    return " | ".join([*(f"{cell:.3g}" for cell in [*cells, float(np.quantile(columns["of_optimum"], 0.05))]), counts])


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main()
