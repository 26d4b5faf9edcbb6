"""Readings of a magnetometer, with the other columns of their recording.

Every reader yields `Samples` and every fit takes them: columns of equal length, in known units
and axes. A `Recording` yields the same blocks of samples in each pass: a file on disk, several files
of one sensor, or `Samples` themselves. A fit makes as many passes as it needs without holding the
recording in memory.

>>> samples = Samples.of([[0.2, 0.1, -0.4], [0.3, 0.0, -0.3]], unit="G")
>>> samples.field[0], samples.unit.inside
(array([ 20.,  10., -40.]), 'uT')
>>> len(samples), [len(block) for block in samples.blocks()]
(2, [2])
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from flinders.arrays import Floats, check_column, check_table, to_floats
from flinders.core.axes import Axes
from flinders.core.disturbance import KINDS, MAX_MOTORS, MOTORS, kind_and_motor, motor_names, sort_key
from flinders.core.keywords import check_keywords
from flinders.core.silence import find_silent
from flinders.core.units import Unit
from flinders.errors import ArrayError, AxesError, count_text
from flinders.foreign_errors import import_optional
from flinders.geometry.quaternions import check_attitudes, from_matrix, product

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterator, Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from flinders.core.calibration import Calibration

BLOCK_ROWS: Final = 8192
"""Count of rows in a block: many, so that the calls of NumPy cost little, but few enough for the cache."""
SILENT: Final = "silent"
"""Reason for skipping readings at which the sensor did not answer."""
NOT_FINITE: Final = "not finite"
"""Reason for skipping readings of which a number is missing or infinite."""
MAX_NOTED_LINES: Final = 10  # largest number of line numbers that are stored for each reason
ACCOMPANYING: Final = "accompanying"
"""Reason for skipping lines that a program prints between its readings: a title, a state, a ruler."""


@dataclass(frozen=True, slots=True)
class Skipped:
    """Rows of a recording that were skipped for one reason.

    >>> print(Skipped(SILENT, 200, (2, 4, 6, 8), "0, 0, 0"))
    200 readings are 0, 0, 0: the sensor did not answer (line 2, 4, 6, …)
    """

    reason: str  #: ``"not finite"``, ``"unreadable"``, ``"other"``, ``"silent"`` or ``"accompanying"``
    rows: int  #: number of rows
    lines: tuple[int, ...] = ()  #: numbers of the first few lines of the file, or rows of the array, counted from 1
    example: str = ""  #: text of the first row, shortened; for silent readings the text of every row

    @property
    def is_silent(self) -> bool:
        """Whether the sensor did not answer."""
        return self.reason == SILENT

    @property
    def kind(self) -> Hashable:
        """Key by which rows are counted together: their reason, and for silent readings also their text."""
        return (self.reason, self.example) if self.is_silent else self.reason

    def __add__(self, other: Skipped) -> Skipped:
        """Add the counts of two entries of the same kind."""
        return replace(self, rows=self.rows + other.rows, lines=(self.lines + other.lines)[:MAX_NOTED_LINES])

    def __str__(self) -> str:
        lines = ", ".join(str(line) for line in self.lines[:3]) + (", …" if self.rows > 3 else "")
        if self.is_silent:
            are = "is" if self.rows == 1 else "are"
            where = f" (line {lines})" * bool(self.lines)
            return f"{count_text(self.rows, 'reading')} {are} {self.example}: the sensor did not answer{where}"
        example = f": {self.example!r}" if self.example else ""
        return f"{self.amount_text('row' if self.is_loss else 'line')} (line {lines}{example})"

    def amount_text(self, noun: str) -> str:
        """Number of the rows and the reason.

        >>> Skipped(NOT_FINITE, 6990).amount_text("row"), Skipped("unreadable", 1).amount_text("line")
        ('6,990 rows without finite readings', '1 unreadable line')
        """
        if self.reason == NOT_FINITE:
            return f"{count_text(self.rows, noun)} without finite readings"
        return count_text(self.rows, f"{self.reason} {noun}")

    @property
    def is_loss(self) -> bool:
        """Whether the skipped rows should have been readings, other than titles and other accompanying lines."""
        return self.reason != ACCOMPANYING


def merge_skipped(one: tuple[Skipped, ...], other: tuple[Skipped, ...]) -> tuple[Skipped, ...]:
    """Merge two lists of skipped rows, with one entry for each kind."""
    kinds = {entry.kind: entry for entry in one}
    for entry in other:
        kinds[entry.kind] = kinds[entry.kind] + entry if entry.kind in kinds else entry
    return tuple(kinds.values())


def silent_entries(words: Floats, numbers: NDArray[Any]) -> tuple[Skipped, ...]:
    """Make entries of silent readings, one for each word, from their (N,) words and row numbers.

    >>> [str(entry) for entry in silent_entries(np.array([0.0, -1.0, 0.0]), np.array([3, 5, 6]))]
    ['1 reading is -1, -1, -1: the sensor did not answer (line 5)', '2 readings are 0, 0, 0: ...']
    """
    kinds = {word: numbers[words == word].tolist() for word in np.unique(words).tolist()}
    return tuple(
        Skipped(SILENT, len(lines), tuple(map(int, lines[:MAX_NOTED_LINES])), ", ".join([f"{word + 0.0:.0f}"] * 3))
        for word, lines in kinds.items()
    )


COLUMNS: Final = (
    "field", "time", "acceleration", "rate", "temperature", "current", "strength", "throttle", "attitude",
    "currents", "throttles",
)  # fmt: skip
"""Columns of `Samples`."""

COLUMN_NAMES: Final = {
    "time": ("time_s", ""),
    "field": ("mag_{}_{unit}", "xyz"),
    "acceleration": ("acc_{}_mps2", "xyz"),
    "rate": ("gyro_{}_radps", "xyz"),
    "temperature": ("temperature_degC", ""),
    "current": ("current_A", ""),
    "throttle": ("throttle_share", ""),
    "currents": ("current{}_A", ""),
    "throttles": ("throttle{}_share", ""),
    "attitude": ("attitude_{}", "wxyz"),
    "strength": ("reference_strength_{unit}", ""),
}
"""Names of `COLUMNS` in tables that the readers recognise, each with the axes or motor numbers of its components."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Samples:
    """Columns of one recording, or of a stretch of it."""

    field: Floats  #: (N, 3), in `unit.inside`: raw readings, in `axes`
    #: unit of the recording, ``unit.name``, and unit of `field`, ``unit.inside``
    unit: Unit = dataclasses.field(default_factory=Unit.of)
    #: mapping from the recorded axes to those of `field`, acceleration, rate and attitude; a mapping that is a mirror
    #: image is applied to `field` alone
    axes: Axes = dataclasses.field(default_factory=Axes)
    time: Floats | None = None  #: (N,), s: times of the readings, ascending in a valid recording
    #: (N, 3): specific force in any unit; a level accelerometer at rest with z down reads −g on z
    acceleration: Floats | None = None
    rate: Floats | None = None  #: (N, 3), rad/s: angular rate of the body
    temperature: Floats | None = None  #: (N,), °C
    current: Floats | None = None  #: (N,), A
    #: (N,), in `unit.inside`: strength of the field at each reading, from a model or a reference magnetometer; NaN if
    #: not known
    strength: Floats | None = None
    #: (N,), 0 to 1: commanded share of full thrust; NaN if not known
    throttle: Floats | None = None
    #: (N, 4): attitude as unit quaternion w, x, y, z, which rotates the axes of `field` to north, east, down. For a
    #: perfect sensor ``quaternions.rotate_vectors(attitude, field)`` is the field of the site. If the axes are forward,
    #: right, down, it is the attitude of the vehicle. NaN if not known. The yaw of an attitude that an autopilot
    #: estimates may come from the compass that is to be calibrated.
    attitude: Floats | None = None
    currents: Floats | None = None  #: (N, M), A: current of each of M motors, the first motor first
    throttles: Floats | None = None  #: (N, M), 0 to 1: throttle of each of M motors
    #: (N,) each, numbers or words: other columns of the log that the user chose, by their names in the log
    auxiliary: Mapping[str, NDArray[Any]] = dataclasses.field(default_factory=dict)
    source: str = "array"  #: file or other origin, for messages
    #: frame of the recorded axes: ``sensor``, or ``vehicle`` if the logger rotated the readings by the mounting
    frame: str = "sensor"
    skipped: tuple[Skipped, ...] = ()  #: rows that were skipped by the reader
    #: numbers of the columns that are assumed to be the magnetometer's, such as ``1,2,3``; empty if the names of the
    #: columns or the user determine them
    nameless: str = ""
    #: onboard calibration when the log was made, if `field` is not corrected by it. None if not known, or if `field`
    #: was logged after this correction.
    onboard: Calibration | None = None

    @classmethod
    @check_keywords()
    def of(
        cls,
        field: ArrayLike,
        *,
        unit: str | Unit = "counts",
        scale: float | None = None,
        axes: str | Axes = "x,y,z",
        time: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        rate: ArrayLike | None = None,
        temperature: ArrayLike | None = None,
        current: ArrayLike | None = None,
        strength: ArrayLike | None = None,
        throttle: ArrayLike | None = None,
        attitude: ArrayLike | None = None,
        currents: ArrayLike | None = None,
        throttles: ArrayLike | None = None,
        auxiliary: Mapping[str, ArrayLike] | None = None,
        source: str = "array",
    ) -> Samples:
        """Make samples of columns in the recording's own unit and axes, without rows whose field is not finite.

        Raises `ArrayError` for a wrong shape, columns of unequal length, a throttle outside 0 to 1, or quaternions that
        are not of unit length; `UnitError` or `AxesError` for an unknown unit or mapping.

        Parameters
        ----------
        field : (N, 3) array-like
            Raw readings in `unit`.
        unit : str or Unit
            ``uT``, ``mG``, ``G``, ``nT``, ``mT``, ``T`` or ``counts``.
        scale : float, optional
            Microtesla in one count; only with ``counts``.
        axes : str or Axes
            The recorded axis for each new axis, such as ``"x,-y,-z"``.
        time, acceleration, rate, temperature, current, strength, throttle, attitude, currents, throttles : optional
            As the attributes of the same names; vectors and attitude in the recorded axes, strength in `unit`.
        auxiliary : mapping of str to (N,) array-like, optional
            Other columns of numbers or of words, which the offset of a calibration can follow.
        """
        unit = unit if isinstance(unit, Unit) else Unit.of(unit, scale)
        axes = axes if isinstance(axes, Axes) else Axes.of(axes)
        recorded = check_table(field, finite=False)
        rows = len(recorded)
        return cls.from_reader(
            recorded,
            unit=unit,
            axes=axes,
            time=None if time is None else check_column(time, rows, "time"),
            acceleration=None if acceleration is None else _check_vectors(acceleration, rows, "acceleration"),
            rate=None if rate is None else _check_vectors(rate, rows, "rate"),
            temperature=None if temperature is None else check_column(temperature, rows, "temperature"),
            current=None if current is None else check_column(current, rows, "current"),
            strength=None if strength is None else check_column(strength, rows, "strength"),
            throttle=None if throttle is None else _check_throttle(check_column(throttle, rows, "throttle")),
            attitude=None if attitude is None else _check_attitude(attitude, rows),
            currents=None if currents is None else _check_motors(currents, rows, "currents"),
            throttles=None if throttles is None else _check_throttle(_check_motors(throttles, rows, "throttles")),
            auxiliary={name: _check_auxiliary(values, rows, name) for name, values in (auxiliary or {}).items()},
            source=source,
        )

    @classmethod
    def from_reader(
        cls,
        field: Floats,
        *,
        unit: Unit,
        axes: Axes,
        strength: Floats | None = None,
        source: str = "array",
        frame: str = "sensor",
        nameless: str = "",
        auxiliary: Mapping[str, NDArray[Any]] | None = None,
        **others: Floats | None,
    ) -> Samples:
        """Make samples of a reader's float64 columns of equal length, without the checks of `of`."""
        is_silent = find_silent(field)
        noted = silent_entries(field[is_silent, 0], np.flatnonzero(is_silent) + 1)
        if unit.scale != 1.0:
            with np.errstate(over="ignore", invalid="ignore"):
                field = field * unit.scale
        strength = None if strength is None else strength * unit.scale
        read = cls(
            field,
            unit,
            strength=strength,
            source=source,
            frame=frame,
            skipped=noted,
            nameless=nameless,
            auxiliary=auxiliary or {},
            **others,  # type: ignore[arg-type]
        )
        return read.map_axes(axes)._skip_rows(is_silent)

    @property
    def span(self) -> tuple[float, float]:
        """Earliest and latest time in s; NaN without times."""
        if self.time is None or not len(self.time):
            return np.nan, np.nan
        return float(np.fmin.reduce(self.time)), float(np.fmax.reduce(self.time))

    def __len__(self) -> int:
        return len(self.field)

    def __repr__(self) -> str:
        first, last = self.span
        over = f" over {last - first:,.4g} s" if last > first else ""
        others = ", ".join([*(name for name in COLUMNS[1:] if getattr(self, name) is not None), *self.auxiliary])
        axes = "" if self.axes.is_identity else f", axes {self.axes}"
        more = f"{f', with {others}' * bool(others)}{', some left out' * bool(self.skipped)}"
        return f"Samples({self.source}: {count_text(len(self), 'reading')}{over} in {self.unit.inside}{axes}{more})"

    def __getitem__(self, rows: slice | NDArray[np.bool_] | Sequence[int]) -> Samples:
        """Select rows: a slice gives a view, an index or a mask a copy."""
        columns = {name: getattr(self, name) for name in COLUMNS}
        auxiliary = {name: values[rows] for name, values in self.auxiliary.items()}
        taken = {name: values[rows] for name, values in columns.items() if values is not None}
        return replace(self, auxiliary=auxiliary, **taken)

    def disturbance_values(self, name: str) -> NDArray[Any] | None:
        """(N,) values of a recorded disturbance, or words of a column of states; None if it was not recorded.

        >>> flown = Samples.of([[1, 2, 3]], current=[9.0], currents=[[4.0, 5.0]])
        >>> values = flown.disturbance_values
        >>> values("current"), values("current2"), values("current3")
        (array([9.]), array([5.]), None)
        """
        kind, number = kind_and_motor(name)
        if not number:
            whole: NDArray[Any] | None = getattr(self, name) if name in KINDS else self.auxiliary.get(name)
            return whole
        each: Floats | None = getattr(self, MOTORS[kind])
        return None if each is None or number > each.shape[1] else each[:, number - 1]

    @property
    def disturbances(self) -> tuple[str, ...]:
        """Names of the recorded disturbances, including those of single motors."""
        each = {kind: getattr(self, many) for kind, many in MOTORS.items()}
        numbered = [
            name for kind, table in each.items() if table is not None for name in motor_names(kind, table.shape[1])
        ]
        there = [name for name in KINDS if getattr(self, name) is not None]
        return tuple(sorted([*there, *numbered, *self.auxiliary], key=sort_key))

    def map_axes(self, axes: Axes) -> Samples:
        """Map field, acceleration, rate and attitude from the recorded axes to other axes.

        The attitude becomes that of the new axes. A mirror image maps the field alone: it corrects a left-handed
        magnetometer, while the other sensors are right-handed. Raises `AxesError` for samples that are mapped already.

        >>> level = Samples.of([[20.0, 0.0, 45.0]], unit="uT", attitude=[[1.0, 0.0, 0.0, 0.0]])
        >>> over = level.map_axes(Axes.of("x,-y,-z"))
        >>> over.field, over.attitude
        (array([[ 20.,  -0., -45.]]), array([[0., 1., 0., 0.]]))
        >>> mended = level.map_axes(Axes.of("x,y,-z"))
        >>> mended.field, mended.attitude
        (array([[ 20.,   0., -45.]]), array([[1., 0., 0., 0.]]))
        """
        if axes == self.axes:
            return self
        if not self.axes.is_identity:
            raise AxesError(f"{self.source} is in axes {self.axes} already: give one mapping from the recorded axes")
        onboard = None if self.onboard is None else self.onboard.map_axes(axes)
        mapped = replace(self, field=axes.apply(self.field), onboard=onboard, axes=axes)
        if axes.is_mirror:
            return mapped
        return replace(
            mapped,
            acceleration=None if self.acceleration is None else axes.apply(self.acceleration),
            rate=None if self.rate is None else axes.apply(self.rate),
            attitude=None if self.attitude is None else _map_attitude(self.attitude, axes),
        )

    def as_columns(self) -> dict[str, NDArray[Any]]:
        """Columns, (N,) each, by names that contain the unit and that `flinders.read` recognises.

        >>> list(Samples.of([[20.0, 0.0, 45.0]], unit="uT", time=[0.0], throttles=[[0.2, 0.3]]).as_columns())
        ['time_s', 'mag_x_uT', 'mag_y_uT', 'mag_z_uT', 'throttle1_share', 'throttle2_share']
        """
        unit, columns = self.unit.inside, dict[str, "NDArray[Any]"]()
        for kind, (name, axes) in COLUMN_NAMES.items():
            values: Floats | None = getattr(self, kind)
            if values is None:
                continue
            for place, values_of_one in enumerate(np.atleast_2d(values.T)):
                columns[name.format(axes[place] if axes else place + 1, unit=unit)] = values_of_one
        return {**columns, **{name: values for name, values in self.auxiliary.items() if name not in columns}}

    def to_arrow(self) -> Any:  # noqa: ANN401 - pyarrow ships no types
        """Make a pyarrow table of the columns of `as_columns`; its ``to_pandas()`` gives a pandas frame.

        Raises `MissingExtra` without pyarrow.
        """
        return import_optional("pyarrow", "parquet", "a table of Arrow").table(self.as_columns())

    def blocks(self, rows: int = BLOCK_ROWS) -> Iterator[Samples]:
        """Yield blocks of `rows` rows in order, as views."""
        for start in range(0, len(self), rows):
            yield self[start : start + rows]

    def _skip_rows(self, is_silent: NDArray[np.bool_]) -> Samples:
        """Remove silent readings and rows whose field is not finite, and list them in `skipped`."""
        is_finite = np.isfinite(self.field)
        if is_finite.all() and not is_silent.any():
            return self
        whole = np.all(is_finite, axis=1)
        rows = np.flatnonzero(~whole)
        noted = Skipped(NOT_FINITE, len(rows), tuple(int(row) + 1 for row in rows[:MAX_NOTED_LINES]))
        skipped = (*self.skipped, noted) if len(rows) else self.skipped
        return replace(self[whole & ~is_silent], skipped=skipped)


