"""What a swing is asked for, and where it comes from: a table, a boat's log, or a recording and its calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from flinders.apps.marine.standards import STANDARDS
from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import is_calibration, is_recording, read_and_left_out, refuse_calibration, site_of
from flinders.cli._output import progress, say
from flinders.cli._program import GOOD, LIMITED, REFUSED
from flinders.cli._stream import open_log
from flinders.errors import FitError, UsageError, counted

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from flinders.apps.marine.compass_log import CompassLog
    from flinders.apps.marine.compensation import Compensation
    from flinders.apps.marine.deviation import Conformity, Deviation, Expected
    from flinders.apps.marine.legs import LoggedSwing
    from flinders.apps.marine.standards import Standard
    from flinders.arrays import Floats
    from flinders.core.geomag import SiteField
    from flinders.heading.stationary import HalfTurn, Rest
    from flinders.workflows.heading_stream import HeadingStream

STANDARD, BOAT = "Standard", "Log of a boat"
"""Headings of the options of a swing by a rule, and of one from a log of NMEA or Signal K."""


class StandardOptions(program.Group):
    """The rule by which a compass is swung, its limit, and the base on which it stood."""

    name: str | None = program.member(
        "--standard", type=click.Choice(list(STANDARDS), case_sensitive=False), metavar="NAME",
        help=f"Rule for compasses: {', '.join(STANDARDS)}. Without a file: print its checklist.",
    )  # fmt: skip
    limit_deg: float | None = program.member(
        "--limit", heading=STANDARD, type=program.angle, metavar="DEG",
        help="Largest deviation allowed [default: that of the rule, where its text was seen].",
    )  # fmt: skip
    base_error_deg: float = program.member(
        "--base-error", heading=STANDARD, type=program.within(0, 45, "degrees from 0 to 45", zero=True), default=0.0,
        show_default=True, metavar="DEG",
        help="What all known headings may be off by together, 1 σ: that of the compass base.",
    )  # fmt: skip
    compensate: bool = program.flag(
        "--compensate", "Say what to turn on N, E, S and W, of a TABLE with a reading on each.", heading=STANDARD
    )
    before: str | None = program.member(
        "--before",
        heading=STANDARD,
        metavar="TABLE",
        help="Readings on N, E, S and W before the compass was compensated.",
    )
    certificate: str | None = program.member(
        "--certificate", what="the certificate", heading=STANDARD, metavar="FILE",
        help="Also write a certificate with fields to sign, as .html, or .pdf by a browser that is installed.",
    )  # fmt: skip
    subject: str = program.member(
        "--subject", heading=STANDARD, default="", metavar="TEXT", help="Vehicle and compass, for the certificate."
    )

    @property
    def rule(self) -> Standard | None:
        """The rule that was named."""
        return None if self.name is None else STANDARDS[self.name]

    @property
    def limit(self) -> float | None:
        """The limit that was typed, else that of the rule."""
        return self.limit_deg if self.limit_deg is not None or self.rule is None else self.rule.limit_deg

    def check(self) -> str:
        """Refuse what does not go together; find the browser that prints the certificate, if it is to be a PDF."""
        from flinders.report.pdf import browser

        if self.certificate is None:
            if self.subject:
                raise UsageError("--subject is for a certificate: give --certificate FILE too")
            return ""
        ending = Path(self.certificate).suffix.lower()
        if ending not in {".html", ".pdf"}:
            raise UsageError(f"--certificate {self.certificate}: name a file that ends with .html or .pdf")
        return browser() if ending == ".pdf" else ""

    def facts(self) -> dict[str, str]:
        """What was typed that a certificate tells."""
        base = f"{self.base_error_deg:g}° (1 σ), in every uncertainty" if self.base_error_deg else ""
        facts = {"Vehicle and compass": self.subject, "Error of the base": base}
        return {name: words for name, words in facts.items() if words}


class BoatOptions(program.Group, heading=BOAT):
    """What the compass of a boat's log is held against."""

    reference: Literal["auto", "heading", "course"] = program.member(
        "--reference", type=click.Choice(["auto", "heading", "course"]), default="auto", show_default=True,
        help="Hold the compass against the true heading of another instrument, or the course over ground.",
    )  # fmt: skip
    slowest: float = program.member(
        "--min-speed", type=program.positive, default=2.0, show_default=True, metavar="M/S",
        help="Slowest leg over ground of which a course is used.",
    )  # fmt: skip
    crab_deg: float = program.member(
        "--crab", type=program.within(0, 45, "degrees from 0 to 45", zero=True), default=1.0, show_default=True,
        metavar="DEG", help="What leeway turns the course from the heading, 1 σ.",
    )  # fmt: skip


