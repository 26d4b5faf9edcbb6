"""Plain text by pyarrow: the same samples, blocks, lines left out and messages as without, whatever a file holds."""

from __future__ import annotations

import sys
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from tests.trials import examples

from flinders.errors import FlindersError
from flinders.readers import TextRecording, _grid, _lines, _source, open_recording, read, text
from flinders.readers._grid import Grid, parser_of, rows_of
from flinders.readers._lines import CUT_MARK, Lines

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.arrays import Floats

pytest.importorskip("pyarrow.csv")

FEW = 8
"""Lines in a block, so that a short file has several."""
NEVER = 1 << 60
XYZ = Grid(",", ".", 3, (0, 1, 2), frozenset({0, 1, 2}))

here = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])

plain = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.integers(-(10**25), 10**25).map(str),
    st.from_regex(r"-?[0-9]{0,25}\.[0-9]{1,25}([eE][-+]?[0-9]{1,3})?", fullmatch=True),
    st.sampled_from(["-0", "1.", ".5", "007", "4.9e-324", "1.7976931348623157e308", "8.5e-400"]),
)
"""Numbers as programs write them; also those that a careless parser rounds wrongly."""
odd = st.sampled_from([
    "", " ", "nan", "NaN", "-nan", "na", "N/A", "null", "inf", "-Infinity", "1e999", "+1", "+-1", "--1", "-", ".", "e",
    "1e", "1e+05", "1_000", "1.2.3", "0x10", "1d5", "nan(1)", "nan()", "(1)", "1 2", " 1 ", "\t1", "1\xa0", "\xb9",
    "$1", "1,5", "1.5", "1'000", "'1'", '"1"', '"1,5"', "1\x00", "1\x0b", "1\x1c", "\ufeff1", "\N{MINUS SIGN}1",
    "\ufffd", "\N{ARABIC-INDIC DIGIT ONE}", "oops", CUT_MARK,
])  # fmt: skip
"""What else stands in cells."""
cells = st.one_of(plain, plain, plain, odd)
notes = st.sampled_from(
    ["", "ok", "12:30:01.5", "1/2/2024", "2024-01-01 12:00", "\xb5T", "#1", "a//b", '"a"', "e", "-"]
)


def table_lines(delimiter: str, *, clean: bool) -> st.SearchStrategy[str]:
    """Lines of five cells, time, note, x, y, z; unless `clean` also whatever else turns up in a file."""
    numbers = plain.map(lambda text: text.replace(".", ",")) if delimiter == ";" else plain
    row = st.tuples(numbers, notes, numbers, numbers, numbers).map(delimiter.join)
    if clean:
        return row
    cell = cells if delimiter == "," else st.one_of(numbers, numbers, numbers, odd)
    messy = st.tuples(cell, notes, cell, cell, cell).map(delimiter.join)
    ragged = st.lists(cell, max_size=7).map(delimiter.join)
    other = st.sampled_from(
        ["", "  ", "\t", delimiter * 4, "# noon", "  % noon", "// noon", header(delimiter), "-----", "gzip ends early"]
    )
    return st.one_of(row, row, row, row, messy, ragged, other, row.map(lambda text: text + delimiter))


def header(delimiter: str) -> str:
    return delimiter.join(["t", "note", "mx", "my", "mz"])


@st.composite
def files(draw: st.DrawFn) -> bytes:
    """A recording that is regular in most of its stretches of `FEW` lines, and not in all of them."""
    delimiter = draw(st.sampled_from([",", ";", "\t"]))
    stretch = st.booleans().flatmap(
        lambda clean: st.lists(table_lines(delimiter, clean=clean), min_size=FEW, max_size=FEW)
    )
    lines = [header(delimiter), *(line for lines in draw(st.lists(stretch, min_size=1, max_size=12)) for line in lines)]
    end = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    encoding = draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]))
    return (end.join(lines) + draw(st.sampled_from(["", end]))).encode(encoding)


