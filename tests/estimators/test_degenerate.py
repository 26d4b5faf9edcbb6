"""Recordings that can hardly be calibrated: refused with a reason, or limited; never good with a wrong heading."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_sentences
from tests.trials import daily
from tests.worlds import judged

import flinders
from flinders import simulate
from flinders.core.samples import Samples
from flinders.errors import FitError, NotAnEllipsoid, StuckAxis, TooFewSamples, Undetermined, Unmoved
from flinders.estimators import METHODS
from flinders.fitting.result import Refused
from flinders.heading.error_propagation import level_turn

if TYPE_CHECKING:
    from flinders.arrays import Floats

NAMES: Final = set(METHODS)
ANY: Final = pytest.mark.parametrize("method", sorted(NAMES))
SIMPLER: Final = {name for name, method in METHODS.items() if method.unknowns < 10}
"""An ellipsoid in any attitude has nine parameters, and noise."""
GENERAL: Final = pytest.mark.parametrize("method", sorted(NAMES - {"sphere", "axes"}))
PLANAR: Final = {"level", "ellipse", "two-axis"}
"""What x and y of a level turn are enough for."""

CENTRE: Final = np.array([10.0, -20.0, 30.0])
TURN: Final = simulate.turns([[0.9, 0.4, 0.3]])[0]
LONG: Final = TURN @ np.diag([50.0, 50.0, 70.0]) @ TURN.T
SKEW: Final = 50.0 * np.array([[1.0, 0.2, 0.1], [0.2, 1.1, 0.15], [0.1, 0.15, 0.9]])


def ring(height: float, n: int = 400) -> Floats:
    """(n, 3) directions at one height."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    across = np.sqrt(1 - height * height)
    return np.stack([across * np.cos(angle), across * np.sin(angle), np.full(n, height)], axis=1)


def read(directions: Floats, shape: Floats, noise: float = 0.0) -> Floats:
    """Readings of a sensor, with noise from one seed."""
    white = np.random.default_rng(1).standard_normal(directions.shape)
    return np.asarray(CENTRE + directions @ shape + noise * white, np.float64)


def refused(field: Floats, method: str) -> FitError:
    with pytest.raises(FitError) as caught:
        flinders.fit(field, method=method)
    return caught.value


def answered(field: Floats, method: str) -> flinders.Fit | None:
    """The fit; None where it is refused for what the readings show. Any other error is a fault."""
    try:
        return flinders.fit(field, method=method)
    except (Refused, NotAnEllipsoid, TooFewSamples, Undetermined):
        return None


def heading_error(fit: flinders.Fit, shape: Floats) -> float:
    """Worst error in degrees of the heading of a level vehicle at dip 60°, the mean removed."""
    heading, directions = level_turn(60.0)
    x, y, _ = fit.calibration.matrix @ (
        CENTRE[:, np.newaxis] + shape @ directions - fit.calibration.offset[:, np.newaxis]
    )
    error = np.angle(np.exp(1j * (np.arctan2(-y, x) - heading)))
    return float(np.degrees(np.abs(error - error.mean()).max()))


@ANY
@pytest.mark.parametrize("height", [0.0, 0.5])
@pytest.mark.parametrize("noise", daily([0.3, 0.0]))
def test_one_ring_is_refused(method: str, height: float, noise: float) -> None:
    """But by what knows a level turn, and is right there."""
    field = read(ring(height), LONG, noise)
    if method == "auto" or method in PLANAR:
        fit = flinders.fit(field, method=method)
        assert (fit.claim.plane, fit.verdict, fit.findings[0].code) == ("xy", "limited", "level-plane")
        return
    error = refused(field, method)
    assert isinstance(error, Refused | NotAnEllipsoid)
    if isinstance(error, Refused):
        assert error.fit.findings[0].code == "one-plane"
        assert_sentences(str(error))


@pytest.mark.parametrize("method", sorted(NAMES - PLANAR))
def test_one_ring_about_an_axis_of_the_sensor_is_an_axis_that_is_stuck(method: str) -> None:
    error = refused(read(ring(0.5), 50.0 * np.eye(3)), method)
    assert isinstance(error, StuckAxis)
    assert (error.axes, error.evidence["axes"]) == (("z",), ("z",))
    assert error.values == pytest.approx((55.0,))
    assert_sentences(str(error))


@pytest.mark.parametrize("method", sorted(PLANAR & NAMES))
def test_that_is_all_the_same_to_what_looks_at_x_and_y(method: str) -> None:
    fit = flinders.fit(read(ring(0.5), 50.0 * np.eye(3)), method=method)
    assert (fit.verdict, fit.findings[0].code) == ("limited", "level-plane")
    npt.assert_allclose(fit.calibration.offset[:2], CENTRE[:2], atol=1e-6)


