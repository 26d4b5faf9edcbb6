"""``flinders swing``: the deviation of a compass, from a table or a recording of a swing; and the half-turn test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flinders.cli import _options as option
from flinders.cli._inputs import is_calibration, is_recording, site_of
from flinders.cli._output import print_json, progress, say
from flinders.cli._program import GOOD, LIMITED, REFUSED
from flinders.cli._stream import HeadingLog, open_log
from flinders.errors import FitError, UsageError, counted

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats
    from flinders.core.geomag import SiteField
    from flinders.heading.deviation import Deviation, Expected
    from flinders.heading.stationary import HalfTurn, Rest


class KnownHeadings(option.Group):
    """Known headings, how well they are known, and how they are found in a recording."""

    headings: str | None = option.member(
        "--headings", heading=option.RECORDING, metavar="DEG,DEG,...",
        help="Known headings of the stationary intervals in LOG, in their order: magnetic, or true with --at.",
    )  # fmt: skip
    sigma_deg: float | None = option.member(
        "--sigma", heading=option.METHOD, type=option.angle, metavar="DEG",
        help="How well a heading was known and read, 1 σ [default: from the residuals].",
    )  # fmt: skip
    stationary_s: float = option.member(
        "--stationary", heading=option.RECORDING, type=option.positive, default=2.0, show_default=True, metavar="S",
        help="Shortest stationary interval in LOG, in seconds; 50 readings where it has no clock.",
    )  # fmt: skip


class SwingOptions(option.Group):
    """A table, or a calibration and a recording; and what is written of the curve."""

    inputs: tuple[str, ...] = option.argument("TABLE | [CALIBRATION] LOG", nargs=-1)
    output: str | None = option.output(
        "the card", "Also write the card, as comma-separated text; - for standard output.", heading=option.OUTPUT
    )
    svg: str | None = option.member(
        "--svg", what="the curve", heading=option.OUTPUT, metavar="FILE", help="Also draw the curve, as SVG."
    )
    step_deg: float = option.member(
        "--step", heading=option.OUTPUT, type=option.within(0, 90, "degrees above 0, up to 90"),
        default=15.0, show_default=True, metavar="DEG", help="Step of the card.",
    )  # fmt: skip
    force: bool = option.force()
    known: KnownHeadings = option.group(KnownHeadings)
    place: option.Place = option.group(option.Place)
    accelerometer: option.Accelerometer = option.group(option.Accelerometer)
    reading: option.ColumnsOptions = option.group(option.ColumnsOptions)
    target_deg: float = option.target("What a turn by 180° may miss, and 1 σ of the curve may be.")
    as_json: bool = option.as_json()

    def refuse_of_recording(self) -> None:
        """Refuse options that a table has no use for."""
        of_recording = {
            "--headings": self.known.headings, "--stationary": option.is_typed("stationary_s"),
            "--level": self.accelerometer.is_level, "--acceleration": self.accelerometer.acceleration,
            "--columns": self.reading.columns,
        }  # fmt: skip
        for name, value in of_recording.items():
            if value not in (None, False):
                raise UsageError(f"{name} is for a recording: flinders swing CALIBRATION LOG")


@dataclass(frozen=True, slots=True)
class Swing:
    """What was found of a compass; of a recording also its rests, and what its calibration claims."""

    deviation: Deviation | None  # where headings are known
    site: SiteField | None  # where the declination comes from
    rests: tuple[Rest, ...] = ()
    halves: tuple[HalfTurn, ...] = ()
    expected: Expected | None = None

    def as_dict(self, target_deg: float) -> dict[str, Any]:
        """JSON-ready."""
        from flinders.heading.stationary import hard_iron
        from flinders.report.heading_pages import limits

        deviation, halves = self.deviation, self.halves
        return {
            "deviation": None if deviation is None else deviation.as_dict(),
            "limits": [] if deviation is None else list(limits(deviation, target_deg)),
            "calibration": None if self.expected is None else self.expected.as_dict(deviation),
            "site": None if self.site is None else self.site.as_dict(),
            "rests": [rest.as_dict() for rest in self.rests],
            "half_turns": [half.as_dict() for half in halves],
            "hard_iron_deg": None if (iron := hard_iron(halves)) is None else {"B": iron[0], "C": iron[1]},
            "half_turns_pass": all(abs(half.off_deg) <= target_deg for half in halves) if halves else None,
            "target_deg": target_deg,
        }

    def exit_code(self, target_deg: float) -> int:
        """How the command ends."""
        from flinders.report.heading_pages import limits

        missed = bool(self.rests) and any(abs(half.off_deg) > target_deg for half in self.halves)
        if self.deviation is None:
            return REFUSED if missed else GOOD
        return LIMITED if missed or limits(self.deviation, target_deg) else GOOD


@option.command_of(
    "swing",
    SwingOptions,
    common=("output", "svg", "headings", "target_deg", "as_json"),
    short_help="Deviation of a compass at known headings, and its card.",
    epilog="""\b
