"""MAGYC's least squares: offset, soft iron and gyro bias from the derivative of the readings and the angular rate.

Minimises ``Σ |[ω − d]× (C m − c) + C ṁ|²`` over windows with the medians of m, ṁ and ω, where

    C = S⁻¹ = L Lᵀ,     L = [[e^l₀, 0, 0], [l₁, e^l₂, 0], [l₃, l₄, e^(−l₀−l₂)]]     (det C = 1)

and b = C⁻¹c. The eleven parameters are (l, c, d). As published, the iteration starts without iron and bias, and takes
Levenberg–Marquardt steps. Windows of one reading are published as MAGYC-NLS; windows of 25 as in the factor graphs
MAGYC-BFG and MAGYC-IFG.

This is written from the equations, with m and ṁ of `benchmarks.emulations.gyro_windows`; it is neither the authors'
code nor their factor graph. The size of the ellipsoid is the root mean square of C (x − b).

S. Rodríguez-Martínez, G. Troni, "Full magnetometer and gyroscope bias estimation using angular rates: theory and
experimental evaluation of a factor graph-based approach" (2024), with the package ``magyc``, whose functions
``magyc_nls`` and ``magyc_bfg`` were read.

Iron and a gyro bias, without noise:

>>> from flinders import simulate
>>> soft = [[1.1, 0.1, 0.04], [0.1, 0.88, 0.02], [0.04, 0.02, 1.22]]
>>> iron = simulate.Sensor(soft, [20.0, 120.0, 90.0], noise=0.0)
>>> imu = simulate.Imu(gyro_bias=[0.004, -0.005, 0.002], gyro_noise=0.0)
>>> samples = simulate.tumble(seed=1, motion="swayed", sensor=iron, imu=imu).samples
>>> found = magyc_ls(samples, window=1)
>>> found.centre.round(2), (found.shape / found.radius * np.cbrt(np.linalg.det(iron.matrix))).round(3).tolist()
(array([ 20., 120.,  90.]), [[1.1, 0.1, 0.04], [0.1, 0.88, 0.02], [0.04, 0.02, 1.22]])
>>> gyro_bias(samples, window=1).round(4)
array([ 0.004, -0.005,  0.002])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from benchmarks.emulations.gyro_windows import steps_of
from flinders.errors import NotAnEllipsoid, TooFewSamples
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.summary.moments import Moments

if TYPE_CHECKING:
    from benchmarks.emulations.gyro_windows import Steps
    from flinders import Samples
    from flinders.arrays import Floats

WINDOW: Final = 25
"""Number of readings in a window, which their medians represent, as published for the factor graphs."""

PARAMETERS: Final = 11

STEPS: Final = 200
"""Largest number of Levenberg–Marquardt steps; a dozen are usual."""

MIN_STEP: Final = 1e-10
"""Size of a step at which the iteration ends, relative to the size of the readings, and in rad/s."""

MAX_AXIS_RATIO: Final = 100.0
"""Largest ratio of the longest to the shortest axis. Beyond it, the fit has diverged in an undetermined direction."""


def magyc_ls(samples: Samples, window: int = WINDOW) -> Ellipsoid:
    """Ellipsoid of the fit.

    Raises
    ------
    NeedsRate, OneAxisTurned
        See `benchmarks.emulations.gyro_windows.steps_of`.
    TooFewSamples
        If there are fewer windows than are needed for the parameters.
    NotAnEllipsoid
        If the fit diverges to an ellipsoid a hundred times as long as wide.
    """
    moments = Moments.of(samples.field)
    origin, scale = moments.mean, moments.spread
    ellipsoid = _ellipsoid(settled(windows_of(samples, window)), moments.about(origin, scale))
    axes = ellipsoid.semi_axes
    if not axes[2] < MAX_AXIS_RATIO * axes[0]:
        raise NotAnEllipsoid(tuple(float(axis / axes[2]) for axis in axes), "magyc-ls")
    return ellipsoid.in_frame(origin, scale)


def gyro_bias(samples: Samples, window: int = WINDOW) -> Floats:
    """(3,) bias of the gyro in rad/s, by the same fit."""
    return settled(windows_of(samples, window))[8:]


def windows_of(samples: Samples, window: int) -> Windows:
    """Windows of a recording, with readings relative to their mean and spread.

    Raises
    ------
    TooFewSamples
        If there are fewer windows than are needed for the parameters.
    """
    moments = Moments.of(samples.field)
    windows = Windows.of(steps_of(samples), moments.mean, moments.spread, window)
    needed = -(-2 * PARAMETERS // 3)
    if len(windows.rate) < needed:
        raise TooFewSamples(found=len(samples), needed=needed * window + 1, method="magyc-ls")
    return windows


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Medians of consecutive steps, scaled so that readings are about 1 long.

    Attributes
    ----------
    field, slope : (K, 3) float
        m and ṁ, the latter per second.
    rate : (K, 3) float, rad/s
    """

    field: Floats
    slope: Floats
    rate: Floats

    @classmethod
    def of(cls, steps: list[Steps], origin: Floats, scale: float, window: int) -> Self:
        """Windows of some steps with their medians; an incomplete window at the end of a segment is left out."""
        columns = [((one.middle - origin) / scale, one.slope / scale, one.rate) for one in steps]
        field, slope, rate = (
            np.concatenate([_medians(part, window) for part in parts]) for parts in zip(*columns, strict=True)
        )
        return cls(field, slope, rate)

    def residuals(self, theta: Floats) -> tuple[Floats, Floats]:
        """(K, 3) residuals at θ = (l, c, d), and their (K, 3, 11) Jacobian."""
        root, roots = _root(theta[:5])
        form = root @ root.T  # C
        rate = self.rate - theta[8:]
        corrected = self.field @ form - theta[5:8]
        residual: Floats = np.cross(rate, corrected) + self.slope @ form
        jacobian = np.empty((len(rate), 3, PARAMETERS))
        for column, moved in enumerate(roots):
            bent = moved @ root.T
            bent = bent + bent.T
            jacobian[:, :, column] = np.cross(rate, self.field @ bent) + self.slope @ bent
        for axis, unit in enumerate(np.eye(3)):
            jacobian[:, :, 5 + axis] = -np.cross(rate, unit)
            jacobian[:, :, 8 + axis] = -np.cross(unit, corrected)
        return residual, jacobian


