"""How a sensor sits in the body, for systems that have a setting of it: a rotation, and whether it is by right angles.

A calibration W (m − b) of W = Q S, with S symmetric, both corrects and turns. In the sensor's own axes it is

    v = R S (m − b)        R from the sensor's axes to those of the body

R is what a target of a mounting holds; S and b are left to the program that reads the sensor, and stand beside it as a
comment. R is that of the calibration, of the axes that its readings were mapped to, and of the mounting that was in
force when they were recorded. A mirrored sensor has an R of determinant −1.

R is taken for one of the 24 by right angles where that one, and no other, is within 3 σ of it; otherwise it is written
as it was found.

>>> from flinders.core.units import Unit
>>> from flinders.targets._mounting import euler
>>> turned = Calibration(euler(0, 0, 89.7), [10, 20, 30], 50.0, rotation="estimated", raw=Unit.of("uT"))
>>> known = ExportOptions(rotation_covariance=np.deg2rad(0.2) ** 2 * np.eye(3))
>>> placement = Placement.of(turned, known, who="this system")
>>> str(placement.axes), placement.sigma_deg.round(3)
('-y,x,z', array([0.2, 0.2, 0.2]))
>>> Placement.of(turned, ExportOptions(), who="this system").axes is None        # nobody knows how far it may be off
True
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.core.axes import nearest_to, of_the_hand_of
from flinders.core.calibration import Calibration
from flinders.core.symmetric_matrix import is_positive
from flinders.core.units import label
from flinders.errors import DocumentError, NotExportable, figures
from flinders.geometry.rotation import rotation_vectors
from flinders.targets._difference import heading_deg
from flinders.targets._mounting import MOST_TURN_DEG, MountingTable, apart_deg, in_words
from flinders.targets._numbers import OWN, in_recorded_axes, unmapped
from flinders.targets._target import ExportOptions, Target, Written

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.arrays import Floats
    from flinders.core.axes import Axes

CHI_SQUARED: Final = 14.16
"""Of three degrees of freedom, exceeded by chance as often as 3 σ of one: 0.27 %."""
DIGITS: Final = 7
"""Significant digits of the correction that stands beside a mounting."""
MAX_SHEAR: Final = 0.01
"""A matrix that stretches by no more is a rotation whose numbers were rounded."""
EXACT: Final = 1e-6
"""Numbers that differ by less are those of a right angle."""
BODY: Final = MountingTable("a body", "roll, pitch and yaw in degrees", (("NONE", 0.0, 0.0, 0.0),))
"""How the sensor was mounted when it was recorded, where its readings were turned into the body's axes: R_z R_y R_x."""
mounting_target: Final = partial(
    Target, unit=OWN, acts="across", follows="all", docs="vehicles/mounting.md", mountings=BODY
)
"""Row of a target that holds a mounting, with what all of them have in common."""


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """How a sensor sits in the body, and the correction of its readings in its own axes."""

    found: Floats  #: (3, 3) R from the sensor's axes to those of the body; its determinant is −1 of a mirrored sensor
    axes: Axes | None  #: the mounting by right angles that it is taken for; None where it is none
    sigma_deg: Floats | None  #: (3,) 1 σ about the body's axes; None where nobody knows
    matrix: Floats  #: (3, 3) S, symmetric
    offset: Floats  #: (3,) b, in the calibration's unit
    mounted: Floats  #: (3, 3) from the axes that the calibration corrects to, to those of the body
    calibration: Calibration  #: that was written, in the sensor's own axes

    @classmethod
    def of(cls, calibration: Calibration, asked: ExportOptions, *, who: str) -> Placement:
        """Take apart a calibration in the sensor's own axes, perhaps mapped.

        Raises `NotExportable` where nothing says how the sensor sits.
        """
        mounted = np.eye(3) if asked.mounting is None else np.asarray(asked.mounting)
        matrix, offset = in_recorded_axes(calibration)
        turn, symmetric = _polar(matrix)
        found = mounted @ unmapped(calibration).T @ turn
        if asked.mounting is None and np.array_equal(found, np.eye(3)):
            raise NotExportable(
                f"{who} holds how the sensor sits in the body, and the calibration does not know it: calibrate with an "
                "accelerometer, gyro or attitude that was recorded beside it, or say how the axes are mapped; none "
                "says that they are those of the body",
                hint={"aiding": "dip", "axes": None, "mounting": "none"},
                beyond=("rotation",),
            )
        covariance = asked.rotation_covariance if calibration.rotation == "estimated" else None
        sigma_deg = None if covariance is None else np.rad2deg(np.sqrt(np.diag(covariance)))
        rounded = np.array([float(f"{value:.{DIGITS}g}") for value in (*symmetric.ravel(), *offset)])
        axes = right_angled(found, covariance)
        return cls(found, axes, sigma_deg, rounded[:9].reshape(3, 3), rounded[9:], mounted, calibration)

    @property
    def rotation(self) -> Floats:
        """(3, 3) R that is written: by right angles where it is taken for that."""
        return self.found if self.axes is None else self.axes.matrix

    @property
    def nearest(self) -> Axes:
        """The mounting by right angles that is nearest, of the same hand."""
        return nearest_to(self.found)

    @property
    def is_mirror(self) -> bool:
        """The sensor is left-handed where the body is right-handed."""
        return float(np.linalg.det(self.found)) < 0.0

    def refuse_mirror(self, who: str) -> None:
        """Raise `NotExportable` for a mirrored sensor: no rotation is that."""
        if not self.is_mirror:
            return
        axis = self.nearest.mirrored_axis
        mended = self.nearest.turned_over(axis)
        then = "without a mapping of its axes" if mended.is_identity else f"with its axes mapped by {mended}"
        raise NotExportable(
            f"the sensor's axes are a mirror image of the body's ({self.nearest}), and {who} holds rotations only: "
            f"change the sign of {axis} in the driver, record anew, and calibrate {then}",
            hint={"axes": None if mended.is_identity else str(mended)},
            beyond=("rotation",),
            axis=axis,
            axes=str(mended),
        )

    def written(
        self,
        rotation: Floats,
        body: Sequence[str],
        values: dict[str, object],
        *,
        notes: Sequence[str] = (),
        is_partial: bool = False,
    ) -> Written:
        """What a target writes, which holds (3, 3) `rotation` for R.

        `is_partial`: it is the nearest mounting by right angles, where the one that was found is none.
        """
        back = self.mounted.T @ rotation

        def apply(raw: Floats) -> Floats:
            corrected: Floats = (raw - self.offset) @ self.matrix.T @ back.T
            return corrected

        stated = {**values, "rotation": rotation, "matrix": self.matrix, "offset": self.offset}
        stated |= {"sigma_deg": self.sigma_deg, "right_angled": None if self.axes is None else str(self.axes)}
        remarks = [*self._notes(), *notes]
        return Written(apply, body, stated, remarks, meant=self._meant(), is_partial=is_partial)

    def _meant(self) -> Calibration | None:
        """The calibration with the mounting by right angles that it is taken for."""
        if self.axes is None:
            return None
        back = unmapped(self.calibration)
        _, symmetric = _polar(in_recorded_axes(self.calibration)[0])
        return replace(
            self.calibration.at(), matrix=self.mounted.T @ self.rotation @ symmetric @ back, rotation="composed"
        )

    def _notes(self) -> Iterator[str]:
        """What to correct before the mounting, how well it is known, and what was taken for right angles."""
        unit = label(self.calibration.unit)
        offset = ", ".join(f"{value:.{DIGITS}g}" for value in self.offset)
        rows = "; ".join(", ".join(f"{value:.{DIGITS}g}" for value in row) for row in self.matrix)
        yield (
            "holds the mounting alone: correct readings m first, in the sensor's own axes, as S (m - b) with "
            f"b = [{offset}] {unit}, S = [{rows}]"
        )
        yield (
            "not for readings that the whole calibration has corrected (c, json, ros-pipeline): those are in the axes "
            "of the body already, and would be turned twice"
        )
        yield self._in_words()

    def _in_words(self) -> str:
        """The rotation that was found, with its uncertainty, and what it is taken for."""
        if self.is_mirror:
            shown = f"the sensor's axes are a mirror image of the body's, {self.nearest}"
        else:
            shown = f"the rotation that was found is {in_words(self.found)}"
        if self.sigma_deg is None:
            known = "no recording says how well it is known"
        else:
            about = zip("xyz", map(figures, self.sigma_deg), strict=True)
            known = f"known to {', '.join(f'{sigma}° about {axis}' for axis, sigma in about)} (1 σ)"
        if self.axes is None:
            return f"{shown}, {known}"
        off = apart_deg(self.found, self.rotation)
        if off <= MOST_TURN_DEG:
            return f"{shown}, {known}: it is the right-angled {self.axes}"
        return (
            f"{shown}, {known}: it is taken for the right-angled {self.axes}, {figures(off)}° away and the only one "
            f"within 3 σ; headings differ by up to {figures(heading_deg(off))}° (at any attitude, dip 60°)"
        )