class KnownHeadings(program.Group):
    """Known headings, how well they are known, and how they are found in a recording."""

    headings: str | None = program.member(
        "--headings", heading=program.RECORDING, metavar="DEG,DEG,...",
        help="Known headings of the stationary intervals in LOG, in their order: magnetic, or true with --at.",
    )  # fmt: skip
    sigma_deg: float | None = program.member(
        "--sigma", heading=program.METHOD, type=program.angle, metavar="DEG",
        help="How well a heading was known and read, 1 σ [default: from the residuals].",
    )  # fmt: skip
    stationary_s: float = program.member(
        "--stationary", heading=program.RECORDING, type=program.positive, default=2.0, show_default=True, metavar="S",
        help="Shortest stationary interval in LOG, in seconds; 50 readings where it has no clock; of a boat 20 s.",
    )  # fmt: skip


class SwingOptions(program.Group):
    """A table, or a calibration and a recording; and what is written of the curve."""

    inputs: tuple[str, ...] = program.argument("TABLE | [CALIBRATION] LOG", nargs=-1, required=False)
    output: str | None = option.output(
        "the card", "Also write the card, as comma-separated text; - for standard output.", heading=program.OUTPUT
    )
    svg: str | None = program.member(
        "--svg", what="the curve", heading=program.OUTPUT, metavar="FILE", help="Also draw the curve, as SVG."
    )
    sentences: str | None = program.member(
        "--hdg", what="the sentences", heading=program.OUTPUT, metavar="FILE",
        help="Also write the card as sentences HDG of NMEA 0183.",
    )  # fmt: skip
    step_deg: float = program.member(
        "--step", heading=program.OUTPUT, type=program.within(0, 90, "degrees above 0, up to 90"),
        default=15.0, show_default=True, metavar="DEG", help="Step of the card; by default that of --standard.",
    )  # fmt: skip
    force: bool = option.force()
    standard: StandardOptions = program.group(StandardOptions)
    boat: BoatOptions = program.group(BoatOptions)
    known: KnownHeadings = program.group(KnownHeadings)
    place: option.Place = program.group(option.Place)
    accelerometer: option.Accelerometer = program.group(option.Accelerometer)
    reading: option.ColumnsOptions = program.group(option.ColumnsOptions)
    target_deg: float = option.target("What a turn by 180° may miss, and 1 σ of the curve may be.")
    as_json: bool = option.as_json()

    @property
    def card_step_deg(self) -> float:
        """The step that was typed, else that of the rule."""
        rule = self.standard.rule
        return self.step_deg if rule is None or program.is_typed("step_deg") else rule.step_deg

    def refuse_of_recording(self) -> None:
        """Refuse options that a table has no use for."""
        _refuse(self._of_magnetometer() | {"--stationary": program.is_typed("stationary_s")}, "a recording")
        self.refuse_of_boat()

    def refuse_of_magnetometer(self) -> None:
        """Refuse options that the log of a boat has no use for."""
        _refuse(self._of_magnetometer() | {"--sigma": self.known.sigma_deg}, "other files than the log of a boat")

    def refuse_of_boat(self) -> None:
        """Refuse options of a boat's log where there is none."""
        names = {"reference": "--reference", "slowest": "--min-speed", "crab_deg": "--crab"}
        _refuse({names[name]: program.is_typed(name) for name in names}, "the log of a boat")

    def _of_magnetometer(self) -> dict[str, object]:
        """Values of the options of a recording, by their spelling."""
        return {
            "--headings": self.known.headings, "--level": self.accelerometer.is_level,
            "--acceleration": self.accelerometer.acceleration, "--columns": self.reading.columns,
        }  # fmt: skip


def _refuse(values: Mapping[str, object], what: str) -> None:
    """Refuse options that are for something else."""
    for name, value in values.items():
        if value not in (None, False):
            raise UsageError(f"{name} is for {what}: leave it out")


