"""The engine gives the numbers of the NumPy formulas."""

from __future__ import annotations

import ctypes
import platform
import re
import subprocess
import sys
import textwrap
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from tests.numpy_likelihood import NumpyLikelihood, foot_directions
from tests.trials import daily
from tests.worlds import SWAPS

from flinders.core.joining import Joined
from flinders.core.samples import Samples
from flinders.diagnostics.axis_swap import axis_swap_of
from flinders.estimators.auto import Auto
from flinders.estimators.consistent import Consistent
from flinders.estimators.data import Readings
from flinders.estimators.likelihood import Likelihood
from flinders.findings import c_tables
from flinders.findings.catalogue import ENGINE_FINDINGS
from flinders.fitting.record import record_of_ellipsoid
from flinders.geometry.ellipsoid import Ellipsoid
from flinders.heading.error_propagation import direction_error_deg, level_error
from flinders.likelihood import magnitude
from flinders.native import build
from flinders.native.engine import Engine, engine
from flinders.native.layouts import RECORD, layout
from flinders.summary.coverage import Coverage
from flinders.summary.moments import Moments
from flinders.summary.quality import DataQuality
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats

try:
    build.compiler()
except build.NoCompiler as error:
    pytest.skip(str(error), allow_module_level=True)


def tumble(
    rows: int, *, seed: int = 1, top: float = 1.0, noise: float = 0.5, outliers: int = 0, scale: float = 1.0
) -> Floats:
    """Readings of a sensor that saw the directions below a height, some of them thrown off."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(20 * rows, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = directions[directions[:, 2] <= top][:rows]
    field: Floats = directions * [45, 50, 55] + [20, 120, 90] + rng.normal(scale=noise, size=directions.shape)
    field[rng.choice(rows, outliers, replace=False)] += rng.normal(scale=40.0, size=(outliers, 3))
    return field * scale


def surface(record: NDArray[np.void]) -> Ellipsoid:
    xx, yy, zz, xy, xz, yz = record["shape"]
    return Ellipsoid(record["centre"], np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


WORLDS = {
    "all around": tumble(500),
    "few": tumble(11),  # of twelve and more, noise that lasts has a say
    "half a sphere": tumble(2000, top=0.0),
    "noisy half": tumble(2000, top=0.0, noise=2.0),
    "a cap": tumble(2000, top=-0.7, noise=1.0),
    "a small cap": tumble(2000, top=-0.95, noise=1.0),
    "long": tumble(50_000),
    "tesla": tumble(500, scale=1e-6),
    "counts": np.round(tumble(800, scale=10.0)),
}


@pytest.mark.parametrize("world", WORLDS)
def test_the_likelihood_has_the_same_minimum_and_covariance(world: str) -> None:
    field = WORLDS[world]
    expected = NumpyLikelihood().estimate(Readings.of(field))
    record = engine().fit(field, robust=0, level=0)
    assert record["status"] == 0
    textbook = expected.covariance if expected.textbook is None else expected.textbook
    sigma = np.sqrt(np.diag(textbook))
    found = surface(record).parameters
    # Where fifty steps do not settle a fit it shows how its start was rounded: the NumPy fit itself moves by 9e-8
    # of sigma where its start is moved by a billionth.
    limit = 1e-5 if record["steps"] == 50 else 1e-9
    npt.assert_array_less(np.abs(found - expected.ellipsoid.parameters) / sigma, limit)
    scale = np.outer(sigma, sigma)
    npt.assert_allclose(record["textbook"].reshape(9, 9) / scale, textbook / scale, atol=10 * limit)
    npt.assert_allclose(record["noise"], expected.noise, rtol=limit)
    npt.assert_allclose(record["prior_influence"], expected.prior_influence, rtol=10 * limit)
    assert record["unobserved"] == expected.unobserved


@pytest.mark.parametrize("world", WORLDS)
def test_heading_errors_follow_from_the_covariance(world: str) -> None:
    record = engine().fit(WORLDS[world], robust=0, dip_deg=-65.0)
    covariance = record["covariance"].reshape(9, 9)
    cloud = Summary.of(WORLDS[world]).cloud
    facing, is_open = engine().signed_dip(Coverage.of_cloud(cloud, surface(record)).counts, -65.0)
    dips = (-65.0, 65.0) if is_open else (facing,)
    levels = [level_error(surface(record), covariance, dip_deg=dip) for dip in dips]
    level = max(levels, key=lambda error: error.worst)
    assert record["dip_deg"] == level.dip_deg
    npt.assert_allclose([record["level_rms_deg"], record["level_worst_deg"]], [level.rms, level.worst], rtol=1e-9)
    direction = direction_error_deg(surface(record), covariance)
    record = engine().heading_errors(record, -65.0)
    assert record["level_worst_deg"] == pytest.approx(level.worst, rel=1e-9)
    npt.assert_allclose([record["direction_rms_deg"], record["direction_worst_deg"]], direction, rtol=1e-9)


def wandering(*, memory: float = 0.0, bent: float = 0.0, creep: float = 0.0) -> Floats:
    """A path over the sphere, with noise that remembers, a distortion of the direction, and an offset that creeps."""
    rng = np.random.default_rng(2)
    time = np.linspace(0.0, 60.0, 3000)
    path = np.stack([np.sin(time) * np.cos(0.13 * time), np.cos(time), np.sin(time) * np.sin(0.13 * time)], axis=1)
    noise = rng.normal(scale=0.3, size=path.shape)
    for row in range(1, len(noise)):
        noise[row] += memory * noise[row - 1]
    wave = np.stack([np.sin(3 * path[:, 0]), 0 * time, np.cos(4 * path[:, 1])], axis=1)
    drift = np.outer(np.linspace(-1.0, 1.0, 3000), [1.0, 0.0, 0.0])
    field: Floats = path * [45, 50, 55] + [20, 120, 90] + noise + bent * wave + creep * drift
    return field


@pytest.mark.parametrize(
    "field",
    daily(
        [wandering(), wandering(memory=0.9), wandering(bent=0.8), wandering(creep=0.3), tumble(30_000, noise=1.0)], 2
    ),
    ids=["white", "memory", "distortion", "creep", "long"],
)
def test_the_covariance_of_correlated_residuals_is_the_same(field: Floats) -> None:
    expected = NumpyLikelihood().estimate(Readings.of(field))
    record = engine().fit(field, robust=0)
    correlation = expected.correlation
    assert correlation is not None
    sigma = np.sqrt(np.diag(expected.covariance))
    scale = np.outer(sigma, sigma)
    npt.assert_allclose(record["covariance"].reshape(9, 9) / scale, expected.covariance / scale, atol=1e-8)
    npt.assert_allclose(
        [record["lag_one"], record["correlation_time"], record["distortion"], record["excess_variance"]],
        [correlation.lag_one, correlation.time, correlation.direction, correlation.excess_variance],
        rtol=1e-8,
    )


@pytest.mark.parametrize("lengths", daily([((400, 700),), ((30_000, 400, 20_000),)]))
def test_nothing_goes_across_from_one_recording_to_the_next(lengths: tuple[int, ...]) -> None:
    whole = np.concatenate([wandering(memory=0.9)] * 17)
    parts = tuple(map(Samples, np.split(whole[: sum(lengths)], np.cumsum(lengths)[:-1])))
    readings = Readings.of(Joined(parts))
    expected, found = NumpyLikelihood().estimate(readings), Likelihood().estimate(readings)
    sigma = np.sqrt(np.diag(expected.covariance))
    scale = np.outer(sigma, sigma)
    npt.assert_allclose(found.covariance / scale, expected.covariance / scale, atol=1e-8)


@pytest.mark.parametrize("prior", [None, 0.3])
@pytest.mark.parametrize("world", ["all around", "half a sphere", "long"])
def test_the_minimum_of_the_sampson_cost_itself_is_the_same(world: str, prior: float | None) -> None:
    readings = Readings.of(WORLDS[world])
    expected = NumpyLikelihood(prior=prior, bias_correction=False).estimate(readings)
    found = Likelihood(prior=prior, bias_correction=False).estimate(readings)
    sigma = np.sqrt(np.diag(expected.covariance))
    npt.assert_array_less(np.abs(found.ellipsoid.parameters - expected.ellipsoid.parameters) / sigma, 1e-8)
    npt.assert_allclose(
        found.covariance / np.outer(sigma, sigma), expected.covariance / np.outer(sigma, sigma), atol=1e-8
    )


def test_axes_that_changed_sign_or_place_are_found() -> None:
    for place, (name, swap) in enumerate(SWAPS.items()):
        field = wandering()
        field[600:] = field[600:] @ swap
        record, found = engine().fit(field), axis_swap_of(field)
        assert (int(record["swaps"][place]), int(record["first_swap"][place])) == (1, 600)
        assert record["swaps"].sum() == 1
        assert found is not None
        assert (found.axes, found.rows) == (name, (600,))


def test_a_jump_is_seen() -> None:
    field = wandering()
    field[1000:] += 40.0
    assert float(engine().fit(field)["largest_jump"]) > 20.0
    assert float(engine().fit(wandering())["largest_jump"]) < 5.0


@pytest.mark.parametrize(("rows", "outliers"), [(500, 15), (500, 60), (5000, 500), (30_000, 600)])
def test_outliers_are_rejected_as_before(rows: int, outliers: int) -> None:
    field = tumble(rows, outliers=outliers, seed=3)
    expected = Auto().estimate(Readings.of(field))
    record = engine().fit(field)
    assert expected.method == "robust"
    assert record["is_robust"]
    sigma = np.sqrt(np.diag(expected.covariance))
    npt.assert_array_less(np.abs(surface(record).parameters - expected.ellipsoid.parameters) / sigma, 0.01)
    npt.assert_allclose(record["rejected_beyond"], expected.rejected_beyond, rtol=0.01)
    assert abs(int(record["used"]) - expected.used) <= max(1, rows // 2000)


def test_clean_readings_lose_none() -> None:
    assert [int(engine().fit(tumble(500, seed=seed))["rejected"]) for seed in range(10)] == [0] * 10


def test_sums_are_those_of_the_moments() -> None:
    field = tumble(1000)
    moments = Moments.of(field)
    sums = engine().sums(field, scale=moments.unit)
    npt.assert_allclose(sums["sums"], moments.sums, rtol=1e-12)


def test_sums_add_and_merge_and_solve() -> None:
    field = tumble(1000)
    call = engine()
    whole = call.sums(field, origin=(20, 120, 90), scale=64.0)
    first = call.add(call.sums(field[:300], origin=(20, 120, 90), scale=64.0), field[300:600])
    merged = call.merge(first, call.sums(field[600:], origin=(0, 64, 64), scale=128.0))
    npt.assert_allclose(merged["sums"], whole["sums"], rtol=1e-9, atol=1e-9)
    expected = Consistent().estimate(Readings.of(field))
    record = call.solve(merged["sums"], origin=merged["origin"], unit=float(merged["scale"]))
    npt.assert_allclose(surface(record).parameters, expected.ellipsoid.parameters, rtol=1e-7, atol=1e-6)
    npt.assert_allclose(record["noise"], expected.noise, rtol=1e-6)


@pytest.mark.parametrize("world", WORLDS)
def test_coverage_is_that_of_the_cloud(world: str) -> None:
    field = WORLDS[world]
    record = engine().fit(field, robust=0)
    expected = Coverage.of_cloud(Summary.of(field).cloud, surface(record))
    npt.assert_allclose(record["coverage"], expected.fraction, atol=0.011)  # a mean may stand on an edge
    npt.assert_allclose(record["hole_deg"], expected.hole_deg, rtol=1e-6)


def rails_of(quality: DataQuality) -> int:
    """The rails of a recording as a record has them."""
    return sum(1 << rail.axis + 3 * (rail.end == "highest") for rail in quality.rails)


@pytest.mark.parametrize("limit", [np.inf, 144.0])
def test_quality_counts_what_it_counted(limit: float) -> None:
    field = (np.round(tumble(3000, noise=0.0) / 8.0) * 8.0).clip(max=limit)
    field[100:110] = field[100]
    time = np.arange(3000.0)
    time[50] = 0.0
    time[7] = np.nan
    record = engine().fit(field, time=time, rests=0)
    quality = DataQuality.of(Samples(field, time=time))
    npt.assert_array_equal(record["lowest"], quality.lows.values)
    npt.assert_array_equal(record["highest"], -quality.highs.values)
    npt.assert_array_equal(record["end_counts"], np.concatenate([quality.lows.counts, quality.highs.counts]))
    assert (int(record["rails"]), float(record["step"])) == (rails_of(quality), quality.step)
    npt.assert_allclose(record["path_correlation"], quality.path.correlation(Moments.of(field).spread), rtol=1e-9)
    assert record["repeats"] == quality.repeats
    assert record["longest_repeat"] >= 10
    assert record["distinct"] == quality.distinct == len(np.unique(field, axis=0))
    assert int(record["backward_steps"]) == quality.clock.backward_steps
    assert float(record["end"]) == 2999.0


@pytest.mark.parametrize("times", [1, 3])
def test_of_many_different_readings_a_sample_is_counted(times: int) -> None:
    field = np.random.default_rng(2).permutation(np.concatenate([tumble(30_000)] * times + [tumble(10_000)]))
    record = engine().fit(field)
    assert record["distinct"] == DataQuality.of(Samples.of(field)).distinct
    npt.assert_allclose(record["distinct"], len(np.unique(field, axis=0)), rtol=0.03)


def test_distances_are_those_of_sampson() -> None:
    field = tumble(501)
    record = engine().fit(field)
    npt.assert_allclose(
        engine().distances(field, record), magnitude.distances(field, surface(record)), rtol=0, atol=1e-10
    )


def test_many_are_one_after_the_other() -> None:
    parts = [WORLDS["all around"], np.zeros((0, 3)), WORLDS["few"], tumble(700, outliers=30), np.full((20, 3), np.nan)]
    offsets = np.cumsum([0, *map(len, parts)])
    together = engine().fit_many(np.concatenate(parts), offsets)
    for part, record in zip(parts, together, strict=True):
        assert engine().fit(part).tobytes() == record.tobytes()
    assert together["status"].tolist() == [0, 1, 0, 0, 2]


def test_threads_do_not_disturb_each_other() -> None:
    """The library runs without the interpreter's lock, and reads options while other threads make their own."""
    fields, dips = [tumble(300, seed=seed) for seed in range(4)], [20.0, 40.0, 60.0, 80.0]
    alone = [engine().fit(field, dip_deg=dip).tobytes() for field, dip in zip(fields, dips, strict=True)]

    def is_disturbed(number: int) -> bool:
        fits = (engine().fit(fields[number], dip_deg=dips[number]).tobytes() for _ in range(300))
        return any(fit != alone[number] for fit in fits)

    with ThreadPoolExecutor(4) as pool:
        assert not any(pool.map(is_disturbed, range(4)))


