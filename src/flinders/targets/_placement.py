"""Mounting of a sensor in a body, for systems with a setting for it: any rotation, or one by right angles.

A calibration W (m − b) with W = Q S and S symmetric corrects and rotates. Written with the sensor's own axes it is

    v = R S (m − b)        R from the sensor's axes to those of the body

The target of a mounting stores R. S and b are left to the program that reads the sensor, and are written as a comment.
R combines the rotation in the calibration, the mapping of its axes, and the mounting during the recording. For a
mirrored sensor R has the determinant −1.

R is rounded to one of the 24 rotations by right angles if exactly one of them is within 3 σ; otherwise R is written as
it was found.

>>> from flinders.core.units import Unit
>>> from flinders.targets._mounting import euler
>>> turned = Calibration(euler(0, 0, 89.7), [10, 20, 30], 50.0, rotation="estimated", raw=Unit.of("uT"))
>>> known = ExportOptions(rotation_covariance=np.deg2rad(0.2) ** 2 * np.eye(3))
>>> placement = Placement.of(turned, known, who="this system")
>>> str(placement.axes), placement.sigma_deg.round(3)
('-y,x,z', array([0.2, 0.2, 0.2]))
>>> Placement.of(turned, ExportOptions(), who="this system").axes is None        # its uncertainty is unknown
True
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.axes import nearest_axes, same_handed_axes
from flinders.core.calibration import Calibration
from flinders.core.symmetric_matrix import is_positive_definite
from flinders.core.units import unit_label
from flinders.errors import DocumentError, NotExportable, figures
from flinders.geometry.rotation import rotation_vectors
from flinders.targets._difference import heading_deg
from flinders.targets._mounting import MAX_TURN_DEG, MountingTable, apart_deg, in_words
from flinders.targets._numbers import OWN, in_recorded_axes, unmapping_matrix
from flinders.targets._target import ExportOptions, Target, Written

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.axes import Axes

CHI_SQUARED: Final = 14.16
"""Quantile of chi-square for three degrees of freedom at the probability of 3 σ: exceeded in 0.27 % of cases."""
SIGNIFICANT_DIGITS: Final = 7
"""Significant digits of the correction in the comment of a mounting."""
MAX_SHEAR: Final = 0.01
"""Largest deviation of a matrix from a rotation, by scale or shear, that counts as rounding of its numbers."""
RIGHT_ANGLE_TOLERANCE: Final = 1e-6
"""Largest deviation of the numbers in a right-angled rotation from 0 and ±1."""
BODY: Final = MountingTable("a body", "roll, pitch and yaw in degrees", (("NONE", 0.0, 0.0, 0.0),))
"""Mounting during the recording, if readings were rotated into the axes of the body: R_z R_y R_x."""
mounting_target: Final = partial(
    Target, group="mounting", unit=OWN, acts="across", follows="all", docs="vehicles/mounting.md", mountings=BODY
)
"""Row of a target that stores a mounting, with the fields that all of these targets share."""


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Rotation of a sensor in its body, and the correction of readings in the sensor's own axes."""

    found: Floats  #: (3, 3) R, from the sensor's axes to those of the body; its determinant is −1 for a mirrored sensor
    axes: Axes | None  #: right-angled mounting to which R was rounded; None if it was not rounded
    sigma_deg: Floats | None  #: (3,) 1 σ about the body's axes; None if unknown
    matrix: Floats  #: (3, 3) S, symmetric
    offset: Floats  #: (3,) b, offset in the calibration's unit
    mounted: Floats  #: (3, 3) rotation from the axes of corrected readings to those of the body
    calibration: Calibration  #: the calibration that was written, in the sensor's own axes

    @classmethod
    def of(cls, calibration: Calibration, asked: ExportOptions, *, who: str) -> Placement:
        """Split a calibration into rotation and correction, in the sensor's own axes, which may be mapped.

        Raises `NotExportable` if the orientation of the sensor is not known.
        """
        mounted = np.eye(3) if asked.mounting is None else np.asarray(asked.mounting)
        matrix, offset = in_recorded_axes(calibration)
        turn, symmetric = _polar(matrix)
        found = mounted @ unmapping_matrix(calibration).T @ turn
        if asked.mounting is None and np.array_equal(found, np.eye(3)):
            raise NotExportable(
                f"{who} needs the orientation of the sensor in the body, which the calibration does not contain: "
                "calibrate with a recorded accelerometer, gyro or attitude, or state the mapping of the axes, or "
                "state the mounting none if the axes are those of the body",
                hint={"aiding": "dip", "axes": None, "mounting": "none"},
                beyond=("rotation",),
            )
        covariance = asked.rotation_covariance if calibration.rotation == "estimated" else None
        sigma_deg = None if covariance is None else np.rad2deg(np.sqrt(np.diag(covariance)))
        rounded = np.array([float(f"{value:.{SIGNIFICANT_DIGITS}g}") for value in (*symmetric.ravel(), *offset)])
        axes = right_angled_axes(found, covariance)
        return cls(found, axes, sigma_deg, rounded[:9].reshape(3, 3), rounded[9:], mounted, calibration)

    @property
    def rotation(self) -> Floats:
        """(3, 3) R as it is written to the file; a signed permutation if it was rounded to right angles."""
        return self.found if self.axes is None else self.axes.matrix

    @property
    def nearest_axes(self) -> Axes:
        """Nearest mounting by right angles with the same handedness."""
        return nearest_axes(self.found)

    @property
    def is_mirror(self) -> bool:
        """Whether one of sensor and body is left-handed and the other right-handed."""
        return float(np.linalg.det(self.found)) < 0.0

    def refuse_mirror(self, who: str) -> None:
        """Raise `NotExportable` for a mirrored sensor, which no rotation describes."""
        if not self.is_mirror:
            return
        axis = self.nearest_axes.mirrored_axis
        mended = self.nearest_axes.reverse_axis(axis)
        then = "without a mapping of its axes" if mended.is_identity else f"with its axes mapped by {mended}"
        raise NotExportable(
            f"the sensor's axes are a mirror image of the body's ({self.nearest_axes}), and {who} holds rotations "
            f"only: change the sign of {axis} in the driver, record again, and calibrate {then}",
            hint={"axes": None if mended.is_identity else str(mended)},
            beyond=("rotation",),
            axis=axis,
            axes=str(mended),
        )

    def write_rotation(
        self,
        rotation: Floats,
        body: Sequence[str],
        values: dict[str, object],
        *,
        notes: Sequence[str] = (),
        is_partial: bool = False,
    ) -> Written:
        """Written form of a target that stores the (3, 3) `rotation` in place of R.

        `is_partial` says that it is the nearest right-angled mounting and that the actual mounting is another one.
        """
        back = self.mounted.T @ rotation

        def apply(raw: Floats) -> Floats:
            corrected: Floats = (raw - self.offset) @ self.matrix.T @ back.T
            return corrected

        stated = {**values, "rotation": rotation, "matrix": self.matrix, "offset": self.offset}
        stated |= {"sigma_deg": self.sigma_deg, "right_angled": None if self.axes is None else str(self.axes)}
        remarks = [*self._notes(), *notes]
        return Written(apply, body, stated, remarks, meant=self._rounded_calibration(), is_partial=is_partial)

    def _rounded_calibration(self) -> Calibration | None:
        """The calibration with its rotation rounded to right angles; None if it was not rounded."""
        if self.axes is None:
            return None
        back = unmapping_matrix(self.calibration)
        _, symmetric = _polar(in_recorded_axes(self.calibration)[0])
        return replace(
            self.calibration.at(), matrix=self.mounted.T @ self.rotation @ symmetric @ back, rotation="composed"
        )

    def _notes(self) -> Iterator[str]:
        """Yield notes: correction before the mounting, uncertainty of the rotation, and rounding to right angles."""
        unit = unit_label(self.calibration.unit)
        offset = ", ".join(f"{value:.{SIGNIFICANT_DIGITS}g}" for value in self.offset)
        rows = "; ".join(", ".join(f"{value:.{SIGNIFICANT_DIGITS}g}" for value in row) for row in self.matrix)
        yield (
            "contains only the mounting: first correct readings m in the sensor's own axes, as S (m - b) with "
            f"b = [{offset}] {unit}, S = [{rows}]"
        )
        yield (
            "not for readings that were corrected by the whole calibration (c, json, ros-pipeline): those are already "
            "in the axes of the body, and would be rotated twice"
        )
        yield self._in_words()

    def _in_words(self) -> str:
        """Words for the rotation that was found, with its uncertainty, and for the one that is written."""
        if self.is_mirror:
            shown = f"the sensor's axes are a mirror image of the body's, {self.nearest_axes}"
        else:
            shown = f"the rotation that was found is {in_words(self.found)}"
        if self.sigma_deg is None:
            known = "its uncertainty is unknown"
        else:
            about = zip("xyz", map(figures, self.sigma_deg), strict=True)
            known = f"known to {', '.join(f'{sigma}° about {axis}' for axis, sigma in about)} (1 σ)"
        if self.axes is None:
            return f"{shown}, {known}"
        off = apart_deg(self.found, self.rotation)
        if off <= MAX_TURN_DEG:
            return f"{shown}, {known}: it is the right-angled {self.axes}"
        return (
            f"{shown}, {known}: it is rounded to the right-angled {self.axes}, {figures(off)}° away and the only one "
            f"within 3 σ; headings differ by up to {figures(heading_deg(off))}° (at any attitude, dip 60°)"
        )


