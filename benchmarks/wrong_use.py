"""Detection of wrong use of further sensors and of the site, and false alarms. Prints Markdown.

    python -m benchmarks.wrong_use [--seeds 20] [--motions swayed,hand] [--cases gyro,axes] [--rows]

Each case makes one mistake in an otherwise correct simulated recording of 1,500 readings, and counts the finding that
names it (``named``) and others (``others``, which may be right as well: a gyro in degrees acts like noise). The case
``good`` has no mistake: a mounting error of a few degrees, a gyro with a bias, a magnetometer with a lag, an attitude
with noise, a site wrong by a degree; any finding there is a false alarm.

Motions: ``swayed`` all headings with tilt, ``hand`` tumbled, ``rocked`` as MAGYC's (10 Hz), ``drive`` bends and hills,
6° at most (5 Hz), ``flight`` banked turns (5 Hz).
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import repeat
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders import fit, simulate
from flinders.core.axes import AXIS_ROTATIONS
from flinders.core.geomag import site_field
from flinders.errors import FitError
from flinders.fitting.aid_selection import fit_with_aids
from flinders.fitting.result import Refused
from flinders.geometry.quaternions import from_angles, from_matrix, product
from flinders.heading.attitude import magnetic_heading_deg
from flinders.likelihood.site_field import Site
from flinders.simulate.attitudes import rates

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.samples import Samples
    from flinders.diagnostics.instruments import Mistake
    from flinders.simulate import Simulated

SEED: Final = 20261121
COUNT: Final = 1500
RATES_HZ: Final = {"swayed": 25.0, "hand": 25.0, "rocked": 10.0, "drive": 5.0, "flight": 5.0}
HOME: Final = (47.6, 11.0)
"""Latitude and longitude of the recordings."""

YEAR: Final = 2026.9
KM: Final = 1.0 / 111.2
"""Degrees of latitude in one kilometre."""


@dataclass(frozen=True, slots=True, eq=False)
class Attack:
    """A recording with a mistake, and the expected finding.

    Attributes
    ----------
    samples : Samples
    aiding : tuple of str
    code : str
        Code of the finding; empty for a good recording.
    site : Site, optional
    disturbances : tuple of str
    """

    samples: Samples
    aiding: tuple[str, ...]
    code: str
    site: Site | None = None
    disturbances: tuple[str, ...] = ()


def recorded(motion: str, seed: int) -> tuple[Simulated, Samples, np.random.Generator]:
    """Correct recording at `HOME`: mounting within 5°, a gyro with a bias, an attitude with 0.5° of noise."""
    rng = np.random.default_rng([SEED, seed])
    home = site_field(*HOME, year=YEAR)
    imu = simulate.Imu(gyro_bias=rng.normal(0.0, 0.01, 3))
    true = simulate.tumble(
        rng, motion=motion, n=COUNT, rate_hz=RATES_HZ[motion], imu=imu, dip_deg=home.inclination_deg,
        field_strength=home.strength,
    )  # fmt: skip
    samples = true.samples
    assert samples.rate is not None
    assert samples.acceleration is not None
    mounting = simulate.turns(np.radians(rng.uniform(-5.0, 5.0, (1, 3))))[0]
    samples = replace(
        samples,
        rate=samples.rate @ mounting.T,
        acceleration=samples.acceleration @ mounting.T,
        attitude=_attitude(true, mounting, rng),
    )
    return true, samples, rng


# mistakes


def good(motion: str, seed: int, strength: float) -> Attack:
    """No mistake: error of the site's dip of one standard deviation, times the strength."""
    _, samples, rng = recorded(motion, seed)
    home = site_field(*HOME, year=YEAR)
    site = replace(Site.of(home), inclination_deg=home.inclination_deg + strength * rng.normal())
    return Attack(samples, ("rate", "dip", "attitude"), "", site)


def gyro(motion: str, seed: int, strength: float) -> Attack:
    """Rate times a factor: 57.3 for degrees, 1000 for mrad/s, −1 for the wrong sign."""
    _, samples, _ = recorded(motion, seed)
    assert samples.rate is not None
    return Attack(replace(samples, rate=samples.rate * strength), ("rate", "dip"), "gyro-unit")


def axes(motion: str, seed: int, strength: float) -> Attack:
    """Axes exchanged by one of 23 rotations: 0 of the gyro, 1 of the accelerometer, 2 of both alike."""
    _, samples, rng = recorded(motion, seed)
    turn = AXIS_ROTATIONS[rng.integers(1, len(AXIS_ROTATIONS))]
    columns = {0: ("rate",), 1: ("acceleration",), 2: ("rate", "acceleration")}[int(strength)]
    wrong = {name: turn.apply(getattr(samples, name)) for name in columns}
    return Attack(replace(samples, **wrong), ("rate", "dip"), "swapped-axes")  # type: ignore[arg-type]


