"""Guidance: the attitude to turn the sensor to next, so that the worst error falls fastest.

A design of readings is G-optimal if it minimises the largest variance of the predictions (Kiefer and Wolfowitz 1960).
The predictions are here the headings of a level vehicle, or the field's direction at any attitude. The covariance P of
the parameters is known after a fit. A reading in the direction u measures one combination of the parameters, the
distance of the surface in this direction, with the Jacobian j of `flinders.likelihood.magnitude` and the variance v. So
the covariance after a batch of n readings can be computed before they are taken,

    P′ = P − P j jᵀ P / (v/n + jᵀ P j)

for each of 100 directions, and the best of them is the advice. To repeat this is a sequential design (as in Wynn 1970).
Readings are then taken where they reduce the error; the sphere is not filled evenly.

After all headings with tilts up to 35°, the error is small for level headings and large for upside-down attitudes:

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1, motion="tilted").samples)
>>> claim, coverage = fit.claim, fit.evidence.coverage
>>> level, any_attitude = (
...     guide(claim.ellipsoid, claim.covariance, noise=fit.evidence.noise, coverage=coverage, dip_deg=60.0, goal=goal)
...     for goal in ("heading", "attitude")
... )
>>> any_attitude
Guidance(attitude, worst 2.59°, after the advice 1.12°)
>>> level.is_reached(1.0), any_attitude.is_reached(1.0)
(True, False)
>>> any_attitude.words()
'hold it upside down with its nose 30° down and turn it slowly once around, keeping it so'

Sources: J. Kiefer, J. Wolfowitz, "The equivalence of two extremum problems", Can. J. Math. 12 (1960) 363–366;
H. P. Wynn, "The sequential generation of D-optimum experimental designs", Ann. Math. Statist. 41 (1970) 1655–1664.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from flinders.findings.poses import POSE_WORDS
from flinders.heading.error_propagation import direction_errors_deg, require_headings
from flinders.native.engine import engine
from flinders.native.layouts import GOAL
from flinders.summary.coverage import CELL_CENTRES

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.findings.poses import Frame
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.native.layouts import Records
    from flinders.summary.coverage import Coverage

Goal = Literal["heading", "attitude"]
FRAMES: Final[tuple[Frame, ...]] = ("vehicle", "sensor")
"""Frames for names of attitudes, in the order of their numbers in flinders.h."""


@dataclass(frozen=True, slots=True, eq=False)
class Guidance:
    """Error in each direction, and the direction where the next readings help most, in corrected sensor axes."""

    # (100,): 1 σ of the field's direction, for a field along each of `flinders.summary.coverage.CELL_CENTRES`
    errors_deg: Floats
    worst_deg: float  # worst error of a level heading, or of any direction for the goal "attitude"
    direction: Floats  # (3,): direction of the field for the next readings, the centre of one of the 100 cells
    after_deg: float  # predicted `worst_deg` after a batch of readings in `direction`
    goal: Goal = "heading"
    dip_deg: float = 60.0  # inclination of the field at the site
    # (3,): down direction of the level vehicle
    down: Floats = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    def is_reached(self, target_deg: float) -> bool:
        """Whether the worst error by the covariance meets the target; a verdict has further rules."""
        return self.worst_deg <= target_deg

    def pose(self, frame: Frame = "vehicle") -> Pose:
        """Simplest attitude to hold while turning once around, so that the field passes near the advised direction.

        While a body turns about the vertical through all headings, the angle between field and vertical is 90° − I. An
        attitude is suitable if its vertical has this angle to the advised direction. For dips up to 75° one of `poses`
        has it to within 15°, usually to a few degrees.
        """
        return poses(frame)[self.pose_number(frame)]

    def pose_number(self, frame: Frame) -> int:
        """Index of the result of `pose` among the `poses` of a frame."""
        goal = goal_row(self.goal, dip_deg=self.dip_deg, down=self.down)
        return engine().pose_towards(FRAMES.index(frame), goal, self.direction)

    def words(self, frame: Frame = "vehicle") -> str:
        """Instruction for the next turn in words, which need no knowledge of north.

        For a ``vehicle`` with axes forward, right, down the words are nose, sides and upside down. For a bare
        ``sensor`` they are the sides out of which its axes point.
        """
        return f"hold it {self.pose(frame).words} and turn it slowly once around, keeping it so"

    def __repr__(self) -> str:
        return f"Guidance({self.goal}, worst {self.worst_deg:.2f}°, after the advice {self.after_deg:.2f}°)"


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """An attitude of a body at any heading."""

    down: Floats  # (3,): unit vector towards the ground, in body axes
    words: str  # the attitude in words, to follow "hold it"
    effort: int  # count of angles to estimate by eye; 0 if a side points down


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
    """Find the direction in which further readings reduce the worst error most.

    Raises `UsageError` within a degree of the magnetic poles, for the goal ``heading``.

    Parameters
    ----------
    covariance : (9, 9) float
        Covariance of (b, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃), in unit²; singular if a method fixes some of them.
    noise : float
        Standard deviation of a reading's distance from the surface, in the unit of the readings.
    coverage : Coverage
        Directions of the readings that gave the covariance, as input of `reading_variance`.
    dip_deg : float
        Inclination of the field at the site, with its sign: positive in the north.
    down : (3,) float, optional
        Down direction of the level vehicle in corrected sensor axes; by default +z. For a sensor that is mounted upside
        down it is −z, and the dip keeps its sign.
    goal : str
        ``heading`` of a level vehicle, or ``attitude`` for the field's direction at any attitude.
    batch : float, optional
        Count of readings before the next advice; by default 1 % of the readings so far.
    """
    if goal == "heading":
        require_headings(dip_deg)
    belief = engine().make_belief(ellipsoid.centre, ellipsoid.shape, covariance, noise, coverage.counts)
    advice = engine().guidance(belief, goal_row(goal, dip_deg=dip_deg, down=down), batch or 0.0)
    return Guidance(
        errors_deg=direction_errors_deg(ellipsoid, covariance, CELL_CENTRES),
        worst_deg=float(advice["worst_deg"]),
        direction=advice["direction"].copy(),
        after_deg=float(advice["after_deg"]),
        goal=goal,
        dip_deg=float(dip_deg),
        down=np.array([0.0, 0.0, 1.0]) if down is None else down,
    )


def goal_row(goal: Goal, *, dip_deg: float, down: Floats | None, target_deg: float = 1.0) -> Records:
    """Record of the goal for the engine; parameters are those of `guide`."""
    row = np.zeros((), dtype=GOAL)
    row["is_attitude"], row["dip_deg"], row["target_deg"] = goal == "attitude", dip_deg, target_deg
    row["down"] = (0.0, 0.0, 1.0) if down is None else down
    return row


def reading_variance(ellipsoid: Ellipsoid, covariance: Floats, noise: float, counts: Floats) -> float:
    """Effective variance v of a further reading, in unit², by the claimed covariance P and the (100,) counts by cell.

    For independent readings P = σ² M⁻¹ with M = Σ JJᵀ, so that all eigenvalues of M P are σ². If residuals are
    correlated, P is larger, and a further reading has proportionally less information. In directions of parameter space
    that readings do not determine, an eigenvalue is too small because of the prior, or too large because M is a sum
    over wide cells. Therefore v is the median eigenvalue, but at least the variance of the noise.

    >>> from flinders.geometry.ellipsoid import Ellipsoid
    >>> from flinders.likelihood import magnitude
    >>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
    >>> jacobian = magnitude.information(CELL_CENTRES, sphere)
    >>> claimed = 3.0 * 0.5**2 * np.linalg.inv(20.0 * jacobian.T @ jacobian)   # as of a third of the readings
    >>> round(reading_variance(sphere, claimed, 0.5, np.full(100, 20.0)) / 0.5**2, 6)
    3.0
    """
    return float(engine().make_belief(ellipsoid.centre, ellipsoid.shape, covariance, noise, counts)["variance"])


@cache
def poses(frame: Frame) -> tuple[Pose, ...]:
    """The attitudes that guidance can advise, for a frame."""
    placed = (engine().pose(FRAMES.index(frame), number) for number in range(len(POSE_WORDS[frame])))
    return tuple(Pose(down, words, effort) for (down, effort), words in zip(placed, POSE_WORDS[frame], strict=True))
