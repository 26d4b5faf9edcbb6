"""A target: how it uses a calibration, what it has room for, who writes its file and who reads it back.

Each module here is a target or a family of them, with a row for each at its end. A row runs the target's own formula on
what is written, and says what that costs. Most write a matrix and an offset in their own unit and axes, `Affine`.

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> halves = Target(
...     name="halves", use="half of the offset", suffix=".txt", title="A toy", formula="c = m - b / 2", unit="uT",
...     keeps="all", storage="decimal", source="nobody",
...     write=lambda given, asked: Written(lambda raw: raw - given.offset / 2, [str(given.offset[0] / 2)], {}),
... )
>>> halves.render(Calibration([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0.2, 0, 0], 50.0, raw=Unit.of("uT"))).checked
'checked: its own formula on 400 fields of 50.00 µT, at most 0.10 µT and 0.11° off the calibration'
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np

from flinders.core.short_repr import ShortRepr
from flinders.core.units import label
from flinders.errors import NotExportable, figures
from flinders.targets._comments import HASH, Comment
from flinders.targets._difference import DIP_DEG, DIRECTIONS, LOSS_DEG, Difference, corrected_by
from flinders.targets._numbers import (
    OWN,
    RECORDED,
    VEHICLE,
    Acts,
    acting,
    followed,
    in_recorded_axes,
    in_sensor_axes,
    per_unit,
    refuse_mounted,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.disturbance import Disturbance
    from flinders.targets._heading_model import HeadingModel
    from flinders.targets._inertial import InertialForm
    from flinders.targets._measurement_noise import MeasurementNoise
    from flinders.targets._mounting import MountingTable

Keeps: TypeAlias = Literal["all", "symmetric", "diagonal", "offset", "rotation", "axes"]
HOLDS: Final[Mapping[Keeps, str]] = {
    "all": "an offset and a whole matrix",
    "symmetric": "an offset and a symmetric matrix",
    "diagonal": "an offset and a diagonal, no soft iron beside it",
    "offset": "an offset and no soft iron",
    "rotation": "a mounting and no calibration",
    "axes": "a mounting by right angles and no calibration",
}
MOUNTINGS: Final = ("rotation", "axes")
"""Kinds that hold how the sensor sits, and leave the correction to the program before them."""
WHERE: Final[Mapping[Acts, str]] = {
    "recorded": "the sensor's own, before its mounting",
    "mapped": "those of the vehicle or board, after the mounting",
    "across": "readings as recorded in, the calibration's axes out",
}
NEXT_TO_NOTHING: Final = 0.0001
EXACT: Final = 1e-9
"""A matrix is of a kind to within this share of its largest entry: products of matrices are rounded."""
EXACT_SINGLE: Final = 1e-6
"""A matrix that float32 has rounded is of a kind to within this share of its largest entry."""

CHANCE: Final = 1e-4
"""How often a clean reading is beyond a limit of `Gates`, at most."""
SIGMAS: Final = NormalDist().inv_cdf(1.0 - CHANCE / 2.0)
"""The limits, in standard deviations."""
TILT_DEG: Final = 1.0
"""1 σ of the vertical that firmware takes from its accelerometer, about each axis."""


@dataclass(frozen=True, slots=True)
class Gates:
    """Limits of a corrected reading that nothing disturbs: firmware can tell a disturbed one by them."""

    strength_limit: float  # how far its length may be off the field strength, in the calibration's unit
    # the dip, and how far the angle to the horizon may be off it; NaN where that cannot be told
    dip_deg: float = math.nan
    dip_limit_deg: float = math.nan

    @property
    def has_dip(self) -> bool:
        """There is a limit of dip."""
        return not math.isnan(self.dip_limit_deg)


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """What is asked of a target besides the calibration."""

    compass: int | None = None  # which one, as the target counts; its first where it is not given
    lossy: bool = False  # write also what leaves out more than 0.5° of heading
    # (3, 3): how the compass was mounted when it was recorded, vehicle = R sensor; None where that is not known
    mounting: Floats | None = None
    rotation_covariance: Floats | None = None  # (3, 3) rad², in the body's axes: of how the sensor sits
    gates: Gates | None = None  # limits by which generated code tells a disturbed reading
    noise: MeasurementNoise | None = None  # what a filter has to assume of corrected readings
    heading: HeadingModel | None = None  # by which generated code states the error of each heading
    estimator: bool = False  # write that also as parameters of the vehicle's estimator
    # of the sensor: names in generated code begin with it, so that code for two sensors goes into one program
    name: str | None = None
    fitting: str = ""  # the command that makes a fit of what the target holds, if there is one


@dataclass(frozen=True, slots=True, eq=False)
class Written:
    """A calibration in the numbers of a target."""

    apply: Callable[[Floats], Floats]  # the target's formula with the numbers as it will hold them, in its units
    body: Sequence[str]  # lines of the file
    values: Mapping[str, Any]  # what is written, for programs
    notes: Sequence[str] = ()  # what else to know
    data: bytes | None = None  # content of the file, where it is no text
    # ``compensated(readings, value)``: the formula at a value of the motors' current or throttle
    compensated: Callable[[Floats, float], Floats] | None = None
    # (3, 3): rotation of the calibration that is in the mounting which is written, in the recorded axes
    turn: Floats | None = None
    formula: str = ""  # by which the numbers are used, where that is not the target's usual one
    # what the numbers stand for, where the mounting that was found is taken for one by right angles
    meant: Calibration | None = None
    is_partial: bool = False  # a mounting that is not by right angles was written as the nearest that is


@dataclass(frozen=True, slots=True, repr=False)
class Export(ShortRepr):
    """A calibration as a target wants it."""

    target: str  # name of the target
    text: str  # content of the file; of one in bytes, what is in it, for people
    fields: dict[str, Any]  # the same for programs, ready for JSON
    checked: str  # how far it is off, in words
    warnings: tuple[str, ...] = ()  # what to see to before it is used
    data: bytes | None = None  # content of the file where it is no text
    has_comments: bool = True  # the text says what is known of it in comments; otherwise that has to be said elsewhere

    @property
    def content(self) -> str | bytes:
        """Content of the file."""
        return self.text if self.data is None else self.data


@dataclass(frozen=True, slots=True)
class TargetReader:
    """How a target's file is read back."""

    mark: bytes  #: regular expression that the first bytes of such a file match, and those of other targets do not
    #: ``read(content, source, strength=…)`` gives the calibration: of the bytes of a file, with its name for messages
    #: and the length of corrected readings, which goes before what the file says of it; in µT, in counts for files in
    #: counts. It takes ``compass`` where there is `which`
    read: Callable[..., Calibration]
    saved: str  #: what the tool itself saves that can be read, in words
    #: ``which(content, source, compass)`` gives number and device id of the compass that is read, of several
    which: Callable[[bytes, str, int | None], tuple[int, int | None]] | None = None
    #: ``states(content, source)`` gives lines on what the file states beside the calibration
    states: Callable[[bytes, str], list[str]] | None = None

    def sniff(self, head: bytes) -> bool:
        """Whether the first bytes may be those of such a file."""
        return re.search(self.mark, head) is not None


