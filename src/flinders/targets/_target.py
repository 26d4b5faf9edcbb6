"""A target: how it uses a calibration, what it can represent, its writer and its reader.

Each module here is a target or a family of targets, with a row for each at its end. A row tries the target's own
formula with the numbers as they are written, and states the error that results. Most targets write a matrix and an
offset in their own unit and axes (`Affine`).

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
"""Kinds of `keeps` for targets that store only the orientation of the sensor, and leave the correction to a program."""
AXES_WORDS: Final[Mapping[Acts, str]] = {
    "recorded": "the sensor's own, before its mounting",
    "mapped": "those of the vehicle or board, after the mounting",
    "across": "readings as recorded in, the calibration's axes out",
}
NEGLIGIBLE_ERROR: Final = 0.0001
TOLERANCE: Final = 1e-9
"""Tolerance for the kind of a matrix, relative to its largest entry, as matrix products are rounded."""
SINGLE_TOLERANCE: Final = 1e-6
"""Tolerance for the kind of a matrix, relative to its largest entry, after rounding to float32."""

FALSE_ALARM_PROBABILITY: Final = 1e-4
"""Largest probability that an undisturbed reading is beyond a limit of `Gates`."""
GATE_SIGMAS: Final = NormalDist().inv_cdf(1.0 - FALSE_ALARM_PROBABILITY / 2.0)
"""Limits of `Gates` in standard deviations."""
TILT_DEG: Final = 1.0
"""Standard deviation in degrees, about each axis, of the vertical that firmware takes from its accelerometer."""


@dataclass(frozen=True, slots=True)
class Gates:
    """Limits for corrected readings without disturbances; firmware recognises a disturbed reading by them."""

    strength_limit: float  # largest difference between its length and the field strength, in the calibration's unit
    # dip in degrees, and largest difference between the measured dip and this dip; NaN if unknown
    dip_deg: float = math.nan
    dip_limit_deg: float = math.nan

    @property
    def has_dip(self) -> bool:
        """Whether there is a limit for the dip."""
        return not math.isnan(self.dip_limit_deg)


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """Options of a target in addition to the calibration."""

    compass: int | None = None  # number of the compass on the target; None for its first
    lossy: bool = False  # whether a heading error above 0.5° by omitted parts is accepted
    # (3, 3): mounting of the compass during the recording, vehicle = R sensor; None if it is not known
    mounting: Floats | None = None
    rotation_covariance: Floats | None = None  # (3, 3) rad²: covariance of the sensor's orientation, in the body's axes
    gates: Gates | None = None  # limits by which generated code recognises a disturbed reading
    noise: MeasurementNoise | None = None  # noise of corrected readings for a filter
    heading: HeadingModel | None = None  # model by which generated code states the error of each heading
    estimator: bool = False  # whether the noise is also written as parameters of the vehicle's estimator
    # name of the sensor, as a prefix of names in generated code: one program can then contain code for two sensors
    name: str | None = None
    fitting: str = ""  # command that fits a calibration which the target can represent, if there is one


@dataclass(frozen=True, slots=True, eq=False)
class Written:
    """A calibration as written for a target."""

    apply: Callable[[Floats], Floats]  # formula of the target, with the numbers as they are stored, in its units
    body: Sequence[str]  # lines of the file
    values: Mapping[str, Any]  # written numbers by name, for programs
    notes: Sequence[str] = ()  # further remarks
    data: bytes | None = None  # content of a binary file
    # ``compensated(readings, value)``: the formula at a value of the current or throttle of the motors
    compensated: Callable[[Floats, float], Floats] | None = None
    # (3, 3): rotation in the calibration that the written mounting contains, in the recorded axes
    turn: Floats | None = None
    formula: str = ""  # formula for these numbers, if it is not the usual one of the target
    # calibration that the numbers mean, if the mounting was rounded to right angles
    meant: Calibration | None = None
    # whether the mounting is not by right angles, and the nearest right-angled one was written
    is_partial: bool = False


@dataclass(frozen=True, slots=True, repr=False)
class Export(ShortRepr):
    """A calibration in the form of a target."""

    target: str  # name of the target
    text: str  # content of the file; for a binary file a description
    fields: dict[str, Any]  # the same content for programs, JSON-ready
    checked: str  # error of the target's formula, in words
    warnings: tuple[str, ...] = ()  # warnings to read before it is used
    data: bytes | None = None  # content of a binary file
    # whether the text contains remarks as comments; otherwise they have to be shown elsewhere
    has_comments: bool = True

    @property
    def content(self) -> str | bytes:
        """Content of the file."""
        return self.text if self.data is None else self.data


@dataclass(frozen=True, slots=True)
class TargetReader:
    """Reader of a target's files."""

    mark: bytes  #: regular expression that matches the first bytes of such files, and of no other target's files
    #: ``read(content, source, strength=…)`` returns the calibration in a file's bytes. `source` is the name for
    #: messages. `strength` is the length of corrected readings, which takes precedence over that in the file, in µT, or
    #: in counts for a file in counts. With `which`, the function also takes ``compass``.
    read: Callable[..., Calibration]
    saved: str  #: files of the tool itself that can be read, in words
    #: ``which(content, source, compass)`` returns number and device id of the compass that is read, if there are
    #: several
    which: Callable[[bytes, str, int | None], tuple[int, int | None]] | None = None
    #: ``states(content, source)`` returns lines about further contents of the file
    states: Callable[[bytes, str], list[str]] | None = None

    def sniff(self, head: bytes) -> bool:
        """Whether these first bytes may be those of such a file."""
        return re.search(self.mark, head) is not None