Example:
  flinders swing swing.csv --svg curve.svg -o card.csv
  flinders swing calibration.json log.csv --headings 0,45,90,135,180,225,270,315
  flinders swing calibration.json log.csv
  flinders swing corrected.csv

\b
Exit codes:
  0  good, and turns by 180° turn the heading by 180° to within the target
  3  a curve with limits, or with turns by 180° that miss the target
  4  without known headings: a turn by 180° misses the target, or there is none
""",
)
def command(options: SwingOptions) -> int:
    """Find the deviation of a compass: its coefficients A to E with their uncertainty, and the deviation card.

    TABLE has one heading a line, in degrees, under a header: compass and magnetic, compass and true (with --at),
    or compass and deviation; a column sigma is used. Or give a LOG in which the sensor rests on one heading after
    another, with the CALIBRATION that corrects it, or alone where it is to be taken as it is: --headings names them;
    without it, the half-turn test alone is made, which needs no known heading: where the sensor was turned by 180°, so
    should its heading have been.
    """
    inputs, target_deg = options.inputs, options.target_deg
    options.checked_outputs()
    if len(inputs) == 1 and _is_raw(inputs[0]):
        swing = _of_log(None, inputs[0], options)
    elif len(inputs) == 1:
        options.refuse_of_recording()
        swing = _of_table(inputs[0], options.known.sigma_deg, options.place)
    elif len(inputs) == 2:
        swing = _of_log(*inputs, options)
    else:
        raise UsageError(f"{len(inputs)} files were given: need a table, or a calibration and a recording")
    _write(swing.deviation, options)
    if options.as_json:
        print_json(swing.as_dict(target_deg))
    else:
        _show(swing, options)
    return swing.exit_code(target_deg)


def _is_raw(path: str) -> bool:
    """Whether a file is no table of headings but a recording, whose compass is taken as it is."""
    from flinders.errors import InputError
    from flinders.readers.swing import read_swing

    try:
        if path != "-":  # standard input can be read once
            read_swing(path)
    except InputError:
        return not is_calibration(path) and is_recording(path)
    return False


def _of_table(path: str, sigma_deg: float | None, place: option.Place) -> Swing:
    """Fit a table."""
    from flinders.geometry.angles import folded, wrapped
    from flinders.heading.deviation import fit
    from flinders.readers.swing import read_swing

    if is_calibration(path):
        raise UsageError(f"{path} is a calibration: give the recording of a swing after it")
    place.check()
    table = read_swing(path)
    columns = table.columns
    for name in ("compass", "magnetic", "true", "deviation"):
        places = (f"{name} in line {line} of {table.source}" for line in table.lines)
        _refuse_no_heading(columns.get(name, ()), places)
    say(f"{table.source}: {counted(len(table.lines), 'heading')}; columns {', '.join(columns)}")
    site = _site_of_table(path, place, is_true="true" in columns)
    if site is not None:
        columns = {**columns, "magnetic": wrapped(columns["true"] - site.declination_deg)}
    deviation = columns["deviation"] if "deviation" in columns else folded(columns["magnetic"] - columns["compass"])
    compass = columns["compass"] if "compass" in columns else wrapped(columns["magnetic"] - deviation)
    if "sigma" in columns and sigma_deg is not None:
        raise UsageError(f"{path} has a column of sigma: leave --sigma out")
    sigma: Floats | float | None = columns.get("sigma", sigma_deg)
    curve = fit(compass, deviation, sigma_deg=sigma)
    halves = _half_turns(compass, compass + deviation, curve.sigma_deg if sigma is None else sigma)
    return Swing(curve, site, halves=halves)


def _half_turns(compass: Floats, magnetic: Floats, sigma_deg: Floats | float | None) -> tuple[HalfTurn, ...]:
    """Pair the headings of a table that are half a turn apart."""
    import numpy as np

    from flinders.heading.stationary import Rest, half_turns

    sigmas = np.broadcast_to(np.nan if sigma_deg is None else sigma_deg, compass.shape).tolist()
    rows = enumerate(zip(compass.tolist(), sigmas, strict=True))
    rests = [Rest(place, place + 1, heading, sigma, sigma) for place, (heading, sigma) in rows]
    return half_turns(rests, magnetic.tolist())


def _site_of_table(path: str, place: option.Place, *, is_true: bool) -> SiteField | None:
    """The field where the swing was made, which true headings need and others do not."""
    if is_true and place.place is None:
        raise UsageError(f"{path} holds true headings: say where with --at LAT,LON and when with --date")
    if not is_true and place.place is not None:
        raise UsageError(f"{path} holds no true headings: leave --at out, or call its column 'true'")
    return None if place.place is None else site_of(place.place, place.date)


def _of_log(calibration: str | None, recording: str, options: SwingOptions) -> Swing:
    """Find the rests of a recording, fit their deviations where headings are known, and pair them."""
    from flinders.heading.stationary import half_turns

    known = None if options.known.headings is None else _known(options.known.headings)
    if options.place.place is not None and known is None:
        raise UsageError("--at turns known headings from true into magnetic: give --headings too, or leave it out")
    log, rests = _rests(calibration, recording, options)
    halves = half_turns(rests)
    if known is None and not halves:
        raise FitError(
            f"no turn by 180° in {recording}, {_listed(rests)}: rest on a heading, turn by 180°, rest again; or "
            "name the known headings with --headings"
        )
    if known is not None and len(rests) != len(known):
        raise FitError(
            f"--headings names {len(known)}, and {recording} holds {_listed(rests)}: name one for each, in order, or "
            "change the shortest --stationary"
        )
    deviation = None if known is None else _deviation(rests, known, log.site, options.known.sigma_deg)
    return Swing(deviation, log.site, rests, halves, _expected(log))


def _deviation(
    rests: tuple[Rest, ...], known: list[float], site: SiteField | None, sigma_deg: float | None
) -> Deviation:
    """Fit the deviation of rests on known headings, which are true where the site is known."""
    import numpy as np

    from flinders.geometry.angles import folded
    from flinders.heading.deviation import fit

    seen = np.array([rest.heading_deg for rest in rests])
    magnetic = np.array(known) - (0.0 if site is None else site.declination_deg)
    return fit(seen, folded(magnetic - seen), sigma_deg=sigma_deg)


def _rests(calibration: str | None, recording: str, options: SwingOptions) -> tuple[HeadingLog, tuple[Rest, ...]]:
    """Go through a recording and find its rests."""
    import numpy as np

    from flinders.heading.stationary import LEAST_READINGS, rests

    with progress("swinging") as bar:
        log = open_log(
            "swing",
            calibration,
            recording,
            place=options.place,
            accelerometer=options.accelerometer,
            progress=bar,
            **options.reading.as_dict(),
        )
        pairs = [(headings.magnetic_deg, samples.time) for _, samples, headings in log.headings()]
    say(f"{log}; {log.corrector.read_words(log.recording)}")
    if calibration is not None and not log.corrector.is_plausible:
        say("! these readings do not suit the calibration: see flinders check")
    heading = np.concatenate([headings for headings, _ in pairs])
    times = [time for _, time in pairs if time is not None]
    steps = np.diff(np.concatenate(times)) if times else np.empty(0)
    step = float(np.median(steps[np.isfinite(steps)])) if np.isfinite(steps).any() else 0.0
    least = max(round(options.known.stationary_s / step), 8) if step > 0.0 else LEAST_READINGS
    return log, rests(heading, least_readings=least)


def _expected(log: HeadingLog) -> Expected | None:
    """Deviation that the calibration's own uncertainty makes, where it states one."""
    from flinders.heading.deviation import Expected
    from flinders.heading.error_propagation import deviation_covariance

    if not log.fit.states_uncertainty:
        return None
    dip, source = log.site_dip()
    covariance = deviation_covariance(log.fit.ellipsoid, log.fit.claimed_covariance, dip_deg=dip, down=log.down())
    return Expected(covariance, dip, source)