def right_angled(found: Floats, covariance: Floats | None = None) -> Axes | None:
    """The mounting by right angles that R is: the only one within 3 σ; None where there is none, or several.

    `covariance`, (3, 3) rad²: of its rotation vector, in the body's axes. Where it is not known R has to be within
    `MOST_TURN_DEG`.

    >>> from flinders.targets._mounting import euler
    >>> tilted = euler(0.0, 2.0, 90.0)
    >>> [right_angled(tilted, np.deg2rad(sigma) ** 2 * np.eye(3)) for sigma in (0.3, 60.0)]
    [None, None]
    >>> str(right_angled(tilted, np.deg2rad(1.0) ** 2 * np.eye(3))), str(right_angled(euler(180, 0, 0)))
    ('-y,x,z', 'x,-y,-z')
    """
    ways = of_the_hand_of(found)
    turns = np.stack([axes.matrix for axes in ways])
    if covariance is None:
        near = [apart_deg(found, turn) <= MOST_TURN_DEG for turn in turns]
    else:
        off = rotation_vectors(found @ np.swapaxes(turns, 1, 2))
        with np.errstate(all="ignore"):
            near = np.einsum("ni,ij,nj->n", off, np.linalg.pinv(covariance), off) <= CHI_SQUARED
    fitting = [axes for axes, is_near in zip(ways, near, strict=True) if is_near]
    return fitting[0] if len(fitting) == 1 else None


