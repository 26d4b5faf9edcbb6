"""``flinders demo``: simulate a sensor and calibrate it, to try the program without a sensor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import print_fit, print_json, say
from flinders.cli._program import EXITS
from flinders.core.language import TERMINAL_LANGUAGE, numeral, phrase

if TYPE_CHECKING:
    from flinders.simulate import Simulated


class Demo(program.Group):
    """A simulated sensor, and the file of its recording."""

    seed: int = program.member(
        "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Seed of the random numbers."
    )
    path: str | None = program.member(
        "--csv", metavar="FILE", help="Also write the simulated recording, to try the other commands on."
    )
    judgement: option.Judgement = program.group(option.Judgement)
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "demo",
    Demo,
    common=("seed", "path", "target_deg", "dip_deg", "as_json", "force"),
    epilog="""\b
Example:
  flinders demo
  flinders demo --seed 7 --csv tumble.csv && flinders calibrate tumble.csv -o calibration.json
""",
)
def command(options: Demo) -> int:
    """Simulate a sensor that is tumbled by hand for a minute, calibrate it, and compare with the truth."""
    from flinders.fitting.calibrate import fit
    from flinders.fitting.fit_json import json_of
    from flinders.likelihood.site_field import Site
    from flinders.simulate import angle_error_deg, tumble

    simulated = tumble(seed=options.seed, dip_deg=options.judgement.dip_deg)
    if options.path:
        _write(options.path, simulated, force=options.force)
    readings = TERMINAL_LANGUAGE.get().count(len(simulated.samples), "reading")
    say(
        phrase(
            "demo.simulated", "simulated: {readings} in a minute of tumbling, hard and soft iron, 0.5 µT of noise",
            readings=readings,
        )
    )  # fmt: skip
    judgement = options.judgement
    site = Site(inclination_deg=judgement.dip_deg)
    result = fit(simulated.samples, target_deg=judgement.target_deg, site=site)
    error = angle_error_deg(result.calibration.matrix, result.calibration.offset, simulated)
    if options.as_json:
        print_json({**json_of(result), "true_direction_error_deg": error})
    else:
        print_fit(result)
        shown = f"{numeral(f'{error:.2g}')}°"
        words = phrase(
            "demo.truth", "The truth is known here: over all directions the corrected field is off by {error} rms.",
            error=shown,
        )  # fmt: skip
        say(f"\n{words}")
    return EXITS[result.verdict]


def _write(path: str, simulated: Simulated, *, force: bool) -> None:
    """Write the recording as a logger would, and the truth to a second file."""
    from flinders.core.files import refuse_existing
    from flinders.simulate import truth, write_csv

    truth_file = truth.truth_path(path)
    refuse_existing(truth_file, force=force)
    write_csv(simulated.samples, path, force=force)
    truth.write(truth.Truth.of(simulated), truth_file, force=force)
    say(f"the recording is in {path}, the truth in {truth_file}")
