"""Accuracy of refreshed calibrations: errors compared with the bound for a known soft iron, and with claims.

    python -m benchmarks.refresh [--trials 200]

Vehicles are calibrated by a tumble of a minute, then an offset of 10 µT an axis is added (1 σ) and the calibration is
refreshed from ten seconds. The bound is the Cramér-Rao bound with the earlier covariance of the shape, and the strength
of the field to 1 %, as prior. Errors are those of a level heading, rms over all headings; a ratio to the claim is a
root mean square over the trials, and 1 for true claims.

The last line is of real repeats: five tumbles of one compass, each calibrated with all its readings, and each ten
seconds of them refreshed with the calibration of another one: difference of both over their combined claim.

A second table is of vehicles at rest at known headings: headings, tilts and dip have errors of 1° (1 σ), the strength
of the field of 1 %. Courses over ground have a crab angle, as from steady wind.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from benchmarks.recordings import FOLDER
from flinders.core.units import Unit
from flinders.errors import FitError
from flinders.fitting.known_heading import PoseSigmas, refresh_at_headings
from flinders.fitting.refreshing import known_shape
from flinders.fitting.result import Refused, with_name
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix, upper_entries
from flinders.heading.error_propagation import level_error
from flinders.likelihood.magnitude import information
from flinders.simulate import Sensor, tumble
from flinders.simulate.attitudes import attitudes_of, in_body_axes, north_and_down

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit
    from flinders.simulate import Simulated

FIELD_UT, MOVE_UT = 50.0, 10.0

MOTIONS: Final = {
    "10 s of ±30°": ("wobble", ()),
    "the same, with its gyro": ("wobble", ("rate",)),
    "level turn": ("level", ()),
}
"""Motion of `flinders.simulate.tumble`, and the aiding sensors."""

HEADINGS: Final = (1, 2, 4, 8)
CRABS_DEG: Final = (0.0, 2.0)
"""Crab angles of courses, 1 σ of each amplitude over the heading."""
DIP_DEG, POSE_READINGS = 60.0, 100
"""Dip, degrees, and readings of a pose."""

CHANGES: Final = (0.0, 0.003, 0.01, 0.02, 0.05)
"""Changes of the soft iron, root mean square of the entries."""


@dataclass(frozen=True, slots=True)
class Trial:
    """A refreshed calibration: heading errors in degrees, rms, and its verdict."""

    error: float
    claim: float
    bound: float
    is_good: bool
    is_changed: bool


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description="How good a refreshed calibration is.")
    parser.add_argument("--trials", type=int, default=200)
    trials = parser.parse_args().trials
    print("| motion | soft iron | error ÷ bound | error ÷ claim | error, ° | claim, ° | good | “changed” | none |")
    print("|---|---|---:|---:|---:|---:|---:|---:|---:|")
    for words, (motion, aiding) in MOTIONS.items():
        for change in CHANGES:
            some = [trial for seed in range(trials) if (trial := tried(seed, motion, aiding, change)) is not None]
            print(f"| {words} | {_changed(change)} | {_row(some, trials)} |", flush=True)
    print("\n| headings, crab | error ÷ claim | error, ° | claim, ° | good | refused for contradiction |")
    print("|---:|---:|---:|---:|---:|---:|")
    for crab, headings in product(CRABS_DEG, HEADINGS):
        some = [trial for seed in range(trials) if (trial := stood(seed, headings, crab)) is not None]
        errors, claims = (np.array([getattr(trial, name) for trial in some]) for name in ("error", "claim"))
        numbers = (np.sqrt(np.mean((errors / claims) ** 2)), np.median(errors), np.median(claims))
        row = [f"{headings}, {crab:g}°", *(f"{number:.3g}" for number in numbers)]
        print(f"| {' | '.join(row)} | {sum(trial.is_good for trial in some)} | {trials - len(some)} |", flush=True)
    ratios = repeats()
    print(f"\nreal repeats: {len(ratios)}, median {np.median(ratios):.2g}, 90 % {np.quantile(ratios, 0.9):.2g}")


def repeats() -> Floats:
    """(K,) differences at the worst heading over the combined claim, for ten seconds of the real repeats."""
    recordings = [flinders.read(path) for path in sorted((FOLDER / "pichim_betaflight").glob("Cal*.csv"))]
    recordings += [flinders.read(path) for path in sorted((FOLDER / "pichim_betaflight").glob("calTest*.csv"))]
    ratios = []
    for (earlier, _), (whole, samples) in permutations([(flinders.fit(each), each) for each in recordings], 2):
        assert samples.time is not None
        seconds = samples.time - samples.time[0]
        for begin in range(0, int(seconds[-1]) - 10, 10):
            part = samples[(seconds >= begin) & (seconds < begin + 10)]
            try:
                fit = flinders.refresh(part, earlier)
            except Refused as refused:
                fit = refused.fit
            apart = flinders.compare(with_name(fit, "refreshed"), whole, dip_deg=DIP_DEG).heading_difference_deg.worst
            ratios.append(apart / math.hypot(fit.heading_error_deg.worst, whole.heading_error_deg.worst))
    return np.array(ratios)


def stood(seed: int, headings: int, crab_deg: float = 0.0) -> Trial | None:
    """Calibrate a vehicle, change it, and refresh from poses at `headings` headings; None if the poses contradict.

    Courses have a crab angle by a steady wind.
    """
    rng = np.random.default_rng([seed, 26])
    first = tumble(seed)
    earlier = flinders.fit(first.samples, site=flinders.Site(strength=FIELD_UT))
    sensor = replace(first.sensor, offset=first.sensor.offset + rng.normal(0.0, MOVE_UT, 3))
    magnetic = rng.uniform(0.0, 360.0) + np.arange(headings) * 360.0 / headings
    world = FIELD_UT * rng.normal(1.0, 0.01) * north_and_down(DIP_DEG + rng.normal())
    angles = np.radians(np.stack([magnetic + rng.normal(size=headings), *rng.normal(size=(2, headings))]))
    fields = in_body_axes(attitudes_of(*angles), world)
    wind = crab_deg * np.random.default_rng([seed, 27]).standard_normal(2)
    courses = magnetic + wind @ [np.sin(np.radians(magnetic)), np.cos(np.radians(magnetic))]
    poses = [sensor.read(np.tile(field, (POSE_READINGS, 1)), rng) for field in fields]
    try:
        fit = refresh_at_headings(
            poses,
            _in_microtesla(earlier),
            courses.tolist(),
            sigmas=PoseSigmas(crab_deg=crab_deg),
            site=flinders.Site(inclination_deg=DIP_DEG),
        )
    except Refused as refused:
        if any(finding.code == "poses-contradict" for finding in refused.fit.findings):
            return None
        fit = refused.fit
    truth = Ellipsoid(sensor.offset, FIELD_UT * sensor.matrix)
    error = heading_deg(truth, parameters(fit.calibration.ellipsoid) - parameters(truth))
    return Trial(error, fit.heading_error_deg.rms, math.nan, fit.verdict == "good", is_changed=False)


def _in_microtesla(fit: Fit) -> Fit:
    return replace(fit, calibration=replace(fit.calibration, raw=Unit.of("uT")))


def tried(seed: int, motion: str, aiding: Sequence[str], change: float) -> Trial | None:
    """Calibrate a vehicle, change it, and refresh; None without a fit."""
    rng = np.random.default_rng([seed, 24])
    first = tumble(seed)
    earlier = flinders.fit(first.samples, site=flinders.Site(strength=FIELD_UT))
    matrix = soft_iron(rng, change) @ first.sensor.matrix
    offset = first.sensor.offset + rng.normal(0.0, MOVE_UT, 3)
    sensor = Sensor((matrix + matrix.T) / 2.0, offset, first.sensor.noise)
    short = tumble(np.random.default_rng([seed, 25]), motion=motion, n=500, sensor=sensor)
    try:
        fit = flinders.refresh(short.samples, earlier, aiding=aiding)
    except Refused as refused:
        fit = refused.fit
    except FitError:
        return None
    codes = {finding.code for finding in fit.findings}
    truth = Ellipsoid(sensor.offset, FIELD_UT * sensor.matrix)
    return Trial(
        heading_deg(truth, parameters(fit.calibration.ellipsoid) - parameters(truth)),
        fit.heading_error_deg.rms,
        bound_deg(short, truth, earlier),
        fit.verdict == "good",
        "soft-iron-changed" in codes,
    )


def soft_iron(rng: np.random.Generator, change: float) -> Floats:
    """(3, 3) symmetric factor that changes the soft iron by `change`, rms of its entries, but not the mean strength."""
    entries = rng.standard_normal(6)
    deviator = symmetric_matrix(entries) - np.eye(3) * entries[:3].mean()
    added: Floats = change * deviator / np.sqrt(np.mean(upper_entries(deviator) ** 2))
    return np.eye(3) + added


def parameters(ellipsoid: Ellipsoid) -> Floats:
    """(9,) offset and shape."""
    return np.concatenate([ellipsoid.centre, upper_entries(ellipsoid.shape)])


def heading_deg(truth: Ellipsoid, error: Floats) -> float:
    """Error of a level heading, rms over all headings, for (9,) errors of the parameters."""
    return level_error(truth, np.outer(error, error)).rms


def bound_deg(short: Simulated, truth: Ellipsoid, earlier: Fit) -> float:
    """Cramér-Rao bound of the level heading error, from the true directions, degrees."""
    directions = np.linalg.solve(truth.shape, (short.samples.field - truth.centre).T).T
    rows = information(directions / np.linalg.norm(directions, axis=1, keepdims=True), truth)
    matrix = rows.T @ rows / short.sensor.noise**2
    matrix[3:, 3:] += np.linalg.inv(known_shape(earlier).covariance)
    return level_error(truth, np.linalg.inv(matrix)).rms


def _changed(change: float) -> str:
    return f"changed by {change:.1%}" if change else "as it was"


def _row(trials: Sequence[Trial], count: int) -> str:
    """Cells of a row."""
    errors, claims, bounds = (
        np.array([getattr(trial, name) for trial in trials]) for name in ("error", "claim", "bound")
    )
    good, changed = sum(trial.is_good for trial in trials), sum(trial.is_changed for trial in trials)
    beside = [float(np.sqrt(np.mean((errors / other) ** 2))) for other in (bounds, claims)]
    typical = [float(np.median(values)) for values in (errors, claims)]
    return " | ".join(
        [*(f"{number:.3g}" for number in (*beside, *typical)), *map(str, (good, changed, count - len(trials)))]
    )


if __name__ == "__main__":
    main()