def to_calibration(rows: Floats, source: str, *, strength: float | None = None) -> Calibration:
    """The calibration that a mounting by itself stands for: it turns readings, in any unit, and corrects nothing.

    Right angles become its axes, mirrored ones too; what is left of another mounting is its matrix. Raises
    `DocumentError` for (3, 3) rows that are farther than `MAX_SHEAR` from a rotation or a mirror image.

    >>> from flinders.targets._mounting import euler
    >>> str(to_calibration(euler(0, 0, 90), "a file").axes)
    '-y,x,z'
    """
    left, sizes, right = np.linalg.svd(rows)
    if not float(np.abs(sizes - 1.0).max()) <= MAX_SHEAR:
        lengths = ", ".join(figures(size) for size in sizes)
        raise DocumentError(f"{source}: the matrix stretches by {lengths}: need a rotation, which does by 1")
    rotation = left @ right
    axes = nearest_to(rotation)
    turn = rotation @ axes.matrix.T
    length = 1.0 if strength is None else strength
    if float(np.abs(turn - np.eye(3)).max()) < EXACT:
        return Calibration(np.eye(3), np.zeros(3), length, strength is not None, axes=axes)
    return Calibration(turn, np.zeros(3), length, strength is not None, rotation="composed", axes=axes)


def _polar(matrix: Floats) -> tuple[Floats, Floats]:
    """Q, orthogonal, and S, symmetric and positive, of matrix = Q S."""
    if np.array_equal(matrix, matrix.T) and is_positive(matrix):
        return np.eye(3), matrix
    left, sizes, right = np.linalg.svd(matrix)
    symmetric = right.T @ np.diag(sizes) @ right
    return left @ right, (symmetric + symmetric.T) / 2