@pytest.mark.parametrize("world", WORLDS)
def test_kernels_agree(world: str) -> None:
    """No product is fused with a sum, so that the baseline and AVX2 give equal digits."""
    if engine().kernels(2) != 2:
        pytest.skip("this processor has no AVX2")
    baseline, avx2 = (engine().fit(WORLDS[world], kernels=kind) for kind in (1, 2))
    for name in RECORD.names or ():
        npt.assert_allclose(avx2[name], baseline[name], rtol=1e-12, err_msg=name)


@pytest.mark.skipif(platform.machine() != "x86_64" or sys.platform != "linux", reason="/proc/cpuinfo of x86-64")
def test_avx2_is_used_where_the_processor_has_it() -> None:
    flags = re.search(r"^flags\s*: (.*)$", Path("/proc/cpuinfo").read_text(encoding="ascii"), flags=re.MULTILINE)
    assert flags
    assert engine().kernels() == (2 if {"avx2", "fma"} <= set(flags[1].split()) else 1)
    assert engine().kernels(1) == 1


@pytest.mark.tools
def test_the_float_build_gives_four_digits(tmp_path: Path) -> None:
    """Offset and shape to a ten thousandth of the radius, as flinders.h says; and no warning of the compiler."""
    native = ctypes.CDLL(str(build.library(tmp_path, options=["-Werror", "-O0", "-DFLINDERS_FLOAT"])))
    native.flinders_workspace_size.restype = ctypes.c_size_t
    field, options = tumble(500).astype(np.float32), np.zeros((), dtype=layout("flinders_options", np.float32))
    record = np.zeros((), dtype=layout("flinders_record", np.float32))
    workspace = np.empty(native.flinders_workspace_size(ctypes.c_size_t(len(field))), dtype=np.uint8)
    address = [ctypes.c_void_p(array.ctypes.data) for array in (field, options, workspace, record)]
    native.flinders_default_options(address[1])
    rows, size = ctypes.c_size_t(len(field)), ctypes.c_size_t(len(workspace))
    assert native.flinders_fit(address[0], None, rows, address[1], address[2], size, address[3]) == 0
    double = engine().fit(field)
    for name in ("centre", "shape", "noise"):
        npt.assert_allclose(record[name], double[name], rtol=0, atol=1e-4 * float(double["radius"]))


