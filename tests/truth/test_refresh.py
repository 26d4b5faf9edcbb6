"""A calibration that is refreshed: hard iron from seconds, soft iron of before, and the truth about both."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.worlds import TUMBLED_SENSOR

import flinders
from flinders.core.units import Unit
from flinders.errors import AxesError, UnitError, UsageError
from flinders.fitting.result import Fit
from flinders.likelihood.site_field import Site
from flinders.simulate import tumble
from flinders.simulate.motions import turns

if TYPE_CHECKING:
    from flinders.simulate import Simulated

MOVED = np.array([8.0, -5.0, 3.0])


@pytest.fixture(scope="module")
def earlier() -> Fit:
    """The calibration of a vehicle before something was moved."""
    return flinders.fit(tumble(seed=3, sensor=TUMBLED_SENSOR).samples)


def recorded(seed: int = 4, motion: str = "wobble", steel: float = 0.0, strength: float = 50.0) -> Simulated:
    """Ten seconds after a battery was moved, and steel built in."""
    bent = np.eye(3) + steel * np.array([[0.5, 1.0, 0.0], [1.0, -0.5, 0.4], [0.0, 0.4, 0.0]])
    matrix = bent @ TUMBLED_SENSOR.matrix @ bent
    sensor = replace(TUMBLED_SENSOR, matrix=matrix, offset=TUMBLED_SENSOR.offset + MOVED)
    return tumble(seed=seed, motion=motion, n=500, sensor=sensor, field_strength=strength)


@pytest.mark.parametrize(("motion", "aiding"), [("wobble", ()), ("wobble", ("rate",)), ("level", ())])
def test_the_offset_is_right_within_its_claim(earlier: Fit, motion: str, aiding: tuple[str, ...]) -> None:
    fit = flinders.refresh(recorded(motion=motion).samples, earlier, aiding=aiding)
    assert fit.verdict == "good"
    assert fit.heading_error_deg.worst < 0.6
    assert np.all(np.abs(fit.calibration.offset - TUMBLED_SENSOR.offset - MOVED) < 4.0 * fit.offset_sigma)
    assert fit.refreshed is not None
    assert np.allclose(fit.refreshed.offset_change, fit.calibration.offset - earlier.calibration.offset)


def test_a_fresh_fit_of_the_same_readings_is_refused() -> None:
    with pytest.raises(flinders.FitError, match="heading may be off"):
        flinders.fit(recorded().samples)


def test_a_good_verdict_rests_on_the_soft_iron(earlier: Fit) -> None:
    fit = flinders.refresh(recorded().samples, earlier)
    assert fit.conditions[0] == "same-soft-iron"
    assert Fit.from_document(fit.to_document()).conditions == fit.conditions


def test_steel_is_noticed_and_allowed_for(earlier: Fit) -> None:
    made = recorded(steel=0.05)
    fit = flinders.refresh(made.samples, earlier)
    assert "soft-iron-changed" in {finding.code for finding in fit.findings}
    assert fit.verdict == "limited"
    error = fit.calibration.offset - made.sensor.offset
    assert np.all(np.abs(error) < 4.0 * fit.offset_sigma)


def test_a_share_of_change_widens_the_claim(earlier: Fit) -> None:
    readings = recorded().samples
    claims = [
        flinders.refresh(readings, earlier, soft_iron_sigma=share).heading_error_deg.worst for share in (0.0, 0.005)
    ]
    assert claims[0] < claims[1] < 1.5


def test_a_rotation_of_the_earlier_calibration_stays(earlier: Fit) -> None:
    turned = turns([[0.0, 0.0, np.pi / 2.0]])[0]
    known = replace(
        earlier,
        calibration=replace(earlier.calibration, matrix=turned @ earlier.calibration.matrix, rotation="composed"),
    )
    plain = flinders.refresh(recorded().samples, earlier).calibration
    fit = flinders.refresh(recorded().samples, known).calibration
    assert np.allclose(fit.matrix, turned @ plain.matrix)
    assert fit.rotation == "composed"


def test_another_place_has_another_strength() -> None:
    first = tumble(seed=3, sensor=TUMBLED_SENSOR, field_strength=50.0)
    earlier = flinders.fit(first.samples, field_strength=50.0)
    there = recorded(strength=40.0)
    fit = flinders.refresh(there.samples, earlier, site=Site(strength=40.0, inclination_deg=60.0))
    assert fit.verdict == "good"
    assert np.linalg.norm(fit.calibration.apply(there.samples.field), axis=1).mean() == pytest.approx(40.0, rel=0.01)
    elsewhere = flinders.refresh(there.samples, earlier)  # nobody says so: the size of the ellipsoid is another
    assert "soft-iron-changed" in {finding.code for finding in elsewhere.findings}


def test_a_calibration_without_uncertainty_counts_as_known_to_two_per_cent(earlier: Fit) -> None:
    imported = replace(earlier, covariance=np.zeros((9, 9)))
    fit = flinders.refresh(recorded().samples, imported)
    assert fit.heading_error_deg.worst > 1.5 * flinders.refresh(recorded().samples, earlier).heading_error_deg.worst
    assert np.all(np.abs(fit.calibration.offset - TUMBLED_SENSOR.offset - MOVED) < 4.0 * fit.offset_sigma)


def test_what_cannot_be_refreshed_is_refused(earlier: Fit) -> None:
    readings = recorded().samples
    level = flinders.fit(tumble(seed=1, motion="level", sensor=TUMBLED_SENSOR).samples, method="level")
    with pytest.raises(UsageError, match="level turn"):
        flinders.refresh(readings, level)
    with pytest.raises(UnitError, match="counts"):
        flinders.refresh(replace(readings, unit=Unit.of("counts")), earlier)
    with pytest.raises(AxesError, match="axes"):
        flinders.refresh(replace(readings, axes=flinders.Axes.of("x,-y,-z")), earlier)
    with pytest.raises(UsageError, match="summary"):
        flinders.refresh(flinders.Summary.of(readings), earlier)
    with pytest.raises(UsageError, match="share"):
        flinders.refresh(readings, earlier, soft_iron_sigma=2.0)
    with pytest.raises(flinders.FitError, match="within"):
        flinders.refresh(np.tile(readings.field[:1], (50, 1)), earlier)


def test_an_array_is_in_unit_and_axes_of_the_calibration() -> None:
    first = tumble(seed=3, sensor=TUMBLED_SENSOR).samples
    earlier = flinders.fit(first.field * 10.0, unit="mG", axes="x,-y,-z")
    fit = flinders.refresh(recorded().samples.field * 10.0, earlier)
    assert np.allclose(fit.calibration.offset * [1, -1, -1], TUMBLED_SENSOR.offset + MOVED, atol=1.0)
