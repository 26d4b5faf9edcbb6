r"""File of a station in TOML: pass limits, motion, serial numbers, exports and certificate.

>>> plan = plan_of('[limits]\nheading_error_deg = 0.5\noffset = [-60, 60]\n[motion]\nbody = "drone"')
>>> plan.limits.heading_error_deg, plan.limits.offset, plan.motion.body, plan.limits.time_s
(0.5, (-60.0, 60.0), 'drone', 120.0)
>>> plan_of("[export]\nfor = ['arduino']")
Traceback (most recent call last):
flinders.errors.UsageError: plan: [export] has no key for: use one of targets
"""

from __future__ import annotations

import re
import tomllib
from typing import TYPE_CHECKING, Final, Literal

import msgspec
from msgspec import Struct

from flinders.core.calibration_file import readable_message
from flinders.core.files import read_bytes
from flinders.errors import UsageError, did_you_mean

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping

Body = Literal["board", "phone", "drone", "car", "boat", "instrument"]
Range = tuple[float, float]

PLAN_BYTES: Final = 1 << 20
MAX_TIME_S: Final = 3600.0
MAX_TARGET_DEG: Final = 180.0
MAX_DIP_DEG: Final = 89.0


class PassLimits(Struct, frozen=True, kw_only=True):
    """Pass limits of a unit; a limit that is None is not checked."""

    heading_error_deg: float = 1.0  #: worst heading error of a level vehicle, 1 σ, at most
    verdict: Literal["good", "limited"] = "good"  #: the worst verdict of the engine that passes
    unit: Literal["uT", "counts"] = "uT"  #: of strength, offset and noise
    strength: Range | None = None  #: of the corrected field, from and to
    offset: Range | None = None  #: of each axis, from and to
    noise: float | None = None  #: of the readings about the ellipsoid, 1 σ, at most
    coverage: float | None = None  #: least share of covered directions, 0 to 1
    time_s: float = 120.0  #: duration of a test

    def tolerance(self, quantity: str) -> float:
        """Width of the pass range of a column; a range with an upper limit only begins at 0. NaN without limits."""
        ranges = {
            **dict.fromkeys(("offset_x", "offset_y", "offset_z"), self.offset),
            "field_strength": self.strength,
            "worst_deg": (0.0, self.heading_error_deg),
            "noise": None if self.noise is None else (0.0, self.noise),
        }
        ends = ranges.get(quantity)
        return ends[1] - ends[0] if ends else float("nan")


class MotionStep(Struct, frozen=True, kw_only=True):
    """A step of a motion: a pose to take, or a motion of the fixture, for some seconds."""

    words: str
    seconds: float


class Motion(Struct, frozen=True, kw_only=True):
    """Motion of a unit: the live page's sequence of turns for a body, or timed steps."""

    body: Body = "board"  #: kind of the unit, for the sequence of turns
    steps: tuple[MotionStep, ...] = ()  #: replace that sequence; the test ends after the last

    @property
    def seconds(self) -> float:
        """Duration of all steps."""
        return sum(step.seconds for step in self.steps)


class Serials(Struct, frozen=True, kw_only=True):
    """Serial numbers: their pattern, and the line of the board that reports one."""

    pattern: str = r"[\w.+-]{1,64}"  #: regular expression of a whole serial number
    board_line: str | None = None  #: regular expression of a line of the board; its first group is the serial number
    repeats: bool = False  #: repeated tests of a unit need no confirmation, as for a gauge study

    @property
    def words(self) -> str:
        """Description of a serial number, for messages."""
        if self.pattern == Serials().pattern:
            return "up to 64 letters, digits, or - _ . +, without a space"
        return f"one that the plan's serial.pattern matches, {self.pattern}"


class StationSite(Struct, frozen=True, kw_only=True):
    """Place of the station."""

    dip_deg: float | None = None  #: inclination of the field


class Exports(Struct, frozen=True, kw_only=True):
    """Exports for each unit that passes, in addition to its calibration file."""

    targets: tuple[str, ...] = ()  #: names of targets


class CertificateFacts(Struct, frozen=True, kw_only=True):
    """Facts for a Digital Calibration Certificate that no calibration holds."""

    laboratory: str  #: name of the laboratory
    country: str  #: of the laboratory, two letters of ISO 3166-1
    city: str  #: of the laboratory
    person: str  #: responsible person
    customer: str  #: name of the customer
    customer_country: str | None = None  #: two letters; by default that of the laboratory
    customer_city: str | None = None  #: by default that of the laboratory
    language: str = "en"  #: two letters of ISO 639-1
    manufacturer: str | None = None  #: of the unit
    model: str | None = None  #: of the unit


class Plan(Struct, frozen=True, kw_only=True):
    """Contents of a station's file."""

    limits: PassLimits = PassLimits()
    motion: Motion = Motion()
    serial: Serials = Serials()
    site: StationSite = StationSite()
    export: Exports = Exports()
    certificate: CertificateFacts | None = None

    @property
    def time_s(self) -> float:
        """Duration of a test, s."""
        return self.motion.seconds if self.motion.steps else self.limits.time_s


