"""Notes on readings, calibrations and headings: codes with named values, and the sentences made from these.

>>> tilt = Note("tilt-cost", values={"cost": 1.73})
>>> tilt
Note(code='tilt-cost', severity='note', values={'cost': 1.73})
>>> print(tilt)
each degree of tilt turns a level heading by up to 1.7°
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal

from flinders.errors import python_arguments
from flinders.readers._likeness import looks_like

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from flinders.errors import Spelling

SENTENCES: Final[Mapping[str, str]] = {
    "stuck": "never changes in {readings:,} readings: {axes}. Check the wiring and the columns",
    "unsuited": (
        "these readings do not suit the calibration: the corrected strength is {strength:.3f} of its field and "
        "spreads by {spread:.1%}, more than the limit of {limit:.1%}: iron or currents were added or removed, or the "
        "calibration is for another sensor, unit or place; see flinders check, or calibrate again"
    ),
    "odd-strength": (
        "Under this calibration the readings are {mean:.3f} times as long as its field, with a spread of {spread:.1%}: "
        "it may be that of another sensor, or something has changed since. Use flinders check."
    ),
    "other-recording": (
        "The calibration was not made from the recording shown: claims are those of its file, drawings are of this "
        "recording."
    ),
    "weak-field": "{words}",
    "no-heading": "no reading has a heading: the acceleration is zero or missing, or x is vertical",
    "without-heading": "{readings} without a heading (nan): a number is missing, or x is vertical",
    "tilt-cost": "each degree of tilt turns a level heading by up to {cost:.1f}°",
    "tilted": "the sensor was tilted, as the vertical field shows: record an accelerometer, and leave {level} out",
    "z-up": (
        "the vertical field points along −z: z is up and level headings are reversed, unless the site is in the "
        "other hemisphere ({dip_deg}): calibrate with {axes} x,-y,-z"
    ),
    "an3192": "an3192 is wrong with both roll and pitch, by 10° at 20° of each: use exact",
    "accelerated": "in {share:.0%} of the readings the acceleration was not that of gravity: their tilt is wrong",
    "foreign-accelerometer": (
        "the dip of the field varies by {scatter_deg:.0f}° with the attitude: the accelerometer is constant, or is "
        "that of another body"
    ),
    "dip-upward": (
        "the measured field points up by {up_deg:.0f}°. South of the magnetic equator that is right: state it with "
        "{site} LATITUDE,LONGITUDE or {dip_deg} -{up_deg:.0f}. North of it the acceleration has the opposite sign, and "
        "headings are reversed: {turn}"
    ),
    "dip-off-model": (
        "the dip differs by {difference_deg:+.1f}° from the model: iron nearby, an uncalibrated accelerometer, or "
        "sensors whose axes are not aligned"
    ),
    "mounting-unobserved": "a constant mounting error does not show: compare with a known heading",
}
"""Sentences by code, with placeholders for values and for `ARGUMENTS`. The code ``looks-like`` has no sentence."""

ARGUMENTS: Final = ("level", "dip_deg", "axes", "site", "acceleration_axes")
"""Arguments in sentences; each interface writes them in its own form."""


@dataclass(frozen=True, slots=True)
class Note:
    """A note on readings, a calibration or headings; subclasses have other sentences."""

    sentences: ClassVar[Mapping[str, str]] = SENTENCES
    arguments: ClassVar[tuple[str, ...]] = ARGUMENTS

    code: str  #: stable name: ``looks-like``, or one of `sentences`
    severity: Literal["limits", "note"] = "note"  #: ``limits`` if it limits the result, else ``note``
    values: Mapping[str, Any] = field(default_factory=dict)  #: numbers and names for the sentence

    def words(self, spell: Spelling = python_arguments) -> str:
        """The sentence, with arguments in the form of an interface."""
        if self.code == "looks-like":
            return looks_like(self.values["what"], spell({"columns": self.values["columns"]}))
        names = {name: spell({name: None}).rstrip("=") for name in self.arguments}
        if self.code == "dip-upward":
            names["turn"] = _axes_advice(self.values["axes_needed"], names["acceleration_axes"])
        return self.sentences[self.code].format_map({**names, **self.values})

    def __str__(self) -> str:
        return self.words()


def _axes_advice(axes: str, option: str) -> str:
    """Advice on the axes of the acceleration; `axes` is empty if the recorded axes are right."""
    return f"give {option}={axes}" if axes else f"leave {option} out"


def limits_in_codes(notes: Iterable[Note]) -> str:
    """Codes of the limiting notes, in one line; empty without any."""
    codes = [note.code for note in notes if note.severity == "limits"]
    return f"limited by {', '.join(codes)}" if codes else ""


def limits_of(notes: Iterable[Note], spell: Spelling = python_arguments) -> list[str]:
    """Sentences of the limiting notes."""
    return [note.words(spell) for note in notes if note.severity == "limits"]
