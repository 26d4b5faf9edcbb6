"""Which way to turn the sensor next, so that the worst error falls fastest.

A design of readings is G-optimal if no other makes the largest variance of what is predicted smaller (Kiefer and
Wolfowitz 1960). What is predicted here is not the next reading but the heading of a level vehicle, or the field's
direction in any attitude. Its covariance P is known after a fit, and a reading in the direction u says one number
about the parameters: how far the surface lies off there, with the Jacobian j of `flinders.likelihood.magnitude`. So
what a batch of n readings would bring can be computed before they are taken,

    P′ = P − P j jᵀ P / (v/n + jᵀ P j)

for all hundred directions at once, and the best of them is the advice. Taking it again and again is a sequential
design (as in Wynn 1970), and ends where the readings are worth having, not where the sphere is evenly filled.

After all headings but no tilt beyond 35°, a level heading is known well and what is upside down is not:

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1, motion="tilted").samples)
>>> level, any_attitude = (
...     guide(fit.ellipsoid, fit.covariance, noise=fit.noise, coverage=fit.coverage, dip_deg=60.0, goal=goal)
...     for goal in ("heading", "attitude")
... )
>>> any_attitude
Guidance(attitude, worst 1.79°, after the advice 0.61°)
>>> level.is_reached(1.0), any_attitude.is_reached(1.0)
(True, False)
>>> any_attitude.words()
'hold it upside down with its nose 30° down and turn it slowly once around, keeping it so'

Sources: J. Kiefer, J. Wolfowitz, "The equivalence of two extremum problems", Can. J. Math. 12 (1960) 363–366;
H. P. Wynn, "The sequential generation of D-optimum experimental designs", Ann. Math. Statist. 41 (1970) 1655–1664.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations, product
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from flinders.heading.error_propagation import direction_errors_deg, direction_gradients, level_gradients, upright
from flinders.likelihood import magnitude
from flinders.summary.coverage import CELLS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.summary.coverage import Coverage

Goal = Literal["heading", "attitude"]
Frame = Literal["vehicle", "sensor"]

SHARPNESS: Final = 4
"""Power in which variances are averaged to judge a batch: nearly the largest, yet not blind to the next ones.

