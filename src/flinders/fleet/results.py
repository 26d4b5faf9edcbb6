"""Results of a fleet: a row for each recording of each unit, with its calibration or the reason why there is none.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble = simulate.tumble(seed=1).samples
>>> row = UnitResult.of_fit(calibrate.fit(tumble), "A17", start_s=0.0, end_s=60.0, readings=len(tumble))
>>> row.verdict, row.code, len(row.covariance)
('good', '', 45)
>>> rows = UnitResults.of([UnitResult(unit="B02", verdict="failed", code="unreadable"), row]).sorted()
>>> rows.unit.tolist(), rows.verdict.tolist(), rows.offset.shape
(['A17', 'B02'], ['good', 'failed'], (2, 3))
>>> back = UnitResults.from_arrow(rows.to_arrow())
>>> back.code.tolist(), bool(np.array_equal(back.covariance, rows.covariance, equal_nan=True))
(['', 'unreadable'], True)

Unknown values are NaN here and null in Arrow and Parquet.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.errors import DocumentError, FlindersError, MissingExtra

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

TEXTS: Final = ("unit", "recording", "verdict", "code", "message", "method", "unit_of_field", "batch")
"""Columns of text."""
COUNTS: Final = ("readings", "used")
"""Columns of whole numbers."""
NUMBERS: Final = ("start_s", "end_s", "worst_deg", "rms_deg", "dip_deg", "noise", "radius", "coverage")
"""Columns of a number that may be missing."""
LISTS: Final = {"offset": 3, "matrix": 9, "covariance": 45}
"""Columns of so many numbers, which are missing together."""
UPPER: Final = np.triu_indices(9)
"""Indices of the 45 numbers of a covariance in its nine rows."""
KEY: Final = ("unit", "recording", "start_s")
"""Columns by which the table is sorted."""
VERSION: Final = "2"
"""Version of the columns, in the metadata of a file; the first had no `batch`."""
SIGN: Final = b"flinders.fleet"
"""Key of that metadata, by which a table of a fleet is recognised."""
LATER: Final = {"batch": ""}
"""Columns that tables of earlier releases lack, and their values."""
GROUP: Final = 65_536
"""Rows in a row group of the table."""
LONGEST: Final = 500
"""Characters of a message, at most."""


def _missing(length: int) -> tuple[float, ...]:
    """Unknown numbers."""
    return (math.nan,) * length


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitResult:
    """Result of one recording of one unit.

    Attributes
    ----------
    unit : str
        Name of the sensor or vehicle.
    recording : str
        Name of the recording; empty if the unit has one recording without a name.
    start_s, end_s : float, s
        Earliest and latest time of its readings, since 1970 if it has dates; NaN without times.
    readings, used : int
        All of them, and those that the fit used.
    verdict : str
        ``good``, ``limited``, ``refused``, or ``failed`` if it could not be read or calculated at all.
    code, message : str
        Of the error of a refused or failed one, else empty.
    method : str
        Method of the final fit.
    worst_deg, rms_deg : float
        Heading error of a level vehicle, 1 σ, at a dip of `dip_deg`.
    dip_deg : float
    offset : 3 float, in `unit_of_field`
    matrix : 9 float
        Row by row.
    covariance : 45 float
        Of (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃), as `Fit.covariance`: its upper triangle, row by row.
    noise, radius : float, in `unit_of_field`
        Noise of the readings about the ellipsoid; strength of the corrected field.
    coverage : float
        Fraction of the sphere that was covered.
    findings : tuple of str
        Codes, by severity.
    unit_of_field : str
        ``uT`` or ``counts``.
    batch : str
        Hardware batch of the unit; empty if it is not known.
    """

    unit: str
    recording: str = ""
    start_s: float = math.nan
    end_s: float = math.nan
    readings: int = 0
    used: int = 0
    verdict: str = "failed"
    code: str = ""
    message: str = ""
    method: str = ""
    worst_deg: float = math.nan
    rms_deg: float = math.nan
    dip_deg: float = math.nan
    offset: tuple[float, ...] = _missing(3)
    matrix: tuple[float, ...] = _missing(9)
    covariance: tuple[float, ...] = _missing(45)
    noise: float = math.nan
    radius: float = math.nan
    coverage: float = math.nan
    findings: tuple[str, ...] = ()
    unit_of_field: str = ""
    batch: str = ""

    @classmethod
    def of_fit(
        cls,
        fit: Fit,
        unit: str,
        *,
        recording: str = "",
        start_s: float = math.nan,
        end_s: float = math.nan,
        readings: int = 0,
    ) -> Self:
        """Row of a fit; one that is refused gives no calibration.

        Parameters
        ----------
        fit : Fit
        unit, recording, start_s, end_s, readings
            As the attributes.
        """
        is_given = fit.verdict != "refused"
        error = fit.heading_error_deg
        worst = fit.findings[0] if fit.findings and not is_given else None
        return cls(
            unit=unit,
            recording=recording,
            start_s=start_s,
            end_s=end_s,
            readings=readings,
            used=int(fit.samples),
            verdict=fit.verdict,
            code="" if is_given else "refused",
            message="" if worst is None else worst.advice[:LONGEST],
            method=fit.method,
            worst_deg=float(error.worst),
            rms_deg=float(error.rms),
            dip_deg=float(error.dip_deg),
            offset=tuple(fit.calibration.offset.tolist()) if is_given else _missing(3),
            matrix=tuple(fit.calibration.matrix.ravel().tolist()) if is_given else _missing(9),
            covariance=tuple(fit.covariance[UPPER].tolist()) if is_given else _missing(45),
            noise=float(fit.noise),
            radius=float(fit.calibration.field_strength) if is_given else math.nan,
            coverage=float(fit.coverage.fraction),
            findings=tuple(finding.code for finding in fit.findings),
            unit_of_field=fit.calibration.unit,
        )

    @classmethod
    def of_error(
        cls,
        error: Exception,
        unit: str,
        *,
        recording: str = "",
        start_s: float = math.nan,
        end_s: float = math.nan,
        readings: int = 0,
        unit_of_field: str = "",
    ) -> Self:
        """Row of an error: a fit that was refused, readings without one, or a file that could not be read.

        >>> from flinders.errors import TooFewSamples
        >>> row = UnitResult.of_error(TooFewSamples(found=5, needed=10, method="likelihood"), "A17", readings=5)
        >>> row.verdict, row.code, row.message[:18]
        ('refused', 'too-few-samples', '5 usable readings,')
        """
        fit = getattr(error, "fit", None)
        if fit is not None:
            return cls.of_fit(fit, unit, recording=recording, start_s=start_s, end_s=end_s, readings=readings)
        code, message = "internal", f"{type(error).__name__}: {error}; this is a fault in Flinders, report it"
        if isinstance(error, FlindersError):
            code, message = error.code, str(error)
        return cls(
            unit=unit,
            recording=recording,
            start_s=start_s,
            end_s=end_s,
            readings=readings,
            verdict="refused" if isinstance(error, FlindersError) and error.exit_code == 4 else "failed",
            code=code,
            message=one_line(message),
            unit_of_field=unit_of_field,
        )


@dataclass(frozen=True, slots=True, eq=False)
class UnitResults:
    """Many rows, column by column: (R,) arrays by the names of `UnitResult`, and (R, K) ones for its lists."""

    unit: NDArray[np.object_]
    recording: NDArray[np.object_]
    start_s: Floats
    end_s: Floats
    readings: NDArray[np.int64]
    used: NDArray[np.int64]
    verdict: NDArray[np.object_]
    code: NDArray[np.object_]
    message: NDArray[np.object_]
    method: NDArray[np.object_]
    worst_deg: Floats
    rms_deg: Floats
    dip_deg: Floats
    offset: Floats
    matrix: Floats
    covariance: Floats
    noise: Floats
    radius: Floats
    coverage: Floats
    findings: NDArray[np.object_]
    unit_of_field: NDArray[np.object_]
    batch: NDArray[np.object_]

    @classmethod
    def of(cls, rows: Sequence[UnitResult]) -> Self:
        """Make columns of rows."""
        return cls(**{name: _column(name, [getattr(row, name) for row in rows]) for name in NAMES})

    @classmethod
    def joined(cls, parts: Iterable[UnitResults]) -> Self:
        """Concatenate tables."""
        tables = list(parts)
        if not tables:
            return cls.of(())
        return cls(**{name: np.concatenate([getattr(part, name) for part in tables]) for name in NAMES})

    def __len__(self) -> int:
        return len(self.unit)

    def __repr__(self) -> str:
        counts = ", ".join(f"{count:,} {verdict}" for verdict, count in self.verdicts().items())
        return f"Rows({counts or 'empty'})"

    def __getitem__(self, rows: slice | NDArray[Any] | Sequence[int]) -> Self:
        """Take some rows."""
        return type(self)(**{name: getattr(self, name)[rows] for name in NAMES})

    def row(self, place: int) -> UnitResult:
        """One row."""
        return UnitResult(**{name: _cell(getattr(self, name)[place]) for name in NAMES})

    def verdicts(self) -> dict[str, int]:
        """Number of rows of each verdict that occurs, the best first."""
        return {name: count for name in VERDICTS if (count := int(np.count_nonzero(self.verdict == name)))}

    def sorted(self) -> Self:
        """Sorted by `KEY`, rows without a time last."""
        start = np.where(np.isnan(self.start_s), np.inf, self.start_s).tolist()
        keys = list(zip(self.unit.tolist(), self.recording.tolist(), start, strict=True))
        return self[np.array(sorted(range(len(keys)), key=keys.__getitem__), dtype=np.intp)]

    def to_arrow(self) -> Any:  # noqa: ANN401 - pyarrow ships no types
        """As a table of Arrow.

        Raises
        ------
        MissingExtra
            If pyarrow is not installed.
        """
        arrow = needs_arrow()
        arrays = [_array(arrow, name, getattr(self, name)) for name in NAMES]
        return arrow.Table.from_arrays(arrays, schema=schema())

    @classmethod
    def from_arrow(cls, table: Any) -> Self:  # noqa: ANN401
        """From a table of Arrow that has the columns of `schema`; those `LATER` may be missing.

        Raises
        ------
        DocumentError
            If columns are missing.
        """
        missing = [name for name in NAMES if name not in table.column_names and name not in LATER]
        if missing:
            raise DocumentError(
                f"this is no table of a fleet: it has no {', '.join(missing)}; make one with `flinders fleet`"
            )
        there = set(table.column_names)
        known = {name: _from_arrow(name, table.column(name)) for name in NAMES if name in there}
        later: dict[str, Any] = {name: objects([LATER[name]] * len(table)) for name in NAMES if name not in there}
        return cls(**known, **later)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """Read a Parquet file of `flinders fleet`.

        Raises
        ------
        DocumentError
            If it is none.
        """
        needs_arrow()
        from pyarrow import parquet
        from pyarrow.lib import ArrowException

        try:
            table = parquet.read_table(path, page_checksum_verification=True)
        except (OSError, ArrowException) as error:
            raise DocumentError(f"{path}: cannot be read as a table of a fleet ({error})") from None
        return cls.from_arrow(table)

    def to_bytes(self) -> bytes:
        """As an Arrow file, which a worker returns."""
        arrow = needs_arrow()
        table = self.to_arrow()
        sink = arrow.BufferOutputStream()
        with arrow.ipc.new_file(sink, table.schema) as writer:
            writer.write_table(table)
        return bytes(sink.getvalue().to_pybytes())

    @classmethod
    def from_bytes(cls, content: bytes) -> Self:
        """From `to_bytes`."""
        return cls.from_arrow(needs_arrow().ipc.open_file(content).read_all())


NAMES: Final = tuple(field.name for field in dataclasses.fields(UnitResults))
"""The columns, in order."""
VERDICTS: Final = ("good", "limited", "refused", "failed")
"""From the best to the worst."""


def needs_arrow() -> Any:  # noqa: ANN401
    """Import pyarrow, which writes the table of a fleet.

    Raises
    ------
    MissingExtra
        If it is not installed.
    """
    try:
        import pyarrow
        import pyarrow.ipc
    except ImportError:
        raise MissingExtra("pyarrow", "fleet", "the table of a fleet") from None
    return pyarrow


def schema() -> Any:  # noqa: ANN401
    """Columns and types of the table in Arrow and Parquet."""
    arrow = needs_arrow()
    kinds = {
        **dict.fromkeys(TEXTS, arrow.string()),
        **dict.fromkeys(COUNTS, arrow.int64()),
        **dict.fromkeys(NUMBERS, arrow.float64()),
        **{name: arrow.list_(arrow.float64(), length) for name, length in LISTS.items()},
        "findings": arrow.list_(arrow.string()),
    }
    return arrow.schema([(name, kinds[name]) for name in NAMES], metadata={SIGN: VERSION})


def _column(name: str, cells: Sequence[Any]) -> NDArray[Any]:
    """Column of the cells of rows."""
    if name in LISTS:
        return np.array(cells, dtype=float).reshape(len(cells), LISTS[name])
    if name in NUMBERS:
        return np.array(cells, dtype=float)
    if name in COUNTS:
        return np.array(cells, dtype=np.int64)
    return objects(cells)


def objects(cells: Sequence[Any]) -> NDArray[np.object_]:
    """(R,) array of texts, or of tuples of them."""
    column = np.empty(len(cells), dtype=object)
    for place, cell in enumerate(cells):  # a slice would take tuples of one length for rows of a matrix
        column[place] = cell
    return column


def one_line(message: str) -> str:
    """A message as it stands in the table."""
    return " ".join(message.split())[:LONGEST]


def _cell(cell: Any) -> Any:  # noqa: ANN401
    """Cell of a column as a value of Python."""
    if isinstance(cell, np.ndarray):
        return tuple(cell.tolist())
    return cell.item() if isinstance(cell, np.generic) else cell


def _array(arrow: Any, name: str, column: NDArray[Any]) -> Any:  # noqa: ANN401
    """Column as Arrow, null for NaN."""
    if name in NUMBERS:
        return arrow.array(column, mask=np.isnan(column))
    if name in LISTS:
        flat = arrow.array(np.ascontiguousarray(column, dtype=float).ravel())
        missing = arrow.array(np.isnan(column).all(axis=1))
        return arrow.FixedSizeListArray.from_arrays(flat, LISTS[name], mask=missing)
    if name in COUNTS:
        return arrow.array(column)
    kind = schema().field(name).type
    if name == "findings":  # few combinations, each of which many rows have
        kinds: dict[tuple[str, ...], int] = {}
        places = [kinds.setdefault(cell, len(kinds)) for cell in column.tolist()]
        return arrow.array(map(list, kinds), type=kind, size=len(kinds)).take(arrow.array(places, arrow.int64()))
    return arrow.array(column, type=kind)


def _from_arrow(name: str, column: Any) -> NDArray[Any]:  # noqa: ANN401
    """Column from Arrow, NaN for null."""
    column = column.combine_chunks()
    if name in LISTS:
        return _list(column, LISTS[name])
    if name in NUMBERS:
        return np.array(column.to_numpy(zero_copy_only=False), dtype=float)
    if name in COUNTS:
        return np.array(column.to_numpy(zero_copy_only=False), dtype=np.int64)
    cells = column.to_pylist()
    return objects([tuple(cell or ()) for cell in cells] if name == "findings" else [cell or "" for cell in cells])


def _list(column: Any, length: int) -> Floats:  # noqa: ANN401
    """(R, length) from a column of lists."""
    numbers = np.full((len(column), length), np.nan)
    known = np.asarray(column.is_valid())
    numbers[known] = np.asarray(column.drop_null().flatten(), dtype=float).reshape(-1, length)
    return numbers
