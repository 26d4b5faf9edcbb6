"""A calibration with what is claimed of it: what is needed to hold it against others, or to put it together with them.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> found = calibrate.fit(simulate.tumble(seed=1).samples)
>>> one = Judged.from_fit(found, name="monday")
>>> one.name, one.samples, one.covariance.shape
('monday', 3000, (9, 9))
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np
from msgspec import UNSET

from flinders.arrays import floats
from flinders.core.calibration import Calibration
from flinders.core.calibration_file import PARAMETERS, read
from flinders.core.units import label
from flinders.errors import ArrayError, AxesError, DocumentError, UnitError
from flinders.geometry.ellipsoid import Ellipsoid, upper
from flinders.geometry.equator import equator, to_equator

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration_file import Document, Fitted, SourceFile
    from flinders.fitting.result import Fit


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """A calibration and its covariance.

    Attributes
    ----------
    calibration : Calibration
    covariance : (9, 9) float, optional
        Of the offset b and the shape S = F W⁻¹, in the order b₁, b₂, b₃, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃, in the square
        of the calibration's unit. None where it claims nothing: it is then taken as exact.
    name : str
        What messages call it.
    record : Fitted, optional
        How it was found.
    files : tuple of SourceFile
        The recordings that it came from, where that is known.

    Raises
    ------
    ArrayError
        Unless the covariance is (9, 9), symmetric and without negative eigenvalues.
    """

    calibration: Calibration
    covariance: Floats | None = None
    name: str = "calibration"
    record: Fitted | None = None
    files: tuple[SourceFile, ...] = ()

    def __post_init__(self) -> None:
        """Check the covariance."""
        if self.covariance is not None:
            object.__setattr__(self, "covariance", _covariance(self.covariance))

    @classmethod
    def from_fit(cls, fit: Fit, *, name: str = "fit") -> Self:
        """Take what a fit found and claims."""
        return cls(fit.calibration, fit.covariance, name, fit.to_document().fit)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a calibration file, with the covariance where it holds one.

        Raises
        ------
        DocumentError
            For a file that cannot be opened or understood, or whose covariance is none of offset and shape.
        """
        return cls.from_document(read(path), name=os.fspath(path))

    @classmethod
    def from_document(cls, document: Document, *, name: str = "calibration") -> Self:
        """Take both out of the content of a calibration file.

        Raises
        ------
        DocumentError
            As `load`.
        """
        calibration = Calibration.from_document(document, source=name)
        files = document.provenance.files if document.provenance else ()
        if document.fit is None or document.fit.covariance is None:
            return cls(calibration, None, name, document.fit, files)
        names = document.fit.covariance_of
        missing = [parameter for parameter in PARAMETERS if parameter not in names]
        if missing:
            raise DocumentError(f"{name}: fit.covariance lacks {', '.join(missing)}: need offset and shape, all nine")
        rows = [names.index(parameter) for parameter in PARAMETERS]
        try:
            covariance = np.array(document.fit.covariance)[np.ix_(rows, rows)]
            return cls(calibration, covariance, name, document.fit, files)
        except ArrayError as error:
            raise DocumentError(f"{name}: fit.{error}") from None

    @property
    def ellipsoid(self) -> Ellipsoid:
        """The ellipsoid that the calibration makes a sphere, which knows no rotation."""
        shape = self.calibration.shape
        squares, axes = np.linalg.eigh(shape @ shape.T)
        return Ellipsoid(self.calibration.offset, (axes * np.sqrt(squares)) @ axes.T)

    @property
    def rotation(self) -> Floats:
        """(3, 3) from the magnetometer's own axes to those it corrects to; unity where it knows none."""
        turned = self.calibration.matrix @ self.ellipsoid.shape / self.calibration.field_strength
        left, _, right = np.linalg.svd(turned)  # rounding off
        rotation: Floats = left @ right
        return rotation

    @property
    def rotation_covariance(self) -> Floats | None:
        """(3, 3) rad², about the axes of the body; None where nobody said."""
        return self._beside("rotation_covariance")

    @property
    def acceleration_bias(self) -> Floats | None:
        """(3,) m/s² what the accelerometer beside it reads too much; None where nobody found out."""
        return self._beside("acceleration_bias")

    def _beside(self, what: str) -> Floats | None:
        """What the record holds of the instruments beside the magnetometer."""
        value = getattr(None if self.record is None else self.record.beside, what, UNSET)
        return None if value is UNSET else np.array(value)

    @property
    def plane(self) -> str | None:
        """The plane of the one turn that it rests on; None for all attitudes, or where nobody said."""
        return None if self.record is None else self.record.plane

    def level(self, dip_deg: float) -> Judged:
        """What it says of a turn in x and y, and nothing else: an ellipsoid whose equator is the ellipse of that turn.

        Parameters
        ----------
        dip_deg : float
            Inclination of the field at the turn, positive where it points along +z of the mapped axes; one that rests
            on a level turn has its own.
        """
        own = None if self.plane is None or self.record is None else self.record.heading_error_deg
        if own is not None and own.dip_deg is not None:
            dip_deg = own.dip_deg
        flat, rows = equator(self.ellipsoid, "xy", dip_deg=dip_deg), to_equator("xy", dip_deg=dip_deg)
        known = self.calibration.field_strength_known
        calibration = Calibration.from_ellipsoid(
            flat.centre,
            flat.shape,
            field_strength=self.calibration.field_strength * math.cos(math.radians(dip_deg)) if known else None,
            raw=self.calibration.raw,
            axes=self.calibration.axes,
        )
        covariance = None if self.covariance is None else rows @ self.covariance @ rows.T
        return replace(self, calibration=replace(calibration, frame=self.calibration.frame), covariance=covariance)

    @property
    def samples(self) -> int:
        """Readings that it came from; 0 where nobody said."""
        return self.record.samples if self.record else 0


