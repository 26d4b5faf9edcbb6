"""Min/max: the published recipes to the digits, an honest claim beside them, and six typed numbers."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.testing as npt
import pytest
from click.testing import CliRunner
from tests.sentences import assert_raises, assert_sentences
from tests.trials import nightly
from tests.worlds import HARD_IRON, SOFT_IRON, method_with

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.cli._program import FIT_KEYS
from flinders.core.axes import Axes
from flinders.core.joining import Joined
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import FitError, NeedsSamples, NotAnEllipsoid, TooFewSamples, UsageError
from flinders.estimators import Readings
from flinders.estimators.minmax import MinMax
from flinders.fitting.axis_extremes import from_extremes
from flinders.fitting.fit_file import load
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.heading.error_propagation import level_error, level_turn
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from pathlib import Path

    from click.testing import Result
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.estimators.minmax import Variant

IRON: Final = {
    "none": np.eye(3),
    "gains": np.diag([0.9, 1.0, 1.2]),
    "skew": SOFT_IRON,
}
CAR: Final = (-157.0, 98.0, -123.0, 124.0, -109.0, 101.0)


def recorded(iron: str, motion: str, n: int, seed: int, noise: float = 0.5) -> Floats:
    sensor = simulate.Sensor(IRON[iron], HARD_IRON, noise)
    return simulate.tumble(seed=seed, motion=motion, n=n, sensor=sensor).samples.field


def calibrate(*words: str) -> Result:
    return CliRunner().invoke(main, ["calibrate", *words])


# The recipe.


@pytest.mark.parametrize("variant", ["mean", "largest", "full-range"])
def test_each_variant_is_its_recipe_written_out(variant: str) -> None:
    """`mean` as the blog's avg_rad / rad, `largest` as Xsca, `full-range` as (x − min) / (max − min) − 0.5."""
    field = recorded("gains", "hand", 3000, 1)
    low, high = field.min(axis=0), field.max(axis=0)
    middle = (low + high) / 2
    half = (high - low) / 2
    wanted = {
        "mean": (field - middle) * (half.sum() / 3 / half),
        "largest": (field - middle) * (half.max() / half),
        "full-range": (field - low) / (high - low) - 0.5,
    }[variant]
    fit = flinders.fit(field, target_deg=90.0, method=method_with("minmax", variant=variant))
    npt.assert_allclose(fit.calibration.apply(field), wanted, rtol=0, atol=1e-10)
    assert fit.calibration.field_strength == pytest.approx(np.abs(wanted).max())
    assert not fit.calibration.field_strength_known


def test_the_variants_differ_in_scale_alone() -> None:
    field = recorded("gains", "hand", 3000, 1)
    fits = [
        flinders.fit(field, method=flinders.estimators.MinMax(variant=v)) for v in ("mean", "largest", "full-range")
    ]
    for fit in fits[1:]:
        npt.assert_allclose(fit.claim.covariance, fits[0].claim.covariance)
        assert fit.heading_error_deg == fits[0].heading_error_deg
        assert [finding.code for finding in fit.findings] == [finding.code for finding in fits[0].findings]


def test_sensor_signs_are_the_axes_mapping(tmp_path: Path) -> None:
    """The MinIMU-9: c = (s·x − s·min) / (max − min) − s·½, each sign beside its axis."""
    field = recorded("gains", "hand", 2000, 2)
    low, high, signs = field.min(axis=0), field.max(axis=0), np.array([1.0, -1.0, -1.0])
    wanted = (signs * field - signs * low) / (high - low) - signs * 0.5
    path = tmp_path / "raw.csv"
    np.savetxt(path, field, delimiter=",", fmt="%.17g")
    words = ("--method", "minmax", "--option", "variant=full-range", "--axes", "x,-y,-z", "--target", "20")
    ended = calibrate(str(path), *words, "-o", str(tmp_path / "c.json"))
    assert ended.exit_code in {0, 3}, ended.output
    found = flinders.Calibration.load(tmp_path / "c.json")
    npt.assert_allclose(found.apply(Axes.of("x,-y,-z").apply(field)), wanted, atol=1e-9)


