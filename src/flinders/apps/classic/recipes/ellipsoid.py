"""Constrained: an ellipsoid with chosen constraints on its radii, axes and centre.

The constraints express knowledge of the sensor, which then need not come from the readings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, Literal, TypeAlias, get_args

import numpy as np

from flinders.errors import NotAnEllipsoid, UsageError
from flinders.estimators.algebraic import fit_error
from flinders.estimators.base import Method
from flinders.estimators.quadric_fit import CONSTRAINT_BASES, Frame, fit_constrained, make_estimate

if TYPE_CHECKING:
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings
    from flinders.geometry.ellipsoid import Ellipsoid

Radii: TypeAlias = Literal["free", "aligned", "xy", "xz", "yz", "sphere", "eye", "diag", "sym", "auto"]

MAGCAL: Final[dict[Radii, Radii]] = {"eye": "sphere", "diag": "aligned", "sym": "free"}
"""Names of MATLAB's ``magcal`` for three of the constraints; its ``auto`` is `Constrained.choose_radii`."""


@dataclass(frozen=True, slots=True)
class Constrained:
    """Ellipsoid by least squares on the quadric's value, with constraints on radii, axes and centre.

    Minimises ``Σ q(x)²``, ``q(x) = xᵀQx + l·x + d``, with ``tr Q = 3`` and one of

    ========================  ===================================================  ========  ===========  ======
    ``radii``                 Q                                                    unknowns  MATLAB       magcal
    ========================  ===================================================  ========  ===========  ======
    ``"free"``                symmetric: the same as `Algebraic`                   10        ``''``       sym
    ``"aligned"``             diagonal: the same as `AxisAligned`                  7         ``'0'``      diag
    ``"xy"``, ``"xz"``,       diagonal, two radii equal                            6         ``'0xy'``,
    ``"yz"``                                                                                 ``'0xz'``
    ``"sphere"``              the identity: the same as `Sphere`                   5         ``'xyz'``    eye
    ========================  ===================================================  ========  ===========  ======

    and with ``centred=True`` l = 0, so that the centre is at zero: three unknowns fewer. The names of MATLAB's
    ``magcal`` are synonyms; its ``"auto"`` starts with the sphere, takes the aligned ellipsoid if its `fit_error` is
    smaller, then the free one if that is smaller still. There is no penalty for unknowns, so that the choice is
    nearly always the free one.

    Moving or scaling the readings moves and scales the solution in the same way, except that ``centred`` cannot follow
    a move. Rotated readings rotate the solution only for ``"free"`` and ``"sphere"``: the others refer to the axes.

    Use it for parity with those two programs, or if the constraint is known to hold: a sensor whose x and y are one
    coil type and z another, an offset that was subtracted before. Do not use an assumed constraint: the error of a
    wrong one does not shrink with more readings. The difference from `Likelihood` is added to the covariance.

    Parameters
    ----------
    radii : str
        Constraint on radii and axes: a row of the table, or a name of ``magcal``.
    centred : bool
        Whether the centre is kept at zero.

    Notes
    -----
    ``ellipsoid_fit`` of 2015 also allows ``'xy'`` and ``'xz'`` with free axes. It sets Q₁₁ = Q₂₂, which does not make
    two radii equal with cross terms (`tests/classic/test_constrained.py`), and is left out; ``2, 'xy'`` of the edition
    of 2009 is ``"xy"`` here. That edition minimises with a constant term of −1, which depends on the position of zero;
    this follows the later one, tr Q = 3. ``magcal`` scales the coefficients of ``diag`` and ``sym`` to unit length, so
    that with noise its last digits differ; without noise both are exact.

    References
    ----------
    .. [1] Y. Petrov, "Ellipsoid fit", MATLAB Central File Exchange 24693 (2009, 2015).
    .. [2] MathWorks, Sensor Fusion and Tracking Toolbox, ``magcal``.

    Examples
    --------
    The documented example of ``magcal``: centre (−50, 20, 100), radii (30, 20, 50).

    >>> from flinders.estimators.data import Readings
    >>> directions = np.random.default_rng(1).normal(size=(40, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> readings = Readings.of(directions * [30, 20, 50] + [-50, 20, 100])
    >>> for radii in ("sym", "diag", "auto"):
    ...     ellipsoid = Constrained(radii).estimate(readings).ellipsoid
    ...     print(ellipsoid.centre.round(6), round(ellipsoid.radius, 4))
    [-50.  20. 100.] 31.0723
    [-50.  20. 100.] 31.0723
    [-50.  20. 100.] 31.0723
    >>> Constrained("xy", centred=True).estimate(Readings.of(directions * [30, 30, 50])).ellipsoid.semi_axes.round(6)
    array([30., 30., 50.])
    """

    radii: Radii = "free"
    centred: bool = False

    name: ClassVar[str] = "ellipsoid"
    unknowns: ClassVar[int] = 10
    is_biased: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuse an unknown constraint."""
        if self.radii not in get_args(Radii):
            raise UsageError(f"radii is {self.radii!r}: need one of {', '.join(get_args(Radii))}")
        if not isinstance(self.centred, bool):
            raise UsageError(f"centred is {self.centred!r}: need True or False")

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises `TooFewSamples`, `OutOfScale`, `StuckAxis` or `Unmoved`: see `Readings.require`, with the number of
        readings by the number of unknowns; `NotAnEllipsoid` if the quadric is open.
        """
        radii = MAGCAL.get(self.radii, self.radii)
        readings.require(self._unknowns("sphere" if radii == "auto" else radii), self.name)
        radii, ellipsoid = self.choose_radii(readings) if radii == "auto" else (radii, self._fit(readings, radii))
        entries = CONSTRAINT_BASES[radii]
        basis = np.zeros((9, 3 + entries.shape[1]))
        basis[:3, :3], basis[3:, 3:] = np.eye(3), entries
        words = [self.name, *([] if radii == "free" else [radii]), *(["centred"] if self.centred else [])]
        made = make_estimate(readings, ellipsoid, " ".join(words), basis[:, 3:] if self.centred else basis)
        return replace(made, estimator=self.name)

    def choose_radii(self, readings: Readings) -> tuple[Radii, Ellipsoid]:
        """Choose the radii with the smallest `fit_error` as ``magcal`` does, from the sphere to the free ellipsoid.

        Raises `NotAnEllipsoid` if not even a sphere fits the readings.
        """
        moments = readings.summary.moments
        radii: Radii = "sphere"
        best = self._fit(readings, radii)
        richer: Radii
        for richer in ("aligned", "free"):
            if len(readings) < self._unknowns(richer):
                break
            try:
                other = self._fit(readings, richer)
            except NotAnEllipsoid:
                continue
            if fit_error(moments, other) < fit_error(moments, best):
                radii, best = richer, other
        return radii, best

    def _unknowns(self, radii: Radii) -> int:
        """Number of unknowns: parameters of the ellipsoid, and the noise."""
        entries: int = CONSTRAINT_BASES[radii].shape[1]
        return entries + (0 if self.centred else 3) + 1

    def _fit(self, readings: Readings, radii: Radii) -> Ellipsoid:
        """Ellipsoid of least squares under the constraints."""
        frame = Frame.of(readings)
        if self.centred:
            frame = Frame.of(readings, np.zeros(3), float(np.hypot(frame.scale, np.linalg.norm(frame.origin))))
        return frame.to_ellipsoid(
            fit_constrained(frame.scatter, CONSTRAINT_BASES[radii], centred=self.centred), self.name
        )


METHOD: Final = Method(
    Constrained,
    use="constraints on radii, axes or centre are known; numbers of ellipsoid_fit and magcal",
    source="Petrov (2009, 2015); MathWorks, magcal",
    is_recipe=True,
)
