"""Magnetic budget of a compass: the stray field for a heading error, and its sources: wires, pairs, magnets.

A field that is fixed to the vehicle, of horizontal component b, turns the earth's horizontal field H by at most
asin(b/H) over all headings. Wires, pairs of wires and magnets make such fields. Each relation is a value, solved for
its one missing quantity:

>>> allowed = Heading.solve(field=parse("field", "150 mG"), error_deg=1.0)
>>> round(allowed.stray / parse("field", "1 mG"), 2)
2.62
>>> Wire.solve(current=0.2, distance=parse("length", "1 cm")).stray
4.0
>>> needed = Wire.solve(current=0.2, stray=allowed.stray)
>>> round(needed.distance / parse("length", "1 cm"), 1)
15.3

Fields are in µT, lengths in m, currents in A, moments in A·m². The formulas are those of magnetostatics in free space,
for straight wires that are long, and magnets that are small, compared with their distance. A calibration removes
constant fields: the budget is for fields that change or are switched.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal, Self, TypeAlias

from flinders.core.units import PER_UNIT, SPELLINGS
from flinders.errors import UnitError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

MU0_2PI: Final = 0.2
"""µ₀/2π in µT·m/A; the 2·10⁻⁷ T·m/A of the old ampere still holds to nine digits (CODATA 2022)."""

RIGHT_ANGLE: Final = 90.0

Kind: TypeAlias = Literal["field", "length", "current", "angle", "moment", "volume"]
Position: TypeAlias = Literal["axial", "equatorial"]

UNITS: Final[Mapping[Kind, Mapping[str, float]]] = {
    "field": PER_UNIT,
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "km": 1e3, "in": 0.0254, "ft": 0.3048},
    "current": {"A": 1.0, "mA": 1e-3, "uA": 1e-6, "kA": 1e3},
    "angle": {"deg": 1.0, "rad": 180.0 / math.pi, "mrad": 0.18 / math.pi},
    "moment": {"Am2": 1.0, "mAm2": 1e-3, "uAm2": 1e-6, "emu": 1e-3},
    "volume": {"m3": 1.0, "cm3": 1e-6, "mm3": 1e-9},
}
"""Factors from each unit to the first unit of its kind, in which this module calculates."""

OTHER_SPELLINGS: Final = {
    "°": "deg", "degree": "deg", "degrees": "deg", "µm": "um", "inch": "in", "inches": "in", "amp": "A", "amps": "A",
    "ampere": "A", "amperes": "A", "ma": "mA", "µA": "uA", "a": "A", "J/T": "Am2", "cc": "cm3", "meter": "m",
    "metre": "m", "meters": "m", "metres": "m", "feet": "ft",
}  # fmt: skip

EXAMPLES: Final[Mapping[Kind, str]] = {
    "field": "2.62mG", "length": "1cm", "current": "0.2A", "angle": "1deg", "moment": "0.1Am2", "volume": "0.3cm3",
}  # fmt: skip

NUMBER: Final = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?!\d)\s*(.*)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class UnitValue:
    """A quantity as it was typed: a number and its unit."""

    value: float  # value in the unit in which this module calculates: µT, m, A, °, A·m² or m³
    unit: str  # typed unit, in its usual spelling

    @classmethod
    def of(cls, kind: Kind, text: str, name: str = "") -> Self:
        """Read a number with its unit: ``2.62mG``, ``1 cm``, ``0.2A``, ``0.1 A·m²``; an angle may lack the unit.

        `name`: name of the quantity in messages, by default its kind.
        Raises `UnitError` for a unit that is missing, not known or of another kind; `UsageError` for a text that is not
        a positive number.

        Examples
        --------
        >>> UnitValue.of("field", "0.5 mG"), UnitValue.of("length", "15 mm"), UnitValue.of("moment", "20 mA·m²")
        (UnitValue(value=0.05, unit='mG'), UnitValue(value=0.015, unit='mm'), UnitValue(value=0.02, unit='mAm2'))
        """
        match, what = NUMBER.fullmatch(text.strip()), f"{name or kind} {text!r}"
        if not match or match[2].startswith((",", ".")):
            comma = f"; write {text.strip().replace(',', '.')}" if re.match(r"\d*,\d+\D", text.strip()) else ""
            raise UsageError(f"{what}: need a number and a unit, such as {EXAMPLES[kind]}{comma}")
        unit = _unit(kind, match[2], what)
        value = float(match[1]) * UNITS[kind][unit]
        if not (math.isfinite(value) and value > 0):
            limit = "below 1e300" if value > 0 else "above 0"
            raise UsageError(f"{what}: need a number {limit}")
        return cls(value, unit)


def parse(kind: Kind, text: str) -> float:
    """Read a quantity, in µT, m, A, °, A·m² or m³; raises the errors of `UnitValue.of`.

    >>> parse("length", "2.5in"), parse("angle", "1°"), parse("current", "200 mA")
    (0.0635, 1.0, 0.2)
    """
    return UnitValue.of(kind, text).value


@dataclass(frozen=True, slots=True)
class Heading:
    """Stray field b and worst heading error δ in a horizontal field H: b = H sin δ.

    At an angle φ between the two fields the error is atan(b sin φ/(H + b cos φ)), and asin(b/H) at its worst. Small
    errors are b/H in radians: 1° at 150 mG is 2.62 mG either way. Beyond b = H a compass may show any heading.
    """

    formula: ClassVar[str] = "b = H sin δ"

    field: float  # µT, horizontal part of the earth's field
    stray: float  # µT, horizontal part of the stray field, fixed to the vehicle
    error_deg: float  # worst heading error over all headings, at most 90

    @classmethod
    def solve(cls, *, field: float | None = None, stray: float | None = None, error_deg: float | None = None) -> Self:
        """Solve for the missing quantity.

        Raises `UsageError` unless exactly one is missing, the others are positive, the error is no more than 90° and
        the stray field no more than the horizontal one.

        Examples
        --------
        >>> [round(Heading.solve(field=25.0, stray=b).error_deg, 2) for b in (1.0, 5.0, 10.0)]
        [2.29, 11.54, 23.58]
        """
        known = _known_quantities(field=field, stray=stray, error_deg=error_deg)
        if known.get("error_deg", 0.0) > RIGHT_ANGLE:
            raise UsageError(f"a heading error of {error_deg:g}°: need no more than 90°")
        match known:
            case {"field": h, "error_deg": error}:
                return cls(h, _require_positive(h * math.sin(math.radians(error))), error)
            case {"stray": b, "error_deg": error}:
                sine = math.sin(math.radians(error))
                return cls(_require_positive(b / sine if sine else math.inf), b, error)
            case {"field": h, "stray": b} if b <= h:
                return cls(h, b, _require_positive(math.degrees(math.asin(b / h))))
        raise UsageError(
            f"a stray field {known['stray'] / known['field']:.3g} times the horizontal field can turn the compass to "
            "any heading: keep the source farther away"
        )


@dataclass(frozen=True, slots=True)
class Wire:
    """A long straight wire whose current returns far away: B = µ₀ I/(2π r)."""

    formula: ClassVar[str] = "B = µ₀ I / (2π r)"

    current: float  # A
    distance: float  # m, from the middle of the wire
    stray: float  # µT, whole field of the wire; its horizontal part depends on the direction of the wire

    @classmethod
    def solve(cls, *, current: float | None = None, distance: float | None = None, stray: float | None = None) -> Self:
        """Solve for the missing quantity; raises `UsageError` unless one is missing and the others are positive.

        >>> [round(Wire.solve(current=i, distance=r).stray, 9) for i, r in ((1, 0.01), (10, 0.02), (30, 0.05))]
        [20.0, 100.0, 120.0]
        """
        match _known_quantities(current=current, distance=distance, stray=stray):
            case {"current": i, "distance": r}:
                return cls(i, r, _require_positive(MU0_2PI * i / r))
            case {"current": i, "stray": b}:
                return cls(i, _require_positive(MU0_2PI * i / b), b)
            case {"distance": r, "stray": b}:
                return cls(_require_positive(b * r / MU0_2PI), r, b)
        raise AssertionError  # `_known_quantities` returns two of three


@dataclass(frozen=True, slots=True)
class Pair:
    """A wire and its parallel return, both long and straight: B = µ₀ I s/(2π (r² − s²/4)).

    This holds in the plane of both wires, the worst place; elsewhere the field is smaller, down to
    µ₀ I s/(2π (r² + s²/4)). Far away both are µ₀ I s/(2π r²). The field of a **twisted** pair is far smaller: it falls
    off exponentially with distance, and 1.5 pitches away it is 50 dB below that of a straight pair (Moser and Spencer
    1968).
    """

    formula: ClassVar[str] = "B = µ₀ I s / (2π (r² − s²/4))"

    current: float  # A
    separation: float  # m, from the middle of one wire to the middle of the other
    distance: float  # m, from the middle between both
    stray: float  # µT

    @classmethod
    def solve(
        cls,
        *,
        current: float | None = None,
        separation: float | None = None,
        distance: float | None = None,
        stray: float | None = None,
    ) -> Self:
        """Solve for the missing quantity.

        Raises `UsageError` unless exactly one is missing and the others are positive, or if the distance is not more
        than half the separation.

        Examples
        --------
        >>> near = Pair.solve(current=10, separation=0.01, distance=0.1)
        >>> round(near.stray, 3), Wire.solve(current=10, distance=0.1).stray
        (2.005, 20.0)
        """
        known = _known_quantities(current=current, separation=separation, distance=distance, stray=stray)
        if known.get("distance", math.inf) <= known.get("separation", 0.0) / 2:
            raise UsageError(
                f"distance is {distance:g} m from the middle of the two wires, and their separation is {separation:g} "
                "m: need a distance of more than half the separation"
            )
        match known:
            case {"current": i, "separation": s, "distance": r}:
                return cls(i, s, r, _require_positive(MU0_2PI * i * (s / (r - s / 2)) / (r + s / 2)))
            case {"current": i, "separation": s, "stray": b}:
                return cls(i, s, _require_positive(math.hypot(s / 2, math.sqrt(MU0_2PI * i / b) * math.sqrt(s))), b)
            case {"current": i, "distance": r, "stray": b}:
                # s²/4 + k s − r² = 0 with k = µ₀ I/(2π B), in the form that loses no digits
                k = MU0_2PI * i / b
                return cls(i, _require_positive(2 * r * (r / (k + math.hypot(k, r)))), r, b)
            case {"separation": s, "distance": r, "stray": b}:
                return cls(_require_positive(b / MU0_2PI * ((r - s / 2) * ((r + s / 2) / s))), s, r, b)
        raise AssertionError  # `_known_quantities` returns three of four


@dataclass(frozen=True, slots=True)
class Magnet:
    """A magnet as a dipole: B = µ₀ m/(2π r³) on its axis, half of that at its side.

    The axis is the worst direction. Within three times its size a magnet is no dipole.
    """

    moment: float  # A·m²
    distance: float  # m, from the middle of the magnet
    stray: float  # µT
    position: Position = "axial"  # position of the sensor: "axial" in front of a pole, "equatorial" beside the magnet

    @property
    def formula(self) -> str:
        """The formula as text."""
        return f"B = µ₀ m / ({'2π' if self.position == 'axial' else '4π'} r³)"

    @classmethod
    def solve(
        cls,
        *,
        moment: float | None = None,
        distance: float | None = None,
        stray: float | None = None,
        position: Position = "axial",
    ) -> Self:
        """Solve for the missing quantity; raises `UsageError` unless one is missing and the others are positive.

        A magnet of neodymium, 1 cm across and 3 mm thick, at 30 cm:

        >>> moment = magnet_moment(remanence=1.3e6, volume=0.236e-6)
        >>> round(moment, 3), round(Magnet.solve(moment=moment, distance=0.3).stray, 2)
        (0.244, 1.81)
        """
        if position not in ("axial", "equatorial"):
            raise UsageError(f"position is {position!r}: need 'axial' or 'equatorial'")
        constant = MU0_2PI if position == "axial" else MU0_2PI / 2
        match _known_quantities(moment=moment, distance=distance, stray=stray):
            case {"moment": m, "distance": r}:
                return cls(m, r, _require_positive(constant * (m / r / r / r)), position)
            case {"moment": m, "stray": b}:
                return cls(m, _require_positive(math.cbrt(constant * (m / b))), b, position)
            case {"distance": r, "stray": b}:
                return cls(_require_positive(b * r * r * r / constant), r, b, position)
        raise AssertionError  # `_known_quantities` returns two of three


def magnet_moment(*, remanence: float, volume: float) -> float:
    """Moment of a magnet in A·m², from its remanence in µT and its volume in m³: m = B_r V/µ₀.

    >>> round(magnet_moment(remanence=1.3e6, volume=1e-6), 3)
    1.035
    """
    return _require_positive(remanence * (volume / (2 * math.pi * MU0_2PI)))


def _known_quantities(**given: float | None) -> dict[str, float]:
    """Return the given quantities; raises `UsageError` unless exactly one is missing and all are positive."""
    known = {name: float(value) for name, value in given.items() if value is not None}
    if len(known) != len(given) - 1:
        names = ", ".join(name.removesuffix("_deg") for name in given)
        raise UsageError(f"{len(known)} of {names} are given: give all but the one to be calculated")
    for name, value in known.items():
        if not (math.isfinite(value) and value > 0):
            raise UsageError(f"{name.removesuffix('_deg')} is {value:g}: need a positive number")
    return known


def _require_positive(value: float) -> float:
    """Return the value; raises `UsageError` if it has overflowed or underflowed."""
    if not (math.isfinite(value) and value > 0):
        raise UsageError("the result of these numbers is too large or too small: check their units")
    return value


def _unit(kind: Kind, text: str, what: str) -> str:
    """Usual spelling of a unit of one kind; `what` names the quantity in a message."""
    units = UNITS[kind]
    spelled = re.sub(r"[ ·⋅*^]", "", text).replace("²", "2").replace("³", "3").replace("μ", "µ")
    if not spelled and kind == "angle":
        return "deg"
    known = SPELLINGS if kind == "field" else OTHER_SPELLINGS
    # Case is ignored, except for currents and moments, where M and m differ by a factor of 1e9.
    lower = spelled if kind in ("current", "moment") else spelled.casefold()
    for name in (spelled, known.get(spelled, ""), lower, known.get(lower, ""), lower.replace("µ", "u")):
        if name in units:
            return name
    named = f"unit {text!r} is not known here" if text else "lacks a unit"
    raise UnitError(f"{what}: {named}; use one of {', '.join(units)}, such as {EXAMPLES[kind]}")


QUANTITIES: Final[Mapping[str, tuple[Kind, str]]] = {
    "field": ("field", "field_uT"),
    "stray": ("field", "stray_uT"),
    "error": ("angle", "error_deg"),
    "current": ("current", "current_A"),
    "distance": ("length", "distance_m"),
    "separation": ("length", "separation_m"),
    "moment": ("moment", "moment_Am2"),
    "remanence": ("field", "remanence_uT"),
    "volume": ("volume", "volume_m3"),
}
"""Kind of each quantity of a budget, and its name with the unit."""

Solver: TypeAlias = "Callable[..., Wire | Pair | Magnet]"


@dataclass
class Budget:
    """A chain of relations: given quantities, and quantities derived from them.

    Examples
    --------
    >>> given = {"current": UnitValue.of("current", "0.2A"), "distance": UnitValue.of("length", "1cm")}
    >>> budget = Budget("wire", given)
    >>> budget.find_source(Wire.solve, ("current", "distance"))
    >>> budget.derived, budget.why
    ({'stray': 4.0}, {'stray': 'B = µ₀ I / (2π r)'})
    """

    kind: str  #: ``heading``, ``wire``, ``pair`` or ``magnet``
    given: dict[str, UnitValue]  #: given quantities by name, in the order in which they are shown
    position: Position | None = None  #: position of the sensor near a magnet
    #: derived quantities by name, in µT, m, A, ° or A·m²; an error of None means any heading
    derived: dict[str, float | None] = field(default_factory=dict)
    why: dict[str, str] = field(default_factory=dict)  #: formula of each derived quantity, by name

    @property
    def known(self) -> dict[str, float]:
        """Given and derived quantities by name, in µT, m, A, °, A·m² or m³."""
        solved = {name: value for name, value in self.derived.items() if value is not None}
        return {name: quantity.value for name, quantity in self.given.items()} | solved

    def find_heading(self) -> None:
        """Find one of horizontal field, stray field and heading error if the other two are known."""
        known = self.known
        if {"field", "stray"} <= known.keys() and known["stray"] > known["field"]:
            self.derived["error"] = None
            return
        solved = Heading.solve(field=known.get("field"), stray=known.get("stray"), error_deg=known.get("error"))
        for name, value in {"field": solved.field, "stray": solved.stray, "error": solved.error_deg}.items():
            if name not in known:
                self.derived[name], self.why[name] = value, solved.formula

    def find_moment(self) -> None:
        """Find the moment of a magnet from its remanence and volume, if they are given.

        Raises `UsageError` if one of them is missing, or the moment is given too.
        """
        made = [self.given[name].value for name in ("remanence", "volume") if name in self.given]
        if len(made) == 1 or (made and "moment" in self.given):
            raise UsageError("give moment, or remanence and volume together")
        if made:
            self.derived["moment"] = magnet_moment(remanence=made[0], volume=made[1])
            self.why["moment"] = "m = B_r V / µ₀"

    def find_source(self, solve: Solver, names: tuple[str, ...]) -> None:
        """Solve for the one unknown of a source: its field, its distance, its current or the heading error.

        Raises `UsageError` for too many or too few quantities.
        """
        heading = [name for name in ("field", "stray", "error") if name in self.given]
        if len(heading) > 2:
            raise UsageError("field, stray and error are all given, and two of them determine the third: leave out one")
        if len(heading) == 2:
            self.find_heading()
        missing = [name for name in (*names, "stray") if name not in self.known]
        options = " and ".join(names)
        if not missing:
            raise UsageError(f"{options} determine the stray field, and stray is given too: leave out one of them")
        if len(missing) > 1:
            raise UsageError(
                f"too few quantities. To calculate the stray field, give {options}. To calculate one of these, give "
                "the others, and either stray or both field and error"
            )
        solved = solve(**{name: self.known.get(name) for name in (*names, "stray")})
        self.derived[missing[0]], self.why[missing[0]] = getattr(solved, missing[0]), solved.formula
        if len(heading) == 1 and heading[0] != "stray":
            self.find_heading()

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: quantities by name with unit, and the names of derived ones; an error of null is any heading."""
        known = self.known
        shown = known.keys() | self.derived.keys()
        values = {key: known.get(name) for name, (_, key) in QUANTITIES.items() if name in shown}
        fields: dict[str, Any] = {"kind": self.kind, **({"position": self.position} if self.position else {}), **values}
        derived = [QUANTITIES[name][1] for name in self.derived]
        # keys of the quantities that were solved for
        fields["derived"] = derived
        # formulas that were used
        fields["formulas"] = [*dict.fromkeys(self.why.values())]
        return fields
