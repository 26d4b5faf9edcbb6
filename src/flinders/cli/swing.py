"""``flinders swing``: the deviation of a compass, from a table or a recording of a swing; and the half-turn test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _compass, _options
from flinders.cli._inputs import is_calibration, read_and_left_out, site_of
from flinders.cli._output import Outputs, print_json, progress, say
from flinders.cli._program import GOOD, LIMITED, REFUSED
from flinders.errors import FitError, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats
    from flinders.cli._options import Place
    from flinders.core.geomag import SiteField
    from flinders.heading.compass import Voyage
    from flinders.heading.deviation import Deviation, Expected
    from flinders.heading.stationary import HalfTurn, Rest

OF_A_RECORDING = ("headings", "stationary_s", "is_level", "acceleration", "columns")
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


class Card(_options.Group):
    """What is written of a curve."""

    output: str | None = _options.member(
        "-o", "--output", heading=_options.OUTPUT, metavar="FILE",
        help="Also write the card, as comma-separated text; - for standard output.",
    )  # fmt: skip
    svg: str | None = _options.member(
        "--svg", heading=_options.OUTPUT, metavar="FILE", help="Also draw the curve, as SVG."
    )
    step_deg: float = _options.member(
        "--step", heading=_options.OUTPUT, type=_options.within(0, 90, "degrees above 0, up to 90"),
        default=15.0, show_default=True, metavar="DEG", help="Step of the card.",
    )  # fmt: skip
    force: bool = _options.member(
        "--force", heading=_options.OUTPUT, is_flag=True, help="Overwrite the output file if it exists."
    )

    def outputs(self, *, as_json: bool) -> Outputs:
        """Both files."""
        return Outputs.of(
            ("the card", self.output), ("the curve", self.svg, "--svg"), force=self.force, as_json=as_json
        )


class KnownHeadings(_options.Group):
    """Known headings, how well they are known, and how they are found in a recording."""

    headings: str | None = _options.member(
        "--headings", heading=_options.RECORDING, metavar="DEG,DEG,...",
        help="Known headings of the stationary intervals in LOG, in their order: magnetic, or true with --at.",
    )  # fmt: skip
    sigma_deg: float | None = _options.member(
        "--sigma", heading=_options.METHOD, type=_options.angle, metavar="DEG",
        help="How well a heading was known and read, 1 σ [default: from the residuals].",
    )  # fmt: skip
    stationary_s: float = _options.member(
        "--stationary", was=("--rest",), heading=_options.RECORDING, type=_options.positive,
        default=2.0, show_default=True, metavar="S",
        help="Shortest stationary interval in LOG, in seconds; 50 readings where it has no clock.",
    )  # fmt: skip


@_options.old_command(
    "swing",
    common=("output", "svg", "headings", "target_deg", "as_json"),
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
@_options.old_groups(card=Card, known=KnownHeadings, place=_options.Place, accelerometer=_options.Accelerometer)
@_options.old_some(_options.ColumnsOptions, "columns", "pattern")
@_options.old_target("What a turn by 180° may miss, and 1 σ of the curve may be.")
@_options.old_as_json
@click.pass_context
def command(
    context: click.Context,
    /,
    inputs: tuple[str, ...],
    card: Card,
    known: KnownHeadings,
    place: Place,
    target_deg: float,
    as_json: bool,
    **options: Any,
) -> int:
    """Find the deviation of a compass: its coefficients A to E with their uncertainty, and the deviation card.

    TABLE has one heading a line, in degrees, under a header: compass and magnetic, compass and true (with --at),
    or compass and deviation; a column sigma is used. Or give a CALIBRATION and a LOG in which the sensor rests on
    one heading after another: --headings names them; without it, the half-turn test alone is made, which needs no
    known heading: where the sensor was turned by 180°, so should its heading have been.
    """
    outputs = card.outputs(as_json=as_json)
    outputs.check(inputs)
    if len(inputs) == 1:
        for name in OF_A_RECORDING:
            if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
                spelled = {"stationary_s": "--stationary", "is_level": "--level"}.get(name, f"--{name}")
                raise UsageError(f"{spelled} is for a recording: flinders swing CALIBRATION LOG")
        swing = _of_table(inputs[0], known.sigma_deg, place)
    elif len(inputs) == 2:
        swing = _of_log(*inputs, known, place, **options)
    else:
        raise UsageError(f"{len(inputs)} files were given: need a table, or a calibration and a recording")
    _write(swing.deviation, card, outputs)
    if as_json:
        print_json(_as_dict(swing, target_deg))
    else:
        _show(swing, card.step_deg, target_deg, outputs)
    return _code(swing, target_deg)


def _code(swing: Swing, target_deg: float) -> int:
    """How it ends."""
    from flinders.report.heading_pages import limits

    missed = any(abs(half.off_deg) > target_deg for half in swing.halves)
    if swing.deviation is None:
        return REFUSED if missed else GOOD
    return LIMITED if missed or limits(swing.deviation, target_deg) else GOOD


def _of_table(path: str, sigma_deg: float | None, place: Place) -> Swing:
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
    place.check()
    table = read_swing(path)
    columns, site = table.columns, None
    for name in ("compass", "magnetic", "true", "deviation"):
        places = [f"{name} in line {line} of {table.source}" for line in table.lines]
        _refuse_no_heading(columns.get(name, ()), places)
    say(f"{table.source}: {len(table.lines)} headings; columns {', '.join(columns)}")
    if "true" in columns:
        if place.place is None:
            raise UsageError(f"{path} holds true headings: say where with --at LAT,LON and when with --date")
        site = site_of(place.place, place.date)
        columns = {**columns, "magnetic": wrapped(columns["true"] - site.declination_deg)}
    elif place.place is not None:
        raise UsageError(f"{path} holds no true headings: leave --at out, or call its column 'true'")
    deviation = columns.get("deviation")
    if deviation is None:
        deviation = folded(columns["magnetic"] - columns["compass"])
    compass = columns["compass"] if "compass" in columns else wrapped(columns["magnetic"] - deviation)
    if "sigma" in columns and sigma_deg is not None:
        raise UsageError(f"{path} has a column of sigma: leave --sigma out")
    sigma: Floats | float | None = columns.get("sigma", sigma_deg)
    return Swing(fit(np.asarray(compass), np.asarray(deviation), sigma_deg=sigma), site)


def _of_log(calibration: str, recording: str, asked: KnownHeadings, place: Place, **options: Any) -> Swing:
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

    known = None if asked.headings is None else _known(asked.headings)
    if place.place is not None and known is None:
        raise UsageError("--at turns known headings from true into magnetic: give --headings too, or leave it out")
    log, rests, expected = _rests(calibration, recording, asked.stationary_s, place=place, **options)
    halves = half_turns(rests)
    if known is None:
        if not halves:
            raise FitError(
                f"no turn by 180° in {recording}, {_listed(rests)}: rest on a heading, turn by 180°, rest again; or "
                "name the known headings with --headings"
            )
        return Swing(None, log.site, rests, halves, expected)
    if len(rests) != len(known):
        raise FitError(
            f"--headings names {len(known)}, and {recording} holds {_listed(rests)}: name one for each, in order, or "
            "change the shortest --stationary"
        )
    seen = np.array([rest.heading_deg for rest in rests])
    magnetic = np.array(known) - (0.0 if log.site is None else log.site.declination_deg)
    deviation = fit(seen, folded(magnetic - seen), sigma_deg=asked.sigma_deg)
    return Swing(deviation, log.site, rests, halves, expected)


def _rests(
    calibration: str, recording: str, stationary_s: float, **options: Any
) -> tuple[_compass.HeadingLog, tuple[Rest, ...], Expected | None]:
    """Go through a recording and find its rests, and what its calibration claims for there."""
    import numpy as np

    from flinders.heading.stationary import LEAST_READINGS, rests

    with progress("swinging") as bar:
        log = _compass.open_log("swing", calibration, recording, progress=bar, **options)
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
    least = max(round(stationary_s / step), 8) if step > 0.0 else LEAST_READINGS
    return log, rests(heading, least_readings=least), _expected(log, watched.voyage)


def _expected(log: _compass.HeadingLog, voyage: Voyage) -> Expected | None:
    """Deviation that the calibration's own uncertainty makes, where it states one."""
    from flinders.heading.deviation import Expected
    from flinders.heading.error_propagation import deviation_covariance

    if not log.fit.states_uncertainty:
        return None
    dip, source = _compass.site_dip(log, voyage)
    down = _compass.down(log, voyage)
    covariance = deviation_covariance(log.fit.ellipsoid, log.fit.covariance, dip_deg=dip, down=down)
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


