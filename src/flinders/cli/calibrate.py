"""``flinders calibrate``: recordings in, a calibration out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _aids, _convergence, _drivers, _extremes, _filters, _options, _reports, _sensors, export
from flinders.cli._program import GOOD, LIMITED
from flinders.cli._sources import Counted, provenance, saying_what_was_skipped
from flinders.cli._talk import print_fit, print_json, progress, say
from flinders.errors import FitError, NotTurned, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.samples import Recording
    from flinders.fitting.result import Fit
    from flinders.heading.smoothing import Filter


@dataclass(frozen=True, slots=True)
class _Results:
    """Where each result goes: a file, ``-`` for standard output, or nowhere.

    Attributes
    ----------
    calibration, report, words, convergence : str, optional
        The report is HTML, the words are plain text.
    exports : tuple of (str, str)
        Target and file of each.
    force : bool
        Write over what is there.
    as_json : bool
        The fit goes to standard output as JSON.
    plots : bool
        It is drawn above its page, where that is printed on a terminal.
    """

    calibration: str | None
    report: str | None
    words: str | None
    convergence: str | None
    exports: tuple[tuple[str, str], ...]
    force: bool
    as_json: bool
    plots: bool

    @property
    def paths(self) -> list[tuple[str, str | None]]:
        """With what they are called in a message."""
        return [
            ("the calibration", self.calibration),
            ("the HTML report", self.report),
            ("the report", self.words),
            ("the convergence", self.convergence),
            *((f"the export to {target}", path) for target, path in self.exports),
        ]

    @property
    def is_printed(self) -> bool:
        """Whether standard output belongs to one of the files."""
        return "-" in (self.calibration, *(path for _, path in self.exports))


def _spread(value: str) -> float | str:
    """Read the value of ``--prior``: a number, or none, which `None` cannot say, as that is "not given"."""
    number = _options.within(0, 100, "a number above 0, up to 100, such as 0.3; or none")
    return "none" if value.strip().casefold() == "none" else number(value)


def _scale(value: str) -> float:
    """Read the value of ``--gyro-scale``, which may be 0: the scales are held."""
    number = _options.within(0, 0.5, "a share from 0 to 0.5, such as 0.02; 0 where the gyro is calibrated")
    return 0.0 if value.strip() in ("0", "0.0") else number(value)


def _bias(value: str) -> float:
    """Read the value of ``--accelerometer-bias``, which may be 0: the bias is held."""
    number = _options.within(0, 2, "m/s² from 0 to 2, such as 0.05; 0 where the accelerometer is calibrated")
    return 0.0 if value.strip() in ("0", "0.0") else number(value)


@click.command(
    "calibrate",
    short_help="Fit recordings of a sensor and write its calibration.",
    epilog="""\b
Example:
  flinders calibrate tumble.csv -o calibration.json
  flinders calibrate monday.csv tuesday.csv --columns mx,my,mz --unit mG -o calibration.json
  flinders calibrate tumble.csv --method minmax --option variant=largest
  flinders calibrate flight.bin --sensor all -o compass-{sensor}.json
  flinders calibrate flight.bin --sensor all --together -o compass-{sensor}.json
  flinders calibrate flight.bin --with current -o calibration.json
  flinders calibrate bench.csv --with current --previous calibration.json -o flown.json
