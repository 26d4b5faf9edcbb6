"""Sentences stand in golden files alone, and the files hold those of the tests that there are."""

from __future__ import annotations

import ast
import re
import tomllib
from typing import TYPE_CHECKING

import pytest
from tests.sentences import (
    SENTENCES,
    TESTS,
    Book,
    Running,
    assert_raises,
    assert_sentences,
    in_toml,
    sentences_with,
    with_placeholders,
)

from flinders.errors import TooFewSamples

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

MIN_WORDS_OF_SENTENCE = 5
METHODS_OF_TEXTS = {
    "startswith",
    "endswith",
    "count",
    "search",
    "match",
    "fullmatch",
    "findall",
    "escape",
    "any",
    "all",
}
COLUMNS_OF_TEXTS = {"message", "said", "says", "match", "meant", "named", "why", "told", "error"}


def literals(node: ast.AST) -> Iterator[str]:
    """Texts that an expression compares with, without those that it passes to functions."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.Call):
        function = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        yield from literals(node.func)
        for argument in node.args if function in METHODS_OF_TEXTS else ():
            yield from literals(argument)
    else:
        for part in ast.iter_child_nodes(node):
            yield from literals(part)


def columns(table: ast.Call) -> Iterator[str]:
    """Texts in those columns of a table of cases that a test compares with."""
    names, cases = ([*ast.iter_child_nodes(argument)] for argument in table.args[:2])
    if isinstance(table.args[1], ast.Call) and table.args[1].args:  # daily([...])
        cases = [*ast.iter_child_nodes(table.args[1].args[0])]
    for place, name in enumerate(names):
        if isinstance(name, ast.Constant) and name.value in COLUMNS_OF_TEXTS:
            for case in cases:
                cells = case.args if isinstance(case, ast.Call) else [*ast.iter_child_nodes(case)]
                yield from literals(cells[place]) if place < len(cells) else ()


def asserted_sentences(source: str) -> list[str]:
    """Sentences that tests assert themselves."""
    said: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Assert):
            said += literals(node.test)
        elif isinstance(node, ast.keyword) and node.arg == "match":
            said += literals(node.value)
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "parametrize":
            said += columns(node)
    return [text for text in said if " " in text and len(re.findall("[A-Za-z]{2,}", text)) >= MIN_WORDS_OF_SENTENCE]


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ('assert "a test asserts this long sentence" in said', 1),
        ('assert said.startswith("a test asserts this long sentence")', 1),
        ('assert re.search(r"no test .* this long sentence", said)', 1),
        ('with raises(E, match="a test asserts this long sentence"): pass', 1),
        ('@mark.parametrize(("line", "said"), [("-x", "a test asserts this long sentence")])\ndef f(): pass', 1),
        ('assert "four words are short" in said', 0),
        ('assert run("check a calibration file against readings").code == 4', 0),
    ],
)
def test_sentences_are_told_from_commands_and_fragments(source: str, count: int) -> None:
    assert len(asserted_sentences(source)) == count


def test_no_test_asserts_a_sentence() -> None:
    found = {
        str(path.relative_to(TESTS)): said
        for path in sorted(TESTS.rglob("test_*.py"))
        if (said := asserted_sentences(path.read_text(encoding="utf-8")))
    }
    assert not found, "hold them with assert_sentences or assert_raises of tests/sentences.py"


def test_golden_files_are_those_of_tests_that_there_are() -> None:
    for path in sorted(SENTENCES.rglob("*.toml")):
        module = TESTS / path.relative_to(SENTENCES).with_suffix(".py")
        assert module.exists(), f"{path.name} is of no module: remove it"
        texts = tomllib.loads(path.read_text(encoding="utf-8"))
        there = set(re.findall(r"^\s*def (test_\w+)", module.read_text(encoding="utf-8"), re.MULTILINE))
        assert {name.partition("[")[0].rpartition("::")[2] for name in texts} <= there, path
        assert path.read_text(encoding="utf-8") == in_toml(texts), path


def running(folder: Path, *, regenerates: bool, is_rare: bool = False, name: str = "test_a") -> Running:
    path = folder / "test_x.toml"
    texts = tomllib.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return Running(Book(path, texts), name, regenerates, is_rare)


def write(folder: Path, *texts: str, name: str = "test_a", has_passed: bool = True) -> None:
    test = running(folder, regenerates=True, name=name)
    for text in texts:
        test.meet(text)
    test.end(has_passed=has_passed)


def held(folder: Path) -> object:
    return tomllib.loads((folder / "test_x.toml").read_text(encoding="utf-8"))


def test_regenerating_writes_what_one_test_met_and_leaves_the_others(tmp_path: Path) -> None:
    write(tmp_path, "one", 'two\n"lines" \\ \n\x1b[0m"""\n', name="test_b[x-1]")
    write(tmp_path, "three", "four")
    write(tmp_path, "five", has_passed=False)
    assert held(tmp_path) == {
        "test_a": ["five", "four"],  # it failed before the second
        "test_b[x-1]": ["one", 'two\n"lines" \\ \n\x1b[0m"""\n'],
    }
    write(tmp_path)
    write(tmp_path, name="test_b[x-1]")
    assert not (tmp_path / "test_x.toml").exists()


def test_a_text_that_differs_is_missing_or_is_left_over_fails(tmp_path: Path) -> None:
    write(tmp_path, "one", "two")
    test = running(tmp_path, regenerates=False)
    test.meet("one")
    with pytest.raises(AssertionError, match="holds more texts"):
        test.end(has_passed=True)
    test.end(has_passed=False)
    with pytest.raises(AssertionError, match="differs"):
        test.meet("other")
    with pytest.raises(AssertionError, match="holds 2 texts"):
        test.meet("three")


def test_another_case_of_every_day_holds_the_text_of_a_nightly_one(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="use codes"):
        running(tmp_path, regenerates=True, is_rare=True).meet("one")
    write(tmp_path, "one", name="test_a[1]")
    test = running(tmp_path, regenerates=True, is_rare=True, name="test_a[2]")
    test.meet("two")
    test.end(has_passed=True)
    assert held(tmp_path) == {"test_a[1]": ["one"]}


def test_an_error_has_its_class_code_and_evidence() -> None:
    def few(found: int) -> None:
        raise TooFewSamples(found=found, needed=10, method="level")

    with assert_raises(TooFewSamples, "too-few-samples", found=3, needed=10) as caught:
        few(3)
    assert caught.value.exit_code == 4
    with pytest.raises(AssertionError, match="found"), assert_raises(TooFewSamples, found=4):
        few(3)
    with pytest.raises(AssertionError, match="too-few-samples"), assert_raises(TooFewSamples, "fit"):
        few(3)


def test_places_of_this_run_are_left_out(tmp_path: Path) -> None:
    assert with_placeholders(f"{tmp_path}/a.csv: port 40123") == "<tmp>/a.csv: port <port>"
    assert_sentences("It took 3.2 s for 1,000 readings.", numbers=False)
    assert sentences_with("2", "<html><p>One.</p><p>It is 2 &gt; 1. No.</p></html>") == ["It is 2 > 1."]
