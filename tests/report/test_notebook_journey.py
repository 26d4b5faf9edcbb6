"""A notebook from a data frame to a heading, cell by cell, shown as a notebook shows values."""

from __future__ import annotations

import ast
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.sentences import assert_raises

import flinders

pandas = pytest.importorskip("pandas")

CELLS = (
    """
    fit = flinders.fit(frame, columns=["east", "north", "down"], unit="uT", target_deg=0.5)
    fit
    """,
    "fit.heading_error_deg",
    "fit.claim",
    "fit.evidence",
    "fit.judgement",
    "fit.provenance",
    "fit.findings[0]",
    "fit.calibration",
    "fit.plot()",
    "fit.plot('strength')",
    "flinders.compare(fit, fit)",
    "flinders.compare_methods(fit.provenance.recording, methods=['auto', 'minmax', 'sphere'])",
    "flinders.compare_methods(fit.provenance.recording, methods=['minmax', 'auto']).sorted_by('validated')",
    """
    corrected = fit.calibration.apply(frame, columns=["east", "north", "down"], level=True)
    corrected["heading_deg"]
    """,
)


def shown_of(cell: str, names: dict[str, object]) -> object:
    """Run a cell, and give the value of its last line."""
    *lines, last = ast.parse("\n".join(map(str.strip, cell.strip().splitlines()))).body
    assert isinstance(last, ast.Expr)
    exec(compile(ast.Module(lines, []), "cell", "exec"), names)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


def test_every_cell_shows_something_short_or_drawn() -> None:
    samples = flinders.simulate.tumble(seed=4, n=500, motion="uniform").samples
    frame = pandas.DataFrame(samples.field, columns=["east", "north", "down"])
    names: dict[str, object] = {"flinders": flinders, "frame": frame}
    for cell in CELLS[:-1]:
        value = shown_of(cell, names)
        assert len(repr(value).splitlines()) <= 4, cell
        assert len(repr(value)) < 400, cell
        for method in ("_repr_html_", "_repr_svg_"):
            if hasattr(value, method):
                assert "<script" not in (shown := getattr(value, method)())
                assert shown.count("<table") == shown.count("</table>")
        if hasattr(value, "_repr_svg_"):
            ElementTree.fromstring(value._repr_svg_())
    headings = shown_of(CELLS[-1], names)
    assert np.isfinite(headings).all()  # type: ignore[call-overload]


def test_a_contest_is_a_table_that_is_sorted_and_gone_through() -> None:
    samples = flinders.simulate.tumble(seed=4, n=500, motion="uniform").samples
    contest = flinders.compare_methods(samples, methods=["minmax", "auto"])
    first, *rows = repr(contest).splitlines()
    assert first.split()[0] == "method"
    assert [row.split()[0] for row in rows] == ["minmax", "auto"] == [entry.method for entry in contest]
    assert [entry.method for entry in contest.sorted_by("validated")] == ["auto", "minmax"]
    assert contest["auto"].verdict == "good"
    assert contest._repr_html_().count("<tr>") == 1 + len(contest)
    with assert_raises(flinders.errors.UsageError):
        contest["minmx"]
    with assert_raises(flinders.errors.UsageError):
        contest.sorted_by("second")


def test_arrays_are_written_by_their_shape_and_numbers_to_four_digits() -> None:
    samples = flinders.simulate.tumble(seed=1, n=500).samples
    assert "array(" not in repr(samples) + repr(flinders.fit(samples).claim)
    assert "covariance=array of 9 × 9" in repr(flinders.fit(samples).claim)
    assert "500 readings" in repr(samples)
