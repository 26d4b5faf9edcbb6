"""``flinders simulate boat``: the compass of a boat over some days."""

from __future__ import annotations

from flinders.cli import _program as program
from flinders.cli._output import print_json
from flinders.cli._program import GOOD
from flinders.cli._simulation import Simulation, size_option


class Boat(Simulation):
    """Duration and output of the simulation."""

    days: float = program.member(
        "--days", type=program.positive, default=7.0, show_default=True, metavar="N", help="Days, from midnight on."
    )
    noise: float = size_option("--noise", "White noise in µT, 1 σ per axis.", default=0.3, show_default=True)


@program.command_of(
    "boat",
    Boat,
    common=("output", "days", "noise", "seed"),
    epilog="""\b
Example:
  flinders simulate boat --days 7 -o week.csv
  flinders watch --replay week.csv --state boat.state --page week.html
""",
)
def command(options: Boat) -> int:
    """Simulate the compass of a small yacht for some days, with disturbances.

    Each day the yacht lies at a berth, is at sea in the morning and in the afternoon, and is off for the night. It
    begins with two circles. At sea it turns now and then, rolls and heels; steel passes by, and once, after four
    sevenths of the time at sea, the offset moves by 5 µT. Columns: time, in seconds from 1970, and magnetic field,
    twice a second at sea. The true calibration is that of the end; --json also lists the events with their times.
    """
    from flinders.apps.service.simulate_boat import boat

    options.check(as_json=options.as_json)
    life = boat(
        options.seed,
        days=options.days,
        field_strength=options.field_strength,
        dip_deg=options.dip_deg,
        noise=options.noise,
    )
    options.write(life.simulated)
    if options.as_json:
        print_json({"recording_file": options.output, "truth_file": options.truth_path, **life.as_dict()})
    return GOOD
