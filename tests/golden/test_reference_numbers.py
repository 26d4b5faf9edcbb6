"""Monte Carlo and rank tables of the project's literature notes, with the seeds stated; §n is a section of theirs.

The tables were made from few runs, which their scatter shows. Where more runs end within 20 % of a figure that is held
here; where they do not, the figure lies among single runs, and that is what is held.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.trials import daily
from tests.worlds import HARD_IRON, SIX_READINGS, SOFT_IRON

import flinders
from flinders import simulate
from flinders.errors import NotAnEllipsoid
from flinders.estimators import Estimator, Readings
from flinders.estimators.algebraic import Algebraic
from flinders.estimators.consistent import Consistent
from flinders.estimators.likelihood import Likelihood
from flinders.geometry.ellipsoid import symmetric_matrix, upper_entries

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats


METHODS: Final[dict[str, Estimator]] = {
    "ols": Algebraic("unit"),
    "nxp": Algebraic("nxp"),
    "consistent": Consistent(),
    "sampson": Likelihood(prior=None, bias_correction=False),
}


def carried(yaw: Floats, pitch: Floats, roll: Floats | float, dip_deg: float) -> Floats:
    """(N, 3) unit fields in a body that was yawed, pitched, then rolled, in degrees; x forward, y right, z down."""
    y, p, r, dip = (np.deg2rad(part) for part in (yaw, pitch, roll, dip_deg))
    ahead, right, down = np.cos(dip) * np.cos(y), -np.cos(dip) * np.sin(y), np.sin(dip)
    ahead, down = np.cos(p) * ahead - np.sin(p) * down, np.sin(p) * ahead + np.cos(p) * down
    right, down = np.cos(r) * right + np.sin(r) * down, np.cos(r) * down - np.sin(r) * right
    return np.stack([ahead, right, down], axis=1)


# §4: the ring and the arch of Vasconcelos et al. (2011), whose own cost diverges from a dip of 20° on


def vasconcelos() -> tuple[Floats, Floats]:
    """C and b of the paper's simulation: b in gauss."""
    psi, theta, phi = np.deg2rad([2.0, 1.0, 1.5])
    scale = np.diag([1.2, 0.8, 1.3])
    skew = np.array(
        [
            [1.0, 0.0, 0.0],
            [np.sin(psi), np.cos(psi), 0.0],
            [-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)],
        ]
    )
    soft = np.array([[0.58, -0.73, 0.36], [1.32, 0.46, -0.12], [-0.26, 0.44, 0.53]])
    hard = scale @ skew @ [-1.2, 0.2, -0.8] + [1.5, 0.4, 2.7]
    return scale @ skew @ soft, hard


@cache
def swept(path: str, dip_deg: float, runs: int) -> Floats:
    """(runs, 4) errors of offset and semi-axes in gauss, Sampson's and the consistent fit's; 10,000 readings, 5 mG."""
    distortion, hard = vasconcelos()
    semi = 0.5 * np.linalg.svd(distortion)[1]
    half = 180.0 if path == "ring" else 90.0
    rng = np.random.default_rng(3)
    errors = []
    for _ in range(runs):
        body = carried(rng.uniform(-half, half, 10_000), rng.uniform(-20.0, 20.0, 10_000), 0.0, dip_deg)
        readings = Readings.of(0.5 * body @ distortion.T + hard + 0.005 * rng.standard_normal((10_000, 3)))
        found = [METHODS[name].estimate(readings).ellipsoid for name in ("sampson", "consistent")]
        parts = ((each.centre - hard, np.sort(each.semi_axes)[::-1] - semi) for each in found)
        errors.append([np.linalg.norm(part) for pair in parts for part in pair])
    return np.array(errors)


def test_offset_and_semi_axes_of_the_paper() -> None:
    distortion, hard = vasconcelos()
    npt.assert_allclose(0.5 * np.linalg.svd(distortion)[1], [0.70244, 0.50135, 0.40359], atol=5.1e-6)
    npt.assert_allclose(hard, [0.06, 0.5264, 1.69455], atol=5.1e-5)


@pytest.mark.parametrize(
    ("path", "dip_deg", "printed"),
    [
        ("ring", 0.0, (0.0002, 0.0014, 0.0002, 0.0010)),
        ("ring", 20.0, (0.0010, 0.0015, 0.0011, 0.0016)),
        ("ring", 31.0, (0.0017, 0.0021, 0.0020, 0.0024)),
        ("ring", 60.0, (0.0063, 0.0080, 0.0060, 0.0071)),
        ("arch", 0.0, (0.0016, 0.0017, 0.0016, 0.0016)),
        ("arch", 20.0, (0.0029, 0.0036, 0.0033, 0.0033)),
        ("arch", 31.0, (0.0053, 0.0049, 0.0052, 0.0053)),
        ("arch", 60.0, (0.0274, 0.0331, 0.0177, 0.0198)),
    ],
)
def test_no_ring_and_no_arch_diverges_and_errors_are_of_the_size_of_the_table(
    path: str, dip_deg: float, printed: tuple[float, ...], trials: Choose
) -> None:
    """Each figure lies among 30 runs, neither in the lowest nor in the highest tenth; no run is ten times off."""
    claim = trials(30, 12)
    found = swept(path, dip_deg, claim.count)
    share = (found < np.array(printed)).mean(axis=0)
    outside = 0.1 if claim.widening == 1.0 else 1e-9  # of few runs: one is smaller, and one larger
    assert ((share >= outside) & (share <= 1.0 - outside)).all(), share
    assert (found.max(axis=0) < 10.0 * claim.widening * np.median(found, axis=0)).all()


