"""Calibration without a recording, from six typed numbers: the extremes of each axis that a board shows.

Boards with a display and no port show only the smallest and the largest reading of each axis. These give an offset and
three scales. They give no noise, no count of readings and no directions, so that no heading error can be claimed, and
the verdict is never better than ``limited``. The finding states the heading error that would result if the half-ranges
differed only because the turn was incomplete.

>>> car = from_extremes([-157, 98, -123, 124, -109, 101], variant="largest")
>>> car
Extremes(limited, offset -29.5, 0.5, -4, scale 1, 1.03, 1.21)
>>> car.findings[0].code, round(car.findings[0].number, 1)
('typed-extremes', 3.6)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from flinders.arrays import to_floats
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.calibration_file import Fitted
from flinders.core.keywords import check_keywords
from flinders.core.units import Unit, unit_label
from flinders.errors import UsageError
from flinders.estimators.data import MAX_READING, MIN_READING
from flinders.estimators.minmax import MinMax, corrected_length, extremes_ellipsoid
from flinders.findings import Finding, certain_finding, link_causes
from flinders.fitting.result import Judged, Outcome
from flinders.fitting.verdict import calibration_findings
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.heading.error_propagation import level_error
from flinders.likelihood.equations import MIN_NOISE

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.core.calibration_file import Document, ProvenanceRecord
    from flinders.estimators.minmax import Variant

TYPED_FINDING: Final = "typed-extremes"


@dataclass(frozen=True, slots=True, eq=False)
class Extremes(Judged, Outcome):
    """A calibration from six numbers, without a claim of accuracy."""

    calibration: Calibration  #: the correction
    low: Floats  #: (3,): smallest reading of each axis, in mapped axes and the calibration's unit
    high: Floats  #: (3,): largest reading of each axis, in mapped axes and the calibration's unit
    findings: tuple[Finding, ...] = ()  #: most severe first

    @property
    def ellipsoid(self) -> Ellipsoid:
        """The ellipsoid that the calibration maps to a sphere."""
        return extremes_ellipsoid(self.low, self.high)

    @property
    def scale(self) -> Floats:
        """(3,) factor of each axis."""
        return np.diag(self.calibration.matrix)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, with the keys of a fit; unknown values are None."""
        return {
            "verdict": self.verdict,
            "method": MinMax.name,  # ``minmax``
            "calibration": self.calibration.as_dict(),
            "heading_error_deg": None,
            "noise": None,
            "samples": 0,
            "coverage": {},
            "covariance": None,
            # `low` and `high` end of each axis, and its `scale`, which makes the ranges equal
            "extremes": {"low": self.low.tolist(), "high": self.high.tolist(), "scale": self.scale.tolist()},
            "findings": [finding.as_dict() for finding in self.findings],
        }

    def to_document(self, provenance: ProvenanceRecord | None = None) -> Document:
        """Content of the calibration file, without a claim."""
        record = Fitted(method=MinMax.name, samples=0, verdict=self.verdict, findings=self.finding_records)
        return self.calibration.to_document(fit=record, provenance=provenance)

    def __repr__(self) -> str:
        offset = ", ".join(f"{value:.6g}" for value in self.calibration.offset)
        scale = ", ".join(f"{value:.3g}" for value in self.scale)
        return f"Extremes({self.verdict}, offset {offset}, scale {scale})"


@check_keywords()
def from_extremes(
    numbers: ArrayLike,
    *,
    variant: Variant = "mean",
    field_strength: float | None = None,
    target_deg: float = 1.0,
    dip_deg: float = 60.0,
    unit: str | Unit | None = None,
    axes: str | Axes | None = None,
    sensor: str | None = None,
) -> Extremes:
    """Calibration from the smallest and the largest reading of each axis, by the formula of `MinMax`.

    Parameters
    ----------
    numbers : (6,) array-like, in `unit`
        Smallest and largest reading of x, of y and of z, as recorded: before the axes are mapped.
    variant : str
        See `MinMax`.
    field_strength, target_deg, dip_deg, sensor
        As for `flinders.fit`; only the finding uses the target.
    unit : str or Unit, optional
        Unit of the numbers, such as ``"mG"``; by default counts.
    axes : str or Axes, optional
        Recorded axis that becomes x, y and z, such as ``"x,-y,-z"``.

    Returns
    -------
    Extremes
        Calibration whose verdict is never better than ``limited``, as six numbers contain no measure of error.

    Raises
    ------
    UsageError
        Unless `numbers` are six finite numbers, the smaller of each axis first; for an unknown variant, or a target
        that is not positive. `UnitError` and `AxesError`, its subclasses, for an unknown unit or unknown axes.

    Examples
    --------
    >>> from_extremes([-10, 50, -30, 30, 0, 60], unit="uT").calibration.offset
    array([20.,  0., 30.])
    """
    if not target_deg > 0.0:
        raise UsageError(f"target is {target_deg:g}°: need a positive angle")
    MinMax(variant)
    unit = Unit.of(unit) if isinstance(unit, str) else unit or Unit.of()
    axes = Axes.of(axes) if isinstance(axes, str) else axes or Axes()
    mapped = axes.apply(unit.scale * _pairs(numbers).T)
    low, high = mapped.min(axis=0), mapped.max(axis=0)
    ellipsoid = extremes_ellipsoid(low, high)
    calibration = Calibration.from_ellipsoid(
        ellipsoid.centre,
        ellipsoid.shape,
        field_strength=corrected_length(ellipsoid.shape.diagonal(), variant)
        if field_strength is None
        else field_strength,
        raw=unit,
        axes=axes,
        sensor=sensor,
    )
    extremes = Extremes(replace(calibration, field_strength_known=field_strength is not None), low, high)
    findings = link_causes([_finding(extremes, target_deg, dip_deg), *calibration_findings(extremes.calibration)])
    return replace(extremes, findings=findings)


def _pairs(numbers: ArrayLike) -> Floats:
    """(3, 2) smallest and largest reading of each axis."""
    values = to_floats(numbers, "extremes")
    if values.shape != (6,):
        raise UsageError(f"extremes are {values.size} numbers: need six, smallest and largest of x, of y and of z")
    pairs = values.reshape(3, 2)
    for axis, (low, high) in zip("xyz", pairs.tolist(), strict=True):
        if not low < high:
            raise UsageError(f"{axis} goes from {low:g} to {high:g}: need the smaller first, and two different numbers")
    half = np.diff(pairs / 2.0, axis=1)
    if not (half.min() > max(MIN_READING, MIN_NOISE * half.max()) and np.abs(pairs).max() < MAX_READING):
        raise UsageError(f"half-ranges of {half.min():.3g} to {half.max():.3g}: no magnetometer reads such numbers")
    return pairs


def _finding(extremes: Extremes, target_deg: float, dip_deg: float) -> Finding:
    """Finding that the accuracy is unknown, with the heading error if the turn did not reach the ends of some axes."""
    half = extremes.ellipsoid.shape.diagonal()
    short = half.max() - half
    shortfall, worst = float(short.max()), 0.0
    if shortfall:
        covariance = np.diag(np.append(short**2, np.zeros(6)))
        sphere = Ellipsoid(extremes.ellipsoid.centre, half.max() * np.eye(3))
        worst = level_error(sphere, covariance, dip_deg=dip_deg).worst
    values = {"is_typed": 1.0, "unturned_deg": worst, "target_deg": target_deg, "shortfall": shortfall}
    return certain_finding({**values, "unit": unit_label(extremes.calibration.unit)}, TYPED_FINDING)
