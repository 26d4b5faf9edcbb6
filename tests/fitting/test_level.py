"""A level turn gives the heading of a level vehicle as well as can be, and says what it does not give."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from benchmarks.datasets import FIELD, FIELD_STRENGTH, dataset, heading_error_deg
from tests.sentences import assert_raises
from tests.trials import daily
from tests.worlds import judged, level_turn, method_with, rms

import flinders
from flinders import simulate
from flinders.core.joining import Joined
from flinders.core.samples import RecordingWrapper, Samples
from flinders.errors import FitError, NotAnEllipsoid, StuckAxis, UsageError
from flinders.estimators import Readings
from flinders.estimators.level import Level
from flinders.fitting.result import Refused
from flinders.geometry.ellipsoid import Ellipsoid, parameter_derivatives
from flinders.heading.error_propagation import level_error
from flinders.simulate import Sensor, Simulated

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tests.trials import Choose

    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.fitting.result import Fit


class Streamed(RecordingWrapper):
    """A recording that comes block by block."""

    def __init__(self, samples: Samples) -> None:
        self.recording: Recording = samples

    def blocks(self) -> Iterator[Samples]:
        """From the first block again."""
        assert isinstance(self.recording, Samples)
        return self.recording.blocks(177)


def codes(fit: Fit) -> list[str]:
    return [finding.code for finding in fit.findings]


def best_heading_deg(recording: Simulated) -> float:
    """Cramér-Rao bound of the heading of a level vehicle, rms, from x and y of a turn that is known to be level.

    Of each reading counts what lies across its ellipse: along it, the unknown heading takes all.
    """
    sensor = recording.sensor
    truth = Ellipsoid(np.asarray(sensor.offset), FIELD_STRENGTH * np.asarray(sensor.matrix))
    along = np.cross(recording.directions, [0.0, 0.0, 1.0]) @ truth.shape
    across = np.stack([-along[:, 1], along[:, 0], np.zeros(len(along))])
    gradients = parameter_derivatives(across / np.linalg.norm(across, axis=0), recording.directions.T) / sensor.noise
    covariance = np.linalg.pinv(gradients.T @ gradients, rcond=1e-9, hermitian=True)
    return level_error(truth, covariance, dip_deg=60.0).rms


def headings_off(fit: Fit, recording: Simulated, tilt_deg: float) -> Floats:
    """Heading errors, rad, of a vehicle that is tilted either way and knows how far; the mean of level ones removed.

    `fit` of `recording`, in a field of dip 60°.
    """
    about = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)
    headings = np.linspace(0.0, 2 * np.pi, 36, endpoint=False)
    level = simulate.turns(np.outer(headings, [0.0, 0.0, 1.0]))
    tilts = simulate.turns(np.radians(tilt_deg) * np.stack([np.cos(about), np.sin(about), 0.0 * about], axis=1))
    off = []
    for tilt in (np.eye(3), *tilts):
        true = FIELD_STRENGTH * simulate.in_body_axes(level @ tilt, FIELD)
        raw = true @ recording.sensor.matrix.T + recording.sensor.offset
        back = fit.calibration.apply(raw) @ tilt.T
        off.append(np.exp(1j * (np.arctan2(-back[:, 1], back[:, 0]) - headings)))
    phasors = np.array(off)
    return np.asarray(np.angle(phasors[1:] / np.mean(phasors[0])), np.float64)


@pytest.mark.parametrize("sigma", daily([0.5, 0.1, 2.0]))
def test_headings_after_a_level_turn_are_as_good_as_can_be_and_as_claimed(sigma: float, trials: Choose) -> None:
    """On the data set S7, as far as 25 recordings can tell: no unbiased estimator is better, and the claim is true."""
    true, claimed, best, claim = [], [], [], trials(25, 9)
    for trial in claim.seeds:
        recording = dataset("S7", trial, sigma)
        fit = flinders.fit(recording.samples.field, target_deg=5.0)
        assert (fit.evidence.method, fit.verdict) == ("level", "limited")
        assert codes(fit)[0] == "level-plane"
        true.append(heading_error_deg(fit.calibration.matrix, fit.calibration.offset, recording))
        claimed.append(fit.heading_error_deg.rms)
        best.append(best_heading_deg(recording))
    low, high = claim.ratios(0.7, 1.2)
    assert rms(best) / rms(true) > 0.8**claim.widening
    assert low < rms(true) / rms(claimed) < high


@pytest.mark.nightly
def test_three_percent_of_strays_are_left_out(trials: Choose) -> None:
    claim = trials(12, 5)
    true, clean = [], []
    for seed in claim.seeds:
        recording = level_turn(seed)
        field = recording.samples.field.copy()
        rng = np.random.default_rng([7, seed])
        struck = rng.choice(len(field), 18, replace=False)
        field[struck] += simulate.uniform_directions(rng, 18) * rng.uniform(25.0, 150.0, (18, 1))
        fit, plain = flinders.fit(field), flinders.fit(recording.samples.field)
        assert (fit.evidence.method, fit.verdict) == ("level", "limited")
        assert "outliers" in codes(fit)
        assert 0.01 < next(finding.number for finding in fit.findings if finding.code == "outliers") < 0.06
        true.append(heading_error_deg(fit.calibration.matrix, fit.calibration.offset, recording))
        clean.append(heading_error_deg(plain.calibration.matrix, plain.calibration.offset, recording))
    assert rms(true) < 1.25**claim.widening * rms(clean)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("arc_deg", "verdicts"), [(300, {"limited"}), (180, {"limited"}), (60, {"limited", "refused"})]
)
def test_less_than_a_full_turn_claims_as_much_less(arc_deg: float, verdicts: set[str], trials: Choose) -> None:
    """Of a sixth of a turn the prior speaks for the rest, and hardly a heading is within the target."""
    weighed, claimed, claim = [], [], trials(25, 9)
    for seed in claim.seeds:
        recording = level_turn(seed, np.linspace(20.0, 20.0 + arc_deg, 600))
        fit = judged(recording.samples.field)
        assert fit.evidence.method == "level"
        assert fit.verdict in verdicts
        true = heading_error_deg(fit.calibration.matrix, fit.calibration.offset, recording)
        weighed.append(true / fit.heading_error_deg.rms)
        claimed.append(fit.heading_error_deg.rms)
    low, high = claim.ratios(0.5, 1.5)
    assert low < rms(weighed) < high
    assert max(weighed) < 4.0
    assert (min(claimed) > 2.0) == (arc_deg == 60)


def test_a_refused_part_of_a_turn_asks_for_the_rest_of_it_and_not_to_turn_the_vehicle_over() -> None:
    with assert_raises(Refused) as caught:
        flinders.fit(level_turn(1, np.linspace(20.0, 60.0, 600)).samples.field)
    assert "side down" not in str(caught.value)


def resting(seed: int, share: float, n: int = 300) -> Simulated:
    """A level turn of some readings, and a rest at one heading that makes up a share of all."""
    rest = round(n * share / (1.0 - share))
    headings = np.concatenate([np.linspace(0.0, 360.0, n, endpoint=False), np.full(rest, 77.0)])
    return level_turn(seed, headings, n=len(headings))


@pytest.mark.nightly
@pytest.mark.parametrize("share", [0.5, 0.75])
def test_a_rest_at_one_heading_does_not_outweigh_the_turn(share: float, trials: Choose) -> None:
    claim = trials(20, 6)
    weighed = []
    for seed in claim.seeds:
        recording = resting(seed, share)
        fit = flinders.fit(recording.samples.field)
        assert (fit.evidence.method, fit.verdict) == ("level", "limited")
        true = heading_error_deg(fit.calibration.matrix, fit.calibration.offset, recording)
        weighed.append(true / fit.heading_error_deg.rms)
    low, high = claim.ratios(0.6, 1.4)
    assert low < rms(weighed) < high
    assert max(weighed) < 4.0


def test_a_turn_that_is_lost_beside_a_rest_gives_no_wrong_heading(trials: Choose) -> None:
    """Nineteen of twenty readings at one heading: refused, or right."""
    for seed in trials(10, 3).seeds:
        recording = resting(seed, 0.95, n=80)
        fit = judged(recording.samples.field)
        true = heading_error_deg(fit.calibration.matrix, fit.calibration.offset, recording)
        assert fit.verdict == "refused" or true < 4.0 * fit.heading_error_deg.rms


def test_without_a_prior_a_level_turn_is_refused() -> None:
    for seed in range(5):
        field = level_turn(seed).samples.field
        with pytest.raises(FitError) as caught:
            flinders.fit(field, method=flinders.estimators.Auto(prior=None))
        assert caught.value.code in {"refused", "undetermined"}
        if isinstance(caught.value, Refused):
            assert caught.value.fit.findings[0].code == "one-plane"
    with assert_raises(UsageError):
        method_with("level", prior=None)


def test_the_sign_of_the_dip_moves_the_offset_along_z_alone() -> None:
    field = level_turn(3).samples.field
    north, south = (
        flinders.fit(field, site=flinders.Site(inclination_deg=60.0)),
        flinders.fit(field, site=flinders.Site(inclination_deg=-60.0)),
    )
    npt.assert_allclose(south.calibration.offset[:2], north.calibration.offset[:2], atol=1e-9)
    npt.assert_allclose(south.calibration.matrix, north.calibration.matrix, atol=1e-12)
    height = float(field[:, 2].mean())
    assert north.calibration.offset[2] < height < south.calibration.offset[2]
    assert south.heading_error_deg.worst == pytest.approx(north.heading_error_deg.worst, rel=1e-9)


@pytest.mark.nightly
def test_headings_of_a_tilted_vehicle_are_no_worse_than_claimed(trials: Choose) -> None:
    """With the right dip; with its sign wrong, as in the other hemisphere, they are about as bad as claimed."""
    claim = trials(20, 6)
    tilts = (5.0, 10.0, 30.0)
    right, wrong, claimed = [], [], []
    for seed in claim.seeds:
        recording = level_turn(seed)
        fit, other = (
            flinders.fit(recording.samples.field, site=flinders.Site(inclination_deg=dip)) for dip in (60.0, -60.0)
        )
        right.append([rms(headings_off(fit, recording, tilt).ravel().tolist()) for tilt in tilts])
        wrong.append([rms(headings_off(other, recording, tilt).ravel().tolist()) for tilt in tilts])
        claimed.append([np.radians(fit.claim.tilted_error(tilt).rms) for tilt in tilts])
        assert fit.claim.tilted_error(5.0).worst > 2.0
        assert fit.findings[0].number == fit.claim.attitude_limit_deg < 5.0
    for tilt, true, beyond, claims in zip(tilts, *map(np.transpose, (right, wrong, claimed)), strict=True):
        low, high = claim.ratios(0.5, 2.5)
        assert rms(true) < 1.1**claim.widening * rms(claims), tilt
        assert low * rms(claims) < rms(beyond) < high * rms(claims), tilt


@pytest.mark.parametrize("axis", [(1.0, 0.0), (0.0, 1.0), (0.6, 0.8)])
def test_a_plane_not_across_z_is_refused_with_a_hint_at_the_axes(axis: tuple[float, float]) -> None:
    for mounted_deg in (45.0, 90.0):
        field = level_turn(2, mounted=(mounted_deg * axis[0], mounted_deg * axis[1], 0.0)).samples.field
        with assert_raises(Refused) as caught:
            flinders.fit(field)
        assert caught.value.fit.findings[0].code == "one-plane"


def test_the_hint_at_the_axes_helps() -> None:
    """A sensor with its x axis down, mapped."""
    recording = level_turn(2)
    field = np.roll(recording.samples.field, 1, axis=1)
    assert judged(Samples.of(field, unit="uT")).verdict == "refused"
    fit = flinders.fit(Samples.of(field, unit="uT", axes="y,z,x"))
    plain = flinders.fit(recording.samples)
    assert fit.evidence.method == "level"
    npt.assert_allclose(fit.calibration.offset, plain.calibration.offset, atol=1e-9)


@pytest.mark.parametrize("mounted", daily([((0.0, 5.0, 0.0),), ((-3.0, 2.0, 0.0),), ((8.0, 0.0, 0.0),)]))
def test_a_sensor_mounted_a_few_degrees_askew_still_gives_headings(
    mounted: tuple[float, float, float], trials: Choose
) -> None:
    weighed, claim = [], trials(20, 6)
    for seed in claim.seeds:
        recording = level_turn(seed, mounted=mounted)
        fit = flinders.fit(recording.samples.field)
        assert fit.evidence.method == "level"
        headings = np.linspace(0.0, 2 * np.pi, 600, endpoint=False)
        exact = FIELD_STRENGTH * recording.directions @ recording.sensor.matrix.T + recording.sensor.offset
        corrected = fit.calibration.apply(exact)
        phasors = np.exp(1j * (np.arctan2(-corrected[:, 1], corrected[:, 0]) - headings))
        weighed.append(rms(np.degrees(np.angle(phasors / phasors.mean())).tolist()) / fit.heading_error_deg.rms)
    low, high = claim.ratios(0.5, 1.5)
    assert low < rms(weighed) < high


def test_a_file_an_array_and_blocks_give_the_same(tmp_path: Path) -> None:
    samples = level_turn(5, n=3000).samples
    path = tmp_path / "boat.csv"
    rows = "".join(f"{x!r},{y!r},{z!r}\n" for x, y, z in samples.field.tolist())
    path.write_text("mx_uT,my_uT,mz_uT\n" + rows, encoding="utf-8")
    array = flinders.fit(samples)
    file = flinders.fit(flinders.read(path))
    blocks = flinders.fit(Streamed(samples))
    assert {fit.evidence.method for fit in (array, file, blocks)} == {"level"}
    for other in (file, blocks):
        npt.assert_allclose(other.calibration.offset, array.calibration.offset, atol=1e-7)
        npt.assert_allclose(other.calibration.matrix, array.calibration.matrix, atol=1e-9)
        npt.assert_allclose(other.claim.covariance, array.claim.covariance, rtol=1e-5, atol=1e-8)
        assert codes(other) == codes(array)


def test_two_level_turns_are_one_as_good_as_both() -> None:
    one, other = level_turn(4), level_turn(4)
    both = Joined((one.samples, replace_noise(other)))
    alone, together = flinders.fit(one.samples), flinders.fit(both)
    assert together.evidence.method == "level"
    assert together.heading_error_deg.rms == pytest.approx(alone.heading_error_deg.rms / np.sqrt(2.0), rel=0.2)


def replace_noise(recording: Simulated) -> Samples:
    """The same turn of the same sensor, read once more."""
    rng = np.random.default_rng(99)
    return Samples.of(recording.sensor.read(FIELD_STRENGTH * recording.directions, rng), unit="uT")


def test_where_only_z_is_stuck_auto_points_to_level_and_level_fits_x_and_y() -> None:
    """A z that never changes may be broken: to do without it has to be asked for."""
    recording = level_turn(6)
    field = recording.samples.field.copy()
    field[:, 2] = 12.5
    with assert_raises(StuckAxis, axes=("z",)) as caught:
        flinders.fit(field)
    assert caught.value.axes == ("z",)
    fit = flinders.fit(field, method="level")
    assert (fit.verdict, codes(fit)[0]) == ("limited", "level-plane")
    assert "saturated" not in codes(fit)
    plain = flinders.fit(recording.samples.field)
    npt.assert_allclose(fit.calibration.matrix[:2, :2], plain.calibration.matrix[:2, :2], rtol=1e-6)
    npt.assert_allclose(fit.calibration.offset[:2], plain.calibration.offset[:2], atol=1e-6)


@pytest.mark.parametrize("stuck", ["x", "y"])
def test_a_stuck_x_or_y_is_refused_by_level_too(stuck: str) -> None:
    field = level_turn(6).samples.field.copy()
    field[:, "xyz".index(stuck)] = 12.5
    for method in ("auto", "level"):
        with pytest.raises(StuckAxis, match=f"{stuck} = 12.5") as caught:
            flinders.fit(field, method=method)
        assert "'level'" not in str(caught.value)


def test_readings_without_noise_give_the_truth_to_rounding() -> None:
    for seed in range(10):
        recording = level_turn(seed, noise=0.0)
        fit = flinders.fit(recording.samples.field)
        assert fit.evidence.method == "level"
        assert heading_error_deg(fit.calibration.matrix, fit.calibration.offset, recording) < 1e-6


def test_readings_on_a_line_are_no_level_turn() -> None:
    line = np.linspace(-1.0, 1.0, 200)[:, np.newaxis] * [30.0, 40.0, 0.0]
    line += 1e-3 * np.random.default_rng(1).standard_normal(line.shape) * [0.0, 0.0, 1.0]
    with pytest.raises(NotAnEllipsoid):
        Level().estimate(Readings.of(line))


def test_no_turn_at_all_is_not_made_into_one() -> None:
    """A tumble fitted as a level turn on demand: the noise about its ellipse gives it away."""
    fit = judged(simulate.tumble(seed=1, motion="uniform").samples.field, method="level")
    assert fit.verdict != "good"
    assert "noise" in codes(fit)


def test_auto_leaves_all_attitudes_to_the_ellipsoid() -> None:
    """Turns on deck, tilted by up to 15°, are no level turn."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        attitudes = simulate.tilted(rng, 1000, tilt_deg=15.0)
        sensor = Sensor.random(rng)
        raw = sensor.read(FIELD_STRENGTH * simulate.in_body_axes(attitudes, FIELD), rng)
        assert judged(raw).evidence.method == "likelihood"
