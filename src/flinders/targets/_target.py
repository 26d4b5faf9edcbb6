"""A target: how it uses a calibration, its capacity, and its writer and reader.

Each module here is a target or a family of them, with a row for each at its end. A row tries the target's own formula
on the written numbers, and states the resulting error. Most targets write a matrix and an offset in their own unit and
axes, `Affine`.

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
from flinders.core.units import unit_label
from flinders.errors import NotExportable, figures
from flinders.targets._comments import HASH, Comment
from flinders.targets._difference import DIP_DEG, DIRECTIONS, MAX_LOSS_DEG, Difference, correct_fields
from flinders.targets._numbers import (
    OWN,
    RECORDED,
    VEHICLE,
    Acts,
    axes_of_action,
    in_recorded_axes,
    in_sensor_axes,
    per_unit,
    refuse_mounted,
    split_motor_disturbance,
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
TargetGroup: TypeAlias = Literal[
    "autopilots", "chips and IMUs", "ROS", "microcontrollers", "libraries, tools", "any program", "mounting", "other"
]
GROUPS: Final[Mapping[TargetGroup, str]] = {
    "autopilots": "an autopilot",
    "chips and IMUs": "a chip or IMU that corrects its readings by registers",
    "ROS": "a robot with ROS",
    "microcontrollers": "a microcontroller, or firmware in C",
    "libraries, tools": "a library for sensor fusion, or a tool that calibrates",
    "any program": "a program that takes plain numbers",
    "mounting": "a system with a setting for the mounting of a sensor",
    "other": "a program with a plugin of its own",
}
"""Groups of targets in the order of the list, each with what a user of its targets has."""
CAPACITY_WORDS: Final[Mapping[Keeps, str]] = {
    "all": "an offset and a whole matrix",
    "symmetric": "an offset and a symmetric matrix",
    "diagonal": "an offset and a diagonal, no other soft iron",
    "offset": "an offset and no soft iron",
    "rotation": "a mounting and no calibration",
    "axes": "a mounting by right angles and no calibration",
}
MOUNTING_KINDS: Final = ("rotation", "axes")
"""Capacities of targets that hold only the sensor's orientation, and leave the correction to a program before them."""
AXES_WORDS: Final[Mapping[Acts, str]] = {
    "recorded": "the sensor's own, before its mounting",
    "mapped": "those of the vehicle or board, after the mounting",
    "across": "readings as recorded in, the calibration's axes out",
}
NEGLIGIBLE_ERROR: Final = 0.0001
TOLERANCE: Final = 1e-9
"""Tolerance of a matrix's kind, relative to its largest entry, for rounding of matrix products."""
SINGLE_TOLERANCE: Final = 1e-6
"""Tolerance of a matrix's kind, relative to its largest entry, for rounding to float32."""

FALSE_ALARM_PROBABILITY: Final = 1e-4
"""Largest probability that a clean reading is beyond a limit of `Gates`."""
GATE_SIGMAS: Final = NormalDist().inv_cdf(1.0 - FALSE_ALARM_PROBABILITY / 2.0)
"""The limits of `Gates`, in standard deviations."""
TILT_DEG: Final = 1.0
"""1 σ about each axis, in degrees, of the vertical that firmware takes from its accelerometer."""


@dataclass(frozen=True, slots=True)
class Gates:
    """Limits of a corrected reading without disturbances, by which firmware recognises a disturbed one."""

    strength_limit: float  # largest deviation of its length from the field strength, in the calibration's unit
    # dip, and largest deviation of the field's angle to the horizon from it; NaN if unknown
    dip_deg: float = math.nan
    dip_limit_deg: float = math.nan

    @property
    def has_dip(self) -> bool:
        """Whether there is a limit of dip."""
        return not math.isnan(self.dip_limit_deg)


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """Options of a target besides the calibration."""

    compass: int | None = None  # number of the compass in the target; None is its first
    lossy: bool = False  # accept a heading error above 0.5° due to omitted parts
    # (3, 3): mounting of the compass during the recording, vehicle = R sensor; None if unknown
    mounting: Floats | None = None
    rotation_covariance: Floats | None = None  # (3, 3) rad², in the body's axes: of the sensor's orientation
    gates: Gates | None = None  # limits by which generated code recognises a disturbed reading
    noise: MeasurementNoise | None = None  # noise of corrected readings for a filter
    heading: HeadingModel | None = None  # model by which generated code states the error of each heading
    estimator: bool = False  # also write the noise as parameters of the vehicle's estimator
    # name of the sensor as prefix of names in generated code, so that one program can include code for two sensors
    name: str | None = None
    fitting: str = ""  # command for a fit within the target's capacity, if there is one


