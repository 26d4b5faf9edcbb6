"""A sensor that was hardly turned is refused for that alone; one that was turned, however little, never is."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.core.samples import Samples
from flinders.diagnostics.unmoved import unmoved_deg
from flinders.errors import FitError, Unmoved
from flinders.fitting.result import Refused
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from pathlib import Path

    from tests.trials import Choose

    from flinders.arrays import Floats

FIELD: Final = 50.0
FALSEHOODS: Final = ("sphere", "columns", "axis", "heading may be off", "about the ellipsoid", "limit", "repeat")
"""Words of findings that follow from a fit to noise."""


def handled(
    seed: int,
    *,
    wobble_deg: float = 0.0,
    noise: float = 0.3,
    iron: float = 0.0,
    drift: float = 0.0,
    count: float = 0.0,
    n: int = 1500,
    kind: str = "both",
) -> tuple[Floats, Floats]:
    """(n, 3) µT of a sensor in one attitude, wobbled about one axis or two, and its offset (3,).

    Iron is in field strengths, a drift in µT along two directions at unlike pace, a count in µT.
    """
    rng = np.random.default_rng(seed)
    up, across, along = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    time = np.linspace(0.0, 30.0, n)[:, np.newaxis]
    angle = math.radians(wobble_deg)
    directions = up + angle * np.sin(1.9 * time) * across
    if kind == "both":
        directions = directions + angle * np.sin(1.1 * time + 1.0) * along
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    offset = rng.normal(size=3)
    offset *= iron * FIELD / np.linalg.norm(offset)
    warming = drift * (np.exp(-time / 10.0) * across + 0.3 * time / 30.0 * along)
    field = offset + FIELD * directions + warming + noise * rng.standard_normal((n, 3))
    return np.asarray(np.round(field / count) * count if count else field, np.float64), offset


def code_of(field: Floats, unit: str = "counts", **options: object) -> str:
    """The code of the error; the verdict where there is none."""
    try:
        return flinders.fit(Samples.of(field, unit=unit), **options).verdict  # type: ignore[arg-type]
    except FitError as error:
        return error.code


@pytest.mark.parametrize("iron", [0.0, 1.0, 10.0])
@pytest.mark.parametrize("noise", [0.05, 0.3, 2.0])
def test_a_still_sensor_is_unmoved_whatever_its_noise_and_iron(noise: float, iron: float, trials: Choose) -> None:
    for seed in trials(25, 1).seeds:
        assert code_of(handled(seed, noise=noise, iron=iron)[0], "uT") == "unmoved"
        if iron != 1.0:  # as strong as the field it may cancel it, and of counts nothing else is known
            assert code_of(handled(seed, noise=noise, iron=iron)[0] * 13.7) == "unmoved"


@pytest.mark.parametrize("n", [60, 20_000])
def test_of_few_readings_and_of_many(n: int, trials: Choose) -> None:
    assert all(code_of(handled(seed, n=n)[0]) == "unmoved" for seed in trials(25, 1).seeds)


@pytest.mark.parametrize(("noise", "count"), [(0.1, 0.15), (0.1, 0.5), (0.3, 0.15), (0.3, 1.0)])
def test_a_still_sensor_whose_readings_flicker_by_counts_is_no_sensor_at_its_limit(
    noise: float, count: float, trials: Choose
) -> None:
    assert all(code_of(handled(seed, noise=noise, count=count)[0]) == "unmoved" for seed in trials(25, 1).seeds)


@pytest.mark.parametrize(("noise", "drift"), [(0.05, 0.5), (0.3, 0.5), (0.3, 2.0), (0.3, 5.0)])
def test_a_still_sensor_that_drifts_is_unmoved(noise: float, drift: float, trials: Choose) -> None:
    assert all(code_of(handled(seed, noise=noise, drift=drift)[0]) == "unmoved" for seed in trials(25, 1).seeds)


@pytest.mark.parametrize("kind", daily(["one", "both"]))
@pytest.mark.parametrize("iron", [0.0, 10.0])
@pytest.mark.parametrize("wobble_deg", [1.0, 3.0])
def test_a_sensor_that_was_wobbled_is_unmoved(wobble_deg: float, iron: float, kind: str, trials: Choose) -> None:
    for seed in trials(25, 1).seeds:
        field, _ = handled(seed, wobble_deg=wobble_deg, iron=iron, kind=kind)
        assert {code_of(field, "uT"), code_of(field)} == {"unmoved"}


@pytest.mark.parametrize("iron", [0.0, 1.0, 10.0])
@pytest.mark.parametrize("wobble_deg", [0.0, 3.0])
def test_the_angle_in_microtesla_is_that_from_the_true_centre(wobble_deg: float, iron: float, trials: Choose) -> None:
    """But for the range of the Earth's field."""
    for seed in trials(25, 1).seeds:
        field, offset = handled(seed, wobble_deg=wobble_deg, iron=iron)
        directions = (field - offset) / np.linalg.norm(field - offset, axis=1, keepdims=True)
        mean = directions.mean(axis=0) / np.linalg.norm(directions.mean(axis=0))
        true = math.degrees(math.acos(float((directions @ mean).min())))
        found = unmoved_deg(Summary.of(field), "uT")
        if found is not None:
            assert found / true > 0.95 * FIELD / 67.0
            assert found / true < 1.5 * FIELD / 22.0  # noise along the field counts as well
        else:
            assert wobble_deg > 0.0
            assert iron == 1.0  # an offset against the field, beside which 3° look like 7°


