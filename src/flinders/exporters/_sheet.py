"""The sheet of a target: its formula, unit, axes, storage and source, and how a file for it is laid out.

A sheet writes the comments, runs the target's formula on what is written, and says what that costs. What a recording or
a person named goes into comments only, in ASCII and without what would end the comment.

>>> print(*BLOCK.lines(["from */ system(1); /* x.json", "2 µT"]), sep=chr(10))
/*
 * from * / system(1); / * x.json
 * 2 uT
 */
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias

import numpy as np

from flinders.conventions._affine import OWN, RECORDED, VEHICLE, Acts, acting, per_unit, refuse_mounted
from flinders.conventions._driven import followed
from flinders.conventions._recorded import in_recorded_axes
from flinders.core.units import label
from flinders.errors import figures
from flinders.exporters._export import DIP_DEG, Deviation, Export

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.disturbance import Driver
    from flinders.exporters._export import Asked, Written

Keeps: TypeAlias = Literal["all", "symmetric", "diagonal", "offset"]

HOLDS: Final[Mapping[Keeps, str]] = {
    "all": "an offset and a whole matrix",
    "symmetric": "an offset and a symmetric matrix",
    "diagonal": "an offset and a diagonal, no soft iron beside it",
    "offset": "an offset and no soft iron",
}
"""What of a calibration a target has room for."""

WHERE: Final[Mapping[Acts, str]] = {
    "recorded": "the sensor's own, before its mounting",
    "mapped": "those of the vehicle or board, after the mounting",
    "across": "readings as recorded in, the calibration's axes out",
}
"""In which axes a target works."""

WIDTH: Final = 78
NEXT_TO_NOTHING: Final = 0.0001
EXACT: Final = 1e-9
"""A matrix is of a kind to within this share of its largest entry: products of matrices are rounded."""
ASCII: Final = str.maketrans({
    "µ": "u", "°": " deg", "−": "-", "·": "*", "×": "x", "σ": "sigma", "±": "+/-", "…": "...", "–": "-", "’": "'",
    "²": "^2", "ᵀ": "'", "½": "1/2", "∕": "/",
})  # fmt: skip


@dataclass(frozen=True, slots=True)
class Comment:
    """How a language marks comments.

    Attributes
    ----------
    each : str
        What a line begins with.
    opening, closing : str
        Lines around them all; empty where there are none.
    ends : tuple of pairs of str
        What must not stand in a comment, and what is written in its place.
    """

    each: str
    opening: str = ""
    closing: str = ""
    ends: tuple[tuple[str, str], ...] = ()

    def lines(self, remarks: Iterable[str]) -> list[str]:
        """Break remarks into lines of comment."""
        wrapped = [
            line
            for remark in remarks
            for line in textwrap.wrap(
                self._harmless(remark),
                WIDTH,
                initial_indent=self.each,
                subsequent_indent=f"{self.each}  ",
                break_on_hyphens=False,
            )
        ]
        return [*([self.opening] if self.opening else []), *wrapped, *([self.closing] if self.closing else [])]

    def _harmless(self, remark: str) -> str:
        """ASCII that can be printed, and ends no comment."""
        text = plain_ascii(remark)
        for found, written in self.ends:
            while found in text:
                text = text.replace(found, written)
        return text


HASH: Final = Comment("# ")
PERCENT: Final = Comment("% ")
BLOCK: Final = Comment(" * ", "/*", " */", (("*/", "* /"), ("/*", "/ *"), ("??", "? ?")))
MARKUP: Final = Comment("  ", "<!--", "-->", (("--", "- -"),))


@dataclass(frozen=True, slots=True)
class Sheet:
    """What is known of a target.

    Attributes
    ----------
    title : str
        Its name, for people.
    formula : str
        By which it uses the numbers.
    unit : str
        Of the readings that it corrects: a name of `units`, ``own`` or ``recorded``.
    keeps : str
        What it holds; a key of `HOLDS`.
    storage : str
        How numbers are kept, and their range.
    source : str
        Where that stands.
    acts : str
        A key of `WHERE`.
    fed : bool
        The program around it chooses which readings it corrects: they may be those of the vehicle.
    follows : str
        What of that which drives an offset it has room for: nothing, one of current and throttle (``motors``), or all.
    lengths : str
        How long corrected readings are, where that is the target's own; empty where it is the calibration's.
    gives : str
        Unit of what comes out, where it is another.
    errors_in : str
        Unit in which its errors are told, where that of the calibration says little beside its steps.
    unverified : tuple of str
        What nobody could verify, a clause each.
    comment : Comment, optional
        None where the file has no room for comments.
    """

    title: str
    formula: str
    unit: str
    keeps: Keeps
    storage: str
    source: str
    acts: Acts = "recorded"
    fed: bool = False
    follows: Literal["", "motors", "all"] = ""
    lengths: str = ""
    gives: str = ""
    errors_in: str = ""
    unverified: tuple[str, ...] = ()
    comment: Comment | None = HASH

    @property
    def where(self) -> str:
        """In which axes it works, in words."""
        return WHERE[self.acts]

    @property
    def holds(self) -> str:
        """What it has room for, in words."""
        return HOLDS[self.keeps]

    def export(
        self, calibration: Calibration, written: Written, *, target: str, about: Sequence[str], asked: Asked
    ) -> Export:
        """Run the target's formula on what is written, and lay the file out.

        Parameters
        ----------
        calibration : Calibration
        written : Written
            It in the numbers of the target.
        target : str
            Name of the target.
        about : sequence of str
            Lines that tell where it comes from.
        asked : Asked

        Raises
        ------
        NotExportable
            Where the target's numbers cost more than a degree of heading, unless that was asked for.
        """
        plain, motor = self._followed(calibration)
        lacks = f"{self.title} holds {self.holds}" if self._loses(plain) else ""
        deviation = self._tried(plain, written.apply, lacks=lacks, lossy=asked.lossy)
        if motor is not None and (driven := written.driven) is not None:
            end = motor.farthest
            far = calibration.at(**{motor.name: end})
            tried = self._tried(far, lambda raw: driven(raw, end), lacks=lacks, lossy=asked.lossy)
            deviation = deviation.beside(tried)
        warnings = (*self._warnings(deviation, lacks), *self._left_out(calibration, motor))
        calibration = plain
        checked = self._checked(calibration, deviation)
        told = [*about, *self._notes(calibration), *written.notes]
        remarks = [f"{self.title}: {self.formula}, in {self._unit(calibration)}", *told, *warnings, checked]
        comments = self.comment.lines(remarks) if self.comment else []
        fields = {
            "target": target,
            "formula": self.formula,
            "unit": self._unit(calibration),
            "axes": self.where,
            "holds": self.holds,
            "values": dict(written.values),
            "checked": self._figures(calibration, deviation),
            "notes": told,
            "unverified": list(self.unverified),
        }
        text = "\n".join([*comments, *written.body, ""])
        return Export(target, text, fields, checked, warnings, written.data, told=bool(comments))

    def refuse_foreign(self, calibration: Calibration) -> None:
        """Refuse a calibration of readings after the mounting for a target that acts before it.

        Raises
        ------
        NotExportable
        """
        if self.acts == "recorded" and not self.fed:
            refuse_mounted(calibration, who=self.title)

    def _tried(
        self, calibration: Calibration, apply: Callable[[Floats], Floats], *, lacks: str, lossy: bool
    ) -> Deviation:
        """Run the target's formula in its units."""
        size = per_unit(calibration, self.unit, who=self.title)
        gives = self._size_given(calibration)
        return Deviation.of(
            calibration,
            lambda raw: gives * apply(raw / size),
            acts=acting(self.acts, calibration),
            relative=bool(self.lengths),
            lacks=lacks,
            lossy=lossy,
        )

    def _size_given(self, calibration: Calibration) -> float:
        """What one unit of a corrected reading is, in the unit of the calibration."""
        return per_unit(calibration, self.gives or self.unit, who=self.title)

    def _followed(self, calibration: Calibration) -> tuple[Calibration, Driver | None]:
        """The plain calibration that its numbers stand for, and the driver of motors that it follows."""
        return followed(calibration) if self.follows == "motors" else (calibration.at(), None)

    def _left_out(self, calibration: Calibration, motor: Driver | None) -> Iterable[str]:
        """What a target costs that does not follow what the calibration follows."""
        if self.follows == "all":
            return
        for driver in calibration.drivers:
            if motor is None or driver.name != motor.name:
                cost = min(calibration.driven_deg(driver, dip_deg=DIP_DEG), 180.0)
                yield (
                    f"{self.title} does not follow {driver.name} here: it is taken for "
                    f"{driver.amount(driver.reference)}, and at {driver.amount(driver.farthest)} headings are "
                    f"off by up to {figures(cost)}° (at any attitude, dip {DIP_DEG:.0f}°)"
                )

    def _loses(self, calibration: Calibration) -> bool:
        """Whether the matrix has more to it than the target holds."""
        matrix = calibration.matrix if acting(self.acts, calibration) == "mapped" else in_recorded_axes(calibration)[0]
        kept = {
            "all": matrix,
            "symmetric": matrix.T,
            "diagonal": np.diag(np.diag(matrix)),
            "offset": np.eye(3) * matrix[0, 0],
        }[self.keeps]
        return bool(np.abs(matrix - kept).max() > EXACT * np.abs(matrix).max())

    def _warnings(self, deviation: Deviation, lacks: str) -> Iterable[str]:
        """What it costs, and what nobody could verify."""
        if lacks:
            yield (
                f"{lacks}: what is left out costs up to {figures(deviation.heading_deg)}° of heading (at any attitude, "
                f"dip {DIP_DEG:.0f}°)"
            )
        for clause in self.unverified:
            yield f"not verified: {clause}"

    def _errors_in(self, calibration: Calibration) -> tuple[float, str]:
        """The unit in which errors are told: its size in that of the calibration, and its name."""
        if self.errors_in:
            return per_unit(calibration, self.errors_in, who=self.title), self.errors_in
        return 1.0, calibration.unit

    def _figures(self, calibration: Calibration, deviation: Deviation) -> dict[str, Any]:
        """How far the target is off, for programs."""
        size, unit = self._errors_in(calibration)
        return {
            "vectors": deviation.vectors,
            "unit": unit,
            "field": calibration.field_strength / size,
            "worst": deviation.worst / size,
            "worst_deg": deviation.worst_deg,
            "heading_deg": deviation.heading_deg,
        }

    def _checked(self, calibration: Calibration, deviation: Deviation) -> str:
        """How far the target is off, in words."""
        size, name = self._errors_in(calibration)
        unit, scaled = label(name), ", scaled," if self.lengths else ""
        return (
            f"checked: its own formula{scaled} on {deviation.vectors} fields of "
            f"{figures(calibration.field_strength / size, 4)} {unit}, "
            f"{_at_most(deviation.worst / size, deviation.worst_deg, unit)} off the calibration"
        )

    def _notes(self, calibration: Calibration) -> Iterable[str]:
        """For which readings the numbers are right, and what comes out."""
        if self.lengths:
            yield f"corrected readings are {self.lengths}"
        else:
            strength = calibration.field_strength / self._size_given(calibration)
            relative = "" if calibration.field_strength_known else ", which is relative: no field strength was given"
            unit = _named(self.gives or self.unit, calibration)
            yield f"corrected readings are {figures(strength, 4)} {unit} long{relative}"
        yield from self._of_the_axes(calibration)

    def _of_the_axes(self, calibration: Calibration) -> Iterable[str]:
        """In which axes readings go in, and what is left to do to those that come out."""
        if calibration.frame == VEHICLE:
            yield "for readings in the axes of the vehicle, after the mounting, as they were recorded"
            if acting(self.acts, calibration) == "recorded" and not calibration.axes.is_identity:
                yield f"acts in those axes, not in those they were mapped to by {calibration.axes}"
        elif calibration.axes.is_identity:
            if self.acts == "mapped":
                yield "acts after the mounting: the recording must be in the axes of the vehicle or board"
        elif self.acts == "recorded":
            yield f"acts in the sensor's own axes: go on mapping them to {calibration.axes} afterwards"
        elif self.acts == "mapped":
            yield f"acts after the mounting, which must map the sensor's axes to {calibration.axes}"
        if self.acts == "across" and not calibration.axes.is_identity:
            yield f"the mapping of axes to {calibration.axes} is in the matrix: give readings as they were recorded"

    def _unit(self, calibration: Calibration) -> str:
        return _named(self.unit, calibration)


