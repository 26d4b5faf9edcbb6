"""Likelihood: Gauss–Newton on the Sampson distance, down to the Cramér–Rao bound."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, cast

import numpy as np

from flinders.core.samples import Samples
from flinders.errors import NotAnEllipsoid, Undetermined
from flinders.estimators.algebraic import trace_fit
from flinders.estimators.base import Correlation, Estimate, Method, check_prior
from flinders.estimators.consistent import adjusted
from flinders.estimators.data import laid_flat
from flinders.estimators.outliers import outliers_among
from flinders.geometry.ellipsoid import Ellipsoid, symmetric
from flinders.geometry.plane import PLANES
from flinders.likelihood import prior
from flinders.native.engine import engine
from flinders.native.layouts import UNDETERMINED

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.estimators.data import Readings
    from flinders.estimators.outliers import Outlier
    from flinders.native.layouts import Records

ENOUGH: Final = 20_000
"""Readings on which the fit is iterated; the whole of a longer recording is gone through once, from there."""

ROBUST, LEVEL = "robust", "level"
"""Methods of an estimate that outliers were rejected for, and of a level turn."""

RESIDUALS: Final = ("lag_one", "correlation_time", "distortion", "excess_variance", "noise_lasts", "steps_kurtosis")
"""Of a record: what a `Correlation` is made of."""


@dataclass(frozen=True, slots=True)
class Likelihood:
    """General ellipsoid by maximum likelihood, corrected for the curvature of the surface.

    Minimises ``Σ s² / σ²`` plus the prior's cost, where s is the Sampson distance of a reading from the
    ellipsoid (see `flinders.likelihood.magnitude`), by Gauss–Newton steps on (b, S) with the Jacobian at
    the foot points, started from `Consistent`. Then the mean of the gradient that noise causes on a
    curved surface is subtracted. σ comes from the residuals.

    On readings of white noise its error is that of the Cramér–Rao bound (``python -m
    benchmarks.accuracy``). Use it whenever the readings themselves are there; `auto` does.

    Parameters
    ----------
    prior : float, optional
        Departure of the scaled shape from a sphere that is thought likely, see
        `flinders.likelihood.prior`; None leaves what was not seen free.
    bias_correction : bool
        False gives the minimum of the Sampson cost itself, for comparison with other software.

    References
    ----------
    .. [1] P. D. Sampson, "Fitting conic sections to very scattered data", CGIP 18 (1982) 97–108.
    .. [2] M. Kok, T. B. Schön, "Magnetometer calibration using inertial sensors", IEEE Sensors J. 16 (2016).

    Examples
    --------
    Half of the sphere is enough for an offset to about a hundredth of the field, and it says so:

    >>> from flinders.estimators.data import Readings
    >>> rng = np.random.default_rng(1)
    >>> directions = rng.normal(size=(2000, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> directions[:, 2] = np.abs(directions[:, 2])
    >>> field = directions * [45, 50, 55] + [20, 120, 90] + rng.normal(scale=0.5, size=directions.shape)
    >>> estimate = Likelihood().estimate(Readings.of(field))
    >>> error = estimate.ellipsoid.centre - [20, 120, 90]
    >>> bool(np.all(np.abs(error) < 3 * np.sqrt(np.diag(estimate.covariance)[:3])))
    True
    """

    prior: float | None = prior.SPREAD
    bias_correction: bool = True

    name: ClassVar[str] = "likelihood"
    unknowns: ClassVar[int] = 10
    is_biased: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse a prior that means nothing."""
        check_prior(self.prior)

    def estimate(self, readings: Readings) -> Estimate:
        """Fit an ellipsoid.

        Raises
        ------
        TooFewSamples, OutOfScale, StuckAxis, Unmoved
            See `Readings.require`.
        NotAnEllipsoid
            If no step leads to a closed surface.
        Undetermined
            If readings leave parameters open, and there is no prior to hold them.
        NeedsSamples
            If only sums were given.
        """
        readings.require(self.unknowns, self.name)
        fitted = readings.fitted()
        return self.polish(fitted, start(fitted))

    def polish(self, readings: Readings, ellipsoid: Ellipsoid, *, robust: bool = False) -> Estimate:
        """Fit from a known start, a robust one, too, where residuals may ask for it; raises as `estimate`."""
        field, ends = readings.in_memory(self.name)
        record = engine().polish(
            field,
            ellipsoid.centre,
            ellipsoid.shape,
            ends=ends,
            prior=self.prior or 0.0,
            bias_correction=self.bias_correction,
            robust=robust,
        )
        return estimated(record, readings)


def recorded(
    readings: Readings, prior: float | None, *, robust: int, level: int, dip_deg: float = 60.0, statistics: int = 1
) -> Records:
    """The engine's record of a fit from the consistent start; raises NeedsSamples.

    The fit is robust never (0), where residuals ask for it (1) or always (2); `level`: 1 for the ellipse of a level
    turn where readings are that.
    """
    field, ends = readings.in_memory(Likelihood.name)
    time = readings.recording.time if isinstance(readings.recording, Samples) else None
    options = {"prior": prior or 0.0, "dip_deg": dip_deg, "robust": robust, "level": level, "statistics": statistics}
    options["rests"] = readings.rests is None
    return engine().fit(field, time=time, ends=ends, **options)


def estimated(record: Records, readings: Readings, *, has_statistics: bool = False) -> Estimate:
    """The estimate in a record of the engine, which counted swaps of axes where it has statistics.

    Raises
    ------
    NotAnEllipsoid, Undetermined
        Where there is none.
    """
    plane = PLANES[record["plane"] - 1] if record["plane"] else None
    method = LEVEL if plane else ROBUST if record["is_robust"] else Likelihood.name
    if record["status"] == UNDETERMINED:
        raise Undetermined(int(record["unobserved"]))
    if record["status"]:
        raise NotAnEllipsoid(method=method)
    limit, outliers = np.inf, cast("tuple[Outlier, ...]", ())
    if record["is_robust"]:
        limit = float(record["rejected_beyond"])
        majority = Ellipsoid(record["majority_centre"], symmetric(record["majority_shape"]))
        near = readings if plane is None else laid_flat(readings, plane, float(majority.centre[2]))
        outliers = outliers_among(near, majority, limit, int(record["dense"]))
    lag_one, time, direction, excess, lasting, steps = (float(record[name]) for name in RESIDUALS)
    lasting = 0.0 if math.isnan(lasting) else lasting
    return Estimate(
        Ellipsoid(record["centre"].copy(), symmetric(record["shape"])),
        record["covariance"].reshape(9, 9).copy(),
        float(record["noise"]),
        method,
        prior_influence=float(record["prior_influence"]),
        correlation=None if math.isnan(time) else Correlation(lag_one, time, direction, excess, lasting, steps),
        textbook=record["textbook"].reshape(9, 9).copy(),
        used=int(record["used"]),
        unobserved=int(record["unobserved"]),
        rejected_beyond=limit,
        outliers=outliers,
        plane=plane,
        may_be_swapped=not has_statistics or any(record["swaps"].tolist()),
    )


def start(readings: Readings) -> Ellipsoid:
    """An ellipsoid to begin with: consistent, else algebraic, else a sphere around the readings."""
    try:
        return adjusted(readings)[0]
    except NotAnEllipsoid:
        moments = readings.summary.moments
        origin, scale = moments.mean, moments.spread
    try:
        return Ellipsoid.from_quadric(trace_fit(moments.about(origin, scale))).in_frame(origin, scale)
    except NotAnEllipsoid:
        return Ellipsoid(origin, scale * np.eye(3))


def spheres_about(field: Floats, radius: float | None = None) -> Iterator[Ellipsoid]:
    """Spheres to begin with: about (N, 3) readings, and beside the plane that they are nearly in.

    Readings that are NaN are left out; where all others are alike, there is no sphere.
    """
    readings = field[np.isfinite(field).all(axis=1)]
    middle = readings.mean(axis=0)
    width = float(np.sqrt(np.mean(np.sum((readings - middle) ** 2, axis=1))))
    normal = np.linalg.eigh(np.cov(readings.T))[1][:, 0]
    for lift in (0.0, 1.0, -1.0, 2.0, -2.0) if width > 0.0 else ():
        yield Ellipsoid(middle + lift * width * normal, (radius or width * math.hypot(1.0, lift)) * np.eye(3))


METHOD: Final = Method(
    Likelihood,
    use="general ellipsoid at the statistical limit; needs the readings themselves",
    source="Sampson (1982); Kok and Schön (2016)",
)
