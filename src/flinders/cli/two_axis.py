"""``flinders two-axis``: the recipe for two axes, of a turn in any plane; plane after plane makes three axes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _options
from flinders.cli._inputs import (
    Counted,
    agree,
    file_of,
    is_calibration,
    made_from,
    provenance,
    saying_what_was_skipped,
    sha256,
)
from flinders.cli._options import old_option as option
from flinders.cli._output import Outputs, print_json, progress, say
from flinders.cli._program import LIMITED
from flinders.errors import FitError, UnitError, UsageError

if TYPE_CHECKING:
    from flinders.cli._options import ReadingOptions
    from flinders.core.samples import Recording
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Turn
    from flinders.summary.summary import Summary

PLANES: Final = ("xy", "yz", "zx")
"""Those of `flinders.geometry.plane`, so that help needs no NumPy; a test holds the two together."""

DRAWING: Final = ".svg"

FLAT: Final = 0.05
"""Variance across over that along, below which readings lie in a plane, and those of a plane on a line."""


class PlaneFiles(_options.Group):
    """What is written where."""

    output: str | None = _options.member(
        "-o", "--output", heading=_options.OUTPUT, metavar="FILE",
        help="Calibration file to write, or - for standard output.",
    )  # fmt: skip
    polar: str | None = _options.member(
        "--polar", heading=_options.OUTPUT, metavar="FILE", help="Also draw the points before and after, as SVG."
    )
    force: bool = _options.member(
        "--force", heading=_options.OUTPUT, is_flag=True, help="Overwrite the output file if it exists."
    )
    as_json: bool = _options.member(
        "--json", heading=_options.OUTPUT, is_flag=True, help="Print the result as JSON on standard output."
    )

    @property
    def outputs(self) -> Outputs:
        """Both files."""
        return Outputs.of(
            ("the calibration", self.output), ("the drawing", self.polar, "--polar"),
            force=self.force, as_json=self.as_json,
        )  # fmt: skip


@_options.old_command(
    "two-axis",
    short_help="Hard and soft iron of one plane, by the two-axis recipe.",
    common=("output", "plane", "method", "after", "polar"),
    epilog="""\b
Example:
  flinders two-axis turn.csv -o calibration.json --polar rose.svg
  flinders two-axis arc.csv --method ellipse

\b
Three axes, one plane at a time, each loaded before the next is recorded:
  flinders two-axis yz.csv --plane yz -o first.json
  flinders two-axis zx.csv --plane zx --after first.json -o second.json
  flinders two-axis xy.csv --after second.json -o third.json
