"""``flinders calibrate --minmax``: six typed numbers in place of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flinders.cli._inputs import provenance
from flinders.cli._output import print_json
from flinders.cli._program import LIMITED
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.cli._fit_options import Estimation, OutputOptions
    from flinders.cli._options import ReadingOptions
    from flinders.heading.smoothing import Filter


def calibrate(
    estimation: Estimation,
    files: OutputOptions,
    reading: ReadingOptions,
    by: Filter | None,
    options: dict[str, Any],
    recordings: tuple[str, ...],
) -> int:
    """Calibrate from six numbers, write it and say what is known of it.

    Raises
    ------
    UsageError
        For anything but six numbers, a recording beside them, or options that need readings.
    OutputError
        Where the file is in the way, or cannot be written.
    """
    from flinders.cli.methods import parsed
    from flinders.core.axes import Axes
    from flinders.core.calibration_file import dumps
    from flinders.core.units import Unit
    from flinders.estimators import METHODS
    from flinders.estimators.reference.minmax import MinMax
    from flinders.fitting.axis_extremes import from_extremes
    from flinders.report.fit_pages import of_extremes

    _refuse(estimation, files, reading, by, recordings)
    own = parsed(estimation.method_options, METHODS[MinMax.name])
    if own.pop("trim", False):
        raise UsageError("--option trim=yes needs readings, and --minmax has none: leave it out")
    outputs = files.outputs
    outputs.check()
    unit = Unit.of(reading.unit or "counts", reading.scale)
    extremes = from_extremes(_numbers(str(estimation.minmax)), unit=unit, axes=Axes.of(reading.axes), **options, **own)
    outputs.write(dumps(extremes.to_document(provenance())), files.output)
    if files.as_json:
        print_json(extremes.as_dict())
    else:
        outputs.show(of_extremes(extremes))
    outputs.say_written("nothing was written: name a file with -o calibration.json")
    return LIMITED


def _refuse(
    estimation: Estimation,
    files: OutputOptions,
    reading: ReadingOptions,
    by: Filter | None,
    recordings: tuple[str, ...],
) -> None:
    """Refuse what means nothing without readings.

    Raises
    ------
    UsageError
    """
    if files.exported:
        raise UsageError("--export does not go with --minmax: write the calibration with -o, then use flinders export")
    if recordings:
        raise UsageError(f"--minmax takes the place of a recording: leave {recordings[0]} out, or --minmax")
    if estimation.method not in ("auto", "minmax"):
        raise UsageError(f"--minmax goes with --method minmax: leave {estimation.method} out")
    of_readings = {
        "--report": files.report,
        "--report-text": files.report_text,
        "--prior": estimation.prior,
        "--robust": estimation.robust or None,
        "--alignment-sigma": estimation.alignment_sigma_deg,
        "--columns": reading.columns,
        "--filter": by,
        "--convergence": files.convergence,
    }
    useless = [option for option, value in of_readings.items() if value is not None]
    if useless:
        raise UsageError(f"{', '.join(useless)} needs readings, and --minmax has none: leave it out")


def _numbers(text: str) -> list[float]:
    """Read numbers between commas.

    Raises
    ------
    UsageError
        For what is no number.
    """
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(f"--minmax {text!r}: need six numbers, such as -157,98,-123,124,-109,101") from None
