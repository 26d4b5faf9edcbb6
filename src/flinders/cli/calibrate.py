"""``flinders calibrate``: fit recordings and write a calibration."""

from __future__ import annotations

import shlex
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _program as program
from flinders.cli._calibrate_options import TRACES, Calibrate
from flinders.cli._inputs import (
    columns_in,
    likely_target,
    open_recordings,
    provenance,
    refuse_others,
    report_readings,
    walk_in,
)
from flinders.cli._output import plot_fit, print_fit, print_json, progress, refuse_report, say, show
from flinders.cli._program import GOOD, LIMITED, print_error
from flinders.cli._spelling import in_options
from flinders.core.language import phrase
from flinders.core.units import MICROTESLA
from flinders.errors import FitError, NotTurned, UsageError

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.core.calibration_file import ProvenanceRecord
    from flinders.core.samples import Recording
    from flinders.fitting.result import Fit
    from flinders.workflows.onboard import OnboardCheck


@program.command_of(
    "calibrate",
    Calibrate,
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
def command(options: Calibrate) -> int:
    """Fit recordings of one sensor and write its calibration.

    Turn the sensor slowly through all directions, away from iron, while recording. RECORDING is text with
    three columns of magnetic field (comma, semicolon, tab or spaces; with or without a header), the output of a
    phone logger or MotionCal, a table, a vehicle's log, or - for standard input: see `flinders info`. Several
    recordings of one sensor are fitted together.
    """
    recordings = options.recordings
    refuse_report(options.files.report, "--report")
    if options.estimation.minmax is not None:
        return _calibrate_typed(options)
    if not recordings:
        raise click.MissingParameter(param_hint="'RECORDING...'", param_type="argument")
    if options.sensors.sensor is None:
        refuse_others(recordings)
    asked = options.of_fit()
    if options.sensors.calibrates_all(recordings):
        return _calibrate_each(options, asked)
    outputs = options.files.checked_outputs(*recordings)
    with progress("reading") as watch:
        recording, asked["sensor"] = open_recordings(
            recordings,
            options.sensors.sensor,
            progress=watch,
            auxiliary=columns_in(asked.get("disturbances", ())),
            **options.reading.as_dict(),
        )
        if (site := options.site.told_by(recording)) is not None:
            asked["site"] = options.site_with(site)
        run = _FitRun(recording, options, asked)
        try:
            fit = run.run_fit()
        except NotTurned:
            if options.aiding.previous is None:
                raise
            from flinders.cli._unturned import calibrate_on_bench

            return calibrate_on_bench(run.parts, asked["disturbances"], options.aiding.previous, outputs)
        except FitError as refusal:
            refused: Fit | None = getattr(refusal, "fit", None)
            if refused is None or not options.estimation.even_if_refused:
                raise
            return run.print_refused(refused, refusal)
    if options.estimation.linearize and fit.calibration.linearization is None:
        from flinders.fitting.linearization import unchanged_reason

        say(f"{unchanged_reason(fit)}: --linearize changes nothing")
    run.write(fit)
    return GOOD if fit.verdict == "good" else LIMITED


def _calibrate_typed(options: Calibrate) -> int:
    """Calibrate from six typed numbers instead of a recording."""
    from flinders.cli._unturned import calibrate_typed

    files, estimation, reading = options.files, options.estimation, options.reading
    if files.exported:
        raise UsageError(
            "--export cannot be used with --minmax: write the calibration with -o, then use flinders export"
        )
    if options.recordings:
        raise UsageError(f"--minmax replaces a recording: leave out {options.recordings[0]} or --minmax")
    if estimation.method not in ("auto", "minmax"):
        raise UsageError(f"--minmax needs --method minmax: leave {estimation.method} out")
    of_readings = {
        **files.of_readings,
        "--prior": estimation.prior,
        "--robust": estimation.robust or None,
        "--linearize": estimation.linearize or None,
        "--alignment-sigma": estimation.alignment_sigma_deg,
        "--columns": reading.columns,
        "--filter": options.by,
        "--history": options.history,
    }
    useless = [name for name, value in of_readings.items() if value is not None]
    if useless:
        raise UsageError(f"--minmax gives no readings: leave {', '.join(useless)} out")
    return calibrate_typed(
        str(estimation.minmax), estimation.method_options, reading, files.outputs, options.of_extremes
    )


def _calibrate_each(options: Calibrate, asked: dict[str, Any]) -> int:
    """Calibrate each magnetometer of a log or table separately, or all of them jointly."""
    from flinders.cli._multi_sensor import MultiSensor

    files = options.files
    alone: dict[str, object] = {"--export": files.exported or None, "--linearize": options.estimation.linearize or None}
    alone["--history"] = options.history
    for name, value in {**files.of_readings, **alone}.items():
        if value is not None:
            raise UsageError(f"{name} is for one magnetometer: leave it out with --sensor all, or choose one")
    return MultiSensor(
        path=options.recordings[0],
        output=files.output,
        force=files.force,
        as_json=files.as_json,
        is_joint=options.sensors.joint,
        reference=options.sensors.reference,
        by=options.by,
        told_by=options.site.told_by,
        site_with=options.site_with,
    ).calibrate(options.reading.as_dict(), asked)


def _propose_unit(calibration: Calibration) -> None:
    """Print the unit in which the earth's field has the strength of readings in counts, if there is such a unit."""
    from flinders.workflows.recording_contents import unit_remark

    if words := unit_remark(calibration.field_strength, calibration.unit, in_options):
        say(f"! {words}")


class _FitRun:
    """The fit of one sensor, from its recordings to its output files; `asked` are the arguments of the fit."""

    def __init__(self, recording: Recording, options: Calibrate, asked: dict[str, Any]) -> None:
        from flinders.core.joining import single_recordings
        from flinders.estimators.data import CountedRecording

        self.parts = [CountedRecording(part) for part in single_recordings(recording)]
        self.options, self.files = options, options.files
        self.asked = asked

    @cached_property
    def provenance(self) -> ProvenanceRecord:
        """Provenance of a calibration from these recordings."""
        return provenance(self.parts)

    @property
    def recording(self) -> Recording:
        """All recordings as one; filtered if ``--filter`` was given."""
        from flinders.core.joining import join_recordings
        from flinders.fitting.filtering import filter_recordings

        if self.options.by is None:
            return join_recordings(self.parts)
        return filter_recordings(self.parts, self.options.by)

    def run_fit(self) -> Fit:
        """Fit the recordings; if the fit is refused, write the reports and the convergence so far."""
        from flinders.fitting.filtering import fit_filtered
        from flinders.fitting.result import with_walk

        try:
            with report_readings(self.parts):
                fit = fit_filtered(self.parts, self.options.by, notice=say, **self.asked)
        except FitError as refusal:
            self._write_reports(refusal)
            self._write_convergence()
            self._point_to_check()
            raise
        return with_walk(fit, walk_in(self.options.history, fit))

    def _point_to_check(self) -> None:
        """For a log that gives no calibration, print the command that checks its onboard calibration."""
        from flinders.core.samples import onboard_of

        paths, sensor = self.options.recordings, self.options.sensors.sensor
        if len(paths) == 1 and onboard_of(self.parts[0]) is not None:
            words = ["flinders", "check", *paths, *(["--sensor", sensor] if sensor else [])]
            command = shlex.join(words)
            say(phrase("next.judge", "the onboard calibration is judged by: {command}", command=command))

    def print_refused(self, refused: Fit, refusal: FitError) -> int:
        """Print a refusal, and the numbers of the refused recipe, marked as refused."""
        from flinders.report.fit_pages import page_of_refused_recipe

        if not self.files.as_json:
            show(page_of_refused_recipe(refused))
        more = {"refused_calibration": refused.calibration.as_dict()}
        return print_error(refusal, as_json=self.files.as_json, more=more)

    def write(self, fit: Fit) -> None:
        """Write and print the fit and its reports, and then the exports, which may fail even for a good fit."""
        from flinders.core.calibration_file import dumps
        from flinders.core.samples import onboard_of
        from flinders.fitting.fit_json import json_of
        from flinders.fitting.result import document_of
        from flinders.workflows.onboard import judge_onboard

        files, outputs, onboard = self.files, self.files.outputs, judge_onboard(self.recording, fit)
        if onboard is None and any(onboard_of(part) is not None for part in self.parts):
            say("! the logs were recorded with different onboard calibrations: none of them is judged")
        if files.output:
            outputs.write(dumps(document_of(fit, self.provenance)), files.output)
        self._write_convergence()
        if not files.as_json and files.report_text != "-":
            if files.plots:
                plot_fit(fit, self.recording, err=outputs.is_printed)
            print_fit(fit, err=outputs.is_printed, is_verbose=files.verbose, onboard=onboard)
        self._write_reports(fit, onboard)
        if fit.calibration.unit != MICROTESLA and not fit.calibration.field_strength_known:
            _propose_unit(fit.calibration)
        self._say_written(onboard)
        if files.exports:
            from flinders.cli.export import write_exports

            write_exports(fit, files.exports, outputs, files=self.provenance.files, calibration=files.output)
        if files.as_json:
            print_json({**json_of(fit), **({} if onboard is None else {"onboard": onboard.as_dict()})})

    def _say_written(self, onboard: OnboardCheck | None) -> None:
        """Print where the calibration was written, and the next command."""
        files = self.files
        if not files.output:
            if files.exports or files.convergence:
                say(phrase("next.no-file", "no calibration file was written: name a file with -o calibration.json"))
            else:
                say(phrase("next.nothing", "nothing was written: name a file with -o calibration.json"))
        elif files.output != "-":
            say(phrase("next.written", "written to {file}", file=files.output))
            if not files.exports:
                target = likely_target(self.provenance.files)
                if onboard is not None and onboard.answer == "holds":
                    say(phrase("next.keep", "the onboard calibration is good enough; to change it anyway:"))
                export = shlex.join(["flinders", "export", "--for", target, files.output])
                say(phrase("next.command", "next: {command}", command=export))
                say(phrase("next.targets", "other targets: {command}", command="flinders targets"))

    def _write_convergence(self) -> None:
        """Write the convergence of the estimate, for ``--convergence``."""
        path = self.files.convergence
        if path is None:
            return
        from flinders.fitting.request import Request, estimator_of
        from flinders.report.drawings import Trace, convergence_drawing, convergence_table

        request = Request.of(self.asked["site"], target_deg=self.asked["target_deg"])
        method = estimator_of(self.asked["method"], request)
        trace = Trace.of(self.recording, method, dip_deg=request.dip_deg, target_deg=request.target_deg)
        if trace is None:
            say(f"{path} was not written: {method.name} had no estimate at any step")
            return
        is_drawing = Path(path).suffix.lower() == TRACES[0]
        self.files.outputs.write(convergence_drawing(trace) if is_drawing else convergence_table(trace), path)
        say(f"convergence written to {path}")

    def _write_reports(self, outcome: Fit | FitError, onboard: OnboardCheck | None = None) -> None:
        """Write the page in plain words and the HTML report, if the user asked for them."""
        outputs, text, html = self.files.outputs, self.files.report_text, self.files.report
        if text is not None:
            from flinders.report.plain import page

            outputs.write(page(outcome, self.provenance), text)
            if text != "-":
                say(phrase("next.report", "report written to {file}", file=text))
        if html is not None:
            from flinders.cli.report import report_of

            typed = self.options.typed_words()
            outputs.write(report_of(outcome, self.recording, self.provenance, typed, onboard), html)
            say(phrase("next.report", "report written to {file}", file=html))
