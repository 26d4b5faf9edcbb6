"""Comparison of a calibration with a level turn, in the plane of the turn.

The vertical axis of a level turn is the sensor's z only if the sensor is upright. If the calibration is right,
corrected readings lie on a circle about the vertical, for any mounting of the sensor: the normal of their plane is the
vertical d, and their height over the centre is F sin I. In axes with z along d the calibration predicts

    the circle 0 + F cos I (cos ψ, −sin ψ)

and the turn's ellipse, which is fitted in the sensor's x and y, is also an ellipse in these axes. Both are compared in
five numbers: two for the middle and three for the shape. The middle depends on the offset and on the third column of
the shape, which the turn cannot separate; the comparison uses only their combined effect. Let y = V F S⁻¹ (x − b) be a
corrected reading with the rotation V into these axes. Errors δb and δS of the calibration, with X = V F S⁻¹ δS Vᵀ,
change to first order

    the middle V F S⁻¹ δb + sin I (X + Xᵀ) ẑ,        the shape cos I (F + (X + Xᵀ)/2)

The antisymmetric part of X is a rotation, which has no effect, because the plane of the readings gives d.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> sensor = simulate.Sensor.random(np.random.default_rng(4))
>>> tumbled, turned = (simulate.tumble(seed=1, motion=how, sensor=sensor) for how in ("hand", "level"))
>>> known, fresh = (calibrate.fit(each.samples) for each in (tumbled, turned))
>>> level = LevelPair.of(known, fresh, turned.samples)
>>> compare_level(level.known, level.fresh, dip_deg=level.dip_deg).answer
'holds'
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple, Self

import numpy as np

from flinders.comparison.comparison import as_equator, compare, compare_level
from flinders.core.joining import single_recordings
from flinders.estimators.covariance import Residuals, correlation_length
from flinders.geometry.ellipsoid import symmetric_matrix
from flinders.geometry.plane import PLANE_PARAMETERS, equator, equator_matrix, symmetric_root
from flinders.heading.error_propagation import upright
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.comparison.comparison import Comparison
    from flinders.core.samples import Recording
    from flinders.fitting.result import Fit

DIFFERENCE_STEP: Final = 1e-6
"""Step for numerical derivatives of the ellipse, as a share of the radius."""


@dataclass(frozen=True, slots=True, eq=False)
class LevelPair:
    """A calibration and a level turn, as ellipses in the plane of the turn."""

    known: Fit  #: calibration in axes with z along the vertical of the turn, as the equator of an ellipsoid
    fresh: Fit  #: level turn in these axes
    #: inclination of the field by the calibration, positive if the field points along +z of the mapped axes
    dip_deg: float

    @classmethod
    def of(cls, known: Fit, fresh: Fit, recording: Recording) -> Self:
        """Determine the plane of the turn, and convert both calibrations to it.

        Parameters
        ----------
        known : Fit
            Calibration for all attitudes.
        fresh : Fit
            Fit to a level turn, `plane` xy.
        recording : Recording
            The turn, in the unit and axes of both.
        """
        turn = _Turn.of(known, fresh, recording)
        _, shape, height = turn.ellipse_and_height(turn.numbers)
        dip = math.atan2(height, math.sqrt(float(np.linalg.det(shape))))
        level = known.calibration.field_strength * math.cos(dip)
        expected = np.array([0.0, 0.0, level, level, 0.0])
        return cls(
            _as_equator(known, expected, turn.expected_covariance(dip)),
            _as_equator(fresh, turn.ellipse(turn.numbers), turn.measured_covariance()),
            math.degrees(dip),
        )


def compare_with_turn(known: Fit, fresh: Fit, recording: Recording, *, target_deg: float = 1.0) -> Comparison:
    """Compare a calibration with a level turn, as `flinders.compare` does for two calibrations.

    Parameters
    ----------
    known, fresh, recording
        As for `LevelPair.of`.
    target_deg : float
        Worst heading difference that is good enough, in degrees.
    """
    level = LevelPair.of(known, fresh, recording)
    return compare_level(level.known, level.fresh, dip_deg=level.dip_deg, target_deg=target_deg)


def compare_on(recording: Recording, known: Fit, fresh: Fit, *, dip_deg: float, target_deg: float) -> Comparison:
    """Compare a calibration with a fit of a recording; a level turn is compared in its plane.

    `dip_deg` and `target_deg` are those of `flinders.compare`; for a level turn the dip is that of the fit.
    """
    if fresh.claim.plane == "xy" and known.claim.plane is None:
        return compare_with_turn(known, fresh, recording, target_deg=target_deg)
    return compare(known, fresh, dip_deg=dip_deg, target_deg=target_deg)


@dataclass(frozen=True, slots=True, eq=False)
class _Turn:
    """A level turn and a calibration, with the parameters of the turn and their covariance."""

    known: Fit  # the calibration
    numbers: Floats  # parameters of the turn: those of the ellipse in x and y, then those of the plane
    covariance: Floats  # covariance of `numbers`

    @classmethod
    def of(cls, known: Fit, fresh: Fit, recording: Recording) -> Self:
        """Fit a plane to the readings."""
        dip_deg = fresh.heading_error_deg.dip_deg if math.isfinite(fresh.heading_error_deg.dip_deg) else 60.0
        ellipse = equator(fresh.calibration.ellipsoid, "xy", dip_deg=dip_deg)
        noise = fresh.evidence.noise if math.isfinite(fresh.evidence.noise) else 0.0
        heights = _heights(recording, ellipse.centre[:2], noise)
        numbers = np.concatenate([ellipse.parameters[PLANE_PARAMETERS], heights.numbers])
        covariance = np.zeros((8, 8))
        rows = equator_matrix("xy", dip_deg=dip_deg)[PLANE_PARAMETERS]
        covariance[:5, :5] = rows @ fresh.claim.claimed_covariance @ rows.T
        covariance[5:, 5:] = heights.covariance
        return cls(known, numbers, covariance)

    @property
    def inverse(self) -> Floats:
        """(3, 3) F S⁻¹ of the calibration, without a rotation."""
        inverse: Floats = self.known.calibration.field_strength * np.linalg.inv(self.known.calibration.ellipsoid.shape)
        return inverse

    def levelling(self, slopes: Floats) -> Floats:
        """(3, 3) rotation V from the axes of corrected readings to axes with z along the vertical of the turn."""
        normal = np.linalg.solve(self.inverse, np.append(-slopes, 1.0))  # symmetric: M⁻ᵀ n
        return upright(normal / np.linalg.norm(normal)).T

    def ellipse_and_height(self, numbers: Floats) -> tuple[Floats, Floats, float]:
        """Middle (2,) and shape (2, 2) of the measured ellipse about the vertical, and its height."""
        turn = self.levelling(numbers[6:]) @ self.inverse
        centre = turn @ (np.append(numbers[:2], numbers[5]) - self.known.calibration.offset)
        along = (turn @ np.vstack([np.eye(2), numbers[6:]]))[:2]
        shape = along @ np.array([[numbers[2], numbers[4]], [numbers[4], numbers[3]]])
        return centre[:2], symmetric_root(shape @ shape.T), float(centre[2])

    def measured_covariance(self) -> Floats:
        """(5, 5) covariance of the measured middle and shape, as claimed by the turn."""
        scale = np.full(8, DIFFERENCE_STEP * self.known.calibration.ellipsoid.radius)
        scale[6:] = DIFFERENCE_STEP
        changes = [self.ellipse(self.numbers + step) - self.ellipse(self.numbers - step) for step in np.diag(scale)]
        jacobian = np.stack(changes, axis=1) / (2.0 * scale)
        covariance: Floats = jacobian @ self.covariance @ jacobian.T
        return covariance

    def ellipse(self, numbers: Floats) -> Floats:
        """(5,) middle and shape (S₁₁, S₂₂, S₁₂) of the measured ellipse about the vertical."""
        middle, shape, _ = self.ellipse_and_height(numbers)
        return np.array([*middle, shape[0, 0], shape[1, 1], shape[0, 1]])

    def expected_covariance(self, dip: float) -> Floats:
        """(5, 5) covariance of the predicted middle and shape, as claimed by the calibration."""
        levelling = self.levelling(self.numbers[6:])
        turn = levelling @ self.inverse
        rows = np.zeros((5, 9))
        rows[:2, :3] = turn[:2]
        for place, entry in enumerate(_ENTRIES):
            change = turn @ entry @ levelling.T
            change = (change + change.T) / 2.0
            rows[:2, 3 + place] = 2.0 * math.sin(dip) * change[:2, 2]
            rows[2:, 3 + place] = math.cos(dip) * np.array([change[0, 0], change[1, 1], change[0, 1]])
        covariance: Floats = rows @ self.known.claim.claimed_covariance @ rows.T
        return covariance


_ENTRIES: Final = tuple(symmetric_matrix(entry) for entry in np.eye(6))
"""The six symmetric basis matrices of S₁₁, S₂₂, S₃₃, S₁₂, S₁₃ and S₂₃."""


class _Heights(NamedTuple):
    """The plane of the readings of a level turn."""

    numbers: Floats  # (3,): height at the middle of the ellipse, in the unit of the readings, then slopes along x and y
    covariance: Floats  # (3, 3): covariance of `numbers`


def _heights(recording: Recording, middle: Floats, noise: float) -> _Heights:
    """The plane of the readings about the (2,) middle; its covariance allows for correlated residuals."""
    parts = [np.concatenate([block.field for block in single.blocks()]) for single in single_recordings(recording)]
    field = np.concatenate(parts)
    plane = engine().fit_plane(field, middle, noise)
    numbers = np.append(plane["height"], plane["slope"])
    columns = np.column_stack([np.ones(len(field)), field[:, :2] - middle])
    left = field[:, 2] - columns @ numbers
    edges = np.cumsum([len(part) for part in parts])
    segments = [np.arange(edge - len(part), edge) for edge, part in zip(edges, parts, strict=True)]
    alike = max(1.0, correlation_length(Residuals(left, columns, segments).autocovariance()))
    return _Heights(numbers, alike * plane["covariance"].reshape(3, 3))


def _as_equator(fit: Fit, numbers: Floats, covariance: Floats) -> Fit:
    """The ellipse of (5,) numbers as the equator of an ellipsoid; the third semi-axis is the mean of the other two."""
    return as_equator(fit, equator_matrix("xy", dip_deg=0.0)[:, PLANE_PARAMETERS], numbers, covariance)
