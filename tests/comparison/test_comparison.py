"""Two calibrations of one simulated sensor: they agree as often as chance says, and a sensor that changed is seen."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises
from tests.worlds import RANDOM_SENSOR

import flinders
from flinders import simulate
from flinders.comparison.comparison import MAX_P_VALUE, LengthSums, compare
from flinders.comparison.pairs import EllipsoidPairs, Pairs
from flinders.core.axes import Axes
from flinders.core.calibration import Calibration
from flinders.core.calibration_file import PARAMETERS, Fitted
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import ArrayError, AxesError, DocumentError, UnitError, UsageError
from flinders.fitting.aiding import Aiding
from flinders.fitting.fit_file import fit_from, load
from flinders.fitting.result import Fit, bare_fit, with_calibration, with_name
from flinders.summary.pooling import p_value_of
from flinders.targets._mounting import euler

if TYPE_CHECKING:
    from pathlib import Path

    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.comparison.comparison import Comparison


@cache
def judged(seed: int, *, n: int = 400, field_strength: float | None = None, moved: float = 0.0) -> Fit:
    """Calibrate a recording of the sensor; its offset moved by so many µT along x."""
    sensor = replace(RANDOM_SENSOR, offset=RANDOM_SENSOR.offset + np.array([moved, 0.0, 0.0]))
    recording = simulate.tumble(seed=seed, motion="uniform", n=n, sensor=sensor)
    return flinders.fit(recording.samples, site=flinders.Site(strength=field_strength))


def changed(one: Fit, **changes: Any) -> Fit:
    return with_calibration(one, replace(one.calibration, **changes))


def claiming(one: Fit, covariance: Floats) -> Fit:
    return replace(one, claim=replace(one.claim, covariance=covariance))


# what chance does


@pytest.mark.parametrize("field_strength", [None, 50.0])
def test_chance_explains_the_difference_as_often_as_it_says(field_strength: float | None, trials: Choose) -> None:
    claim = trials(100, 25)
    pairs = [
        compare(*(judged(2 * seed + part, field_strength=field_strength) for part in (0, 1))) for seed in claim.seeds
    ]
    chances = np.array([pair.p_value for pair in pairs], float)
    assert np.mean(chances < 0.05) <= 0.05 + 0.06 * claim.widening
    assert abs(np.mean(chances) - 0.5) < 0.1 * claim.widening
    assert {pair.freedom for pair in pairs} == {8 if field_strength is None else 9}
    assert sum(chances < MAX_P_VALUE) <= 0.04 * claim.widening * claim.count
    assert "fails" not in {pair.answer for pair in pairs}
    ratios = np.array([pair.ratio for pair in pairs], float)
    low, high = claim.ratios(0.85, 1.15)
    assert low < np.sqrt(np.mean(ratios**2)) < high


@pytest.mark.parametrize("freedom", range(3, 10))
def test_chance_is_that_of_the_chi_square_distribution(freedom: int) -> None:
    from scipy import stats

    values = np.linspace(0.0, 60.0, 600)
    found, true = [p_value_of(value, freedom) for value in values], stats.chi2.sf(values, freedom)
    npt.assert_allclose(found, true, atol=0.006)
    npt.assert_allclose(np.array(found)[true < 0.1], true[true < 0.1], atol=0.002)


# what has changed


def test_after_its_offset_moved_a_calibration_fails() -> None:
    found = compare(judged(0), judged(1, moved=5.0))
    assert found.answer == "fails"
    npt.assert_allclose(found.offset_difference, [5.0, 0.0, 0.0], atol=0.5)
    assert found.offset_share == pytest.approx(0.1, rel=0.2)  # of the radius found, which is that of field and scale
    assert found.p_value is not None
    assert found.p_value < 1e-10


def test_a_change_of_no_consequence_holds_and_one_near_the_target_cannot_be_told() -> None:
    first, second = judged(0, n=4000), judged(1, n=4000, moved=0.3)
    found = compare(first, second)
    assert found.p_value is not None
    assert found.p_value < MAX_P_VALUE
    assert found.answer == "holds"
    assert compare(first, second, target_deg=0.1).answer == "fails"
    near = compare(first, second, target_deg=1.01 * found.worst_deg)
    assert near.answer == "cannot-tell"
    assert near.telling_bound_deg == pytest.approx(0.01 * found.worst_deg)


@pytest.mark.parametrize("factor", [0.8, 1.2])
def test_the_claim_that_would_tell_does(factor: float) -> None:
    first, second = judged(0), judged(1, moved=0.3)
    target_deg = factor * compare(first, second).worst_deg
    found = compare(first, second, target_deg=target_deg)
    assert found.answer == "cannot-tell"
    assert found.telling_bound_deg is not None
    assert found.claimed_bound_deg is not None
    for share, answer in ((0.99, "fails" if factor < 1.0 else "holds"), (1.01, "cannot-tell")):
        narrower = (share * found.telling_bound_deg / found.claimed_bound_deg) ** 2
        claims = (claiming(one, narrower * np.asarray(one.claim.covariance)) for one in (first, second))
        assert compare(*claims, target_deg=target_deg).answer == answer


def test_the_wider_claim_is_named() -> None:
    first, second = judged(0), claiming(judged(1), 9.0 * np.asarray(judged(1).claim.covariance))
    found = compare(first, second, target_deg=0.1)
    assert (found.answer, found.wider_claim) == ("cannot-tell", "b")
    assert compare(second, first, target_deg=0.1).wider_claim == "a"
    bounds = found.own_bounds_deg
    assert bounds is not None
    assert bounds[1] == pytest.approx(3.0 * bounds[0], rel=0.1)
    assert found.claimed_bound_deg == pytest.approx(np.hypot(*bounds), rel=0.05)


def test_the_heading_difference_is_the_one_of_the_offset() -> None:
    """An offset of δ across a horizontal field of H cos I errs by δ/(H cos I) sin ψ."""
    one = bare_fit(Calibration(np.eye(3), np.zeros(3), 50.0))
    other = changed(one, offset=np.array([0.1, 0.0, 0.0]))
    found = compare(one, other, dip_deg=60.0)
    assert found.heading_difference_deg.worst == pytest.approx(np.rad2deg(0.1 / 25.0), rel=0.01)
    assert found.heading_difference_deg.rms == pytest.approx(np.rad2deg(0.1 / 25.0) / np.sqrt(2.0), rel=0.01)
    assert found.heading_mean_deg == pytest.approx(0.0, abs=1e-9)
    assert found.direction_difference_deg == pytest.approx(np.rad2deg(0.1 / 50.0) * np.sqrt(2 / 3), rel=0.01)


@pytest.mark.parametrize("angles", [(0.0, 0.0, 2.0), (12.0, -5.0, 30.0), (0.0, 0.0, 180.0)])
def test_a_rotation_that_one_alone_knows_is_left_out(angles: tuple[float, float, float]) -> None:
    """An aid finds how the axes sit in the body; the ellipsoid is the same, and so is its heading."""
    one, turn = judged(0), euler(*angles)
    matrix = turn @ one.calibration.matrix
    found = compare(one, changed(one, matrix=matrix, rotation="estimated"))
    assert (found.answer, found.rotation) == ("holds", None)
    assert not found.is_identical
    assert found.heading_difference_deg.worst == pytest.approx(0.0, abs=1e-9)
    assert found.direction_difference_deg == pytest.approx(0.0, abs=1e-5)
    cosine = (np.trace(turn) - 1.0) / 2.0
    assert found.omitted_rotation_deg == pytest.approx(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))), abs=1e-6)


def test_two_rotations_that_differ_beyond_chance_and_target_fail() -> None:
    """A sensor that was turned in its mounting by 3°, known to 0.1° about each axis both times."""
    one = judged(0)
    aiding = Aiding(rotation_covariance=np.deg2rad(0.1) ** 2 * np.eye(3))
    first, second, alike = (
        replace(
            changed(one, matrix=euler(0, 0, yaw) @ one.calibration.matrix, rotation="estimated"),
            evidence=replace(one.evidence, aiding=aiding),
        )
        for yaw in (5.0, 8.0, 5.1)
    )
    found = compare(first, second)
    assert found.rotation is not None
    npt.assert_allclose(found.rotation.vector_deg, [0.0, 0.0, 3.0], atol=1e-9)
    assert found.rotation.angle_sigma_deg == pytest.approx(0.1 * np.sqrt(2.0))
    assert (found.answer, found.is_turned, found.is_turned_beyond_target) == ("fails", True, True)
    small = compare(first, second, target_deg=5.0)
    assert (small.answer, small.is_turned, small.is_turned_beyond_target) == ("holds", True, False)
    assert not compare(first, alike).is_turned
    bare = [bare_fit(each.calibration) for each in (first, second)]
    assert (compare(*bare).answer, compare(bare[0], bare[0]).answer) == ("fails", "holds")


def test_an_offset_beyond_the_field_is_no_constant_heading() -> None:
    """Where the heading no longer goes round, the difference is all angles, not a mean to be removed."""
    one = bare_fit(Calibration(np.eye(3), np.zeros(3), 50.0))
    for far in (200.0, 1e200):
        found = compare(one, changed(one, offset=np.array([far, 0.0, 0.0])))
        assert found.heading_difference_deg.rms > 60.0
        assert found.answer == "fails"


def test_the_scale_counts_where_both_fields_are_known() -> None:
    """The same sensor in a stronger field reads longer; a gain that changed reads longer in the same field."""
    one = judged(0, n=4000)
    shape = 1.1 * one.calibration.shape
    stronger = with_calibration(one, Calibration.from_ellipsoid(one.calibration.offset, shape, raw=Unit.of("uT")))
    found = compare(one, stronger)
    assert (found.answer, found.is_scale_known) == ("holds", False)
    assert found.scale_difference == pytest.approx(0.1)
    assert found.chi_square == pytest.approx(0.0, abs=1e-6)
    known = [
        with_calibration(one, Calibration.from_ellipsoid(
            one.calibration.offset, factor * one.calibration.shape, field_strength=field, raw=Unit.of("uT")
        ))
        for factor, field in ((1.0, 50.0), (1.1, 55.0), (1.1, 50.0))
    ]  # fmt: skip
    assert compare(known[0], known[1]).answer == "holds"
    assert compare(known[0], known[1]).scale_difference == pytest.approx(0.0, abs=1e-12)
    gain = compare(known[0], known[2])
    assert (gain.answer, gain.is_scale_known, gain.freedom) == ("holds", True, 9)
    assert gain.p_value is not None
    assert gain.p_value < MAX_P_VALUE
    assert gain.scale_difference == pytest.approx(0.1)
    assert gain.heading_difference_deg.worst < 0.5


# either way round


def test_it_makes_no_difference_but_of_sign_which_comes_first() -> None:
    def numbers(found: Comparison) -> list[float | None]:
        claimed = found.claimed_deg
        assert claimed is not None
        return [
            found.heading_difference_deg.rms, found.heading_difference_deg.worst, claimed.rms, claimed.worst,
            found.direction_difference_deg, found.chi_square, found.offset_share, found.freedom,
        ]  # fmt: skip

    for first, second in ((judged(0), judged(1)), (judged(0), judged(1, moved=5.0))):
        forth, back = compare(first, second), compare(second, first)
        npt.assert_allclose(numbers(forth), numbers(back), rtol=1e-9)  # type: ignore[arg-type]
        assert forth.heading_mean_deg == pytest.approx(-back.heading_mean_deg)
        npt.assert_allclose(forth.offset_difference, -back.offset_difference)
        assert forth.answer == back.answer


def test_a_calibration_agrees_with_itself() -> None:
    for one in (judged(0), claiming(judged(0), np.zeros((9, 9)))):
        found = compare(one, one)
        assert found.answer == "holds"
        assert found.is_identical
        assert found.heading_difference_deg.worst < 1e-9
    assert not compare(judged(0), judged(1)).is_identical


# what is claimed


def test_a_calibration_without_a_covariance_is_exact() -> None:
    first, second = judged(0), judged(1)
    bare = [claiming(one, np.zeros((9, 9))) for one in (first, second)]
    both, half, none = compare(first, second), compare(first, bare[1]), compare(*bare)
    assert both.chi_square is not None
    assert half.chi_square is not None
    assert half.chi_square > both.chi_square
    assert (none.chi_square, none.p_value, none.claimed_deg, none.ratio) == (None, None, None, None)
    assert (none.answer, none.telling_bound_deg, none.wider_claim) == ("holds", None, None)
    assert compare(*bare, target_deg=0.001).answer == "fails"


def test_calibrations_that_claim_little_do_not_tell() -> None:
    first, second = (claiming(one, 1e4 * np.asarray(one.claim.covariance)) for one in (judged(0), judged(1)))
    found = compare(first, second)
    assert found.p_value is not None
    assert found.p_value > MAX_P_VALUE
    assert found.answer == "cannot-tell"


# doors and gates


def test_a_file_says_what_the_fit_did(tmp_path: Path) -> None:
    fit = flinders.fit(simulate.tumble(seed=3, motion="uniform", sensor=RANDOM_SENSOR).samples)
    fit.save(tmp_path / "a.json")
    loaded, kept = load(tmp_path / "a.json"), fit
    npt.assert_array_equal(loaded.claim.covariance, kept.claim.covariance)
    ours, theirs = compare(kept, judged(0)), compare(loaded, judged(0))
    assert (theirs.answer, theirs.freedom) == (ours.answer, ours.freedom)
    for name in ("chi_square", "p_value", "ratio", "direction_difference_deg"):
        assert getattr(theirs, name) == pytest.approx(getattr(ours, name), rel=1e-9), name


def test_the_covariance_of_a_file_is_found_by_its_names() -> None:
    one = judged(0)
    order = [3, 4, 5, 6, 7, 8, 2, 1, 0]
    names = [PARAMETERS[row] for row in order]
    rows = tuple(map(tuple, one.claim.covariance[np.ix_(order, order)].tolist()))
    fitted = Fitted(method="x", samples=1, covariance=rows, covariance_of=tuple(names))
    found = fit_from(one.calibration.to_document(fit=fitted))
    npt.assert_array_equal(found.claim.covariance, one.claim.covariance)


@pytest.mark.parametrize(
    "covariance",
    [
        np.eye(1),
        np.triu(np.ones((9, 9))),
        np.eye(9) - 0.9,
    ],
)
def test_a_covariance_that_is_none(covariance: Floats) -> None:
    rows = tuple(map(tuple, covariance.tolist()))
    fitted = Fitted(method="x", samples=1, covariance=rows, covariance_of=PARAMETERS[: len(rows)])
    with assert_raises(DocumentError):
        fit_from(judged(0).calibration.to_document(fit=fitted), name="a.json")


def test_what_cannot_be_compared() -> None:
    one = judged(0)
    with assert_raises(UnitError):
        compare(one, with_name(changed(one, raw=Unit.of("counts")), "other"))
    with pytest.raises(AxesError, match="axes x,-y,-z"):
        compare(one, changed(one, axes=Axes.of("x,-y,-z")))
    for wrong in ({"target_deg": 0.0}, {"target_deg": float("nan")}, {"dip_deg": 90.0}):
        with pytest.raises(UsageError):
            compare(one, one, **wrong)
    with pytest.raises(ArrayError, match="shape"):
        claiming(one, np.eye(6))


def test_paths_and_bare_calibrations_are_compared_too(tmp_path: Path) -> None:
    one, other = judged(0), judged(1)
    paths = [tmp_path / "one.json", tmp_path / "other.json"]
    for fit, path in zip((one, other), paths, strict=True):
        fit.save(path)
    found, wanted = compare(str(paths[0]), paths[1]), compare(one, other)
    assert found.answer == wanted.answer
    assert found.chi_square == pytest.approx(wanted.chi_square, rel=1e-6)
    bare = compare(one.calibration, other.calibration)
    assert bare.p_value is None
    assert bare.worst_deg == pytest.approx(wanted.worst_deg)
    with assert_raises(UsageError):
        compare(np.zeros((3, 3)), one)  # type: ignore[arg-type]


def test_the_strength_of_readings_adds() -> None:
    recording = simulate.tumble(seed=4, motion="uniform", sensor=RANDOM_SENSOR)
    calibration = judged(0).calibration
    field = recording.samples.field
    lengths = np.linalg.norm(calibration.apply(field), axis=1) / calibration.field_strength
    found = LengthSums.of_corrected(calibration, field[:300]) + LengthSums.of_corrected(calibration, field[300:])
    assert found.readings == len(field)
    assert [found.mean, found.spread] == pytest.approx([lengths.mean(), lengths.std()])
    assert (LengthSums().mean, LengthSums().spread) == (0.0, 0.0)


def level_and_all_round(seed: int, axes: str = "x,y,z") -> tuple[Fit, Fit]:
    """A sensor tumbled, and turned level on another day; `axes` turns it over."""
    sensor = simulate.Sensor.random(np.random.default_rng(seed), noise=0.5)
    tumble = simulate.tumble(seed=seed, motion="uniform", n=1000, sensor=sensor)
    turn = simulate.tumble(seed=seed + 1000, motion="level", n=400, sensor=sensor)
    fits = (flinders.fit(Samples.of(one.samples.field, unit="uT", axes=axes)) for one in (tumble, turn))
    return tuple(fit for fit in fits)  # type: ignore[return-value]


@pytest.mark.nightly
def test_a_level_turn_is_held_against_a_calibration_in_the_plane_that_it_knows(trials: Choose) -> None:
    """As often beyond chance as chance is, and off by what both claim: it says nothing of what it has not seen."""
    claim = trials(60, 12)
    pairs = [level_and_all_round(seed) for seed in claim.seeds]
    found = [compare(*pair) for pair in pairs]
    assert all(one.freedom == 4 for one in found)
    assert (
        sum(one.p_value is not None and one.p_value < 0.05 for one in found)
        <= (0.05 + 0.1 * claim.widening) * claim.count
    )
    ratios = [one.ratio for one in found if one.ratio is not None]
    low, high = claim.ratios(0.7, 1.3)
    assert low < float(np.sqrt(np.mean(np.square(ratios)))) < high
    assert all(one.claimed_deg is not None and one.claimed_deg.worst < 1.0 for one in found)
    assert "fails" not in {one.answer for one in found}


@pytest.mark.parametrize("axes", ["x,y,z", "x,-y,-z"])
def test_a_shift_across_the_deck_is_seen_by_a_level_turn_and_one_along_the_mast_is_not(axes: str) -> None:
    full, turn = level_and_all_round(3, axes)
    dip = 60.0 if axes == "x,y,z" else -60.0
    for shift, answer in (([1.0, 0.0, 0.0], "fails"), ([0.0, 0.0, 5.0], "holds")):
        moved = replace(full, calibration=replace(full.calibration, offset=full.calibration.offset + shift))
        assert compare(moved, turn, dip_deg=dip).answer == answer


def test_a_scale_that_is_left_out_is_no_direction_also_of_rounded_covariances() -> None:
    """An engine's are symmetric to rounding: χ² of a check went from 35 to 73 by what that left of the scale."""
    rng = np.random.default_rng(1)
    root, shape = rng.normal(size=(9, 9)), np.diag([48.0, 50.0, 53.0])
    covariance = root @ root.T * (1.0 + 1e-9 * rng.normal(size=(9, 9)))
    first = EllipsoidPairs(np.zeros((1, 3)), shape[np.newaxis], covariance[np.newaxis])
    second = EllipsoidPairs(np.ones((1, 3)), shape[np.newaxis] + 0.1, covariance[np.newaxis])
    assert Pairs.of(first, second).chi_square()[1] == 8
