"""What holds of any printed line: its numbers come back, whatever stands between them, and a cut line is no reading."""

from __future__ import annotations

from hypothesis import assume, given
from hypothesis import strategies as st

from flinders.readers._cells import decimal
from flinders.readers._recognition import recognise
from flinders.readers._tokenizer import compile_pattern, names_of, pattern_of, split_line
from flinders.readers.dialects.pattern import Pattern

numbers = st.floats(-1e4, 1e4).map(lambda value: f"{value:.3f}") | st.integers(-32768, 32767).map(str)
words = st.text("abcdefghijklmnopqrstuvwyz _-ABCDEFMXYZ", min_size=0, max_size=8).map(str.strip)
labels = words.filter(lambda label: not split_line(label)[0])  # ``ovf`` is a number that overflowed
signs = st.sampled_from([":", "=", ": ", " = ", " [", " ("])
units = st.sampled_from(["uT", "µT", "mG", "gauss", "nT"])


@given(st.lists(st.tuples(labels, signs, numbers), min_size=1, max_size=10))
def test_the_numbers_of_a_labelled_line_come_back(items: list[tuple[str, str, str]]) -> None:
    line = ", ".join(f"{label}{sign}{number}" for label, sign, number in items)
    found, gaps = split_line(line)
    assert found == [number for _, _, number in items]
    assert len(gaps) == len(found) + 1 == len(names_of(gaps)) + 1


@given(st.lists(numbers, min_size=3, max_size=3), signs, units, st.sampled_from([" ", "\t", ", ", " ; "]))
def test_axes_and_their_unit_are_read_whatever_parts_them(xyz: list[str], sign: str, unit: str, between: str) -> None:
    line = between.join(f"{axis}{sign}{number}" for axis, number in zip("XYZ", xyz, strict=True)) + f" {unit}"
    dialect = recognise([line] * 3)
    assert dialect is not None
    assert dialect.names == tuple(f"{axis} ({unit})" for axis in "XYZ")
    assert list(dialect.row(line) or ()) == xyz


@given(st.lists(numbers, min_size=3, max_size=3), st.integers(1, 40))
def test_a_line_that_was_cut_is_no_reading(xyz: list[str], end: int) -> None:
    """Its unit is missing, or a label: no shorter number is ever taken for the whole one."""
    line = "X: {} Y: {} Z: {} uT".format(*xyz)
    assume(end < len(line) - 1)
    dialect = recognise([line] * 3)
    assert dialect is not None
    assert dialect.row(line[:end]) is None


@given(st.lists(numbers, min_size=3, max_size=3))
def test_two_lines_that_run_together_are_no_reading(xyz: list[str]) -> None:
    line = "X: {} Y: {} Z: {} uT".format(*xyz)
    dialect = recognise([line] * 3)
    assert dialect is not None
    assert dialect.row(line + line) is None
    assert dialect.row(line[:-3] + line) is None


@given(st.lists(st.tuples(labels, signs, numbers), min_size=3, max_size=6))
def test_the_quick_way_finds_what_the_careful_one_does(items: list[tuple[str, str, str]]) -> None:
    line = " ".join(f"{label}{sign}{number}" for label, sign, number in items)
    found, gaps = split_line(line)
    quick = compile_pattern(gaps).fullmatch(line)
    assert quick is not None
    assert list(quick.groups()) == found


@given(st.lists(numbers, min_size=3, max_size=5), st.sampled_from(["<{}>", "{}|{}", "N{} /", "a{}b "]))
def test_a_line_is_a_case_of_its_own_pattern(found: list[str], around: str) -> None:
    line = "".join(around.replace("{}", f" {number} ") for number in found)
    assume(len(split_line(line)[0]) >= 3)
    assert Pattern.of(pattern_of(line)).row(line) == split_line(line)[0]


@given(st.integers(-32768, 32767))
def test_hexadecimal_numbers_of_sixteen_bits_are_signed(value: int) -> None:
    assert decimal(f"0x{value % 65536:04X}") == str(value)
