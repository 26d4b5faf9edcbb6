"""A target: how it uses a calibration, what it has room for, who writes its file and who reads it back.

Each module here is a target or a family of them, with a row for each at its end. A row runs the target's own formula on
what is written, and says what that costs.

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> halves = Target(
...     name="halves", use="half of the offset", suffix=".txt", title="A toy", formula="c = m - b / 2", unit="uT",
...     keeps="all", storage="decimal", source="nobody",
...     write=lambda found, asked: Written(lambda raw: raw - found.offset / 2, [str(found.offset[0] / 2)], {}),
... )
>>> halves.render(Calibration([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0.2, 0, 0], 50.0, raw=Unit.of("uT"))).checked
'checked: its own formula on 400 fields of 50.00 µT, at most 0.10 µT and 0.11° off the calibration'
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias

import numpy as np

from flinders.core.units import label
from flinders.errors import figures
from flinders.targets._affine import OWN, RECORDED, VEHICLE, Acts, acting, in_recorded_axes, per_unit, refuse_mounted
from flinders.targets._autopilot import followed
from flinders.targets._export import DIP_DEG, NOTHING_MORE, Difference, Export, ExportOptions, Written
from flinders.targets._text import HASH, Comment

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.disturbance import Disturbance

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

NEXT_TO_NOTHING: Final = 0.0001
EXACT: Final = 1e-9
"""A matrix is of a kind to within this share of its largest entry: products of matrices are rounded."""


@dataclass(frozen=True, slots=True)
class TargetReader:
    """How a target's file is read back.

    Attributes
    ----------
    mark : bytes
        Regular expression that the first bytes of such a file match, and those of other targets do not.
    read : callable
        ``read(content, source, strength=…)`` gives the calibration: of the bytes of a file, with its name for messages
        and the length of corrected readings, which goes before what the file says of it; in µT, in counts for files in
        counts. It takes ``compass`` where there is `which`.
    saved : str
        What the tool itself saves that can be read, in words.
    which : callable, optional
        ``which(content, source, compass)`` gives number and device id of the compass that is read, of several.
    """

    mark: bytes
    read: Callable[..., Calibration]
    saved: str
    which: Callable[[bytes, str, int | None], tuple[int, int | None]] | None = None

    def sniff(self, head: bytes) -> bool:
        """Whether the first bytes may be those of such a file."""
        return re.search(self.mark, head) is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """One row of the table of targets.

    Attributes
    ----------
    name : str
        What `find` and ``--to`` look for.
    use : str
        What it writes, for people.
    suffix : str
        Ending of such a file.
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
    write : callable
        ``write(calibration, asked)`` gives the calibration in the numbers of the target.
    reader : TargetReader, optional
        Where such a file can be read back.
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
    docs : str
        The page that tells about it.
    compasses : range, optional
        Numbers of the compasses that it keeps; with them it takes ``--compass``.
    named : bool
        Names in it stand in a program beside those of others, and it takes ``--name``.
    """

    name: str
    use: str
    suffix: str
    title: str
    formula: str
    unit: str
    keeps: Keeps
    storage: str
    source: str
    write: Callable[[Calibration, ExportOptions], Written]
    reader: TargetReader | None = None
    acts: Acts = "recorded"
    fed: bool = False
    follows: Literal["", "motors", "all"] = ""
    lengths: str = ""
    gives: str = ""
    errors_in: str = ""
    unverified: tuple[str, ...] = ()
    comment: Comment | None = HASH
    docs: str = "targets.md"
    compasses: range | None = None
    named: bool = False

    @property
    def where(self) -> str:
        """In which axes it works, in words."""
        return WHERE[self.acts]

    @property
    def holds(self) -> str:
        """What it has room for, in words."""
        return HOLDS[self.keeps]

    @property
    def family(self) -> str:
        """What targets in the same numbers have in common: ``px4`` of px4-shell."""
        return self.name.partition("-")[0]

    @property
    def refuses_mounted(self) -> bool:
        """Whether it refuses readings in the axes of the vehicle: it acts before the mounting, on what it reads."""
        return self.acts == "recorded" and not self.fed

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "use": self.use,
            "suffix": self.suffix,
            "formula": self.formula,
            "unit": self.unit,
            "holds": self.holds,
            "axes": self.where,
            "storage": self.storage,
            "source": self.source,
            "unverified": self.unverified,
            "import": self.reader is not None,
            "docs": self.docs,
        }

    def render(
        self, calibration: Calibration, *, about: Sequence[str] = (), asked: ExportOptions = NOTHING_MORE
    ) -> Export:
        """Write a calibration for the target, and try the target's own formula on what is written.

        Parameters
        ----------
        calibration : Calibration
        about : sequence of str
            Lines that tell where it comes from.
        asked : ExportOptions
            Which compass, and what else there is to choose.

        Raises
        ------
        UnitError
            Where counts would have to become a unit, or the other way round.
        NotExportable
            For what the target cannot hold, what costs more than a degree of heading unless that was asked for, and
            readings in other axes than those in which it acts.
        UsageError
            For a compass that there is not, or a name that cannot be written.
        """
        if self.refuses_mounted:
            refuse_mounted(calibration, who=self.title)
        written = self.write(calibration, asked)
        plain, motor = followed(calibration) if self.follows == "motors" else (calibration.at(), None)
        lacks = f"{self.title} holds {self.holds}" if self._loses(plain) else ""
        deviation = self._tried(plain, written.apply, lacks=lacks, lossy=asked.lossy)
        if motor is not None and (compensated := written.compensated) is not None:
            end = motor.farthest
            far = calibration.at(**{motor.name: end})
            tried = self._tried(far, lambda raw: compensated(raw, end), lacks=lacks, lossy=asked.lossy)
            deviation = deviation.worse(tried)
        warnings = (*self._warnings(deviation, lacks), *self._left_out(calibration, motor))
        return self._laid_out(plain, written, deviation, about, warnings)

    def _laid_out(
        self,
        plain: Calibration,
        written: Written,
        deviation: Difference,
        about: Sequence[str],
        warnings: tuple[str, ...],
    ) -> Export:
        """The file with its comments, and the same for programs."""
        unit, checked = _named(self.unit, plain), self._checked(plain, deviation)
        notes = [*about, *self._notes(plain), *written.notes]
        remarks = [f"{self.title}: {self.formula}, in {unit}", *notes, *warnings, checked]
        comments = self.comment.lines(remarks) if self.comment else []
        fields = {
            "target": self.name,
            "formula": self.formula,
            "unit": unit,
            "axes": self.where,
            "holds": self.holds,
            "values": dict(written.values),
            "checked": self._figures(plain, deviation),
            "notes": notes,
            "unverified": list(self.unverified),
        }
        text = "\n".join([*comments, *written.body, ""])
        return Export(self.name, text, fields, checked, warnings, written.data, has_comments=bool(comments))

    def _tried(
        self, calibration: Calibration, apply: Callable[[Floats], Floats], *, lacks: str, lossy: bool
    ) -> Difference:
        """Run the target's formula in its units."""
        size = per_unit(calibration, self.unit, who=self.title)
        gives = self._size_given(calibration)
        return Difference.of(
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

    def _left_out(self, calibration: Calibration, motor: Disturbance | None) -> Iterable[str]:
        """What a target costs that does not follow what the calibration follows."""
        if self.follows == "all":
            return
        for disturbance in calibration.disturbances:
            if motor is None or disturbance.name != motor.name:
                cost = min(calibration.disturbance_deg(disturbance, dip_deg=DIP_DEG), 180.0)
                yield (
                    f"{self.title} does not follow {disturbance.name} here: it is taken for "
                    f"{disturbance.amount(disturbance.reference)}, and at {disturbance.amount(disturbance.farthest)} "
                    f"headings are off by up to {figures(cost)}° (at any attitude, dip {DIP_DEG:.0f}°)"
                )

    def _loses(self, calibration: Calibration) -> bool:
        """Whether the matrix has more to it than the target holds."""
        matrix = calibration.matrix if acting(self.acts, calibration) == "mapped" else in_recorded_axes(calibration)[0]
        reduced = {
            "all": matrix,
            "symmetric": matrix.T,
            "diagonal": np.diag(np.diag(matrix)),
            "offset": np.eye(3) * matrix[0, 0],
        }[self.keeps]
        return bool(np.abs(matrix - reduced).max() > EXACT * np.abs(matrix).max())

    def _warnings(self, deviation: Difference, lacks: str) -> Iterable[str]:
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

    def _figures(self, calibration: Calibration, deviation: Difference) -> dict[str, Any]:
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

    def _checked(self, calibration: Calibration, deviation: Difference) -> str:
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


def _named(unit: str, calibration: Calibration) -> str:
    """What a unit of a target is called for this calibration."""
    return {OWN: calibration.unit, RECORDED: calibration.raw.name}.get(unit, unit)


def _at_most(worst: float, worst_deg: float, unit: str) -> str:
    """Write the errors; what is next to nothing only as that, since it differs from machine to machine."""
    if max(worst, worst_deg) < NEXT_TO_NOTHING:
        return f"less than {NEXT_TO_NOTHING} {unit} and {NEXT_TO_NOTHING}°"
    return f"at most {figures(max(worst, NEXT_TO_NOTHING))} {unit} and {figures(max(worst_deg, NEXT_TO_NOTHING))}°"