def _named(unit: str, calibration: Calibration) -> str:
    """What a unit of a sheet is called for this calibration."""
    return {OWN: calibration.unit, RECORDED: calibration.raw.name}.get(unit, unit)


def _at_most(worst: float, worst_deg: float, unit: str) -> str:
    """Write the errors; what is next to nothing only as that, since it differs from machine to machine."""
    if max(worst, worst_deg) < NEXT_TO_NOTHING:
        return f"less than {NEXT_TO_NOTHING} {unit} and {NEXT_TO_NOTHING}°"
    return f"at most {figures(max(worst, NEXT_TO_NOTHING))} {unit} and {figures(max(worst_deg, NEXT_TO_NOTHING))}°"


def plain_ascii(text: str) -> str:
    r"""Write text in printable ASCII, other characters by their code.

    >>> plain_ascii("48 µT, café\x07\u2028")
    '48 uT, caf\\xe9\\x07\\u2028'
    """
    return "".join(
        sign if sign.isascii() and sign.isprintable() else sign.encode("unicode_escape").decode()
        for sign in text.translate(ASCII)
    )


def digits(value: float, suffix: str = "") -> str:
    """Write a number of single precision so that it is read back the same, with a point.

    >>> digits(0.1), digits(-3.0, "f"), digits(1e-12)
    ('0.100000001', '-3.0f', '9.99999996e-13')
    """
    text = f"{np.float32(value) + np.float32(0):.9g}"
    return f"{text if any(sign in text for sign in '.en') else f'{text}.0'}{suffix}"