class Limit(NamedTuple):
    """A parameter that a target takes between two values only."""

    name: str
    quantity: str  # ``offset``, ``matrix``, ``scale`` (mean of its diagonal), or ``iron`` (matrix over scale)
    places: tuple[int, ...]  # in it, row after row; of several, the length is meant
    low: float
    high: float
    unit: float = 1.0  # µT in one of its numbers


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """One row of the table of targets."""

    name: str  #: what `find` and ``--to`` look for
    use: str  #: what it writes, for people
    suffix: str  #: ending of such a file
    title: str  #: its name, for people
    formula: str  #: by which it uses the numbers
    unit: str  #: of the readings that it corrects: a name of `units`, ``own`` or ``recorded``
    keeps: Keeps  #: what it holds; a key of `HOLDS`
    storage: str  #: how numbers are kept, and their range
    source: str  #: where that stands
    #: ``write(calibration, asked)`` gives the calibration in the numbers of the target
    write: Callable[[Calibration, ExportOptions], Written]
    reader: TargetReader | None = None  #: where such a file can be read back
    acts: Acts = "recorded"  #: a key of `WHERE`
    fed: bool = False  #: the program around it chooses which readings it corrects: they may be those of the vehicle
    #: which disturbances it has room for: none, one of current and throttle (``motors``), or all
    follows: Literal["", "motors", "all"] = ""
    linearizes: bool = False  #: it has room for the linearization of axes
    #: how long corrected readings are, where that is the target's own; empty where it is the calibration's
    lengths: str = ""
    gives: str = ""  #: unit of what comes out, where it is another
    #: unit in which its errors are told, where that of the calibration says little beside its steps
    errors_in: str = ""
    unverified: tuple[str, ...] = ()  #: what nobody could verify, a clause each
    comment: Comment | None = HASH  #: None where the file has no room for comments
    docs: str = "targets.md"  #: the page that tells about it
    compasses: range | None = None  #: numbers of the compasses that it keeps; with them it takes ``--compass``
    named: bool = False  #: names in it stand in a program beside those of others, and it takes ``--name``
    mountings: MountingTable | None = None  #: those that it can be given; with them it takes ``--mounting``
    limits: tuple[Limit, ...] = ()  #: of its parameters
    inertial: InertialForm | None = None  #: how it holds an accelerometer and a gyro too
    estimator: str = ""  #: the estimator beside it that takes the noise of a compass; with one it takes ``--noise``

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
        """What targets in the same numbers have in common: ``adafruit`` of adafruit-eeprom."""
        return self.name.partition("-")[0]

    @property
    def refuses_mounted(self) -> bool:
        """Whether it needs the sensor's own axes: it acts before the mounting, on what it reads, or is the mounting."""
        return (self.acts == "recorded" and not self.fed) or self.keeps in MOUNTINGS

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "use": self.use,
            "suffix": self.suffix,
            "formula": self.formula,
            "unit": self.unit,
            "holds": self.holds,
            "axes": self.where,  # axes that it corrects
            "storage": self.storage,
            "source": self.source,
            "unverified": self.unverified,
            "import": self.reader is not None,  # whether `flinders import` reads it back
            "docs": self.docs,
        }

    def render(
        self, calibration: Calibration, *, about: Sequence[str] = (), asked: ExportOptions | None = None
    ) -> Export:
        """Write a calibration for the target; `about`: lines that tell where it comes from, and the rest as `tried`."""
        return self.tried(calibration, asked=asked).export(about)

    def tried(self, calibration: Calibration, *, asked: ExportOptions | None = None) -> Trial:
        """Put a calibration in the numbers of the target, and try the target's own formula on them.

        `asked`: which compass, and what else there is to choose. Raises `UnitError` where counts would have to become a
        unit, or the other way round; `NotExportable` for what the target cannot hold, what costs more than 0.5° of
        heading unless that was asked for, and readings in other axes than those in which it acts; `UsageError` for a
        compass that there is not, or a name that cannot be written.
        """
        asked = asked or ExportOptions()
        given = calibration.frame
        calibration = self._before_the_mounting(calibration, asked.mounting)
        turn = asked.mounting if calibration.frame != given else None
        if calibration.linearization is not None and not self.linearizes:
            raise NotExportable(
                f"the calibration linearizes its axes, and {self.title} holds {self.holds}: use c, arduino or "
                "micropython, or calibrate without",
                hint={"linearize": None},
                beyond=("linearization",),
            )
        written = self.write(calibration, asked)
        plain, motor = followed(calibration) if self.follows == "motors" else (calibration.at(), None)
        plain = written.meant or plain
        lacks = f"{self.title} holds {self.holds}" if self._loses(plain, written) else ""
        deviation = self._tried(plain, written.apply, lacks=lacks, asked=asked)
        if motor is not None and (compensated := written.compensated) is not None:
            end = motor.farthest
            far = calibration.at(**{motor.name: end})
            tried = self._tried(far, lambda raw: compensated(raw, end), lacks=lacks, asked=asked)
            deviation = deviation.worse(tried)
        warnings = (*self._warnings(deviation, lacks, asked.fitting), *self._left_out(calibration, motor))
        return Trial(self, plain, written, deviation, bool(lacks), warnings, turn)

    def _before_the_mounting(self, calibration: Calibration, mounting: Floats | None) -> Calibration:
        """The calibration in the sensor's own axes, for a target that corrects those; `NotExportable` where unknown."""
        if not self.refuses_mounted or calibration.frame != VEHICLE:
            return calibration
        if mounting is None:
            refuse_mounted(calibration, who=self.title)
        return in_sensor_axes(calibration, np.asarray(mounting))

    def corrected(self, calibration: Calibration, apply: Callable[[Floats], Floats], directions: Floats) -> Floats:
        """(N, 3) fields over their strength, as a formula in its units corrects what is read in (N, 3) directions."""
        size, given = per_unit(calibration, self.unit, who=self.title), self._size_given(calibration)
        acts, relative = acting(self.acts, calibration), bool(self.lengths)
        return corrected_by(
            calibration, lambda raw: given * apply(raw / size), directions, acts=acts, relative=relative
        )

    def _tried(
        self, calibration: Calibration, apply: Callable[[Floats], Floats], *, lacks: str, asked: ExportOptions
    ) -> Difference:
        """Run the target's formula in its units, and refuse what costs too much."""
        deviation = Difference.of(calibration, self.corrected(calibration, apply, DIRECTIONS))
        if lacks:
            takes_turn = calibration.rotation != "symmetric" and self.keeps not in MOUNTINGS
            mountings = self.mountings if takes_turn else None
            deviation.refuse_lost(lacks, lossy=asked.lossy, mountings=mountings, fitting=asked.fitting)
        else:
            deviation.refuse_coarse(calibration, lossy=asked.lossy)
        return deviation

    def _size_given(self, calibration: Calibration) -> float:
        """What one unit of a corrected reading is, in the unit of the calibration."""
        return per_unit(calibration, self.gives or self.unit, who=self.title)

    def _left_out(self, calibration: Calibration, motor: Disturbance | None) -> Iterable[str]:
        """What the disturbances cost that a target does not follow."""
        for disturbance in calibration.disturbances if self.follows != "all" else ():
            if motor is None or disturbance.name != motor.name:
                yield not_followed(calibration, disturbance, f"{self.title} does not follow {disturbance.name} here")

    def _loses(self, calibration: Calibration, written: Written) -> bool:
        """Whether the matrix has more to it than the target holds beside a rotation in its mounting."""
        if self.keeps in MOUNTINGS:
            return written.is_partial
        turn = written.turn
        matrix = calibration.matrix if acting(self.acts, calibration) == "mapped" else in_recorded_axes(calibration)[0]
        if turn is not None:
            matrix = turn.T @ matrix
        reduced = {
            "all": matrix,
            "symmetric": matrix.T,
            "diagonal": np.diag(np.diag(matrix)),
            "offset": np.eye(3) * matrix[0, 0],
        }[self.keeps]
        exact = EXACT if turn is None else EXACT_SINGLE
        return bool(np.abs(matrix - reduced).max() > exact * np.abs(matrix).max())

    def _warnings(self, deviation: Difference, lacks: str, fitting: str) -> Iterable[str]:
        """What it costs, and what nobody could verify."""
        if lacks:
            fitted = f"; a fit of what it holds: {fitting}" if fitting and deviation.heading_deg > LOSS_DEG else ""
            yield (
                f"{lacks}: what is left out costs up to {figures(deviation.heading_deg)}° of heading (at any attitude, "
                f"dip {DIP_DEG:.0f}°){fitted}"
            )
        for clause in self.unverified:
            yield f"not verified: {clause}"

    def _errors_in(self, calibration: Calibration) -> tuple[float, str]:
        """The unit in which errors are told: its size in that of the calibration, and its name."""
        if self.errors_in:
            return per_unit(calibration, self.errors_in, who=self.title), self.errors_in
        return 1.0, calibration.unit

    def as_figures(self, calibration: Calibration, deviation: Difference) -> dict[str, Any]:
        """How far the target is off, for programs."""
        size, unit = self._errors_in(calibration)
        return {
            "vectors": len(DIRECTIONS),
            "unit": unit,
            "field": calibration.field_strength / size,
            "worst": deviation.worst / size,
            "worst_deg": deviation.worst_deg,
            "heading_deg": deviation.heading_deg,
        }

    def checked(self, calibration: Calibration, deviation: Difference) -> str:
        """How far the target is off, in words."""
        size, name = self._errors_in(calibration)
        unit, scaled = label(name), ", scaled," if self.lengths else ""
        return (
            f"checked: its own formula{scaled} on {len(DIRECTIONS)} fields of "
            f"{figures(calibration.field_strength / size, 4)} {unit}, "
            f"{_at_most(deviation.worst / size, deviation.worst_deg, unit)} off the calibration"
        )

    def notes(self, calibration: Calibration) -> Iterable[str]:
        """For which readings the numbers are right, and what comes out."""
        if self.keeps in MOUNTINGS:
            return
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


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A calibration in the numbers of a target, and what the target's own formula makes of it."""

    target: Target
    plain: Calibration  #: at rest, in the axes that the target corrects
    written: Written
    difference: Difference
    loses: bool  #: the target holds less than the calibration
    warnings: tuple[str, ...]
    #: (3, 3) from the axes that the target corrects to those of the calibration that was given; None of the same
    turn: Floats | None = None

    def corrected(self, directions: Floats) -> Floats:
        """(N, 3) fields over their strength, as the target corrects what the sensor reads in (N, 3) directions.

        Both are in the axes of the calibration that was given.
        """
        turn = np.eye(3) if self.turn is None else self.turn
        corrected: Floats = self.target.corrected(self.plain, self.written.apply, directions @ turn) @ turn.T
        return corrected

    def export(self, about: Sequence[str] = ()) -> Export:
        """The file with its comments, `about` first, and the same for programs."""
        target, plain, written = self.target, self.plain, self.written
        unit, checked = _named(target.unit, plain), target.checked(plain, self.difference)
        notes = [*about, *target.notes(plain), *written.notes]
        formula = written.formula or target.formula
        remarks = [f"{target.title}: {formula}, in {unit}", *notes, *self.warnings, checked]
        comments = target.comment.lines(remarks) if target.comment else []
        fields = {
            "target": target.name,
            "formula": formula,
            "unit": unit,
            "axes": target.where,
            "holds": target.holds,
            "values": dict(written.values),
            "checked": target.as_figures(plain, self.difference),
            "notes": notes,
            "unverified": list(target.unverified),
        }
        text = "\n".join([*comments, *written.body, ""])
        return Export(target.name, text, fields, checked, self.warnings, written.data, has_comments=bool(comments))


def not_followed(calibration: Calibration, disturbance: Disturbance, why: str) -> str:
    """Say what it costs that something takes a disturbance at its reference."""
    cost = min(calibration.disturbance_deg(disturbance, dip_deg=DIP_DEG), 180.0)
    return (
        f"{why}: it is taken for {disturbance.amount(disturbance.reference)}, and at "
        f"{disturbance.amount(disturbance.farthest)} headings are off by up to {figures(cost)}° (at any attitude, dip "
        f"{DIP_DEG:.0f}°)"
    )


def _named(unit: str, calibration: Calibration) -> str:
    """What a unit of a target is called for this calibration."""
    return {OWN: calibration.unit, RECORDED: calibration.raw.name}.get(unit, unit)


def _at_most(worst: float, worst_deg: float, unit: str) -> str:
    """Write the errors; what is next to nothing only as that, since it differs from machine to machine."""
    if max(worst, worst_deg) < NEXT_TO_NOTHING:
        return f"less than {NEXT_TO_NOTHING} {unit} and {NEXT_TO_NOTHING}°"
    return f"at most {figures(max(worst, NEXT_TO_NOTHING))} {unit} and {figures(max(worst_deg, NEXT_TO_NOTHING))}°"
