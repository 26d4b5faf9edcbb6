"""The page without a server decides as the live session does: both go through one table of events."""

from __future__ import annotations

import json
from base64 import b64decode
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, get_args

import msgspec
import numpy as np
import pytest
from flinders.live.evaluation import evaluate
from flinders.live.page_state import Cursor, points, session_state
from flinders.live.session import (
    Arrived,
    FitDone,
    Linked,
    LiveSession,
    Opened,
    Requested,
    Series,
    Ticked,
    begin_fit,
    step,
    wants_fit,
)
from tests.javascript import run

import flinders
from flinders import simulate
from flinders.comparison.comparison import compare
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.live.buffer import ReadingBuffer, rows_of
from flinders.live.messages import Phase, encode, parse
from flinders.report.view import view
from flinders.standalone.package import session_rules

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.live.messages import Link

RATE_HZ: Final = 50.0
UT: Final = Unit.of("uT")
DIFFERENT: Final = {"revision", "previous", "recording", "can_send"}
"""Of the state: what the page counts otherwise, and what it has not."""
PLAY: Final = """
const [{ Session, seriesOf }, { Cursor, sessionState }] = await Promise.all(["session.js", "state.js"].map(load));
const { events, rules } = given;
const session = new Session(rules);
const cursor = new Cursor();
const unit = { inside: "uT", recorded: "uT", scale: 1 };
const act = {
    arrived: ({ at, time, field }) => session.arrived(at, { time: time.map((t) => t ?? NaN), field }, unit),
    linked: ({ at, link, words }) => session.linked(at, link, words),
    opened: ({ at, name, field }) => session.openedLog(at, name, seriesOf(rules, { time: null, field, unit })),
    requested: ({ at, command }) => session.requested(at, command),
    ticked: ({ at }) => session.ticked(at),
    begun: ({ at }) => session.wantsFit(at) && session.beginFit().numbers.length,
    fitted: ({ at, evaluated, seconds }) => session.fitDone(at, evaluated, seconds),
};
return events.map((event) => {
    const said = act[event.type](event);
    const frame = cursor.frame(session);
    const points = frame && Buffer.from(frame).toString("base64");
    return { state: sessionState(session), points, fitted: event.type === "begun" ? said : null };
});
"""


@dataclass(slots=True)
class Recorded:
    """A session that writes down its events, with what it shows after each."""

    session: LiveSession = field(default_factory=LiveSession)
    cursor: Cursor = field(default_factory=Cursor)
    events: list[dict[str, Any]] = field(default_factory=list)
    shown: list[dict[str, Any]] = field(default_factory=list)

    def arrived(self, at: float, rows: Floats) -> None:
        self.session, _ = step(self.session, Arrived(at, rows, UT))
        time = [None if np.isnan(each) else each for each in rows[:, 0].tolist()]
        self._note({"type": "arrived", "at": at, "time": time, "field": rows[:, 1:4].ravel().tolist()})

    def linked(self, at: float, link: Link, words: str) -> None:
        self.session, _ = step(self.session, Linked(at, link, words))
        self._note({"type": "linked", "at": at, "link": link, "words": words})

    def requested(self, at: float, **command: Any) -> None:
        self.session, _ = step(self.session, Requested(at, parse(json.dumps(command))))
        self._note({"type": "requested", "at": at, "command": command})

    def ticked(self, at: float) -> None:
        self.session, _ = step(self.session, Ticked(at))
        self._note({"type": "ticked", "at": at})

    def opened(self, at: float, name: str, rows: Floats) -> None:
        series = Series(ReadingBuffer.empty().extended(rows), UT, is_timed=False)
        self.session, _ = step(self.session, Opened(at, name, series, "a log"))
        self._note({"type": "opened", "at": at, "name": name, "field": rows[:, 1:4].ravel().tolist()})

    def fitted(self, at: float) -> None:
        """Fit where one is wanted; it takes a tenth of a second."""
        wanted = wants_fit(self.session, at)
        evaluated = evaluate(self.session)
        if wanted:
            self.session = begin_fit(self.session)
        self._note({"type": "begun", "at": at}, evaluated.used + evaluated.rejected if wanted else False)
        if not wanted:
            return
        self.session, _ = step(self.session, FitDone(at + 0.1, evaluated, 0.001))
        fields = ("key", "view", "refusal", "reasons", "used", "rejected")
        told = {name: msgspec.to_builtins(getattr(evaluated, name)) for name in fields}
        told["coverage"] = 0.0 if evaluated.fit is None else evaluated.fit.coverage.fraction
        told["alarms"] = sorted(evaluated.alarms)
        self._note({"type": "fitted", "at": at + 0.1, "evaluated": told, "seconds": 0.001})

    def _note(self, event: dict[str, Any], fitted: int | bool | None = None) -> None:
        frame, self.cursor = points(self.session, self.cursor)
        state = json.loads(encode(session_state(self.session)))
        self.events.append(event)
        self.shown.append({"state": state, "points": frame, "fitted": fitted})


def tumbled(seed: int, count: int) -> Floats:
    """Rows of a sensor that is turned all round, one a second."""
    return rows_of(Samples.of(simulate.tumble(seed=seed, n=count, noise=0.4).samples.field))