class Recording(Protocol):
    """Source of samples that can be read block by block, any number of times."""

    @property
    def source(self) -> str:
        """File or other origin, for messages."""

    @property
    def unit(self) -> Unit:
        """Unit of the recording and of its blocks."""

    @property
    def axes(self) -> Axes:
        """Mapping of the recorded axes to those of the blocks."""

    def blocks(self) -> Iterator[Samples]:
        """Yield all blocks from the first on; all have the same unit, axes and columns."""


class RecordingWrapper:
    """Base of recordings that process the blocks of another recording and keep its source, unit and axes."""

    __slots__ = ()
    recording: Recording

    @property
    def source(self) -> str:
        """Source of the inner recording."""
        return self.recording.source

    @property
    def unit(self) -> Unit:
        """Unit of the inner recording."""
        return self.recording.unit

    @property
    def axes(self) -> Axes:
        """Axes of the inner recording."""
        return self.recording.axes

    @property
    def frame(self) -> str:
        """Frame of the inner recording."""
        return frame_of(self.recording)

    @property
    def onboard(self) -> Calibration | None:
        """Onboard calibration of the inner recording."""
        return onboard_of(self.recording)


def frame_of(recording: Recording) -> str:
    """Frame of the recorded axes: ``sensor``, or ``vehicle`` if the logger rotated the readings by the mounting.

    >>> frame_of(Samples.of([[1, 2, 3]]))
    'sensor'
    """
    return str(getattr(recording, "frame", "sensor"))


