"""Tables of a fleet that are broken, odd or in disorder: whoever has readings in them gets a row that says so."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily

import flinders
from flinders import simulate
from flinders.apps.fleet import UnitResults, fit_many, plan, worker
from flinders.apps.fleet.job import run
from flinders.apps.fleet.options import Options
from flinders.apps.fleet.plan import plan_of
from flinders.core.samples import Samples
from flinders.errors import UnreadableInput, UsageError
from flinders.readers.parquet import group_extents

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from flinders.readers.parquet import Extent

pyarrow = pytest.importorskip("pyarrow")
from pyarrow import ipc, parquet  # noqa: E402 - after it is known to be there

READINGS = 150
BYTES = (b"\0", b"\x7f", b"\xff", b"\x1c", b"\x19")
"""What a damaged byte of a footer may be: an end, lengths, a struct, a list."""
FIELDS = [simulate.tumble(seed=seed, n=READINGS, motion="uniform").samples.field for seed in range(6)]


def table(*units: int, names: Sequence[Any] = (), **columns: Any) -> Any:  # noqa: ANN401 - pyarrow ships no types
    """Readings of units, one after the other, as a table of Arrow."""
    field = np.concatenate([FIELDS[unit] for unit in units])
    ids = [name for unit in (names or [f"U{unit}" for unit in units]) for name in [unit] * READINGS]
    times = np.tile(np.arange(READINGS) * 0.02, len(units))
    axes = {f"mag_{axis}_uT": field[:, place] for place, axis in enumerate("xyz")}
    return pyarrow.table({"unit": ids, "time_s": times, **axes, **columns})


def spoil(path: Path, group: int, column: str) -> None:
    """Turn bytes in the pages of a column of a row group."""
    metadata = parquet.read_metadata(path)
    place = metadata.schema.to_arrow_schema().get_field_index(column)
    chunk = metadata.row_group(group).column(place)
    begin = chunk.dictionary_page_offset or chunk.data_page_offset
    content = bytearray(path.read_bytes())
    for byte in range(begin, begin + chunk.total_compressed_size):
        content[byte] ^= 0x5A
    path.write_bytes(content)


def rows_of(folder: Path, **options: Any) -> UnitResults:
    out = folder.parent / "out.parquet"
    run(str(folder), out, Options(**options), workers=0, force=True)
    return UnitResults.read(out)


def told(rows: UnitResults) -> dict[str, tuple[int, str]]:
    """Readings and code, or verdict, by unit; each unit once."""
    assert len(set(rows.unit.tolist())) == len(rows)
    codes = [code or verdict for code, verdict in zip(rows.code.tolist(), rows.verdict.tolist(), strict=True)]
    return dict(zip(rows.unit.tolist(), zip(rows.readings.tolist(), codes, strict=True), strict=True))


def test_a_run_imports_no_pandas(tmp_path: Path) -> None:
    """pyarrow does for the first array that it makes of anything but memory: a quarter of a second a process."""
    parquet.write_table(table(0, 1), tmp_path / "fleet.parquet")
    code = (
        "import sys; from flinders.apps.fleet.options import Options; from flinders.apps.fleet.job import run\n"
        "rows = run('fleet.parquet', 'out.parquet', Options(), workers=0).rows\n"
        "print(rows, 'pandas' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=tmp_path)
    assert done.stdout.split() == ["2", "False"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "in").mkdir()
    return tmp_path / "in"


GOOD, UNREADABLE = (READINGS, "good"), (READINGS, "unreadable")


@pytest.mark.parametrize("largest", [1_000_000, 400, 100])
def test_a_broken_row_group_costs_those_who_have_readings_in_it(
    folder: Path, largest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one partition, in several, and where each unit is streamed."""
    for module in (plan, worker):
        monkeypatch.setattr(module, "MAX_ROWS", largest)
    parquet.write_table(table(0, 1, 2, 3), folder / "a.parquet", row_group_size=100)
    spoil(folder / "a.parquet", 2, "mag_y_uT")
    rows = rows_of(folder)
    assert told(rows) == {"U0": GOOD, "U1": UNREADABLE, "U2": GOOD, "U3": GOOD}
    assert_sentences(rows.message[1])
    np.testing.assert_allclose(
        rows.offset[3], flinders.fit(Samples.of(FIELDS[3], unit="uT")).calibration.offset, rtol=1e-6
    )


