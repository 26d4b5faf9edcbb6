"""The ladder of NXP's solvers: each rung, when it is climbed, and the rules written out a second time."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.testing as npt
import pytest
from click.testing import CliRunner

import flinders
from flinders import simulate
from flinders.cli import main
from flinders.core.samples import Samples
from flinders.errors import FitError, NeedsSamples, NotAnEllipsoid, TooFewSamples
from flinders.estimators import Algebraic, Ladder, Readings, Sphere, fit_error
from flinders.estimators.reference.ladder import FULL, RUNGS, NothingAccepted, bins_of, solved
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from flinders.arrays import Floats

OFFSET: Final = np.array([20.0, 120.0, 90.0])
IRON: Final = np.array([[1.10, 0.10, 0.04], [0.10, 0.88, 0.02], [0.04, 0.02, 1.22]])


def turned(n: int, seed: int = 1, *, noise: float = 0.5, iron: Floats = IRON, field: float = 50.0) -> Floats:
    rng = np.random.default_rng(seed)
    readings: Floats = OFFSET + field * simulate.uniform(rng, n) @ iron + noise * rng.standard_normal((n, 3))
    return readings


def in_microtesla(field: Floats) -> Readings:
    return Readings.of(Samples.of(field, unit="uT"))


# The solvers.


def test_four_elements_are_a_sphere_and_ten_are_nxps_ellipsoid() -> None:
    field = turned(200)
    sphere, error = solved(field, 4, 50.0)
    assert sphere.isclose(Sphere().estimate(Readings.of(field)).ellipsoid, rtol=1e-9)
    assert error == pytest.approx(fit_error(Readings.of(field).summary.moments, sphere))
    general, _ = solved(field, 10, 50.0)
    assert general.isclose(Algebraic("nxp").estimate(Readings.of(field)).ellipsoid, rtol=1e-9)


def test_seven_elements_find_axes_without_cross_terms() -> None:
    gains = np.diag([0.9, 1.0, 1.2])
    found, error = solved(turned(150, noise=0.0, iron=gains), 7, 50.0)
    npt.assert_allclose(found.centre, OFFSET, atol=1e-8)
    npt.assert_allclose(found.shape, 50.0 * gains, atol=1e-8)
    assert error < 1e-9


@pytest.mark.parametrize("pitch_deg", [1.0, 5.0])
def test_an_open_surface_is_no_trial_though_its_determinant_is_positive(pitch_deg: float) -> None:
    """A level turn with a little pitch and no soft iron at all: ten elements often have two negative eigenvalues, which
    the sign of the determinant does not tell."""
    open_surfaces = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        yaw = np.linspace(0, 2 * np.pi, 180)
        pitch = np.deg2rad(pitch_deg) * np.sin(7 * yaw)
        north, down = math.cos(math.radians(60)), math.sin(math.radians(60))
        x = north * np.cos(yaw) * np.cos(pitch) - down * np.sin(pitch)
        z = north * np.cos(yaw) * np.sin(pitch) + down * np.cos(pitch)
        field = 50.0 * np.stack([x, -north * np.sin(yaw), z], axis=1) + 0.5 * rng.standard_normal((180, 3))
        try:
            found, _ = solved(field, 10, 50.0)
        except NotAnEllipsoid:
            open_surfaces += 1
        else:
            assert found.semi_axes[0] > 0.0
    assert open_surfaces > 0


# The rules, written out a second time: index by index, one reading at a time.


def put(held: Floats, index: NDArray[np.int64], reading: Floats, place: tuple[int, int], loop: int) -> None:
    """The four cases of the buffer: full or not, bin taken or not."""
    is_full, is_free = int((index >= 0).sum()) == FULL, index[place] == -1
    if is_full and is_free:
        ages = np.where(index >= 0, index, 10**9)
        index[np.unravel_index(int(ages.argmin()), ages.shape)] = -1
    elif not is_full and not is_free and np.abs(held[place] - reading).sum() >= 5.0:
        for other in np.ndindex(12, 24):
            if index[other] == -1:
                place = (other[0], other[1])
            elif np.abs(held[other] - reading).sum() < 5.0:
                return
    held[place], index[place] = reading, loop


def climbed(field: Floats) -> tuple[int, Floats, list[tuple[int, int]]]:
    """Elements and offset in the end, and at which reading each rung was first in use."""
    index = -np.ones((12, 24), dtype=int)
    held = np.zeros((12, 24, 3))
    edges = [math.tan(math.pi * (-0.5 + (i + 1) / 12)) for i in range(11)]
    valid, error_aged, found, first = 0, 0.0, None, []
    for loop, reading in enumerate(field):
        x, y, z = (
            reading if found is None else found.radius * np.linalg.solve(found.shape, reading - found.centre)
        ).tolist()
        j = sum(x / z >= edge for edge in edges)
        k = sum(y / z >= edge for edge in edges) + (12 if x < 0 else 0)
        put(held, index, reading, (j, k), loop)
        if (loop + 1) % 20:
            continue
        buffer = held[index >= 0]
        if len(buffer) < 40:
            continue
        error_aged *= 1.02
        solver = 4 if len(buffer) < 100 else 7 if len(buffer) < 150 else 10
        try:
            trial, error = solved(buffer, solver, 50.0)
        except (NotAnEllipsoid, np.linalg.LinAlgError):
            continue
        if not 22.0 <= trial.radius <= 67.0:
            continue
        error = max(error, {4: 0.12, 7: 0.075, 10: 0.0}[solver])
        if valid == 0 or error <= error_aged or (solver > valid and error <= 0.04):
            if solver != valid:
                first.append((loop + 1, solver))
            valid, error_aged, found = solver, max(error, 0.02), trial
    assert found is not None
    return valid, found.centre, first


@pytest.mark.parametrize(
    ("motion", "seed", "n"),
    [("hand", 1, 900), ("uniform", 2, 500), ("hemisphere", 3, 600), ("tilted", 4, 900), ("eight", 5, 900)],
)
def test_the_rules_written_out_give_the_same(motion: str, seed: int, n: int) -> None:
    field = simulate.tumble(seed=seed, motion=motion, n=n, noise=0.5).samples.field
    elements, centre, first = climbed(field)
    readings = in_microtesla(field)
    found = Ladder().estimate(readings)
    assert found.method == f"ladder {elements}"
    npt.assert_allclose(found.ellipsoid.centre, centre, atol=1e-9)
    steps = Ladder().converge(readings, steps=n)
    seen = [
        (int(steps.counts[i]), int(stage))
        for i, stage in enumerate(steps.stages)
        if stage and (i == 0 or steps.stages[i - 1] != stage)
    ]
    assert seen == first


def test_the_bins_are_twelve_by_twenty_four() -> None:
    bins = bins_of(simulate.uniform(np.random.default_rng(1), 50_000))
    assert (bins.min(), bins.max()) == (0, 287)
    assert len(np.unique(bins)) > 250


# The climb.


def test_each_rung_needs_its_readings() -> None:
    """Directions all unlike each other, so that every reading is held."""
    readings = in_microtesla(turned(400))
    steps = Ladder().converge(readings, steps=400)
    assert list(dict.fromkeys(steps.stages)) == ["", "4", "7", "10"]
    first = {stage: int(steps.counts[steps.stages.index(stage)]) for stage in ("4", "7", "10")}
    for rung in RUNGS:
        assert rung.least <= first[str(rung.elements)] <= rung.least + 60
    npt.assert_allclose(steps.parameters[-1, :3], OFFSET, atol=0.5)


def test_what_a_lower_rung_cannot_model_is_claimed_by_nobody() -> None:
    """After 60 readings a sphere is in use, and the claim knows of the soft iron that it leaves."""
    fit = flinders.fit(Samples.of(turned(60), unit="uT"), method="ladder", target_deg=60.0)
    assert fit.method == "ladder 4"
    assert np.linalg.norm(fit.calibration.offset - OFFSET) < 2.5 * np.sqrt(np.trace(fit.covariance[:3, :3]))
    assert fit.bias_deg > 1.0
    assert "bias" in [finding.code for finding in fit.findings]


@pytest.mark.parametrize("motion", ["hand", "uniform", "hemisphere"])
def test_the_claim_covers_the_error(motion: str) -> None:
    shares = []
    for seed in range(12):
        made = simulate.tumble(seed=seed, motion=motion, n=3000, noise=0.5)
        fit = flinders.fit(made.samples, method="ladder", target_deg=90.0)
        off = np.linalg.norm(fit.calibration.offset - made.sensor.offset)
        shares.append(off / np.sqrt(np.trace(fit.covariance[:3, :3])))
    assert max(shares) < 2.0
    assert np.median(shares) < 1.1


@pytest.mark.parametrize(
    ("field", "accepted"), [(10.0, False), (21.0, False), (30.0, True), (60.0, True), (70.0, False)]
)
def test_only_a_field_of_the_earth_is_accepted_and_only_where_the_unit_is_known(field: float, accepted: bool) -> None:
    readings = turned(500, field=field, noise=0.2, iron=np.eye(3))
    in_counts = Ladder().estimate(Readings.of(Samples.of(readings, unit="counts")))
    assert in_counts.ellipsoid.radius == pytest.approx(field, rel=0.02)
    if accepted:
        assert Ladder().estimate(in_microtesla(readings)).ellipsoid.radius == pytest.approx(field, rel=0.02)
        return
    with pytest.raises(NothingAccepted, match="outside the earth's 22 to 67") as caught:
        Ladder().estimate(in_microtesla(readings))
    assert caught.value.trials > 0


def test_counts_of_any_size_climb_alike() -> None:
    field = turned(800)
    one, other = (
        Ladder().estimate(Readings.of(Samples.of(size * field, unit="counts"))).ellipsoid for size in (1.0, 37.0)
    )
    npt.assert_allclose(other.centre / 37.0, one.centre, atol=1e-6)


def test_an_aged_error_lets_a_changed_offset_in() -> None:
    """Iron comes near: what is in use is good for a while, then the readings before are forgotten one by one."""
    field = turned(6000)
    field[2000:] += [15.0, 0.0, 0.0]
    found = Ladder().estimate(in_microtesla(field))
    npt.assert_allclose(found.ellipsoid.centre, OFFSET + np.array([15.0, 0.0, 0.0]), atol=0.6)


# Refusals.


def test_readings_alike_are_no_forty_readings() -> None:
    """A sensor at rest for ten minutes; and one that rocks in one place."""
    rng = np.random.default_rng(1)
    still = OFFSET + [50.0, 0.0, 0.0] + 0.3 * rng.standard_normal((3000, 3))
    with pytest.raises(NothingAccepted, match="it needs 40 unlike readings and found") as caught:
        Ladder().estimate(in_microtesla(still))
    assert caught.value.buffered < 40
    assert caught.value.evidence == {"buffered": caught.value.buffered, "trials": 0}
    with pytest.raises(FitError):
        Ladder().converge(in_microtesla(still))


def test_too_few_and_sums_are_refused() -> None:
    with pytest.raises(TooFewSamples):
        Ladder().estimate(in_microtesla(turned(39)))
    with pytest.raises(NeedsSamples, match="ladder"):
        Ladder().estimate(Readings(Summary.of(turned(500))))


def test_forty_readings_give_a_sphere_or_a_refusal() -> None:
    fit = Ladder().estimate(in_microtesla(turned(40)))
    assert (fit.method, fit.used) == ("ladder 4", 40)


def test_the_program_says_why_nothing_was_accepted(tmp_path: Path) -> None:
    path = tmp_path / "weak.csv"
    np.savetxt(path, turned(300, field=10.0), delimiter=",", fmt="%.4f", header="mx_uT,my_uT,mz_uT", comments="")
    ended = CliRunner().invoke(main, ["calibrate", str(path), "--method", "ladder", "--json"])
    assert ended.exit_code == 4
    error = json.loads(ended.stdout)["error"]
    assert error["code"] == "not-an-ellipsoid"
    assert "outside the earth's" in error["message"]
