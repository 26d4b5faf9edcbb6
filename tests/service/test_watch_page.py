"""The page of a watch: what it says in each state, what it draws, and that nothing of it is fetched."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, datetime
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.program import flinders_
from tests.sentences import assert_sentences
from tests.service.test_watch import BEGUN_S, DRIVE, MOVED, driven, table

from flinders import OnlineCalibration, Samples
from flinders.apps.service.sources import of_recordings
from flinders.apps.service.timeline_figures import timeline
from flinders.apps.service.watch_page import page
from flinders.apps.service.watching import Files, Watch
from flinders.workflows.timeline import OnlinePoint

if TYPE_CHECKING:
    from flinders.apps.service.reports import Report

NOW = datetime(2026, 9, 21, 14, 30, tzinfo=UTC)


@pytest.fixture(scope="module")
def known() -> tuple[OnlineCalibration, Report]:
    """What is known after ten minutes, in which the offset moved."""
    watch = Watch(of_recordings([Samples.of(DRIVE[1], unit="uT", time=BEGUN_S + DRIVE[0], source="drive.csv")]))
    report = watch.run()
    assert watch._online is not None
    return watch._online, report


def said(html: str) -> str:
    """The text of a page, without marks and doubled blanks."""
    body = html.split("<body>")[1].split("<script", maxsplit=1)[0]
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", body)).split())


def test_it_says_what_is_known_now(known: tuple[OnlineCalibration, Report]) -> None:
    online, report = known
    text = said(page(report, online, every=60.0, written=NOW))
    assert f"{report.heading_error_deg:.2g}°" in text
    assert_sentences(text, about="target of 1°")
    assert_sentences(text, about="newest readings")
    assert "moved, and was learnt" in text
    assert "12,000 since" in text
    assert f"Good until {report.good_until[11:16]} " in text  # type: ignore[index]
    assert "A first calibration was found" in text


def test_it_says_what_is_wrong(known: tuple[OnlineCalibration, Report]) -> None:
    online, report = known
    wrong = replace(
        report, doing="disturbed", verdict="refused", heading_error_deg=23.0, is_connected=False, is_locked=True
    )
    told = [replace(report, kind="source", event="gone", words="/dev/ttyACM0 is gone", heading_error_deg=None)]
    text = said(page(wrong, online, told=told, troubles=["boat.state: cannot be written"], every=60.0))
    assert_sentences(text, about="23°")
    assert_sentences(text, about="newest readings")
    assert_sentences(text, about="Boat.state")
    assert "No sensor." in text
    assert "Locked." in text
    assert "/dev/ttyACM0 is gone" in text
    assert "No calibration yet" in said(page(Watch(of_recordings([])).report(), None))


def test_nothing_is_fetched_and_names_are_escaped(known: tuple[OnlineCalibration, Report]) -> None:
    online, report = known
    html = page(replace(report, source="<script>alert(1)</script>"), online, every=60.0)
    assert "<script>alert" not in html
    assert "://" not in html
    assert "default-src 'none'" in html
    assert 'http-equiv="refresh" content="60"' in html
    names = re.findall(r'clipPath id="([^"]+)"', html)
    assert len(names) == len(set(names))
    for chart in re.findall(r'<svg class="figure".*?</svg>', html, re.DOTALL):
        ElementTree.fromstring(chart)
        assert "nan" not in chart
        assert "inf" not in chart


def test_the_last_page_is_not_loaded_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("drive.csv").write_text(table(BEGUN_S + DRIVE[0][:3000], DRIVE[1][:3000]))
    assert flinders_("watch", "--replay", "drive.csv", "--page", "boat.html").code == 0
    html = Path("boat.html").read_text(encoding="utf-8")
    assert "refresh" not in html
    assert "data-every" not in html
    assert_sentences(said(html), about="ended")


def test_a_page_is_written_at_events_and_not_more_often_than_each_two_seconds() -> None:
    now, written = [0.0], list[float]()
    samples = [
        Samples.of(DRIVE[1][row : row + 20], unit="uT", time=DRIVE[0][row : row + 20]) for row in range(0, 3000, 20)
    ]

    def stopped() -> bool:
        now[0] += 0.05
        return False

    def write(_: object) -> bool:
        written.append(now[0])
        return True

    watch = Watch(
        of_recordings(samples), files=Files(page="boat.html"), stopped=stopped, clock=lambda: now[0], every=1e9
    )
    watch._page.write = write  # type: ignore[method-assign, assignment]
    watch.run()
    assert len(written) > 2  # at the beginning, at events, at the end
    assert np.diff(written[:-1]).min() >= 2.0


def test_a_timeline_of_any_kind_is_drawn() -> None:
    empty = OnlinePoint(0.0, "learning")
    point = OnlinePoint(60.0, "undisturbed", 0.5, 1.0, (1.0, 2.0, 3.0), (0.1, 0.1, 0.1), events=("learnt", "adopted"))
    far = replace(point, time_s=3e9, heading_error_deg=900.0, bound_deg=2000.0, is_read=False, events=("moved",))
    for points in ([empty], [empty, replace(empty, time_s=1.0)], [empty, point], [point], [empty, point, far], [far]):
        for is_wide in (True, False):
            chart = timeline(points, target_deg=1.0, unit="µT", wide=is_wide)
            ElementTree.fromstring(chart)
            assert "nan" not in chart
    assert chart.count('class="mark moved"') == 1


def test_what_was_known_of_the_offsets_is_drawn(known: tuple[OnlineCalibration, Report]) -> None:
    online, _ = known
    time, field = driven(60.0, seed=5)
    online.add(field + MOVED, time=BEGUN_S + 700.0 + time)
    points = online.timeline_until(BEGUN_S + 700.0 + 86400.0)
    assert [point.is_read for point in points[-8:]] == [False] * 8
    assert points[-1].time_s == BEGUN_S + 700.0 + 86400.0
    chart = timeline(points, target_deg=1.0, unit="µT", wide=True)
    assert chart.count('class="unread"') == 4
    assert chart.count('class="moved"') == 4
