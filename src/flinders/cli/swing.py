"""``flinders swing``: the deviation of a compass, from a table or a recording of a swing; and the half-turn test."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _compass, _options
from flinders.cli._calibration import is_calibration
from flinders.cli._program import GOOD, LIMITED, REFUSED
from flinders.cli._site import site_of
from flinders.cli._sources import read_and_left_out
from flinders.cli._talk import drawn, print_json, progress, say
from flinders.errors import FitError, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats
    from flinders.core.geomag import SiteField
    from flinders.heading.compass import Voyage
    from flinders.heading.deviation import Deviation, Expected
    from flinders.heading.stationary import HalfTurn, Rest

OF_A_RECORDING = ("headings", "rest_s", "is_level", "acceleration", "columns")
"""Options that a table has no use for."""


@dataclass(frozen=True, slots=True)
class Swing:
    """What was found of a compass.

    Attributes
    ----------
    deviation : Deviation, optional
        Where headings are known.
    site : SiteField, optional
        Where the declination comes from.
    rests, halves : tuple of Rest, of HalfTurn
        Of a recording.
    expected : Expected, optional
        What its calibration claims, of a recording.
    """

    deviation: Deviation | None
    site: SiteField | None
    rests: tuple[Rest, ...] = ()
    halves: tuple[HalfTurn, ...] = ()
    expected: Expected | None = None


@click.command(
    "swing",
    short_help="Deviation of a compass at known headings, and its card.",
    epilog="""\b
Example:
  flinders swing swing.csv --svg curve.svg -o card.csv
  flinders swing calibration.json log.csv --headings 0,45,90,135,180,225,270,315
  flinders swing calibration.json log.csv

\b
Exit codes:
  0  good, and turns by 180° turn the heading by 180° to within the target
  3  a curve with limits, or with turns by 180° that miss the target
  4  without known headings: a turn by 180° misses the target, or there is none