def test_one_that_has_other_readings_elsewhere_is_not_fitted_from_those(folder: Path) -> None:
    whole = table(0, 1, 2)
    for place in range(3):
        parquet.write_table(whole.take(list(range(place, len(whole), 3))), folder / f"{place}.parquet")
    parquet.write_table(table(3), folder / "3.parquet")
    spoil(folder / "1.parquet", 0, "mag_x_uT")
    rows = rows_of(folder)
    assert told(rows) == {"U0": UNREADABLE, "U1": UNREADABLE, "U2": UNREADABLE, "U3": GOOD}
    assert_sentences(rows.message[0])


def test_a_table_whose_field_is_no_numbers_costs_its_units(folder: Path) -> None:
    parquet.write_table(table(0, 1).slice(0, 200), folder / "a.parquet")
    texts = table(1, 2).slice(50)
    texts = texts.set_column(2, "mag_x_uT", texts["mag_x_uT"].cast("string"))
    parquet.write_table(texts, folder / "b.parquet")
    code = "no-magnetometer"
    assert told(rows_of(folder)) == {"U0": GOOD, "U1": (READINGS, code), "U2": (READINGS, code)}


@pytest.mark.parametrize("statistics", [True, False])
def test_rows_whose_units_cannot_be_read_are_a_row_of_their_file(folder: Path, *, statistics: bool) -> None:
    """Those at the ends of what the footer tells are known to be there; nobody takes it for one recording."""
    written = table(0, 1, 2, 3)
    parquet.write_table(written, folder / "a.parquet", row_group_size=300, write_statistics=statistics)
    parquet.write_table(table(0, 4), folder / "b.parquet")
    spoil(folder / "a.parquet", 0, "unit")
    rows = rows_of(folder)
    found = told(rows)
    assert found.pop("(a.parquet)") == (300, "unreadable")
    assert_sentences(rows.message[0])
    assert found["U2"] == found["U3"] == found["U4"] == GOOD
    assert found["U0"] == ((READINGS, "unreadable") if statistics else GOOD)
    assert ("U1" in found) == statistics


def test_sizes_that_contradict_the_schema_are_a_row_of_their_table(folder: Path) -> None:
    """pyarrow ends the program where it is asked for the metadata of such a column."""
    for unit in range(2):
        parquet.write_table(table(unit), folder / f"{unit}.parquet")
    content = (folder / "0.parquet").read_bytes()
    levels, more = b"\x26\x00\xac\x02", b"\x36\x00\x2c\x02"  # 0 and 150 values of two levels; three of 0, 22 and 1
    assert content.count(levels) == 5
    (folder / "0.parquet").write_bytes(content.replace(levels, more))
    assert told(rows_of(folder)) == {"U0": (READINGS, "unreadable"), "U1": GOOD}


@pytest.mark.parametrize(
    ("units", "name", "options"),
    [
        (["A17", "B02", "C05", "C05"], "unit", {}),
        (["A17", "B02", "C05", "C05"], "a_long_name_of_a_column_" * 12, {"compression": "zstd"}),
        (["A17", None, "C05", "C05"], "unit", {"use_dictionary": False}),
        ([b"A17", b"\xff", b"C05", b"C05"], "unit", {}),
        ([-7, 300, 12, 12], "serial", {}),
        (["\x19\x18\x04unit", "B02", "C05", "C05"], "unit", {"write_statistics": False}),
    ],
)
def test_extents_are_those_of_pyarrow(folder: Path, units: list[Any], name: str, options: dict[str, Any]) -> None:
    columns = {"unit.part": ["x"] * 4, name: units, "z": [{"unit": "y"}] * 4}
    parquet.write_table(pyarrow.table(columns), folder / "a.parquet", row_group_size=2, **options)
    metadata = parquet.read_metadata(folder / "a.parquet")
    stated = [metadata.row_group(group).column(1).statistics for group in range(2)]
    known = [None if each is None or each.null_count else (each.min_raw, each.max_raw) for each in stated]
    assert group_extents(metadata, name) == [
        ends and tuple(end.to_bytes(8, "little", signed=True) if isinstance(end, int) else end for end in ends)
        for ends in known
    ]


