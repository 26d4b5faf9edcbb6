"""Problem of the solver for shots of a survey instrument: magnetometer, accelerometer and pointing axis.

A shot is one pair of readings while the instrument points at a target. Shot k of group j has an attitude C_k, from the
axes of the instrument to the world (north, east, down). Residuals are

    m_k − b − S Rᵀ C_kᵀ f,        g_k − b' − S' C_kᵀ e,        t_j − C_k p

with the magnetometer's reading m and the accelerometer's reading g, which points down; the field f = (cos I, 0, sin I)
of dip I and e = (0, 0, 1); the pointing axis p, a unit vector in the accelerometer's axes; and the common direction t_j
of all shots of group j, which differ in their roll. Each of the three kinds of residual has its own standard deviation:
noise of both sensors and error of aiming. For a nonlinear accelerometer g_k is replaced by g_k + q g_k² for each axis.
The directions t_j are eliminated (`flinders.likelihood.observations`). The parameters are 24 gains, axes and offsets of
both sensors, or 27 with q, and three for the attitude of each shot.

Standard deviations are estimated from the residuals and the trace of the hat matrix of each kind (W. Förstner 1979).

Source: B. Heeb, *A General Calibration Algorithm for 3-Axis Compass/Clinometer Devices*, CREG Journal 73 (2009), for
groups of shots rolled about the pointing axis. Heeb alternates between vectors and matrices; here all are estimated at
once. For the quadratic terms, CalibAlgoBH.java of TopoDroid, after Heeb's second algorithm.

>>> SurveyLayout(shots=56).size
192
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, Self, TypeAlias

import numpy as np

from flinders.geometry.ellipsoid import sphere_through
from flinders.geometry.rotation import cross_matrices, lengths, perpendicular_vectors, rotations, step_on_sphere
from flinders.likelihood.equations import MIN_NOISE, NormalEquations
from flinders.likelihood.observations import (
    EliminatedEquations,
    ObservationGroup,
    ObservationRows,
    Weights,
    eliminate_directions,
    weighted_jacobian,
)
from flinders.likelihood.parameters import ROTATION_SIGMA, ParameterLayout, Parameters
from flinders.likelihood.prior import SensorPrior
from flinders.likelihood.solver import LAST_STEP_SIGMAS, MAX_COST_INCREASE, Iterate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.likelihood.solver import Equations

FORWARD, DOWN = np.eye(3)[0], np.eye(3)[2]

GAIN_SPREAD: Final = 0.1
"""Prior standard deviation of gains, and of misalignment angles in rad, for sensors without soft iron."""

QUADRATIC_SPREAD: Final = 0.05
"""Prior standard deviation of q times gravity; the DistoX stores at most 0.045."""

MIN_AIM_SIGMA_RAD: Final = 2e-4
"""Smallest standard deviation of aiming by hand in rad."""

START_SIGMA: Final = 0.03
"""Standard deviation at the start of each kind of residual: relative to the field, to gravity, and in rad."""

SHOT_FREEDOM: Final = 5.0
"""Degrees of freedom of a shot's residuals after its attitude is fitted: two lengths, dip, and two of direction."""

MIN_FREEDOM: Final = 0.5
"""Smallest degrees of freedom of a kind of residual at which its standard deviation is estimated."""

RESIDUAL_KINDS: Final = (np.s_[:, :3], np.s_[:, 3:6], np.s_[:, 6:])
"""Slices of the residuals of field, gravity and aim."""

MAGNETOMETER, ACCELEROMETER = ParameterLayout.of(rotation=True), ParameterLayout.of()