def test_a_known_field_strength_takes_the_place_of_the_variants() -> None:
    field = recorded("gains", "hand", 3000, 1)
    fit = flinders.fit(
        field, site=flinders.Site(strength=50.0), method=flinders.estimators.MinMax(variant="full-range")
    )
    assert (fit.calibration.field_strength, fit.calibration.field_strength_known) == (50.0, True)


def test_an_axis_whose_readings_are_all_negative_keeps_its_maximum() -> None:
    """Where the published script, with maxima that start at zero, finds half the offset."""
    field = recorded("none", "uniform", 2000, 3) - [300.0, 0.0, 0.0]
    fit = flinders.fit(field, method="minmax")
    npt.assert_allclose(fit.calibration.offset, HARD_IRON - [300.0, 0.0, 0.0], atol=1.5)
    published = (min(0.0, field[:, 0].min()) + max(0.0, field[:, 0].max())) / 2
    assert abs(published - (HARD_IRON[0] - 300.0)) > 100.0


def test_sums_are_enough_and_the_order_does_not_matter() -> None:
    field = recorded("gains", "hand", 1000, 4)
    halves = Summary.of(field[:300]) + Summary.of(field[300:])
    one, other = (MinMax().estimate(Readings.of(source)) for source in (field, halves))
    assert other.ellipsoid.isclose(one.ellipsoid, rtol=1e-14)


@pytest.mark.parametrize("options", [{"variant": "median"}, {"trim": "yes"}, {"variant": 3}])
def test_options_that_mean_nothing_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=next(iter(options))):
        MinMax(**options)


# The claim.


@pytest.mark.parametrize("iron", sorted(IRON))
@pytest.mark.parametrize(
    ("motion", "n"),
    [
        ("uniform", 20), nightly("uniform", 500), nightly("uniform", 5000), nightly("hemisphere", 500),
        nightly("tilted", 1000), ("hand", 3000),
    ],
)  # fmt: skip
def test_the_claim_covers_the_error(iron: str, motion: str, n: int) -> None:
    """Of the offset, and of the heading: within twice the claim always, within once in most cases."""
    offsets, headings = [], []
    for seed in range(12):
        try:
            fit = flinders.fit(recorded(iron, motion, n, seed), method="minmax", target_deg=100.0)
        except FitError:
            continue
        off = np.linalg.norm(fit.calibration.offset - HARD_IRON)
        offsets.append(off / np.sqrt(np.trace(fit.claim.covariance[:3, :3])))
        headings.append(heading_rms(fit, IRON[iron]) / fit.heading_error_deg.rms)
    assert len(offsets) >= 8
    assert max(offsets) < 2.0
    assert np.median(offsets) < 1.1
    assert max(headings) < 2.0
    assert np.median(headings) < 1.0


def heading_rms(fit: flinders.Fit, iron: Floats) -> float:
    """Error in degrees of the heading of a level vehicle at dip 60°, the mean removed."""
    heading, directions = level_turn(60.0)
    raw = HARD_IRON[:, np.newaxis] + 50.0 * iron @ directions
    x, y, _ = fit.calibration.matrix @ (raw - fit.calibration.offset[:, np.newaxis])
    error = np.angle(np.exp(1j * (np.arctan2(-y, x) - heading)))
    return float(np.degrees(np.std(error)))


def test_half_a_sphere_is_never_good() -> None:
    """The end that was not reached is where nothing was read: 25 µT of offset."""
    for seed in range(5):
        fit = flinders.fit(recorded("none", "hemisphere", 500, seed), method="minmax", target_deg=100.0)
        assert np.linalg.norm(fit.calibration.offset - HARD_IRON) > 20.0
        assert fit.claim.offset_sigma[2] > 20.0
        assert fit.verdict == "limited"