def test_extents_of_a_broken_footer_are_known_or_not_and_no_exception(tmp_path: Path) -> None:
    parquet.write_table(table(0).select(["unit"]), tmp_path / "a.parquet")
    footer_file = tmp_path / "footer"
    parquet.read_metadata(tmp_path / "a.parquet").write_metadata_file(footer_file)
    whole = footer_file.read_bytes()

    def states(content: bytes) -> list[Extent | None]:
        written = SimpleNamespace(num_row_groups=1, write_metadata_file=lambda sink: sink.write(content))
        return group_extents(written, "unit")

    changed = [states(whole[:place] + byte + whole[place + 1 :]) for place in range(len(whole)) for byte in BYTES]
    cut = [states(whole[:place]) for place in range(len(whole))]
    assert states(whole) == [(b"U0", b"U0")]
    assert {len(ends) for ends in changed + cut} == {1}
    assert [None] in changed


def test_a_table_without_a_footer_is_a_row_among_other_tables(folder: Path) -> None:
    parquet.write_table(table(0), folder / "a.parquet")
    parquet.write_table(table(1), folder / "b.parquet")
    content = (folder / "b.parquet").read_bytes()
    (folder / "b.parquet").write_bytes(content[:-50])
    rows = rows_of(folder)
    assert told(rows) == {"(b.parquet)": (0, "unreadable"), "U0": GOOD}
    assert_sentences(rows.message[0])


@pytest.mark.parametrize("date", ["", "/date=2026-03-01"])
def test_a_table_without_a_footer_costs_the_unit_that_its_path_says(folder: Path, date: str) -> None:
    for unit in range(3):
        path = folder / f"unit=U{unit}{date}"
        path.mkdir(parents=True)
        bare = table(unit).drop_columns(["unit"])
        parquet.write_table(bare.slice(0, 100), path / "0.parquet")
        parquet.write_table(bare.slice(100), path / "1.parquet")
    broken = folder / f"unit=U1{date}" / "1.parquet"
    broken.write_bytes(broken.read_bytes()[:-50])
    (folder / f"unit=U2{date}" / "0.parquet").unlink()
    (folder / f"unit=U2{date}" / "1.parquet").write_bytes(b"PAR1")
    rows = rows_of(folder)
    assert told(rows) == {"U0": GOOD, "U1": (100, "unreadable"), "U2": (0, "unreadable")}
    assert_sentences(rows.message[1])


def test_a_broken_table_in_a_folder_of_null_is_a_row(folder: Path) -> None:
    for path, content in (("unit=__HIVE_DEFAULT_PARTITION__", b"PAR1"), ("unit=U0", None)):
        (folder / path).mkdir()
        parquet.write_table(table(0).drop_columns(["unit"]), folder / path / "a.parquet")
        if content is not None:
            (folder / path / "a.parquet").write_bytes(content)
    assert told(rows_of(folder)) == {
        "(unit=__HIVE_DEFAULT_PARTITION__/a.parquet)": (0, "unreadable"), "U0": GOOD,
    }  # fmt: skip


def test_what_cannot_be_read_is_counted(folder: Path) -> None:
    parquet.write_table(table(0, 1), folder / "a.parquet", row_group_size=READINGS)
    spoil(folder / "a.parquet", 1, "mag_z_uT")
    ended = run(str(folder), folder.parent / "out.parquet", Options(), workers=0)
    assert (ended.readings, ended.failed_readings, ended.codes) == (300, 150, {"unreadable": 1})