@dataclass(frozen=True, slots=True)
class SurveyLayout:
    """Columns of the Jacobian for the parameters of an instrument and the attitudes of its shots."""

    shots: int  # number of shots
    gravity: float = 0.0  # length of the accelerometer's readings, by which q is scaled; 0 without quadratic terms
    magnetometer: ClassVar[slice] = slice(0, 12)
    accelerometer: ClassVar[slice] = slice(12, 21)
    dip: ClassVar[slice] = slice(21, 22)
    pointing: ClassVar[slice] = slice(22, 24)

    @property
    def is_quadratic(self) -> bool:
        """Whether the accelerometer has quadratic terms."""
        return self.gravity > 0.0

    @property
    def _own(self) -> int:
        """Number of parameters of the instrument."""
        return 27 if self.is_quadratic else 24

    @property
    def quadratic(self) -> slice:
        """Columns of q times `gravity`."""
        return slice(24, self._own)

    @property
    def instrument(self) -> slice:
        """Columns of the instrument, without attitudes."""
        return slice(0, self._own)

    @property
    def attitudes(self) -> slice:
        """Columns of the attitudes, three for each shot."""
        return slice(self._own, self.size)

    @property
    def size(self) -> int:
        """Number of all parameters."""
        return self._own + 3 * self.shots


@dataclass(frozen=True, slots=True, eq=False)
class SurveyParameters:
    """Values of the parameters of an instrument and its shots."""

    # offset, shape, and rotation from the magnetometer's axes to the accelerometer's
    magnetometer: Parameters
    accelerometer: Parameters  # offset and shape
    dip: float  # rad
    pointing: Floats  # (3,): p, in the accelerometer's axes
    attitudes: Floats  # (N, 3, 3): from the accelerometer's axes to north, east and down
    # (3,): q, one over the unit of the accelerometer
    quadratic: Floats = dataclasses.field(default_factory=lambda: np.zeros(3))

    @property
    def field(self) -> Floats:
        """(3,) direction of the field in the world."""
        return np.array([np.cos(self.dip), 0.0, np.sin(self.dip)])

    def with_attitudes(self, attitudes: Floats) -> Self:
        """The same instrument with other (N, 3, 3) attitudes."""
        return replace(self, attitudes=attitudes)

    @property
    def without_attitudes(self) -> Self:
        """The instrument without attitudes."""
        return self.with_attitudes(np.empty((0, 3, 3)))

    @property
    def is_closed(self) -> bool:
        """Whether both surfaces are ellipsoids."""
        return self.magnetometer.is_closed and self.accelerometer.is_closed

    def take_step(self, step: Floats, layout: SurveyLayout) -> Self:
        """Parameters after a (P,) step."""
        turned = rotations(step[layout.attitudes].reshape(-1, 3))
        return type(self)(
            self.magnetometer.take_step(step[layout.magnetometer], MAGNETOMETER),
            self.accelerometer.take_step(step[layout.accelerometer], ACCELEROMETER),
            self.dip + float(step[layout.dip][0]),
            step_on_sphere(self.pointing, step[layout.pointing]),
            turned @ self.attitudes if len(turned) else self.attitudes,
            self.quadratic + step[layout.quadratic] / layout.gravity if layout.is_quadratic else self.quadratic,
        )

    def relative_step(self, step: Floats, layout: SurveyLayout) -> float:
        """Largest change by a (P,) step: of offset and shape relative to their sensor's radius, of angles in rad."""
        return max(
            self.magnetometer.relative_step(step[layout.magnetometer], MAGNETOMETER),
            self.accelerometer.relative_step(step[layout.accelerometer], ACCELEROMETER),
            float(np.abs(step[9:12]).max()),
            float(np.abs(step[layout.dip.start :]).max()),
        )

    def correct_quadratic(self, gravity: Floats) -> Floats:
        """(..., 3) readings of the accelerometer, corrected for their quadratic terms."""
        return gravity + self.quadratic * gravity**2

    def corrected_directions(self, magnetic: Floats, gravity: Floats) -> tuple[Floats, Floats]:
        """Directions of field and gravity in the accelerometer's axes, of about unit length, from (..., 3) readings."""
        pairs = ((magnetic, self.magnetometer), (self.correct_quadratic(gravity), self.accelerometer))
        field, down = ((reading - own.offset) @ np.linalg.inv(own.rotated_shape).T for reading, own in pairs)
        return field, down

    def angles(self, magnetic: Floats, gravity: Floats) -> Floats:
        """(2, ...) azimuth and inclination in rad of (..., 3) readings."""
        north, east, down = np.moveaxis(
            attitudes_of(*self.corrected_directions(magnetic, gravity)) @ self.pointing, -1, 0
        )
        return np.stack([np.arctan2(east, north), np.arctan2(-down, np.hypot(north, east))])

    @property
    def to_instrument(self) -> Floats:
        """(3, 3) rotation from the accelerometer's axes to those of the instrument, with the pointing axis as first.

        The roll about the pointing axis is that of Heeb: the accelerometer's matrix is symmetric in the other two axes.
        """
        right = np.eye(3)[1] - self.pointing[1] * self.pointing
        right /= np.linalg.norm(right)
        axes = np.stack([self.pointing, right, np.cross(self.pointing, right)])
        gain = axes @ np.linalg.inv(self.accelerometer.shape)
        roll = np.arctan2(gain[2, 1] - gain[1, 2], gain[1, 1] + gain[2, 2])
        turned: Floats = rotations(-roll * FORWARD) @ axes
        return turned


