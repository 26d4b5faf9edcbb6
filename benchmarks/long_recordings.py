"""Claims on recordings of ten minutes and more: noise with an end, lagging axes, and currents.

    python -m benchmarks.long_recordings [--trials 40] [--effects "one axis late by 20 ms" …] [--processes 2]

A sensor is tumbled by hand or flies aerobatics for ten minutes; a tag is worn for an hour by an animal that
turns, pitches and rolls. The physics are those of `benchmarks.adversary`, which shares no code with
`flinders.simulate`. The field of a throttle is relative to its mean, which is part of the offset in flight.

*Claim over true* is the ratio for the worst level heading error, over all fits, also refused ones: true claims have 0.8
in the median. *Within two* is the share with an error of at most twice the claim.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.adversary import (
    EFFECTS,
    RATE_HZ,
    STEPS_PER_READING,
    Effect,
    Path,
    about,
    fitted,
    headings,
    held,
    level,
    recorded,
    sensor,
    smooth,
    stream,
    tumble,
    turned,
)
from benchmarks.varying_field import VERDICTS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.random import Generator

    from flinders.arrays import Floats

MINUTES: Final = 600.0
HOUR: Final = 3600.0
STEP_S: Final = 1.0 / (STEPS_PER_READING * RATE_HZ)


def aerobatics(rng: Generator) -> Path:
    """Path of rolls and loops, with less yaw."""
    rates = np.array([1.2, 0.5, 0.3]) * smooth(rng, round(MINUTES / STEP_S), STEP_S, 2.0)
    return turned(rng, rates, STEP_S)


def worn(rng: Generator) -> Path:
    """Path of an animal with random turns, pitch of 34° (rms) and roll of 23°, at ten readings a second."""
    step_s = 10.0 * STEP_S
    steps = round(HOUR / step_s)
    pitch, roll = (size * smooth(rng, steps, step_s, 8.0, 1)[:, 0] for size in (0.6, 0.4))
    yaw = step_s * np.cumsum(0.15 * smooth(rng, steps, step_s, 5.0, 1)[:, 0])
    zero = np.zeros(steps)
    attitudes = (
        about(np.stack([zero, zero, yaw], axis=1))
        @ about(np.stack([zero, pitch, zero], axis=1))
        @ about(np.stack([roll, zero, zero], axis=1))
    )
    return Path(step_s * np.arange(steps), attitudes, held(rng, attitudes, step_s))


def throttle(rng: Generator, path: Path, *, full: float) -> Floats:
    """Field of a motor current that varies within seconds, less its mean; `full` µT at full throttle."""
    step_s = path.time[1] - path.time[0]
    share = np.clip(0.5 + 0.3 * smooth(rng, len(path.time), step_s, 2.0, 1)[:, 0], 0.0, 1.0) ** 1.5
    along = rng.standard_normal(3)
    field: Floats = full * (share - share.mean())[:, None] * along / np.linalg.norm(along)
    return field


PATHS: Final[dict[str, Callable[[Generator], Path]]] = {
    "tumble, 10 min": partial(tumble, seconds=MINUTES),
    "aerobatics, 10 min": aerobatics,
    "animal, 1 h": worn,
}
EXTRA_EFFECTS: Final = {
    name: EFFECTS[name]
    for name in (
        "nothing",
        "one axis late by 20 ms",
        "one axis late by 60 ms",
        "axes late by 50 ms ± 30 %",
        "memory 4 s, 0.5 µT",
        "memory 30 s, 0.5 µT",
        "load on and off, 2 µT",
    )
} | {f"throttle, {full:.0f} µT": Effect(body=partial(throttle, full=full)) for full in (1.0, 3.0)}


def tried(case: tuple[str, str, int]) -> tuple[str, float, float, str] | None:
    """Verdict, claim and true error, degrees, and the first finding, of one fit of an effect on a path with a seed."""
    name, path, seed = case
    of = sensor(stream(seed, "sensor"))
    fit = fitted(recorded(seed, of, EXTRA_EFFECTS[name], PATHS[path](stream(seed, f"path {path}"))))
    if fit is None:
        return None
    true = float(np.abs(headings(fit.calibration.apply(level(seed, of, EXTRA_EFFECTS[name])))).max())
    return fit.verdict, fit.heading_error_deg.worst, true, fit.findings[0].code


HEAD: Final = (
    "| path | effect | good, limited, refused | claimed, true (median) | claim over true 10 / 50 / 90 % | within two |"
    " first |\n"
    "|---|---|---|---|---|---:|---|"
)


def row(path: str, name: str, trials: Sequence[tuple[str, float, float, str]]) -> str:
    """A row of the table."""
    verdicts, claimed, true, first = (np.array(column) for column in zip(*trials, strict=True))
    counts = ", ".join(str((verdicts == verdict).sum()) for verdict in VERDICTS)
    ratios = " / ".join(f"{q:.1f}" for q in np.quantile(claimed / true, [0.1, 0.5, 0.9]))
    codes, times = np.unique(first, return_counts=True)
    return (
        f"| {path} | {name} | {counts} | {np.median(claimed):.2f}°, {np.median(true):.2f}° | {ratios} |"
        f" {np.mean(true <= 2.0 * claimed):.0%} | {codes[times.argmax()]} |"
    )


def table(names: Sequence[str], trials: int, processes: int) -> Iterator[str]:
    """A row for each path and effect."""
    yield HEAD
    with ProcessPoolExecutor(processes) as pool:
        for path in PATHS:
            for name in names:
                found = pool.map(tried, [(name, path, seed) for seed in range(trials)])
                yield row(path, name, [trial for trial in found if trial is not None])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--trials", type=int, default=40, help="fits of each effect on each path")
    parser.add_argument("--effects", nargs="+", default=list(EXTRA_EFFECTS), choices=EXTRA_EFFECTS, metavar="EFFECT")
    parser.add_argument("--processes", type=int, default=2)
    chosen = parser.parse_args(arguments)
    for line in table(chosen.effects, chosen.trials, chosen.processes):
        print(line, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
