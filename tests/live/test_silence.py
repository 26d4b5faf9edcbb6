"""Readings at which the sensor did not answer, on a wire and in the page without a program."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any, Final

import pytest
from tests.core.test_silence import GOOD, csv, interrupted, tumble
from tests.javascript import run
from tests.sentences import assert_sentences

import flinders
from flinders.apps.live.standalone import lines
from flinders.links.transcript import Transcript

if TYPE_CHECKING:
    from pathlib import Path


def test_a_board_that_prints_them_is_told_of_once() -> None:
    field = interrupted(tumble(), 0.0, "every other row")
    transcript = Transcript("the board")
    taken = [
        transcript.take(f"mx:{x:.2f} my:{y:.2f} mz:{z:.2f}\n".encode(), at)
        for at, (x, y, z) in enumerate(field.tolist())
    ]
    assert sum(len(each.readings) for each in taken if each.readings is not None) == GOOD
    (event,) = (event for each in taken for event in each.events if event.kind == "no-answer")
    assert_sentences(event.words)


PROGRAM: Final = """
const { readLog, LineReader } = await load("lines.js");
const log = readLog(given, "log.csv", Uint8Array.from(atob(given.content), (letter) => letter.charCodeAt(0)));
const reader = new LineReader(given);
const rows = given.pieces.flatMap((piece, at) => reader.take(piece, at).rows);
return { field: [...log.field], words: log.words, arrived: rows.length, silence: reader.silence };
"""


@pytest.mark.parametrize("word", [0.0, -1.0, 0x8181])
def test_the_page_without_a_program_leaves_out_the_same(word: float, tmp_path: Path) -> None:
    path = csv(tmp_path / "log.csv", interrupted(tumble(), word, "every other row"))
    content = path.read_bytes()
    given: dict[str, Any] = {"lines": lines.data(), "content": base64.b64encode(content).decode()}
    page = run(PROGRAM, given | {"pieces": [f"{line}\n" for line in content.decode().splitlines()]})
    assert page["field"] == flinders.read(path).field.ravel().tolist()
    said = f"400 readings are {word:.0f}, {word:.0f}, {word:.0f}"
    assert f"{said}: the sensor did not answer" in page["words"]
    assert page["arrived"] == GOOD
    assert page["silence"].startswith(said)