def test_rows_without_a_unit_are_never_fitted(folder: Path) -> None:
    """Null, empty and blank ones, in one file or several, in a path, of a table in memory, and streamed."""
    whole = table(0, 1, 2, 3, names=["A", None, "", "  "])
    for files in (1, 2):
        for place in range(files):
            parquet.write_table(whole.take(list(range(place, len(whole), files))), folder / f"{place}.parquet")
        rows = rows_of(folder)
        assert told(rows) == {"": (3 * READINGS, "no-unit"), "A": GOOD}
        assert_sentences(rows.message[0])
    with pytest.MonkeyPatch.context() as patch:
        for module in (plan, worker):
            patch.setattr(module, "MAX_ROWS", 100)
        assert told(rows_of(folder)) == {"": (3 * READINGS, "no-unit"), "A": GOOD}
    assert told(fit_many(whole)) == {"": (3 * READINGS, "no-unit"), "A": GOOD}
    ended = run(str(folder), folder.parent / "out.parquet", Options(), workers=0, force=True)
    assert (ended.units, ended.rows) == (1, 2)


def test_ids_of_bytes_numbers_and_floats_are_texts(folder: Path) -> None:
    for names, told_as in (
        ([b"A", b"\xff\x00"], ["A", "ff00"]),
        ([7, 10], ["10", "7"]),
        ([1.5, 2.5], ["1.5", "2.5"]),
    ):
        for group in (READINGS, 1_000):
            parquet.write_table(table(0, 1, names=names), folder / "a.parquet", row_group_size=group)
            assert rows_of(folder).unit.tolist() == told_as


def test_paths_of_hive_are_decoded(folder: Path) -> None:
    bare = table(0).drop_columns(["unit"])
    for path in ("unit=A%2F1/batch=7", "unit=__HIVE_DEFAULT_PARTITION__/batch=8"):
        (folder / path).mkdir(parents=True)
        parquet.write_table(bare, folder / path / "part.parquet")
    (folder / "batch=9" / "unit=B%202").mkdir(parents=True)
    text = "mag_x_uT,mag_y_uT,mag_z_uT\n" + "".join(",".join(map(str, row)) + "\n" for row in FIELDS[1].tolist())
    (folder / "batch=9" / "unit=B%202" / "monday.csv").write_text(text)
    rows = rows_of(folder)
    assert told(rows) == {"": (READINGS, "no-unit"), "A/1": GOOD, "B 2": GOOD}
    assert rows.batch.tolist() == ["8", "7", "9"]


@pytest.mark.parametrize("column", daily(["batch", "HW_Batch", "lot", "revision"]))
def test_the_batch_of_hardware_stands_in_the_table(folder: Path, column: str) -> None:
    """Of several the first by name, whichever row is met first; empty where there is none."""
    named = ["2026-04", "2026-05", None]
    batches = [batch for batch in named for _ in range(READINGS)]
    batches[:50] = ["2026-07"] * 50
    parquet.write_table(table(0, 1, 2, **{column: batches}), folder / "a.parquet", row_group_size=70)
    assert rows_of(folder).batch.tolist() == ["2026-04", "2026-05", ""]
    with pytest.MonkeyPatch.context() as patch:
        for module in (plan, worker):
            patch.setattr(module, "MAX_ROWS", 100)
        assert rows_of(folder).batch.tolist() == ["2026-04", "2026-05", ""]
    assert fit_many(table(0, names=["A"], firmware=[3] * READINGS), batch_column="firmware").batch.tolist() == ["3"]


def test_one_of_several_magnetometers_is_chosen_as_by_the_single_command(folder: Path) -> None:
    left, right = table(0), table(1)
    both = left.select(["unit", "time_s"])
    for side, source in (("left", left), ("right", right)):
        for axis in "xyz":
            both = both.append_column(f"mag_{side}_{axis}_uT", source[f"mag_{axis}_uT"])
    parquet.write_table(both, folder / "a.parquet")
    chosen = [rows_of(folder, sensor=sensor).offset[0].tolist() for sensor in (None, "1", "2", "mag_right")]
    assert chosen[0] == chosen[1] != chosen[2] == chosen[3]
    assert told(rows_of(folder, sensor="stern")) == {"U0": (READINGS, "usage")}
    parquet.write_table(left, folder / "a.parquet")
    (folder / "U1.csv").write_text("x,y,z\n" + "".join(",".join(map(str, row)) + "\n" for row in FIELDS[1].tolist()))
    assert told(rows_of(folder, sensor="stern", unit="uT")) == {"U0": GOOD, "U1": GOOD}, "as flinders calibrate"