def a_session() -> Recorded:
    """A sensor that is turned, disturbed, paused, edited, gone and back; a log; and a start anew."""
    readings = tumbled(seed=4, count=3000)
    readings[:, 0] /= RATE_HZ
    readings[1400:1500, 1:4] += (14.0, -9.0, 6.0)
    told = Recorded()
    told.ticked(0.1)
    for second in range(56):
        told.arrived(1.0 + second, readings[50 * second : 50 * second + 50])
        told.fitted(1.05 + second)
        if second == 10:
            told.requested(11.2, type="target", deg=0.25)
        if second == 12:
            told.requested(13.2, type="pause", paused=True)
        if second == 14:
            told.requested(15.2, type="pause", paused=False)
            told.requested(15.3, type="undo")
            told.requested(15.4, type="undo")
            told.requested(15.5, type="redo")
        if second == 35:
            told.requested(36.2, type="exclude", start_s=27.9, end_s=30.1)
            told.requested(36.3, type="restore", start_s=30.0, end_s=30.05)
            told.requested(36.4, type="exclude", start_s=80.0, end_s=90.0)
            told.requested(36.5, type="goal", goal="attitude")
    told.ticked(57.5)
    told.fitted(57.6)
    told.ticked(61.0)
    told.linked(62.0, "gone", "the board is gone: plug it in again")
    told.requested(62.5, type="dip", deg=-30.0)
    told.fitted(62.6)
    told.requested(62.7, type="place", latitude_deg=48.2, longitude_deg=16.4, year=2026.9)
    told.fitted(62.9)
    again = readings[:100].copy()  # a clock that begins anew, and a time that is missing
    again[3, 0] = np.nan
    told.arrived(63.0, again)
    told.requested(63.5, type="target", deg=2.0)
    told.requested(63.6, type="goal", goal="heading")
    for second in range(4):
        told.fitted(64.0 + second)
    told.opened(70.0, "a.csv", tumbled(seed=5, count=400))
    told.requested(70.1, type="pause", paused=True)
    told.fitted(70.2)
    told.ticked(71.0)
    told.requested(72.0, type="back_to_live")
    told.fitted(72.1)
    told.requested(73.0, type="clear")
    told.arrived(73.5, readings[:7])
    told.linked(74.0, "ended", "")
    return told


def test_both_show_the_same_after_each_event() -> None:
    told = a_session()
    phases = {shown["state"]["phase"] for shown in told.shown}
    assert phases == set(get_args(Phase)), "the table visits every phase"
    played = run(PLAY, {"events": told.events, "rules": session_rules()})
    for event, expected, seen in zip(told.events, told.shown, played, strict=True):
        same(event, expected, seen)


def same(event: dict[str, Any], expected: dict[str, Any], seen: dict[str, Any]) -> None:
    """Compare what both show after an event."""
    kind = {name: value for name, value in event.items() if name not in ("field", "time", "evaluated")}
    for name, value in expected["state"].items():
        if name in DIFFERENT:
            continue
        assert seen["state"][name] == (pytest.approx(value) if isinstance(value, float) else value), (kind, name)
    assert seen["fitted"] == expected["fitted"], kind
    assert (seen["points"] is None) == (expected["points"] is None), kind
    if expected["points"] is not None:
        wanted, frame = (np.frombuffer(each, "<f4") for each in (expected["points"], b64decode(seen["points"])))
        np.testing.assert_array_equal(frame, wanted, err_msg=str(kind))


COMPARE: Final = """
const { compared } = await load("previous.js");
return compared(given.previous, given.view, { dipDeg: -35, targetDeg: 1, unit: given.unit });
"""


def test_an_earlier_calibration_is_as_far_off_as_flinders_compare_says() -> None:
    sensor = simulate.Sensor.random(np.random.default_rng(3))
    moved = sensor.offset + np.array([1.0, 2.0, -3.0])
    changed = simulate.Sensor(offset=moved, matrix=sensor.matrix @ np.diag([1.0, 1.04, 1.0]))
    tumbles = [simulate.tumble(seed=9, sensor=each).samples for each in (sensor, changed)]
    before, now = map(flinders.fit, tumbles)
    asked = {
        "previous": {"name": "old.json", "calibration": numbers_of(before)},
        "view": msgspec.to_builtins(view(now, tumbles[1])),
    }
    answer = run(COMPARE, {**asked, "unit": "µT"})
    worst = compare(before, now, dip_deg=-35.0).heading_difference_deg.worst
    assert answer["change_deg"] == pytest.approx(worst, rel=1e-6)
    assert f"{worst:.1f}" in answer["words"]
    assert "counts" in run(COMPARE, {**asked, "unit": "counts"})["words"]


def numbers_of(fit: flinders.Fit) -> dict[str, Any]:
    """A calibration as the page has it."""
    calibration = fit.calibration
    return {
        "matrix": calibration.matrix.tolist(),
        "offset": calibration.offset.tolist(),
        "fieldStrength": calibration.field_strength,
        "fieldStrengthKnown": calibration.field_strength_known,
        "unit": calibration.unit,
    }