@pytest.mark.parametrize("motion", simulate.MOTIONS)
def test_a_sensor_that_was_turned_is_not_called_still(motion: str, trials: Choose) -> None:
    """Tumbles, level turns, tilts of a few degrees, drives and rests, also in coarse counts."""
    for seed in trials(25, 1).seeds:
        turned = simulate.tumble(seed=seed, motion=motion, stationary=0.3 if seed % 2 else 0.0).samples.field
        offset = np.random.default_rng(seed).normal(size=3)
        for iron in (0.0, 1.0, 10.0):
            field = turned + iron * FIELD * offset / np.linalg.norm(offset)
            for one in (field, np.round(field / 2.0) * 2.0):
                summary = Summary.of(one)
                assert unmoved_deg(summary, "uT") is None
                assert unmoved_deg(summary, "counts") is None


@pytest.mark.parametrize("tilt_deg", [0.0, 5.0])
@pytest.mark.parametrize("iron", [0.0, 10.0])
def test_a_vehicle_that_tilts_by_five_degrees_is_not_called_still(tilt_deg: float, iron: float, trials: Choose) -> None:
    for seed in trials(25, 1).seeds:
        field = simulate.tumble(seed=seed, motion="tilted", tilt_deg=tilt_deg, n=1000, dip_deg=70.0).samples.field
        field = field + iron * FIELD * np.array([0.6, 0.0, 0.8])
        assert unmoved_deg(Summary.of(field), "uT") is unmoved_deg(Summary.of(field), "counts") is None


@pytest.mark.parametrize("half_deg", [15.0, 30.0])
@pytest.mark.parametrize("noise", [0.05, 0.3])
def test_a_patch_of_directions_is_not_called_still(half_deg: float, noise: float, trials: Choose) -> None:
    for seed in trials(25, 1).seeds:
        rng = np.random.default_rng(seed)
        height = rng.uniform(math.cos(math.radians(half_deg)), 1.0, 1500)
        turn = rng.uniform(0.0, 2.0 * np.pi, 1500)
        across = np.sqrt(1.0 - height**2)
        directions = np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
        field = rng.uniform(-30.0, 30.0, 3) + FIELD * directions + noise * rng.standard_normal((1500, 3))
        assert unmoved_deg(Summary.of(field), "uT") is unmoved_deg(Summary.of(field), "counts") is None


def test_a_full_turn_amid_a_long_rest_is_not_called_still(trials: Choose) -> None:
    for seed in trials(25, 1).seeds:
        turn = simulate.tumble(seed=seed, n=1000).samples.field + np.array([600.0, 0.0, 0.0])
        rest = turn[0] + 0.3 * np.random.default_rng(seed).standard_normal((9000, 3))
        assert unmoved_deg(Summary.of(np.concatenate([rest, turn])), "counts") is None


def test_a_turn_of_another_unit_is_not_called_still(trials: Choose) -> None:
    """In gauss that are taken for microtesla the whole field is half of one."""
    for seed in trials(25, 1).seeds:
        assert unmoved_deg(Summary.of(simulate.tumble(seed=seed).samples.field / 100.0), "uT") is None


@pytest.mark.parametrize("method", ["auto", "consistent", "robust", "minmax"])
def test_every_method_says_so_and_nothing_else(method: str) -> None:
    with pytest.raises(Unmoved) as caught:
        flinders.fit(Samples.of(handled(1)[0], unit="uT"), method=method)
    assert not isinstance(caught.value, Refused)
    assert_sentences(str(caught.value))
    assert 1.0 < caught.value.angle_deg < 2.0
    assert dict(caught.value.evidence) == {"angle_deg": caught.value.angle_deg}