@pytest.mark.parametrize(
    ("dip_deg", "printed"), [(20.0, (0.0010, 0.0015, 0.0011, 0.0016)), (31.0, (0.0017, 0.0021, 0.0020, 0.0024))]
)
def test_a_ring_errs_by_the_figures_of_the_table_to_a_fifth(
    dip_deg: float, printed: tuple[float, ...], trials: Choose
) -> None:
    """Medians of 60 runs; at the other places those of 120 are 0.6 to 2.1 times what few runs gave the table."""
    claim = trials(60, 12)
    npt.assert_allclose(np.median(swept("ring", dip_deg, claim.count), axis=0), printed, rtol=0.2 * claim.widening)


@pytest.mark.nightly
@pytest.mark.parametrize("half", [180.0, 90.0], ids=["ring", "arch"])
def test_the_cost_of_the_paper_runs_away(half: float) -> None:
    """Σ (|T(h − b)| − 1)² from the truth, at a dip of 31°: it shrinks as the ellipsoid grows, without end."""
    from scipy.optimize import least_squares

    distortion, hard = vasconcelos()
    rng = np.random.default_rng(3)
    body = carried(rng.uniform(-half, half, 2000), rng.uniform(-20.0, 20.0, 2000), 0.0, 31.0)
    field = 0.5 * body @ distortion.T + hard + 0.005 * rng.standard_normal((2000, 3))
    left, values, _ = np.linalg.svd(0.5 * distortion)
    truth = np.concatenate([upper_entries(left @ np.diag(1.0 / values) @ left.T), hard])

    def residuals(unknowns: Floats) -> Floats:
        lengths: Floats = np.linalg.norm((field - unknowns[6:]) @ symmetric_matrix(unknowns[:6]), axis=1)
        return lengths - 1.0

    found = least_squares(residuals, truth, method="lm", max_nfev=400)
    assert np.mean(found.fun**2) < 0.01 * np.mean(residuals(truth) ** 2)
    assert np.linalg.norm(found.x[6:] - hard) > 10.0


# §5 and §13: bias and centre errors of partial coverage


def directions(rng: np.random.Generator, motion: str, n: int = 1000) -> Floats:
    """(n, 3) directions of a motion of §13: a cap of so many degrees about z, or a vehicle that tilts by up to 20°."""
    if motion == "vehicle":
        return carried(rng.uniform(0.0, 360.0, n), rng.uniform(-20.0, 20.0, n), rng.uniform(-20.0, 20.0, n), 60.0)
    height, around = rng.uniform(np.cos(np.deg2rad(float(motion))), 1.0, n), rng.uniform(0.0, 2.0 * np.pi, n)
    across = np.sqrt(1.0 - height**2)
    return np.stack([across * np.cos(around), across * np.sin(around), height], axis=1)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("motion", "sigma", "printed"),
    [
        ("60", 0.5, {"ols": 2.39, "consistent": 0.92}),
        ("vehicle", 0.5, {"ols": 6.2, "nxp": 10.3}),
        ("vehicle", 2.0, {"ols": 47.0, "sampson": 9.8}),
    ],
)
def test_median_centre_errors_of_partial_coverage(
    motion: str, sigma: float, printed: dict[str, float], trials: Choose
) -> None:
    """80 runs of 1,000 readings, on paths of our own: the notes do not give theirs.

    Not held at 0.5 µT of noise: Sampson's 0.71 and 2.8 µT, which come out as 1.1 and 1.8, and 2.5 for the consistent
    fit on the vehicle, which is 1.8.
    """
    rng, claim = np.random.default_rng(1), trials(80, 20)
    errors: dict[str, list[float]] = {name: [] for name in printed}
    for _ in claim.seeds:
        noise = sigma * rng.standard_normal((1000, 3))
        readings = Readings.of(50.0 * directions(rng, motion) @ SOFT_IRON.T + HARD_IRON + noise)
        for name, kept in errors.items():
            kept.append(float(np.linalg.norm(METHODS[name].estimate(readings).ellipsoid.centre - HARD_IRON)))
    assert {name: float(np.median(kept)) for name, kept in errors.items()} == pytest.approx(
        printed, rel=0.2 * claim.widening
    )


