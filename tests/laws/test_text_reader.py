"""Laws of the text reader: what any table says is what is read, and garbage never gets past the error tree."""

from __future__ import annotations

import gzip
from typing import TYPE_CHECKING

import numpy as np
import numpy.testing as npt
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flinders.errors import FlindersError
from flinders.readers import TextRecording, open_recording, read

if TYPE_CHECKING:
    from pathlib import Path

here = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
numbers = st.floats(allow_nan=False, allow_infinity=False, width=32).map(float)
readings = st.tuples(numbers, numbers, numbers).filter(lambda each: len(set(each)) > 1)  # others may be no answer
rows = st.lists(readings, min_size=1, max_size=40)
dialects = st.sampled_from(
    [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (" ", "."), ("   ", ","), (", ", ".")]
)
headers = st.sampled_from(
    [(), ("mx", "my", "mz"), ("mag_x", "mag_y", "mag_z"), ("x", "y", "z"), ("MagX", "MagY", "MagZ")]
)
encodings = st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"])
ends = st.sampled_from(["\n", "\r\n", "\r"])


def written(table: list[tuple[float, float, float]], dialect: tuple[str, str], header: tuple[str, ...]) -> list[str]:
    """Write a table the way some logger would."""
    delimiter, decimal = dialect
    lines = [delimiter.join(f"{value!r}".replace(".", decimal) for value in row) for row in table]
    return [delimiter.join(header), *lines] if header else lines


@here
@given(rows, dialects, headers, encodings, ends, st.booleans())
def test_what_is_written_is_read(
    tmp_path: Path,
    table: list[tuple[float, float, float]],
    dialect: tuple[str, str],
    header: tuple[str, ...],
    encoding: str,
    end: str,
    packed: bool,
) -> None:
    """Any numbers, delimiter, decimal sign, header, encoding, line end and packing: the same numbers, bit for bit."""
    content = end.join([*written(table, dialect, header), ""]).encode(encoding)
    path = tmp_path / "table.csv"
    path.write_bytes(gzip.compress(content) if packed else content)
    samples = read(path)
    npt.assert_array_equal(samples.field, np.array(table))
    assert samples.skipped == ()


@here
@given(rows, dialects, headers, ends)
def test_an_unchanged_copy_reads_back(
    tmp_path: Path,
    table: list[tuple[float, float, float]],
    dialect: tuple[str, str],
    header: tuple[str, ...],
    end: str,
) -> None:
    """A corrected copy under the identity has the same readings to nine digits, and the same header and line ends."""
    path, copy = tmp_path / "table.csv", tmp_path / "copy.csv"
    path.write_bytes(end.join([*written(table, dialect, header), ""]).encode())
    recording = open_recording(path)
    assert isinstance(recording, TextRecording)
    lines = list(recording.corrected_lines(lambda field: field))
    assert all(line.endswith(end) for line in lines)
    assert not header or lines[0] == dialect[0].join(header) + end
    copy.write_text("".join(lines), newline="")
    npt.assert_allclose(read(copy).field, np.array(table), rtol=1e-8)


@here
@given(rows, st.lists(st.tuples(st.integers(0, 40), st.sampled_from(["oops", "1,2", "1,2,3,4", "a,b,c"])), max_size=3))
def test_a_bad_line_never_loses_the_rest(
    tmp_path: Path, table: list[tuple[float, float, float]], bad: list[tuple[int, str]]
) -> None:
    """Bad lines after the first reading are counted, and all good ones are read."""
    lines = written(table, (",", "."), ("mx", "my", "mz"))
    bad = bad[: len(table) - 1]
    for place, text in bad:
        lines.insert(2 + place % len(table), text)
    (tmp_path / "table.csv").write_text("\n".join(lines))
    samples = read(tmp_path / "table.csv")
    npt.assert_array_equal(samples.field, np.array(table))
    assert sum(entry.rows for entry in samples.skipped) == len(bad)


@here
@given(st.binary(max_size=300) | st.text("0123456789.,;-+e \t\n\rxyz[]{}\"'#nan", max_size=300).map(str.encode))
def test_any_bytes_are_read_or_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    """Whatever the file holds, only errors of the tree get out, and their message is one line."""
    path = tmp_path / "table.csv"
    path.write_bytes(content)
    refused: FlindersError | None = None
    try:
        samples = read(path)
    except FlindersError as error:
        refused = error
    if refused:
        assert "\n" not in str(refused)
    else:
        assert len(samples) > 0
        assert np.isfinite(samples.field).all()