def test_the_record_of_the_library_has_the_layout_of_the_header() -> None:
    record = engine().fit(tumble(100))
    assert record["version"] == 1
    assert record["rows"] == 100
    assert not np.isnan(record["sums"]).any()


def test_every_status_has_words() -> None:
    words = [engine().message(status) for status in range(10)]
    assert len(set(words)) == 10
    assert "unknown status" not in words


def test_the_example_of_the_header_runs(tmp_path: Path) -> None:
    text = (build.SOURCE_FOLDER / "flinders.h").read_text(encoding="utf-8")
    example = textwrap.indent("\n".join(re.findall(r"^ \*     (.*)$", text, flags=re.MULTILINE)), "    ")
    points = ",".join(f"{value:.17g}" for value in tumble(50).ravel())
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include <stdlib.h>\n#include "flinders.h"\n'
        f"int main(void) {{\n    static const double field[] = {{{points}}};\n    const size_t rows = 50;\n"
        "    const size_t size = flinders_workspace_size(rows);\n    void *workspace = malloc(size);\n"
        f"{example}\n    free(workspace);\n    return status;\n}}\n"
    )
    library = build.library()
    program = tmp_path / "main"
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", f"-I{build.SOURCE_FOLDER}", f"-Wl,-rpath,{library.parent}"]
    subprocess.run(
        [*build.compiler(), *flags, "main.c", str(library), "-lm", "-o", str(program)], cwd=tmp_path, check=True
    )
    told = subprocess.run([str(program)], capture_output=True, text=True, check=True).stdout.splitlines()
    record = Engine().fit(tumble(50))
    assert told[0] == "offset {:.1f} {:.1f} {:.1f}".format(*record["centre"])
    judgement = Engine().judge(record, Engine().request())
    assert told[1] == f"{judgement['worst_deg']:.2f} degrees, verdict {judgement['verdict']}"
    assert len(told) - 2 == int((judgement["order"] < len(ENGINE_FINDINGS)).sum()) > 0


