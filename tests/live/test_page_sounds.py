"""The page sounds what a person who turns a sensor has to know, once, and only where that is switched on."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.testing as npt
from tests.javascript import run

PLAY: Final = """
const kept = new Map(given.kept);
globalThis.localStorage = { getItem: (key) => kept.get(key) ?? null, setItem: (key, value) => kept.set(key, value) };
globalThis.window = globalThis;
const heard = [];
const gain = { gain: { setValueAtTime() {}, exponentialRampToValueAtTime() {} }, connect: () => gain };
globalThis.AudioContext = class {
    currentTime = 0;
    createOscillator() {
        const frequency = { value: 0 };
        return { frequency, connect: () => gain, start: () => heard.push(frequency.value), stop() {} };
    }
    createGain() { return gain; }
};
const { Sounds } = await load("../sounds.js");
const box = { checked: false, addEventListener: (_, act) => (box.change = act) };
const sounds = new Sounds(box);
const each = given.states.map(({ phase, step, seen, on }, i) => {
    heard.length = 0;
    if (on !== undefined) { box.checked = on; box.change(); heard.length = 0; }
    const view = { tiles_seen: Array.from({ length: 642 }, (_, tile) => Number(tile < seen)) };
    sounds.follow({ phase }, view, step ? { kind: "turn", step } : { kind: "around", step: 0 }, i);
    return [...heard];
});
return { each, kept: [...kept], checked: box.checked };
"""


def played(*states: dict[str, Any], kept: tuple[tuple[str, str], ...] = (("flinders-sounds", "on"),)) -> dict[str, Any]:
    """What is heard in each state."""
    usual = {"phase": "collecting", "step": 1, "seen": 0}
    done: dict[str, Any] = run(PLAY, {"states": [{**usual, **state} for state in states], "kept": kept})
    return done


def test_each_news_has_its_sound_and_none_is_repeated() -> None:
    each = played(
        {}, {}, {"seen": 12}, {"seen": 12}, {"seen": 12, "step": 2}, {"seen": 12, "step": 2, "phase": "wrong"},
        {"seen": 12, "step": 2, "phase": "wrong"}, {"seen": 12, "step": 0, "phase": "good"},
    )["each"]  # fmt: skip
    assert each == [[], [], [880], [], [660, 880], [220, 165], [], [523, 659, 784]]


def test_small_areas_add_up_and_a_session_that_is_begun_anew_counts_anew() -> None:
    each = played({}, {"seen": 6}, {"seen": 11}, {"seen": 12}, {"seen": 0}, {"seen": 11}, {"seen": 12})["each"]
    assert each == [[], [], [], [880], [], [], [880]]


def test_nothing_is_heard_until_sounds_are_switched_on_and_the_browser_remembers_that() -> None:
    done = played({}, {"phase": "wrong"}, {"on": True}, {"phase": "good"}, kept=())
    assert done["each"] == [[], [], [], [523, 659, 784]]
    assert done["kept"] == [["flinders-sounds", "on"]]
    assert played({}, {"phase": "good"})["checked"]


BEEPS: Final = """
globalThis.window = globalThis;
const { beepPeriod } = await load("../sounds.js");
const view = { shown: { offset: [10, 0, 0], matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], strength: 50 } };
const lead = { kind: given.kind, target: [1, 0, 0] };
return given.angles.map((angle) => beepPeriod(lead, view, [10 + 50 * Math.cos(angle), 50 * Math.sin(angle), 0]));
"""


def test_the_beep_is_faster_as_the_arrow_comes_nearer() -> None:
    angles = np.linspace(0.0, np.pi, 7).tolist()
    periods = run(BEEPS, {"kind": "arrow", "angles": angles})
    assert periods == sorted(periods)
    npt.assert_allclose([periods[0], periods[-1]], [0.12, 1.2])
    assert run(BEEPS, {"kind": "turn", "angles": angles}) == [None] * 7


NEARER: Final = """
const heard = [];
globalThis.window = globalThis;
globalThis.localStorage = { getItem: () => "on", setItem() {} };
const { Sounds } = await load("../sounds.js");
const sounds = new Sounds({ addEventListener() {} });
sounds.play = (sound) => heard.push(sound);
const view = { tiles_seen: [], shown: { offset: [0, 0, 0], matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], strength: 50 } };
const lead = { kind: "arrow", target: [1, 0, 0], step: 0 };
return [[-50, 0, 0], [50, 0, 0]].map((raw) => {
    heard.length = 0;
    const from = raw[0] > 0 ? 10 : 0;
    for (let at = 0; at < 60; at += 1) sounds.follow({ phase: "collecting" }, view, lead, from + at / 20, raw);
    return heard.length;
});
"""


def test_beeps_are_as_far_apart_as_the_arrow_is_far() -> None:
    far, near = run(NEARER, None)
    assert far == 3
    assert 18 <= near <= 25


SPOKEN: Final = """
globalThis.window = globalThis;
const { spokenWords } = await load("../voice.js");
return given.map((after, i) => spokenWords(i ? given[i - 1] : null, after));
"""


def test_each_sentence_is_spoken_once_and_a_fault_begins_with_its_name() -> None:
    turn = {"phase": "collecting", "step": 1, "words": "Turn it."}
    wrong = {"phase": "wrong", "step": 0, "words": "It is stuck."}
    good = {"phase": "good", "step": 0, "words": "Done: press Finish."}
    heard = [turn, turn, {**turn, "step": 2, "words": "Tip it."}, wrong, wrong, good, good]
    assert run(SPOKEN, heard) == [
        "Turn it.", "", "Turn done. Tip it.", "Wrong: It is stuck.", "", "Good. Done: press Finish.", "",
    ]  # fmt: skip