def right_angled_axes(found: Floats, covariance: Floats | None = None) -> Axes | None:
    """Right-angled mounting that agrees with R, the only one within 3 σ; None for none or several.

    `covariance` is that of R's rotation vector, (3, 3) rad², in the body's axes. Without it, R must be within
    `MAX_TURN_DEG` of the mounting.

    >>> from flinders.targets._mounting import euler
    >>> tilted = euler(0.0, 2.0, 90.0)
    >>> [right_angled_axes(tilted, np.deg2rad(sigma) ** 2 * np.eye(3)) for sigma in (0.3, 60.0)]
    [None, None]
    >>> str(right_angled_axes(tilted, np.deg2rad(1.0) ** 2 * np.eye(3))), str(right_angled_axes(euler(180, 0, 0)))
    ('-y,x,z', 'x,-y,-z')
    """
    ways = same_handed_axes(found)
    turns = np.stack([axes.matrix for axes in ways])
    if covariance is None:
        near = [apart_deg(found, turn) <= MAX_TURN_DEG for turn in turns]
    else:
        off = rotation_vectors(found @ np.swapaxes(turns, 1, 2))
        with np.errstate(all="ignore"):
            near = np.einsum("ni,ij,nj->n", off, np.linalg.pinv(covariance), off) <= CHI_SQUARED
    fitting = [axes for axes, is_near in zip(ways, near, strict=True) if is_near]
    return fitting[0] if len(fitting) == 1 else None


