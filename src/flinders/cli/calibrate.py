"""``flinders calibrate``: recordings in, a calibration out."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from flinders.cli._fit_options import AidingOptions, Estimation, OutputOptions, Sensors, SiteOptions
from flinders.cli._inputs import Counted, joined, opened, provenance, saying_what_was_skipped
from flinders.cli._options import (
    ReadingOptions,
)  # fmt: skip
from flinders.cli._options import old_command as a_command
from flinders.cli._options import (
    old_field_strength as field_strength,
)
from flinders.cli._options import (
    old_groups as groups,
)
from flinders.cli._options import (
    old_judgement as judgement,
)
from flinders.cli._options import (
    old_smoothing as smoothing,
)
from flinders.cli._output import (
    print_fit,
    print_json,
    progress,
    refuse_report,
    refuse_twice,
    say,
)  # fmt: skip
from flinders.cli._program import GOOD, LIMITED
from flinders.errors import FitError, NotTurned

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.samples import Recording
    from flinders.fitting.result import Fit
    from flinders.heading.smoothing import Filter


@a_command(
    "calibrate",
    short_help="Fit recordings of a sensor and write its calibration.",
    common=("output", "columns", "unit", "sensor", "report"),
    epilog="""\b
Example:
  flinders calibrate tumble.csv -o calibration.json
  flinders calibrate monday.csv tuesday.csv --columns mx,my,mz --unit mG -o calibration.json
  flinders calibrate tumble.csv --method minmax --option variant=largest
  flinders calibrate flight.bin --sensor all -o compass-{sensor}.json
  flinders calibrate flight.bin --sensor all --joint -o compass-{sensor}.json
  flinders calibrate flight.bin --with current -o calibration.json
  flinders calibrate bench.csv --with current --previous calibration.json -o flown.json