""",
)
@click.argument("recordings", nargs=-1, metavar="RECORDING...")
@click.option(
    "-o", "--output", metavar="FILE",
    help="Calibration file to write, or - for standard output; without it nothing is written.",
)  # fmt: skip
@click.option(
    "--report", metavar="FILE.html", help="Also write a report with figures, in one HTML file.",
)  # fmt: skip
@click.option(
    "--report-text", "words", metavar="FILE",
    help="Also write a page of plain words for those who will use the compass, or - for standard output.",
)  # fmt: skip
@click.option("--method", default="auto", show_default=True, metavar="NAME", help="One of `flinders methods`.")
@click.option(
    "--option", "method_options", multiple=True, metavar="NAME=VALUE",
    help="An option of the method, as `flinders methods` lists them; may be given several times.",
)  # fmt: skip
@click.option(
    "--minmax", metavar="X0,X1,Y0,Y1,Z0,Z1",
    help="Smallest and largest reading of each axis, typed in place of a recording.",
)  # fmt: skip
@click.option(
    "--field-strength", type=_options.positive, metavar="F",
    help="Strength of the field at the site, in µT (in counts for a recording in counts).",
)  # fmt: skip
@click.option(
    "--prior",
    type=_spread,
    metavar="SPREAD|none",
    help="Soft iron thought likely where nothing was seen [default: 0.3].",
)
@click.option("--robust", is_flag=True, help="Look for stray readings whether or not the residuals ask for it.")
@click.option(
    "--alignment-sigma", "alignment_sigma_deg", type=_options.positive, metavar="DEG",
    help="How well the mounting is known, 1 σ about each axis: its heading error is told on its own.",
)  # fmt: skip
@click.option(
    "--sensor", metavar="NAME|all",
    help="Name or serial number to keep; of a log, which magnetometer, by number or name, or all of them.",
)  # fmt: skip
@click.option(
    "--together", is_flag=True,
    help="With --sensor all: fit the magnetometers of one body together, and say which of them departs.",
)  # fmt: skip
@click.option(
    "--reference", metavar="NAME",
    help="With --together: into whose axes the others are turned, by number or name [default: the first].",
)  # fmt: skip
@click.option(
    "--with", "aiding", multiple=True, metavar="NAME,…",
    help="What else was recorded and shall count: current, throttle, temperature, which the offset then follows "
    "(currents, throttles: of each motor; current2: of one); rate, dip, tilt, attitude, or auto.",
)  # fmt: skip
@click.option(
    "--at", "place", metavar="LAT,LON[,ALT]",
    help="Site of the recording: its dip and strength then count (World Magnetic Model; with --date).",
)  # fmt: skip
@click.option("--date", metavar="DAY", help="Day of the recording, such as 2026-11-21.")
@click.option(
    "--gain-sigma", "gain_sigma", type=_options.within(0, 1, "a share above 0, up to 1, such as 0.01"), metavar="SHARE",
    help="With --at: how well the sensor's mean gain is known, 1 σ [default: 0.05].",
)  # fmt: skip
@click.option(
    "--gyro-scale", "gyro_scale", type=_scale, metavar="SHARE",
    help="With --with rate: what the gyro's scales may be off by, 1 σ; 0 where it is calibrated [default: 0.02].",
)  # fmt: skip
@click.option(
    "--accelerometer-bias", "acceleration_bias", type=_bias, metavar="M/S2",
    help="With --with dip: what the accelerometer may be off by, 1 σ; 0 where it is calibrated [default: 0.3].",
)  # fmt: skip
@click.option(
    "--previous", metavar="CALIBRATION",
    help="With --with and a sensor that was not turned: the calibration that the disturbances found belong to.",
)  # fmt: skip
@_filters.option
@click.option(
    "--convergence", metavar="FILE",
    help="Also draw (FILE.svg) or list (FILE.csv) how the estimate settles, for methods that can be watched.",
)  # fmt: skip
@click.option(
    "--export", "exported", multiple=True, metavar="TARGET[:FILE]",
    help="Also write it for one of `flinders targets` [FILE: the target's name with its ending]; may be given several "
    "times.",
)  # fmt: skip
@click.option("--plot/--no-plot", "plots", default=True, help="Draw the readings, on a terminal.")
@_options.judgement
@_options.recording
@_options.force
@_options.as_json
def command(
    recordings: tuple[str, ...],
    output: str | None,
    report: str | None,
    words: str | None,
    plots: bool,
    force: bool,
    as_json: bool,
    prior: float | str | None,
    robust: bool,
    method_options: tuple[str, ...],
    aiding: tuple[str, ...],
    together: bool,
    reference: str | None,
    place: str | None,
    date: str | None,
    gain_sigma: float | None,
    gyro_scale: float | None,
    acceleration_bias: float | None,
    previous: str | None,
    minmax: str | None,
    by: Filter | None,
    convergence: str | None,
    exported: tuple[str, ...],
    **options: Any,
) -> int:
    """Fit recordings of one sensor and write its calibration.

    Turn the sensor slowly through all directions, away from iron, while recording. RECORDING is text with
    three columns of field (comma, semicolon, tab or spaces; with or without a header), the output of a
    phone logger or MotionCal, a table, a vehicle's log, or - for standard input: see `flinders info`. Several
    recordings of one sensor are fitted together.
    """
    if prior is not None:
        options["prior"] = None if prior == "none" else prior
    if robust:
        options["robust"] = True
    _reports.refuse(report, "--report")
    results = _Results(output, report, words, convergence, export.named(exported), force, as_json, plots)
    if minmax is not None:
        export.refuse_with(exported, "--minmax")
        return _extremes.calibrate(
            minmax,
            recordings=recordings,
            method_options=method_options,
            output=output,
            force=force,
            as_json=as_json,
            options={**options, "report_html": report, "report": words, "filter": by, "convergence": convergence},
        )
    if not recordings:
        raise click.MissingParameter(param_hint="'RECORDING...'", param_type="argument")
    _check(recordings, options)
    _add(options, method_options)
    _convergence.refuse(convergence, options["method"])
    _drivers.add(options, _aids.add(options, aiding, place, date, gain_sigma, gyro_scale, acceleration_bias), previous)
    asked = {**options, "filter": by}
    reading = {name: options.pop(name) for name in _options.READING}
    is_all = _sensors.is_all(recordings, options["sensor"])
    if together and not is_all:
        raise UsageError("--together goes with --sensor all: it takes all magnetometers of a log or table")
    if reference is not None and not together:
        raise UsageError("--reference goes with --together: without it nothing is turned into other axes")
    if is_all:
        beside = {"--report": report, "--report-text": words, "--convergence": convergence}
        beside["--export"] = ", ".join(exported) or None
        return _sensors.calibrate(
            recordings, output, beside, by=by, reading=reading, options=options, force=force, as_json=as_json,
            together=together, reference=reference,
        )  # fmt: skip
    _check_outputs(recordings, results)
    try:
        fit, parts = _fit(recordings, by, reading, options, results, asked)
    except NotTurned:
        if previous is None:
            raise
        opened = _sensors.opened(recordings, options, **reading)
        return _drivers.bench(opened, options["disturbances"], previous, output, force=force, as_json=as_json)
    _write(fit, parts, results)
    _convergence.write(convergence, _filters.through(parts, by), options, force=force)
    _tell(fit, parts, by, results, asked)
    return GOOD if fit.verdict == "good" else LIMITED


def _fit(
    recordings: tuple[str, ...],
    by: Filter | None,
    reading: dict[str, Any],
    options: dict[str, Any],
    results: _Results,
    asked: dict[str, Any],
) -> tuple[Fit, list[Counted]]:
    """Read the recordings and fit them together; of a refusal, write the reports and how far the estimate came.

    Raises
    ------
    FitError
        Where no calibration can be given.
    """
    from flinders.core.samples import singles

    with progress("reading") as watch:
        opened = _sensors.opened(recordings, options, progress=watch, **reading)
        parts = [Counted(part) for part in singles(opened)]
        try:
            with saying_what_was_skipped(parts):
                return _fitted(parts, by, options), parts
        except FitError as refusal:
            _report(refusal, parts, by, results, asked)
            _convergence.write(results.convergence, _filters.through(parts, by), options, force=results.force)
            raise


def _tell(fit: Fit, parts: list[Counted], by: Filter | None, results: _Results, asked: dict[str, Any]) -> None:
    """Print the fit, write its reports, and last what may fail although the fit is good: the file for a target."""
    if not results.as_json and results.words != "-":
        if results.plots:
            _reports.plot(fit, _filters.through(parts, by), err=results.is_printed)
        print_fit(fit, err=results.is_printed)
        for line in _aids.told(fit).splitlines():
            say(line)
    _report(fit, parts, by, results, asked)
    if results.calibration != "-":
        nothing = "nothing" if not results.exports and results.convergence is None else "no calibration file"
        say(
            f"written to {results.calibration}"
            if results.calibration
            else f"{nothing} was written: name a file with -o calibration.json"
        )
    if results.exports:
        files = provenance(parts).files
        export.beside(fit, results.exports, files=files, force=results.force, calibration=results.calibration)
    if results.as_json:
        print_json(fit.as_dict())


def _fitted(parts: Sequence[Recording], by: Filter | None, options: dict[str, Any]) -> Fit:
    """Fit the recordings together, filtered where that was asked for."""
    from flinders.fitting.calibrate import fit

    return fit(_filters.through(parts, None), **options) if by is None else _filters.fit_filtered(parts, by, options)


def _check(recordings: tuple[str, ...], options: dict[str, Any]) -> None:
    """Find what cannot work before anything is read: the recording may be long, or still be on its way.

    Raises
    ------
    UsageError
        For options that are not known or contradict each other, or a recording given twice.
    """
    from flinders.core.units import Unit
    from flinders.estimators import METHODS, method_of

    method, prior = options["method"], "prior" in options
    method_of(method)
    with_prior = [name for name, kind in METHODS.items() if "prior" in getattr(kind, "__dataclass_fields__", {})]
    if prior and method not in with_prior:
        raise UsageError(f"--prior goes with --method {' or '.join(with_prior)}: {method} has none, leave --prior out")
    if "robust" in options and method != "auto":
        raise UsageError(f"--robust goes with --method auto: leave it out, or use --method robust instead of {method}")
    if options["unit"]:
        Unit.of(options["unit"], options["scale"])
    _options.refuse_twice(recordings)


def _add(options: dict[str, Any], words: tuple[str, ...]) -> None:
    """Add the options of the method itself.

    Raises
    ------
    UsageError
        For those that the method has not, values that it cannot take, or what another option says already.
    """
    from flinders.cli._method_options import parsed
    from flinders.estimators import METHODS

    method = METHODS[options["method"]]
    own = parsed(words, method)
    twice = [name for name in own if name in options]
    if twice:
        raise UsageError(f"--{twice[0]} and --option {twice[0]} say the same: give one of them")
    method(**own)
    options.update(own)


def _check_outputs(recordings: tuple[str, ...], results: _Results) -> None:
    """Find what could not be written before anything is read.

    Raises
    ------
    UsageError
        Where two results would go to one place, or over a recording.
    OutputError
        Where a file is in the way, or could not be written.
    """
    from flinders.core.files import refuse_existing

    printed = ["--json"] * results.as_json + [name for name, path in results.paths if path == "-"]
    if len(printed) > 1:
        options = {"the calibration": "-o", "the report": "--report-text"}
        option = options.get(printed[results.as_json], "--export TARGET:FILE")
        raise UsageError(f"{' and '.join(printed)} would both go to standard output: name a file with {option}")
    files: dict[Path, str] = {}
    for name, path in results.paths:
        if not path or path == "-":
            continue
        _options.refuse_to_overwrite(path, recordings)
        refuse_existing(path, force=results.force)
        if other := files.get(Path(path).resolve()):
            raise UsageError(f"{path} is named for {other} and for {name}: give them two names")
        files[Path(path).resolve()] = name


def _write(fit: Fit, parts: list[Counted], results: _Results) -> None:
    """Write the calibration where it was asked for."""
    from flinders.core.calibration_file import dumps

    if results.calibration == "-":
        click.echo(dumps(fit.to_document(provenance(parts))), nl=False)
    elif results.calibration:
        fit.save(results.calibration, force=results.force, provenance=provenance(parts))


def _report(
    outcome: Fit | FitError, parts: list[Counted], by: Filter | None, results: _Results, asked: dict[str, Any]
) -> None:
    """Write the page of plain words, and the one with figures, where they were asked for."""
    from flinders.core.files import write_text
    from flinders.report.plain import page

    if results.words == "-":
        click.echo(page(outcome, provenance(parts)), nl=False)
    elif results.words is not None:
        write_text(page(outcome, provenance(parts)), results.words, force=results.force)
        say(f"report written to {results.words}")
    if results.report is not None:
        recording = _filters.through(parts, by)
        _reports.write(outcome, recording, provenance(parts), results.report, asked=asked, force=results.force)
        say(f"report written to {results.report}")