def test_dates_in_words_are_times(folder: Path) -> None:
    dates = [f"2026-03-01T12:00:{place * 0.02:06.3f}Z" for place in range(READINGS)]
    written = table(0).drop_columns(["time_s"]).append_column("time", pyarrow.array(dates))
    parquet.write_table(written, folder / "a.parquet")
    rows = rows_of(folder)
    np.testing.assert_allclose([rows.start_s[0], rows.end_s[0]], [1772366400.0, 1772366402.98], atol=1e-3)
    parquet.write_table(written.set_column(4, "time", pyarrow.array(["noon"] * READINGS)), folder / "a.parquet")
    assert np.isnan(rows_of(folder).start_s[0])
    dates[5], dates[7], dates[9] = "2026-02-30T12:00:00Z", "2999-03-01T12:00:00Z", "2026-03-01T12:00:00+99:00"
    parquet.write_table(written.set_column(4, "time", pyarrow.array(dates)), folder / "a.parquet")
    rows = rows_of(folder)
    np.testing.assert_allclose([rows.start_s[0], rows.end_s[0]], [1772366400.0, 1772366402.98], atol=1e-3)
    time = flinders.read(folder / "a.parquet").time
    assert time is not None
    assert np.flatnonzero(np.isnan(time)).tolist() == [5, 7, 9]


def test_times_that_are_missing_do_not_hide_the_others(folder: Path) -> None:
    times = [None, *(place * 0.02 for place in range(1, READINGS - 1)), None]
    parquet.write_table(table(0).set_column(1, "time_s", pyarrow.array(times)), folder / "a.parquet")
    rows = rows_of(folder)
    np.testing.assert_allclose([rows.start_s[0], rows.end_s[0]], [0.02, 2.96])


