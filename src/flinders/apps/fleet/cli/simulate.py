"""``flinders simulate fleet``: a folder of recordings of many units, with the truth of each."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from flinders.cli import _program as program
from flinders.cli._output import print_json, say
from flinders.cli._program import GOOD
from flinders.errors import OutputError, count_text


class SimulatedFleet(program.Group):
    """Options of a simulated line: number of units, share of faulty ones, output folder."""

    output: str = program.member(
        "-o", "--output", required=True, metavar="FOLDER", help="Where to write the recordings."
    )
    units: int = program.member(
        "--units",
        type=click.IntRange(1, 1_000_000),
        default=100,
        show_default=True,
        metavar="N",
        help="Units of the line.",
    )
    recordings: int = program.member(
        "--recordings", type=click.IntRange(1, 10), default=2, show_default=True, metavar="N",
        help="Number of recordings of each unit, a month apart.",
    )  # fmt: skip
    bad: float = program.member(
        "--bad", type=program.number_within(0, 1, "a share from 0 to 1", zero=True), default=0.1, show_default=True,
        metavar="SHARE", help="Share of units with a fault from their first recording on.",
    )  # fmt: skip
    drifting: float = program.member(
        "--drifting", type=program.number_within(0, 1, "a share from 0 to 1", zero=True), default=0.1,
        show_default=True, metavar="SHARE", help="Share of units whose offset changes between two recordings.",
    )  # fmt: skip
    seed: int = program.member(
        "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Another seed, other numbers."
    )
    as_json: bool = program.flag("--json", "Print the result as JSON on standard output.")


@program.command_of(
    "fleet",
    SimulatedFleet,
    common=("output", "units", "recordings", "bad", "drifting"),
    epilog="""\b
Example:
  flinders simulate fleet -o line --units 200
  flinders fleet line -o calibrations.parquet --bad bad.csv --properties line.units.csv
  flinders drift calibrations.parquet
""",
)
def command(options: SimulatedFleet) -> int:
    """Simulate a line: a folder with a folder of recordings for each unit, some good and some not.

    Next to the folder, FOLDER.truth.csv has the truth of each recording: its fault, the change of the offset, and the
    sensor; FOLDER.units.csv has properties of the units. The same seed gives the same bytes.
    """
    from flinders.apps.fleet.simulate import LineTruth, line_of
    from flinders.apps.fleet.tables import record_table
    from flinders.core.files import make_folder, refuse_existing, write_text
    from flinders.simulate import write_csv

    folder = Path(options.output)
    truth, properties = (folder.with_name(f"{folder.name}.{what}.csv") for what in ("truth", "units"))
    if folder.exists():
        raise OutputError(f"{folder} exists: give another name, or remove it first")
    for path in (folder, truth, properties):
        refuse_existing(path)
    written: list[LineTruth] = []
    made = line_of(
        options.units, seed=options.seed, bad=options.bad, drifting=options.drifting, recordings=options.recordings
    )
    for true, samples in made:
        make_folder(folder / true.unit)
        write_csv(samples, folder / true.unit / true.recording)
        written.append(true)
    with record_table(truth, LineTruth) as each:
        if each is not None:
            each(written)
    units = list(dict.fromkeys(true.unit for true in written))
    write_text("".join(["unit,revision,place\n", *map(_properties, units)]), properties)
    faulty = len({true.unit for true in written if true.fault})
    moved = len({true.unit for true in written if true.offset_change})
    if options.as_json:
        print_json(
            {"folder": str(folder), "units": len(units), "recordings": len(written), "faulty": faulty, "moved": moved}
        )
    say(
        f"simulated: {count_text(len(written), 'recording')} of {count_text(len(units), 'unit')}; {faulty} have a "
        f"fault, {moved} an offset that moves"
    )
    say(f"the recordings are in {folder}, the truth in {truth}, properties of the units in {properties}")
    say(f"next: {shlex.join(['flinders', 'fleet', str(folder), '-o', 'calibrations.parquet'])}")
    return GOOD


def _properties(unit: str) -> str:
    """Line of a unit in the CSV of properties: every third unit is of the newer revision; there are two benches."""
    number = int(unit[1:])
    return f"{unit},{'B' if number % 3 == 0 else 'A'},bench {1 + number % 2}\n"
