"""``flinders tolles-lawson``: the field of an aircraft in its scalar magnetometer, found and removed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import open_recordings, refuse_calibrations, report_readings
from flinders.cli._output import say
from flinders.cli._program import EXITS, GOOD
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.apps.survey.aeromagnetic import CompensatedFlight
    from flinders.core.samples import Recording, Samples


class TollesLawson(program.Group):
    """Options: a flight, its scalar magnetometer, outputs."""

    recording: str = program.argument("RECORDING")
    scalar: str | None = program.member(
        "--scalar", heading=program.RECORDING, metavar="COLUMN",
        help="The scalar magnetometer's column, by name or number [default: a reference strength, else the length of "
        "the vector].",
    )  # fmt: skip
    coefficients: str | None = program.member(
        "--coefficients", metavar="FILE", help="Compensate RECORDING by the coefficients of another flight."
    )
    output: str | None = option.output(
        "the result",
        "File for the coefficients, or with --coefficients for the compensated readings; - for standard output.",
    )
    reading: option.ReadingByChip = program.group(option.ReadingByChip)
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "tolles-lawson",
    TollesLawson,
    common=("scalar", "coefficients", "output", "as_json"),
    epilog="""\b
Example:
  flinders tolles-lawson box.csv --scalar mag1_nT -o coefficients.json
  flinders tolles-lawson lines.csv --scalar mag1_nT --coefficients coefficients.json -o compensated.csv

\b
Exit codes:
  0  good
  3  limited: written, with its limits
  4  refused: the manoeuvres do not determine all terms, nothing written
""",
)
def command(options: TollesLawson) -> int:
    """Fit the permanent, induced and eddy-current field of an aircraft to its scalar magnetometer.

    RECORDING is a calibration flight: rolls, pitches and yaws on several headings, with the vector magnetometer in
    the axes of the aircraft, x forward and z down, and the scalar magnetometer. Without --coefficients the sixteen
    coefficients are fitted, with their uncertainty; with --coefficients, RECORDING is compensated. Compensated readings
    are correct up to a constant.
    """
    options.checked_outputs(options.coefficients)
    refuse_calibrations([options.recording])
    samples = _samples(options)
    return _fit(samples, options) if options.coefficients is None else _compensate(samples, options)


def _samples(options: TollesLawson) -> Samples:
    """Readings of both magnetometers, in memory."""
    from flinders.core.joining import read_into_memory
    from flinders.estimators.data import CountedRecording
    from flinders.readers import TextRecording

    recording, _ = open_recordings([options.recording], None, **options.reading.as_dict())
    if options.scalar is not None:
        if not isinstance(recording, TextRecording):
            raise UsageError(f"{recording.source} is not a text file: its columns are known, leave --scalar out")
        recording.name_strength(options.scalar)
    counted = CountedRecording(recording)
    with report_readings([counted]):
        samples = read_into_memory(counted)
    say(
        "scalar magnetometer: "
        + ("none, the length of the vector" if samples.strength is None else _scalar_column(recording))
    )
    return samples


def _scalar_column(recording: Recording) -> str:
    """Name of the scalar magnetometer's column, for a message."""
    from flinders.readers import TextRecording

    column = recording.columns.of_kind("strength") if isinstance(recording, TextRecording) else None
    return "the reference strength of the recording" if column is None else column.names[0]


def _fit(samples: Samples, options: TollesLawson) -> int:
    """Fit coefficients, and write them unless they are refused."""
    from flinders.apps.survey.aeromagnetic import as_dict, dumps, tolles_lawson
    from flinders.apps.survey.pages import of_tolles_lawson

    fit, outputs = tolles_lawson(samples), options.outputs
    if fit.verdict != "refused":
        outputs.write(dumps(fit), options.output)
    outputs.print(lambda: as_dict(fit), lambda: of_tolles_lawson(fit))
    if fit.verdict != "refused":
        outputs.say_written("nothing was written: name a file with -o coefficients.json")
    return EXITS[fit.verdict]


def _compensate(samples: Samples, options: TollesLawson) -> int:
    """Compensate readings, and print the residual."""
    from flinders.apps.survey.aeromagnetic import compensate_flight
    from flinders.apps.survey.pages import of_compensated

    outputs, flight = options.outputs, compensate_flight(samples, options.coefficients or "")
    outputs.write("".join(_lines(flight)), options.output)
    outputs.print(flight.summary.as_dict, lambda: of_compensated(flight.summary))
    outputs.say_written("nothing was written: name a file with -o compensated.csv")
    return GOOD


def _lines(flight: CompensatedFlight) -> Iterator[str]:
    """Yield lines of CSV: time, scalar reading and compensated reading; nan for a missing one."""
    yield "time_s,scalar_nT,compensated_nT\n"
    for row in zip(flight.time_s.tolist(), flight.scalar.tolist(), flight.compensated.tolist(), strict=True):
        yield "{:.4f},{:.3f},{:.3f}\n".format(*row)
