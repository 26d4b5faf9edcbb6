"""Detected faults of units, and false alarms for good units, as a confusion table in Markdown.

    python -m benchmarks.faults [--each 500] [--good 5000] [--workers 2]     # each fault and severity, so many units
    python -m benchmarks.faults --fleet 1000000 [--bad 0.03] --out runs/     # a fleet as it is drawn, to go on with

Units are those of `flinders.apps.fleet.simulate`. They are judged by ``flinders.fit_many``, whose verdicts equal those
of ``flinders.fit``. A unit is **found** if it is limited, refused or without a fit, or if a note names the fault
(`FAULT_NOTES`). A good unit that is found is a false alarm; the table names its most severe finding and such notes. A
unit that is not found is **off** if its true worst level heading error is above `MIN_HARM_DEG`; a fault that does not
affect the calibration does no harm.

Each piece of `PIECE` units is one file in ``--out``, which is written under another name and then renamed. A piece that
exists is not run again. Memory is bounded by one piece. A unit is determined by the seed and its number, so that the
table does not depend on the number of workers.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from flinders import fit_many, simulate
from flinders.apps.fleet.simulate import BAD_SHARE, DIP_DEG, FAULTS, Specimen, unit

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.arrays import Floats

SEED: Final = 20261122
PIECE: Final = 500

MIN_HARM_DEG: Final = 2.0
"""Smallest heading error in degrees that counts as harm: twice the target, and 2 σ of a claim equal to the target."""

FAULT_NOTES: Final = frozenset({"stale-repeats", "outliers", "field-changed"})
"""Notes about a fault that the calibration takes into account."""

Key: TypeAlias = tuple[str, int]
"""Fault and severity; empty and 0 for good units."""

Tally: TypeAlias = dict[Key, Counter[str]]


@dataclass(frozen=True, slots=True)
class Piece:
    """Some consecutive units.

    Attributes
    ----------
    first, count : int
        Number of the first unit, and number of units.
    fault : str, optional
        Fault of all units; empty for good units; None to draw it for each unit.
    severity : int
    bad : float
        Share of bad units, if faults are drawn.
    """

    first: int
    count: int
    fault: str | None = None
    severity: int = 2
    bad: float = BAD_SHARE

    @property
    def name(self) -> str:
        """Name of its file."""
        what = f"{self.bad:g}" if self.fault is None else f"{self.fault or 'good'}-{self.severity}"
        return f"{what}-{self.first:08d}-{self.count}.json"

    def units(self) -> Iterator[Specimen]:
        """Yield the units."""
        for number in range(self.first, self.first + self.count):
            yield unit(number, seed=SEED, bad=self.bad, fault=self.fault, severity=self.severity)


def judged(made: Sequence[Specimen]) -> Iterator[Counter[str]]:
    """Yield the counts of each unit: ``units``, verdict, ``found``, and codes, of which the most severe has a !."""
    rows = fit_many({f"{place:06d}": one.samples for place, one in enumerate(made)})
    for place, one in enumerate(made):
        verdict, codes = str(rows.verdict[place]), list(rows.findings[place])
        if verdict == "failed" or not codes:
            codes = [str(rows.code[place]) or "none", *codes]
        if verdict != "good":
            codes[0] += "!"
        told = [verdict, *codes]
        if verdict != "good" or not FAULT_NOTES.isdisjoint(codes):
            told.append("found")
        elif off_deg(one, rows.offset[place], rows.matrix[place].reshape(3, 3)) > MIN_HARM_DEG:
            told.append("off")
        yield Counter(["units", *told])


def off_deg(made: Specimen, offset: Floats, matrix: Floats) -> float:
    """Worst true level heading error in degrees, minus the mean error over all headings."""
    headings = np.radians(np.arange(0.0, 360.0, 3.0))
    attitudes = simulate.attitudes_of(headings, 0.0, 0.0)
    world = made.field_strength * simulate.north_and_down(DIP_DEG)
    raw = simulate.in_body_axes(attitudes, world) @ made.sensor.matrix.T + made.sensor.offset
    x, y, _ = matrix @ (raw @ made.lasting.T - offset).T
    error = np.exp(1j * (np.arctan2(-y, x) - headings))
    return float(np.degrees(np.abs(np.angle(error * np.conj(error.mean())))).max())


def tallied(piece: Piece, folder: Path | None = None) -> Tally:
    """Counts of a piece, which are computed or read from its file."""
    path = None if folder is None else folder / piece.name
    if path is not None and path.exists():
        return {
            (fault, severity): Counter(counts) for fault, severity, counts in json.loads(path.read_text())
        }  # fmt: skip
    tally: Tally = {}
    made = list(piece.units())
    for one, counts in zip(made, judged(made), strict=True):
        tally.setdefault((one.fault, one.severity), Counter()).update(counts)
    if path is not None:
        begun = path.with_suffix(".part")
        begun.write_text(json.dumps([[*key, counts] for key, counts in tally.items()]))
        begun.replace(path)
    return tally


def pieces_of(total: int, *, fault: str | None, severity: int = 2, bad: float = BAD_SHARE) -> Iterator[Piece]:
    """Yield pieces with `total` units altogether."""
    for first in range(0, total, PIECE):
        yield Piece(first, min(PIECE, total - first), fault, severity, bad)


def by_class(each: int, good: int, faults: Sequence[str]) -> Iterator[Piece]:
    """Yield pieces with units of each fault and severity, and good units; faults without a sign have one severity."""
    yield from pieces_of(good, fault="")
    for fault in faults:
        for severity in (1, 2) if FAULTS[fault].is_detectable else (2,):
            yield from pieces_of(each, fault=fault, severity=severity)


def run(pieces: Iterable[Piece], workers: int, folder: Path | None) -> Tally:
    """Run all pieces in several processes, and add up their counts."""
    total: Tally = {}
    work = partial(tallied, folder=folder)
    with ProcessPoolExecutor(workers) as pool:
        for tally in pool.map(work, pieces):
            for key, counts in tally.items():
                total.setdefault(key, Counter()).update(counts)
    return total


def table(total: Tally) -> list[str]:
    """Rows in Markdown for each fault and severity; the good units are first."""
    rows = [
        "| fault | severity | units | good | limited | refused | no fit | found | missed and off | reported by |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---|",
    ]
    order = ["", *FAULTS]
    for (fault, severity), counts in sorted(total.items(), key=lambda item: (order.index(item[0][0]), item[0][1])):
        of, amount = counts["units"], FAULTS[fault].amount(severity) if fault else 0.0
        verdicts = [f"{counts[verdict] / of:.1%}" for verdict in ("good", "limited", "refused", "failed")]
        what = f"{('', 'smaller', 'larger')[severity]} ({amount:g})" if fault else ""
        cells = [fault or "**none**", what, f"{of:,}", *verdicts, f"**{counts['found'] / of:.2%}**", str(counts["off"])]
        rows.append(f"| {' | '.join(cells)} | {told_by(counts)} |")
    return rows


def told_by(counts: Counter[str]) -> str:
    """Most frequent findings, with their counts: those other than notes, and notes about faults."""
    codes = [
        (code.rstrip("!"), number)
        for code, number in counts.most_common()
        if code.endswith("!") or code in FAULT_NOTES or code == "field-strength"
    ]
    summed: Counter[str] = Counter()
    for code, number in codes:
        summed[code] += number
    return ", ".join(f"`{code}` {number / counts['units']:.1%}" for code, number in summed.most_common(4))


def summary(total: Tally) -> list[str]:
    """Three lines about detected faults and false alarms."""
    lines = []
    for severity, words in ((2, "larger"), (1, "smaller")):
        told = [c for (fault, how), c in total.items() if how == severity and FAULTS[fault].is_detectable]
        if told:
            found, of = sum(c["found"] for c in told), sum(c["units"] for c in told)
            least = min(c["found"] / c["units"] for c in told)
            lines.append(f"recall at the {words} severity: {found / of:.2%} of {of:,}; of the worst fault {least:.2%}")
    good = total.get(("", 0), Counter())
    if good:
        beyond = (good["limited"] + good["refused"] + good["failed"]) / good["units"]
        lines.append(
            f"false alarms: {good['found'] / good['units']:.2%} of {good['units']:,} good units, "
            f"{beyond:.2%} beyond notes; off unseen: {good['off']}"
        )  # fmt: skip
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the pieces and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=500, help="units of each fault and severity")
    parser.add_argument("--good", type=int, default=5000, help="good units")
    parser.add_argument("--faults", default=",".join(FAULTS), help="only these")
    parser.add_argument("--fleet", type=int, help="units of a fleet as it is drawn, instead")
    parser.add_argument("--bad", type=float, default=BAD_SHARE, help="share of bad units in it")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="folder for what is done, to go on from after a stop")
    options = parser.parse_args(arguments)
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
    pieces = (
        by_class(options.each, options.good, options.faults.split(","))
        if options.fleet is None
        else pieces_of(options.fleet, fault=None, bad=options.bad)
    )
    total = run(pieces, options.workers, options.out)
    sys.stdout.write("\n".join([*table(total), "", *summary(total)]) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