@dataclass(frozen=True, slots=True, eq=False)
class ShotGroup:
    """All shots in W rows, one row for each group of a common direction; rows are padded to n shots with weight 0."""

    shots: NDArray[np.intp]  # (W, n): index of the shot
    weight: Floats  # (W, n): 1, or 0 for padding
    magnetic: Floats  # (W, n, 3): readings of the magnetometer
    gravity: Floats  # (W, n, 3): readings of the accelerometer

    @classmethod
    def of(cls, magnetic: Floats, gravity: Floats, groups: NDArray[np.intp]) -> Self:
        """Arrange (N, 3) readings by their (N,) groups."""
        members = [np.flatnonzero(groups == group) for group in dict.fromkeys(groups.tolist())]
        longest = max(map(len, members))
        shots = np.stack([np.pad(own, (0, longest - len(own)), mode="edge") for own in members])
        weight = np.stack([np.arange(longest) < len(own) for own in members]).astype(float)
        return cls(shots, weight, magnetic[shots], gravity[shots])

    def at(self, _: SurveyParameters) -> Self:
        """The same group, which does not depend on the parameters."""
        return self

    def aim_directions(self, at: SurveyParameters) -> Floats:
        """(W, n, 3) direction of the pointing axis of each shot in the world."""
        aimed: Floats = at.attitudes[self.shots] @ at.pointing
        return aimed

    def guess(self, at: SurveyParameters) -> Floats:
        """(W, 3) mean direction of each group, as a start."""
        total = np.einsum("wni,wn->wi", self.aim_directions(at), self.weight)
        mean: Floats = total / np.linalg.norm(total, axis=1, keepdims=True)
        return mean

    def residuals(self, at: SurveyParameters, directions: Floats, noises: Floats) -> Floats:
        """(W, 9, n) residuals of field, gravity and aim, in standard deviations."""
        back = np.swapaxes(at.attitudes[self.shots], 2, 3)
        field = self.magnetic - at.magnetometer.offset - back @ at.field @ at.magnetometer.rotated_shape.T
        gravity = at.correct_quadratic(self.gravity) - at.accelerometer.offset - back @ DOWN @ at.accelerometer.shape
        aim = directions[:, np.newaxis] - self.aim_directions(at)
        left = np.concatenate([field, gravity, aim], axis=2) * np.sqrt(self.weight)[..., np.newaxis]
        return np.swapaxes(left / np.repeat(noises, 3), 1, 2)

    def cost(self, at: SurveyParameters, directions: Floats, noises: Floats) -> float:
        """Σ r², with each residual r in units of its standard deviation."""
        return float(np.sum(self.residuals(at, directions, noises) ** 2))

    def linearize(
        self, at: SurveyParameters, directions: Floats, layout: SurveyLayout, noises: Floats
    ) -> EliminatedEquations:
        """Normal equations, with the directions eliminated."""
        return eliminate_directions(self.rows(at, directions, layout, noises))

    def rows(self, at: SurveyParameters, directions: Floats, layout: SurveyLayout, noises: Floats) -> ObservationRows:
        """Residuals (W, 9, n) and Jacobians (W, 9, n, P) in standard deviations."""
        shape = (len(self.shots), 9, self.shots.shape[1])
        jacobian, turning, own = (np.zeros((*shape, width)) for width in (layout.size, 3, 2))
        self._fill_sensors(jacobian, turning, at, layout)
        jacobian[:, 6:, :, layout.pointing] = np.swapaxes(
            at.attitudes[self.shots] @ perpendicular_vectors(at.pointing), 1, 2
        )
        turning[:, 6:] = np.swapaxes(-cross_matrices(self.aim_directions(at)), 1, 2)
        row, place = np.nonzero(self.weight)
        for axis in range(3):
            columns = layout.attitudes.start + 3 * self.shots[row, place] + axis
            jacobian[row, :, place, columns] = turning[row, :, place, axis]
        own[:, 6:] = -perpendicular_vectors(directions)[:, :, np.newaxis]
        scale = np.sqrt(self.weight)[:, np.newaxis, :, np.newaxis] / np.repeat(noises, 3)[:, np.newaxis, np.newaxis]
        residual, nothing, count = self.residuals(at, directions, noises), np.zeros(shape), float(self.weight.sum())
        counts = (3.0 * count, 3.0 * count, 2.0 * count)
        return ObservationRows(
            residual, jacobian * scale, own * scale, nothing, nothing, np.zeros(layout.size), counts, RESIDUAL_KINDS
        )

    def _fill_sensors(self, jacobian: Floats, turning: Floats, at: SurveyParameters, layout: SurveyLayout) -> None:
        """Write the unweighted Jacobian of both sensors, by their parameters, the dip, and attitudes (`turning`)."""
        back = np.swapaxes(at.attitudes[self.shots], 2, 3)
        sensors = (
            (self.magnetic, at.magnetometer, MAGNETOMETER, at.field, layout.magnetometer),
            (self.gravity, at.accelerometer, ACCELEROMETER, DOWN, layout.accelerometer),
        )
        for first, (reading, own, columns, world, place) in zip((0, 3), sensors, strict=True):
            group = ObservationGroup(self.shots, reading, np.ones_like(self.weight))
            jacobian[:, first : first + 3, :, place] = weighted_jacobian(
                group, own, back @ world, columns, Weights(1.0)
            )
            turned = own.rotated_shape @ back @ cross_matrices(world)
            turning[:, first : first + 3] = np.swapaxes(turned, 1, 2)
        if layout.is_quadratic:
            jacobian[:, 3:6, :, layout.quadratic] = -np.einsum(
                "wni,ij->winj", self.gravity**2 / layout.gravity, np.eye(3)
            )
        steeper = back @ [-at.field[2], 0.0, at.field[0]] @ at.magnetometer.rotated_shape.T
        jacobian[:, :3, :, layout.dip.start] = np.swapaxes(steeper, 1, 2)