def everything(path: Path) -> object:
    """All that a reader tells of a file, to the bit, or the error in which it ends."""
    told: list[object] = []
    try:
        gone: list[tuple[int, int | None]] = []
        recording = open_recording(path, columns="mx,my,mz", progress=lambda *at: gone.append(at))
        assert isinstance(recording, TextRecording)
        for lines, block in recording.numbered_blocks():
            time = None if block.time is None else block.time.tobytes()
            told.append((lines.tolist(), block.field.tobytes(), time, block.skipped, recording.skipped))
        told += [gone[-1], gone == sorted(gone), list(recording.corrected_lines(np.negative, add=True))]
    except FlindersError as error:
        told.append(repr(error))
    return told


@pytest.fixture
def by_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make blocks of a few lines."""
    monkeypatch.setattr(_lines, "BLOCK_ROWS", FEW)
    monkeypatch.setattr("flinders.readers.text.BLOCK_ROWS", FEW)
    monkeypatch.setattr(_source, "lines_of", partial(_lines.lines_of, least=FEW))


def parsed(text: str, grid: Grid = XYZ) -> Floats | None:
    parse = parser_of(grid)
    assert parse is not None
    return parse(Lines(1, text, text.count("\n") + 1, len(text)))


@settings(here, max_examples=examples(50).max_examples)
@given(files())
@example(
    b"t;note;mx;my;mz\n\n0,0;;0,0;0,0;0,0\n1,;;0,0;0,0;0,0\n1,7976931348623157e308;;0,0;0,0;0,0\n\n0,0;;0,0;0,0;0,0\n"
)
@pytest.mark.usefixtures("by_few")
def test_a_file_reads_the_same_with_and_without_pyarrow(tmp_path: Path, content: bytes) -> None:
    """Samples, their lines, what is left out and when that is said, progress, corrected copies, messages: all alike."""
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(text, "MIN_BYTES_FOR_ARROW", NEVER)
        plainly = everything(path)
        patch.setattr(text, "MIN_BYTES_FOR_ARROW", 0)
        assert everything(path) == plainly


@given(
    st.lists(st.tuples(cells, notes, cells, cells).map(",".join), min_size=1, max_size=6).map("\n".join)
    | st.text("0123456789.,-+eEnaif \t\n_x(\ufeff#", max_size=40)
)
def test_a_stretch_is_given_whole_and_right_or_not_at_all(text: str) -> None:
    """What pyarrow gives are the numbers of every line, to the bit, without one that would not have been read."""
    grid = Grid(",", ".", 4, (0, 2, 3), frozenset({2, 3}))
    values = parsed(text, grid)
    if values is not None:
        lines = text.split("\n")
        rows = rows_of(lines, range(1, len(lines) + 1), grid)
        npt.assert_array_equal(values, rows.values)
        npt.assert_array_equal(np.signbit(values), np.signbit(rows.values))
        assert (len(values), rows.unreadable) == (len(lines), [])


@given(st.lists(st.tuples(plain, plain, plain).map(",".join), min_size=1, max_size=6))
def test_numbers_as_programs_write_them_are_given(lines: list[str]) -> None:
    """Rounded as Python rounds them, however many digits they have."""
    values = parsed("\n".join(lines))
    assert values is not None
    npt.assert_array_equal(values, [[float(cell) for cell in line.split(",")] for line in lines])


@pytest.mark.parametrize(
    "line",
    [
        "",
        "1,2",
        "1,2,3,",
        "1,2,3,4",
        ",,",
        "1,,3",
        "1,2,nan(1)",
        "\ufeff1,2,3",
        '"1",2,3',
        "1,2,0x3",
        "1,2,1_0",
        "1,2,+-3",
        "# 1,2,3",
        f"1,2,3{CUT_MARK}",
        "1,2,\N{MINUS SIGN}3",
        "1,2,null",
        "1,2,1 000",
        "1,2,3\x00",
    ],
)
def test_what_is_doubtful_is_left_to_the_other_path(line: str) -> None:
    """One such line, first or last, and nothing is given of the whole stretch."""
    assert parsed("1,2,3") is not None
    assert parsed(f"{line}\n1,2,3") is None
    assert parsed(f"1,2,3\n{line}") is None


@pytest.mark.parametrize(
    "grid",
    [
        Grid(" ", ".", 3, (0, 1, 2), frozenset({0, 1, 2})),
        Grid(",", ",", 3, (0, 1, 2), frozenset({0, 1, 2})),
        Grid(",", ".", 0, (0, 1, 2), frozenset({0, 1, 2})),
    ],
    ids=["spaces", "commas twice", "any width"],
)
def test_lines_that_pyarrow_cannot_cut_are_not_given_to_it(grid: Grid) -> None:
    """Runs of spaces, decimal commas between commas, lines of unlike width."""
    assert parser_of(grid) is None


def test_large_files_take_the_fast_path_and_small_ones_do_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From `MIN_BYTES_FOR_ARROW` bytes on, and without pyarrow never; the samples are those of the table."""
    values = np.random.default_rng(5).normal(0.0, 30.0, (20_000, 3)).round(3)
    path = tmp_path / "log.csv"
    path.write_text("mx,my,mz\n" + "".join(f"{x!r},{y!r},{z!r}\n" for x, y, z in values.tolist()))
    given: list[int] = []

    def watched(grid: Grid) -> _grid.Parse | None:
        parse = parser_of(grid)

        def noted(lines: Lines) -> Floats | None:
            assert parse is not None
            values = parse(lines)
            given.append(0 if values is None else len(values))
            return values

        return parse and noted

    monkeypatch.setattr(text, "parser_of", watched)
    npt.assert_array_equal(read(path).field, values)
    assert given == []
    monkeypatch.setattr(text, "MIN_BYTES_FOR_ARROW", path.stat().st_size)
    npt.assert_array_equal(read(path).field, values)
    assert given == [11_809]  # the first 8192 lines hold the header
    monkeypatch.setitem(sys.modules, "pyarrow.csv", None)
    npt.assert_array_equal(read(path).field, values)
    assert len(given) == 1