@dataclass(frozen=True, slots=True, eq=False)
class Written:
    """A calibration in the numbers of a target."""

    apply: Callable[[Floats], Floats]  # the target's formula with the numbers as stored, in its units
    body: Sequence[str]  # lines of the file
    values: Mapping[str, Any]  # written values, for programs
    notes: Sequence[str] = ()  # further remarks
    data: bytes | None = None  # content of a binary file
    # ``compensated(readings, value)``: the formula at a value of the motors' current or throttle
    compensated: Callable[[Floats, float], Floats] | None = None
    # (3, 3): rotation of the calibration that is in the written mounting, in the recorded axes
    turn: Floats | None = None
    formula: str = ""  # formula for the numbers, if it differs from the target's usual one
    # calibration for the numbers, if the mounting was rounded to right angles
    meant: Calibration | None = None
    is_partial: bool = False  # the mounting is not by right angles, and the nearest one that is was written


@dataclass(frozen=True, slots=True, repr=False)
class Export(ShortRepr):
    """A calibration in the form of a target."""

    target: str  # name of the target
    text: str  # content of the file; a readable description of a binary one
    fields: dict[str, Any]  # the same for programs, ready for JSON
    checked: str  # its error, in words
    warnings: tuple[str, ...] = ()  # warnings before its use
    data: bytes | None = None  # content of a binary file
    has_comments: bool = True  # the text contains remarks as comments; otherwise they have to be shown elsewhere

    @property
    def content(self) -> str | bytes:
        """Content of the file."""
        return self.text if self.data is None else self.data


@dataclass(frozen=True, slots=True)
class TargetReader:
    """Reader of a target's files."""

    mark: bytes  #: regular expression that matches the first bytes of such files, and of no other target's
    #: ``read(content, source, strength=…)`` returns the calibration in a file's bytes. `source` is its name for
    #: messages, `strength` the length of corrected readings, which has priority over the file's; in µT, or in counts
    #: for files in counts. With `which` it also takes ``compass``
    read: Callable[..., Calibration]
    saved: str  #: files of the tool itself that can be read, in words
    #: ``which(content, source, compass)`` returns number and device id of the compass that is read, of several
    which: Callable[[bytes, str, int | None], tuple[int, int | None]] | None = None
    #: ``states(content, source)`` returns lines on further statements in the file
    states: Callable[[bytes, str], list[str]] | None = None

    def sniff(self, head: bytes) -> bool:
        """Whether the first bytes may be those of such a file."""
        return re.search(self.mark, head) is not None