@pytest.mark.parametrize("method", ["level", "ellipse"])
def test_methods_of_a_plane_ask_for_a_turn_in_it(method: str) -> None:
    with assert_raises(Unmoved):
        flinders.fit(Samples.of(handled(1)[0], unit="uT"), method=method)


def test_sums_alone_tell_it() -> None:
    with pytest.raises(Unmoved):
        flinders.fit(Summary.of(handled(2)[0]))


@pytest.fixture
def still(tmp_path: Path) -> str:
    """A file of a sensor that lay on a table, in coarse counts of 0.15 µT."""
    path = tmp_path / "still.csv"
    field, _ = handled(3, noise=0.1, count=0.15)
    rows = np.column_stack([np.arange(len(field)) / 50.0, field])
    np.savetxt(path, rows, delimiter=",", header="time_s,mag_x_uT,mag_y_uT,mag_z_uT", comments="", fmt="%.4f")
    return str(path)


def test_the_terminal_says_one_thing(still: str) -> None:
    ended = CliRunner().invoke(main, ["calibrate", still])
    assert ended.exit_code == 4
    told = [line for line in ended.stderr.splitlines() if line.startswith("refused: ")]
    assert_sentences(told)
    assert not any(word in ended.stderr.partition("\n")[2] for word in FALSEHOODS)


def test_info_says_one_thing(still: str) -> None:
    ended = CliRunner().invoke(main, ["info", still])
    assert ended.exit_code == 0
    marked = [line for line in ended.stdout.splitlines() if line.lstrip().startswith("!")]
    assert len(marked) == 1
    assert_sentences(marked[0])
    assert not any(word in ended.stdout.partition("readings")[2] for word in FALSEHOODS)
    sensor = json.loads(CliRunner().invoke(main, ["info", still, "--json"]).stdout)["sensors"][0]
    assert (sensor["coverage"], sensor["strength"], sensor["rails"]) == (None, None, [])


def exact(n: int = 3000, *, resolution: float = 0.0) -> Floats:
    """A slow tumble without noise, to a resolution in µT."""
    truth = simulate.tumble(seed=5, n=n, noise=0.0, motion="hand" if n > 1000 else "uniform").samples.field
    return np.asarray(np.round(truth / resolution) * resolution if resolution else truth, np.float64)


@pytest.mark.parametrize("n", [200, 3000, 20_000])
@pytest.mark.parametrize("offset", [0.0, 500.0])
@pytest.mark.parametrize("kept", daily([np.float64, np.float32]))
def test_a_recording_without_noise_is_good(n: int, offset: float, kept: type) -> None:
    """To the digits of double and of single precision: rounding says nothing of how readings hang together."""
    fit = flinders.fit((exact(n) + np.array([offset, 0.0, -offset])).astype(kept))
    assert fit.verdict == "good"
    assert fit.evidence.residuals.independent_samples > 0.99 * n  # a turn by hand has its pauses
    always = {"unit-unknown", "scale-unknown", "rotation-unknown"}
    codes = {finding.code for finding in fit.findings} - {"outliers"}  # the mean of a pause is off by 1e-5 of the field
    assert codes == always | ({"unordered"} if n == 200 else set())


@pytest.mark.parametrize("resolution", [1e-6, 1e-4, 0.01, 0.15, 1.0])
def test_a_recording_that_is_exact_to_its_resolution_is_good(resolution: float) -> None:
    fit = flinders.fit(exact(resolution=resolution))
    assert fit.verdict == "good"
    assert fit.evidence.residuals.independent_samples > 100


def test_noise_that_hangs_together_is_still_seen_just_above_the_floor() -> None:
    """Of two thousandths of a per cent of the field, which follows itself from reading to reading."""
    rng = np.random.default_rng(1)
    shaken = np.cumsum(rng.standard_normal((3000, 1)), axis=0)
    shaken = 1e-3 * (shaken - np.convolve(shaken[:, 0], np.ones(51) / 51, mode="same")[:, np.newaxis]) / shaken.std()
    field = exact()
    fit = flinders.fit(field * (1.0 + shaken / FIELD))
    assert fit.evidence.residuals.independent_samples < 1500


def test_the_terminal_calls_a_recording_without_noise_good(tmp_path: Path) -> None:
    path = tmp_path / "exact.csv"
    np.savetxt(path, exact(), delimiter=",", header="mag_x_uT,mag_y_uT,mag_z_uT", comments="", fmt="%.17g")
    ended = CliRunner().invoke(main, ["calibrate", str(path)])
    assert ended.exit_code == 0
    assert "GOOD" in ended.output
    assert "independent" not in ended.output
