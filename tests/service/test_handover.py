"""When a calibration is handed to what readings come from: only if it is better there, safe, and not too often."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.sentences import assert_sentences
from tests.service.test_watch import MOVED, driven

from flinders import Calibration, OnlineCalibration
from flinders.apps.service.handover import CHECK_PERIOD_S, Handover
from flinders.errors import NotConfirmed, NotSent
from flinders.links.recipients import Recipient
from flinders.workflows.online_events import ACTIVITIES

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

HOUR_S = 3600.0


@dataclass
class Board:
    """Something that takes calibrations."""

    held: Calibration
    name: str = "the board"
    refusal: str = ""
    failure: Exception | None = None
    is_told: bool = True
    sent: list[Calibration] = field(default_factory=list)
    suffix: str = ".param"

    def on_board(self, _: float) -> Calibration | None:
        return self.held if self.is_told else None

    def transfer(self, calibration: Calibration) -> Any:  # noqa: ANN401 - itself
        self._next = calibration
        return self

    @property
    def is_done(self) -> bool:
        return self._next.isclose(self.held)

    def backup(self) -> str:
        return f"{self.held.offset}\n"

    def carry_out(self, *, stopped: Callable[[], bool], say: Callable[[str], None]) -> str:  # noqa: ARG002
        if self.failure is not None:
            raise self.failure
        self.held = self._next
        self.sent.append(self._next)
        return "it holds it"


@pytest.fixture
def online() -> OnlineCalibration:
    time, field_ut = driven(300.0)
    online = OnlineCalibration()
    online.add(field_ut, time=time)
    return online


class Clock:
    now = 1.79e9

    def __call__(self) -> float:
        return self.now


class Desk:
    """A board, a calibration, and what hands it over."""

    def __init__(self, online: OnlineCalibration, folder: Path, **more: Any) -> None:
        self.online, self.folder, self.clock = online, folder, Clock()
        self.board = Board(Calibration.identity(field_strength=50.0), **more)
        self.handover = self.anew()

    def anew(self) -> Handover:
        return Handover(self.board, str(self.folder), interval_s=HOUR_S, clock=self.clock)

    def look(self, after: float = CHECK_PERIOD_S) -> tuple[str, str] | None:
        self.clock.now += after
        return self.handover.send_if_due(self.online, self.online.time_s)


def test_what_is_better_is_sent_once_and_what_was_before_is_kept(online: OnlineCalibration, tmp_path: Path) -> None:
    desk = Desk(online, tmp_path)
    assert isinstance(desk.board, Recipient)
    event, words = desk.look() or ("", "")
    assert event == "sent"
    assert_sentences(words)
    assert online.calibration is not None
    assert desk.board.sent[0].isclose(online.calibration)
    (kept,) = tmp_path.iterdir()
    assert kept.read_text() == "[0. 0. 0.]\n"
    assert [desk.look(HOUR_S) for _ in range(3)] == [None] * 3
    assert len(desk.board.sent) == 1


def test_it_is_sent_no_more_often_than_each_hour_also_when_started_again(
    online: OnlineCalibration, tmp_path: Path
) -> None:
    desk = Desk(online, tmp_path)
    assert desk.look() is not None
    time, field_ut = driven(120.0, seed=3)
    online.add(field_ut + MOVED, time=online.time_s + 60.0 + time)
    assert online.state.doing == "undisturbed"
    assert desk.look(HOUR_S / 2) is None
    desk.handover = desk.anew()
    assert desk.look() is None
    assert (desk.look(HOUR_S / 2) or ("",))[0] == "sent"
    np.testing.assert_allclose(desk.board.held.offset, [17.0, -27.0, 4.0], atol=1.0)
    assert len(list(tmp_path.iterdir())) == 2


def test_nothing_is_sent_while_it_is_disturbed(online: OnlineCalibration, tmp_path: Path) -> None:
    desk = Desk(online, tmp_path)
    online._record["state"] = ACTIVITIES.index("disturbed")
    assert desk.look() is None
    online._record["state"] = ACTIVITIES.index("undisturbed")
    assert (desk.look() or ("",))[0] == "sent"


def test_an_armed_vehicle_is_waited_for_and_told_once(online: OnlineCalibration, tmp_path: Path) -> None:
    desk = Desk(online, tmp_path, refusal="it is armed")
    event, words = desk.look() or ("", "")
    assert event == "waits"
    assert_sentences(words)
    assert desk.look() is None
    desk.board.refusal = ""
    assert (desk.look() or ("",))[0] == "sent"


def test_what_tells_nothing_of_an_axis_is_not_sent(online: OnlineCalibration, tmp_path: Path) -> None:
    desk = Desk(online, tmp_path)
    online._record["is_level"] = 1
    event, words = desk.look() or ("", "")
    assert event == "waits"
    assert_sentences(words)
    online._record["is_level"] = 0
    online._record["latest_covariance"][20] = 12.0**2
    event, words = desk.look() or ("", "")
    assert (event, "off by up to 12 µT" in words) == ("waits", True)
    assert desk.board.sent == []


def test_what_is_on_board_and_as_good_stays(online: OnlineCalibration, tmp_path: Path) -> None:
    desk = Desk(online, tmp_path)
    assert online.calibration is not None
    c = online.calibration
    desk.board.held = Calibration(1.2 * c.matrix, c.offset + 0.01, 1.2 * c.field_strength)
    assert desk.look() is None
    assert desk.handover.send_if_due(OnlineCalibration(), 0.0) is None


def test_where_nobody_knows_what_is_on_board_it_has_to_be_within_the_target(
    online: OnlineCalibration, tmp_path: Path
) -> None:
    desk = Desk(online, tmp_path, is_told=False)
    later = online.time_s + 7 * 86400.0
    desk.clock.now += CHECK_PERIOD_S
    assert desk.handover.send_if_due(online, later) is None
    assert (desk.look() or ("",))[0] == "sent"


@pytest.mark.parametrize("failure", [NotSent("nothing was changed"), NotConfirmed("DO NOT ARM")])
def test_a_failure_is_told_and_tried_again_after_the_interval(
    online: OnlineCalibration, tmp_path: Path, failure: Exception
) -> None:
    desk = Desk(online, tmp_path, failure=failure)
    event, words = desk.look() or ("", "")
    assert (event, str(failure) in words) == ("not-sent", True)
    assert_sentences(words)
    assert str(failure) in desk.handover.failure
    assert desk.look() is None
    desk.board.failure = None
    assert (desk.look(HOUR_S) or ("",))[0] == "sent"
    assert desk.handover.failure == ""