""",
)
@click.argument("recording", metavar="RECORDING")
@option(
    "--plane", type=click.Choice(PLANES), default="xy", show_default=True,
    help="The two axes that see the field go round: xy for a turn about z.",
)  # fmt: skip
@option(
    "--method", type=click.Choice(("two-axis", "ellipse")), default="two-axis", show_default=True,
    help="Mean and scatter of equally spaced points, or least squares, which do not care.",
)  # fmt: skip
@option(
    "--after", metavar="CALIBRATION",
    help="RECORDING was made with this loaded: the result is the two of them, composed.",
)  # fmt: skip
@_options.old_groups(reading=_options.ReadingOptions, files=PlaneFiles)
@option(
    "--sensor", heading=_options.RECORDING, metavar="NAME",
    help="Name or serial number to store; of a log, which magnetometer, by number or name.",
)  # fmt: skip
@_options.old_field_strength()
@_options.old_judgement
@click.pass_context
def command(
    context: click.Context, /, recording: str, reading: ReadingOptions, files: PlaneFiles, **options: Any
) -> int:
    """Find hard and soft iron of two axes from a turn about the third one, which points up or down.

    The mean of points equally spaced in heading is the offset; the eigenvalues and eigenvectors of their scatter are
    the soft iron. Where the points turn out not to be equally spaced it says so, and by how many degrees the mean is
    wrong: --method ellipse fits the ellipse of least squares instead. The result holds for this plane alone: exit
    code 3, as of everything limited.
    """
    from flinders.comparison.composition import composed, refuse_unloaded
    from flinders.core.calibration_file import SourceFile, dumps
    from flinders.fitting.result import Refused

    after, outputs = options["after"], files.outputs
    _check(recording, after, files)
    first = None if after is None else _loaded(context, after, reading, options)
    with progress("reading") as watch:
        source = Counted(_opened(recording, first, watch, reading, options))
        with saying_what_was_skipped([source]):
            turn = _turn(source, options["plane"], options["method"])
            if first is not None:
                refuse_unloaded(first, turn, dip_deg=options["dip_deg"], source=source.source)
            try:
                fit = _fit(source, turn, first, options, as_json=files.as_json)
            except Refused as refusal:
                _draw(turn, refusal.fit, files)
                raise
    both = None if first is None else composed(first, fit)
    if files.output:
        own = SourceFile(name=source.source, sha256=sha256(source), bytes=file_of(source).size, rows=len(turn.points))
        made_from = provenance(files=[*(first.files if first else ()), own])
        outputs.write(dumps((both or fit).to_document(made_from)), files.output)
    _draw(turn, fit, files)
    _show(fit, turn, both, after, files)
    return LIMITED


def _check(recording: str, after: str | None, files: PlaneFiles) -> None:
    """Find what could not be read or written before anything is.

    Raises
    ------
    UsageError
        Where two results would go to one place, or over what is read; for a calibration in place of a recording, or
        a drawing that is named as something else.
    OutputError
        Where a file is in the way, or could not be written.
    """
    if files.polar and files.polar != "-" and Path(files.polar).suffix.lower() != DRAWING:
        raise UsageError(
            f"--polar {files.polar}: need a name that ends in {DRAWING} (a drawing), or - for standard output"
        )
    files.outputs.check([recording, *([after] if after else [])])
    if is_calibration(recording):
        raise UsageError(f"{recording} is a calibration: give the recording of a turn, and the calibration to --after")


def _loaded(context: click.Context, after: str, reading: ReadingOptions, options: dict[str, Any]) -> Fit:
    """Load the calibration that the turn was recorded with, and let it say what it knows: scale, axes and dip.

    Raises
    ------
    UsageError
        For options that contradict it.
    DocumentError
        For what is no calibration file.
    """
    from flinders.fitting.result import Fit

    if after == "-":
        raise UsageError("--after needs a file: standard input is for the recording")
    first = Fit.load(after)
    if reading.axes != "x,y,z":
        raise UsageError(f"readings made with {after} loaded are in its axes already: leave --axes out")
    if options["field_strength"] is not None:
        raise UsageError(f"{after} has set how long corrected readings are: leave --field-strength out")
    dip = first.heading_error_deg.dip_deg
    is_known = not math.isnan(dip)
    is_given = context.get_parameter_source("dip_deg") is click.core.ParameterSource.COMMANDLINE
    if is_known and is_given and abs(abs(dip) - abs(options["dip_deg"])) > 1e-6:
        raise UsageError(
            f"--dip says {options['dip_deg']:g}°, and {after} was made for {dip:g}°: record all planes at one place, "
            "and leave --dip out"
        )
    if is_known and not is_given:
        options["dip_deg"] = dip
    return first


def _opened(
    recording: str,
    first: Fit | None,
    watch: Any,  # noqa: ANN401 - progress
    reading: ReadingOptions,
    options: dict[str, Any],
) -> Recording:
    """Open the recording, in the unit of what was loaded.

    Raises
    ------
    UnitError
        Where the two are not of one kind.
    UsageError
        Where the calibration was made from this very recording.
    """
    from flinders.readers import Instrument, holds_log, open_recording

    chosen = options["sensor"] if holds_log(recording) else None
    source = open_recording(recording, flat=options["plane"], sensor=chosen, progress=watch, **reading.as_dict())
    if isinstance(source, Instrument):
        options["sensor"] = source.name
    if first is None:
        return source
    if reading.unit is None and reading.scale is None:
        agree(first.calibration, source)
    elif source.unit.inside != first.calibration.unit:
        raise UnitError(f"{source.source} is in {source.unit.inside}, {first.name} in {first.calibration.unit}")
    if made_from(first.name, [source]):
        raise UsageError(
            f"{first.name} was made from {source.source}, which cannot have been recorded with it loaded: record the "
            f"next plane with {first.name} loaded, or correct a raw recording with flinders apply"
        )
    return source


def _turn(source: Recording, plane: Any, method: str) -> Turn:  # noqa: ANN401 - one of the planes, as click has checked
    """Go through the points of the plane, and the ellipse through them; of a long recording through some of them.

    Raises
    ------
    FitError
        Where no ellipse goes through them.
    """
    from flinders.estimators import Readings, within_range
    from flinders.estimators.ellipse import Ellipse
    from flinders.estimators.in_plane import require_turn
    from flinders.estimators.likelihood import ENOUGH
    from flinders.geometry.plane import PlaneEllipse, Turn, order_of

    readings = within_range(Readings.of(source))
    _doubt(readings.summary, plane)
    require_turn(readings, Ellipse.unknowns, method, plane)
    ellipsoid = Ellipse(plane, dip_deg=0.0).estimate(readings).ellipsoid
    cells = list(order_of(plane)[:2])
    points = readings.thinned(ENOUGH, Ellipse.name)[:, cells]
    return Turn.of(plane, points, PlaneEllipse(ellipsoid.centre[cells], ellipsoid.shape[cells][:, cells]))


def _doubt(summary: Summary, plane: Any) -> None:  # noqa: ANN401 - as above
    """Say where the readings lie flat, but in another plane."""
    import numpy as np

    from flinders.geometry.plane import PLANES, across

    if len(summary) < len(PLANES):
        return
    variances, axes = np.linalg.eigh(summary.moments.covariance)
    about = "xyz"[int(np.abs(axes[:, 0]).argmax())]
    goes_round = variances[0] < FLAT * variances[1] and variances[1] > FLAT * variances[2]
    if goes_round and about != across(plane):
        lies = next(other for other in PLANES if across(other) == about)
        say(f"! the readings go round about {about}: this looks like a turn in the plane {lies}, not {plane}")


def _fit(source: Recording, turn: Turn, first: Fit | None, options: dict[str, Any], *, as_json: bool) -> Fit:
    """Fit by the method that was asked for; where that is refused, say how the points are spaced.

    Raises
    ------
    FitError
        As `flinders.fit`.
    """
    from flinders.fitting.calibrate import fit
    from flinders.report.fit_pages import spacing_words

    given = {name: options[name] for name in ("method", "plane", "target_deg", "dip_deg", "sensor")}
    strength = options["field_strength"] if first is None else first.calibration.field_strength
    try:
        result = fit(source, field_strength=strength, **given)
    except FitError:
        if not as_json:
            say(spacing_words(turn, options["target_deg"], is_mean=options["method"] == "two-axis"))
        raise
    if first is None:
        return result
    known = first.calibration.field_strength_known
    return replace(result, calibration=replace(result.calibration, field_strength_known=known))


def _draw(turn: Turn, fit: Fit, files: PlaneFiles) -> None:
    """Draw the turn where that was asked for; of a refused fit too, which is when an uneven turn should be seen."""
    from flinders.report.drawings import turn_drawing

    if files.polar:
        files.outputs.write(turn_drawing(turn, fit), files.polar)
        if files.polar != "-" and fit.verdict == "refused":
            say(f"written to {files.polar}")


def _show(fit: Fit, turn: Turn, both: Fit | None, after: str | None, files: PlaneFiles) -> None:
    """Print the page; on standard error, where a result has standard output."""
    from flinders.report.fit_pages import of_turn

    if files.as_json:
        print_json(_as_dict(fit, turn, both))
    else:
        files.outputs.show(of_turn(fit, turn, composed=both, after=after))
    files.outputs.say_written()
    if files.output is None:
        say("no calibration was written: name a file with -o calibration.json")


def _as_dict(fit: Fit, turn: Turn, both: Fit | None) -> dict[str, Any]:
    """JSON-ready: a fit, the turn, and what is to be loaded where it is composed."""
    from flinders.comparison.composition import as_dict

    even = turn.spacing.is_even(within_deg=fit.target_deg)
    return {
        **fit.as_dict(),
        "turn": {**turn.as_dict(), "mean_is_trusted": even},
        "composed": None if both is None else as_dict(both),
    }