TABLES: Final[dict[str, type[Struct]]] = {
    "limits": PassLimits, "motion": Motion, "serial": Serials, "site": StationSite, "export": Exports,
    "certificate": CertificateFacts,
}  # fmt: skip


def read_plan(path: str | os.PathLike[str]) -> Plan:
    """Read the file of a station.

    Raises
    ------
    UsageError
        For a file that cannot be read, is not TOML, or has an unknown key or a value out of range.
    """
    content = read_bytes(path, largest=PLAN_BYTES, what="file of a station", refused=UsageError)
    try:
        return plan_of(content.decode(), str(path))
    except UnicodeDecodeError:
        raise UsageError(f"{path}: cannot be read: it is not UTF-8 text; save it as UTF-8") from None


def plan_of(text: str, name: str = "plan") -> Plan:
    """Parse the text of a station's file; `name` is used in messages. Raises `UsageError`."""
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{name}: is not TOML: {error}") from None
    _refuse_unknown(name, tables)
    try:
        plan = msgspec.convert(tables, Plan)
    except msgspec.ValidationError as error:
        raise UsageError(f"{name}: {readable_message(error)}") from None
    _refuse_out_of_range(name, plan)
    return plan


def _refuse_unknown(name: str, tables: Mapping[str, object]) -> None:
    """Refuse unknown keys, so that a typing error does not drop a limit."""
    _refuse_keys(name, tables, TABLES)
    for table, kind in TABLES.items():
        content = tables.get(table, {})
        if not isinstance(content, dict):
            raise UsageError(f"{name}: {table} is no table: write [{table}] on a line of its own, and its keys below")
        _refuse_keys(f"{name}: [{table}]", content, kind.__struct_fields__)
    steps = tables.get("motion", {}).get("steps", ())  # type: ignore[attr-defined]  # a table by now
    for step in steps if isinstance(steps, list) else ():
        if isinstance(step, dict):
            _refuse_keys(f"{name}: [motion] steps", step, MotionStep.__struct_fields__)


def _refuse_keys(where: str, table: Mapping[str, object], known: tuple[str, ...] | Mapping[str, object]) -> None:
    for key in table:
        if key not in known:
            listed = ", ".join(sorted(known))
            raise UsageError(f"{where} has no key {key}{did_you_mean(key, known)}: use one of {listed}")


def _refuse_out_of_range(name: str, plan: Plan) -> None:
    """Refuse a plan with numbers out of range or invalid patterns."""
    limits = plan.limits
    _need(name, "limits.heading_error_deg", limits.heading_error_deg, 0.0, MAX_TARGET_DEG)
    _need(name, "limits.time_s", limits.time_s, 0.0, MAX_TIME_S)
    for step in plan.motion.steps:
        _need(name, "motion.steps.seconds", step.seconds, 0.0, MAX_TIME_S)
    if limits.noise is not None:
        _need(name, "limits.noise", limits.noise, 0.0, float("inf"))
    if limits.coverage is not None:
        _need(name, "limits.coverage", limits.coverage, 0.0, 1.0)
    if plan.site.dip_deg is not None and not abs(plan.site.dip_deg) <= MAX_DIP_DEG:
        raise UsageError(f"{name}: site.dip_deg is {plan.site.dip_deg:g}: need −89 to 89")
    for key, ends in {"strength": limits.strength, "offset": limits.offset}.items():
        if ends is not None and not ends[0] < ends[1]:
            raise UsageError(f"{name}: limits.{key} is from {ends[0]:g} to {ends[1]:g}: need a number below the second")
    _pattern(name, "serial.pattern", plan.serial.pattern)
    if plan.serial.board_line is not None and not _pattern(name, "serial.board_line", plan.serial.board_line).groups:
        raise UsageError(
            f"{name}: serial.board_line has no group: put the serial number's part in brackets, as in "
            r"'serial: (\w+)'"
        )
    if plan.certificate is not None:
        _refuse_codes(name, plan.certificate)


def _refuse_codes(name: str, facts: CertificateFacts) -> None:
    """Refuse invalid codes of countries and languages."""
    for key, value, shape in (
        ("country", facts.country, "[A-Z]{2}"),
        ("customer_country", facts.customer_country or facts.country, "[A-Z]{2}"),
        ("language", facts.language, "[a-z]{2}"),
    ):
        if not re.fullmatch(shape, value):
            example = "DE" if shape == "[A-Z]{2}" else "en"
            raise UsageError(f"{name}: certificate.{key} is {value!r}: need two letters, such as {example}")


def _need(name: str, key: str, value: float, above: float, most: float) -> None:
    if not above < value <= most:
        upper = "" if most == float("inf") else f", up to {most:g}"
        raise UsageError(f"{name}: {key} is {value:g}: need a number above {above:g}{upper}")


def _pattern(name: str, key: str, pattern: str) -> re.Pattern[str]:
    try:
        return re.compile(pattern)
    except re.error as error:
        raise UsageError(f"{name}: {key} {pattern!r} is not a regular expression: {error}") from None