def test_units_of_field_that_differ_are_told_with_their_files(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    counts = table(0).rename_columns(["unit", "time_s", "mx", "my", "mz"])
    parquet.write_table(table(0), folder / "a.parquet")
    parquet.write_table(counts, folder / "b.parquet")
    said = rows_of(folder).message[0]
    assert_sentences(said)
    for module in (plan, worker):
        monkeypatch.setattr(module, "MAX_ROWS", 100)
    assert rows_of(folder).message[0] == said, "of a unit that is streamed too"


@pytest.mark.parametrize("largest", [1_000_000, 100])
def test_units_beside_one_in_two_units_of_field_are_fitted(
    folder: Path, largest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where they lie in the same files, and where they are streamed."""
    for module in (plan, worker):
        monkeypatch.setattr(module, "MAX_ROWS", largest)
    parquet.write_table(table(0, 1).take([*range(0, 300, 2)]), folder / "b.parquet")
    parquet.write_table(table(0).take([*range(1, 150, 2)]), folder / "c.parquet")
    counts = table(1).rename_columns(["unit", "time_s", "mx", "my", "mz"]).take([*range(1, 150, 2)])
    parquet.write_table(counts, folder / "a.parquet")
    assert told(rows_of(folder)) == {"U0": GOOD, "U1": (READINGS, "unit")}


def test_what_a_run_wrote_is_no_recording(folder: Path) -> None:
    parquet.write_table(table(0, 1), folder / "a.parquet")
    out = folder / "out.parquet"
    first = run(str(folder), out, Options(), workers=0)
    parts = worker.calibrate_partition(plan_of(str(folder), Options()).partitions[0], options=Options())
    (folder / "other.parquet.parts").mkdir()
    (folder / "other.parquet.parts" / "part-0000000-1-00000000.arrow").write_bytes(parts)
    again = run(str(folder), out, Options(), workers=0, force=True)
    assert (first.other_files, again.other_files) == ({}, {"tables of fleets": 1})
    assert (again.verdicts, again.files) == ({"good": 2}, 1)
    (folder / "a.parquet").unlink()
    with assert_raises(UnreadableInput):
        run(str(folder), folder.parent / "no.parquet", Options(), workers=0)


def test_truths_and_calibrations_beside_recordings_are_no_units(folder: Path) -> None:
    """They are known by what is in them: JSON with readings is a recording, whatever it is called."""
    recording = simulate.tumble(seed=1, n=400)
    csv = "mx_uT,my_uT,mz_uT\n" + "".join("{:.2f},{:.2f},{:.2f}\n".format(*row) for row in recording.samples.field)
    (folder / "U0.csv").write_text(csv)
    (folder / "U1.truth.json").write_text(
        json.dumps([{"mx": x, "my": y, "mz": z} for x, y, z in recording.samples.field.tolist()])
    )
    truth = simulate.truth.dumps(simulate.truth.Truth.of(recording))
    for name in ("U0.truth.json", "U0.json", "aside.JSON"):
        (folder / name).write_text(truth)
    flinders.fit(recording.samples).save(folder / "calibration.json")
    (folder / "U2.truth.json").write_text('{"truth": 1}')
    ended = run(str(folder), folder.parent / "out.parquet", Options(unit="uT"), workers=0)
    assert told(UnitResults.read(folder.parent / "out.parquet")) == {
        "U0": (400, GOOD[1]), "U1.truth": (400, GOOD[1]), "U2.truth": (0, "unreadable"),
    }  # fmt: skip
    assert ended.other_files == {"calibration files": 1, "truth files": 3}
    assert ended.files == 3


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes of POSIX")
def test_a_link_to_nothing_is_a_row_and_a_pipe_is_left_alone(folder: Path) -> None:
    parquet.write_table(table(0), folder / "a.parquet")
    (folder / "U1.csv").symlink_to(folder / "gone.csv")
    os.mkfifo(folder / "U2.csv")
    ended = run(str(folder), folder.parent / "out.parquet", Options(), workers=0)
    assert told(UnitResults.read(folder.parent / "out.parquet")) == {"U0": GOOD, "U1": (0, "unreadable")}
    assert ended.other_files == {"pipe": 1}


def test_a_nested_column_is_no_batch(folder: Path) -> None:
    """The units beside it are fitted one by one; a batch that another column names is taken."""
    board = [{"board": "A", "rev": 2}] * 2 * READINGS
    for name, nested in (("hardware", board), ("batch", [[1]] * 2 * READINGS)):
        rows = table(0, 1, **{name: nested}, lot=["7"] * 2 * READINGS)
        parquet.write_table(rows, folder / "a.parquet")
        for found in (rows_of(folder), fit_many(rows)):
            assert told(found) == {"U0": GOOD, "U1": GOOD}
            assert found.batch.tolist() == ["7", "7"]


@pytest.mark.parametrize("fault", ["nested", "twice", "empty"])
def test_a_table_whose_units_cannot_be_told_is_not_fitted_as_one(folder: Path, fault: str) -> None:
    whole = table(0, 1)
    if fault == "nested":
        whole = whole.set_column(0, "unit", pyarrow.array([[1]] * len(whole)))
    elif fault == "twice":
        whole = whole.append_column("unit", whole["unit"])
    parquet.write_table(whole.slice(0, 0) if fault == "empty" else whole, folder / "a.parquet")
    for beside in (False, True):
        if beside:
            parquet.write_table(table(2), folder / "b.parquet")
        rows = rows_of(folder)
        assert told(rows) == {"(a.parquet)": (0, "unreadable")} | ({"U2": GOOD} if beside else {})
        assert_sentences(rows.message[0])
    if fault != "empty":
        with assert_raises(UnreadableInput):
            fit_many(whole)


@pytest.mark.parametrize("path", ["U0.parquet", "unit=U0/a.parquet", "unit=U0/date=2026-03-01/a.parquet"])
@pytest.mark.parametrize("largest", [1_000_000, 100])
def test_a_file_that_could_not_be_opened_at_first_fails_with_that_error(
    folder: Path, path: str, largest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Even if it can be opened later: its row groups are not in the plan."""
    for module in (plan, worker):
        monkeypatch.setattr(module, "MAX_ROWS", largest)
    (folder / path).parent.mkdir(parents=True, exist_ok=True)
    parquet.write_table(table(0).drop_columns(["unit"]), folder / path, row_group_size=100)

    def closed(*_: object) -> None:
        raise UnreadableInput("the store does not answer")

    with monkeypatch.context() as patch:
        patch.setattr(plan, "open_table_file", closed)
        (partition,) = plan_of(str(folder), Options()).partitions
    partition = pickle.loads(pickle.dumps(partition))
    rows = UnitResults.from_bytes(worker.calibrate_partition(partition, options=Options()))
    assert told(rows) == {"U0": (0, "unreadable")}
    assert_sentences(rows.message[0])


@pytest.mark.parametrize("largest", [1_000_000, 100])
def test_a_file_that_goes_while_the_run_goes_on_is_counted_once(
    folder: Path, largest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (plan, worker):
        monkeypatch.setattr(module, "MAX_ROWS", largest)
    parquet.write_table(table(0, 1), folder / "a.parquet")
    (folder / "unit=U2" / "date=2026-03-01").mkdir(parents=True)
    parquet.write_table(table(2).drop_columns(["unit"]), folder / "unit=U2" / "date=2026-03-01" / "b.parquet")
    partitions = plan_of(str(folder), Options()).partitions
    for path in folder.rglob("*.parquet"):
        path.unlink()
    rows = UnitResults.join(
        [UnitResults.from_bytes(worker.calibrate_partition(each, options=Options())) for each in partitions]
    )
    assert told(rows) == {"(a.parquet)": (300, "unreadable"), "U2": UNREADABLE}


@pytest.mark.parametrize("column", ["mag_x_uT", "mag_z_uT"])
@pytest.mark.parametrize("codec", ["zstd", "lz4"])
def test_a_broken_record_batch_costs_those_who_have_readings_in_it(folder: Path, column: str, codec: str) -> None:
    """Also of a compressed file, of which the column of units is unpacked alone."""
    whole = table(0, 1, 2, lot=["7"] * 3 * READINGS)
    options = ipc.IpcWriteOptions(compression=codec)
    with ipc.new_file(folder / "a.arrow", whole.schema, options=options) as file:
        file.write_table(whole, max_chunksize=READINGS)
    content = (folder / "a.arrow").read_bytes()
    field = FIELDS[1][:, "xyz".index(column[4])].tobytes()
    packed = pyarrow.compress(field, codec=codec, asbytes=True)
    begin = content.index(packed[:40])
    (folder / "a.arrow").write_bytes(content[:begin] + b"\xff" * 40 + content[begin + 40 :])
    rows = rows_of(folder)
    assert told(rows) == {"U0": GOOD, "U1": UNREADABLE, "U2": GOOD}
    assert rows.batch.tolist() == ["7"] * 3
    assert_sentences(rows.message[1])


@pytest.mark.parametrize("largest", [1_000_000, 100])
def test_units_that_cannot_be_read_keep_their_batch(
    folder: Path, largest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (plan, worker):
        monkeypatch.setattr(module, "MAX_ROWS", largest)
    lots = ["6"] * READINGS + ["7"] * READINGS
    parquet.write_table(table(0, 1, lot=lots), folder / "a.parquet", row_group_size=READINGS)
    spoil(folder / "a.parquet", 1, "mag_y_uT")
    rows = rows_of(folder)
    assert (told(rows), rows.batch.tolist()) == ({"U0": GOOD, "U1": UNREADABLE}, ["6", "7"])


def test_a_table_without_the_batch_that_was_asked_for_has_none(folder: Path) -> None:
    parquet.write_table(table(0, batch=["7"] * READINGS), folder / "a.parquet")
    parquet.write_table(table(1, lot=["8"] * READINGS), folder / "b.parquet")
    rows = rows_of(folder, batch_column="batch")
    assert (told(rows), rows.batch.tolist()) == ({"U0": GOOD, "U1": GOOD}, ["7", ""])
    with assert_raises(UsageError):
        rows_of(folder, batch_column="revision")
    with assert_raises(UsageError):
        fit_many(table(0), batch_column="revision")