def onboard_of(recording: Recording) -> Calibration | None:
    """Onboard calibration when a log was made, if the readings are not corrected by it; None if not known."""
    onboard: Calibration | None = getattr(recording, "onboard", None)
    return onboard


def _check_vectors(values: ArrayLike, rows: int, name: str) -> Floats:
    """Check an (N, 3) column, which may have NaN in any row."""
    array = check_table(values, name, finite=False)
    check_column(array[:, 0], rows, name)
    return array


def _check_motors(values: ArrayLike, rows: int, name: str) -> Floats:
    """Check an (N, M) column of M motors, which may have NaN in any row."""
    array = to_floats(values, name)
    if array.ndim != 2 or not 1 <= array.shape[1] <= MAX_MOTORS:
        raise ArrayError(
            f"{name} has shape {array.shape}: need ({rows}, M), a column for each of up to {MAX_MOTORS} motors"
        )
    check_column(array[:, 0], rows, name)
    return array


def _check_auxiliary(values: ArrayLike, rows: int, name: str) -> NDArray[Any]:
    """Check an (N,) column of numbers or of words."""
    array = np.asarray(values)
    if array.dtype.kind in "USO" and array.shape == (rows,) and any(isinstance(value, str) for value in array.tolist()):
        return np.array(["" if value is None else str(value) for value in array.tolist()])
    return check_column(values, rows, name)


def _check_throttle(array: Floats) -> Floats:
    """Check throttles, 0 to 1 or NaN."""
    beyond = np.argwhere((array < 0.0) | (array > 1.0))
    if len(beyond):
        first = beyond[0]
        raise ArrayError(
            f"throttle is {array[tuple(first)]:g} at index {first[0]} ({len(beyond):,} such values): need 0 to 1, or "
            "NaN if not known; divide per cent by 100"
        )
    return array


def _map_attitude(attitude: Floats, axes: Axes) -> Floats:
    """(N, 4) attitude of mapped right-handed axes, from that of the recorded axes."""
    return attitude if axes.is_identity else product(attitude, from_matrix(axes.apply(np.eye(3))))


def _check_attitude(values: ArrayLike, rows: int) -> Floats:
    """Check (N, 4) unit quaternions, which may have NaN in any row."""
    array = check_attitudes(values)
    if array.shape != (rows, 4):
        raise ArrayError(f"attitude has shape {array.shape}: need ({rows}, 4), one quaternion w, x, y, z a reading")
    return array
