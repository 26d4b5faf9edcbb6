"""Notes on readings, their calibration and headings: codes with named values, and the sentences that these make.

>>> tilt = Note("tilt-cost", values={"cost": 1.73})
>>> tilt
Note(code='tilt-cost', severity='note', values={'cost': 1.73})
>>> print(tilt)
each degree of tilt turns a level heading by up to 1.7°
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal

from flinders.errors import in_python
from flinders.readers._likeness import looks_like

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from flinders.errors import Spelling

SENTENCES: Final[Mapping[str, str]] = {
    "stuck": "never changes in {readings:,} readings: {axes}. Check the wiring and the columns",
    "unsuited": (
        "these readings do not suit the calibration: corrected, their strength is {strength:.3f} of its field and "
        "spreads by {spread:.1%}, and {limit:.1%} would be much: iron or currents have come or gone, or it is for "
        "another sensor, unit or place; see flinders check, or calibrate again"
    ),
    "odd-strength": (
        "Under this calibration the readings are {mean:.3f} times as long as its field, with a spread of {spread:.1%}: "
        "it may be that of another sensor, or something has changed since. flinders check tells more."
    ),
    "other-recording": (
        "The recording shown is not one that the calibration was made from: what is claimed is that of its file, what "
        "is drawn is this recording."
    ),
    "weak-field": "{words}",
    "no-heading": "no reading has a heading: the acceleration is zero or missing, or x is vertical",
    "without-heading": "{readings} without a heading (nan): a number is missing, or x is vertical",
    "tilt-cost": "each degree of tilt turns a level heading by up to {cost:.1f}°",
    "tilted": "the sensor was tilted, as the vertical field shows: record an accelerometer, and leave {level} out",
    "z-up": (
        "the vertical field points along −z: z is up and level headings run backwards, unless the site is in the "
        "other hemisphere ({dip_deg}): calibrate with {axes} x,-y,-z"
    ),
    "an3192": "an3192 is wrong where roll and pitch come together, by 10° at 20° of each: use exact",
    "accelerated": "in {share:.0%} of the readings the acceleration was not that of gravity: their tilt is off",
    "foreign-accelerometer": (
        "the dip of the field wanders by {scatter_deg:.0f}° with the attitude: the accelerometer never changes, or is "
        "that of another body"
    ),
    "dip-upward": (
        "the field is seen to point up by {up_deg:.0f}°. South of the magnetic equator that is right: say so with "
        "{site} LATITUDE,LONGITUDE or {dip_deg} -{up_deg:.0f}. North of it the acceleration has the opposite sign, and "
        "headings run backwards: {turn}"
    ),
    "dip-off-model": (
        "the dip is {difference_deg:+.1f}° off the model: iron nearby, an accelerometer that is not calibrated, or "
        "sensors that do not sit square to each other"
    ),
    "mounting-unobserved": "a constant mounting error does not show: compare with a known heading",
}
"""Formats of the values of each code but ``looks-like``, and of the arguments of `ARGUMENTS`, as an interface spells
them."""

ARGUMENTS: Final = ("level", "dip_deg", "axes", "site", "acceleration_axes")
"""Arguments that sentences name."""


@dataclass(frozen=True, slots=True)
class Note:
    """Something to know about readings, their calibration or headings; a subclass has sentences of its own."""

    sentences: ClassVar[Mapping[str, str]] = SENTENCES
    arguments: ClassVar[tuple[str, ...]] = ARGUMENTS

    code: str  #: stable name: ``looks-like``, or one of `sentences`
    severity: Literal["limits", "note"] = "note"  #: ``limits``: they hold with limits; ``note``: good to know
    values: Mapping[str, Any] = field(default_factory=dict)  #: numbers and names that the sentence takes

    def words(self, spell: Spelling = in_python) -> str:
        """The sentence, with arguments as an interface spells them."""
        if self.code == "looks-like":
            return looks_like(self.values["what"], spell({"columns": self.values["columns"]}))
        names = {name: spell({name: None}).rstrip("=") for name in self.arguments}
        if self.code == "dip-upward":
            names["turn"] = _turn(self.values["axes_needed"], names["acceleration_axes"])
        return self.sentences[self.code].format_map({**names, **self.values})

    def __str__(self) -> str:
        return self.words()


def _turn(axes: str, option: str) -> str:
    """How the acceleration has to be turned; `axes` is empty where it has to be left as it is."""
    return f"give {option}={axes}" if axes else f"leave {option} out"


def limits_in_codes(notes: Iterable[Note]) -> str:
    """The codes of those notes that limit what holds, for a line; empty where none does."""
    codes = [note.code for note in notes if note.severity == "limits"]
    return f"limited by {', '.join(codes)}" if codes else ""


def limits_of(notes: Iterable[Note], spell: Spelling = in_python) -> list[str]:
    """The sentences of those notes that limit what holds."""
    return [note.words(spell) for note in notes if note.severity == "limits"]