def to_calibration(rows: Floats, source: str, *, strength: float | None = None) -> Calibration:
    """Calibration that consists of a mounting: it rotates readings in any unit and does not correct them.

    A mounting by right angles, mirrored or not, becomes the mapping of axes; the rest of any other mounting becomes the
    matrix. Raises `DocumentError` if the (3, 3) rows deviate by more than `MAX_SHEAR` from a rotation or a mirror
    image.

    >>> from flinders.targets._mounting import euler
    >>> str(to_calibration(euler(0, 0, 90), "a file").axes)
    '-y,x,z'
    """
    left, sizes, right = np.linalg.svd(rows)
    if not float(np.abs(sizes - 1.0).max()) <= MAX_SHEAR:
        lengths = ", ".join(figures(size) for size in sizes)
        raise DocumentError(f"{source}: the matrix scales by {lengths}: need a rotation, which scales by 1")
    rotation = left @ right
    axes = nearest_axes(rotation)
    turn = rotation @ axes.matrix.T
    length = 1.0 if strength is None else strength
    if float(np.abs(turn - np.eye(3)).max()) < RIGHT_ANGLE_TOLERANCE:
        return Calibration(np.eye(3), np.zeros(3), length, strength is not None, axes=axes)
    return Calibration(turn, np.zeros(3), length, strength is not None, rotation="composed", axes=axes)


def _polar(matrix: Floats) -> tuple[Floats, Floats]:
    """Orthogonal Q, and symmetric positive S, of matrix = Q S."""
    if np.array_equal(matrix, matrix.T) and is_positive_definite(matrix):
        return np.eye(3), matrix
    left, sizes, right = np.linalg.svd(matrix)
    symmetric = right.T @ np.diag(sizes) @ right
    return left @ right, (symmetric + symmetric.T) / 2