@dataclass(frozen=True, slots=True)
class Swing:
    """What was found of a compass; of a recording also its rests, and what its calibration claims."""

    deviation: Deviation | None  # where headings are known
    site: SiteField | None  # where the declination comes from
    rests: tuple[Rest, ...] = ()
    halves: tuple[HalfTurn, ...] = ()
    expected: Expected | None = None
    conformity: Conformity | None = None  # where there is a limit
    before: Compensation | None = None  # coefficients before the compass was compensated
    logged: LoggedSwing | None = None  # readings from a boat's log

    def as_dict(self, target_deg: float) -> dict[str, Any]:
        """JSON-ready."""
        from flinders.apps.marine.swing_words import limits
        from flinders.heading.stationary import hard_iron

        deviation, halves = self.deviation, self.halves
        return {
            "deviation": None if deviation is None else deviation.as_dict(),
            # what limits the card, in words
            "limits": [] if deviation is None else list(limits(deviation, target_deg)),
            # what the calibration lets expect of a swing
            "calibration": None if self.expected is None else self.expected.as_dict(deviation),
            "site": None if self.site is None else self.site.as_dict(),
            "conformity": None if self.conformity is None else self.conformity.as_dict(),
            "before": None if self.before is None else self.before.as_dict(),
            "logged": None if self.logged is None else self.logged.as_dict(),
            "rests": [rest.as_dict() for rest in self.rests],  # stretches of one heading
            "half_turns": [half.as_dict() for half in halves],  # pairs of them, half a turn apart
            # B and C that half turns show
            "hard_iron_deg": None if (iron := hard_iron(halves)) is None else {"B": iron[0], "C": iron[1]},
            # whether all half turns are within `target_deg`
            "half_turns_pass": all(abs(half.error_deg) <= target_deg for half in halves) if halves else None,
            "target_deg": target_deg,  # deviation asked for
        }

    def exit_code(self, target_deg: float) -> int:
        """How the command ends."""
        from flinders.apps.marine.swing_words import limits

        missed = bool(self.rests) and any(abs(half.error_deg) > target_deg for half in self.halves)
        if self.deviation is None:
            return REFUSED if missed else GOOD
        is_open = self.conformity is not None and self.conformity.verdict != "within"
        return LIMITED if missed or is_open or limits(self.deviation, target_deg) else GOOD

    def judged_by(self, rule: StandardOptions, place: option.Place) -> Swing:
        """The same by a rule: the error of the base in its uncertainty, the limit, and what was before."""
        from flinders.apps.marine.deviation import common_error, conformity

        if self.deviation is None:
            return self
        curve = self.deviation.widened(common_error(rule.base_error_deg))
        checked = None if rule.limit is None else conformity(curve, rule.limit)
        before = None if rule.before is None else compensation_of(rule.before, place)
        return replace(self, deviation=curve, conformity=checked, before=before)


def is_boat(path: str) -> bool:
    """Whether a file is a log of NMEA or Signal K."""
    from flinders.apps.marine.compass_log import is_compass_log

    return path != "-" and is_compass_log(path)


def is_raw(path: str) -> bool:
    """Whether a file is no table of headings but a recording, whose compass is taken as it is."""
    from flinders.apps.marine.swing_table import read_swing
    from flinders.errors import InputError

    try:
        if path != "-":  # standard input can be read once
            read_swing(path)
    except InputError:
        return not is_calibration(path) and is_recording(path)
    return False


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """What a table holds of a swing: (N,) degrees each."""

    compass_deg: Floats
    deviation_deg: Floats  # magnetic less compass
    sigma_deg: Floats | None
    site: SiteField | None


def of_table(path: str, sigma_deg: float | None, place: option.Place) -> Swing:
    """Fit a table."""
    from flinders.apps.marine.deviation import fit

    readings = read_table(path, place)
    compass = readings.compass_deg
    if readings.sigma_deg is not None and sigma_deg is not None:
        raise UsageError(f"{path} has a column of sigma: leave --sigma out")
    sigma: Floats | float | None = sigma_deg if readings.sigma_deg is None else readings.sigma_deg
    curve = fit(compass, readings.deviation_deg, sigma_deg=sigma)
    halves = _half_turns(compass, compass + readings.deviation_deg, curve.sigma_deg if sigma is None else sigma)
    return Swing(curve, readings.site, halves=halves)


def compensation_of(path: str, place: option.Place) -> Compensation:
    """What to turn on N, E, S and W by a table with a reading on each."""
    from flinders.apps.marine.compensation import compensation

    readings = read_table(path, place)
    return compensation(readings.compass_deg, readings.deviation_deg)


def read_table(path: str, place: option.Place) -> Readings:
    """Read a table, its true headings made magnetic by the declination of the place."""
    from flinders.apps.marine.swing_table import read_swing
    from flinders.geometry.angles import folded, wrapped

    refuse_calibration(path, "give the recording of a swing after it")
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
    return Readings(compass, deviation, columns.get("sigma"), site)


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