class Limit(NamedTuple):
    """A parameter with a limited range."""

    name: str
    quantity: str  # ``offset``, ``matrix``, ``scale`` (mean of its diagonal), or ``iron`` (matrix over scale)
    places: tuple[int, ...]  # in row order; of several entries, the length is limited
    low: float
    high: float
    unit: float = 1.0  # µT in one unit of it


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """One row of the table of targets."""

    name: str  #: name for `find` and ``--to``
    use: str  #: written form, for users
    suffix: str  #: suffix of such a file
    title: str  #: title for users
    formula: str  #: formula that uses the numbers
    unit: str  #: of uncorrected readings: a name of `units`, ``own`` or ``recorded``
    keeps: Keeps  #: its capacity; a key of `CAPACITY_WORDS`
    storage: str  #: format and range of stored numbers
    source: str  #: source of the formula
    #: ``write(calibration, asked)`` returns the calibration in the numbers of the target
    write: Callable[[Calibration, ExportOptions], Written]
    group: TargetGroup = "other"  #: what a user has; a key of `GROUPS`
    reader: TargetReader | None = None  #: reader of such a file, if it can be read back
    acts: Acts = "recorded"  #: a key of `AXES_WORDS`
    fed: bool = False  #: the surrounding program selects the readings that it corrects, which may be in vehicle axes
    #: disturbances that it can hold: none, current or throttle (``motors``), or all
    follows: Literal["", "motors", "all"] = ""
    linearizes: bool = False  #: it can hold a linearization of axes
    #: length of corrected readings, if the target defines it; empty if it is the calibration's
    lengths: str = ""
    gives: str = ""  #: unit of corrected readings, if it differs
    #: unit for its errors, if that of the calibration is inappropriate for its steps
    errors_in: str = ""
    unverified: tuple[str, ...] = ()  #: unverified properties, a clause each
    comment: Comment | None = HASH  #: None if the file cannot contain comments
    docs: str = "targets.md"  #: page of the documentation
    compasses: range | None = None  #: numbers of its compasses; with them it takes ``--compass``
    named: bool = False  #: its names share a program with others, so that it takes ``--name``
    mountings: MountingTable | None = None  #: its mountings; with them it takes ``--mounting``
    limits: tuple[Limit, ...] = ()  #: ranges of its parameters
    inertial: InertialForm | None = None  #: form of an accelerometer and a gyro, if it holds them too
    estimator: str = ""  #: an estimator that takes the noise of a compass; with one it takes ``--noise``

    @property
    def where(self) -> str:
        """Axes in which it works, in words."""
        return AXES_WORDS[self.acts]

    @property
    def holds(self) -> str:
        """Its capacity, in words."""
        return CAPACITY_WORDS[self.keeps]

    @property
    def family(self) -> str:
        """Common name of targets with the same numbers: ``adafruit`` of adafruit-eeprom."""
        return self.name.partition("-")[0]

    @property
    def refuses_mounted(self) -> bool:
        """Whether the target needs the sensor's own axes, as it acts before the mounting or is the mounting."""
        return (self.acts == "recorded" and not self.fed) or self.keeps in MOUNTING_KINDS

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "group": self.group,
            "use": self.use,
            "suffix": self.suffix,
            "formula": self.formula,
            "unit": self.unit,
            "holds": self.holds,
            "axes": self.where,  # axes in which it corrects
            "storage": self.storage,
            "source": self.source,
            "unverified": self.unverified,
            "import": self.reader is not None,  # whether `flinders import` reads it back
            "docs": self.docs,
        }

    def render(
        self, calibration: Calibration, *, about: Sequence[str] = (), asked: ExportOptions | None = None
    ) -> Export:
        """Write a calibration for the target; `about`: remarks on its origin; parameters and errors as `tried`."""
        return self.try_formula(calibration, asked=asked).export(about)

    def try_formula(self, calibration: Calibration, *, asked: ExportOptions | None = None) -> Trial:
        """Express a calibration in the numbers of the target, and check them with the target's own formula.

        `asked`: the compass and other options. Raises `UnitError` if counts would have to be converted to a unit, or
        vice versa; `NotExportable` for numbers that the target cannot hold, for a heading error above 0.5° due to
        omitted parts unless it is accepted, and for readings in other axes than the target's; `UsageError` for a
        compass that does not exist, or an invalid name.
        """
        asked = asked or ExportOptions()
        given = calibration.frame
        calibration = self._in_axes_of_target(calibration, asked.mounting)
        turn = asked.mounting if calibration.frame != given else None
        if calibration.linearization is not None and not self.linearizes:
            raise NotExportable(
                f"the calibration linearizes its axes, and {self.title} holds {self.holds}: use c, arduino or "
                "micropython, or calibrate without",
                hint={"linearize": None},
                beyond=("linearization",),
            )
        written = self.write(calibration, asked)
        plain, motor = split_motor_disturbance(calibration) if self.follows == "motors" else (calibration.at(), None)
        plain = written.meant or plain
        lacks = f"{self.title} holds {self.holds}" if self._exceeds_capacity(plain, written) else ""
        deviation = self._measure_difference(plain, written.apply, lacks=lacks, asked=asked)
        if motor is not None and (compensated := written.compensated) is not None:
            end = motor.extreme_value
            far = calibration.at(**{motor.name: end})
            tried = self._measure_difference(far, lambda raw: compensated(raw, end), lacks=lacks, asked=asked)
            deviation = deviation.worst_of(tried)
        warnings = (*self._warnings(deviation, lacks, asked.fitting), *self._disturbance_errors(calibration, motor))
        return Trial(self, plain, written, deviation, bool(lacks), warnings, turn)

    def _in_axes_of_target(self, calibration: Calibration, mounting: Floats | None) -> Calibration:
        """The calibration in the sensor's own axes, if the target needs these; `NotExportable` if they are unknown."""
        if not self.refuses_mounted or calibration.frame != VEHICLE:
            return calibration
        if mounting is None:
            refuse_mounted(calibration, who=self.title)
        return in_sensor_axes(calibration, np.asarray(mounting))

    def corrected(self, calibration: Calibration, apply: Callable[[Floats], Floats], directions: Floats) -> Floats:
        """(N, 3) fields relative to their strength, as a formula in its units corrects readings in these directions."""
        size, given = per_unit(calibration, self.unit, who=self.title), self._size_given(calibration)
        acts, relative = axes_of_action(self.acts, calibration), bool(self.lengths)
        return correct_fields(
            calibration, lambda raw: given * apply(raw / size), directions, acts=acts, relative=relative
        )

    def _measure_difference(
        self, calibration: Calibration, apply: Callable[[Floats], Floats], *, lacks: str, asked: ExportOptions
    ) -> Difference:
        """Run the target's formula in its units, and raise `NotExportable` for a large error."""
        deviation = Difference.of(calibration, self.corrected(calibration, apply, DIRECTIONS))
        if lacks:
            takes_turn = calibration.rotation != "symmetric" and self.keeps not in MOUNTING_KINDS
            mountings = self.mountings if takes_turn else None
            deviation.refuse_lost(lacks, lossy=asked.lossy, mountings=mountings, fitting=asked.fitting)
        else:
            deviation.refuse_coarse(calibration, lossy=asked.lossy)
        return deviation

    def _size_given(self, calibration: Calibration) -> float:
        """Size of one unit of a corrected reading, in the unit of the calibration."""
        return per_unit(calibration, self.gives or self.unit, who=self.title)

    def _disturbance_errors(self, calibration: Calibration, motor: Disturbance | None) -> Iterable[str]:
        """Heading errors due to disturbances that a target does not follow."""
        for disturbance in calibration.disturbances if self.follows != "all" else ():
            if motor is None or disturbance.name != motor.name:
                yield words_of_unfollowed(
                    calibration, disturbance, f"{self.title} does not follow {disturbance.name} here"
                )

    def _exceeds_capacity(self, calibration: Calibration, written: Written) -> bool:
        """Whether the matrix exceeds the target's capacity, apart from a rotation in its mounting."""
        if self.keeps in MOUNTING_KINDS:
            return written.is_partial
        turn = written.turn
        matrix = (
            calibration.matrix
            if axes_of_action(self.acts, calibration) == "mapped"
            else in_recorded_axes(calibration)[0]
        )
        if turn is not None:
            matrix = turn.T @ matrix
        reduced = {
            "all": matrix,
            "symmetric": matrix.T,
            "diagonal": np.diag(np.diag(matrix)),
            "offset": np.eye(3) * matrix[0, 0],
        }[self.keeps]
        exact = TOLERANCE if turn is None else SINGLE_TOLERANCE
        return bool(np.abs(matrix - reduced).max() > exact * np.abs(matrix).max())

    def _warnings(self, deviation: Difference, lacks: str, fitting: str) -> Iterable[str]:
        """Warnings on omitted and unverified parts."""
        if lacks:
            fitted = f"; a fit within its limits: {fitting}" if fitting and deviation.heading_deg > MAX_LOSS_DEG else ""
            yield (
                f"{lacks}: the omitted parts cause a heading error of up to {figures(deviation.heading_deg)}° (at any "
                f"attitude, dip {DIP_DEG:.0f}°){fitted}"
            )
        for clause in self.unverified:
            yield f"not verified: {clause}"

    def _errors_in(self, calibration: Calibration) -> tuple[float, str]:
        """The unit for errors: its size in that of the calibration, and its name."""
        if self.errors_in:
            return per_unit(calibration, self.errors_in, who=self.title), self.errors_in
        return 1.0, calibration.unit

    def as_figures(self, calibration: Calibration, deviation: Difference) -> dict[str, Any]:
        """Errors of the target, for programs."""
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
        """Errors of the target, in words."""
        size, name = self._errors_in(calibration)
        unit, scaled = unit_label(name), ", scaled," if self.lengths else ""
        return (
            f"checked: its own formula{scaled} on {len(DIRECTIONS)} fields of "
            f"{figures(calibration.field_strength / size, 4)} {unit}, "
            f"{_error_words(deviation.worst / size, deviation.worst_deg, unit)} off the calibration"
        )

    def notes(self, calibration: Calibration) -> Iterable[str]:
        """Remarks on the readings that the numbers are for, and on the corrected ones."""
        if self.keeps in MOUNTING_KINDS:
            return
        if self.lengths:
            yield f"corrected readings are {self.lengths}"
        else:
            strength = calibration.field_strength / self._size_given(calibration)
            relative = "" if calibration.field_strength_known else ", which is relative: no field strength was given"
            unit = _unit_name(self.gives or self.unit, calibration)
            yield f"corrected readings are {figures(strength, 4)} {unit} long{relative}"
        yield from self._of_the_axes(calibration)

    def _of_the_axes(self, calibration: Calibration) -> Iterable[str]:
        """Remarks on the axes of the readings, and on steps that remain after the correction."""
        if calibration.frame == VEHICLE:
            yield "for readings in the axes of the vehicle, after the mounting, as they were recorded"
            if axes_of_action(self.acts, calibration) == "recorded" and not calibration.axes.is_identity:
                yield f"acts in those axes, not in those they were mapped to by {calibration.axes}"
        elif calibration.axes.is_identity:
            if self.acts == "mapped":
                yield "acts after the mounting: the recording must be in the axes of the vehicle or board"
        elif self.acts == "recorded":
            yield f"acts in the sensor's own axes: map the corrected readings to {calibration.axes} as before"
        elif self.acts == "mapped":
            yield f"acts after the mounting, which must map the sensor's axes to {calibration.axes}"
        if self.acts == "across" and not calibration.axes.is_identity:
            yield f"the mapping of axes to {calibration.axes} is in the matrix: give readings as they were recorded"


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A calibration in the numbers of a target, with the errors of the target's own formula."""

    target: Target
    plain: Calibration  #: with motors at rest, in the axes that the target corrects
    written: Written
    difference: Difference
    loses: bool  #: the target's capacity is less than the calibration
    warnings: tuple[str, ...]
    #: (3, 3) from the axes that the target corrects to those of the given calibration; None if they are equal
    turn: Floats | None = None

    def corrected(self, directions: Floats) -> Floats:
        """(N, 3) fields relative to their strength, as the target corrects the sensor's readings in (N, 3) directions.

        Both are in the axes of the given calibration.
        """
        turn = np.eye(3) if self.turn is None else self.turn
        corrected: Floats = self.target.corrected(self.plain, self.written.apply, directions @ turn) @ turn.T
        return corrected

    def export(self, about: Sequence[str] = ()) -> Export:
        """The file with its comments, `about` first, and its values for programs."""
        target, plain, written = self.target, self.plain, self.written
        unit, checked = _unit_name(target.unit, plain), target.checked(plain, self.difference)
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


def words_of_unfollowed(calibration: Calibration, disturbance: Disturbance, why: str) -> str:
    """Message with the heading error if a disturbance is taken at its reference."""
    cost = min(calibration.disturbance_deg(disturbance, dip_deg=DIP_DEG), 180.0)
    return (
        f"{why}: it is taken for {disturbance.text_of(disturbance.reference)}, and at "
        f"{disturbance.text_of(disturbance.extreme_value)} headings are off by up to {figures(cost)}° (at any "
        f"attitude, dip {DIP_DEG:.0f}°)"
    )


def _unit_name(unit: str, calibration: Calibration) -> str:
    """Name of a target's unit for this calibration."""
    return {OWN: calibration.unit, RECORDED: calibration.raw.name}.get(unit, unit)


def _error_words(worst: float, worst_deg: float, unit: str) -> str:
    """Errors as text; negligible ones only as such, since they differ between machines."""
    if max(worst, worst_deg) < NEGLIGIBLE_ERROR:
        return f"less than {NEGLIGIBLE_ERROR} {unit} and {NEGLIGIBLE_ERROR}°"
    return f"at most {figures(max(worst, NEGLIGIBLE_ERROR))} {unit} and {figures(max(worst_deg, NEGLIGIBLE_ERROR))}°"