def refuse_unlike(a: Judged, b: Judged) -> None:
    """Refuse calibrations whose numbers cannot be held against each other.

    Raises
    ------
    UnitError
        Where one is in µT and the other in counts.
    AxesError
        Where their axes are mapped in different ways.
    """
    if a.calibration.unit != b.calibration.unit:
        raise UnitError(
            f"{a.name} is for readings in {label(a.calibration.unit)}, {b.name} for {label(b.calibration.unit)}: "
            "calibrate both with one unit (counts need --scale)"
        )
    for what in ("axes", "frame"):
        ours, theirs = getattr(a.calibration, what), getattr(b.calibration, what)
        if ours != theirs:
            how = "with the same --axes" if what == "axes" else "from readings in the same axes, sensor's or vehicle's"
            raise AxesError(f"{a.name} has {what} {ours}, {b.name} has {what} {theirs}: calibrate both {how}")


def rescaled(covariance: Floats, factor: float) -> Floats:
    """(9, 9) covariance of (b, S) once the shape S was multiplied by `factor`."""
    factors = np.repeat([1.0, factor], [3, 6])
    return covariance * np.outer(factors, factors)


def without_scale(covariance: Floats, shape: Floats, reference: Floats) -> Floats:
    """(9, 9) covariance of (b, S) once S was brought to the size of a reference R (3, 3), tr(R⁻¹S) = 3.

    For S about R, that is the same determinant: S/s with s = tr(R⁻¹S)/3 changes by δS − S tr(R⁻¹δS)/3, given
    as `shape` after it was brought there. Whatever its scale was, the row of R⁻¹ is free of it, so that several
    covariances are singular in the same direction.
    """
    jacobian = np.eye(9)
    jacobian[3:, 3:] -= np.outer(upper(shape), trace_with(reference)) / 3.0
    projected: Floats = jacobian @ covariance @ jacobian.T
    return projected


def trace_with(reference: Floats) -> Floats:
    """(6,) coefficients of tr(R⁻¹S) in the entries of S that `upper` takes."""
    relative: Floats = upper(np.linalg.inv(reference)) * [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]
    return relative


def _covariance(values: Floats) -> Floats:
    """Let through what can be a covariance of nine parameters."""
    array = floats(values, "covariance")
    if array.shape != (9, 9):
        raise ArrayError(f"covariance has shape {array.shape}: need (9, 9), of offset and shape")
    lack = float(np.abs(array - array.T).max())
    largest = float(np.abs(array).max())
    if lack > 1e-6 * largest:
        raise ArrayError(f"covariance is not symmetric: entries across the diagonal differ by up to {lack:.3g}")
    lowest = float(np.linalg.eigvalsh(array)[0])
    if lowest < -1e-6 * largest:
        raise ArrayError(f"covariance has the eigenvalue {lowest:.3g}: no variance is negative")
    return array