@ANY
@pytest.mark.parametrize("axes", [(1,), (0, 2), (0, 1, 2)], ids=["one", "two", "all"])
def test_axes_that_never_change_are_named(method: str, axes: tuple[int, ...]) -> None:
    field = read(simulate.fibonacci(200), SKEW, 0.3)
    field[:, axes] = 7.25
    error = refused(field, method)
    assert isinstance(error, StuckAxis | Unmoved)
    if isinstance(error, StuckAxis):
        asked = [axis for axis in axes if method not in PLANAR or axis < 2]  # it does not look at z
        assert error.axes == tuple("xyz"[axis] for axis in asked)
        assert error.values == (7.25,) * len(asked)


@ANY
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_readings_on_one_line_are_refused(method: str, noise: float) -> None:
    along = np.linspace(-1, 1, 80)[:, np.newaxis] * [1.0, 2.0, 3.0]
    assert isinstance(refused(read(along, 20 * np.eye(3), noise), method), Refused | NotAnEllipsoid)


@ANY
def test_a_sensor_that_was_never_moved_is_refused(method: str) -> None:
    still = read(np.repeat([[0.6, 0.0, 0.8]], 1000, axis=0), SKEW, 0.3)
    assert isinstance(refused(still, method), Unmoved)


@ANY
def test_a_small_cap_is_refused(method: str) -> None:
    directions = simulate.fibonacci(6000)
    cap = directions[directions[:, 2] > np.cos(np.radians(15))]
    error = refused(read(cap, SKEW, 0.3), method)
    assert isinstance(error, Refused | NotAnEllipsoid)


@ANY
@pytest.mark.parametrize("seed", daily(range(2)))
def test_a_handful_of_readings_is_too_few_or_limited(method: str, seed: int) -> None:
    field = read(np.random.default_rng(seed).permutation(simulate.fibonacci(60)), 50.0 * np.eye(3), 0.3)
    for n in range(1, 13):
        if n < METHODS[method].unknowns:
            error = refused(field[:n], method)
            assert isinstance(error, TooFewSamples)
            assert (error.found, error.needed) == (n, METHODS[method].unknowns)
            continue
        fit = answered(field[:n], method)
        if fit is not None:
            assert fit.verdict == "limited"
            assert next(finding.number for finding in fit.findings if finding.code == "few-samples") == n


@GENERAL
def test_six_places_seen_again_and_again_are_not_many(method: str) -> None:
    """The faces of a box fix an offset, not nine unknowns."""
    faces = np.repeat(np.concatenate([np.eye(3), -np.eye(3)]), 50, axis=0)
    fit = answered(read(faces, SKEW, 0.3), method)
    assert fit is None or fit.verdict == "limited" or heading_error(fit, SKEW) < 4 * fit.heading_error_deg.worst


@GENERAL
@pytest.mark.parametrize("shape", daily([LONG, 50.0 * np.eye(3), SKEW]), ids=["long", "sphere", "skew"])
def test_two_noisy_rings_are_never_good_with_a_wrong_heading(method: str, shape: Floats) -> None:
    field = read(np.concatenate([ring(0.5), ring(-0.5)]), shape, 0.3)
    fit = answered(field, method)
    assert (
        fit is None or fit.verdict == "limited" or heading_error(fit, shape) < max(1.0, 4 * fit.heading_error_deg.worst)
    )


@GENERAL
@pytest.mark.parametrize(
    "directions",
    [np.concatenate([ring(0.5), ring(-0.5)]), np.repeat(np.concatenate([np.eye(3), -np.eye(3)]), 50, axis=0)],
    ids=["two rings", "six faces"],
)
@pytest.mark.parametrize("shape", daily([LONG, SKEW]), ids=["long", "skew"])
def test_an_ellipsoid_left_open_without_noise_is_never_good_and_wrong(
    method: str, directions: Floats, shape: Floats
) -> None:
    """Rank 8 and 6 of 9: any number of ellipsoids goes through them, exactly."""
    fit = answered(read(directions, shape), method)
    assert fit is None or fit.verdict == "limited" or heading_error(fit, shape) < 1.0


@pytest.mark.parametrize("method", sorted(NAMES - SIMPLER - {"ekf"}))
def test_three_rings_are_enough(method: str) -> None:
    """But for simpler models, and for a filter, which the first ring alone leads astray."""
    field = read(np.concatenate([ring(0.6), ring(0.0), ring(-0.6)]), SKEW, 0.3)
    fit = flinders.fit(field, method=method)
    assert heading_error(fit, SKEW) < max(4 * fit.heading_error_deg.worst, 0.5)
    assert fit.heading_error_deg.worst < 1.0


# The exact list of §15 of the literature notes, in its order. Items 5 (TWOSTEP), 8 (dip alignment), 9 (gyro), 12
# (Tolles–Lawson, motor current) and 13 (frames of two sensors) need what this release does not have.