SurveyIterate: TypeAlias = "Iterate[SurveyParameters, ShotGroup, Floats]"


@dataclass(frozen=True, slots=True, eq=False)
class SurveyProblem:
    """Shots, and the prior of the instrument."""

    group: ShotGroup
    layout: SurveyLayout
    priors: tuple[SensorPrior, SensorPrior]  # of magnetometer and accelerometer
    tolerance: ClassVar[float] = MAX_COST_INCREASE
    last_step: ClassVar[float] = LAST_STEP_SIGMAS

    @classmethod
    def of(cls, magnetic: Floats, gravity: Floats, groups: NDArray[np.intp], *, is_quadratic: bool = False) -> Self:
        """Make the problem of (N, 3) readings of field and gravity, forward, right and down, and (N,) groups."""
        of_field, of_gravity = (SensorPrior.of(readings, GAIN_SPREAD, np.eye(3)) for readings in (magnetic, gravity))
        layout = SurveyLayout(len(magnetic), sphere_through(gravity)[1] if is_quadratic else 0.0)
        return cls(ShotGroup.of(magnetic, gravity, groups), layout, (of_field, of_gravity))

    def initial(self, at: SurveyParameters) -> SurveyIterate:
        """Start of the iteration at given parameters, with large standard deviations."""
        noises = np.array([START_SIGMA * at.magnetometer.radius, START_SIGMA * at.accelerometer.radius, START_SIGMA])
        return Iterate(at, (self.group,), (self.group.guess(at),), noises)

    def prior_equations(self, at: SurveyParameters) -> NormalEquations:
        """Normal equations of the prior."""
        size, layout = self.layout.size, self.layout
        whole = NormalEquations(np.zeros((size, size)), np.zeros(size), 0.0, 0)
        whole += self.priors[0].equations(at.magnetometer, MAGNETOMETER).place_block(layout.magnetometer, size)
        whole += self.priors[1].equations(at.accelerometer, ACCELEROMETER).place_block(layout.accelerometer, size)
        left = perpendicular_vectors(at.pointing).T @ (FORWARD - at.pointing) / ROTATION_SIGMA
        own = NormalEquations(np.eye(2) / ROTATION_SIGMA**2, left / ROTATION_SIGMA, float(left @ left), 0)
        whole += own.place_block(layout.pointing, size)
        if layout.is_quadratic:
            curve = layout.gravity * at.quadratic / QUADRATIC_SPREAD
            own = NormalEquations(np.eye(3) / QUADRATIC_SPREAD**2, -curve / QUADRATIC_SPREAD, float(curve @ curve), 0)
            whole += own.place_block(layout.quadratic, size)
        return whole

    def reweigh(self, iterate: SurveyIterate, _: Equations) -> SurveyIterate:
        """Weight each kind of residual by its estimated standard deviation."""
        influence = Influence.of(self, iterate)
        return replace(iterate, weights=np.maximum(iterate.weights * influence.factors, min_sigmas(iterate.at)))


