"""Gauge R&R: the study of AIAG's manual, an independent computation, and a simulated truth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from scipy import stats
from tests.program import flinders_
from tests.sentences import assert_raises

from flinders.apps.live.station.gauge import f_tail, gauge_study
from flinders.apps.live.station.gauge_table import measured_table
from flinders.errors import UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from tests.trials import Choose

    from flinders.arrays import Floats

AIAG: Floats = np.array([
    [[0.29, -0.56, 1.34, 0.47, -0.80, 0.02, 0.59, -0.31, 2.26, -1.36],
     [0.41, -0.68, 1.17, 0.50, -0.92, -0.11, 0.75, -0.20, 1.99, -1.25],
     [0.64, -0.58, 1.27, 0.64, -0.84, -0.21, 0.66, -0.17, 2.01, -1.31]],
    [[0.08, -0.47, 1.19, 0.01, -0.56, -0.20, 0.47, -0.63, 1.80, -1.68],
     [0.25, -1.22, 0.94, 1.03, -1.20, 0.22, 0.55, 0.08, 2.12, -1.62],
     [0.07, -0.68, 1.34, 0.20, -1.28, 0.06, 0.83, -0.34, 2.19, -1.50]],
    [[0.04, -1.38, 0.88, 0.14, -1.46, -0.29, 0.02, -0.46, 1.77, -1.49],
     [-0.11, -1.13, 1.09, 0.20, -1.07, -0.67, 0.01, -0.56, 1.45, -1.77],
     [-0.15, -0.96, 0.67, 0.11, -1.45, -0.49, 0.21, -0.49, 1.87, -2.16]],
]).transpose(2, 0, 1)  # fmt: skip
"""(10, 3, 3) by part, operator and repeat: the data of AIAG's manual, 4th edition, figure III-B 6a."""


def test_the_example_of_aiag_has_the_numbers_of_its_tables() -> None:
    """Tables A 3 and A 4 of the manual, as several packages quote them; the manual itself was not at hand."""
    study = gauge_study(AIAG)
    squares = {row.source: (row.freedom, row.squares, row.mean_square) for row in study.rows}
    npt.assert_allclose(squares["operator"], (2, 3.1673, 1.58363), atol=5e-5)
    npt.assert_allclose(squares["part"], (9, 88.3619, 9.81799), atol=5e-5)
    npt.assert_allclose(squares["interaction"], (18, 0.3590, 0.01994), atol=5e-5)
    npt.assert_allclose(squares["repeatability"], (60, 2.7589, 0.04598), atol=5e-5)
    assert study.is_pooled
    sigma = [study.sigma(name) for name in ("repeatability", "operator", "gauge", "part")]
    npt.assert_allclose(sigma, (0.199933, 0.226838, 0.302373, 1.042327), atol=5e-6)
    share = [study.percent(name) for name in ("repeatability", "operator", "gauge", "part")]
    npt.assert_allclose(share, (18.4, 20.9, 27.9, 96.0), atol=0.05)
    assert (study.distinct_categories, study.grade) == (4, "marginal")


def test_sums_of_squares_are_those_of_least_squares_models() -> None:
    """Each term's sum of squares is by what the residuals shrink when a model takes it in."""
    values = np.random.default_rng(4).normal(size=(5, 3, 4)) + np.arange(5.0)[:, None, None]
    part, operator, _ = np.indices(values.shape)
    terms = [
        np.ones((values.size, 1)),
        np.eye(5)[part.ravel()],
        np.eye(3)[operator.ravel()],
        np.eye(15)[(3 * part + operator).ravel()],
    ]

    def left(count: int) -> float:
        design = np.hstack(terms[:count])
        best = np.linalg.lstsq(design, values.ravel(), rcond=None)[0]
        return float(((values.ravel() - design @ best) ** 2).sum())

    drops = [left(count) - left(count + 1) for count in (1, 2, 3)]
    npt.assert_allclose([row.squares for row in gauge_study(values).rows], [*drops, left(4)], rtol=1e-9)


def test_an_interaction_counts_where_its_test_says_so() -> None:
    rng = np.random.default_rng(2)
    values = rng.normal(scale=0.1, size=(8, 3, 3)) + rng.normal(size=(8, 3, 1))
    study = gauge_study(values)
    by_name = {row.source: row for row in study.rows}
    assert not study.is_pooled
    expected = (by_name["interaction"].mean_square - by_name["repeatability"].mean_square) / 3
    assert study.variances["interaction"] == pytest.approx(expected)


def test_one_operator_leaves_reproducibility_out() -> None:
    study = gauge_study(AIAG[:, :1])
    assert study.variances["reproducibility"] == 0.0
    assert [row.source for row in study.rows] == ["part", "repeatability"]
    assert study.sigma("repeatability") == pytest.approx(np.sqrt(AIAG[:, 0].var(axis=1, ddof=1).mean()))