""",
)
@click.argument("inputs", nargs=-1, required=True, metavar="TABLE | CALIBRATION LOG")
@click.option(
    "-o", "--output", metavar="FILE", help="Also write the card, as comma-separated text; - for standard output.",
)  # fmt: skip
@click.option("--svg", metavar="FILE", help="Also draw the curve, as SVG.")
@click.option(
    "--headings", metavar="DEG,DEG,...",
    help="Known headings of the rests in LOG, in their order: magnetic, or true with --at.",
)  # fmt: skip
@click.option(
    "--sigma", "sigma_deg", type=_options.within(0, 180, "degrees above 0, up to 180"), metavar="DEG",
    help="How well a heading was known and read, 1 σ [default: from the residuals].",
)  # fmt: skip
@click.option(
    "--step", "step_deg", type=_options.within(0, 90, "degrees above 0, up to 90"), default=15.0, show_default=True,
    metavar="DEG", help="Step of the card.",
)  # fmt: skip
@click.option(
    "--rest", "rest_s", type=_options.positive, default=2.0, show_default=True, metavar="S",
    help="Shortest rest in LOG, in seconds; 50 readings where it has no clock.",
)  # fmt: skip
@click.option(
    "--target", "target_deg", type=_options.within(0, 180, "degrees above 0, up to 180"), default=1.0,
    show_default=True, metavar="DEG", help="What a turn by 180° may miss, and 1 σ of the curve may be.",
)  # fmt: skip
@_compass.place
@_compass.sensors
@_options.force
@_options.as_json
@click.pass_context
def command(context: click.Context, /, inputs: tuple[str, ...], as_json: bool, **options: Any) -> int:
    """Find the deviation of a compass: its coefficients A to E with their uncertainty, and the deviation card.

    TABLE has one heading a line, in degrees, under a header: compass and magnetic, compass and true (with --at),
    or compass and deviation; a column sigma is used. Or give a CALIBRATION and a LOG in which the sensor rests on
    one heading after another: --headings names them; without it, the half-turn test alone is made, which needs no
    known heading: where the sensor was turned by 180°, so should its heading have been.
    """
    _check_outputs(inputs, as_json=as_json, **options)
    if len(inputs) == 1:
        for name in OF_A_RECORDING:
            if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
                spelled = {"rest_s": "--rest", "is_level": "--level"}.get(name, f"--{name}")
                raise UsageError(f"{spelled} is for a recording: flinders swing CALIBRATION LOG")
        swing = _of_table(inputs[0], **options)
    elif len(inputs) == 2:
        swing = _of_log(*inputs, **options)
    else:
        raise UsageError(f"{len(inputs)} files were given: need a table, or a calibration and a recording")
    _write(swing.deviation, **options)
    if as_json:
        print_json(_as_dict(swing, options["target_deg"]))
    else:
        _show(swing, options)
    return _code(swing, options["target_deg"])


def _code(swing: Swing, target_deg: float) -> int:
    """How it ends."""
    from flinders.report.swing_page import limits

    missed = any(abs(half.off_deg) > target_deg for half in swing.halves)
    if swing.deviation is None:
        return REFUSED if missed else GOOD
    return LIMITED if missed or limits(swing.deviation, target_deg) else GOOD


def _check_outputs(
    inputs: tuple[str, ...], *, output: str | None, svg: str | None, force: bool, as_json: bool, **_: Any
) -> None:
    """Find what could not be written before anything is read.

    Raises
    ------
    UsageError
        Where two results would go to standard output, into one file, or over what is read.
    OutputError
        Where a file could not be written.
    """
    from flinders.core.files import refuse_existing

    if (output == "-") + (svg == "-") + as_json > 1:
        raise UsageError("two results would go to standard output: give all but one of them a file")
    if output is not None and output == svg and output != "-":
        raise UsageError(f"card and curve would both be written to {output}: give them two names")
    for path in (output, svg):
        if path is not None:
            _options.refuse_to_overwrite(path, inputs)
            if path != "-":
                refuse_existing(path, force=force)


def _of_table(path: str, *, sigma_deg: float | None, place: str | None, date: str | None, **_: Any) -> Swing:
    """Fit a table.

    Raises
    ------
    UsageError
        Where true headings come without a place, or a place without true headings.
    """
    import numpy as np

    from flinders.geometry.angles import folded, wrapped
    from flinders.heading.deviation import fit
    from flinders.readers.swing import read_swing

    if is_calibration(path):
        raise UsageError(f"{path} is a calibration: give the recording of a swing after it")
    if date is not None and place is None:
        raise UsageError("--date is for the declination at a place: give --at LAT,LON too")
    table = read_swing(path)
    columns, site = table.columns, None
    for name in ("compass", "magnetic", "true", "deviation"):
        places = [f"{name} in line {line} of {table.source}" for line in table.lines]
        _refuse_no_heading(columns.get(name, ()), places)
    say(f"{table.source}: {len(table.lines)} headings; columns {', '.join(columns)}")
    if "true" in columns:
        if place is None:
            raise UsageError(f"{path} holds true headings: say where with --at LAT,LON and when with --date")
        site = site_of(place, date)
        columns = {**columns, "magnetic": wrapped(columns["true"] - site.declination_deg)}
    elif place is not None:
        raise UsageError(f"{path} holds no true headings: leave --at out, or call its column 'true'")
    deviation = columns.get("deviation")
    if deviation is None:
        deviation = folded(columns["magnetic"] - columns["compass"])
    compass = columns["compass"] if "compass" in columns else wrapped(columns["magnetic"] - deviation)
    if "sigma" in columns and sigma_deg is not None:
        raise UsageError(f"{path} has a column of sigma: leave --sigma out")
    sigma: Floats | float | None = columns.get("sigma", sigma_deg)
    return Swing(fit(np.asarray(compass), np.asarray(deviation), sigma_deg=sigma), site)


def _of_log(
    calibration: str, recording: str, *, headings: str | None, sigma_deg: float | None, rest_s: float, **options: Any
) -> Swing:
    """Find the rests of a recording, fit their deviations where headings are known, and pair them.

    Raises
    ------
    FitError
        Where there are not as many rests as headings, or neither headings nor half turns.
    """
    import numpy as np

    from flinders.geometry.angles import folded
    from flinders.heading.deviation import fit
    from flinders.heading.stationary import half_turns

    known = None if headings is None else _known(headings)
    if options["place"] is not None and known is None:
        raise UsageError("--at turns known headings from true into magnetic: give --headings too, or leave it out")
    log, found, expected = _rests(calibration, recording, rest_s, options)
    halves = half_turns(found)
    if known is None:
        if not halves:
            raise FitError(
                f"no turn by 180° in {recording}, {_listed(found)}: rest on a heading, turn by 180°, rest again; or "
                "name the known headings with --headings"
            )
        return Swing(None, log.site, found, halves, expected)
    if len(found) != len(known):
        raise FitError(
            f"--headings names {len(known)}, and {recording} holds {_listed(found)}: name one for each, in order, or "
            "change the shortest --rest"
        )
    seen = np.array([rest.heading_deg for rest in found])
    magnetic = np.array(known) - (0.0 if log.site is None else log.site.declination_deg)
    deviation = fit(seen, folded(magnetic - seen), sigma_deg=sigma_deg)
    return Swing(deviation, log.site, found, halves, expected)


def _rests(
    calibration: str, recording: str, rest_s: float, options: dict[str, Any]
) -> tuple[_compass.Log, tuple[Rest, ...], Expected | None]:
    """Go through a recording and find its rests, and what its calibration claims for there."""
    import numpy as np

    from flinders.heading.stationary import LEAST_READINGS, rests

    names = ("is_level", "acceleration", "acceleration_axes", "place", "date", "columns")
    with progress("swinging") as bar:
        log = _compass.open_log(
            "swing", calibration, recording, formula="exact", progress=bar, **{name: options[name] for name in names}
        )
        watched = _compass.Watch(log)
        pairs = [(headings.magnetic_deg, samples.time) for _, samples, headings in watched.headings()]
    rows, left_out = watched.corrector.strength.readings, getattr(log.recording, "skipped", ())
    say(f"{log}; {read_and_left_out(rows, left_out)}")
    if not watched.corrector.is_plausible:
        say("! these readings do not suit the calibration: see flinders check")
    heading = np.concatenate([headings for headings, _ in pairs])
    times = [time for _, time in pairs if time is not None]
    steps = np.diff(np.concatenate(times)) if times else np.empty(0)
    step = float(np.median(steps[np.isfinite(steps)])) if np.isfinite(steps).any() else 0.0
    least = max(round(rest_s / step), 8) if step > 0.0 else LEAST_READINGS
    return log, rests(heading, least_readings=least), _expected(log, watched.voyage)


def _expected(log: _compass.Log, voyage: Voyage) -> Expected | None:
    """Deviation that the calibration's own uncertainty makes, where it states one."""
    from flinders.heading.deviation import Expected
    from flinders.heading.error_propagation import deviation_covariance

    if log.judged.covariance is None:
        return None
    dip, source = _compass.site_dip(log, voyage)
    down = _compass.down(log, voyage)
    covariance = deviation_covariance(log.judged.ellipsoid, log.judged.covariance, dip_deg=dip, down=down)
    return Expected(covariance, dip, source)


