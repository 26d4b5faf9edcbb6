"""The report of a fleet says what its table holds: nobody is left out, nothing is rounded away, and why is said."""

from __future__ import annotations

import inspect
import re
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from tests.sentences import assert_sentences

from flinders.apps.fleet import job, progress
from flinders.apps.fleet.aggregate import overview_of
from flinders.apps.fleet.report import page
from flinders.apps.fleet.results import UnitResult, UnitResults
from flinders.apps.fleet.worker import LostWorker
from flinders.errors import FitError, FlindersError, InputError, UsageError
from flinders.findings import action

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

parquet = pytest.importorskip("pyarrow.parquet")

DOCS = Path(__file__).resolve().parents[2] / "docs"


def good(unit: str, **fields: Any) -> UnitResult:
    values: dict[str, Any] = {
        "verdict": "good", "method": "likelihood", "worst_deg": 0.4, "offset": (1.0, 2.0, 3.0), "field_strength": 50.0,
        "noise": 0.3, "findings": ("scale-unknown",), "unit_of_field": "uT",
    }  # fmt: skip
    return UnitResult(unit=unit, **{**values, **fields})


def told(tmp_path: Path, rows: Sequence[UnitResult]) -> str:
    """The text of a report, without marks and doubled blanks."""
    parquet.write_table(UnitResults.of(rows).sorted().to_arrow(), tmp_path / "fleet.parquet")
    body = page(overview_of([tmp_path / "fleet.parquet"])).split("<body>")[1].split("<script")[0]
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", body)).split())


def test_one_that_could_not_be_read_of_thousands_is_in_the_headline(tmp_path: Path) -> None:
    rows = [good(f"U{place:04d}") for place in range(2500)]
    text = told(
        tmp_path, [*rows, UnitResult(unit="", recording="p2.parquet", code="unreadable", message="p2 is broken")]
    )
    assert "> 99.9% good" in text
    assert ": 1 (< 0.1%)" in text
    assert_sentences(text, about="2,501")
    assert "100.0%" not in text
    assert "is read p2 is broken" in text, "a file without a unit begins with its message"


def test_field_strengths_are_told_apart_by_their_unit(tmp_path: Path) -> None:
    text = told(tmp_path, [good("A"), good("B", unit_of_field="counts", field_strength=400.0)])
    assert "Field strength, counts" in text
    assert "Field strength, µT" in text


def test_batches_are_shown_where_the_table_has_them(tmp_path: Path) -> None:
    refused = {"verdict": "refused", "code": "coverage", "offset": (float("nan"),) * 3}
    rows = [good(f"{place}", batch=f"<lot {place % 2}>") for place in range(40)]
    rows += [good(f"bad {place}", batch="<lot 1>", **refused) for place in range(20)]
    text = told(tmp_path, rows)
    assert "<lot 0> 0.0% <lot 1> 50.0%" in text
    assert "● stands out" in text
    without = told(tmp_path, [good(f"{place}") for place in range(40)])
    assert "By hardware batch" not in without


def test_every_event_of_the_log_is_in_the_docs() -> None:
    told = set(re.findall(r'event\(\s*"([a-z-]+)"', inspect.getsource(job) + inspect.getsource(progress)))
    text = (DOCS / "fleet" / "fleet.md").read_text()
    table = text[text.index("## What the log says") :]
    assert told == set(re.findall(r"^\| `([a-z-]+)` \|", table, flags=re.MULTILINE))


def of_rows() -> Iterator[type[FlindersError]]:
    """Errors that the row of a recording can have."""
    waiting: list[type[FlindersError]] = [FitError, InputError, UsageError, LostWorker]
    while waiting:
        kind = waiting.pop()
        waiting += kind.__subclasses__()
        if kind.__module__.startswith("flinders."):
            yield kind


NEVER: frozenset[str] = frozenset({
    "fit", "input", "array", "link", "needs-samples", "needs-recording", "not-merged", "no-accelerometer",
    "not-validated", "collapsed", "constant-strength", "no-calibration", "no-onboard", "unknown-parameter",
})  # fmt: skip
"""Of bases, of connections, of methods that a fleet does not call, and of a question to its table."""


def test_every_reason_has_an_advice() -> None:
    codes = {kind.code for kind in of_rows()} | {"refused", "internal"}
    assert [code for code in sorted(codes - NEVER) if not action(code)] == []
