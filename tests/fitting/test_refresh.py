"""A calibration that is refreshed: hard iron from seconds, soft iron of before, and the truth about both."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.sentences import assert_raises
from tests.worlds import TUMBLED_SENSOR

import flinders
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import AxesError, TooFewSamples, UnitError, UsageError
from flinders.fitting.fit_file import fit_from
from flinders.fitting.known_heading import PoseSigmas, refresh_at_headings
from flinders.fitting.result import Fit, Refused, document_of
from flinders.likelihood.site_field import Site
from flinders.simulate import tumble
from flinders.simulate.attitudes import attitudes_of, in_body_axes, north_and_down, turns

if TYPE_CHECKING:
    from collections.abc import Sequence

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
    assert np.all(np.abs(fit.calibration.offset - TUMBLED_SENSOR.offset - MOVED) < 4.0 * fit.claim.offset_sigma)
    assert fit.evidence.diagnosis.refreshed is not None
    assert np.allclose(
        fit.evidence.diagnosis.refreshed.offset_change, fit.calibration.offset - earlier.calibration.offset
    )


def test_a_fresh_fit_of_the_same_readings_is_refused() -> None:
    with assert_raises(flinders.FitError):
        flinders.fit(recorded().samples)


def test_a_good_verdict_rests_on_the_soft_iron(earlier: Fit) -> None:
    fit = flinders.refresh(recorded().samples, earlier)
    assert fit.judgement.conditions[0] == "same-soft-iron"
    assert fit_from(document_of(fit)).judgement.conditions == fit.judgement.conditions


def test_steel_is_noticed_and_allowed_for(earlier: Fit) -> None:
    made = recorded(steel=0.05)
    fit = flinders.refresh(made.samples, earlier)
    assert "soft-iron-changed" in {finding.code for finding in fit.findings}
    assert fit.verdict == "limited"
    error = fit.calibration.offset - made.sensor.offset
    assert np.all(np.abs(error) < 4.0 * fit.claim.offset_sigma)


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
    earlier = flinders.fit(first.samples, site=flinders.Site(strength=50.0))
    there = recorded(strength=40.0)
    fit = flinders.refresh(there.samples, earlier, site=Site(strength=40.0, inclination_deg=60.0))
    assert fit.verdict == "good"
    assert np.linalg.norm(fit.calibration.apply(there.samples.field), axis=1).mean() == pytest.approx(40.0, rel=0.01)
    elsewhere = flinders.refresh(there.samples, earlier)  # nobody says so: the size of the ellipsoid is another
    assert "soft-iron-changed" in {finding.code for finding in elsewhere.findings}


def test_a_calibration_without_uncertainty_counts_as_known_to_two_per_cent(earlier: Fit) -> None:
    imported = replace(earlier, claim=replace(earlier.claim, covariance=np.zeros((9, 9))))
    fit = flinders.refresh(recorded().samples, imported)
    assert fit.heading_error_deg.worst > 1.5 * flinders.refresh(recorded().samples, earlier).heading_error_deg.worst
    assert np.all(np.abs(fit.calibration.offset - TUMBLED_SENSOR.offset - MOVED) < 4.0 * fit.claim.offset_sigma)


def test_what_cannot_be_refreshed_is_refused(earlier: Fit) -> None:
    readings = recorded().samples
    level = flinders.fit(tumble(seed=1, motion="level", sensor=TUMBLED_SENSOR).samples, method="level")
    with assert_raises(UsageError):
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


@pytest.mark.parametrize(
    ("rows", "found", "among", "needed"), [(0, 0, 0, 20), (19, 19, 0, 20), (8, 8, 80, 10)], ids=["none", "few", "alike"]
)
def test_too_few_readings_are_counted_as_they_are(earlier: Fit, rows: int, found: int, among: int, needed: int) -> None:
    readings = recorded().samples
    some = readings[np.linspace(0, len(readings) - 1, rows).astype(int).repeat(10 if among else 1)]
    with pytest.raises(TooFewSamples) as caught:
        flinders.refresh(some, earlier)
    assert (caught.value.found, caught.value.among, caught.value.needed) == (found, among, needed)


def poses(headings: Sequence[float], *, pitch_deg: float = 0.0) -> list[Samples]:
    """Recordings of a vehicle after its battery was moved, at rest, with an accelerometer where it leans."""
    sensor = replace(TUMBLED_SENSOR, offset=TUMBLED_SENSOR.offset + MOVED)
    rng = np.random.default_rng(5)
    attitudes = attitudes_of(np.radians(headings), np.radians(pitch_deg), 0.0)
    fields, forces = (
        in_body_axes(attitudes, world) for world in (50.0 * north_and_down(60.0), np.array([0.0, 0.0, -9.81]))
    )
    return [
        Samples.of(
            sensor.read(np.tile(field, (100, 1)), rng),
            unit=Unit.of("uT"),
            acceleration=np.tile(force, (100, 1)) if pitch_deg else None,
        )
        for field, force in zip(fields, forces, strict=True)
    ]


@pytest.mark.parametrize(("headings", "verdict"), [([10.0], "limited"), ([10.0, 100.0, 190.0, 280.0], "good")])
def test_poses_at_known_headings_give_the_offset(earlier: Fit, headings: list[float], verdict: str) -> None:
    fit = refresh_at_headings(poses(headings), earlier, headings, site=flinders.Site(inclination_deg=60.0))
    assert fit.verdict == verdict
    assert np.all(np.abs(fit.calibration.offset - TUMBLED_SENSOR.offset - MOVED) < 3.0 * fit.claim.offset_sigma)
    assert fit.judgement.conditions == ("same-soft-iron", "uniform-field", "constant-iron")


def test_an_accelerometer_tells_how_a_pose_leans(earlier: Fit) -> None:
    leaning = poses([45.0], pitch_deg=20.0)
    felt = refresh_at_headings(leaning, earlier, [45.0], site=flinders.Site(inclination_deg=60.0))
    ignored = refresh_at_headings(
        [replace(one, acceleration=None) for one in leaning], earlier, [45.0], site=flinders.Site(inclination_deg=60.0)
    )
    errors = [np.linalg.norm(fit.calibration.offset - TUMBLED_SENSOR.offset - MOVED) for fit in (felt, ignored)]
    assert errors[0] < 0.2
    assert errors[1] > 10.0


def test_a_heading_that_was_typed_wrong_contradicts_the_others(earlier: Fit) -> None:
    with assert_raises(Refused) as refused:
        refresh_at_headings(
            poses([0.0, 90.0, 180.0, 270.0]),
            earlier,
            [0.0, 90.0, 180.0, 250.0],
            site=flinders.Site(inclination_deg=60.0),
        )
    assert refused.value.fit.findings[0].code == "poses-contradict"


def test_poses_that_tell_nothing_are_refused(earlier: Fit) -> None:
    pose = poses([0.0])
    with pytest.raises(UsageError, match="dip"):
        refresh_at_headings(pose, earlier, [0.0])
    with assert_raises(UsageError):
        refresh_at_headings(pose, earlier, [0.0, 90.0], site=flinders.Site(inclination_deg=60.0))
    with pytest.raises(UsageError, match="moved"):
        refresh_at_headings([recorded().samples], earlier, [0.0], site=flinders.Site(inclination_deg=60.0))
    with pytest.raises(UsageError, match="sigma"):
        PoseSigmas(heading_deg=0.0)


def test_an_array_is_in_unit_and_axes_of_the_calibration() -> None:
    first = tumble(seed=3, sensor=TUMBLED_SENSOR).samples
    earlier = flinders.fit(first.field * 10.0, unit="mG", axes="x,-y,-z")
    fit = flinders.refresh(recorded().samples.field * 10.0, earlier)
    assert np.allclose(fit.calibration.offset * [1, -1, -1], TUMBLED_SENSOR.offset + MOVED, atol=1.0)
