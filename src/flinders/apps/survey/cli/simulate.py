"""``flinders simulate aircraft``: an aircraft with a scalar magnetometer, on a calibration flight."""

from __future__ import annotations

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import print_json
from flinders.cli._program import GOOD
from flinders.cli._simulation import Simulation
from flinders.errors import UsageError


class CalibrationFlight(program.Group):
    """Options: an aircraft, its headings, and the recording."""

    output: str = option.output(
        "the recording", "Where to write the recording [default: standard output].", default="-"
    )
    aircraft: int = program.member(
        "--aircraft", type=click.IntRange(min=0), default=1, show_default=True, metavar="N",
        help="Number of the simulated aircraft with its magnetometers.",
    )  # fmt: skip
    headings: str = program.member(
        "--headings",
        metavar="DEG,…",
        default="0,90,180,270",
        show_default=True,
        help="Headings to fly, one after the other.",
    )
    seed: int = program.same_as(Simulation, "seed")
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "aircraft",
    CalibrationFlight,
    epilog="""\b
Example:
  flinders simulate aircraft -o box.csv
  flinders simulate aircraft -o lines.csv --headings 45,225 --seed 2
""",
)
def command(options: CalibrationFlight) -> int:
    """Simulate rolls of 10°, pitches and yaws of 5° on several headings, in an aircraft with a magnetic field.

    Columns: time, vector magnetometer in the axes of the aircraft, and the scalar magnetometer as a reference strength.
    """
    import numpy as np

    from flinders.apps.survey.simulate_aircraft import Aircraft, calibration_flight, fluxgate
    from flinders.simulate.recording import lines

    outputs = options.checked_outputs()
    headings = program.numbers_of(options.headings)
    if not headings:
        raise UsageError(f"--headings {options.headings!r}: need degrees, such as 0,90,180,270")
    built = np.random.default_rng(options.aircraft)
    flight = calibration_flight(
        options.seed, headings_deg=headings, aircraft=Aircraft.random(built), vector=fluxgate(built)
    )
    outputs.write("".join(f"{line}\n" for line in lines(flight.samples)), options.output)
    outputs.say_written()
    if options.as_json:
        print_json(flight.as_dict())
    return GOOD
