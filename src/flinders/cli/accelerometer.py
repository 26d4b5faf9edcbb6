"""``flinders accelerometer``: calibrate an accelerometer from still poses."""

from __future__ import annotations

import shlex

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import provenance, report_readings
from flinders.cli._output import say


class Accelerometer(program.Group):
    """A recording of still poses, and the output file."""

    recording: str = program.argument("POSES")
    columns: str | None = program.member(
        "--columns", metavar="X,Y,Z", help="The accelerometer's columns: three names, or numbers counted from 1."
    )
    gravity: float | None = program.member(
        "--gravity", metavar="MPS2", type=float,
        help=(
            "Gravity at the place, in m/s² [default: 9.80665]. An error of this value changes all gains equally, "
            "and no tilt."
        ),
    )  # fmt: skip
    output: str | None = option.output("the calibration", "File to write.")
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "accelerometer",
    Accelerometer,
    common=("output", "columns", "gravity", "force", "as_json"),
    epilog="""\b
Example:
  flinders accelerometer poses.csv -o accelerometer.json
  flinders export --for arduino accelerometer.json

\b
Exit codes:
  4  refused: the poses leave an offset or a gain undetermined; the message
       names the side to turn up next
""",
)
def command(options: Accelerometer) -> None:
    """Calibrate an accelerometer from still poses: offsets, gains, misalignment, and the error of the vertical.

    Put the device on each of its six sides for two seconds while recording. Movement between the poses does no harm.
    Six more poses, on edges, determine the angles between the axes. If a gyro is recorded too, its offset is estimated.
    POSES is any recording that `flinders calibrate` takes; it needs no magnetometer.
    """
    from flinders.core.inertial_record import dumps
    from flinders.estimators.data import CountedRecording
    from flinders.report.accelerometer_page import of_accelerometer
    from flinders.workflows.accelerometer import calibrate_accelerometer, open_acceleration, read_accelerations

    outputs = options.checked_outputs()
    recording, is_field = open_acceleration(options.recording, options.columns)
    part = CountedRecording(recording)
    with report_readings([part], is_field=False):
        samples = read_accelerations(part, is_field=is_field)
        fit = calibrate_accelerometer(samples, gravity=options.gravity)
    if options.output:
        outputs.write(dumps(fit.document(provenance([part]))), options.output)
    outputs.print(fit.as_dict, lambda: of_accelerometer(fit))
    outputs.say_written("nothing was written: name a file with -o accelerometer.json")
    if options.output and options.output != "-":
        say(f"next: {shlex.join(['flinders', 'export', '--for', 'arduino', options.output])}")
