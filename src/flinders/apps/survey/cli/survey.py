"""``flinders survey``: a cave or geological surveyor's instrument, from shots rolled about its laser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import provenance, source_file_of_content
from flinders.cli._program import EXITS, GOOD
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.apps.survey.calibration import SurveyFit


FIT_OPTIONS: Final = (
    "output",
    "pointing",
    "axes",
    "acceleration_axes",
    "distox",
    "mag_cal",
    "target_deg",
    "non_linear",
)
"""Options of a fit, which cannot be used with an earlier calibration."""


class Survey(program.Group):
    """Options: shots, axes of both sensors, outputs."""

    path: str = program.argument("SHOTS")
    output: str | None = option.output("the calibration", "Calibration file to write, or - for standard output.")
    pointing: Any = program.member(
        "--pointing", type=click.Choice(("x", "y", "z")), heading=program.RECORDING,
        help="Axis of the laser [default: y for files of mag-cal, else x].",
    )  # fmt: skip
    axes: str = program.member(
        "--axes", default="x,y,z", show_default=True, metavar="AXES", heading=program.RECORDING,
        help="Axes of the magnetometer along x, y and z of the instrument.",
    )  # fmt: skip
    acceleration_axes: str | None = program.member(
        "--acceleration-axes", metavar="AXES", heading=program.RECORDING,
        help="Axes of the accelerometer along x, y and z of the instrument [default: as --axes].",
    )  # fmt: skip
    calibration: str | None = program.member(
        "--previous", metavar="FILE",
        help="Check SHOTS with this calibration, without a fit: a calibration file, coefficients of a DistoX, or JSON "
        "of mag-cal.",
    )  # fmt: skip
    distox: str | None = program.member(
        "--distox", what="the coefficients", metavar="FILE", heading=program.OUTPUT,
        help="Also write the 52 bytes of coefficients of a DistoX.",
    )  # fmt: skip
    mag_cal: str | None = program.member(
        "--mag-cal", what="the JSON of mag-cal", metavar="FILE", heading=program.OUTPUT,
        help="Also write the JSON of mag-cal and the SAP6.",
    )  # fmt: skip
    non_linear: bool = program.flag(
        "--non-linear", "Also fit quadratic terms of the accelerometer, as TopoDroid's non-linear algorithm.",
        heading=program.METHOD,
    )  # fmt: skip
    target_deg: float = option.target("Worst error of azimuth and inclination that is good enough.", 0.5)
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "survey",
    Survey,
    common=("output", "pointing", "calibration", "target_deg", "as_json"),
    epilog="""\b
Example:
  flinders survey shots.csv -o calibration.json --distox coefficients.bin
  flinders survey sap6.json --axes x,y,-z --acceleration-axes=-y,-x,z --mag-cal calib.json
  flinders survey check.csv --previous calibration.json

\b
Exit codes:
  0  good
  3  limited: written, with its limits
  4  refused: nothing written
""",
)
def command(options: Survey) -> int:
    """Calibrate magnetometer, accelerometer and laser of a survey instrument from its shots.

    SHOTS is a calibration exported by TopoDroid, JSON of mag-cal or a SAP6, or any table with both sensors, one shot a
    line. Take four shots in each of 14 directions, to the sides and corners of a cube, with a quarter turn about the
    laser between shots, away from iron. Take the shots of one direction one after the other.
    """
    from flinders.apps.survey.calibration import fit_survey
    from flinders.apps.survey.pages import of_survey
    from flinders.apps.survey.shots import read_shots
    from flinders.core.calibration_file import dumps

    outputs = options.checked_outputs(options.calibration)
    if options.calibration is not None:
        return _check(options, options.calibration)
    shots = read_shots(
        options.path, axes=options.axes, acceleration_axes=options.acceleration_axes, pointing=options.pointing
    )
    fit = fit_survey(shots, target_deg=options.target_deg, non_linear=options.non_linear)
    if fit.verdict != "refused":
        contents = _instrument_files(fit, options)
        source = source_file_of_content(shots.source, Path(options.path).read_bytes(), len(shots))
        outputs.write(dumps(fit.to_document(provenance(files=[source]))), options.output)
        for path, content in contents.items():
            outputs.write(content, path)
        outputs.say_written("no calibration was written: name a file with -o calibration.json")
    outputs.print(fit.as_dict, lambda: of_survey(fit))
    return EXITS[fit.verdict]


def _check(options: Survey, path: str) -> int:
    """Print a check of shots, read in the axes of an earlier calibration."""
    from flinders.apps.survey.checking import check_survey
    from flinders.apps.survey.pages import of_check

    typed = [name for name in FIT_OPTIONS if program.is_typed(name)]
    if typed:
        names = ", ".join(f"--{name.removesuffix('_deg').replace('_', '-')}" for name in typed)
        raise UsageError(f"with --previous nothing is fitted, and its file states the axes: leave {names} out")
    errors, name = check_survey(options.path, path), Path(path).name
    options.outputs.print(
        lambda: {"rms_deg": errors.rms_deg, "shots": errors.as_dict()}, lambda: of_check(errors, name)
    )
    return GOOD


def _instrument_files(fit: SurveyFit, options: Survey) -> dict[str, str | bytes]:
    """Contents of the files that the options request for an instrument, by path."""
    from flinders.apps.survey.targets import distox_coefficients, mag_cal_json

    made: dict[str, str | bytes] = {}
    if options.distox:
        made[options.distox] = distox_coefficients(fit.calibration)
    if options.mag_cal:
        made[options.mag_cal] = mag_cal_json(
            fit.calibration, dip_deg=fit.dip_deg, noise=fit.noise, gravity_noise=fit.gravity_noise
        )
    return made