def test_soft_iron_across_the_axes_is_a_bias_that_is_told() -> None:
    fit = flinders.fit(recorded("skew", "uniform", 2000, 1), method="minmax", target_deg=20.0)
    assert fit.claim.bias_deg > 3.0
    assert "bias" in [finding.code for finding in fit.findings]


def test_seven_readings_are_enough_for_a_number_and_for_nothing_else() -> None:
    few = recorded("none", "uniform", 7, 1)
    estimate = MinMax().estimate(Readings.of(few))
    assert np.sqrt(np.diag(estimate.covariance)[:3]).min() > 0.1 * estimate.ellipsoid.radius
    with pytest.raises(FitError):
        flinders.fit(few, method="minmax")
    with pytest.raises(TooFewSamples):
        flinders.fit(few[:6], method="minmax")


def test_an_axis_that_hardly_changes_beside_the_others_gives_no_ellipsoid() -> None:
    field = recorded("none", "uniform", 100, 1)
    field[:, 2] = 0.0
    field[0, 2] = 5e-324
    with pytest.raises(NotAnEllipsoid):
        MinMax().estimate(Readings.of(field))


# Trimming.


def spoilt() -> Floats:
    """A tumble; before it the sensor rested beside a magnet, and a few bits were lost."""
    clean = recorded("gains", "hand", 2000, 5)
    rng = np.random.default_rng(5)
    clump = np.array([180.0, 60.0, 20.0]) + 0.5 * rng.standard_normal((250, 3))
    field = np.concatenate([clump, clean])
    field[[700, 1200, 1900], [0, 1, 2]] += [400.0, -350.0, 500.0]
    return field


def test_trimming_takes_off_what_spoils_the_extremes() -> None:
    plain, trimmed = (MinMax(trim=trim).estimate(Readings.of(spoilt())) for trim in (False, True))
    assert np.abs(plain.ellipsoid.centre - HARD_IRON).min() > 20.0
    npt.assert_allclose(trimmed.ellipsoid.centre, HARD_IRON, atol=1.5)
    npt.assert_allclose(trimmed.ellipsoid.shape, 50.0 * IRON["gains"], atol=3.0)
    assert trimmed.used + sum(outlier.readings for outlier in trimmed.outliers) == len(spoilt())
    assert sum(outlier.readings for outlier in trimmed.outliers) >= 253


def test_trimming_tells_what_it_left_out() -> None:
    fit = flinders.fit(spoilt(), target_deg=5.0, method=flinders.estimators.MinMax(trim=True))
    assert "outliers" in [finding.code for finding in fit.findings]
    assert fit.evidence.samples <= 2000 - 3
    assert np.all(np.abs(fit.calibration.offset - HARD_IRON) < 3 * fit.claim.offset_sigma)


def test_a_clump_on_the_surface_changes_no_extreme() -> None:
    clean = recorded("gains", "hand", 2000, 6)
    rested = np.concatenate([clean, np.repeat(clean[:1], 3000, axis=0)])
    one, other = (MinMax().estimate(Readings.of(field)).ellipsoid for field in (clean, rested))
    assert other.isclose(one, rtol=1e-14)


def test_trimming_clean_readings_changes_next_to_nothing() -> None:
    field = recorded("gains", "uniform", 2000, 7)
    plain, trimmed = (MinMax(trim=trim).estimate(Readings.of(field)).ellipsoid for trim in (False, True))
    npt.assert_allclose(trimmed.centre, plain.centre, atol=0.5)


def test_trimming_needs_readings_and_enough_of_them() -> None:
    field = recorded("gains", "uniform", 100, 8)
    with assert_raises(NeedsSamples):
        flinders.fit(Summary.of(field), method=flinders.estimators.MinMax(trim=True))
    with pytest.raises(TooFewSamples) as caught:
        flinders.fit(field[:11], method=flinders.estimators.MinMax(trim=True))
    assert (caught.value.found, caught.value.needed) == (11, 35)


