"""The choreography and the lead of the page: turns are noticed, wrong ones do not trap, and words stand still."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final

import pytest
from benchmarks.turning import play
from tests.javascript import run

from flinders.native import build

TURN: Final = """
const [{ advance, begin, isOver, progress, SEQUENCES }, { rotated, rotation }] =
    await Promise.all(["choreography.js", "../../../../static/views/turn.js"].map(load));
const view = (strength) => ({ shown: { strength, offset: [0, 0, 0], matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]] },
    any_attitude_deg: { rms: 1, worst: 2 }, tiles_seen: [], tiles_deg: [] });
const known = given.strength ? view(given.strength) : null;
let now = begin(given.body ?? "board");
let count = 0;
const seen = [];
let chance = 1;
const noise = () => (chance = (chance * 16807) % 2147483647) / 2147483647 - 0.5;
for (const { axis, from, angles, rate = 1, gravity = null } of given.turns) {
    for (const degrees of angles.length ? angles : [0]) {
        const turn = rotation({ axis, angle: (degrees * Math.PI) / 180 });
        const field = rotated(turn, from).map((part, i) => 50 * part + [80, -60, 30][i] + 0.2 * noise());
        const lies = gravity && rotated(turn, gravity).map((part) => 9.81 * part);
        now = advance(now, { time: [0.02 * count++], field, acceleration: lies }, known);
    }
    seen.push([now.step, progress(now)]);
}
return { seen, over: isOver(now), of: SEQUENCES[now.body].length };
"""
"""Turns of a noisy sensor with an offset; where it has come after each."""


def once(axis: tuple[float, ...], start: tuple[float, ...], degrees: float = 360.0, **more: Any) -> dict[str, Any]:
    """A turn at 60° a second."""
    step = 1.2 if degrees > 0 else -1.2
    return {"axis": axis, "from": start, "angles": [step * i for i in range(int(degrees / step) + 1)], **more}


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
SLANTED: Final = (0.6, 0.64, 0.48)


def test_three_turns_about_three_axes_are_three_steps() -> None:
    done = run(TURN, {"turns": [once(Z, SLANTED), once(X, SLANTED), once(Y, SLANTED)], "strength": 50.0})
    assert [step for step, _ in done["seen"]] == [1, 2, 3]
    assert done["over"]


def test_progress_is_the_share_of_the_turn() -> None:
    """A whole turn of a drone, and half a turn of a board."""
    for body, share in (("drone", 0.25), ("board", 0.5)):
        done = run(TURN, {"turns": [once(Z, SLANTED, 90.0)], "strength": 50.0, "body": body})
        assert done["seen"][0][1] == pytest.approx(share, abs=0.25 * share)


def test_the_same_turn_again_is_no_second_step() -> None:
    done = run(TURN, {"turns": [once(Z, SLANTED), once(Z, SLANTED), once(X, SLANTED)], "strength": 50.0})
    assert [step for step, _ in done["seen"]] == [1, 1, 2]


def test_rocking_is_no_turn() -> None:
    there = [1.2 * i for i in range(20)]
    rocked = {"axis": X, "from": Z, "angles": [*there, *reversed(there)] * 4}
    done = run(TURN, {"turns": [rocked], "strength": 50.0})
    assert done["seen"][0][0] == 0
    assert done["seen"][0][1] < 0.2


def test_a_field_along_the_axis_does_not_trap() -> None:
    """Turned about the field: the accelerometer tells; without one, the time does, as far as anything moves."""
    told = once(Z, (0.02, 0.0, 1.0), gravity=X)
    assert run(TURN, {"turns": [told], "strength": 50.0})["seen"][0][0] == 1
    slow = {**once(Z, (0.2, 0.0, 0.98)), "angles": [0.6 * i for i in range(1200)]}
    assert run(TURN, {"turns": [slow], "strength": 50.0})["seen"][0][0] >= 1


@pytest.mark.parametrize("body", ["car", "boat"])
def test_what_stays_level_is_asked_for_level_circles(body: str) -> None:
    circles = [once(Z, (0.5, 0.0, -0.87)), once(Z, (0.5, 0.0, -0.87), -360.0)]
    done = run(TURN, {"turns": circles, "body": body, "strength": 50.0})
    assert [step for step, _ in done["seen"]] == [1, 2]
    assert done["of"] == 2


LEAD: Final = """
const { lead } = await load("lead.js");
const { begin } = await load("choreography.js");
const state = { phase: "collecting", words: "", readings: 500, paused: false, finished: null, opened: null,
    source: { link: "connected", kind: "serial" }, reasons: [], ...given.state };
const shown = { offset: [0, 0, 0], matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], strength: 50 };
const choreography = { ...begin(given.body ?? "board"), step: given.step };
let now = null;
return given.events.map(([at, direction, raw, phase]) => {
    const guidance = direction && { direction, words: "", is_path: true, frame: "sensor" };
    const view = { shown, guidance, tiles_seen: [], tiles_deg: [] };
    now = lead(now, { at, state: { ...state, phase: phase ?? state.phase }, view, choreography, raw, centres: [] });
    return now;
});
"""
RAW: Final = [50.0, 0.0, 0.0]


def led(events: list[list[Any]], **given: Any) -> list[dict[str, Any]]:
    """Leads after each of some events: when, where the field is to point, and points; and the phase, if another."""
    leads: list[dict[str, Any]] = run(LEAD, {"events": events, "step": 3, **given})
    return leads


def test_a_target_stands_until_it_is_reached_or_five_seconds_have_passed() -> None:
    up, down = [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]
    leads = led([[0, up, RAW], [2, down, RAW], [4, down, RAW], [5.1, down, RAW], [7, up, RAW], [8.5, up, [0, 5, -50]]])
    assert [each["target"] for each in leads] == [up, up, up, down, down, up]
    assert {each["kind"] for each in leads} == {"arrow"}


def test_words_and_target_change_together_and_twelve_times_a_minute_at_most() -> None:
    ways = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]]
    events = [[0.1 * i, ways[i // 3 % 4], [50.0 * part for part in ways[(i // 3 + 2) % 4]]] for i in range(3000)]
    leads = led(events)
    changes = [after["since"] for before, after in pairwise(leads) if after["words"] != before["words"]]
    assert all(
        before["target"] == after["target"] for before, after in pairwise(leads) if before["since"] == after["since"]
    )
    assert min(after - before for before, after in pairwise(changes)) >= 3.0
    assert max(sum(at <= other < at + 60.0 for other in changes) for at in changes) <= 12


def test_what_is_good_or_wrong_is_said_at_once() -> None:
    up = [0.0, 0.0, 1.0]
    leads = led([[0, up, RAW], [1, up, RAW, "good"], [1.2, up, RAW, "wrong"]], state={"words": "The sensor is gone."})
    assert [each["kind"] for each in leads] == ["arrow", "done", "wrong"]


def test_a_car_is_never_asked_to_turn_over() -> None:
    leads = led([[0, [0.0, 0.0, 1.0], RAW]], body="car", step=2)
    assert leads[0]["kind"] == "around"
    assert leads[0]["target"] is None


@pytest.mark.parametrize("who", ["always", "turns"])
def test_who_does_what_the_page_asks_is_done_soon(who: str) -> None:
    """Table: docs/guidance.md."""
    try:
        build.library(target=build.WEB_PLATFORM)
    except build.NoCompiler as error:
        pytest.skip(str(error))
    runs = play([{"seed": seed, "who": who, "halts": 0, "body": "board", "dip": 60, "most_s": 60} for seed in range(6)])
    assert max(each.seconds for each in runs) < 30.0
    assert max(each.words for each in runs) <= 12