def mirrored(motion: str, seed: int, strength: float) -> Attack:
    """One axis with the wrong sign: 0 of the gyro, 1 of the accelerometer, 2 of both."""
    _, samples, rng = recorded(motion, seed)
    signs = np.ones(3)
    signs[rng.integers(3)] = -1.0
    columns = {0: ("rate",), 1: ("acceleration",), 2: ("rate", "acceleration")}[int(strength)]
    wrong = {name: getattr(samples, name) * signs for name in columns}
    return Attack(replace(samples, **wrong), ("rate", "dip"), "swapped-axes")


def left_handed(motion: str, seed: int, strength: float) -> Attack:
    """Magnetometer mounted by one of 24 rotations, with one axis mirrored: 0 to 2 for x, y, z, 3 for none."""
    _, samples, rng = recorded(motion, seed)
    turn = AXIS_ROTATIONS[rng.integers(len(AXIS_ROTATIONS))]
    mounted = turn.reverse_axis("xyz"[int(strength)]) if strength < 3 else turn
    home = Site.of(site_field(*HOME, year=YEAR))
    code = f"mirrored-axis {mounted}" if strength < 3 else ""
    field = samples.field @ mounted.matrix
    return Attack(replace(samples, field=field), ("rate", "dip"), code, home)


def site(motion: str, seed: int, strength: float) -> Attack:
    """Site displaced to the north by some km; to the south if negative."""
    _, samples, _ = recorded(motion, seed)
    other = site_field(HOME[0] + strength * KM, HOME[1], year=YEAR)
    return Attack(samples, ("rate", "dip"), "site-differs", Site.of(other))


def leaning(motion: str, seed: int, strength: float) -> Attack:
    """Correct accelerometer of a vehicle that drives or flies, with slow noise of some µT.

    Other motions turn on the spot, so any finding on those is a false alarm.
    """
    _, samples, rng = recorded(motion, seed)
    memory = np.exp(-1.0 / (10.0 * RATES_HZ[motion]))
    noise = strength * rng.normal(size=samples.field.shape)
    noise[1:] *= np.sqrt(1.0 - memory**2)
    for row in range(1, len(noise)):
        noise[row] += memory * noise[row - 1]
    return Attack(replace(samples, field=samples.field + noise), ("dip",), "leans-in-turns")


def compass(motion: str, seed: int, strength: float) -> Attack:
    """Yaw from the same compass before its calibration, with an offset of some µT; roll and pitch are right."""
    true, samples, rng = recorded(motion, seed)
    assert true.attitudes is not None
    around = rng.normal(size=3)
    offset = strength * around / np.linalg.norm(around)
    samples = replace(samples, field=samples.field - true.sensor.offset + offset)
    felt = simulate.in_body_axes(true.attitudes, np.array([0.0, 0.0, -1.0]))
    raw = samples.field @ np.linalg.inv(np.asarray(true.sensor.matrix)).T
    perfect = true.field_strength * true.directions
    error = np.radians(magnetic_heading_deg(raw, felt) - magnetic_heading_deg(perfect, felt))
    zeros = np.zeros(len(error))
    yawed = product(from_angles(np.stack([zeros, zeros, error], axis=1)), samples.attitude)  # type: ignore[arg-type]
    return Attack(replace(samples, attitude=yawed), ("dip", "attitude"), "circular-attitude")


def current(motion: str, seed: int, strength: float) -> Attack:
    """Current that varies only by its noise, of some A."""
    _, samples, rng = recorded(motion, seed)
    flat = 12.0 + rng.normal(0.0, strength, len(samples))
    return Attack(replace(samples, current=flat), (), "disturbance-constant", disturbances=("current",))


def one_axis(motion: str, seed: int, strength: float) -> Attack:
    """Turn about the vertical alone, rocked by some degrees; the motion gives the rate of readings."""
    rng = np.random.default_rng([SEED, seed])
    turning = simulate.rocked(
        rng, seconds=COUNT / RATES_HZ[motion], rate_hz=RATES_HZ[motion], amplitudes_deg=(5.0, 5.0, 360.0)
    )
    heading = np.unwrap(np.arctan2(turning.attitudes[:, 1, 0], turning.attitudes[:, 0, 0]))
    home = site_field(*HOME, year=YEAR)
    lean = np.radians(strength) * np.sin(np.outer(turning.time, [0.31, 0.23]) + rng.uniform(0.0, 6.0, 2))
    attitudes = simulate.attitudes_of(heading, lean[:, 0], lean[:, 1])
    sensor = simulate.Sensor.random(rng, noise=0.5)
    true = simulate.in_body_axes(attitudes, home.strength * simulate.north_and_down(home.inclination_deg))
    rate = rates(attitudes, RATES_HZ[motion]) + rng.normal(0.0, 0.005, true.shape) + rng.normal(0.0, 0.01, 3)
    base = simulate.tumble(rng, motion="hand", n=COUNT, rate_hz=RATES_HZ[motion]).samples
    samples = replace(
        base, field=sensor.read(true, rng), rate=rate, acceleration=simulate.specific_force(attitudes, rng)
    )
    return Attack(samples, ("rate",), "one-axis")