def test_two_recordings_are_trimmed_as_one() -> None:
    field = spoilt()
    both = Joined((Samples.of(field[:1100]), Samples.of(field[1100:])))
    fit = flinders.fit(both, target_deg=5.0, method=flinders.estimators.MinMax(trim=True))
    npt.assert_allclose(fit.calibration.offset, HARD_IRON, atol=1.5)


# Six typed numbers.


def test_typed_extremes_are_those_of_a_recording() -> None:
    field = recorded("gains", "hand", 3000, 1)
    numbers = np.stack([field.min(axis=0), field.max(axis=0)], axis=1).ravel()
    variants: list[Variant] = ["mean", "largest", "full-range"]
    for variant in variants:
        fit = flinders.fit(field, target_deg=90.0, method=method_with("minmax", variant=variant))
        typed = from_extremes(numbers, variant=variant)
        npt.assert_allclose(typed.calibration.matrix, fit.calibration.matrix)
        npt.assert_allclose(typed.calibration.offset, fit.calibration.offset)


def test_typed_extremes_claim_nothing_and_are_never_good(tmp_path: Path) -> None:
    """Also where the three half-ranges are alike, which a short turn can make."""
    for numbers in (CAR, (-50, 50, -50, 50, -50, 50)):
        found = from_extremes(numbers, field_strength=50.0, unit=Unit.of("uT"))
        assert found.verdict == "limited"
        assert found.findings[0].code == "typed-extremes"
        fields = found.as_dict()
        assert (fields["heading_error_deg"], fields["noise"], fields["covariance"]) == (None, None, None)
        found.save(tmp_path / "typed.json", force=True)
        loaded = load(tmp_path / "typed.json")
        assert (loaded.claim.states_uncertainty, loaded.evidence.samples, loaded.verdict) == (False, 0, "limited")
    assert found.findings[0].number == 0.0


def test_what_a_short_turn_would_cost_is_what_it_costs() -> None:
    """All axes alike, y turned to one end only as far as 100 of 120: the true offset is off by half of what lacks."""
    found = from_extremes([-120, 120, -120, 100, -120, 120])
    finding = found.findings[0]
    covariance = np.zeros((9, 9))
    covariance[1, 1] = 10.0**2
    sphere = Ellipsoid(np.zeros(3), 120.0 * np.eye(3))
    assert finding.number == pytest.approx(level_error(sphere, covariance, dip_deg=60.0).worst)
    assert found.calibration.offset[1] == -10.0
    assert_sentences(finding.advice)


def test_units_and_axes_are_those_of_a_recording() -> None:
    found = from_extremes(CAR, unit=Unit.of("mG"), axes=Axes.of("y,-x,z"))
    assert found.calibration.unit == "uT"
    npt.assert_allclose(found.calibration.offset, [0.05, 2.95, -0.4])
    npt.assert_allclose((found.low, found.high), [[-12.3, -9.8, -10.9], [12.4, 15.7, 10.1]])


@pytest.mark.parametrize(
    "numbers",
    [
        [1, 2, 3, 4],
        [[1, 2], [3, 4], [5, 6]],
        [2, 1, 3, 4, 5, 6],
        [1, 2, 3, 3, 5, 6],
        [-1e300, 1e300, 3, 4, 5, 6],
        [0, 1e-300, 3, 4, 5, 6],
        [0, 1e-9, -3, 4000, -5000, 6],
    ],
)
def test_numbers_that_are_no_extremes_are_refused(numbers: ArrayLike) -> None:
    with assert_raises(UsageError):
        from_extremes(numbers)


def test_options_of_typed_extremes_are_checked() -> None:
    with pytest.raises(UsageError, match="variant"):
        from_extremes(CAR, variant="median")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="target"):
        from_extremes(CAR, target_deg=0.0)


# On the command line.


