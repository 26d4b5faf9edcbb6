"""``flinders calibrate``: recordings in, a calibration out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _convergence, _extremes, _filters, _options, _sensors, export
from flinders.cli._program import GOOD, LIMITED
from flinders.cli._sources import Counted, provenance, saying_what_was_skipped
from flinders.cli._talk import print_fit, print_json, progress, say
from flinders.errors import FitError, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.filters import Filter
    from flinders.result import Fit
    from flinders.samples import Recording


def _spread(value: str) -> float | str:
    """Read the value of ``--prior``: a number, or none, which `None` cannot say, as that is "not given"."""
    number = _options.within(0, 100, "a number above 0, up to 100, such as 0.3; or none")
    return "none" if value.strip().casefold() == "none" else number(value)


@click.command(
    "calibrate",
    short_help="Fit recordings of a sensor and write its calibration.",
    epilog="""\b
Example:
  flinders calibrate tumble.csv -o calibration.json
  flinders calibrate monday.csv tuesday.csv --columns mx,my,mz --unit mG -o calibration.json
  flinders calibrate tumble.csv --method minmax --option variant=largest
  flinders calibrate flight.bin --sensor all -o compass-{sensor}.json
""",
)
@click.argument("recordings", nargs=-1, metavar="RECORDING...")
@click.option(
    "-o", "--output", metavar="FILE",
    help="Calibration file to write, or - for standard output; without it nothing is written.",
)  # fmt: skip
@click.option(
    "--report-text", "report", metavar="FILE",
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
@_filters.option
@click.option(
    "--convergence", metavar="FILE",
    help="Also draw (FILE.svg) or list (FILE.csv) how the estimate settles, for methods that can be watched.",
)  # fmt: skip
@click.option(
    "--export", "exported", metavar="TARGET[:FILE]",
    help="Also write it for one of `flinders targets` [FILE: the target's name with its ending].",
)  # fmt: skip
@_options.judgement
@_options.recording
@_options.force
@_options.as_json
def command(
    recordings: tuple[str, ...],
    output: str | None,
    report: str | None,
    force: bool,
    as_json: bool,
    prior: float | str | None,
    robust: bool,
    method_options: tuple[str, ...],
    minmax: str | None,
    by: Filter | None,
    convergence: str | None,
    exported: str | None,
    **options: Any,
) -> int:
    """Fit recordings of one sensor and write its calibration.

    Turn the sensor slowly through all directions, away from iron, while recording. RECORDING is text with
    three columns of field (comma, semicolon, tab or spaces; with or without a header), the output of a
    phone logger or MotionCal, a table, a vehicle's log, or - for standard input: see `flinders info`. Several
    recordings of one sensor are fitted together.
    """
    from flinders.samples import Joined

    if prior is not None:
        options["prior"] = None if prior == "none" else prior
    if robust:
        options["robust"] = True
    target, to = export.named(exported)
    if minmax is not None:
        export.refuse_with(exported, "--minmax")
        return _extremes.calibrate(
            minmax,
            recordings=recordings,
            method_options=method_options,
            output=output,
            force=force,
            as_json=as_json,
            options={**options, "report": report, "filter": by, "convergence": convergence},
        )
    if not recordings:
        raise click.MissingParameter(param_hint="'RECORDING...'", param_type="argument")
    _check(recordings, options)
    _add(options, method_options)
    _convergence.refuse(convergence, options["method"])
    files = {"the calibration": output, "the report": report, "the convergence": convergence, "the export": to}
    reading = {name: options.pop(name) for name in _options.READING}
    if _sensors.is_all(recordings, options["sensor"]):
        beside = {"--report-text": report, "--convergence": convergence, "--export": exported}
        return _sensors.calibrate(
            recordings, output, beside, by=by, reading=reading, options=options, force=force, as_json=as_json
        )
    _check_outputs(recordings, files, force=force, as_json=as_json)
    with progress("reading") as watch:
        opened = _sensors.opened(recordings, options, progress=watch, **reading)
        parts = [Counted(part) for part in (opened.recordings if isinstance(opened, Joined) else (opened,))]
        for part in parts:
            say(str(part.recording))
        try:
            with saying_what_was_skipped(part.recording for part in parts):
                fit = _fitted(parts, by, options)
        except FitError as refusal:
            _report(refusal, report, parts, force=force)
            _convergence.write(convergence, _filters.through(parts, by), options, force=force)
            raise
    _write(fit, output, parts, force=force)
    _convergence.write(convergence, _filters.through(parts, by), options, force=force)
    if target and to:
        export.beside(fit, target, to, files=provenance(parts).files, force=force)
    if as_json:
        print_json(fit.as_dict())
    elif report != "-":
        print_fit(fit, err="-" in {output, to})
    _report(fit, report, parts, force=force)
    if output != "-":
        nothing = "nothing" if to is None and convergence is None else "no calibration file"
        say(f"written to {output}" if output else f"{nothing} was written: name a file with -o calibration.json")
    return GOOD if fit.verdict == "good" else LIMITED


def _fitted(parts: Sequence[Recording], by: Filter | None, options: dict[str, Any]) -> Fit:
    """Fit the recordings together, filtered where that was asked for."""
    from flinders.fitting import fit

    return fit(_filters.through(parts, None), **options) if by is None else _filters.fit_filtered(parts, by, options)


def _check(recordings: tuple[str, ...], options: dict[str, Any]) -> None:
    """Find what cannot work before anything is read: the recording may be long, or still be on its way.

    Raises
    ------
    UsageError
        For options that are not known or contradict each other, or a recording given twice.
    """
    from flinders.estimators import METHODS
    from flinders.units import Unit

    method, prior = options["method"], "prior" in options
    if method not in METHODS:
        raise UsageError(f"method {method!r} is not known: use one of {', '.join(METHODS)}")
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


def _check_outputs(recordings: tuple[str, ...], results: dict[str, str | None], *, force: bool, as_json: bool) -> None:
    """Find what could not be written before anything is read; `results` names where each goes.

    Raises
    ------
    UsageError
        Where two results would go to one place, or over a recording.
    OutputError
        Where a file is in the way, or could not be written.
    """
    from flinders.files import refuse_existing

    printed = ["--json"] * as_json + [name for name, path in results.items() if path == "-"]
    if len(printed) > 1:
        options = {"the calibration": "-o", "the report": "--report-text", "the export": "--export TARGET:FILE"}
        option = next(option for name, option in options.items() if results.get(name) == "-")
        raise UsageError(f"{' and '.join(printed)} would both go to standard output: name a file with {option}")
    files: dict[Path, str] = {}
    for name, path in results.items():
        if not path or path == "-":
            continue
        _options.refuse_to_overwrite(path, recordings)
        refuse_existing(path, force=force)
        if other := files.get(Path(path).resolve()):
            raise UsageError(f"{path} is named for {other} and for {name}: give them two names")
        files[Path(path).resolve()] = name


def _write(fit: Fit, output: str | None, parts: list[Counted], *, force: bool) -> None:
    """Write the calibration where it was asked for."""
    from flinders.document import dumps

    if output == "-":
        click.echo(dumps(fit.to_document(provenance(parts))), nl=False)
    elif output:
        fit.save(output, force=force, provenance=provenance(parts))


def _report(outcome: Fit | FitError, path: str | None, parts: list[Counted], *, force: bool) -> None:
    """Write the page of plain words where it was asked for."""
    from flinders.files import write_text
    from flinders.report.plain import page

    if path is None:
        return
    text = page(outcome, provenance(parts))
    if path == "-":
        click.echo(text, nl=False)
    else:
        write_text(text, path, force=force)
        say(f"report written to {path}")