@pytest.mark.parametrize(
    "name",
    [
        "ckexplorer_acc_mag/acc_mag_log.csv",
        "pichim_betaflight/20231014_apex5_mag_on_tpu_02.csv",
        "px4_pyulog_auavx21/sample_mag.csv",
        "sunsided_hmc5883l/unmoved-10min_dec8.csv",
        "xio_fusion/sensor_data.csv",
    ],
)
@pytest.mark.usefixtures("by_few")
def test_real_recordings_read_the_same(recordings: Callable[[str], Path], tmp_path: Path, name: str) -> None:
    """Loggers of all sorts, the beginning of each."""
    path = tmp_path / "log.csv"
    path.write_bytes(b"".join(recordings(name).read_bytes().splitlines(keepends=True)[:1000]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(text, "MIN_BYTES_FOR_ARROW", 0)
        fast = read(path)
        patch.setattr(text, "MIN_BYTES_FOR_ARROW", NEVER)
        plainly = read(path)
    npt.assert_array_equal(fast.field, plainly.field)
    assert fast.skipped == plainly.skipped


def test_tabs_beside_quoted_cells_part_cells_in_a_corrected_copy(tmp_path: Path) -> None:
    """An empty cell before or behind a quoted one is a cell, and numbers are put where they were read."""
    path = tmp_path / "log.tsv"
    path.write_text('a\tb\tmx\tmy\tmz\n\t"n"\t1\t2\t3\n"n"\t\t4\t5\t6\n"n"\t \t"7"\t8\t9\n')
    recording = open_recording(path)
    assert isinstance(recording, TextRecording)
    copy = "".join(recording.corrected_lines(np.negative)).splitlines()
    assert copy[1:] == ['\t"n"\t-1\t-2\t-3', '"n"\t\t-4\t-5\t-6', '"n"\t \t"-7"\t-8\t-9']