def min_sigmas(at: SurveyParameters) -> Floats:
    """(3,) smallest standard deviation of each kind of residual."""
    return np.array([at.magnetometer.radius * MIN_NOISE, at.accelerometer.radius * MIN_NOISE, MIN_AIM_SIGMA_RAD])


@dataclass(frozen=True, slots=True, eq=False)
class Influence:
    """Residuals and hat matrix of a fit; the hat matrix states how much each reading influences its own prediction."""

    residual: Floats  # (N, 9): residuals of each shot, in standard deviations
    hat: Floats  # (N, 9, 9): block of the hat matrix for each shot
    jacobian: Floats  # (N, 9, Q): derivatives of the residuals by all parameters and directions
    inverse: Floats  # (Q, Q): inverse of the normal matrix

    @classmethod
    def of(cls, problem: SurveyProblem, iterate: SurveyIterate) -> Self:
        """Compute the influence at an iterate."""
        group, size = problem.group, problem.layout.size
        rows = group.rows(iterate.at, iterate.directions[0], problem.layout, iterate.weights)
        whole = np.concatenate([rows.jacobian, _expand_directions(rows.own)], axis=3)
        real = np.nonzero(group.weight)
        order = np.argsort(group.shots[real])
        jacobian = whole.transpose(0, 2, 1, 3)[real][order]
        flat = jacobian.reshape(-1, whole.shape[3])
        matrix = flat.T @ flat
        matrix[:size, :size] += problem.prior_equations(iterate.at).matrix
        inverse = _inverse(matrix)
        hat = (flat @ inverse).reshape(jacobian.shape) @ np.swapaxes(jacobian, 1, 2)
        return cls(rows.residual.transpose(0, 2, 1)[real][order], hat, jacobian, inverse)

    def covariance(self, factors: Floats) -> Floats:
        """(Q, Q) covariance of parameters and directions, if the variance of each kind is multiplied by a factor.

        `factors` are (3,), for field, gravity and aim.
        """
        flat = self.jacobian.reshape(-1, self.jacobian.shape[2])
        more = np.tile(np.repeat(factors - 1.0, 3), len(self.jacobian))
        covariance: Floats = self.inverse + self.inverse @ (flat.T * more) @ flat @ self.inverse
        return covariance

    @property
    def freedom(self) -> Floats:
        """(3,) degrees of freedom of each kind of residual."""
        taken = np.einsum("nkk->k", self.hat).reshape(3, 3).sum(axis=1)
        freedom: Floats = len(self.hat) * np.array([3.0, 3.0, 2.0]) - taken
        return freedom

    @property
    def factors(self) -> Floats:
        """(3,) factors for the standard deviation of each kind of residual."""
        squares = np.sum(self.residual**2, axis=0).reshape(3, 3).sum(axis=1)
        factors: Floats = np.sqrt(squares / np.maximum(self.freedom, MIN_FREEDOM))
        return factors

    @property
    def contradiction(self) -> Floats:
        """(N,) contradiction of each shot to all others.

        It is the root of the decrease of χ², per degree of freedom, if the shot is left out.
        """
        free = np.eye(9) - self.hat
        fall = np.einsum("ni,nij,nj->n", self.residual, np.linalg.pinv(free, rcond=1e-6, hermitian=True), self.residual)
        contradiction: Floats = np.sqrt(fall / SHOT_FREEDOM)
        return contradiction