def severity(fit: flinders.Fit, code: str) -> str | None:
    """How grave a finding is; None where there is none."""
    return next((finding.severity for finding in fit.findings if finding.code == code), None)


@ANY
def test_1_fewer_readings_than_parameters(method: str) -> None:
    needed = METHODS[method].unknowns
    error = refused(read(simulate.fibonacci(needed - 1), SKEW), method)
    assert (error.code, error.evidence["found"], error.evidence["needed"]) == ("too-few-samples", needed - 1, needed)


@ANY
@pytest.mark.parametrize(("places", "code"), [(1, "stuck-axis"), (2, "too-few-samples")])
def test_1_duplicates_only(method: str, places: int, code: str) -> None:
    assert refused(np.repeat(read(simulate.fibonacci(7)[:places], SKEW), 100, axis=0), method).code == code


@ANY
def test_different_readings_are_counted_wherever_they_stand(method: str) -> None:
    few = read(simulate.fibonacci(METHODS[method].unknowns - 1), SKEW, 0.3)
    error = refused(np.tile(few, (50, 1)), method)
    assert (error.code, error.evidence["found"]) == ("too-few-samples", len(few))
    assert_sentences(str(error))


def test_copied_readings_are_no_evidence() -> None:
    """Readings do not claim more, however often they are repeated."""
    once = read(simulate.fibonacci(120), SKEW, 0.3)
    fit, copied = flinders.fit(once), flinders.fit(np.tile(once, (50, 1)))
    assert fit.heading_error_deg.worst < copied.heading_error_deg.worst < 3.0 * fit.heading_error_deg.worst
    assert severity(copied, "stale-repeats") == "note"


@pytest.mark.parametrize("noise", [0.0, 0.3])
@pytest.mark.parametrize("prior", [0.3, None])
def test_2_rank_5_a_planar_ring(noise: float, prior: float | None) -> None:
    """The limit goes with the noise; the fall-back is the ellipse of a level turn, where the plane is across z."""
    across, upright = (read(ring(0.5) @ turn, LONG, noise) for turn in (np.eye(3), np.eye(3)[[1, 2, 0]]))
    if prior is None:
        assert refused_with(across, method=flinders.estimators.Auto(prior=None)) in {"undetermined", "one-plane"}
    else:
        assert severity(flinders.fit(across), "level-plane") == "limits"
        assert refused_with(upright) == "one-plane"


def refused_with(field: Floats, **options: object) -> str:
    """The code of an error, or of the gravest finding."""
    with pytest.raises(FitError) as caught:
        flinders.fit(field, **options)  # type: ignore[arg-type]
    return caught.value.fit.findings[0].code if isinstance(caught.value, Refused) else caught.value.code


@pytest.mark.parametrize("noise", [0.1, 0.3])
def test_2_rank_8_two_rings(noise: float) -> None:
    field = read(np.concatenate([ring(0.6), np.roll(ring(0.6), 1, axis=1)]), SKEW, noise)
    fit = judged(field)
    assert severity(fit, "unobservable-parameters") == "limits"
    assert fit.evidence.unobserved == 1
    with pytest.raises(Undetermined) as caught:
        flinders.fit(field, method=flinders.estimators.Auto(prior=None))
    assert caught.value.evidence["unseen"] == 1


@pytest.mark.parametrize("signs", [(1.0, 1.0, -1.0), (1.0, -1.0, -1.0), (1.0, 1.0, 0.0)], ids=["one", "two", "none"])
@pytest.mark.parametrize("method", ["algebraic", "consistent"])
def test_3_the_quadric_is_open(signs: tuple[float, float, float], method: str) -> None:
    """Hyperboloids of one and two sheets, where det A alone would let the second pass; and a cylinder."""
    rng = np.random.default_rng(2)
    along = rng.uniform(-40.0, 40.0, 400)
    angle = rng.uniform(0.0, 2 * np.pi, 400)
    radius = {-1.0: np.sqrt(2500.0 + along**2), 0.0: np.full(400, 50.0)}[signs[2]]
    if signs[1] < 0.0:
        radius = np.abs(along)
        along = np.sign(along) * np.sqrt(2500.0 + along**2)
    field = np.stack([radius * np.cos(angle), radius * np.sin(angle), along], axis=1)
    error = refused(np.asarray(field + CENTRE, np.float64), method)
    assert error.code in {"not-an-ellipsoid", "refused"}
    if isinstance(error, NotAnEllipsoid) and error.eigenvalues:
        assert min(error.eigenvalues) <= 1e-6