def test_what_a_record_does_not_know_makes_no_finding_and_no_widening() -> None:
    """As of a fit of other origin: a surface and its covariance, and nothing of the readings."""
    record = record_of_ellipsoid(Ellipsoid(np.zeros(3), 50.0 * np.eye(3)))
    record["covariance"] = 1e-4 * np.eye(9).ravel()
    judgement = engine().judge(record, engine().request(shrinks=0))
    npt.assert_array_equal(record["covariance"], 1e-4 * np.eye(9).ravel())
    found = {ENGINE_FINDINGS[place] for place in np.flatnonzero(judgement["severities"])}
    assert found <= {"rotation-unknown", "scale-unknown"}
    assert 0.0 < judgement["worst_deg"] < 0.1


def test_the_tables_of_c_are_made_from_the_catalogue() -> None:
    """``python -m flinders.findings.c_tables`` writes them anew."""
    made = {"flinders_rules.h": c_tables.header(), "rules.c": c_tables.source()}
    assert {name: (build.SOURCE_FOLDER / name).read_text(encoding="utf-8") for name in made} == made


@pytest.mark.parametrize("is_level", [False, True])
def test_a_disturbance_explains_what_a_triangular_factor_says(is_level: bool) -> None:
    rng = np.random.default_rng(3)
    field = tumble(3000, seed=3)
    if is_level:
        field[:, 2] = 90.0 + rng.normal(scale=0.5, size=3000)
    values = np.cumsum(rng.normal(size=3000))
    field[:, 0] += 0.05 * values
    values[::7] = np.nan
    ellipsoid = Ellipsoid(np.array([20.0, 120.0, 90.0]), np.diag([45.0, 50.0, 55.0]))
    found = engine().regress(field, values, ellipsoid.centre, ellipsoid.shape, limit=2.0)

    residuals = magnitude.distances(field, ellipsoid)
    taken = (np.abs(residuals) <= 2.0) & np.isfinite(values)
    jacobian = magnitude.information(foot_directions(field[taken], ellipsoid), ellipsoid)
    about = values[taken] - values[taken].mean()
    design = np.hstack([jacobian, jacobian[:, :3] * about[:, np.newaxis]])
    scale = np.linalg.norm(design, axis=0)
    triangle = np.asarray(np.linalg.qr(np.column_stack([design / scale, residuals[taken]]), mode="r"))
    step = np.linalg.lstsq(design / scale, residuals[taken], rcond=1e-9)[0] / scale

    assert found["used"] == taken.sum()
    assert found["stride"] == 1
    assert found["explained"] == pytest.approx(np.sum(triangle[9:12, -1] ** 2), rel=1e-7)
    assert found["left"] == pytest.approx(triangle[12, -1] ** 2, rel=1e-7)
    npt.assert_allclose(found["per_unit"], step[9:], rtol=1e-6, atol=1e-9)
    npt.assert_allclose([found["range"], found["farthest"]], [np.ptp(about), np.abs(about).max()], rtol=1e-12)