def settled(windows: Windows) -> Floats:
    """(11,) θ = (l, c, d) at the minimum that Levenberg–Marquardt steps reach from zero.

    Raises
    ------
    NotAnEllipsoid
        If a step overflows.
    """
    theta, damping = np.zeros(PARAMETERS), 1e-3
    residual, jacobian = windows.residuals(theta)
    cost = float(np.sum(residual**2))
    for _ in range(STEPS):
        matrix = np.einsum("kip,kiq->pq", jacobian, jacobian)
        gradient = np.einsum("kip,ki->p", jacobian, residual)
        damped = matrix + damping * np.diag(np.diag(matrix)) + np.finfo(float).tiny * np.eye(PARAMETERS)
        try:
            step = -np.linalg.solve(damped, gradient)
        except np.linalg.LinAlgError:
            raise NotAnEllipsoid((0.0, 0.0, 1.0), "magyc-ls") from None
        if not np.all(np.abs((theta + step)[:5]) < 50.0):  # e⁵⁰ is not a realistic soft iron
            damping *= 10.0
            continue
        tried, slopes = windows.residuals(theta + step)
        worth = float(np.sum(tried**2))
        if worth <= cost:
            theta, residual, jacobian, cost, damping = theta + step, tried, slopes, worth, max(damping / 10.0, 1e-12)
        else:
            damping *= 10.0
        if np.abs(step).max() < MIN_STEP:
            break
    return theta


def _ellipsoid(theta: Floats, scatter: Floats) -> Ellipsoid:
    """Ellipsoid for θ, in the coordinates of the windows; its size is that of corrected readings."""
    root, _ = _root(theta[:5])
    form = root @ root.T
    shape = np.linalg.inv(form)
    centre = shape @ theta[5:8]
    count = scatter[9, 9]
    mean, square = scatter[9, 6:9] / count, scatter[6:9, 6:9] / count
    about = square - np.outer(mean, centre) - np.outer(centre, mean) + np.outer(centre, centre)
    return Ellipsoid(centre, shape * float(np.sqrt(max(np.sum(form @ form * about), 0.0))))


def _root(entries: Floats) -> tuple[Floats, Floats]:
    """(3, 3) L, and its (5, 3, 3) derivatives, for (5,) l."""
    first, second = np.exp(entries[0]), np.exp(entries[2])
    third = np.exp(-entries[0] - entries[2])
    root = np.array([[first, 0.0, 0.0], [entries[1], second, 0.0], [entries[3], entries[4], third]])
    moved = np.zeros((5, 3, 3))
    moved[0, 0, 0], moved[0, 2, 2] = first, -third
    moved[1, 1, 0] = 1.0
    moved[2, 1, 1], moved[2, 2, 2] = second, -third
    moved[3, 2, 0] = 1.0
    moved[4, 2, 1] = 1.0
    return root, moved


def _medians(rows: Floats, window: int) -> Floats:
    """(K, 3) medians of groups of rows; an incomplete group at the end is left out."""
    whole = len(rows) // window
    medians: Floats = np.median(rows[: whole * window].reshape(whole, window, 3), axis=1)
    return medians
