"""However a fleet is cut into files, its table is the same."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.frames import PolarsLike, Streamed, of_polars, refuse
from tests.sentences import assert_raises
from tests.trials import examples

import flinders
from flinders import simulate
from flinders.apps.fleet import UnitResult, UnitResults, fit_many, worker
from flinders.apps.fleet.job import run
from flinders.apps.fleet.options import Options
from flinders.apps.fleet.plan import plan_of
from flinders.apps.fleet.results import needs_arrow
from flinders.errors import MissingExtra, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from flinders.apps.fleet.recordings import Job

pandas = pytest.importorskip("pandas")
pyarrow = pytest.importorskip("pyarrow")
from pyarrow import feather, parquet  # noqa: E402 - after it is known to be there

UNITS = 5
SAMPLES = {f"U{seed}": simulate.tumble(seed=seed, n=120 + 10 * seed, motion="uniform").samples for seed in range(UNITS)}
NUMBERS = (
    "start_s",
    "end_s",
    "worst_deg",
    "rms_deg",
    "offset",
    "matrix",
    "covariance",
    "noise",
    "field_strength",
    "coverage",
)


def columns(unit: str) -> dict[str, Any]:
    samples = SAMPLES[unit]
    assert samples.time is not None
    names = {f"mag_{axis}_uT": samples.field[:, place] for place, axis in enumerate("xyz")}
    return {"serial": [unit] * len(samples), "time_s": samples.time, **names}


WHOLE = pyarrow.concat_tables([pyarrow.table(columns(unit)) for unit in SAMPLES])


def as_one_file(folder: Path) -> None:
    parquet.write_table(WHOLE, folder / "all.parquet")


def as_small_row_groups(folder: Path) -> None:
    parquet.write_table(WHOLE, folder / "all.parquet", row_group_size=77)


def as_a_file_each(folder: Path) -> None:
    for unit in SAMPLES:
        parquet.write_table(pyarrow.table(columns(unit)), folder / f"{unit}.parquet")


def as_folders_by_unit(folder: Path) -> None:
    for unit in SAMPLES:
        (folder / f"serial={unit}").mkdir()
        table = pyarrow.table(columns(unit)).drop_columns(["serial"])
        parquet.write_table(table.slice(0, 50), folder / f"serial={unit}" / "part-0.parquet")
        parquet.write_table(table.slice(50), folder / f"serial={unit}" / "part-1.parquet")


def as_stretches_of_time(folder: Path) -> None:
    """Each file has readings of each unit, the later ones in the file that comes first."""
    for place, (begin, end) in enumerate([(100, 10_000), (0, 60), (60, 100)]):
        parts = [pyarrow.table(columns(unit)).slice(begin, end - begin) for unit in SAMPLES]
        parquet.write_table(pyarrow.concat_tables(parts), folder / f"{place}.parquet")


def as_readings_that_take_turns(folder: Path) -> None:
    order = np.argsort(np.concatenate([columns(unit)["time_s"] for unit in SAMPLES]), kind="stable")
    parquet.write_table(WHOLE.take(order), folder / "all.parquet", row_group_size=200)


def as_rows_in_no_order(folder: Path) -> None:
    parquet.write_table(shuffled(), folder / "all.parquet")


def as_rows_in_no_order_of_two_files(folder: Path) -> None:
    for place, table in enumerate((shuffled().slice(0, 300), shuffled().slice(300))):
        parquet.write_table(table, folder / f"{place}.parquet")


def as_rows_in_no_order_of_seven_files(folder: Path) -> None:
    for place in range(7):
        rows = np.arange(place, WHOLE.num_rows, 7)
        parquet.write_table(shuffled().take(rows), folder / f"{place}.parquet", row_group_size=31)


def as_rows_in_no_order_of_tiny_row_groups(folder: Path) -> None:
    parquet.write_table(shuffled(), folder / "all.parquet", row_group_size=7)


def shuffled() -> Any:  # noqa: ANN401 - pyarrow ships no types
    """All readings, in no order."""
    return WHOLE.take(np.random.default_rng(1).permutation(WHOLE.num_rows))


def as_arrow(folder: Path) -> None:
    feather.write_feather(WHOLE, folder / "all.feather", compression="uncompressed", chunksize=100)


WAYS = [
    as_one_file, as_small_row_groups, as_a_file_each, as_folders_by_unit, as_stretches_of_time,
    as_readings_that_take_turns, as_arrow, as_rows_in_no_order, as_rows_in_no_order_of_two_files,
    as_rows_in_no_order_of_seven_files, as_rows_in_no_order_of_tiny_row_groups,
]  # fmt: skip


@pytest.fixture(scope="module")
def alone() -> UnitResults:
    """Each unit by itself, as `flinders.fit` has it."""
    rows = []
    for unit, samples in SAMPLES.items():
        assert samples.time is not None
        start, end = float(samples.time[0]), float(samples.time[-1])
        rows.append(
            UnitResult(unit=unit, start_s=start, end_s=end, readings=len(samples)).with_fit(flinders.fit(samples))
        )
    return UnitResults.of(rows)


@pytest.mark.parametrize("written", WAYS)
def test_any_way_to_write_it_gives_the_table_of_single_fits(
    written: Callable[[Path], None], tmp_path: Path, alone: UnitResults
) -> None:
    (tmp_path / "in").mkdir()
    written(tmp_path / "in")
    run(str(tmp_path / "in"), tmp_path / "out.parquet", Options(), workers=0)
    rows = UnitResults.read(tmp_path / "out.parquet")
    for name in ("unit", "recording", "readings", "samples", "verdict", "code", "findings", "unit_of_field", "method"):
        assert getattr(rows, name).tolist() == getattr(alone, name).tolist(), name
    for name in NUMBERS:
        expected = getattr(alone, name)
        scale = 1e-9 * np.abs(expected).max()
        np.testing.assert_allclose(getattr(rows, name), expected, rtol=1e-9, atol=scale, err_msg=name)


def test_any_way_to_give_it_in_memory_does_too(alone: UnitResults) -> None:
    for source in (SAMPLES, WHOLE, shuffled()):
        rows = fit_many(source)
        assert rows.unit.tolist() == alone.unit.tolist()
        np.testing.assert_allclose(rows.offset, alone.offset, rtol=1e-9)


def test_units_by_name_and_frames_of_pandas_need_no_pyarrow() -> None:
    code = (
        "import sys; sys.modules['pyarrow'] = None\n"
        "import flinders, pandas\n"
        "field = flinders.simulate.tumble(seed=1).samples.field\n"
        "frame = pandas.DataFrame(field, columns=list('xyz'))\n"
        "rows = flinders.fit_many({'A': field, 'B': frame, 'C': field[:3]})\n"
        "print(*rows.verdict)\n"
        "print(*flinders.fit_many(frame.assign(unit='B')).verdict)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.split() == ["good", "good", "refused", "good"]


@pytest.fixture
def remove_pyarrow(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], None]]:
    """Act as if it was not installed, from the call on."""

    def remove() -> None:
        monkeypatch.setattr("flinders.foreign_errors.import_module", refuse)
        needs_arrow.cache_clear()

    yield remove
    needs_arrow.cache_clear()


@pytest.mark.parametrize("make", [pandas.DataFrame, PolarsLike, of_polars])
def test_frames_of_all_units_need_no_pyarrow(
    remove_pyarrow: Callable[[], None], make: Callable[[dict[str, Any]], Any]
) -> None:
    """In any order, with dates, and with rows of no unit: as Arrow has it."""
    whole = shuffled().to_pydict()
    whole["time_s"] = (1.7e18 + 1e9 * np.array(whole["time_s"])).astype("datetime64[ns]")
    whole["lot"] = [7] * len(whole["serial"])
    whole["serial"][:3] = [None] * 3
    expected = fit_many(pyarrow.table(whole))
    remove_pyarrow()
    rows = fit_many(make(whole))
    for name in ("unit", "recording", "batch", "readings", "samples", "verdict", "code", "message"):
        assert getattr(rows, name).tolist() == getattr(expected, name).tolist(), name
    for name in NUMBERS:
        np.testing.assert_allclose(getattr(rows, name), getattr(expected, name), rtol=1e-9, err_msg=name)
    with assert_raises(UsageError):
        fit_many(make(whole), unit_column="serie")
    with assert_raises(UsageError):
        fit_many(make({name: column for name, column in whole.items() if name != "serial"}))


def test_what_is_no_table_is_refused_and_another_stream_of_arrow_needs_pyarrow(
    remove_pyarrow: Callable[[], None],
) -> None:
    streamed = Streamed(columns("U0"))
    remove_pyarrow()
    with assert_raises(MissingExtra):
        fit_many(streamed)
    with assert_raises(UsageError):
        fit_many(SAMPLES["U0"].field)


@settings(examples(40), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.integers(1, 400), min_size=1, max_size=4), st.integers(50, 400), st.integers(10, 100))
def test_each_reading_is_in_one_partition(
    tmp_path_factory: pytest.TempPathFactory, cuts: list[int], largest: int, group: int
) -> None:
    """For files cut anywhere, and any bound on what fits into memory."""
    from flinders.apps.fleet import plan

    folder = tmp_path_factory.mktemp("cut")
    ends = sorted({min(cut, WHOLE.num_rows) for cut in np.cumsum(cuts)} | {WHOLE.num_rows})
    for place, (begin, end) in enumerate(zip([0, *ends], ends, strict=False)):
        parquet.write_table(WHOLE.slice(begin, end - begin), folder / f"{place}.parquet", row_group_size=group)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "MAX_ROWS", largest)
        patch.setattr(worker, "MAX_ROWS", largest)
        patch.setattr(worker, "fit_jobs", counted)
        rows = [
            UnitResults.from_bytes(worker.calibrate_partition(each, options=Options()))
            for each in plan_of(str(folder), Options()).partitions
        ]
    found = UnitResults.join(rows)
    assert dict(zip(found.unit.tolist(), found.readings.tolist(), strict=True)) == {
        unit: len(samples) for unit, samples in SAMPLES.items()
    }
    assert len(found) == UNITS


def counted(jobs: list[Job], options: Options) -> UnitResults:
    """What would be fitted."""
    return UnitResults.of([counted_one(job, options) for job in jobs])


def counted_one(job: Job, options: Options) -> UnitResult:
    """Its readings, as they come when it is gone through."""
    rows = sum(len(block) for block in job.source.blocks())
    assert rows == job.readings
    return UnitResult(unit=job.unit, recording=job.recording, readings=rows)


texts = st.text(st.characters(codec="utf-8"), max_size=5)
rows_of = st.builds(
    UnitResult, unit=texts, recording=texts, start_s=st.floats(allow_infinity=False), readings=st.integers(0, 2**60),
    worst_deg=st.floats(allow_infinity=False), offset=st.tuples(*[st.floats(-1e9, 1e9)] * 3),
    findings=st.lists(texts, max_size=3).map(tuple),
)  # fmt: skip


@given(st.lists(rows_of, max_size=5))
def test_rows_come_back_from_arrow_as_they_were(rows: list[UnitResult]) -> None:
    table = UnitResults.of(rows)
    back = UnitResults.from_bytes(table.to_bytes())
    assert len(back) == len(rows)
    assert all(repr(back.row(place)) == repr(table.row(place)) for place in range(len(rows)))


@given(st.lists(rows_of, max_size=6), st.integers(0, 6))
def test_sorting_does_not_depend_on_where_a_table_was_cut(rows: list[UnitResult], cut: int) -> None:
    whole = UnitResults.of(rows).sorted()
    joined = UnitResults.join([UnitResults.of(rows[:cut]).sorted(), UnitResults.of(rows[cut:]).sorted()]).sorted()
    assert [repr(whole.row(place)) for place in range(len(rows))] == [
        repr(joined.row(place)) for place in range(len(rows))
    ]