def test_minmax_prints_the_cars_table_and_writes_a_file(tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    ended = calibrate("--minmax", ",".join(map(str, CAR)), "--option", "variant=largest", "-o", str(path))
    assert ended.exit_code == 3
    for row in ("x   -157    98    -29.5        127.5    1.00", "z   -109   101     -4.0        105.0    1.21"):
        assert row in ended.output
    npt.assert_allclose(flinders.Calibration.load(path).offset, [-29.5, 0.5, -4.0])
    piped = calibrate("--minmax", ",".join(map(str, CAR)), "-o", "-")
    assert json.loads(piped.stdout)["calibration"]["offset"] == [-29.5, 0.5, -4.0]
    assert "[scale-unknown]" in piped.stderr


def test_minmax_as_json_has_the_keys_of_a_fit() -> None:
    ended = calibrate("--minmax", ",".join(map(str, CAR)), "--json")
    fields = json.loads(ended.stdout)
    assert set(FIT_KEYS) <= set(fields)
    assert fields["extremes"]["low"] == [-157.0, -123.0, -109.0]


@pytest.mark.parametrize(
    "words",
    [
        ["--minmax", "1,2,3"],
        ["--minmax", "1,2,a,4,5,6"],
        ["--minmax", "1,2,3,4,5,6", "tumble.csv"],
        ["--minmax", "1,2,3,4,5,6", "--method", "level"],
        ["--minmax", "1,2,3,4,5,6", "--robust"],
        ["--minmax", "1,2,3,4,5,6", "--report-text", "a", "--columns", "x,y,z"],
        ["--minmax", "1,2,3,4,5,6", "--option", "trim=yes"],
        ["--minmax", "1,2,3,4,5,6", "-o", "-", "--json"],
        [],
        ["a.csv", "--option", "variant=largest"],
        ["a.csv", "--option", "prior"],
        ["a.csv", "--option", "prior=much"],
        ["a.csv", "--option", "robust=perhaps"],
        ["a.csv", "--option", "robust=yes", "--option", "robust=no"],
        ["a.csv", "--robust", "--option", "robust=no"],
        ["a.csv", "--method", "consistent", "--option", "prior=1"],
        ["a.csv", "--method", "minmax", "--option", "variant=median"],
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_refused_before_anything_is_read(words: list[str]) -> None:
    ended = calibrate(*words)
    assert ended.exit_code == 2
    assert_sentences(ended.output)


@pytest.mark.parametrize(
    ("method", "words", "options"),
    [
        ("minmax", ["variant=largest", "trim=yes"], {"variant": "largest", "trim": True}),
        ("algebraic", ["normalisation=nxp"], {"normalisation": "nxp"}),
        ("likelihood", ["prior=none", "bias-correction=no"], {"prior": None, "bias_correction": False}),
    ],
)
def test_options_of_a_method_reach_it(method: str, words: list[str], options: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "raw.csv"
    np.savetxt(path, recorded("gains", "hand", 500, 1), delimiter=",", fmt="%.6f")
    given = [part for word in words for part in ("--option", word)]
    ended = calibrate(str(path), "--method", method, *given, "--target", "30", "--json")
    fit = flinders.fit(flinders.read(path), method=method_with(method, **options), target_deg=30.0)
    npt.assert_allclose(json.loads(ended.stdout)["calibration"]["matrix"], fit.calibration.matrix)


def test_the_list_of_methods_names_every_option_with_its_values() -> None:
    listed = json.loads(CliRunner().invoke(main, ["methods", "--json"]).stdout)
    assert listed["minmax"]["options"] == {"variant": ["mean", "largest", "full-range"], "trim": ["no", "yes"]}
    assert listed["level"]["options"] == {"prior": ["0.3"]}
    assert listed["consistent"]["options"] == {}
    shown = " ".join(CliRunner().invoke(main, ["methods"]).stdout.split())
    assert_sentences(shown, about="largest")