class Limit(NamedTuple):
    """Range of a parameter."""

    name: str
    quantity: str  # ``offset``, ``matrix``, ``scale`` (mean of its diagonal), or ``iron`` (matrix divided by scale)
    places: tuple[int, ...]  # places in row order; if there are several, the length of the vector is limited
    low: float
    high: float
    unit: float = 1.0  # µT per unit of the parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """One row of the table of targets."""

    name: str  #: name for `find` and for ``--for``
    use: str  #: what is written, in words for users
    suffix: str  #: suffix of such a file
    title: str  #: name of the target for users
    formula: str  #: formula that uses the numbers
    unit: str  #: unit of uncorrected readings: a name of `units`, ``own`` or ``recorded``
    keeps: Keeps  #: part of a calibration that it can represent; a key of `CAPACITY_WORDS`
    storage: str  #: format and range of stored numbers
    source: str  #: source of the formula
    #: ``write(calibration, asked)`` returns the calibration in the numbers of the target
    write: Callable[[Calibration, ExportOptions], Written]
    group: TargetGroup = "other"  #: what a user of this target has; a key of `GROUPS`
    reader: TargetReader | None = None  #: reader of such a file; None if it cannot be read
    acts: Acts = "recorded"  #: axes in which it corrects; a key of `AXES_WORDS`
    #: whether the program around it selects the readings to correct, so that they may be in vehicle axes
    fed: bool = False
    #: disturbances that it can represent: none, current or throttle (``motors``), or all
    follows: Literal["", "motors", "all"] = ""
    linearizes: bool = False  #: whether it can represent a linearization of axes
    #: length of corrected readings, if the target defines it; empty if it is that of the calibration
    lengths: str = ""
    gives: str = ""  #: unit of corrected readings, if it is not that of uncorrected ones
    #: unit in which its errors are stated, if that of the calibration is too coarse or too fine
    errors_in: str = ""
    unverified: tuple[str, ...] = ()  #: properties that no source confirms, a clause each
    comment: Comment | None = HASH  #: syntax of comments; None if the file cannot contain comments
    docs: str = "targets.md"  #: page of the docs that describes it
    compasses: range | None = None  #: numbers of its compasses, for ``--compass``; None if it has just one
    named: bool = False  #: whether its code shares a program with other code, so that it accepts ``--name``
    mountings: MountingTable | None = None  #: mountings that it can set, for ``--mounting``; None if it sets none
    limits: tuple[Limit, ...] = ()  #: ranges of its parameters
    inertial: InertialForm | None = None  #: form of an accelerometer and a gyro, if it can represent them too
    estimator: str = ""  #: estimator that uses the noise of a compass, for ``--noise``; empty without one
    programs: tuple[str, ...] = ()  #: further programs that use its output; `find` answers their names with this target
    writes_noise: bool = False  #: whether its text states the noise of a known claim, without ``--noise``

    @property
    def where(self) -> str:
        """Words for the axes in which it corrects."""
        return AXES_WORDS[self.acts]

    @property
    def holds(self) -> str:
        """Words for the part of a calibration that it can represent."""
        return CAPACITY_WORDS[self.keeps]

    @property
    def family(self) -> str:
        """Name that targets with the same numbers share: ``adafruit`` for adafruit-eeprom."""
        return self.name.partition("-")[0]

    @property
    def refuses_mounted(self) -> bool:
        """Whether it needs readings in the sensor's own axes, since it acts before the mounting or is the mounting."""
        return (self.acts == "recorded" and not self.fed) or self.keeps in MOUNTING_KINDS

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
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
        """Write a calibration for the target; `about` are remarks on its origin; errors are those of `try_formula`."""
        return self.try_formula(calibration, asked=asked).export(about)

    def try_formula(self, calibration: Calibration, *, asked: ExportOptions | None = None) -> Trial:
        """Express a calibration in the numbers of the target, and check them with the target's own formula.

        `asked` has the compass and other options. `UnitError` is raised if counts would have to be converted to a unit,
        or a unit to counts. `NotExportable` is raised for numbers that the target cannot represent, for a heading error
        above 0.5° by omitted parts unless it is accepted, and for readings in axes other than the target's.
        `UsageError` is raised for a compass that does not exist, and for an invalid name.
        """
        asked = asked or ExportOptions()
        given = calibration.frame
        calibration = self._in_axes_of_target(calibration, asked.mounting)
        turn = asked.mounting if calibration.frame != given else None
        if calibration.linearization is not None and not self.linearizes:
            raise NotExportable(
                f"the calibration linearizes its axes, and {self.title} holds {self.holds}: use c, arduino or "
                "micropython, or calibrate without linearization",
                hint={"linearize": False},
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
        """Calibration in the sensor's own axes if the target needs them; `NotExportable` if they are not known."""
        if not self.refuses_mounted or calibration.frame != VEHICLE:
            return calibration
        if mounting is None:
            refuse_mounted(calibration, who=self.title)
        return in_sensor_axes(calibration, np.asarray(mounting))

    def corrected(self, calibration: Calibration, apply: Callable[[Floats], Floats], directions: Floats) -> Floats:
        """(N, 3) fields relative to their strength, as a formula in the target's units corrects readings."""
        size, given = per_unit(calibration, self.unit, who=self.title), self._size_given(calibration)
        acts, relative = axes_of_action(self.acts, calibration), bool(self.lengths)
        return correct_fields(
            calibration, lambda raw: given * apply(raw / size), directions, acts=acts, relative=relative
        )

    def _measure_difference(
        self, calibration: Calibration, apply: Callable[[Floats], Floats], *, lacks: str, asked: ExportOptions
    ) -> Difference:
        """Run the target's formula in its units, and raise `NotExportable` if the error is large."""
        deviation = Difference.of(calibration, self.corrected(calibration, apply, DIRECTIONS))
        if lacks:
            takes_turn = calibration.rotation != "symmetric" and self.keeps not in MOUNTING_KINDS
            mountings = self.mountings if takes_turn else None
            deviation.refuse_lost(lacks, lossy=asked.lossy, mountings=mountings, fitting=asked.fitting)
        else:
            deviation.refuse_coarse(calibration, lossy=asked.lossy)
        return deviation

    def _size_given(self, calibration: Calibration) -> float:
        """Size of one unit of corrected readings, in the unit of the calibration."""
        return per_unit(calibration, self.gives or self.unit, who=self.title)

    def _disturbance_errors(self, calibration: Calibration, motor: Disturbance | None) -> Iterable[str]:
        """Yield words for heading errors by disturbances that the target does not represent."""
        for disturbance in calibration.disturbances if self.follows != "all" else ():
            if motor is None or disturbance.name != motor.name:
                yield words_of_unfollowed(
                    calibration, disturbance, f"{self.title} does not follow {disturbance.name} here"
                )

    def _exceeds_capacity(self, calibration: Calibration, written: Written) -> bool:
        """Whether the target cannot represent the matrix, apart from a rotation that its mounting contains."""
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
        """Yield warnings about omitted parts and unverified properties."""
        if lacks:
            fitted = f"; a fit within its limits: {fitting}" if fitting and deviation.heading_deg > MAX_LOSS_DEG else ""
            yield (
                f"{lacks}: the omitted parts cause a heading error of up to {figures(deviation.heading_deg)}° (at any "
                f"attitude, dip {DIP_DEG:.0f}°){fitted}"
            )
        for clause in self.unverified:
            yield f"not verified: {clause}"

    def _errors_in(self, calibration: Calibration) -> tuple[float, str]:
        """Unit in which errors are stated: its size in the unit of the calibration, and its name."""
        if self.errors_in:
            return per_unit(calibration, self.errors_in, who=self.title), self.errors_in
        return 1.0, calibration.unit

    def as_figures(self, calibration: Calibration, deviation: Difference) -> dict[str, Any]:
        """Errors of the target as numbers, for programs."""
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
        """Words for the errors of the target."""
        size, name = self._errors_in(calibration)
        unit, scaled = unit_label(name), ", scaled," if self.lengths else ""
        return (
            f"checked: its own formula{scaled} on {len(DIRECTIONS)} fields of "
            f"{figures(calibration.field_strength / size, 4)} {unit}, "
            f"{_error_words(deviation.worst / size, deviation.worst_deg, unit)} off the calibration"
        )

    def notes(self, calibration: Calibration) -> Iterable[str]:
        """Yield remarks on the readings that the numbers are for, and on corrected readings."""
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
        """Yield remarks on the axes of the readings, and on steps that are left to do after the correction."""
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
    plain: Calibration  #: calibration with motors at rest, in the axes that the target corrects
    written: Written
    difference: Difference
    loses: bool  #: whether the target omits parts of the calibration
    warnings: tuple[str, ...]
    #: (3, 3) from the axes that the target corrects to those of the given calibration; None if they are the same
    turn: Floats | None = None

    def corrected(self, directions: Floats) -> Floats:
        """(N, 3) fields relative to their strength, as the target corrects the sensor's readings in (N, 3) directions.

        Fields and directions are in the axes of the given calibration.
        """
        turn = np.eye(3) if self.turn is None else self.turn
        corrected: Floats = self.target.corrected(self.plain, self.written.apply, directions @ turn) @ turn.T
        return corrected

    def export(self, about: Sequence[str] = ()) -> Export:
        """The file, with `about` as the first of its comments, and the numbers for programs."""
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
    """Message about the heading error if a disturbance is assumed to have its reference value."""
    cost = min(calibration.disturbance_deg(disturbance, dip_deg=DIP_DEG), 180.0)
    return (
        f"{why}: it is taken for {disturbance.text_of(disturbance.reference)}, and at "
        f"{disturbance.text_of(disturbance.extreme_value)} headings are off by up to {figures(cost)}° (at any "
        f"attitude, dip {DIP_DEG:.0f}°)"
    )


def _unit_name(unit: str, calibration: Calibration) -> str:
    """Name of a target's unit, for a calibration."""
    return {OWN: calibration.unit, RECORDED: calibration.raw.name}.get(unit, unit)


def _error_words(worst: float, worst_deg: float, unit: str) -> str:
    """Words for errors. Negligible errors are only called so, as their digits differ between machines."""
    if max(worst, worst_deg) < NEGLIGIBLE_ERROR:
        return f"less than {NEGLIGIBLE_ERROR} {unit} and {NEGLIGIBLE_ERROR}°"
    return f"at most {figures(max(worst, NEGLIGIBLE_ERROR))} {unit} and {figures(max(worst_deg, NEGLIGIBLE_ERROR))}°"