def of_boat(path: str, options: SwingOptions) -> Swing:
    """Fit the readings of a log of NMEA or Signal K."""
    from flinders.apps.marine.compass_log import read_compass_log
    from flinders.apps.marine.deviation import fit
    from flinders.geometry.angles import wrapped

    options.refuse_of_magnetometer()
    log = read_compass_log(path, options.boat.reference)
    say(f"{log.source}: {log.words}")
    site = _site_of_boat(log, options.place)
    logged = _logged(log, wrapped(log.reference_deg - site.declination_deg), options)
    curve = fit(logged.compass_deg, logged.deviation_deg, sigma_deg=logged.sigma_deg).widened(logged.common_covariance)
    magnetic = logged.compass_deg + logged.deviation_deg
    has_headings = logged.is_steady and not log.is_course
    halves = _half_turns(logged.compass_deg, magnetic, logged.sigma_deg) if has_headings else ()
    return Swing(curve, site, halves=halves, logged=logged)


def _site_of_boat(log: CompassLog, place: option.Place) -> SiteField:
    """The field where the log was made, by its positions and clock unless another place was typed."""
    place.check()
    where = place.place or (None if log.place is None else "{:.4f},{:.4f}".format(*log.place))
    day = place.date or (None if log.day is None else f"{log.day}")
    if where is None or day is None:
        missing = "position" if where is None else "date"
        raise UsageError(f"{log.source} has no {missing}: say where with --at LAT,LON and when with --date")
    return site_of(where, day)


def _logged(log: CompassLog, magnetic_deg: Floats, options: SwingOptions) -> LoggedSwing:
    """Readings from straight legs; where there are too few, from turns, if the reference is a heading."""
    from flinders.apps.marine.legs import LEG_S, legs, turning

    least_s = options.known.stationary_s if program.is_typed("stationary_s") else LEG_S
    try:
        return legs(
            log.time,
            log.compass_deg,
            magnetic_deg,
            log.speed,
            is_course=log.is_course,
            least_s=least_s,
            slowest=options.boat.slowest,
            crab_deg=options.boat.crab_deg,
        )
    except FitError:
        if log.is_course:
            raise
        return turning(log.time, log.compass_deg, magnetic_deg)


def of_log(calibration: str | None, recording: str, options: SwingOptions) -> Swing:
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
            "name the known headings with --headings",
            rests=len(rests),
        )
    if known is not None and len(rests) != len(known):
        raise FitError(
            f"--headings names {len(known)}, and {recording} holds {_listed(rests)}: name one for each, in order, or "
            "change the shortest --stationary",
            rests=len(rests),
            headings=len(known),
        )
    deviation = None if known is None else _deviation(rests, known, log.site, options.known.sigma_deg)
    return Swing(deviation, log.site, rests, halves, _expected(log))


def _deviation(
    rests: tuple[Rest, ...], known: list[float], site: SiteField | None, sigma_deg: float | None
) -> Deviation:
    """Fit the deviation of rests on known headings, which are true where the site is known."""
    import numpy as np

    from flinders.apps.marine.deviation import fit
    from flinders.geometry.angles import folded

    seen = np.array([rest.heading_deg for rest in rests])
    magnetic = np.array(known) - (0.0 if site is None else site.declination_deg)
    return fit(seen, folded(magnetic - seen), sigma_deg=sigma_deg)


def _rests(calibration: str | None, recording: str, options: SwingOptions) -> tuple[HeadingStream, tuple[Rest, ...]]:
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
    say(f"{log}; {read_and_left_out(log.voyage.readings, getattr(log.recording, 'skipped', ()))}")
    if calibration is not None and not log.corrector.is_plausible:
        say("! these readings do not suit the calibration: see flinders check")
    heading = np.concatenate([headings for headings, _ in pairs])
    times = [time for _, time in pairs if time is not None]
    steps = np.diff(np.concatenate(times)) if times else np.empty(0)
    step = float(np.median(steps[np.isfinite(steps)])) if np.isfinite(steps).any() else 0.0
    least = max(round(options.known.stationary_s / step), 8) if step > 0.0 else LEAST_READINGS
    return log, rests(heading, least_readings=least)


def _expected(log: HeadingStream) -> Expected | None:
    """Deviation that the calibration's own uncertainty makes, and that of its rotation, where it states one."""
    from flinders.apps.marine.deviation import Expected
    from flinders.comparison.comparison import rotation_covariance
    from flinders.heading.error_propagation import deviation_covariance

    if not log.fit.claim.states_uncertainty:
        return None
    dip, source = log.site_dip()
    covariance = deviation_covariance(
        log.fit.calibration.ellipsoid,
        log.fit.claim.claimed_covariance,
        dip_deg=dip,
        down=log.down_in_body(),
        rotation=log.fit.calibration.rotation_matrix,
        rotation_covariance=rotation_covariance(log.fit),
    )
    return Expected(covariance, dip, source)


def _known(text: str) -> list[float]:
    """Read the known headings."""
    known = program.numbers_of(text)
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