def _known(text: str) -> list[float]:
    """Read the known headings.

    Raises
    ------
    UsageError
        For anything but numbers.
    """
    import math

    try:
        known = [float(part) for part in text.split(",")]
    except ValueError:
        known = [math.nan]
    if not all(map(math.isfinite, known)):
        raise UsageError(f"--headings {text!r}: need degrees, such as 0,45,90,135,180,225,270,315")
    _refuse_no_heading(known, [f"number {place} of --headings" for place in range(1, len(known) + 1)])
    return known


def _refuse_no_heading(angles: Iterable[float], places: Iterable[str]) -> None:
    """Refuse what goes round more than once: a slip, such as a digit too many.

    Raises
    ------
    UsageError
        With the first of them, and where it stands.
    """
    for angle, place in zip(angles, places, strict=False):
        if abs(angle) > 360.0:
            raise UsageError(f"{place} is {angle:g}°: need degrees from −360 to 360")


def _listed(found: tuple[Rest, ...]) -> str:
    """Say which rests there are."""
    from flinders.errors import counted
    from flinders.geometry.angles import shown_heading

    shown = ", ".join(shown_heading(rest.heading_deg, 0) for rest in found[:12]) + ", …" * (len(found) > 12)
    return f"{counted(len(found), 'rest')}{f' on {shown}' if found else ''}"


def _write(
    deviation: Deviation | None, *, output: str | None, svg: str | None, force: bool, step_deg: float, **_: Any
) -> None:
    """Write card and curve.

    Raises
    ------
    UsageError
        Where there is no curve to write, or the step does not go round.
    """
    from flinders.core.files import write_text
    from flinders.report.deviation_chart import drawing
    from flinders.report.swing_page import card

    if deviation is None:
        if output or svg:
            raise UsageError("without known headings there is no curve: give --headings, or leave -o and --svg out")
        return
    for path, text in ((output, card(deviation, step_deg)), (svg, drawing(deviation))):
        if path == "-":
            click.echo(text, nl=False)
        elif path is not None:
            write_text(text, path, force=force)


def _show(swing: Swing, options: dict[str, Any]) -> None:
    """Print the page; on standard error, where the card or the curve has standard output."""
    from flinders.report.swing_page import of_swing

    content = of_swing(
        swing.deviation,
        site=swing.site,
        rests=swing.rests,
        halves=swing.halves,
        expected=swing.expected,
        target_deg=options["target_deg"],
        step_deg=options["step_deg"],
    )
    if "-" in {options["output"], options["svg"]}:
        say(drawn(content, sys.stderr))
    else:
        click.echo(drawn(content, sys.stdout))
    for path in (options["output"], options["svg"]):
        if path not in {None, "-"}:
            say(f"written to {path}")


def _as_dict(swing: Swing, target_deg: float) -> dict[str, Any]:
    """JSON-ready."""
    from flinders.heading.stationary import hard_iron
    from flinders.report.swing_page import limits

    deviation, halves = swing.deviation, swing.halves
    return {
        "deviation": None if deviation is None else deviation.as_dict(),
        "limits": [] if deviation is None else list(limits(deviation, target_deg)),
        "calibration": None if swing.expected is None else swing.expected.as_dict(deviation),
        "site": None if swing.site is None else swing.site.as_dict(),
        "rests": [rest.as_dict() for rest in swing.rests],
        "half_turns": [half.as_dict() for half in halves],
        "hard_iron_deg": None if (iron := hard_iron(halves)) is None else {"B": iron[0], "C": iron[1]},
        "half_turns_pass": all(abs(half.off_deg) <= target_deg for half in halves) if halves else None,
        "target_deg": target_deg,
    }