CASES: Final[Mapping[str, tuple[Callable[[str, int, float], Attack], tuple[float, ...]]]] = {
    "good": (good, (0.0, 1.0)),
    "gyro": (gyro, (180.0 / np.pi, np.pi / 180.0, 1e3, -1.0)),
    "axes": (axes, (0, 1, 2)),
    "mirrored": (mirrored, (0, 1, 2)),
    "left-handed": (left_handed, (0, 1, 2, 3)),
    "site": (site, (-3000.0, -1000.0, -500.0, 500.0, 1000.0, 3000.0)),
    "leaning": (leaning, (0.0, 0.5)),
    "compass": (compass, (2.0, 5.0, 10.0, 20.0, 40.0)),
    "current": (current, (0.0, 0.02, 0.1)),
    "one-axis": (one_axis, (0.0, 0.5, 1.0, 3.0)),
}


# evaluation


def codes_of(attack: Attack) -> tuple[str, ...]:
    """Codes of the findings on instruments; without a fit, ``refused`` and the reason."""
    if attack.disturbances:
        try:
            findings = fit(attack.samples, disturbances=attack.disturbances).findings
        except Refused as refusal:
            findings = refusal.fit.findings
        except FitError as refusal:
            return (f"refused: {type(refusal).__name__}",)
        return tuple(finding.code for finding in findings if finding.code.startswith("disturbance"))
    try:
        _, aiding = fit_with_aids(attack.samples, attack.aiding, site=attack.site)
    except FitError as refusal:
        return (f"refused: {type(refusal).__name__}",)
    return tuple(_named(mistake) for mistake in aiding.mistakes)


def _named(mistake: Mistake) -> str:
    """Code of a mistake, and for a mirrored axis the mapping that corrects it."""
    if mistake.code != "mirrored-axis":
        return mistake.code
    return f"{mistake.code} {mistake.finding.values['axes']}"


def tried(case: str, strength: float, motion: str, seed: int) -> tuple[str, tuple[str, ...]]:
    """Expected code, and codes found."""
    attack = CASES[case][0](motion, seed, strength)
    return attack.code, codes_of(attack)


def table(pool: ProcessPoolExecutor, cases: Sequence[str], motions: Sequence[str], seeds: int) -> Iterator[str]:
    """Yield a row for each case, strength and motion."""
    yield "| case | strength | motion | named | others |"
    yield "|---|---:|---|---:|---|"
    for case in cases:
        for strength in CASES[case][1]:
            for motion in motions:
                found = list(pool.map(tried, repeat(case), repeat(strength), repeat(motion), range(seeds)))
                named = sum(code in codes for code, codes in found)
                others = Counter(other for code, codes in found for other in codes if other != code)
                told = ", ".join(f"{code} {count}" for code, count in others.most_common()) or "–"
                share = "–" if not any(code for code, _ in found) else f"{named} of {seeds}"
                yield f"| {case} | {strength:g} | {motion} | {share} | {told} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    options = _parser().parse_args(arguments)
    for asked, there in ((options.cases, CASES), (options.motions, RATES_HZ)):
        if unknown := [name for name in asked if name not in there]:
            sys.exit(f"{', '.join(unknown)} not known: there are {', '.join(there)}")
    with ProcessPoolExecutor(options.processes) as pool:
        for row in table(pool, options.cases, options.motions, options.seeds):
            print(row, flush=True)


def _parser() -> argparse.ArgumentParser:
    """Describe the command line."""
    parser = argparse.ArgumentParser("python -m benchmarks.wrong_use", description="Which wrong use is named.")

    def names(text: str) -> list[str]:
        return text.split(",")

    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--motions", type=names, default=list(RATES_HZ), metavar="NAME,…", help="all by default")
    parser.add_argument("--cases", type=names, default=list(CASES), metavar="NAME,…", help="all by default")
    parser.add_argument("--processes", type=int, default=2)
    return parser


def _attitude(true: Simulated, mounting: Floats, rng: np.random.Generator) -> Floats:
    """(N, 4) logged attitude of gyro and accelerometer, with 0.5° of noise about each axis."""
    assert true.attitudes is not None
    shaken = simulate.turns(rng.normal(0.0, np.radians(0.5), (len(true.attitudes), 3)))
    return from_matrix(true.attitudes @ mounting.T @ shaken)


if __name__ == "__main__":
    main()