def _listed(rests: tuple[Rest, ...]) -> str:
    """Say which rests there are."""
    from flinders.errors import counted
    from flinders.geometry.angles import shown_heading

    shown = ", ".join(shown_heading(rest.heading_deg, 0) for rest in rests[:12]) + ", …" * (len(rests) > 12)
    return f"{counted(len(rests), 'rest')}{f' on {shown}' if rests else ''}"


def _write(deviation: Deviation | None, card: Card, outputs: Outputs) -> None:
    """Write card and curve.

    Raises
    ------
    UsageError
        Where there is no curve to write, or the step does not go round.
    """
    from flinders.report.drawings import swing_drawing
    from flinders.report.heading_pages import card as written

    if deviation is not None:
        outputs.write(written(deviation, card.step_deg), card.output)
        outputs.write(swing_drawing(deviation), card.svg)
    elif card.output or card.svg:
        raise UsageError("without known headings there is no curve: give --headings, or leave -o and --svg out")


def _show(swing: Swing, step_deg: float, target_deg: float, outputs: Outputs) -> None:
    """Print the page; on standard error, where the card or the curve has standard output."""
    from flinders.report.heading_pages import of_swing

    outputs.show(
        of_swing(
            swing.deviation,
            site=swing.site,
            rests=swing.rests,
            halves=swing.halves,
            expected=swing.expected,
            target_deg=target_deg,
            step_deg=step_deg,
        )
    )
    outputs.say_written()


def _as_dict(swing: Swing, target_deg: float) -> dict[str, Any]:
    """JSON-ready."""
    from flinders.heading.stationary import hard_iron
    from flinders.report.heading_pages import limits

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
