"""Li: the ellipsoid-specific fit of Li and Griffiths, which Magneto uses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.errors import NotAnEllipsoid, UsageError
from flinders.estimators.base import Method
from flinders.estimators.quadric_fit import Frame, make_estimate
from flinders.geometry.ellipsoid import Ellipsoid

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings

MIN_K: Final = 3.0
"""Lower limit of k: there the constraint k J > I² excludes every ellipsoid, even a sphere."""

MAX_K: Final = 2.0**20
"""Largest k that is tried: it allows axis ratios up to a thousand, far beyond those of a sensor."""

MAX_BISECTIONS: Final = 40
"""Number of bisections, which determine log₂ k to rounding."""


@dataclass(frozen=True, slots=True)
class Li:
    """General ellipsoid by least squares on the quadric's value, with a constraint that makes it an ellipsoid.

    Minimises ``Σ q(x)²`` with ``k J − I² = 1``, where ``I = tr Q`` and ``J`` is the sum of the
    principal 2 × 2 minors of Q. With k = 4 every solution is an ellipsoid. Every shape whose short
    radius is at least half the long one can be reached, and flat ones cannot. Without k, the largest k that
    gives an ellipsoid is searched, from 2²⁰ down by bisection, as the paper proposes.

    Use ``Li(k=4)`` for parity with Magneto 1.2/1.4 and the scripts that copy it, and if other
    fits find no ellipsoid. It is biased towards spheres: with half of the directions covered and 4 % noise the
    error of its centre is 7.7 µT, that of `Consistent` 0.8 µT (`tests/classic/test_printed_numbers.py`).

    References
    ----------
    .. [1] Q. Li, J. G. Griffiths, "Least squares ellipsoid specific fitting", GMP 2004, eq. 7–15.

    Examples
    --------
    A shape that k = 4 cannot reach:

    >>> from flinders.estimators.data import Readings
    >>> directions = np.random.default_rng(1).normal(size=(40, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> readings = Readings.of(directions * [2.0, 1.0, 0.5])
    >>> Li().estimate(readings).ellipsoid.semi_axes.round(6)
    array([0.5, 1. , 2. ])
    >>> bool(Li(k=4.0).estimate(readings).ellipsoid.semi_axes[0] > 0.52)
    True
    """

    k: float | None = None

    name: ClassVar[str] = "li"
    unknowns: ClassVar[int] = 10
    is_biased: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuse a k that does not enforce an ellipsoid."""
        k: object = self.k
        if k is not None and not (isinstance(k, int | float) and MIN_K < k < np.inf):
            raise UsageError(f"k is {k!r}: need a number above {MIN_K:g}, such as 4, or None to search the best value")

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`; `NotAnEllipsoid` if the
        readings lie in one plane.
        """
        readings.require(self.unknowns, self.name)
        frame = Frame.of(readings)
        local = self._search(frame.scatter) if self.k is None else _ellipsoid(frame.scatter, self.k)
        return make_estimate(readings, local.in_frame(frame.origin, frame.scale), self.name)

    def _search(self, scatter: Floats) -> Ellipsoid:
        """Ellipsoid of the largest k, by bisection of log k between 4, which always gives one, and `MAX_K`."""
        best, low, high = _attempt(scatter, MAX_K), np.log2(4.0), np.log2(MAX_K)
        if best is not None:
            return best
        best = _ellipsoid(scatter, 4.0)
        for _ in range(MAX_BISECTIONS):
            middle = (low + high) / 2.0
            candidate = _attempt(scatter, 2.0**middle)
            if candidate is None:
                high = middle
            else:
                best, low = candidate, middle
        return best


def _attempt(scatter: Floats, k: float) -> Ellipsoid | None:
    try:
        return _ellipsoid(scatter, k)
    except NotAnEllipsoid:
        return None


def _ellipsoid(scatter: Floats, k: float) -> Ellipsoid:
    """Ellipsoid that solves the constrained eigenproblem for one k."""
    constraint = np.diag([-1.0, -1.0, -1.0, -k, -k, -k])
    constraint[:3, :3] += (k / 2.0 - 1.0) * (1.0 - np.eye(3))
    quadratic, mixed, linear = scatter[:6, :6], scatter[:6, 6:], scatter[6:, 6:]
    back = np.linalg.pinv(linear, rcond=1e-14, hermitian=True) @ mixed.T
    values, vectors = np.linalg.eig(np.linalg.solve(constraint, quadratic - mixed @ back))
    form = np.real(vectors[:, np.argmax(np.real(values))])
    return Ellipsoid.from_quadric(np.concatenate([form, -back @ form]), method="li")


METHOD: Final = Method(
    Li,
    use="always an ellipsoid, as Magneto fits it; biased towards spheres",
    source="Li and Griffiths (2004), eq. 7–15; Magneto",
    is_recipe=True,
    programs=("Magneto",),
)