def test_simulated_studies_give_their_variances_back(trials: Choose) -> None:
    """The mean of unbiased estimates lies within four standard errors of the truth."""
    chosen = trials(2000, 200)
    truth = {"repeatability": 0.09, "operator": 0.25, "interaction": 0.16, "part": 4.0}
    found = np.array([_estimates(np.random.default_rng(seed), truth) for seed in chosen.seeds])
    error = found.std(axis=0, ddof=1) / np.sqrt(chosen.count)
    npt.assert_array_less(np.abs(found.mean(axis=0) - list(truth.values())), 4.0 * error)


def _estimates(rng: np.random.Generator, truth: dict[str, float]) -> list[float]:
    part, operator = rng.normal(size=(10, 1, 1)), rng.normal(size=(1, 6, 1))
    both, each = rng.normal(size=(10, 6, 1)), rng.normal(size=(10, 6, 3))
    scales = [np.sqrt(truth[name]) for name in ("part", "operator", "interaction", "repeatability")]
    study = gauge_study(sum(scale * values for scale, values in zip(scales, (part, operator, both, each), strict=True)))
    return [study.variances[name] for name in ("repeatability", "operator", "interaction", "part")]


@pytest.mark.parametrize("f", [0.05, 0.9, 3.0, 40.0])
@pytest.mark.parametrize("freedom", [(1, 4), (2, 18), (9, 60), (18, 600)])
def test_the_tail_of_f_is_that_of_scipy(f: float, freedom: tuple[int, int]) -> None:
    assert f_tail(f, *freedom) == pytest.approx(stats.f.sf(f, *freedom), rel=1e-9)


@pytest.mark.parametrize("shape", [(1, 3, 3), (5, 3, 1), (4, 3)])
def test_too_few_parts_or_repeats_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(UsageError):
        gauge_study(np.zeros(shape))


def rows_of(values: Floats) -> list[dict[str, str]]:
    """Rows of a station's table, of parts, operators and repeats."""
    return [
        {"unit": f"P{part}", "operator": "ABCDEF"[who], "noise": str(values[part, who, again]), "unit_of_field": "uT"}
        for part, who, again in np.ndindex(values.shape)
    ]


def test_a_table_gives_the_values_of_its_rows_in_any_order() -> None:
    rows = rows_of(AIAG)
    shuffled = [rows[place] for place in np.random.default_rng(1).permutation(len(rows))]
    study = gauge_study(measured_table(shuffled, "noise").values)
    assert study.percent("gauge") == pytest.approx(gauge_study(AIAG).percent("gauge"))


def test_further_repeats_and_tests_without_a_number_are_left_out() -> None:
    stopped = {"unit": "P1", "operator": "A", "noise": "", "unit_of_field": ""}
    more = {"unit": "P1", "operator": "A", "noise": "9", "unit_of_field": "uT"}
    measured = measured_table([stopped, *rows_of(AIAG), more], "noise")
    assert (measured.values.shape, measured.left_out, measured.unit) == ((10, 3, 3), 1, "uT")
    npt.assert_array_equal(measured.values, AIAG)


def test_a_part_that_one_operator_has_not_measured_is_named() -> None:
    rows = [row for row in rows_of(AIAG) if (row["unit"], row["operator"]) != ("P4", "B")]
    with pytest.raises(UsageError, match=r"P4.*B"):
        measured_table(rows, "noise")


@pytest.mark.parametrize("names", [{"part": "units"}, {"operator": "opertor"}])
def test_a_column_of_parts_or_operators_that_is_not_there_is_named(names: dict[str, str]) -> None:
    with assert_raises(UsageError):
        measured_table(rows_of(AIAG), "noise", **names)


def test_the_exit_code_and_the_report_say_whether_the_gauge_is_acceptable(tmp_path: Path) -> None:
    table, report = tmp_path / "table.csv", tmp_path / "gauge.html"
    lines = ["unit,operator,noise,unit_of_field", *(",".join(row.values()) for row in rows_of(AIAG))]
    table.write_text("\n".join(lines), encoding="utf-8")
    (tmp_path / "line.toml").write_text("[limits]\nnoise = 100\n", encoding="utf-8")
    asked = ("gauge-study", str(table), "--quantity", "noise")
    assert flinders_(*asked).code == flinders_("gauge-study", str(tmp_path), "--quantity", "noise").code == 3
    ended = flinders_(*asked, "--plan", str(tmp_path / "line.toml"), "--report", str(report), "--json")
    assert ended.code == 0
    assert ended.json["noise"]["grade"] == "acceptable"
    assert ended.json["noise"]["percent_of_tolerance"] == pytest.approx(6 * 0.302373, rel=1e-5)
    assert report.read_text(encoding="utf-8").count("<svg class") >= 1
    (tmp_path / "bad.csv").write_text("part,value\n1,2\n", encoding="utf-8")
    assert flinders_("gauge-study", str(tmp_path / "bad.csv")).code == 5
