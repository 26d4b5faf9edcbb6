"""However rows are dealt to files, put together they are the same bytes, and in order."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.sentences import assert_raises
from tests.trials import examples

from flinders.apps.fleet import UnitResult, UnitResults, merging
from flinders.apps.fleet.merging import merge, table_counts
from flinders.apps.fleet.results import named_rows
from flinders.errors import OutputError

pytest.importorskip("pyarrow")

texts = st.sampled_from(["", "A", "A1", "Ä", "é", "z", "\U0001d538", "\uffff"])
times = st.sampled_from([float("nan"), -1.0, 0.0, 2.5])
rows = st.lists(
    st.builds(
        UnitResult, unit=texts, recording=texts, start_s=times, message=texts, worst_deg=times,
        verdict=st.sampled_from(["good", "limited", "failed"]), readings=st.integers(0, 9),
        findings=st.lists(texts, max_size=3).map(tuple), offset=st.sampled_from([(0.0, 1.0, 2.0), (float("nan"),) * 3]),
    ),
    max_size=40,
)  # fmt: skip


def merged(parts: list[UnitResults], folder: Path, group: int) -> bytes:
    paths = [folder / f"part-{place}" for place in range(len(parts))]
    for path, part in zip(paths, parts, strict=True):
        path.write_bytes(part.to_bytes())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(merging, "GROUP_ROWS", group)
        merge(paths, folder / "all.parquet")
    return (folder / "all.parquet").read_bytes()


@given(rows, st.data(), st.integers(1, 12))
@examples(25)
def test_any_deal_gives_the_same_bytes(cells: list[UnitResult], data: st.DataObject, group: int) -> None:
    whole = UnitResults.of(cells).sorted()
    files = data.draw(st.integers(1, 5))
    keys = [(row.unit, row.recording, str(row.start_s)) for row in map(whole.row, range(len(whole)))]
    own = {key: data.draw(st.integers(0, files - 1)) for key in dict.fromkeys(keys)}  # equal rows stay in one file
    dealt = [whole[[place for place, key in enumerate(keys) if own[key] == file]] for file in range(files)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        assert merged(dealt, folder, group) == merged([whole], folder, group)
        assert UnitResults.read(folder / "all.parquet").to_bytes() == whole.to_bytes()


@given(st.lists(st.integers(0, 3), max_size=12), st.integers(1, 5))
@examples(15)
def test_of_equal_rows_those_of_the_first_file_come_first(files: list[int], group: int) -> None:
    parts = [UnitResults.of([UnitResult(unit="A", readings=file)] * files.count(file)) for file in range(4)]
    with tempfile.TemporaryDirectory() as name:
        merged(parts, Path(name), group)
        assert UnitResults.read(Path(name) / "all.parquet").readings.tolist() == sorted(files)


@given(rows, st.integers(1, 12))
@examples(15)
def test_counts_are_those_of_the_whole_table(cells: list[UnitResult], group: int) -> None:
    whole = UnitResults.of(cells).sorted()
    with tempfile.TemporaryDirectory() as name:
        merged([whole], Path(name), group)
        counts = table_counts(Path(name) / "all.parquet")
    assert (counts["rows"], counts["units"]) == (
        len(whole),
        len(set(named_rows(whole.to_arrow()).column("unit").to_pylist())),
    )
    assert counts["readings"] == int(whole.readings.sum())
    assert counts["verdicts"] == whole.verdicts()
    found = [code for codes in whole.findings for code in codes]
    assert counts["findings"] == {code: found.count(code) for code in found if code}
    known = [row.worst_deg for row in cells if row.verdict != "failed" and row.worst_deg == row.worst_deg]
    places = np.percentile(known, [50, 95, 100]) if known else ()
    assert counts["worst_deg"] == dict(zip(("median", "p95", "largest"), places, strict=False))


def test_a_table_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "all.parquet").mkdir()
    (tmp_path / "all.parquet" / "in-the-way").touch()
    with assert_raises(OutputError):
        merge([], tmp_path / "all.parquet")
    assert [path.name for path in tmp_path.iterdir()] == ["all.parquet"]