Two errors that are alike take two batches, and mending the first leaves the largest as it is. See
`tests/truth/test_guidance.py`.
"""

BATCH_SHARE: Final = 0.01
"""Readings in a batch, of those there are: what each of a hundred cells holds when all directions are alike."""

FULL_DIGITS: Final = 1e-12
"""Variances below this share of the largest are those of parameters that the method holds."""

EFFORT_DEG: Final = 2.0
"""How much farther an attitude may miss the direction for each degree of effort that it saves."""


@dataclass(frozen=True, slots=True, eq=False)
class Guidance:
    """What is known in each direction, and where the next readings would tell most; all in corrected sensor axes."""

    errors_deg: Floats  # (100,) 1 σ of the direction of the field in each of `flinders.summary.coverage.CELLS`
    worst_deg: float  # the error that matters: of a level heading, or of any direction for the goal "attitude"
    direction: Floats  # (3,), one of the cells: where the field should point next
    after_deg: float  # `worst_deg` after a batch there, as far as can be told before it is taken
    goal: Goal = "heading"
    dip_deg: float = 60.0  # inclination of the field at the site
    down: Floats = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))  # (3,), which way is down when level

    def is_reached(self, target_deg: float) -> bool:
        """The worst error is no larger than was asked for. As far as the covariance tells: a verdict knows more."""
        return self.worst_deg <= target_deg

    def pose(self, frame: Frame = "vehicle") -> Pose:
        """The attitude to hold while turning once around: simple, and passing the advised direction closely.

        Turned about the vertical through all headings, a body meets the field at a fixed angle of 90° − I from its
        own vertical, wherever north is. So an attitude will do if its vertical makes that angle with the advised
        direction. One of `POSES` does to within 15°, usually to a few, for dips up to 75°; it is the simplest such.
        """
        wanted = self.direction if frame == "sensor" else upright(self.down).T @ self.direction
        angles = np.rad2deg(np.arccos(np.clip(_DOWNS[frame] @ wanted, -1.0, 1.0)))
        costs = np.abs(angles - (90.0 - self.dip_deg)) + EFFORT_DEG * _EFFORTS[frame]
        return POSES[frame][int(np.argmin(costs.round(6)))]  # of those that are alike, the first

    def words(self, frame: Frame = "vehicle") -> str:
        """Say what to do, to somebody who knows neither where north is nor which way the field points.

        For a ``vehicle`` with axes forward, right, down (at least when it is level): nose, sides, upside down. For a
        bare ``sensor``: the sides that its axes point out of.
        """
        return f"hold it {self.pose(frame).words} and turn it slowly once around, keeping it so"

    def __repr__(self) -> str:
        return f"Guidance({self.goal}, worst {self.worst_deg:.2f}°, after the advice {self.after_deg:.2f}°)"


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """An attitude, but for its heading."""

    down: Floats  # (3,) unit vector in the axes of the body: what points to the ground
    words: str  # after "hold it"
    effort: int  # how many angles have to be judged by eye: none where a side points down


def guide(
    ellipsoid: Ellipsoid,
    covariance: Floats,
    *,
    noise: float,
    coverage: Coverage,
    dip_deg: float = 60.0,
    down: Floats | None = None,
    goal: Goal = "heading",
    batch: float | None = None,
) -> Guidance:
    """Find the direction whose readings would reduce the worst error most.

    Raises `UsageError` within a degree of the magnetic poles, for the goal ``heading``.

    Parameters
    ----------
    covariance : (9, 9) float
        Of (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃), in unit²; may be singular, where a method holds some of them.
    noise : float
        Standard deviation of a reading's distance from the surface, in the unit of the readings.
    coverage : Coverage
        Of the readings that the covariance comes from: `reading_variance` is drawn from both.
    dip_deg : float
        Inclination of the field at the site, with its sign: positive in the north.
    down : (3,) float, optional
        Which way is down when the vehicle is level, in corrected sensor axes; by default +z. For a sensor that is
        mounted upside down this is −z, and the dip keeps its sign.
    goal : str
        ``heading``: of a level vehicle; ``attitude``: the field's direction, whichever way the sensor is turned.
    batch : float, optional
        Readings that will be taken before the next advice; by default a hundredth of those there are.
    """
    wanted = goal_gradients(ellipsoid, goal, CELLS, dip_deg=dip_deg, down=down)
    jacobian = magnitude.information(CELLS, ellipsoid)
    readings = batch or max(BATCH_SHARE * coverage.readings, 1.0)
    variance = reading_variance(jacobian, covariance, noise, coverage.counts)
    before = _variances(wanted, covariance)
    after = (before[:, np.newaxis] - _gains(wanted, jacobian, covariance, variance / readings)).clip(min=0.0)
    best = int(np.argmin(sharp_mean(after.T)))
    return Guidance(
        errors_deg=direction_errors_deg(ellipsoid, covariance, CELLS),
        worst_deg=float(np.rad2deg(np.sqrt(before.max()))),
        direction=CELLS[best],
        after_deg=float(np.rad2deg(np.sqrt(after[:, best].max()))),
        goal=goal,
        dip_deg=float(dip_deg),
        down=np.array([0.0, 0.0, 1.0]) if down is None else down,
    )


def reading_variance(jacobian: Floats, covariance: Floats, noise: float, counts: Floats) -> float:
    """Variance v of a reading with which the readings counted give the covariance that is claimed, in unit².

    Independent readings claim P = σ² M⁻¹ with M = Σ JJᵀ, and all eigenvalues of M P are σ². Where residuals are
    correlated, P is wider, and a reading more of the same kind is worth as much less. Directions of parameter space
    that nobody saw say nothing of that: there a prior makes the eigenvalue too small, or, M being a sum over
    cells, the cells' width makes it too large. So the median speaks; but no reading is better than its noise.

    `jacobian` is (K, 9), in the middle of each cell, and `counts` (K,) the readings there.

    >>> jacobian = np.random.default_rng(1).normal(size=(100, 9))
    >>> claimed = 3.0 * 0.5**2 * np.linalg.inv(20.0 * jacobian.T @ jacobian)   # as of a third of the readings
    >>> round(reading_variance(jacobian, claimed, 0.5, np.full(100, 20.0)) / 0.5**2, 6)
    3.0
    """
    values, vectors = np.linalg.eigh(covariance)
    free = values > FULL_DIGITS * values[-1]
    if not free.any():
        return noise**2
    root = jacobian @ (vectors[:, free] * np.sqrt(values[free]))
    ascending = np.linalg.eigvalsh(root.T * counts @ root)
    return max(noise**2, float(ascending[(len(ascending) - 1) // 2] + ascending[len(ascending) // 2]) / 2.0)


def _variances(gradients: Floats, covariance: Floats) -> Floats:
    """(M,) variances of M things with (M, R, 9) gradients, summed over their R components."""
    variances: Floats = np.sum(gradients @ covariance * gradients, axis=(1, 2)).clip(min=0.0)
    return variances


def _gains(gradients: Floats, jacobian: Floats, covariance: Floats, variance: float) -> Floats:
    """(M, K) by how much a batch of the given variance in each of K directions lowers each of M variances."""
    lever = covariance @ jacobian.T
    own = np.einsum("ki,ik->k", jacobian, lever)
    shared = np.sum(np.square(gradients.reshape(-1, 9) @ lever).reshape(*gradients.shape[:2], -1), axis=1)
    gains: Floats = shared / np.maximum(variance + own, np.finfo(float).tiny)
    return gains


def goal_gradients(
    ellipsoid: Ellipsoid, goal: Goal, directions: Floats, *, dip_deg: float, down: Floats | None
) -> Floats:
    """(M, R, 9) gradients of what a goal wants known: the heading of a level vehicle, or (M, 3) directions."""
    if goal == "heading":
        return level_gradients(ellipsoid, dip_deg=dip_deg, down=down)[:, np.newaxis]
    return direction_gradients(ellipsoid, directions)


def sharp_mean(variances: Floats) -> Floats:
    """(K,) mean of the fourth powers of (K, M) variances, in units of the largest: what the advice makes small."""
    scaled = variances / max(float(variances.max()), np.finfo(float).tiny)
    means: Floats = np.mean(scaled**SHARPNESS, axis=1)
    return means


_ROLLS: Final = {
    0: "", 45: "rolled 45° to its right", 90: "on its right side", 135: "rolled 135° to its right",
    180: "upside down", -135: "rolled 135° to its left", -90: "on its left side", -45: "rolled 45° to its left",
}  # fmt: skip
_PITCHES: Final = {
    0: "", -30: "with its nose 30° down", -60: "with its nose 60° down",
    30: "with its nose 30° up", 60: "with its nose 60° up",
}  # fmt: skip
_SIDES: Final = dict(zip(("+x", "+y", "+z", "−x", "−y", "−z"), np.concatenate([np.eye(3), -np.eye(3)]), strict=True))


def _vehicle_poses() -> Iterator[Pose]:
    """Nose straight down and up, and five pitches with eight rolls about the nose."""
    yield Pose(_SIDES["+x"], "with its nose straight down", 0)
    yield Pose(_SIDES["−x"], "with its nose straight up", 0)
    for pitch_deg, roll_deg in product(_PITCHES, _ROLLS):
        pitch, roll = np.deg2rad(pitch_deg), np.deg2rad(roll_deg)
        down = np.array([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])
        words = f"{_ROLLS[roll_deg]} {_PITCHES[pitch_deg]}".strip() or "level"
        yield Pose(down, words, int(pitch_deg != 0) + int(roll_deg % 90 != 0))


def _sensor_poses() -> Iterator[Pose]:
    """Sides, edges and corners of a box along the axes, and sides with a neighbour lowered."""
    for name, side in _SIDES.items():
        yield Pose(side, f"with its {name} side down", 0)
    for one, two in combinations(_SIDES, 2):
        if _SIDES[one] @ _SIDES[two] == 0.0:
            edge = (_SIDES[one] + _SIDES[two]) / np.sqrt(2.0)
            yield Pose(edge, f"with the edge between its {one} and {two} sides down", 1)
            for low, lowered in ((one, two), (two, one)):
                down = np.sqrt(0.75) * _SIDES[low] + 0.5 * _SIDES[lowered]
                yield Pose(down, f"with its {low} side down and its {lowered} side lowered by 30°", 1)
    for signs in product("+−", repeat=3):
        one, two, three = (sign + axis for sign, axis in zip(signs, "xyz", strict=True))
        corner = (_SIDES[one] + _SIDES[two] + _SIDES[three]) / np.sqrt(3.0)
        yield Pose(corner, f"with the corner of its {one}, {two} and {three} sides down", 2)


POSES: Final[dict[Frame, tuple[Pose, ...]]] = {"vehicle": tuple(_vehicle_poses()), "sensor": tuple(_sensor_poses())}
"""The attitudes that advice is given in, for either frame."""

_DOWNS: Final = {frame: np.array([pose.down for pose in poses]) for frame, poses in POSES.items()}
_EFFORTS: Final = {frame: np.array([pose.effort for pose in poses], float) for frame, poses in POSES.items()}
