"""``flinders two-axis``: the recipe for two axes, of a turn in any plane; plane after plane makes three axes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import load, provenance, refuse_calibration, saying_what_was_read
from flinders.cli._output import progress, say
from flinders.cli._program import LIMITED
from flinders.cli._spelling import in_options
from flinders.errors import FitError, UnitError, UsageError

if TYPE_CHECKING:
    from flinders.core.samples import Recording
    from flinders.estimators.data import CountedRecording
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Turn
    from flinders.summary.summary import Summary

PLANES: Final = ("xy", "yz", "zx")
"""Those of `flinders.geometry.plane`, so that help needs no NumPy; a test holds the two together."""

DRAWING: Final = ".svg"

FLAT: Final = 0.05
"""Variance across over that along, below which readings lie in a plane, and those of a plane on a line."""


class TwoAxis(program.Group):
    """The recording of a turn, how it is fitted, and what is written."""

    recording: str = program.argument("RECORDING")
    plane: Any = program.member(
        "--plane", type=click.Choice(PLANES), default="xy", show_default=True,
        help="The two axes that see the field go round: xy for a turn about z.",
    )  # fmt: skip
    method: str = program.member(
        "--method", type=click.Choice(("two-axis", "ellipse")), default="two-axis", show_default=True,
        help="Mean and scatter of equally spaced points, or least squares, which do not care.",
    )  # fmt: skip
    after: str | None = program.member(
        "--after", metavar="CALIBRATION",
        help="RECORDING was made with this loaded: the result is the two of them, composed.",
    )  # fmt: skip
    reading: option.ReadingOptions = program.group(option.ReadingOptions)
    output: str | None = option.output(
        "the calibration", "Calibration file to write, or - for standard output.", heading=program.OUTPUT
    )
    polar: str | None = program.member(
        "--polar",
        what="the drawing",
        heading=program.OUTPUT,
        metavar="FILE",
        help="Also draw the points before and after, as SVG.",
    )
    force: bool = option.force()
    as_json: bool = option.as_json()
    sensor: str | None = option.sensor(
        "Name or serial number to store; of a log, which magnetometer, by number or name.", "NAME"
    )
    field_strength: float | None = option.field_strength()
    judgement: option.Judgement = program.group(option.Judgement)

    def check(self) -> None:
        """Find what could not be read or written before anything is."""
        if self.polar and self.polar != "-" and Path(self.polar).suffix.lower() != DRAWING:
            raise UsageError(
                f"--polar {self.polar}: need a name that ends in {DRAWING} (a drawing), or - for standard output"
            )
        self.checked_outputs(self.after)
        refuse_calibration(self.recording, "give the recording of a turn, and the calibration to --after")
        if self.after == "-":
            raise UsageError("--after needs a file: standard input is for the recording")

    def dip_after(self, first: Fit) -> float:
        """The dip of what was loaded, which knows the site, the axes and the scale."""
        if self.reading.axes != "x,y,z":
            raise UsageError(f"readings made with {self.after} loaded are in its axes already: leave --axes out")
        if self.field_strength is not None:
            raise UsageError(f"{self.after} has set how long corrected readings are: leave --field-strength out")
        dip, given = first.heading_error_deg.dip_deg, self.judgement.dip_deg
        if math.isnan(dip):
            return given
        if program.is_typed("dip_deg") and abs(abs(dip) - abs(given)) > 1e-6:
            raise UsageError(
                f"--dip says {given:g}°, and {self.after} was made for {dip:g}°: record all planes at one place, "
                "and leave --dip out"
            )
        return given if program.is_typed("dip_deg") else dip


@program.command_of(
    "two-axis",
    TwoAxis,
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
def command(options: TwoAxis) -> int:
    """Find hard and soft iron of two axes from a turn about the third one, which points up or down.

    The mean of points equally spaced in heading is the offset; the eigenvalues and eigenvectors of their scatter are
    the soft iron. Where the points turn out not to be equally spaced it says so, and by how many degrees the mean is
    wrong, and the ellipse of least squares is fitted instead (--method ellipse), unless --method two-axis is typed. The
    result holds for this plane alone: exit code 3, as of everything limited.
    """
    from flinders.apps.classic.composition import composed, refuse_unloaded
    from flinders.core.calibration_file import dumps
    from flinders.estimators.data import CountedRecording
    from flinders.fitting.result import Refused

    options.check()
    first = None if options.after is None else load("two-axis --after", options.after)
    dip_deg = options.judgement.dip_deg if first is None else options.dip_after(first)
    with progress("reading") as watch:
        source = CountedRecording(_opened(options, first, watch))
        with saying_what_was_read([source]):
            turn = _turn(source, options)
        if first is not None:
            refuse_unloaded(first, turn, dip_deg=dip_deg, source=source.source)
        try:
            fit = _fit_or_ellipse(source, turn, first, dip_deg, options)
        except Refused as refusal:
            _draw(turn, refusal.fit, options)
            raise
    both = None if first is None else composed(first, fit)
    if options.output:
        made_from = provenance([source], first.provenance.files if first else ())
        options.outputs.write(dumps((both or fit).to_document(made_from)), options.output)
    _draw(turn, fit, options)
    _show(fit, turn, both, options)
    return LIMITED


def _opened(options: TwoAxis, first: Fit | None, watch: Any) -> Recording:  # noqa: ANN401 - progress
    """Open the recording, in the unit of what was loaded."""
    from flinders.readers import holds_log, open_recording
    from flinders.workflows.recordings import agree, made_from

    reading = options.reading
    chosen = options.sensor if holds_log(options.recording) else None
    source = open_recording(options.recording, flat=options.plane, sensor=chosen, progress=watch, **reading.as_dict())
    if first is None:
        return source
    if reading.unit is None and reading.scale is None:
        agree(first.calibration, source)
    elif source.unit.inside != first.calibration.unit:
        raise UnitError(f"{source.source} is in {source.unit.inside}, {first.name} in {first.calibration.unit}")
    if made_from(first, [source]):
        raise UsageError(
            f"{first.name} was made from {source.source}, which cannot have been recorded with it loaded: record the "
            f"next plane with {first.name} loaded, or correct a raw recording with flinders apply"
        )
    return source


def _turn(source: Recording, options: TwoAxis) -> Turn:
    """Go through the points of the plane, and the ellipse through them; of a long recording through some of them."""
    from flinders.estimators import Readings, within_range
    from flinders.estimators.ellipse import Ellipse
    from flinders.estimators.in_plane import require_turn
    from flinders.estimators.likelihood import ENOUGH
    from flinders.geometry.plane import PlaneEllipse, Turn, order_of

    plane = options.plane
    readings = within_range(Readings.of(source))
    _doubt(readings.summary, plane)
    require_turn(readings, Ellipse.unknowns, options.method, plane)
    ellipsoid = Ellipse(plane, dip_deg=0.0).estimate(readings).ellipsoid
    cells = list(order_of(plane)[:2])
    points = readings.thinned(ENOUGH, Ellipse.name)[:, cells]
    return Turn.of(plane, points, PlaneEllipse(ellipsoid.centre[cells], ellipsoid.shape[cells][:, cells]))


def _doubt(summary: Summary, plane: Any) -> None:  # noqa: ANN401 - one of the planes, as click has checked
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


def _fit_or_ellipse(source: CountedRecording, turn: Turn, first: Fit | None, dip_deg: float, options: TwoAxis) -> Fit:
    """Fit by the mean; by the ellipse of least squares where the mean is off and nobody asked for it.

    Where that is no way out, say how the points are spaced.
    """
    from flinders.apps.classic.pages import spacing_words

    try:
        if program.is_typed("method") or _is_mean_right(source, turn, first, dip_deg, options):
            return _fit(source, first, dip_deg, options)
        fit = _fit(source, first, dip_deg, replace(options, method="ellipse"))
    except FitError:
        if not options.as_json:
            say(spacing_words(turn, options.judgement.target_deg, is_mean=options.method == "two-axis"))
        raise
    say("the mean of these points is not their centre: fitted by least squares, as --method ellipse does")
    return fit


def _is_mean_right(source: CountedRecording, turn: Turn, first: Fit | None, dip_deg: float, options: TwoAxis) -> bool:
    """Whether the mean of the points is their centre, by how they are spaced and by the likelihood."""
    from flinders.fitting.result import Refused

    try:
        found = _fit(source, first, dip_deg, options)
    except Refused:
        return False
    is_off = any(finding.code == "bias" for finding in found.findings)
    return not is_off and turn.spacing.is_even(within_deg=options.judgement.target_deg)


def _fit(source: CountedRecording, first: Fit | None, dip_deg: float, options: TwoAxis) -> Fit:
    """Fit by the method that was asked for."""
    from flinders.apps.classic.two_axis_recipe import TwoAxisRecipe
    from flinders.estimators.ellipse import Ellipse
    from flinders.fitting.calibrate import fit
    from flinders.likelihood.site_field import Site
    from flinders.readers import Instrument

    result = fit(
        source,
        method=(TwoAxisRecipe if options.method == TwoAxisRecipe.name else Ellipse)(plane=options.plane),
        target_deg=options.judgement.target_deg,
        site=Site.stated(
            strength=options.field_strength if first is None else first.calibration.field_strength,
            inclination_deg=None if first is None and not program.is_typed("dip_deg") else dip_deg,
        ),
        sensor=source.recording.name if isinstance(source.recording, Instrument) else options.sensor,
    )
    if first is None:
        return result
    known = first.calibration.field_strength_known
    return result.with_calibration(replace(result.calibration, field_strength_known=known))


def _draw(turn: Turn, fit: Fit, options: TwoAxis) -> None:
    """Draw the turn where that was asked for; of a refused fit too, which is when an uneven turn should be seen."""
    from flinders.apps.classic.turn_drawing import turn_drawing

    if options.polar:
        options.outputs.write(turn_drawing(turn, fit), options.polar)
        if options.polar != "-" and fit.verdict == "refused":
            say(f"written to {options.polar}")


def _show(fit: Fit, turn: Turn, both: Fit | None, options: TwoAxis) -> None:
    """Print the page; on standard error, where a result has standard output."""
    from flinders.apps.classic.pages import of_turn

    outputs = options.outputs
    outputs.print(
        lambda: _as_dict(fit, turn, both),
        lambda: of_turn(fit, turn, in_options, composed=both, after=options.after),
    )
    outputs.say_written()
    if options.output is None:
        say("no calibration was written: name a file with -o calibration.json")


def _as_dict(fit: Fit, turn: Turn, both: Fit | None) -> dict[str, Any]:
    """JSON-ready: a fit, the turn, and what is to be loaded where it is composed."""
    from flinders.apps.classic.composition import as_dict

    even = turn.spacing.is_even(within_deg=fit.claim.target_deg)
    return {
        **fit.as_dict(),
        "turn": {**turn.as_dict(), "is_mean_trusted": even},
        "composed": None if both is None else as_dict(both),
    }
