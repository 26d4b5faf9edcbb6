"""No claim of a real recording shrinks by more than a third, and no verdict becomes better, without a reason kept."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import pytest
from benchmarks import claims_by_release as table
from benchmarks.claims_by_release import Column, Kept
from tests.sentences import assert_raises, assert_sentences

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

COLUMNS: Final = table.kept()
FIRST: Final = Column("1", "first", {"a.csv": Kept("limited", 0.9, 1.0, ("noise",)), "b.csv": Kept("good", 0.3)})


@pytest.mark.parametrize("name", COLUMNS[-1].recordings)
def test_a_better_verdict_or_a_much_smaller_claim_has_a_reason(name: str, recordings: Callable[[str], Path]) -> None:
    """A change that is meant: ``python -m benchmarks.claims_by_release --keep NAME --because WHY``."""
    assert recordings(name).exists()
    assert not table.unexplained(name, COLUMNS, table.fitted(name))


def test_each_column_has_the_reasons_that_it_needs() -> None:
    for number, column in enumerate(COLUMNS):
        for name, row in column.recordings.items():
            assert not table.unexplained(name, COLUMNS[:number], row), column.name


def test_small_steps_add_up() -> None:
    columns = [Column(name, "", {"a.csv": Kept("limited", claim)}) for name, claim in [("1", 1.0), ("2", 0.8)]]
    assert not table.unexplained("a.csv", columns[1:], Kept("limited", 0.6))
    assert_sentences(table.unexplained("a.csv", columns, Kept("limited", 0.6)))


def test_a_reason_sets_a_new_mark() -> None:
    explained = Column("2", "", {"a.csv": Kept("limited", 0.3, reason="rests are left out")})
    assert not table.unexplained("a.csv", [FIRST, explained], Kept("limited", 0.25))
    assert table.unexplained("a.csv", [FIRST, explained], Kept("limited", 0.15))


def test_changes_are_told_from_a_fifth_on() -> None:
    new = {"a.csv": Kept("good", 0.7), "b.csv": Kept("good", 0.35), "c.csv": Kept("refused")}
    assert_sentences(list(table.changes(FIRST, new)))


def test_a_column_is_kept_with_the_reasons_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def answer(question: str) -> str:
        asked.append(question)
        return 'a "truth"'

    monkeypatch.setattr(table, "TABLE", tmp_path / "table.toml")
    monkeypatch.setattr("builtins.input", answer)
    table.keep("1", "first", [], FIRST.recordings)
    assert table.kept() == [FIRST]
    table.keep("2", "next", table.kept(), {**FIRST.recordings, "b.csv": Kept("good", 0.1)})
    assert_sentences(asked)
    assert table.kept()[-1].recordings["b.csv"] == Kept("good", 0.1, reason='a "truth"')
    with assert_raises(SystemExit):
        table.keep("2", "again", table.kept(), {})


def test_nothing_is_kept_without_a_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "TABLE", tmp_path / "table.toml")
    monkeypatch.setattr("builtins.input", lambda _: " ")
    with assert_raises(SystemExit):
        table.keep("2", "next", [FIRST], {"a.csv": Kept("good", 0.9)})
    assert not table.TABLE.exists()