def _known(text: str) -> list[float]:
    """Read the known headings."""
    known = option.numbers_of(text)
    if not known:
        raise UsageError(f"--headings {text!r}: need degrees, such as 0,45,90,135,180,225,270,315")
    _refuse_no_heading(known, (f"number {place} of --headings" for place in range(1, len(known) + 1)))
    return known


def _refuse_no_heading(angles: Iterable[float], places: Iterable[str]) -> None:
    """Refuse what goes round more than once: a slip, such as a digit too many."""
    for angle, place in zip(angles, places, strict=False):
        if abs(angle) > 360.0:
            raise UsageError(f"{place} is {angle:g}°: need degrees from −360 to 360")


def _listed(rests: tuple[Rest, ...]) -> str:
    """Say which rests there are."""
    from flinders.geometry.angles import shown_heading

    shown = ", ".join(shown_heading(rest.heading_deg, 0) for rest in rests[:12]) + ", …" * (len(rests) > 12)
    return f"{counted(len(rests), 'rest')}{f' on {shown}' if rests else ''}"


def _write(deviation: Deviation | None, options: SwingOptions) -> None:
    """Write card and curve."""
    from flinders.report.drawings import swing_drawing
    from flinders.report.heading_pages import card

    if deviation is not None:
        options.outputs.write(card(deviation, options.step_deg), options.output)
        options.outputs.write(swing_drawing(deviation), options.svg)
    elif options.output or options.svg:
        raise UsageError("without known headings there is no curve: give --headings, or leave -o and --svg out")


def _show(swing: Swing, options: SwingOptions) -> None:
    """Print the page; on standard error, where the card or the curve has standard output."""
    from flinders.report.heading_pages import of_swing

    page = of_swing(
        swing.deviation,
        site=swing.site,
        rests=swing.rests,
        halves=swing.halves,
        expected=swing.expected,
        target_deg=options.target_deg,
        step_deg=options.step_deg,
    )
    options.outputs.show(page)
    options.outputs.say_written()
