r"""The file of a station: pass limits, motion, serial numbers, exports and certificate, as TOML.

>>> plan = plan_of('[limits]\nheading_error_deg = 0.5\noffset = [-60, 60]\n[motion]\nbody = "drone"')
>>> plan.limits.heading_error_deg, plan.limits.offset, plan.motion.body, plan.limits.time_s
(0.5, (-60.0, 60.0), 'drone', 120.0)
>>> plan_of("[export]\nfor = ['arduino']")
Traceback (most recent call last):
flinders.errors.UsageError: plan: [export] has no key for: it takes targets
"""

from __future__ import annotations

import re
import tomllib
from typing import TYPE_CHECKING, Final, Literal

import msgspec
from msgspec import Struct

from flinders.core.calibration_file import in_words
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
    coverage: float | None = None  #: share of the sphere that has to be seen, 0 to 1
    time_s: float = 120.0  #: after which a unit is judged by what has come

    def tolerance(self, quantity: str) -> float:
        """Width of the pass range of a column of the table, from 0 of an upper limit; NaN where it has none."""
        ranges = {
            **dict.fromkeys(("offset_x", "offset_y", "offset_z"), self.offset),
            "field_strength": self.strength,
            "worst_deg": (0.0, self.heading_error_deg),
            "noise": None if self.noise is None else (0.0, self.noise),
        }
        ends = ranges.get(quantity)
        return ends[1] - ends[0] if ends else float("nan")


class MotionStep(Struct, frozen=True, kw_only=True):
    """A pose to take, or a motion of the fixture, for so long."""

    words: str
    seconds: float


class Motion(Struct, frozen=True, kw_only=True):
    """How a unit is moved: by the live page's sequence of turns for what is in the hand, or by timed steps."""

    body: Body = "board"  #: what is in the hand
    steps: tuple[MotionStep, ...] = ()  #: in place of that sequence; the unit is judged after the last

    @property
    def seconds(self) -> float:
        """What all steps take."""
        return sum(step.seconds for step in self.steps)


class Serials(Struct, frozen=True, kw_only=True):
    """Serial numbers: what one looks like, and the line of the board that says it."""

    pattern: str = r"[\w.+-]{1,64}"  #: regular expression of a whole serial number
    board_line: str | None = None  #: regular expression of a line of the board; its first group is the serial number
    repeats: bool = False  #: units are tested several times, as for a gauge study: nothing is asked

    @property
    def words(self) -> str:
        """What a serial number looks like."""
        if self.pattern == Serials().pattern:
            return "up to 64 letters, digits, or - _ . +, without a space"
        return f"one that the plan's serial.pattern matches, {self.pattern}"


class StationSite(Struct, frozen=True, kw_only=True):
    """Where the station is."""

    dip_deg: float | None = None  #: inclination of the field


class Exports(Struct, frozen=True, kw_only=True):
    """What is written of each unit that passes, beside its calibration file."""

    targets: tuple[str, ...] = ()  #: names of targets


class CertificateFacts(Struct, frozen=True, kw_only=True):
    """What a Digital Calibration Certificate states that no calibration knows."""

    laboratory: str  #: name of who calibrates
    country: str  #: of the laboratory, two letters of ISO 3166-1
    city: str  #: of the laboratory
    person: str  #: who is responsible
    customer: str  #: name of who gets the unit
    customer_country: str | None = None  #: two letters; by default that of the laboratory
    customer_city: str | None = None  #: by default that of the laboratory
    language: str = "en"  #: two letters of ISO 639-1
    manufacturer: str | None = None  #: of the unit
    model: str | None = None  #: of the unit


class Plan(Struct, frozen=True, kw_only=True):
    """The file of a station."""

    limits: PassLimits = PassLimits()
    motion: Motion = Motion()
    serial: Serials = Serials()
    site: StationSite = StationSite()
    export: Exports = Exports()
    certificate: CertificateFacts | None = None

    @property
    def time_s(self) -> float:
        """After which a unit is judged by what has come."""
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
        For a file that cannot be read, is no TOML, or has a key or value that cannot be meant.
    """
    content = read_bytes(path, largest=PLAN_BYTES, what="file of a station", refused=UsageError)
    try:
        return plan_of(content.decode(), str(path))
    except UnicodeDecodeError:
        raise UsageError(f"{path}: cannot be read: it is not UTF-8 text; save it as UTF-8") from None


def plan_of(text: str, name: str = "plan") -> Plan:
    """Understand the text of such a file, which messages call `name`; raises `UsageError`."""
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{name}: is no TOML: {error}") from None
    _refuse_unknown(name, tables)
    try:
        plan = msgspec.convert(tables, Plan)
    except msgspec.ValidationError as error:
        raise UsageError(f"{name}: {in_words(error)}") from None
    _refuse_out_of_range(name, plan)
    return plan


def _refuse_unknown(name: str, tables: Mapping[str, object]) -> None:
    """Refuse keys that nobody reads, so that no limit is left out by a typing error."""
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
            raise UsageError(f"{where} has no key {key}{did_you_mean(key, known)}: it takes {listed}")


def _refuse_out_of_range(name: str, plan: Plan) -> None:
    """Refuse numbers and patterns that cannot be meant."""
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
            f"{name}: serial.board_line has no group: put the part that is the serial number into brackets, as in "
            r"'serial: (\w+)'"
        )
    if plan.certificate is not None:
        _refuse_codes(name, plan.certificate)


def _refuse_codes(name: str, facts: CertificateFacts) -> None:
    """Refuse codes of countries and languages that a certificate cannot hold."""
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
        raise UsageError(f"{name}: {key} {pattern!r} is no regular expression: {error}") from None
