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
from flinders.summary.coverage import CELLS

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.findings.poses import Frame
    from flinders.geometry.ellipsoid import Ellipsoid
    from flinders.native.layouts import Records
    from flinders.summary.coverage import Coverage

Goal = Literal["heading", "attitude"]
FRAMES: Final[tuple[Frame, ...]] = ("vehicle", "sensor")
"""Axes that an attitude is named in, in the order of their numbers in flinders.h."""


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
        direction. One of `poses` does to within 15°, usually to a few, for dips up to 75°; it is the simplest such.
        """
        return poses(frame)[self.pose_number(frame)]

    def pose_number(self, frame: Frame) -> int:
        """The number of that attitude among those of a frame."""
        goal = goal_row(self.goal, dip_deg=self.dip_deg, down=self.down)
        return engine().pose_towards(FRAMES.index(frame), goal, self.direction)

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
    if goal == "heading":
        require_headings(dip_deg)
    belief = engine().believe(ellipsoid.centre, ellipsoid.shape, covariance, noise, coverage.counts)
    advice = engine().guidance(belief, goal_row(goal, dip_deg=dip_deg, down=down), batch or 0.0)
    return Guidance(
        errors_deg=direction_errors_deg(ellipsoid, covariance, CELLS),
        worst_deg=float(advice["worst_deg"]),
        direction=advice["direction"].copy(),
        after_deg=float(advice["after_deg"]),
        goal=goal,
        dip_deg=float(dip_deg),
        down=np.array([0.0, 0.0, 1.0]) if down is None else down,
    )


def goal_row(goal: Goal, *, dip_deg: float, down: Floats | None, target_deg: float = 1.0) -> Records:
    """What further readings are for, as the engine has it; parameters as those of `guide`."""
    row = np.zeros((), dtype=GOAL)
    row["is_attitude"], row["dip_deg"], row["target_deg"] = goal == "attitude", dip_deg, target_deg
    row["down"] = (0.0, 0.0, 1.0) if down is None else down
    return row


def reading_variance(ellipsoid: Ellipsoid, covariance: Floats, noise: float, counts: Floats) -> float:
    """Variance v of a reading with which (100,) readings counted give the covariance that is claimed, in unit².

    Independent readings claim P = σ² M⁻¹ with M = Σ JJᵀ, and all eigenvalues of M P are σ². Where residuals are
    correlated, P is wider, and a reading more of the same kind is worth as much less. Directions of parameter space
    that nobody saw say nothing of that: there a prior makes the eigenvalue too small, or, M being a sum over
    cells, the cells' width makes it too large. So the median speaks; but no reading is better than its noise.

    >>> from flinders.geometry.ellipsoid import Ellipsoid
    >>> from flinders.likelihood import magnitude
    >>> sphere = Ellipsoid(np.zeros(3), 50.0 * np.eye(3))
    >>> jacobian = magnitude.information(CELLS, sphere)
    >>> claimed = 3.0 * 0.5**2 * np.linalg.inv(20.0 * jacobian.T @ jacobian)   # as of a third of the readings
    >>> round(reading_variance(sphere, claimed, 0.5, np.full(100, 20.0)) / 0.5**2, 6)
    3.0
    """
    return float(engine().believe(ellipsoid.centre, ellipsoid.shape, covariance, noise, counts)["variance"])


@cache
def poses(frame: Frame) -> tuple[Pose, ...]:
    """The attitudes that advice is given in, for either frame."""
    placed = (engine().pose(FRAMES.index(frame), number) for number in range(len(POSE_WORDS[frame])))
    return tuple(Pose(down, words, effort) for (down, effort), words in zip(placed, POSE_WORDS[frame], strict=True))
