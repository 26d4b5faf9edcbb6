"""Several magnetometers of one body: what is known of each, and which one departs."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily, nightly
from tests.worlds import TURNED, body

import flinders
from flinders import simulate
from flinders.comparison.agreement import disagreements, heading_deg
from flinders.comparison.multi_sensor import fit_multi, nearest_axes
from flinders.core.samples import Samples
from flinders.core.time_alignment import align_readings, interpolate_readings
from flinders.errors import FitError, InputError, UsageError
from flinders.estimators import multi_sensor
from flinders.fitting.result import Fit, Refused
from flinders.geometry.ellipsoid import upper_entries
from flinders.geometry.rotation import rotations

if TYPE_CHECKING:
    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.comparison.members import Member

FIELD: Final = 50.0
"""µT."""


def fit_of(member: Member) -> Fit:
    return member.fit.fit if isinstance(member.fit, Refused) else member.fit  # type: ignore[return-value]


def codes(member: Member) -> set[str]:
    return {finding.code for finding in member.findings}


def changed(samples: Samples, **fields: Any) -> Samples:
    return replace(samples, **fields)


# what is found


def test_offsets_shapes_and_rotation_are_those_of_the_sensors() -> None:
    recordings, sensors, _ = body(2)
    fields = np.stack([samples.field for samples in recordings.values()])
    found = multi_sensor.fit_sensors(fields)
    for number, sensor in enumerate(sensors):
        at, sigma = found.parameters[number], np.sqrt(np.diag(found.of(number)))
        error = np.concatenate(
            [at.offset - sensor.offset, upper_entries(at.shape) - upper_entries(FIELD * sensor.matrix)]
        )
        assert np.all(np.abs(error) < 4.0 * sigma[:9])
        assert np.abs(error[:3]).max() < 0.2
    turned, covariance = found.rotation(1)
    npt.assert_allclose(turned, TURNED, atol=4.0 * np.sqrt(covariance.max()))
    assert np.rad2deg(np.sqrt(covariance.max())) < 0.1
    npt.assert_allclose(found.noise, 0.5, rtol=0.1)


@pytest.mark.nightly
def test_what_is_claimed_is_what_is_off(trials: Choose) -> None:
    """Squared error over claimed variance, of offsets and of the rotation, mean over twelve bodies: near one."""
    claim = trials(12, 4)
    offsets, turns = [], []
    for seed in claim.seeds:
        recordings, sensors, _ = body(seed, motion="uniform", n=400)
        found = multi_sensor.fit_sensors(np.stack([samples.field for samples in recordings.values()]))
        for number, sensor in enumerate(sensors):
            error = found.parameters[number].offset - sensor.offset
            offsets.append(error @ np.linalg.solve(found.of(number)[:3, :3], error) / 3.0)
        off = found.parameters[1].rotation @ TURNED.T
        vector = 0.5 * np.array([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]])
        turns.append(vector @ np.linalg.solve(found.rotation(1)[1], vector) / 3.0)
    for values, bounds in ((offsets, (0.6, 1.5)), (turns, (0.5, 1.8))):
        low, high = claim.ratios(*bounds)
        assert low < np.mean(values) < high


def test_the_rotation_of_the_reference_is_exact() -> None:
    recordings, _, _ = body(3, n=500, noises=(0.5, 0.5, 1.0))
    found = multi_sensor.fit_sensors(np.stack([samples.field for samples in recordings.values()]), reference=1)
    npt.assert_allclose(found.rotation(1)[0], np.eye(3), atol=1e-12)
    assert not found.rotation(1)[1].any()


@pytest.mark.nightly
def test_a_noisy_sensor_gains_most_from_a_good_one_beside_it() -> None:
    recordings, _, _ = body(4, motion="tilted", n=1500, noises=(0.3, 3.0))
    found = fit_multi(recordings)
    good, noisy = found.members
    assert isinstance(noisy.fit, Fit)
    alone = noisy.alone.fit if isinstance(noisy.alone, Refused) else noisy.alone
    assert isinstance(alone, Fit)
    assert noisy.fit.heading_error_deg.worst < 0.5 * alone.heading_error_deg.worst
    assert isinstance(good.alone, Fit)
    assert fit_of(good).heading_error_deg.worst <= good.alone.heading_error_deg.worst * 1.02


def test_corrected_readings_are_in_the_axes_of_the_reference() -> None:
    recordings, _, directions = body(5)
    found = fit_multi(recordings, reference="a")
    for name, samples in recordings.items():
        calibration = fit_of(found[name]).calibration
        corrected = calibration.apply(samples.field) / calibration.field_strength
        assert np.rad2deg(np.median(np.linalg.norm(corrected - directions, axis=1))) < 1.5
    assert fit_of(found["b"]).calibration.rotation == "estimated"
    assert fit_of(found["a"]).calibration.rotation == "symmetric"


def test_more_coverage_is_not_claimed_of_a_body_that_was_not_turned_over() -> None:
    """Two sensors see the same: what the first leaves open the second leaves open as well."""
    recordings, _, _ = body(6, motion="level", n=600)
    found = fit_multi(recordings)
    assert not found.is_joint
    assert all("not-together" in codes(member) for member in found.members)
    assert all(member.fit is member.alone or fit_of(member).claim.plane for member in found.members)


def test_what_lies_beside_the_reference_turns_all_into_the_body() -> None:
    path = simulate.tumble(seed=3, motion="flight", n=2000)
    rng = np.random.default_rng(3)
    mounted = rotations(np.array([[0.1, -0.2, 0.3]]))[0]
    first, second = simulate.Sensor.random(rng, noise=0.5), simulate.Sensor.random(rng, noise=0.5)
    reference = replace(path.samples, field=first.read(FIELD * path.directions @ mounted, rng))
    other = replace(path.samples, field=second.read(FIELD * path.directions @ mounted @ TURNED, rng))
    found = fit_multi({"a": reference, "b": other}, aiding=("rate", "dip"))
    assert found.in_body
    for name, samples in (("a", reference), ("b", other)):
        calibration = fit_of(found[name]).calibration
        corrected = calibration.apply(samples.field) / calibration.field_strength
        assert np.rad2deg(np.linalg.norm(np.mean(corrected - path.directions, axis=0))) < 3.0
    assert found["b"].rotation is not None
    npt.assert_allclose(found["b"].rotation, TURNED, atol=0.1)


# clocks and rates


def test_different_rates_meet_at_the_slower_ones_moments() -> None:
    recordings, sensors, _ = body(7, n=3000)
    slow = recordings["b"][::5]
    found = fit_multi({"a": recordings["a"], "b": slow})
    assert found.agreement.instants == len(slow)
    npt.assert_allclose(fit_of(found["b"]).calibration.offset, sensors[1].offset, atol=0.3)


@pytest.mark.parametrize("delay", daily([-0.37, 0.11]))
def test_a_clock_that_is_off_is_found_and_taken_off(delay: float) -> None:
    recordings, _, _ = body(8, n=3000)
    time = recordings["b"].time
    assert time is not None
    found = fit_multi({"a": recordings["a"], "b": changed(recordings["b"], time=time + delay)})
    assert found["b"].delay_s == pytest.approx(delay, abs=max(4.0 * found["b"].delay_sigma_s, 2e-3))
    assert "clock-differs" in codes(found["b"])
    assert np.rad2deg(np.linalg.norm(np.asarray(found["b"].rotation) - TURNED)) < 0.5


@pytest.mark.nightly
def test_equal_clocks_have_no_delay(trials: Choose) -> None:
    for seed in trials(4, 2).seeds:
        recordings, _, _ = body(20 + seed, n=1500)
        times = [samples.time for samples in recordings.values() if samples.time is not None]
        assert not align_readings(times, [samples.field for samples in recordings.values()]).delays_s.any()


def test_no_line_is_drawn_across_a_gap() -> None:
    time = np.concatenate([np.arange(10.0), np.arange(30.0, 40.0)])
    taken = interpolate_readings(time, np.tile(time[:, np.newaxis], 3), np.array([4.5, 15.0, 35.25, 99.0]))
    npt.assert_allclose(taken[[0, 2], 0], [4.5, 35.25])
    assert np.isnan(taken[[1, 3]]).all()


def test_rows_without_time_belong_together_where_they_are_as_many() -> None:
    recordings, _, _ = body(9, n=600)
    timeless = {name: changed(samples, time=None) for name, samples in recordings.items()}
    assert fit_multi(timeless).is_joint
    with assert_raises(UsageError):
        fit_multi({"a": timeless["a"], "b": timeless["b"][:500]})
    with assert_raises(UsageError):
        fit_multi({"a": recordings["a"], "b": timeless["b"]})


def test_recordings_of_different_times_are_refused() -> None:
    recordings, _, _ = body(10, n=600)
    time = recordings["b"].time
    assert time is not None
    with assert_raises(InputError):
        fit_multi({"a": recordings["a"], "b": changed(recordings["b"], time=time + 1e4)})


# what may be wrong with one


def test_exchanged_axes_are_named() -> None:
    recordings, _, _ = body(11, same=True)
    swapped = changed(recordings["b"], field=recordings["b"].field[:, [1, 0, 2]] * [1.0, -1.0, 1.0])
    found = fit_multi({"a": recordings["a"], "b": swapped})["b"]
    assert (found.axes, found.is_mirrored) == ("-y,x,z", False)
    assert found.misalignment_deg < 1.0
    [turned] = [finding for finding in found.findings if finding.code == "turned-to"]
    assert 0.0 < turned.number < 0.5
    assert "-y,x,z" in turned.advice


def test_a_mirror_image_is_found_and_corrected() -> None:
    recordings, _, directions = body(12, same=True)
    mirrored = changed(recordings["b"], field=recordings["b"].field * [1.0, 1.0, -1.0])
    found = fit_multi({"a": recordings["a"], "b": mirrored})["b"]
    assert (found.axes, found.is_mirrored) == ("x,y,-z", True)
    assert "mirrored-sensor" in codes(found)
    corrected = fit_of(found).calibration.apply(mirrored.field) / fit_of(found).calibration.field_strength
    assert np.rad2deg(np.median(np.linalg.norm(corrected - directions, axis=1))) < 1.5


def test_the_rotation_of_a_mirror_image_is_as_uncertain_as_of_its_original() -> None:
    recordings, _, _ = body(12, n=500, same=True, noises=(0.5, 0.5, 0.5))
    fields = np.stack([samples.field for samples in recordings.values()])
    plain = multi_sensor.fit_sensors(fields)
    fields[2] *= [1.0, 1.0, -1.0]
    mirrored = multi_sensor.fit_sensors(fields)
    turn, covariance = mirrored.rotation(2)
    assert np.linalg.det(turn) == pytest.approx(-1.0)
    npt.assert_allclose(np.trace(covariance), np.trace(plain.rotation(2)[1]), rtol=0.05)


def test_another_unit_is_named() -> None:
    recordings, _, _ = body(13)
    found = fit_multi({"a": recordings["a"], "b": changed(recordings["b"], field=recordings["b"].field * 10.0)})
    assert "unlike-units" in codes(found["b"])
    assert found["b"].length_ratio == pytest.approx(10.0, rel=0.3)  # scales of either are off by up to a quarter


def test_a_copy_is_no_second_witness() -> None:
    recordings, _, _ = body(14, n=800, noises=(0.5, 0.5, 0.5))
    copy = changed(recordings["a"], field=recordings["a"].field[:, [2, 0, 1]] * 16.0)
    found = fit_multi({**recordings, "d": copy})
    assert found["d"].copy_of == "a"
    assert codes(found["d"]) == {"copied-sensor"}
    without = fit_multi(recordings)
    npt.assert_allclose(fit_of(found["a"]).claim.covariance, fit_of(without["a"]).claim.covariance, rtol=1e-6)


def test_readings_at_the_limit_do_not_count() -> None:
    recordings, sensors, _ = body(15)
    limit = float(np.quantile(recordings["b"].field[:, 0], 0.9))
    cut = changed(recordings["b"], field=np.minimum(recordings["b"].field, [limit, np.inf, np.inf]))
    found = fit_multi({"a": recordings["a"], "b": cut})
    assert "saturated" in {finding.code for finding in fit_of(found["b"]).findings}
    error = fit_of(found["b"]).calibration.offset - sensors[1].offset
    assert np.all(np.abs(error) < 4.0 * fit_of(found["b"]).claim.offset_sigma)


def test_a_sensor_that_departs_for_a_while_is_told_by_the_others() -> None:
    recordings, sensors, _ = body(16, noises=(0.5, 0.5, 0.5))
    time = recordings["b"].time
    assert time is not None
    disturbed = recordings["b"].field + np.outer((time > 10.0) & (time < 14.0), [6.0, -3.0, 2.0])
    found = fit_multi({**recordings, "b": changed(recordings["b"], field=disturbed)})
    runs = found.agreement.disagreements
    assert [run.sensor for run in runs] == [1]
    assert runs[0].start_s == pytest.approx(10.0, abs=1.1)
    assert runs[0].end_s == pytest.approx(14.0, abs=1.1)
    assert runs[0].heading_deg == pytest.approx(heading_deg(7.0 / FIELD, 60.0), rel=0.35)
    assert "sensor-deviates" in codes(found["b"])
    assert not {"sensor-deviates", "disagree"} & (codes(found["a"]) | codes(found["c"]))
    npt.assert_allclose(fit_of(found["b"]).calibration.offset, sensors[1].offset, atol=0.3)


def test_of_two_it_is_not_told_which_unless_a_length_changes() -> None:
    rng = np.random.default_rng(1)
    q = simulate.tumble(seed=17, motion="hand", n=1500).directions
    seen = np.stack([q + rng.normal(scale=0.01, size=q.shape) for _ in range(2)])
    time = np.arange(1500) / 50.0
    across = seen.copy()
    across[1, 500:700] = seen[1, 500:700] @ rotations(np.array([[0.0, 0.0, 0.2]]))[0].T
    assert {run.sensor for run in disagreements(across, time)} == {None}
    longer = seen.copy()
    longer[1, 500:700] *= 1.2
    assert [(run.sensor, run.is_by_length) for run in disagreements(longer, time)] == [(1, True)]


def test_two_that_disagree_say_so_both() -> None:
    """The field of the second is turned by 11.5° for two seconds of twenty; none of the lengths tells of it."""
    recordings, sensors, directions = body(40, n=1000, same=True)
    astray = directions.copy()
    astray[400:500] = directions[400:500] @ rotations(np.array([[0.0, 0.0, 0.2]]))[0].T
    field = sensors[1].read(FIELD * astray, np.random.default_rng(1))
    found = fit_multi({"a": recordings["a"], "b": changed(recordings["b"], field=field)})
    for member in found.members:
        [told] = [finding for finding in member.findings if finding.code == "disagree"]
        assert 8.0 < told.number < 25.0
        assert_sentences(told.advice)


def loose(recordings: dict[str, Samples], sensors: list[simulate.Sensor], directions: Floats, name: str) -> Samples:
    """The readings of a sensor that swings by 5° about its mount all the time: no length of it changes."""
    time = recordings[name].time
    assert time is not None
    swing = np.deg2rad(5.0) * np.sin(2.0 * np.pi * time / 9.0)[:, np.newaxis] * [0.6, 0.0, 0.8]
    swung = np.einsum("nij,nj->ni", rotations(swing), directions)
    sensor = sensors["abcd".index(name)]
    return changed(recordings[name], field=sensor.read(FIELD * swung, np.random.default_rng(3)))


@pytest.mark.parametrize("name", daily(["a", "b"]))
def test_of_two_that_disagree_all_the_time_neither_is_blamed_nor_bent(name: str) -> None:
    recordings, sensors, directions = body(41, n=1000, same=True)
    swinging = loose(recordings, sensors, directions, name)
    found = fit_multi({**recordings, name: swinging})
    assert not found.is_joint
    assert found.agreement.disagreements == ()
    for member, sensor in zip(found.members, sensors, strict=True):
        [told] = member.findings
        assert (told.code, told.severity) == ("disagree", "limits")
        assert 1.5 < told.number < 4.0  # of 3.5° rms, over cos 60°, a third a component is 4; the fit takes up some
        assert fit_of(member).calibration is member.alone.calibration  # type: ignore[union-attr]
        npt.assert_allclose(fit_of(member).calibration.offset, sensor.offset, atol=0.4)


def test_of_three_the_one_that_swings_is_blamed_and_the_others_stay_joint() -> None:
    recordings, sensors, directions = body(41, n=1000, same=True, noises=(0.5, 0.5, 0.5))
    found = fit_multi({**recordings, "b": loose(recordings, sensors, directions, "b")})
    assert found.is_joint
    assert [member.is_kept for member in found.members] == [False, True, False]
    assert codes(found["b"]) == {"sensor-deviates-throughout", "not-together"}
    assert found["b"].rotation is None
    worst = fit_of(found["b"]).heading_error_deg.worst
    [told] = [finding for finding in found["b"].findings if finding.code == "not-together"]
    assert told.limit == pytest.approx(1.5 * worst)
    assert told.number > told.limit
    assert not codes(found["a"]) & {"sensor-deviates-throughout", "not-together"}


def test_two_white_noises_are_no_disagreement(trials: Choose) -> None:
    for seed in trials(3, 1).seeds:
        recordings, _, _ = body(50 + seed, n=1000, noises=(0.3, 3.0))
        found = fit_multi(recordings)
        assert found.is_joint
        assert found.agreement.apart_deg == 0.0
        assert not any({"disagree", "not-together"} & codes(member) for member in found.members)


@pytest.mark.nightly
def test_a_clock_that_is_off_by_more_than_is_looked_for_harms_nobody(trials: Choose) -> None:
    """Three seconds: the readings of that sensor belong to other moments."""
    for seed in trials(2, 1).seeds:
        recordings, sensors, _ = body(60 + seed, n=1500, noises=(0.5, 0.5, 0.5))
        time = recordings["b"].time
        assert time is not None
        found = fit_multi({**recordings, "b": changed(recordings["b"], time=time + 3.0)})
        assert found["b"].is_kept
        for member, sensor in zip(found.members, sensors, strict=True):
            alone = member.alone
            assert isinstance(alone, Fit)
            assert fit_of(member).heading_error_deg.worst <= 1.5 * alone.heading_error_deg.worst
            npt.assert_allclose(fit_of(member).calibration.offset, sensor.offset, atol=0.4)


@pytest.mark.nightly
@pytest.mark.parametrize("noises", [(0.5, 0.5, 0.5), nightly((0.5, 0.5, 0.5, 0.5))])
def test_two_that_are_disturbed_alike_are_no_majority(noises: tuple[float, ...]) -> None:
    recordings, sensors, _ = body(62, n=1500, noises=noises)
    for name in "bc":
        time = recordings[name].time
        assert time is not None
        pushed = sensors["abcd".index(name)].matrix @ (TURNED.T @ [8.0, 8.0, 0.0])
        disturbed = recordings[name].field + np.outer((time > 8.0) & (time < 13.0), pushed)
        recordings[name] = changed(recordings[name], field=disturbed)
    found = fit_multi(recordings)
    assert {run.sensor for run in found.agreement.disagreements} == {1, 2}
    assert not codes(found["a"]) & {"sensor-deviates", "sensor-deviates-throughout", "disagree"}
    for place, name in ((1, "b"), (2, "c")):
        assert "sensor-deviates" in codes(found[name])
        assert "outliers" in {finding.code for finding in fit_of(found[name]).findings}
        npt.assert_allclose(fit_of(found[name]).calibration.offset, sensors[place].offset, atol=0.3)


def test_lengths_tell_against_a_majority_only_where_all_of_it_changed() -> None:
    rng = np.random.default_rng(1)
    q = simulate.tumble(seed=17, motion="hand", n=1500).directions
    seen = np.stack([q + rng.normal(scale=0.01, size=q.shape) for _ in range(3)])
    time = np.arange(1500) / 50.0
    both, one = seen.copy(), seen.copy()
    both[1:, 500:700] = 1.2 * (seen[1:, 500:700] @ rotations(np.array([[0.0, 0.0, 0.3]]))[0].T)
    one[0, 500:700] = seen[0, 500:700] @ rotations(np.array([[0.0, 0.0, 0.3]]))[0].T
    one[1, 500:700] *= 1.006
    assert {(run.sensor, run.is_by_length) for run in disagreements(both, time)} == {(1, True), (2, True)}
    assert {(run.sensor, run.is_by_length) for run in disagreements(one, time)} == {(0, False)}


@pytest.mark.nightly
def test_no_departure_where_there_is_none(trials: Choose) -> None:
    for seed in trials(3, 1).seeds:
        recordings, _, _ = body(30 + seed, n=1000, noises=(0.5, 1.0, 0.5))
        assert fit_multi(recordings).agreement.disagreements == ()


def test_a_sensor_beside_a_motor_is_told_from_one_that_is_only_noisy() -> None:
    recordings, _, _ = body(18, noises=(0.5, 3.0, 0.5))
    rng = np.random.default_rng(2)
    hum = 6.0 * np.repeat(rng.normal(size=(15, 1)), 100, axis=0) * [1.0, 0.5, -0.5]
    found = fit_multi({**recordings, "c": changed(recordings["c"], field=recordings["c"].field + hum)})
    assert "sensor-deviates-throughout" not in codes(found["b"])
    assert codes(found["c"]) & {"sensor-deviates-throughout", "sensor-deviates"}


def test_a_dead_sensor_stands_beside_the_others() -> None:
    recordings, _, _ = body(19, n=600, noises=(0.5, 0.5, 0.5))
    stuck = changed(recordings["b"], field=np.tile([1.0, 2.0, 3.0], (600, 1)))
    found = fit_multi({**recordings, "b": stuck})
    assert isinstance(found["b"].fit, FitError)
    assert [member.name for member in found.members] == ["a", "b", "c"]
    assert found["c"].rotation is not None


def test_wrong_use_says_what_is_needed() -> None:
    recordings, _, _ = body(1, n=100)
    with assert_raises(UsageError):
        fit_multi({"a": recordings["a"]})
    with assert_raises(UsageError):
        fit_multi(recordings, reference="c")
    counts = Samples.of(recordings["b"].field, time=recordings["b"].time)
    with assert_raises(UsageError):
        fit_multi({"a": recordings["a"], "b": counts}, site=flinders.Site(strength=50.0))


def test_nearest_axes_of_each_of_the_24_and_their_mirror_images() -> None:
    from flinders.core.axes import SIGNED_PERMUTATIONS

    for axes in SIGNED_PERMUTATIONS:
        assert nearest_axes(axes.apply(np.eye(3)).T) == (str(axes), 0.0)


def test_the_facade_has_it() -> None:
    assert flinders.fit_multi is fit_multi
