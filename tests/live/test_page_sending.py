"""The page without a program sends to a board what `flinders send` sends, and believes the same echo."""

from __future__ import annotations

from base64 import b64encode
from typing import Any, Final

import numpy as np
import pytest
from tests.javascript import run
from tests.sentences import assert_sentences

from flinders.links.motioncal import echo_lines
from flinders.targets.motioncal import MotionCalPacket

SEND: Final = """
const { send } = await load("sending.js");
globalThis.setTimeout = (act) => queueMicrotask(act);
const packet = Uint8Array.from(Buffer.from(given.packet, "base64"));
const written = [];
const board = {
    echoes: null,
    async write(piece) {
        if (given.isGone) throw new Error("gone");
        written.push(...piece);
        const whole = written.length / packet.length;
        if (Number.isInteger(whole)) for (const text of given.answers[whole - 1] ?? []) board.echoes.take(text);
    },
};
const said = await send(board, packet).then((words) => ({ words }), ({ message }) => ({ refusal: message }));
return { ...said, written: Buffer.from(written).toString("base64"), isListening: board.echoes !== null };
"""
PACKET: Final = MotionCalPacket(
    np.array([10.0, -20.5, 30.25]), 50.0, np.array([[1.25, 0.1, -0.05], [0.1, 1.0, 0.02], [-0.05, 0.02, 0.8]])
)
ECHO: Final = "".join(f"{line}\r\n" for line in echo_lines(PACKET))


def sent(*answers: list[str], is_gone: bool = False) -> dict[str, Any]:
    """What a board that answers so to each packet makes of it."""
    content = b64encode(PACKET.encode()).decode()
    done: dict[str, Any] = run(SEND, {"packet": content, "answers": answers, "isGone": is_gone})
    assert not done["isListening"]
    return done


@pytest.mark.parametrize("pieces", [[ECHO], [ECHO[:30], ECHO[30:70], ECHO[70:]], ["Raw:1,2,3,4,5,6,7,8,9\r\n" + ECHO]])
def test_a_board_that_echoes_what_it_was_sent_has_confirmed_it(pieces: list[str]) -> None:
    done = sent(pieces)
    assert_sentences(done["words"])
    assert done["written"] == b64encode(PACKET.encode()).decode()


def test_a_board_that_loses_the_first_packet_is_sent_it_again() -> None:
    assert sent([], [ECHO])["words"].endswith("at try 2")


def test_other_numbers_are_no_confirmation() -> None:
    other = ECHO.replace("-20.500", "-20.530")
    done = sent([other], [other], [other])
    assert_sentences(done["refusal"])


def test_a_board_that_says_nothing_of_what_it_holds_is_not_believed() -> None:
    assert_sentences(sent()["refusal"])
    assert_sentences(sent(*[[ECHO.split("\r\n")[0] + "\r\n"]] * 3)["refusal"])
    assert_sentences(sent(*[["Cal1:1,2\r\nCal2:x\r\n"]] * 3)["refusal"])


def test_a_board_that_is_gone_is_said() -> None:
    assert sent(is_gone=True)["refusal"] == "gone"
