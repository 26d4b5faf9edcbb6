"""Filters: what they take off, what they bend, by how much, and that the program says so."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from click.testing import CliRunner
from tests.sentences import assert_sentences
from tests.trials import daily

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.core.samples import Samples
from flinders.fitting.filtering import filtered_finding
from flinders.heading.error_propagation import level_turn
from flinders.heading.smoothing import MAX_REJECTED, NAMES, Filter, Name, filter_recording

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from click.testing import Result
    from tests.trials import Choose

    from flinders.arrays import Floats

BARE: Final = simulate.Sensor(offset=np.array([20.0, 120.0, 90.0]))
ALL: Final = pytest.mark.parametrize("name", NAMES)


def passed(field: Floats, by: Filter, *, time: Floats | None = None) -> Floats:
    samples = Samples(field, time=time)
    return np.concatenate([block.field for block in filter_recording(samples, by).blocks()])


def circle(step_deg: float, rows: int = 4000) -> Floats:
    angle = np.deg2rad(step_deg) * np.arange(rows) + 0.1
    return 50.0 * np.stack([np.cos(angle), np.sin(angle), np.zeros(rows)], axis=1)


def off_deg(fit: flinders.Fit, sensor: simulate.Sensor) -> float:
    """Heading error (rms) in degrees of a level vehicle at dip 60°, the mean removed."""
    _, directions = level_turn(60.0)
    raw = sensor.offset[:, np.newaxis] + 50.0 * sensor.matrix @ directions
    matrix, offset = sensor.correction
    found = fit.calibration.matrix @ (raw - fit.calibration.offset[:, np.newaxis])
    true = matrix @ (raw - offset[:, np.newaxis])
    error = np.angle(np.exp(1j * (np.arctan2(-found[1], found[0]) - np.arctan2(-true[1], true[0]))))
    return float(np.degrees(np.std(error)))


def run(*words: str) -> Result:
    return CliRunner().invoke(main, words)


def written(path: Path, field: Floats, time: Floats | None = None) -> str:
    columns = field if time is None else np.column_stack([time, field])
    header = "mx_uT,my_uT,mz_uT" if time is None else "time_s,mx_uT,my_uT,mz_uT"
    np.savetxt(path, columns, delimiter=",", fmt="%.6f", header=header, comments="")
    return str(path)


# What a uniform turn loses.


@pytest.mark.parametrize("step_deg", daily([0.5, 2.0, 5.0, 10.0, 20.0, 30.0], 3))
@pytest.mark.parametrize("width", daily([3, 5, 9, 21], 2))
@pytest.mark.parametrize("name", ["moving-average", "kalman"])
def test_a_mean_and_a_kalman_filter_shrink_a_circle_by_their_formula(name: Name, width: int, step_deg: float) -> None:
    by = Filter(name, width)
    radii = np.linalg.norm(passed(circle(step_deg), by)[300:-300], axis=1)
    npt.assert_allclose(radii, 50.0 * by.remaining_share(step_deg), atol=1e-6)


@pytest.mark.parametrize(("width", "step_deg"), [(5, 0.5), (9, 1.0), (21, 1.0), (41, 2.0), (5, 10.0), (9, 20.0)])
def test_a_median_cuts_the_ends_of_each_axis_off(width: int, step_deg: float) -> None:
    """At cos((w − 1)θ/4) of the radius, to one step; what is nowhere near an end stays as it was."""
    by = Filter("median", width)
    field = circle(step_deg)
    out = passed(field, by)[100:-100]
    ends = np.abs(out[:, :2]).max(axis=0) / 50.0
    step = np.deg2rad(step_deg)
    cut = np.arccos(by.remaining_share(step_deg))
    assert np.all(ends <= np.cos(cut) + 1e-12)
    assert np.all(ends >= np.cos(cut + step) - 1e-12)
    inner = np.abs(field[100:-100, :2]) < 50.0 * np.cos(2.0 * cut + step)
    npt.assert_array_equal(out[:, :2][inner], field[100:-100, :2][inner])


@ALL
@pytest.mark.parametrize("width", daily([5, 15, 45]))
def test_a_constant_field_gets_as_quiet_as_the_mean_of_its_width(name: Name, width: int) -> None:
    """Variance 1/width, of the median π/2 times that where it is wide."""
    noise = np.random.default_rng(1).normal(size=(20_000, 3))
    variance = passed(noise + 40.0, Filter(name, width))[200:-200].var()
    expected = {5: 1.434, 15: 1.526, 45: 1.557}[width] if name == "median" else 1.0
    assert variance * width == pytest.approx(expected, rel=0.06)


@pytest.mark.parametrize("name", ["moving-average", "kalman"])
def test_what_cannot_wait_is_late_by_half_the_width(name: Name) -> None:
    """On a ramp, and in the phase of a slow turn."""
    by = Filter(name, 9)
    ramp = np.arange(400.0)[:, np.newaxis] * [1.0, -2.0, 0.5]
    late = (ramp - by.start(centred=False).push(ramp).field)[200:] / [1.0, -2.0, 0.5]
    npt.assert_allclose(late, by.lag, rtol=1e-9)
    assert by.lag == 4.0


# What that does to a calibration.


def rings(steps_deg: tuple[float, float, float], by: Filter | None) -> Floats:
    """Turns about x, y and z, each at its own rate and at three heights, each filtered on its own; no soft iron."""
    rng = np.random.default_rng(1)
    parts = []
    for axis, step in enumerate(steps_deg):
        angle = np.deg2rad(step) * np.arange(int(720 / step))
        for height in (-0.6, 0.0, 0.6):
            flat = np.sqrt(1.0 - height**2)
            turn = np.stack([flat * np.cos(angle), flat * np.sin(angle), np.full(len(angle), height)], axis=1)
            field = BARE.offset + 50.0 * np.roll(turn, axis + 1, axis=1) + 0.1 * rng.standard_normal(turn.shape)
            parts.append(field if by is None else passed(field, by))
    return np.concatenate(parts)


@pytest.mark.parametrize(
    ("by", "steps_deg", "radius", "heading_deg"),
    [
        (None, (8.0, 8.0, 2.0), 50.00, (0.00, 0.02)),
        ("moving-average:5", (2.0, 2.0, 2.0), 49.95, (0.00, 0.03)),
        ("moving-average:5", (8.0, 8.0, 8.0), 49.29, (0.00, 0.08)),
        ("moving-average:5", (8.0, 8.0, 2.0), 49.71, (0.00, 0.05)),
        ("moving-average:5", (2.0, 8.0, 8.0), 49.71, (0.15, 0.25)),
        ("median:5", (2.0, 8.0, 8.0), 49.97, (0.03, 0.07)),
        ("kalman:5", (2.0, 8.0, 8.0), 49.23, (0.4, 0.6)),
    ],
)
def test_turns_at_unlike_rates_are_bent_into_a_false_soft_iron(
    by: str | None, steps_deg: tuple[float, float, float], radius: float, heading_deg: tuple[float, float]
) -> None:
    """Points are pulled inside unevenly; the offset, by symmetry, stays. Of z alone a level heading sees nothing."""
    fit = flinders.fit(rings(steps_deg, None if by is None else Filter.of(by)), method="algebraic", target_deg=20.0)
    off = off_deg(fit, BARE)
    assert fit.calibration.ellipsoid.radius == pytest.approx(radius, abs=0.02)
    assert heading_deg[0] <= off < heading_deg[1]
    npt.assert_allclose(fit.calibration.offset, BARE.offset, atol=0.1)


@pytest.mark.parametrize(
    ("rate_hz", "by", "radius", "true_deg"),
    daily(
        [
            (50.0, None, 0.0, 0.08),
            (50.0, "moving-average:5", 0.10, 0.11),
            (50.0, "median:5", 0.03, 0.08),
            (50.0, "kalman:5", 0.29, 0.22),
            (25.0, "moving-average:5", 0.40, 0.18),
            (25.0, "kalman:5", 1.14, 0.42),
            (10.0, None, 0.0, 0.10),
            (10.0, "moving-average:5", 2.93, 1.0),
            (10.0, "median:5", 0.38, 0.27),
            (10.0, "kalman:5", 6.1, 1.9),
        ],
        3,
    ),
)
def test_a_tumble_by_hand_shrinks_and_its_claim_stays_honest(
    rate_hz: float, by: str | None, radius: float, true_deg: float, trials: Choose
) -> None:
    """2.3° a reading at 50 Hz, 10° at 10 Hz: the true error over the claimed one (rms over 12 seeds) is 0.6 to 1.3."""
    off, claimed, shrunk, claim = [], [], [], trials(12, 4)
    for seed in claim.seeds:
        made = simulate.tumble(seed=seed, motion="hand", n=1500, rate_hz=rate_hz, noise=0.5)
        recording = made.samples if by is None else filter_recording(made.samples, Filter.of(by))
        fit = flinders.fit(recording, target_deg=30.0)
        off.append(off_deg(fit, made.sensor))
        claimed.append(fit.heading_error_deg.rms)
        shrunk.append(50.0 * np.cbrt(np.linalg.det(made.sensor.matrix)) - fit.calibration.ellipsoid.radius)
    low, high = claim.ratios(0.5, 1.6)
    assert np.mean(shrunk) == pytest.approx(radius, abs=(0.03 + 0.1 * radius) * claim.widening)
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(true_deg, rel=0.15 * claim.widening)
    assert low < np.sqrt(np.mean(np.square(np.divide(off, claimed)))) < high


# Spikes, and fields that really change.


@pytest.mark.parametrize("name", ["median", "kalman"])
def test_spikes_do_not_come_through(name: Name) -> None:
    rng = np.random.default_rng(4)
    field = circle(0.5) + 0.3 * rng.standard_normal((4000, 3))
    struck = np.arange(50, 4000, 40)
    field[struck] += 100.0 * rng.choice([-1.0, 1.0], size=(len(struck), 3))
    stream = Filter(name).start(centred=True)
    through = stream.push(field) + stream.finish()
    assert np.abs(through.field - circle(0.5)).max() < 4.0
    if name == "kalman":
        npt.assert_array_equal(np.flatnonzero(~through.accepted), struck)
        assert stream.dropped == len(struck)


@pytest.mark.nightly
def test_noise_alone_is_hardly_ever_dropped() -> None:
    """The gate is that of once in ten thousand; the scale is estimated, which makes it a little more."""
    stream = Filter("kalman", 9).start(centred=True)
    stream.push(np.random.default_rng(2).normal(size=(100_000, 3)))
    assert 2 <= stream.dropped <= 40


@pytest.mark.parametrize("jump", [5.0, 50.0, 5000.0])
def test_a_field_that_has_really_changed_is_followed(jump: float) -> None:
    """A magnet is put down, and taken away again: after three readings the filter is there, each time."""
    rng = np.random.default_rng(3)
    true = np.full((600, 3), 30.0)
    true[200:400] += jump
    stream = Filter("kalman", 9).start(centred=False)
    through = stream.push(true + 0.3 * rng.standard_normal(true.shape))
    late = [slice(200 + MAX_REJECTED, 400), slice(400 + MAX_REJECTED, 600)]
    for rows in late:
        assert np.abs(through.field[rows] - true[rows]).max() < 1.8
    assert stream.restarts == 2
    assert {200, 201, 400, 401} <= set(np.flatnonzero(~through.accepted).tolist())
    assert stream.dropped <= 6


@pytest.mark.parametrize("step_deg", [3.0, 10.0, 45.0, 120.0])
def test_a_turn_that_begins_after_a_rest_does_not_lock_the_filter_out(step_deg: float) -> None:
    rest = np.repeat(circle(step_deg, 1), 300, axis=0)
    field = np.concatenate([rest, circle(step_deg, 500)]) + 0.1 * np.random.default_rng(5).standard_normal((800, 3))
    stream = Filter("kalman", 5).start(centred=True)
    through = stream.push(field)
    assert through.accepted[320:].all()
    radii = np.linalg.norm(through.field[400:, :2], axis=1)
    npt.assert_allclose(radii, 50.0 * Filter("kalman", 5).remaining_share(step_deg), atol=1.0)


def test_values_that_never_changed_do_not_make_the_gate_shut() -> None:
    """A coarse converter at rest: no scale of innovations is known."""
    field = np.full((300, 3), 12.0)
    field[100:] += np.random.default_rng(1).integers(-1, 2, size=(200, 3))
    stream = Filter("kalman").start(centred=True)
    assert stream.push(field).accepted[103:].all()


def test_a_clock_without_pauses_is_not_cut() -> None:
    """Readings that come in bursts of five, with time stamps of whole milliseconds, and some times missing."""
    time = np.round(np.repeat(np.arange(200) * 0.1, 5), 3)
    time[[50, 51, 700]] = np.nan
    stream = Filter("median").start(centred=True)
    stream.push(circle(1.0, 1000), time)
    assert stream.restarts == 0
    gone = time.copy()
    gone[500:] += 8.0
    stream = Filter("median").start(centred=True)
    stream.push(circle(1.0, 1000), gone)
    assert stream.restarts == 1


@pytest.mark.parametrize(
    ("name", "moved_deg"),
    daily(
        [
            ("michaelwro_fxos8700/mag-readings.txt", {"median": 1.8, "moving-average": 5.1, "kalman": 13.7}),
            ("sunsided_hmc5883l/full-sphere.csv", {"median": 0.036, "moving-average": 0.065, "kalman": 0.27}),
        ]
    ),
)
def test_real_recordings_are_bent_by_how_far_a_reading_turns(
    name: str, moved_deg: dict[Name, float], recordings: Callable[[str], Path]
) -> None:
    """By 13° and by 0.4° from one to the next."""
    path = str(recordings(name))
    for by, wanted in moved_deg.items():
        ended = run("calibrate", path, "--filter", by, "--target", "10", "--json")
        finding = next(entry for entry in json.loads(ended.stdout)["findings"] if entry["code"] == "filtered")
        assert finding["number"] == pytest.approx(wanted, rel=0.2)


# On the command line.


def test_calibrate_says_what_the_filter_did(tmp_path: Path) -> None:
    made = simulate.tumble(seed=2, motion="hand", n=3000, rate_hz=200.0)
    slow = written(tmp_path / "slow.csv", made.samples.field)
    ended = run("calibrate", slow, "--filter", "median", "--json")
    note = next(finding for finding in json.loads(ended.stdout)["findings"] if finding["code"] == "filtered")
    assert (ended.exit_code, note["severity"]) == (0, "note")
    assert 0.0 < note["number"] <= note["limit"]
    assert_sentences(note["advice"])

    fast = written(tmp_path / "fast.csv", simulate.tumble(seed=2, motion="hand", n=3000).samples.field)
    ended = run("calibrate", fast, "--filter", "kalman", "--json")
    limit = next(finding for finding in json.loads(ended.stdout)["findings"] if finding["code"] == "filtered")
    assert (ended.exit_code, limit["severity"]) == (3, "limits")
    assert limit["number"] > limit["limit"]
    assert_sentences(limit["advice"])


def test_a_filter_that_spoils_a_good_recording_is_told_with_the_refusal(tmp_path: Path) -> None:
    """Readings in any order: their means lie anywhere inside."""
    path = written(tmp_path / "any.csv", simulate.tumble(seed=3, motion="uniform", n=500).samples.field)
    assert run("calibrate", path).exit_code == 0
    ended = run("calibrate", path, "--filter", "moving-average")
    assert ended.exit_code == 4
    assert_sentences(" ".join(ended.output.split()))


def test_spikes_spoil_extremes_and_a_median_saves_them(tmp_path: Path) -> None:
    sensor = simulate.Sensor(np.diag([0.9, 1.0, 1.2]), np.array([20.0, 120.0, 90.0]), 0.3)
    field = simulate.tumble(seed=5, motion="hand", n=6000, rate_hz=100.0, sensor=sensor).samples.field.copy()
    rng = np.random.default_rng(1)
    field[rng.choice(6000, 20, replace=False)] += rng.normal(size=(20, 3)) * 200.0
    path = written(tmp_path / "spikes.csv", field)
    assert run("calibrate", path, "--method", "minmax").exit_code == 4
    ended = run("calibrate", path, "--method", "minmax", "--filter", "median", "--target", "3", "--json")
    found = json.loads(ended.stdout)
    assert ended.exit_code == 3
    npt.assert_allclose(found["calibration"]["offset"], sensor.offset, atol=1.0)
    assert "filtered" in [finding["code"] for finding in found["findings"]]


def test_a_filter_does_not_invent_what_single_readings_never_did(tmp_path: Path) -> None:
    """A median of so many readings repeats itself."""
    path = written(tmp_path / "plain.csv", simulate.tumble(seed=2, motion="hand").samples.field)
    ended = run("calibrate", path, "--filter", "median:99", "--json")
    codes = [finding["code"] for finding in json.loads(ended.stdout)["findings"]]
    assert "filtered" in codes
    assert "stale-repeats" not in codes


def test_a_filter_does_not_hide_a_sensor_at_its_limit(tmp_path: Path) -> None:
    sensor = simulate.Sensor(offset=np.array([20.0, 10.0, 5.0]), noise=0.3, saturation=60.0)
    made = simulate.tumble(seed=5, motion="hand", n=6000, rate_hz=200.0, sensor=sensor)
    path = written(tmp_path / "railed.csv", made.samples.field)
    plain, smooth = (
        json.loads(run("calibrate", path, *words, "--json").stdout) for words in ((), ("--filter", "moving-average"))
    )
    for found in (plain, smooth):
        assert "saturated" in [finding["code"] for finding in found["findings"]]
        npt.assert_allclose(found["calibration"]["offset"], sensor.offset, atol=0.3)


def test_a_finding_without_anything_to_hold_it_against_is_a_limit() -> None:
    fit = flinders.fit(simulate.tumble(seed=1).samples)
    finding = filtered_finding(fit, None, Filter("kalman"), 12)
    assert (finding.severity, finding.number) == ("limits", 180.0)
    assert "12 readings dropped" in finding.advice


def calibrated(folder: Path) -> str:
    made = simulate.tumble(seed=2, motion="hand", n=2000)
    flinders.fit(made.samples).save(folder / "c.json")
    return str(folder / "c.json")


@ALL
def test_apply_filters_a_stream_and_keeps_its_lines(name: Name, tmp_path: Path) -> None:
    """As many lines, the same times; a pause starts it afresh; what comes out rests on what came before alone."""
    calibration = calibrated(tmp_path)
    made = simulate.tumble(seed=2, motion="hand", n=400)
    assert made.samples.time is not None
    time = made.samples.time + np.where(np.arange(400) >= 250, 60.0, 0.0)
    raw = written(tmp_path / "raw.csv", made.samples.field, time)
    out = tmp_path / "out.csv"
    ended = run("apply", calibration, raw, "-o", str(out), "--filter", name, "--json")
    assert ended.exit_code == 0, ended.output
    fields = json.loads(ended.stdout)["filter"]
    assert (fields["name"], fields["lag_readings"], fields["restarts"]) == (name, 2.0, 1)
    rows = np.loadtxt(out, delimiter=",", skiprows=1)
    npt.assert_allclose(rows[:, 0], time, atol=1e-6)
    expected = Filter(name).start(centred=False).push(np.round(made.samples.field, 6), np.round(time, 6)).field
    npt.assert_allclose(rows[:, 1:], flinders.Calibration.load(calibration).apply(expected), atol=1e-5)


def test_heading_is_steadier_with_a_filter(tmp_path: Path) -> None:
    calibration = calibrated(tmp_path)
    sensor = simulate.tumble(seed=2, motion="hand", n=2000).sensor
    north = np.repeat([[0.3, 0.4, 0.75**0.5]], 4000, axis=0) * 50.0
    still = written(tmp_path / "still.csv", sensor.read(north, np.random.default_rng(1)))
    spread = []
    for words in ((), ("--filter", "moving-average:25")):
        out = tmp_path / f"h{len(words)}.csv"
        ended = run("heading", calibration, still, "--level", "-o", str(out), *words)
        assert ended.exit_code == 0, ended.output
        spread.append(np.loadtxt(out, delimiter=",", skiprows=1)[50:, 1].std())
    assert_sentences(ended.output)
    assert spread[0] / spread[1] == pytest.approx(5.0, rel=0.2)


@pytest.mark.parametrize(
    "value",
    [
        "mean",
        "",
        "median:4",
        "median:1",
        "kalman:2",
        "median:",
        "median:5.0",
        "median:-5",
        "median:99999999999999999999",
    ],
)
def test_a_filter_that_there_is_not_is_refused(value: str, tmp_path: Path) -> None:
    ended = run("calibrate", str(tmp_path / "any.csv"), "--filter", value)
    assert ended.exit_code == 2
    assert_sentences(ended.output)


@pytest.mark.parametrize("command", ["calibrate", "apply", "heading"])
def test_two_filters_are_refused(command: str, tmp_path: Path) -> None:
    ended = run(command, *[str(tmp_path / "any")] * 2, "--filter", "median", "--filter", "kalman:9")
    assert ended.exit_code == 2
    assert_sentences(ended.output)


def test_names_of_filters_may_be_written_in_capitals() -> None:
    assert Filter.of(" Median : 7 ") == Filter("median", 7)


def test_typed_extremes_have_no_readings_to_filter() -> None:
    ended = run("calibrate", "--minmax", "-1,1,-1,1,-1,1", "--filter", "median")
    assert ended.exit_code == 2
    assert "leave --filter out" in ended.output
