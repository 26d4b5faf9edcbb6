"""What the field of the site adds to a level turn: as much as is claimed, and up to which tilt it can be used."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks.level import Turned, recorded
from benchmarks.terms import tilted_error_deg
from click.testing import CliRunner, Result
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily
from tests.worlds import rms

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.core.samples import Samples
from flinders.estimators import Readings
from flinders.estimators.known_dip import update_by_site
from flinders.estimators.level import Level, is_level_turn
from flinders.fitting.result import Refused
from flinders.likelihood.site_field import Site
from flinders.native.engine import engine

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.fitting.result import Fit
    from flinders.simulate import Simulated

SITE = Site(50.0, 60.0, gain_sigma=0.05, inclination_sigma_deg=1.0)


def off(fit: Fit, truth: Simulated, tilt_deg: float) -> float:
    return tilted_error_deg((fit.calibration.offset, fit.calibration.matrix), truth, tilt_deg)


def refit(samples: Samples, **options: object) -> Fit:
    """As a level turn."""
    return flinders.fit(samples, method="level", **options)  # type: ignore[arg-type]


def calibrated(folder: Path, *words: str, name: str = "boat.csv") -> Result:
    """What the command makes of a level turn in Seattle, recorded without an accelerometer."""
    truth, _ = Turned().record(1, 300)
    header = "mx_uT,my_uT,mz_uT"
    np.savetxt(folder / "boat.csv", truth.samples.field, fmt="%.3f", delimiter=",", header=header, comments="")
    typed = ["calibrate", str(folder / name), "--at", "47.62,-122.35", "--json", *words]
    return CliRunner().invoke(main, typed, prog_name="flinders")


def test_headings_of_a_level_vehicle_are_those_of_the_ellipse() -> None:
    """Within a tenth of them on S7, whatever is known of the site and the mounting."""
    alone, at_site, mounted = [], [], []
    for number in range(8):
        truth, site = recorded("S7", number)
        alone.append(off(refit(truth.samples), truth, 0.0))
        at_site.append(off(refit(truth.samples, site=site), truth, 0.0))
        mounted.append(off(refit(truth.samples, site=replace(site, alignment_sigma_deg=2.0)), truth, 0.0))
    assert rms(at_site) < 1.02 * rms(alone)
    assert rms(mounted) < 1.1 * rms(alone)


@pytest.mark.nightly
@pytest.mark.parametrize("mounted_deg", [2.0, 5.0])
def test_a_stated_mounting_makes_tilts_usable_and_the_claim_true(mounted_deg: float) -> None:
    """Heading errors at 5° and 10° of tilt, of sensors that are mounted as well as was said."""
    ratios, limits, loose = [], [], []
    for number in range(10):
        truth, site = Turned(mounted_deg=mounted_deg).record(number, 300)
        fit = refit(truth.samples, site=replace(site, alignment_sigma_deg=mounted_deg))
        ratios += [off(fit, truth, tilt) / fit.claim.tilted_error(tilt).rms for tilt in (5.0, 10.0)]
        limits.append(fit.claim.attitude_limit_deg)
        loose.append(refit(truth.samples).claim.attitude_limit_deg)
    assert 0.6 < rms(ratios) < 1.25
    assert max(ratios) < 3.5
    assert np.median(limits) > 5.0 * np.median(loose)


def test_without_a_stated_mounting_the_prior_holds_what_lies_across() -> None:
    ratios = []
    for number in range(8):
        truth, site = Turned(mounted_deg=5.0).record(number, 300)
        fit = refit(truth.samples, site=site)
        ratios += [off(fit, truth, tilt) / fit.claim.tilted_error(tilt).rms for tilt in (5.0, 10.0)]
    assert rms(ratios) < 1.0
    assert max(ratios) < 2.0


@pytest.mark.nightly
def test_the_third_offset_is_found_as_well_as_is_claimed() -> None:
    weighed = []
    for number in range(10):
        truth, site = Turned(mounted_deg=2.0).record(number, 300)
        fit = refit(truth.samples, site=replace(site, alignment_sigma_deg=2.0))
        weighed.append(float((fit.calibration.offset[2] - truth.sensor.offset[2]) / fit.claim.offset_sigma[2]))
        assert fit.claim.offset_sigma[2] < 10.0 < refit(truth.samples).claim.offset_sigma[2]
    assert 0.5 < rms(weighed) < 2.0


@pytest.mark.parametrize(
    "turned",
    daily([Turned(arc_deg=180.0), Turned(wobble_deg=1.0), Turned(slope_deg=5.0), Turned(slope_deg=10.0)], 2),
    ids=["half a turn", "wobble", "slope 5°", "slope 10°"],
)
def test_no_turn_is_claimed_better_than_it_is(turned: Turned) -> None:
    """Partial turns, swaying vehicles and slopes that an accelerometer shows."""
    ratios = []
    for number in range(8):
        truth, site = replace(turned, mounted_deg=2.0).record(number, 300)
        fit = refit(truth.samples, site=replace(site, alignment_sigma_deg=2.0))
        ratios += [off(fit, truth, tilt) / fit.claim.tilted_error(tilt).rms for tilt in (0.0, 2.0, 5.0, 10.0)]
    assert rms(ratios) < 1.3
    assert max(ratios) < 4.0


def test_a_slope_widens_the_claim_without_a_site_too() -> None:
    (flat, _), (steep, _) = (Turned(slope_deg=slope).record(1, 300) for slope in (0.0, 5.0))
    claims = [flinders.fit(truth.samples).heading_error_deg.worst for truth in (flat, steep)]
    assert claims[0] < 0.3
    assert claims[1] > 1.0
    assert claims[1] == pytest.approx(refit(steep.samples).heading_error_deg.worst, rel=1e-9)


def test_a_slope_counts_as_a_tilt_of_the_vehicle() -> None:
    claims = []
    for slope in (0.0, 2.0, 5.0):
        truth, site = Turned(slope_deg=slope).record(1, 300)
        claims.append(refit(truth.samples, site=site).heading_error_deg.worst)
    level, two, five = claims
    assert level < 0.3
    assert two == pytest.approx(2.0 / 5.0 * five, rel=0.3)


@pytest.mark.parametrize("slope", [0.0, 5.0])
def test_what_stays_in_the_body_is_a_bias_of_the_accelerometer_and_no_slope(slope: float) -> None:
    """0.3 m/s² is 1.8° of tilt, and stays where it is while the vehicle turns; a slope goes round."""
    truth, site = Turned(slope_deg=slope).record(1, 300)
    assert truth.samples.acceleration is not None
    biased = replace(truth.samples, acceleration=truth.samples.acceleration + np.array([0.3, -0.2, 0.1]))
    claims = [refit(samples, site=site).heading_error_deg.worst for samples in (truth.samples, biased)]
    assert claims[1] == pytest.approx(claims[0], rel=0.05)


@pytest.mark.parametrize("aiding", [("dip",), ("rate",), ("rate", "dip"), "auto"])
def test_aids_of_a_level_turn_are_left_out_and_named(aiding: str | tuple[str, ...]) -> None:
    truth, site = Turned(mounted_deg=2.0).record(2, 300)
    fit = flinders.fit(truth.samples, aiding=aiding, site=site)
    assert fit.evidence.method == "level"
    assert fit.evidence.aiding is not None
    assert all(not aid.is_used and "one plane" in aid.reason for aid in fit.evidence.aiding.sensors)
    npt.assert_array_equal(fit.calibration.matrix, flinders.fit(truth.samples, site=site).calibration.matrix)


def test_a_vehicle_that_sways_enough_is_no_level_turn() -> None:
    level, _ = Turned().record(1, 300)
    swayed, _ = Turned(wobble_deg=3.0).record(1, 300)
    assert is_level_turn(level.samples.field)
    assert not is_level_turn(swayed.samples.field)


def test_a_turn_about_another_axis_asks_for_that_axis() -> None:
    """Across x: neither the site nor an accelerometer can say anything."""
    truth, site = Turned().record(1, 300)
    samples = truth.samples
    turned = Samples.of(samples.field[:, [2, 0, 1]], unit="uT", acceleration=samples.acceleration)
    with assert_raises(Refused):
        flinders.fit(turned, aiding=("dip",), site=site)


def test_a_sensor_upside_down_is_not_placed_by_the_dip() -> None:
    """Its z points up, as the accelerometer shows: the dip says nothing of it."""
    truth, site = Turned().record(1, 300)
    over = [1.0, -1.0, -1.0]
    assert truth.samples.acceleration is not None
    turned = replace(truth.samples, field=truth.samples.field * over, acceleration=truth.samples.acceleration * over)
    assert refit(truth.samples, site=site).claim.offset_sigma[2] < 15.0
    assert refit(turned, site=site).claim.offset_sigma[2] > 25.0


def test_what_is_taken_for_granted_of_z_is_said() -> None:
    """That nobody knows which way it points, or that the site was left out where an accelerometer shows it up."""
    truth, site = Turned().record(1, 300)
    over = [1.0, -1.0, -1.0]
    assert truth.samples.acceleration is not None
    turned = replace(truth.samples, field=truth.samples.field * over, acceleration=truth.samples.acceleration * over)
    unseen = replace(turned, acceleration=None)
    taken, left_out, neither = "with z down, and", "site was not used", "nothing shows whether"
    for samples, at, words, z_down in (
        (unseen, site, {neither}, None),
        (unseen, replace(site, z_down=True), {taken}, True),
        (unseen, replace(site, inclination_deg=None), set(), True),
        (turned, replace(site, z_down=True), {left_out}, False),
        (turned, replace(site, inclination_deg=None), set(), True),
        (turned, None, set(), True),
        (truth.samples, site, {taken}, True),
    ):
        fit = refit(samples, site=at)
        (advice,) = [finding.advice for finding in fit.findings if finding.code == "level-plane"]
        assert {each for each in (taken, left_out, neither) if each in advice} == words
        assert fit.evidence.z_down is z_down


OVER = np.array([1.0, -1.0, -1.0])


@pytest.mark.nightly
@pytest.mark.parametrize("mounted_deg", [None, 2.0])
def test_where_nothing_shows_which_way_z_points_the_claim_is_true_of_both(mounted_deg: float | None) -> None:
    """Ten sensors, each with z down and with z up: rms of true over claimed 0.95 level, 0.98 to 1.05 at a tilt."""
    ratios = []
    for number in range(10):
        truth, site = Turned(mounted_deg=2.0).record(number, 300)
        for turned in (np.ones(3), OVER):
            samples = replace(truth.samples, field=truth.samples.field * turned, acceleration=None)
            fit = refit(samples, site=replace(site, alignment_sigma_deg=mounted_deg))
            over = np.diag(turned)
            corrected = over @ fit.calibration.offset, over @ fit.calibration.matrix @ over
            tilts = (0.0, 2.0, 5.0, 10.0)
            ratios.append(
                [tilted_error_deg(corrected, truth, tilt) / fit.claim.tilted_error(tilt).rms for tilt in tilts]
            )
    npt.assert_allclose(np.sqrt(np.mean(np.square(ratios), axis=0)), 1.0, atol=0.2)
    assert np.max(ratios) < 2.0


def test_a_level_heading_does_not_care_which_way_z_points() -> None:
    truth, site = Turned(mounted_deg=2.0).record(1, 300)
    samples = replace(truth.samples, acceleration=None)
    for mounted_deg in (None, 2.0):
        either, down = (
            refit(samples, site=replace(site, z_down=said, alignment_sigma_deg=mounted_deg)) for said in (False, True)
        )
        npt.assert_allclose(either.heading_error_deg.worst, down.heading_error_deg.worst, rtol=1e-6)
        npt.assert_array_equal(either.calibration.matrix, down.calibration.matrix)
        npt.assert_array_equal(either.calibration.offset, down.calibration.offset)
        assert either.claim.offset_sigma[2] > 50.0 > 3.0 * down.claim.offset_sigma[2]


def test_axes_that_were_mapped_and_those_of_a_vehicle_have_z_down() -> None:
    truth, site = Turned().record(1, 300)
    recorded_axes = Samples.of(truth.samples.field * OVER, unit="uT")
    mapped = Samples.of(truth.samples.field * OVER, unit="uT", axes="x,-y,-z")
    for samples, z_down in (
        (recorded_axes, None), (mapped, True), (replace(recorded_axes, frame="vehicle"), True)
    ):  # fmt: skip
        assert refit(samples, site=site).evidence.z_down is z_down


@pytest.mark.parametrize(
    ("day", "dip_deg"),
    [("1985-06-01", 69.82), ("2009.9", 69.29), ("2012-06-01", 69.23), ("2019.9", 69.0), ("2026-11-21", 68.75)],
)
def test_the_dip_is_that_of_the_model_of_the_day(day: str, dip_deg: float, tmp_path: Path) -> None:
    ended = calibrated(tmp_path, "--date", day)
    assert json.loads(ended.stdout)["heading_error_deg"]["dip_deg"] == pytest.approx(dip_deg, abs=0.02)


@pytest.mark.parametrize("day", ["1890-01-01", "2040-01-01"])
def test_a_day_that_no_model_covers_is_refused_before_anything_is_read(day: str, tmp_path: Path) -> None:
    ended = calibrated(tmp_path, "--date", day, name="no such file.csv")
    assert ended.exit_code == 2
    assert_sentences(ended.stderr)


def test_axes_that_were_typed_say_that_z_is_down(tmp_path: Path) -> None:
    limits = []
    for typed in ((), ("--axes", "x,y,z")):
        ended = calibrated(tmp_path, "--date", "2026-11-21", *typed)
        assert ended.exit_code == 3, ended.stderr
        (finding,) = [each for each in json.loads(ended.stdout)["findings"] if each["code"] == "level-plane"]
        assert ("nothing shows whether" in finding["advice"]) == (not typed)
        limits.append(finding["number"])
    assert limits[1] > 3.0 * limits[0]


def test_a_strength_in_another_unit_is_left_out_and_that_is_found() -> None:
    truth, site = Turned().record(1, 300)
    counts = Samples.of(truth.samples.field * 10.0)
    fit = refit(counts, site=site)
    assert not fit.calibration.field_strength_known
    other = refit(counts, site=replace(site, strength=None))
    npt.assert_array_equal(fit.calibration.offset, other.calibration.offset)
    (finding,) = [each for each in fit.findings if each.code == "strength-differs"]
    assert finding.severity == "note"
    assert finding.number > finding.limit == 4.0
    assert finding.values["site_strength"] == site.strength
    assert finding.values["strength_found"] == pytest.approx(500.0, rel=0.3)
    assert {*codes(other)} == {*codes(fit)} - {"strength-differs"}


def test_a_strength_of_the_site_that_readings_of_all_directions_contradict_is_left_out() -> None:
    tumble = simulate.tumble(seed=2, n=300, motion="uniform").samples
    plain, beside, near = (flinders.fit(tumble, site=at) for at in (None, Site(35.0, gain_sigma=0.05), SITE))
    (finding,) = [each for each in beside.findings if each.code == "strength-differs"]
    sigmas = (plain.calibration.ellipsoid.shape.trace() / 3.0 - 35.0) / (0.05 * 35.0)
    assert finding.number == pytest.approx(sigmas, rel=1e-3)
    assert "strength-differs" not in codes(plain) + codes(near)
    npt.assert_allclose(beside.calibration.offset, plain.calibration.offset, rtol=1e-9)
    assert near.calibration.field_strength == SITE.strength


def codes(fit: Fit) -> list[str]:
    return [finding.code for finding in fit.findings]


def test_the_strength_is_that_of_corrected_readings() -> None:
    truth, site = Turned().record(1, 300)
    fit = refit(truth.samples, site=site)
    assert fit.calibration.field_strength == site.strength
    assert fit.calibration.field_strength_known


def test_a_dip_that_is_given_goes_before_that_of_the_site() -> None:
    truth, site = Turned().record(1, 300)
    assert flinders.fit(truth.samples, method="level", site=site).claim.dip_deg == site.inclination_deg
    fit = refit(truth.samples, site=Site.merge_stated(site, inclination_deg=40.0))
    assert fit.claim.dip_deg == 40.0
    assert fit.claim.offset_sigma[2] > 25.0


def test_the_finding_says_how_fast_it_degrades_and_what_would_help() -> None:
    truth, site = Turned(mounted_deg=2.0).record(3, 300)
    alone, loose = refit(truth.samples), refit(truth.samples, site=site)
    known = refit(truth.samples, site=replace(site, alignment_sigma_deg=2.0))
    for fit in (alone, loose, known):
        (finding,) = [finding for finding in fit.findings if finding.code == "level-plane"]
        assert_sentences(finding.advice)
        assert finding.number == fit.claim.attitude_limit_deg
    assert alone.claim.per_degree_of_tilt > 3.0 * loose.claim.per_degree_of_tilt > 6.0 * known.claim.per_degree_of_tilt
    assert "mounting" in loose.findings[0].advice
    assert "mounting" not in known.findings[0].advice + alone.findings[0].advice


def test_heights_astray_are_left_out() -> None:
    rng = np.random.default_rng(1)
    turn = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    field = np.column_stack([25.0 * np.cos(turn), 25.0 * np.sin(turn), 30.0 + 2.0 * np.cos(turn)])
    field += rng.normal(0.0, 0.3, field.shape)
    struck = field.copy()
    struck[::40, 2] += 40.0
    found = engine().fit_plane(struck, np.zeros(2), 0.3)
    sigmas = np.sqrt(found["covariance"][::4])
    assert abs(found["height"] - 30.0) < 4.0 * sigmas[0]
    assert np.all(np.abs(found["slope"] - [0.08, 0.0]) < 4.0 * sigmas[1:])


def test_a_plane_without_noise_is_found_exactly() -> None:
    turn = np.radians(np.arange(0.0, 360.0, 10.0))
    plane = np.stack([np.cos(turn), np.sin(turn), 5.0 + 0.2 * np.cos(turn)], axis=1)
    found = engine().fit_plane(plane, np.zeros(2), 0.0)
    npt.assert_allclose([found["height"], *found["slope"]], [5.0, 0.2, 0.0], atol=1e-12)


def test_without_noise_the_whole_ellipsoid_is_found() -> None:
    """Where the mounting is perfect and the strength exact, but for the degree by which a floor may slope."""
    truth, _ = Turned().record(5, 300)
    sensor = replace(truth.sensor, noise=0.0, matrix=3.0 * truth.sensor.matrix / np.trace(truth.sensor.matrix))
    raw = sensor.read(50.0 * truth.directions, np.random.default_rng(0))
    readings = Readings.of(Samples.of(raw, unit="uT"))
    site = replace(SITE, gain_sigma=1e-6, inclination_sigma_deg=1e-6)
    alone = Level(dip_deg=60.0).estimate(readings)
    found = update_by_site(alone, readings, site, dip_deg=60.0, alignment_sigma_deg=1e-4)
    npt.assert_allclose(found.ellipsoid.centre, sensor.offset, atol=0.2)
    npt.assert_allclose(found.ellipsoid.shape, 50.0 * np.asarray(sensor.matrix), atol=0.2)
    assert np.abs(alone.ellipsoid.centre - sensor.offset).max() > 5.0
