"""One call of the engine fits a level turn as `auto` does, and its record is judged as `flinders.fit` judges."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.worlds import judged, level_turn

from flinders.estimators import Level, Readings, Robust
from flinders.geometry.ellipsoid import Ellipsoid, symmetric_matrix
from flinders.likelihood import magnitude
from flinders.native import build
from flinders.native.engine import engine

if TYPE_CHECKING:
    from flinders.arrays import Floats

try:
    build.compiler()
except build.NoCompiler as error:
    pytest.skip(str(error), allow_module_level=True)

DIPS = (-75.0, 0.0, 30.0, 80.0)


def turned(n: int = 600, *, degrees: float = 360.0, sway: float = 0.0, noise: float = 0.5, seed: int = 1) -> Floats:
    """Readings of a turn in a field of dip 60°, which leave their plane by `sway` µT."""
    heading, rng = np.linspace(0.0, np.radians(degrees), n), np.random.default_rng(seed)
    level = [26 * np.cos(heading) + 3 * np.sin(heading) + 20, 3 * np.cos(heading) - 24 * np.sin(heading) - 35]
    across = 70.0 + sway * np.sin(7.0 * heading)
    field: Floats = np.stack([*level, across], axis=1) + noise * rng.standard_normal((n, 3))
    return field


@pytest.mark.parametrize(("sway", "plane"), [(0.0, 1), (0.7, 1), (20.0, 0)])
def test_readings_that_leave_their_plane_by_noise_alone_are_a_level_turn(sway: float, plane: int) -> None:
    field = turned(sway=sway, degrees=720.0)
    assert engine().fit(field)["plane"] == plane
    assert [int(engine().fit(field, **option)["plane"]) for option in ({"level": 0}, {"prior": 0.0})] == [0, 0]


def test_a_level_turn_is_the_same_by_every_call() -> None:
    field = turned()
    record, asked = engine().fit(field), engine().fit_level(field)
    many = engine().fit_many(np.concatenate([field, field[::2]]), [0, 600, 900])
    assert record.tobytes() == asked.tobytes() == many[0].tobytes()
    assert many[1].tobytes() == engine().fit(field[::2]).tobytes()
    estimate = Level().estimate(Readings.of(field))
    assert (estimate.method, estimate.plane) == ("level", "xy")
    npt.assert_array_equal(estimate.ellipsoid.centre, record["centre"])
    npt.assert_array_equal(estimate.covariance.ravel(), record["covariance"])


def test_six_readings_are_enough_and_five_are_not() -> None:
    field = turned(6, degrees=300.0, noise=0.05)
    assert [int(engine().fit(field[:n])["status"]) for n in (5, 6)] == [1, 0]
    assert [int(engine().fit_level(field[:n])["status"]) for n in (5, 6)] == [1, 0]
    assert engine().fit(field[:6], level=0)["status"] == 1


def test_the_ellipse_is_that_of_the_readings_at_every_dip() -> None:
    field = turned()
    flat = engine().fit_level(field, dip_deg=0.0)
    for dip_deg in DIPS:
        record, dip = engine().fit_level(field, dip_deg=dip_deg), np.radians(dip_deg)
        shape = symmetric_matrix(record["shape"])
        npt.assert_allclose(np.cos(dip) * shape, symmetric_matrix(flat["shape"]), rtol=1e-9, atol=1e-9)
        npt.assert_allclose(record["centre"] + np.sin(dip) * shape[:, 2], flat["centre"], rtol=1e-9, atol=1e-9)
        npt.assert_allclose(record["level_worst_deg"], flat["level_worst_deg"], rtol=1e-6)
        assert record["covariance"].reshape(9, 9)[2, 2] >= record["radius"] ** 2


def test_no_neighbour_of_an_ellipse_is_closer_to_its_readings() -> None:
    """At the minimum of the likelihood, but for the step that curvature asks for."""
    field = turned(noise=0.1)
    record = engine().fit_level(field, dip_deg=0.0)
    flat = np.column_stack([field[:, :2], np.full(len(field), record["centre"][2])])

    def cost(offset: Floats, scale: Floats) -> float:
        shape = symmetric_matrix(record["shape"]) * np.outer(scale, scale)
        surface = Ellipsoid(record["centre"] + offset, shape)
        return float(np.sum(magnitude.distances(flat, surface) ** 2))

    best = cost(np.zeros(3), np.ones(3))
    sigma = np.sqrt(record["covariance"].reshape(9, 9).diagonal())
    for axis in (0, 1):
        for sign in (-1.0, 1.0):
            step = np.zeros(3)
            step[axis] = sign * 0.3
            assert cost(step * sigma[axis], np.ones(3)) > best
            assert cost(np.zeros(3), 1.0 + step * sigma[3 + axis] / record["shape"][axis]) > best


@pytest.mark.parametrize("noise", [0.1, 0.5, 2.0])
@pytest.mark.parametrize("degrees", [120.0, 360.0])
def test_the_record_of_one_call_is_judged_as_a_fit(noise: float, degrees: float) -> None:
    field = turned(noise=noise, degrees=degrees)
    fit, judgement = judged(field), engine().judge(engine().fit(field), engine().request(is_microtesla=0))
    npt.assert_allclose(judgement["worst_deg"], fit.heading_error_deg.worst, rtol=1e-9)
    npt.assert_allclose(judgement["covariance"], fit.claim.claimed_covariance.ravel(), rtol=1e-9)
    npt.assert_allclose(judgement["bound_deg"], fit.claim.heading_bound_deg, rtol=1e-3)
    assert ("good", "limited", "refused").index(fit.verdict) == max(int(judgement["verdict"]) - 1, 0)
    assert "level-plane" in [finding.code for finding in fit.findings]


def test_outliers_of_a_level_turn_are_rejected_where_residuals_ask_for_it() -> None:
    field = turned()
    field[::50] += np.outer(np.where(np.arange(12) % 2, 1.0, -1.0), [15.0, 12.0, 9.0])
    record, without = engine().fit(field), engine().fit(field, robust=0)
    assert [int(each["rejected"]) for each in (record, without)] == [11, 0]  # one was thrown along the ellipse
    npt.assert_allclose(record["centre"][:2], engine().fit(turned())["centre"][:2], atol=0.1)
    assert Level().estimate(Readings.of(field)).outliers


def test_a_body_that_was_tilted_is_no_level_turn() -> None:
    """Of a turn of which a third was lifted, the turn itself leaves out more than a fifth of the readings."""
    field = turned(degrees=720.0)
    field[:200] += [6.0, 4.0, 12.0]
    assert engine().fit(field)["plane"] == 0


def test_recordings_of_one_sensor_are_a_turn_together() -> None:
    field = np.concatenate([turned(seed=1), turned(300, seed=2)])
    together = engine().fit(field, ends=[600, 900])
    assert [int(together[name]) for name in ("plane", "rows")] == [1, 900]
    npt.assert_allclose(together["centre"], engine().fit(field)["centre"], rtol=1e-9)


def test_methods_of_all_axes_take_no_level_turn() -> None:
    samples = level_turn(1).samples
    assert Robust().estimate(Readings.of(samples)).plane is None


def test_a_rest_beside_a_turn_counts_as_in_any_fit() -> None:
    still = np.tile(turned()[-1], (300, 1)) + 0.5 * np.random.default_rng(2).standard_normal((300, 3))
    record = engine().fit(np.concatenate([turned(), still]))
    assert [int(record[name]) for name in ("plane", "rests")] == [1, 1]
    assert record["fitted"] < 610


def test_readings_on_a_line_have_no_ellipse() -> None:
    line = np.outer(np.linspace(-1.0, 1.0, 100), [30.0, 20.0, 0.0])
    assert engine().fit_level(line)["status"] == 6