def _expand_directions(own: Floats) -> Floats:
    """(W, k, n, 2 W) Jacobian by the directions of all W rows, from the (W, k, n, 2) Jacobian by each row's own."""
    count = len(own)
    apart: Floats = np.einsum("wkna,wv->wknva", own, np.eye(count)).reshape(*own.shape[:3], 2 * count)
    return apart


def _inverse(matrix: Floats) -> Floats:
    """Inverse of a normal matrix, computed with its diagonal scaled to 1."""
    scale = np.sqrt(np.diag(matrix))
    inverse: Floats = np.linalg.inv(matrix / np.outer(scale, scale)) / np.outer(scale, scale)
    return inverse


def attitudes_of(field: Floats, down: Floats) -> Floats:
    """(N, 3, 3) attitudes, from the instrument to north, east, down, by (N, 3) field and gravity directions (TRIAD)."""
    east = np.cross(down, field)
    rows = np.stack([np.cross(east, down), east, down], axis=-2)
    unit: Floats = rows / np.linalg.norm(rows, axis=-1, keepdims=True)
    return unit


def start_parameters(magnetic: Floats, gravity: Floats) -> SurveyParameters:
    """Parameters to start from: a sphere for each sensor, the stated axes, and attitudes from the readings."""
    sensors = [Parameters.at(centre, radius * np.eye(3)) for centre, radius in map(sphere_through, (magnetic, gravity))]
    at = SurveyParameters(sensors[0], sensors[1], 0.0, FORWARD, np.empty((0, 3, 3)))
    field, down = (vectors / lengths(vectors)[:, np.newaxis] for vectors in at.corrected_directions(magnetic, gravity))
    sine = float(np.mean(np.einsum("ni,ni->n", field, down)))
    return replace(at, dip=float(np.arcsin(sine)), attitudes=attitudes_of(field, down))