""",
)
@click.argument("recordings", nargs=-1, metavar="RECORDING...")
@groups(
    reading=ReadingOptions,
    sensors=Sensors,
    site=SiteOptions,
    aiding=AidingOptions,
    estimation=Estimation,
    files=OutputOptions,
)
@field_strength()
@smoothing
@judgement
def command(
    recordings: tuple[str, ...],
    by: Filter | None,
    reading: ReadingOptions,
    sensors: Sensors,
    site: SiteOptions,
    aiding: AidingOptions,
    estimation: Estimation,
    files: OutputOptions,
    **options: Any,
) -> int:
    """Fit recordings of one sensor and write its calibration.

    Turn the sensor slowly through all directions, away from iron, while recording. RECORDING is text with
    three columns of field (comma, semicolon, tab or spaces; with or without a header), the output of a
    phone logger or MotionCal, a table, a vehicle's log, or - for standard input: see `flinders info`. Several
    recordings of one sensor are fitted together.
    """
    refuse_report(files.report, "--report")
    outputs = files.outputs
    if estimation.minmax is not None:
        from flinders.cli._minmax import calibrate

        return calibrate(estimation, files, reading, by, {**options, "sensor": sensors.sensor}, recordings)
    if not recordings:
        raise click.MissingParameter(param_hint="'RECORDING...'", param_type="argument")
    estimation.check()
    _check(recordings, reading)
    options |= {"sensor": sensors.sensor, **estimation.as_options()}
    options |= estimation.own_options({*options, *reading.as_dict()})
    if files.convergence is not None:
        from flinders.cli import _convergence

        _convergence.refuse(files.convergence, estimation.method)
    options |= {**aiding.as_options(), **site.as_options()}
    if sensors.are_all(recordings):
        from flinders.cli import _multi_sensor

        return _multi_sensor.calibrate(recordings[0], sensors, by, files, reading.as_dict(), options, fitted)
    outputs.check(recordings)
    run = _Run(by, options, files, {**options, **reading.as_dict(), "filter": by})
    try:
        with progress("reading") as watch:
            fit = run.fit(recordings, progress=watch, **reading.as_dict())
    except NotTurned:
        if aiding.previous is None:
            raise
        from flinders.cli import _disturbances

        recording = opened(recordings, options, **reading.as_dict())
        return _disturbances.bench(recording, options["disturbances"], aiding.previous, outputs)
    run.write(fit)
    return GOOD if fit.verdict == "good" else LIMITED


def _check(recordings: tuple[str, ...], reading: ReadingOptions) -> None:
    """Find what cannot work before anything is read: the recording may be long, or still be on its way.

    Raises
    ------
    UsageError
        For a unit that is not known, or a recording given twice.
    """
    from flinders.core.units import Unit

    if reading.unit:
        Unit.of(reading.unit, reading.scale)
    refuse_twice(recordings)


@dataclass(slots=True)
class _Run:
    """A fit of one sensor, from its recordings to its files.

    Attributes
    ----------
    by : Filter, optional
        What the readings go through.
    options : dict
        Of `flinders.fit`.
    files : OutputOptions
    asked : dict
        All that was asked for, for the report.
    parts : list of Counted
        The recordings.
    """

    by: Filter | None
    options: dict[str, Any]
    files: OutputOptions
    asked: dict[str, Any]
    parts: Sequence[Counted] = ()

    def fit(self, recordings: tuple[str, ...], **reading: Any) -> Fit:
        """Read the recordings and fit them; of a refusal, write the reports and how far the estimate came.

        Raises
        ------
        FitError
            Where no calibration can be given.
        """
        from flinders.core.samples import singles

        self.parts = [Counted(part) for part in singles(opened(recordings, self.options, **reading))]
        try:
            with saying_what_was_skipped(self.parts):
                return fitted(self.parts, self.by, self.options)
        except FitError as refusal:
            self._report(refusal)
            self._converge()
            raise

    @property
    def recording(self) -> Recording:
        """The recordings as one, filtered where that was asked for."""
        if self.by is None:
            return joined(self.parts)
        from flinders.cli._filters import through

        return through(self.parts, self.by)

    def write(self, fit: Fit) -> None:
        """Write and print the fit and its reports, and last what may fail although it is good: files for targets."""
        from flinders.core.calibration_file import dumps

        files, outputs = self.files, self.files.outputs
        if files.output:
            outputs.write(dumps(fit.to_document(provenance(self.parts))), files.output)
        self._converge()
        if not files.as_json and files.report_text != "-":
            stream = sys.stderr if outputs.is_printed else sys.stdout
            if files.plots and stream.isatty():
                from flinders.cli.report import plot

                plot(fit, self.recording, err=outputs.is_printed)
            print_fit(fit, err=outputs.is_printed)
        self._report(fit)
        if files.output != "-":
            nothing = "nothing" if not files.exports and files.convergence is None else "no calibration file"
            say(
                f"written to {files.output}"
                if files.output
                else f"{nothing} was written: name a file with -o calibration.json"
            )
        if files.exports:
            from flinders.cli.export import write_exports

            made_from = provenance(self.parts).files
            write_exports(fit, files.exports, outputs, files=made_from, calibration=files.output)
        if files.as_json:
            print_json(fit.as_dict())

    def _converge(self) -> None:
        """Write how the estimate converges, where that was asked for."""
        if self.files.convergence is not None:
            from flinders.cli import _convergence

            _convergence.write(self.files.convergence, self.recording, self.options, force=self.files.force)

    def _report(self, outcome: Fit | FitError) -> None:
        """Write the page of plain words, and the one with figures, where they were asked for."""
        text, html = self.files.report_text, self.files.report
        if text is not None:
            from flinders.report.plain import page

            self.files.outputs.write(page(outcome, provenance(self.parts)), text)
            if text != "-":
                say(f"report written to {text}")
        if html is not None:
            from flinders.cli.report import write

            made_from = provenance(self.parts)
            write(outcome, self.recording, made_from, html, asked=self.asked, force=self.files.force)
            say(f"report written to {html}")


def fitted(parts: Sequence[Recording], by: Filter | None, options: dict[str, Any]) -> Fit:
    """Fit recordings together, filtered where that was asked for."""
    if by is not None:
        from flinders.cli._filters import fit_filtered

        return fit_filtered(parts, by, options)
    from flinders.fitting.calibrate import fit

    return fit(joined(parts), **options)