def test_3_axes_that_differ_too_much() -> None:
    fit = judged(read(simulate.fibonacci(2000), np.diag([50.0, 50.0, 130.0]), 0.3))
    assert severity(fit, "axis-ratio") == "limits"
    assert severity(judged(read(simulate.fibonacci(2000), np.diag([50.0, 50.0, 90.0]), 0.3)), "axis-ratio") is None


@pytest.mark.parametrize(("strength", "found"), [(15.0, True), (25.0, False), (60.0, False), (80.0, True)])
def test_4_a_field_that_is_not_the_earths(strength: float, found: bool) -> None:
    samples = Samples.of(read(simulate.fibonacci(2000), strength * np.eye(3), 0.1), unit="uT")
    assert (severity(judged(samples), "field-strength") == "note") is found


def test_4_inflation() -> None:
    directions = simulate.fibonacci(8000)
    fit = judged(read(directions[directions[:, 2] > np.cos(np.radians(20.0))], SKEW, 0.3))
    assert severity(fit, "inflation") == "limits"
    assert severity(judged(read(directions, SKEW, 0.3)), "inflation") is None


def test_4_an_offset_of_many_fields_is_no_fault_of_the_fit() -> None:
    """Iron may be that strong; what counts is what readings there are."""
    fit = flinders.fit(read(simulate.fibonacci(2000), SKEW, 0.3) + np.array([500.0, 0.0, 0.0]))
    assert fit.verdict == "good"
    npt.assert_allclose(fit.calibration.offset, np.add(CENTRE, [500.0, 0.0, 0.0]), atol=0.1)


def test_6_scale_without_a_field_strength() -> None:
    field = read(simulate.fibonacci(2000), SKEW, 0.3)
    assert severity(flinders.fit(field), "scale-unknown") == "note"
    assert severity(flinders.fit(field, site=flinders.Site(strength=50.0)), "scale-unknown") is None


def test_7_rotation_and_mirror() -> None:
    field = read(simulate.fibonacci(2000), SKEW, 0.3)
    assert severity(flinders.fit(field), "rotation-unknown") == "note"
    assert severity(judged(Samples.of(field, axes="x,y,-z")), "mirrored-axes") == "limits"
    assert severity(judged(Samples.of(field, axes="y,-x,z")), "mirrored-axes") is None


def test_10_clustered_samples() -> None:
    """All within three degrees; and a third of them so, beside a full tumble, which does no harm."""
    rng = np.random.default_rng(4)
    near = np.array([0.6, 0.0, 0.8]) + 0.03 * rng.standard_normal((600, 3))
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    assert refused_with(read(near, SKEW, 0.3)) == "unmoved"
    beside = flinders.fit(read(np.concatenate([near, simulate.fibonacci(1200)]), SKEW, 0.3))
    assert beside.verdict == "good"
    assert heading_error(beside, SKEW) < 4 * beside.heading_error_deg.worst


def test_10_stationary_samples() -> None:
    still = read(np.repeat([[0.6, 0.0, 0.8]], 1000, axis=0), SKEW, 0.01)
    assert refused_with(still) == "unmoved"


def test_10_stale_repeats() -> None:
    field = read(np.random.default_rng(1).permutation(simulate.fibonacci(600)), SKEW, 0.3)
    once, fourfold = flinders.fit(field), flinders.fit(np.repeat(field, 4, axis=0))
    assert severity(fourfold, "stale-repeats") == "note"
    assert severity(once, "stale-repeats") is None
    assert fourfold.heading_error_deg.worst > 0.9 * once.heading_error_deg.worst


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_11_a_clipped_axis(axis: int) -> None:
    field = read(simulate.fibonacci(3000), SKEW, 0.3)
    limit = CENTRE[axis] + 40.0
    field[:, axis] = np.minimum(field[:, axis], limit)
    fit = judged(field)
    assert severity(fit, "saturated") == "limits"
    assert any(f"highest value of {'xyz'[axis]} ({limit:g})" in finding.advice for finding in fit.findings)


def test_11_tails_that_are_not_gaussian() -> None:
    """Student's t of two degrees of freedom: what is far out is left out, and the heading is as claimed."""
    rng = np.random.default_rng(6)
    field = read(rng.permutation(simulate.fibonacci(2000)), SKEW) + 0.3 * rng.standard_t(2, (2000, 3))
    fit = judged(np.asarray(field, np.float64))
    assert severity(fit, "outliers") == "note"
    assert heading_error(fit, SKEW) < 4 * fit.heading_error_deg.worst


def test_11_a_field_that_varies_with_time() -> None:
    field = simulate.tumble(seed=4, sensor=simulate.Sensor(noise=0.3)).samples.field
    creeping = np.linspace(0.0, 2.0, len(field))[:, np.newaxis] * [1.0, 0.0, 0.0]
    assert severity(judged(field), "field-changed") is None
    assert severity(judged(np.asarray(field + creeping, np.float64)), "field-changed") == "limits"
