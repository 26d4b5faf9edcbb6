"""The page sounds what a person who turns a sensor has to know, once, and only where that is switched on."""

from __future__ import annotations

from typing import Any, Final

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