@pytest.mark.parametrize(("sigma", "bias", "noise"), daily([(2.0, 1.6, 1.99), (5.0, 10.5, 4.99)]))
def test_half_a_sphere_biases_plain_least_squares_and_not_the_consistent_fit(
    sigma: float, bias: float, noise: float
) -> None:
    """§5: mean over 60 runs of 1,000 readings; the notes print 1.6 and 10.5 µT, of one run each."""
    rng = np.random.default_rng(2)
    off: dict[str, list[Floats]] = {"ols": [], "consistent": []}
    sigmas = []
    for _ in range(60):
        field = 50.0 * directions(rng, "90") @ SOFT_IRON.T + HARD_IRON
        readings = Readings.of(field + sigma * rng.standard_normal((1000, 3)))
        for name, kept in off.items():
            kept.append(METHODS[name].estimate(readings).ellipsoid.centre - HARD_IRON)
        sigmas.append(METHODS["consistent"].estimate(readings).noise)
    plain, consistent = (float(np.linalg.norm(np.mean(kept, axis=0))) for kept in off.values())
    assert plain == pytest.approx(bias, rel=0.25)
    assert consistent < 0.1 * plain
    assert np.mean(sigmas) == pytest.approx(noise, rel=0.01)


# §7: the smallest model that will do


def test_the_condition_of_the_example_of_an4246() -> None:
    """Six points nearly in a plane: the condition of [h 1] is 4240, that of the normal equations its square."""
    assert np.linalg.cond(np.column_stack([SIX_READINGS, np.ones(6)])) == pytest.approx(4240.0, abs=0.5)
    # Centred and scaled, as it is solved here, the same points are no trouble.
    moments = Readings.of(SIX_READINGS).summary.moments
    assert np.linalg.cond(moments.about(moments.mean, moments.spread)[6:, 6:]) < 100.0


@pytest.mark.parametrize("tilt_deg", [1.0, 2.0, 5.0, 10.0, 20.0])
def test_a_ring_without_soft_iron_deceives_ten_parameters_and_not_auto(tilt_deg: float) -> None:
    """Yaw all round, a little pitch, dip 60°: the general fit is open or tens of µT off, with a small residual."""
    rng = np.random.default_rng(3)
    body = carried(rng.uniform(0.0, 360.0, 1000), rng.uniform(-tilt_deg, tilt_deg, 1000), 0.0, 60.0)
    field = 50.0 * body + HARD_IRON + 0.5 * rng.standard_normal((1000, 3))
    readings = Readings.of(field)
    try:
        general = METHODS["ols"].estimate(readings).ellipsoid
    except NotAnEllipsoid:
        pass
    else:
        assert np.linalg.norm(general.centre - HARD_IRON) > 20.0
    found = flinders.fit(field)
    assert found.verdict == "limited"
    off = found.calibration.apply(50.0 * body + HARD_IRON)[:, :2] - (found.calibration.field_strength * body)[:, :2]
    level = np.rad2deg(np.abs(off).max() / (0.5 * found.calibration.field_strength))
    assert level < 4.0 * max(found.heading_error_deg.worst, 0.5)


# §12: what a recording determines


def ring(height: float, axis: int) -> Floats:
    """(60, 3) directions around an axis at a height along it."""
    angle = np.arange(60) * np.pi / 30.0
    across = np.sqrt(1.0 - height**2)
    flat = np.stack([across * np.cos(angle), across * np.sin(angle), np.full(60, height)], axis=1)
    return np.roll(flat, axis - 2, axis=1)


SEEN: Final[dict[str, Floats]] = {
    "one ring": ring(0.3, 2),
    "two parallel rings": np.concatenate([ring(0.3, 2), ring(-0.4, 2)]),
    "two rings that cross": np.concatenate([ring(0.3, 2), ring(0.2, 0)]),
    "three rings": np.concatenate([ring(0.3, 2), ring(0.2, 0), ring(0.1, 1)]),
    "nine points": simulate.uniform_directions(np.random.default_rng(1), 9),
    "many points": simulate.uniform_directions(np.random.default_rng(1), 200),
}


@pytest.mark.parametrize(
    ("seen", "soft", "columns", "rank"),
    [
        ("one ring", SOFT_IRON, range(10), 5),
        ("one ring", SOFT_IRON, range(6, 10), 3),
        ("one ring", np.eye(3), (0, 1, 2, 6, 7, 8, 9), 4),
        ("two parallel rings", SOFT_IRON, range(10), 8),
        ("two rings that cross", SOFT_IRON, range(10), 8),
        ("three rings", SOFT_IRON, range(10), 9),
        ("nine points", SOFT_IRON, range(10), 9),
        ("many points", SOFT_IRON, range(10), 9),
    ],
)
def test_the_rank_of_the_design_says_what_is_determined(
    seen: str, soft: Floats, columns: range | tuple[int, ...], rank: int
) -> None:
    """Without noise nine is all there is: the tenth direction is the ellipsoid itself."""
    moments = Readings.of(50.0 * SEEN[seen] @ soft.T + HARD_IRON).summary.moments
    values = np.linalg.eigvalsh(moments.about(moments.mean, moments.spread)[np.ix_(columns, columns)])
    assert int(np.sum(values > 1e-10 * values[-1])) == rank
