"""Likelihood: Gauss–Newton on the Sampson distance, with errors at the Cramér–Rao bound."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final, cast

import numpy as np

from flinders.core.samples import Samples
from flinders.errors import NotAnEllipsoid, Undetermined
from flinders.estimators.algebraic import trace_fit
from flinders.estimators.base import Correlation, Estimate, Method, check_prior
from flinders.estimators.consistent import fit_adjusted
from flinders.estimators.data import project_to_plane
from flinders.estimators.outliers import list_outliers
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix
from flinders.geometry.plane import PLANES
from flinders.likelihood import prior
from flinders.native.engine import engine
from flinders.native.layouts import UNDETERMINED_STATUS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.estimators.data import Readings
    from flinders.estimators.outliers import Outlier
    from flinders.native.layouts import Records

MAX_ITERATED_READINGS: Final = 20_000
"""Largest number of readings in the iteration; for a longer recording a last step uses all readings."""

ROBUST_METHOD, LEVEL_METHOD = "robust", "level"
"""Names of the methods of an estimate from which outliers were rejected, and of an estimate of a level turn."""

CORRELATION_FIELDS: Final = (
    "lag_one",
    "correlation_time",
    "distortion",
    "excess_variance",
    "noise_lasts",
    "steps_kurtosis",
)
"""Fields of the engine's record for the attributes of a `Correlation`, in their order."""


@dataclass(frozen=True, slots=True)
class Likelihood:
    """General ellipsoid by maximum likelihood, corrected for the curvature of the surface.

    Minimises ``Σ s² / σ²`` plus the prior's cost, where s is the Sampson distance of a reading from the
    ellipsoid (see `flinders.likelihood.magnitude`), by Gauss–Newton steps on (b, S) with the Jacobian at
    the foot points, from the start of `Consistent`. Then the mean gradient by noise on a curved surface is
    subtracted. σ is estimated from the residuals.

    For white noise its error is at the Cramér–Rao bound (``python -m benchmarks.accuracy``). Use it whenever
    the readings themselves are available; `auto` does.

    Parameters
    ----------
    prior : float, optional
        Prior 1 σ of the deviation of the shape from a sphere, relative to the radius, see
        `flinders.likelihood.prior`; None for no prior, so that unobserved parameters are free.
    bias_correction : bool
        False gives the minimum of the Sampson cost itself, for comparison with other software.

    References
    ----------
    .. [1] P. D. Sampson, "Fitting conic sections to very scattered data", CGIP 18 (1982) 97–108.
    .. [2] M. Kok, T. B. Schön, "Magnetometer calibration using inertial sensors", IEEE Sensors J. 16 (2016).

    Examples
    --------
    Readings on half of the sphere give the offset to about a hundredth of the field, as claimed:

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

    prior: float | None = prior.SOFT_IRON_SPREAD
    bias_correction: bool = True

    name: ClassVar[str] = "likelihood"
    unknowns: ClassVar[int] = 10
    is_biased: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse an invalid prior."""
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
            If readings do not determine all parameters, and there is no prior.
        NeedsSamples
            If only sums were given.
        """
        readings.require(self.unknowns, self.name)
        fitted = readings.for_fit()
        return self.polish(fitted, start_ellipsoid(fitted))

    def polish(self, readings: Readings, ellipsoid: Ellipsoid, *, robust: bool = False) -> Estimate:
        """Fit from a given start; raises as `estimate`.

        With `robust`, outliers are rejected if residuals show any.
        """
        field, ends = readings.as_array(self.name)
        record = engine().polish(
            field,
            ellipsoid.centre,
            ellipsoid.shape,
            ends=ends,
            prior=self.prior or 0.0,
            bias_correction=self.bias_correction,
            robust=robust,
        )
        return estimate_from_record(record, readings)


def fit_record(
    readings: Readings, prior: float | None, *, robust: int, level: int, dip_deg: float = 60.0, statistics: int = 1
) -> Records:
    """Record of the engine for a fit from the consistent start; raises `NeedsSamples` for sums alone.

    `robust` rejects outliers never (0), if residuals show outliers (1), or always (2). With `level` 1 an ellipse is
    fitted if the readings are those of a level turn.
    """
    field, ends = readings.as_array(Likelihood.name)
    time = readings.recording.time if isinstance(readings.recording, Samples) else None
    options = {"prior": prior or 0.0, "dip_deg": dip_deg, "robust": robust, "level": level, "statistics": statistics}
    options["rests"] = readings.rests is None
    return engine().fit(field, time=time, ends=ends, **options)


def estimate_from_record(record: Records, readings: Readings, *, has_statistics: bool = False) -> Estimate:
    """Make the estimate of a record of the engine; a record with statistics also shows exchanged axes.

    Raises
    ------
    NotAnEllipsoid, Undetermined
        If the fit failed.
    """
    plane = PLANES[record["plane"] - 1] if record["plane"] else None
    method = LEVEL_METHOD if plane else ROBUST_METHOD if record["is_robust"] else Likelihood.name
    if record["status"] == UNDETERMINED_STATUS:
        raise Undetermined(int(record["unobserved"]))
    if record["status"]:
        raise NotAnEllipsoid(method=method)
    limit, outliers = np.inf, cast("tuple[Outlier, ...]", ())
    if record["is_robust"]:
        limit = float(record["rejected_beyond"])
        majority = Ellipsoid(record["majority_centre"], symmetric_matrix(record["majority_shape"]))
        near = readings if plane is None else project_to_plane(readings, plane, float(majority.centre[2]))
        outliers = list_outliers(near, majority, limit, int(record["dense"]))
    lag_one, time, direction, excess, lasting, steps = (float(record[name]) for name in CORRELATION_FIELDS)
    lasting = 0.0 if math.isnan(lasting) else lasting
    return Estimate(
        Ellipsoid(record["centre"].copy(), symmetric_matrix(record["shape"])),
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


def start_ellipsoid(readings: Readings) -> Ellipsoid:
    """Ellipsoid to start from: that of `Consistent`, else of `Algebraic`, else a sphere about the readings."""
    try:
        return fit_adjusted(readings)[0]
    except NotAnEllipsoid:
        moments = readings.summary.moments
        origin, scale = moments.mean, moments.spread
    try:
        return Ellipsoid.from_quadric(trace_fit(moments.about(origin, scale))).in_frame(origin, scale)
    except NotAnEllipsoid:
        return Ellipsoid(origin, scale * np.eye(3))


def start_spheres(field: Floats, radius: float | None = None) -> Iterator[Ellipsoid]:
    """Yield spheres to start from: one about (N, 3) readings, and one at each side of the plane that fits them best.

    Readings with NaN are left out. Nothing is yielded if all other readings are equal.
    """
    readings = field[np.isfinite(field).all(axis=1)]
    middle = readings.mean(axis=0)
    width = float(np.sqrt(np.mean(np.sum((readings - middle) ** 2, axis=1))))
    normal = np.linalg.eigh(np.cov(readings.T))[1][:, 0]
    for lift in (0.0, 1.0, -1.0, 2.0, -2.0) if width > 0.0 else ():
        yield Ellipsoid(middle + lift * width * normal, (radius or width * math.hypot(1.0, lift)) * np.eye(3))


METHOD: Final = Method(
    Likelihood,
    use="general ellipsoid with the accuracy of the statistical limit; needs the readings themselves",
    source="Sampson (1982); Kok and Schön (2016)",
)
