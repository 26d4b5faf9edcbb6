"""Stability of a good result of the page while the sensor rests in another field. Prints Markdown.

    python -m benchmarks.kept [--sensors 40] [--processes 2]

A sensor with unknown iron is turned for 25 s, and rests for 15 s before, in the middle or after, where the field
differs by a share of itself in a random direction. *Lost*: a session that was good has another phase later. *Alarmed*:
it has the phase *wrong*. *Ratio* is the true over the claimed worst level heading error of good final calibrations. The
physics are those of `benchmarks.adversary`.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
from tests.page_session import PageSession

from benchmarks import adversary
from flinders.apps.live.buffer import COLUMNS
from flinders.core.units import MICROTESLA, Unit

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats

RATE_HZ: Final = 50.0
TURNED_S, RESTED_S, STEP_S = 25.0, 15.0, 0.5
REST_POSITIONS: Final = ("before", "between", "after")
FIELD_CHANGES: Final = (0.0, 0.01, 0.02, 0.03, 0.05, 0.2)


@dataclass(frozen=True, slots=True)
class Played:
    """Result of a session."""

    was_good: bool
    is_lost: bool
    is_alarmed: bool
    ratio: float  # NaN unless the final calibration is good


def played(seed: int, when: str, off: float) -> Played:
    """Play a turn with a rest into a session of the page."""
    of = adversary.sensor(adversary.stream(seed, "sensor"))
    field = _with_rest(_turned(seed, of), adversary.stream(seed, "rest"), of, when, off)
    rows = np.full((len(field), COLUMNS), np.nan)
    rows[:, 0], rows[:, 1:4] = np.arange(len(field)) / RATE_HZ, field
    session, phases, step = PageSession(), [], round(STEP_S * RATE_HZ)
    for begin in range(0, len(rows), step):
        some = rows[begin : begin + step]
        session.arrived(float(some[-1, 0]), some, Unit.of(MICROTESLA))
        session.fit()
        phases.append(session.state.phase)
    first = phases.index("good") if "good" in phases else len(phases)
    return Played(
        first < len(phases),
        any(phase != "good" for phase in phases[first:]),
        "wrong" in phases,
        _ratio(session, seed, of),
    )


def _turned(seed: int, of: adversary.Sensor) -> Floats:
    """(N, 3) readings of a tumble."""
    path = adversary.tumble(adversary.stream(seed, "path 0"), seconds=TURNED_S, rate=1.5)
    return adversary.recorded(seed, of, adversary.EFFECTS["nothing"], path).field


def _with_rest(field: Floats, rng: np.random.Generator, of: adversary.Sensor, when: str, off: float) -> Floats:
    """Readings with a rest at their present attitude, in a field that differs by a share."""
    at = {"before": 0, "between": len(field) // 2, "after": len(field)}[when]
    inside = np.linalg.solve(of.iron.T, field[min(at, len(field) - 1)] - of.offset)
    aside = rng.standard_normal(3)
    there = inside + off * np.linalg.norm(inside) * aside / np.linalg.norm(aside)
    noise = adversary.NOISE_UT * rng.standard_normal((round(RESTED_S * RATE_HZ), 3))
    return np.concatenate([field[:at], there @ of.iron + of.offset + noise, field[at:]])


def _ratio(session: PageSession, seed: int, of: adversary.Sensor) -> float:
    """True over claimed worst level heading error of the final fit."""
    view = session.view
    if view is None or view.verdict != "good":
        return np.nan
    level = adversary.level(seed, of, adversary.EFFECTS["nothing"])
    corrected = (level - np.array(view.offset)) @ np.array(view.matrix).T
    return float(np.abs(adversary.headings(corrected)).max() / view.heading_error_deg.worst)


def table(sensors: int, processes: int) -> Iterator[str]:
    """Yield a row for each position of the rest and each change of the field."""
    yield "| rest | field off by | good | lost | alarmed | good in the end | ratio 50 / 90 % |"
    yield "|---|---:|---:|---:|---:|---:|---|"
    with ProcessPoolExecutor(processes) as pool:
        for when in REST_POSITIONS:
            for off in FIELD_CHANGES:
                done = list(pool.map(partial(played, when=when, off=off), range(sensors)))
                ratios = [one.ratio for one in done if np.isfinite(one.ratio)]
                quantiles = " / ".join(f"{ratio:.1f}" for ratio in np.quantile(ratios, [0.5, 0.9]))
                counts = [sum(one.was_good for one in done), sum(one.is_lost for one in done)]
                counts += [sum(one.is_alarmed for one in done), len(ratios)]
                yield f"| {when} | {off:.0%} | {' | '.join(map(str, counts))} | {quantiles} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--sensors", type=int, default=40)
    parser.add_argument("--processes", type=int)
    options = parser.parse_args()
    for line in table(options.sensors, options.processes):
        print(line, flush=True)


if __name__ == "__main__":
    main()
