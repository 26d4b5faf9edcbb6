"""The recorder without its command: bytes in, text, readings and events out; torn recordings are continued."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner
from tests.feeding import asked
from tests.sentences import assert_raises, assert_sentences

from flinders import simulate
from flinders.cli import main
from flinders.errors import OutputError
from flinders.links.feeds import FeedEvent
from flinders.links.recorder import Recorder
from flinders.links.recording_text import ResumedRecording
from flinders.links.sinks import FileSink
from flinders.links.transcript import MAX_LINE_BYTES, Transcript
from flinders.links.transports import Disconnection, ScriptedSource, Silence
from flinders.readers import read

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.arrays import Floats
    from flinders.core.samples import Samples

FIELD = np.round(simulate.tumble(seed=3).samples.field[:40], 1)
"""µT to the 0.1 µT of MotionCal's counts."""


def raw(rows: Floats = FIELD) -> bytes:
    return "".join(f"Raw:0,0,8192,0,0,16,{','.join(f'{10 * v:.0f}' for v in row)}\r\n" for row in rows).encode()


def table(rows: Floats = FIELD, header: str = "mx_uT,my_uT,mz_uT\n") -> bytes:
    return (header + "".join(f"{x:.1f},{y:.1f},{z:.1f}\n" for x, y, z in rows)).encode()


def fed(recorder: Recorder, source: ScriptedSource) -> tuple[Samples, list[FeedEvent]]:
    """Ask until the script is at its end, and then for what is left."""

    def is_over(_: Samples, events: list[FeedEvent]) -> bool:
        if source.is_done:
            recorder.close()
        return bool(events) and events[-1].kind == "ended"

    readings, events = asked(recorder, is_over)
    return readings, events[:-1]


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


# readings and events


@pytest.mark.parametrize(
    "content",
    [
        raw(),
        table(),
        b"t_ms;mx_uT;my_uT;mz_uT;T_C\n" + b"".join(b"%d;1,5;2;%d;21,5\n" % (20 * n, n) for n in range(30)),
        b"".join(b'{"mag": {"x": 1.50, "y": %d, "z": -3}, "t": %d}\n' % (n, n) for n in range(30)),
        b"t_ns,mx_uT,my_uT,mz_uT\n" + b"".join(b"17%017d,1,nan,3\n17%017d,1,2,3\n" % (n, n + 1) for n in range(0, 9)),
    ],
    ids=["Raw", "table", "own time", "JSON", "epochs and gaps"],
)
def test_readings_are_those_that_the_file_gives(content: bytes) -> None:
    rng = np.random.default_rng(0)
    cuts = np.sort(rng.integers(0, len(content), 15)).tolist()
    source = ScriptedSource([content[a:b] for a, b in zip([0, *cuts], [*cuts, len(content)], strict=True) if b > a])
    with FileSink("out.csv") as sink:
        readings, events = fed(Recorder(source, sink), source)
    live, kept = readings, read("out.csv")
    assert [event.kind for event in events] == ["connected", "settled"]
    np.testing.assert_array_equal(live.field, kept.field)
    assert live.unit.inside == kept.unit.inside
    for column in ("time", "acceleration", "rate", "temperature"):
        one, other = getattr(live, column), getattr(kept, column)
        assert (one is None) == (other is None), column
        if one is not None:
            np.testing.assert_array_equal(one, other)


def test_columns_and_unit_that_the_lines_do_not_tell_are_those_asked_for() -> None:
    content = b"x\n" + b"1,2,3,217,4,-586\n" * 30
    for options, count in (({}, 0), ({"columns": "c4,c5,c6", "unit": "mG"}, 30)):
        source = ScriptedSource([content])
        with FileSink("out.csv", force=True) as sink:
            readings, _ = fed(Recorder(source, sink, **options), source)  # type: ignore[arg-type]
        assert len(readings) == count
    assert readings.field[0] == pytest.approx((21.7, 0.4, -58.6))
    assert readings.unit.inside == "uT"


def test_lines_whose_magnetometer_is_not_clear_are_recorded_and_said_to_be_unclear() -> None:
    source = ScriptedSource([b"x\n" + b"1,2,3,217,4,-586\n" * 30])
    with FileSink("out.csv") as sink:
        readings, events = fed(Recorder(source, sink), source)
    assert [event.kind for event in events] == ["connected", "settled", "unclear"]
    assert "three of t_s,c1,c2,c3,c4,c5,c6" in events[-1].words
    assert len(readings) == 0
    assert Path("out.csv").read_text(encoding="utf-8").count("217,4,-586") == 30


def test_a_loss_and_a_return_are_events_between_the_readings() -> None:
    source = ScriptedSource([raw(FIELD[:20]), Disconnection(), raw(FIELD[20:])])
    order: list[str] = []
    with FileSink("out.csv") as sink:
        recorder = Recorder(source, sink)
        while not source.is_done:
            found = recorder.next(0.05)
            order += [found.kind] if isinstance(found, FeedEvent) else [] if found is None else ["readings"]
        recorder.close()
    assert order == ["connected", "settled", "readings", "gone", "back", "readings"]
    np.testing.assert_allclose(read("out.csv").field, FIELD)


def test_silence_and_other_lines_are_events() -> None:
    transcript = Transcript("the board")
    assert [event.kind for event in transcript.take(b"", 3.1).events] == ["silent"]
    assert transcript.take(b"", 9.0).events == []  # once
    assert transcript.take(b"noise", 60.0).events == []
    assert [event.kind for event in transcript.take(b"", 63.1).events] == ["nothing"]
    transcript = Transcript("the board")
    events = transcript.take(raw() + b"1;2;3\n" * 60, 0.5).events
    assert [event.kind for event in events] == ["settled", "garbage"]


def test_a_header_long_before_a_slow_sensors_first_reading_counts() -> None:
    """At 1 Hz the header is let go of, as a comment, before the first row is there."""
    transcript = Transcript("the board")
    text = transcript.take(b"mx_uT,my_uT,mz_uT\n", 0.0).text + transcript.take(b"", 1.0).text
    for second in range(2, 8):
        taken = transcript.take(b"21.7,0.4,-58.6\n", second)
        text += taken.text + transcript.take(b"", second + 0.95).text
    Path("out.csv").write_text(text, encoding="utf-8")
    assert transcript.statistics.form is not None
    assert transcript.statistics.unit == "µT"
    assert read("out.csv").unit.name == "uT"


def test_a_line_that_is_too_long_is_one_line_not_understood_and_no_reading() -> None:
    """A megabyte of numbers between two rows, cut anywhere: none of its pieces is a row, and no byte is lost."""
    long = b"1.5,2.5,3.5," * 90_000
    content = table(FIELD[:20]) + long + b"\n" + table(FIELD[20:], header="")
    said: list[str] = []
    source = ScriptedSource([content[start : start + 65_521] for start in range(0, len(content), 65_521)])
    with FileSink("out.csv") as sink:
        told = Recorder(source, sink, stopped=lambda: source.is_done, say=said.append).run()
    assert (told.readings, told.unknown) == (40, 1)
    assert not any(line.startswith("!") for line in said)
    text = Path("out.csv").read_text(encoding="utf-8")
    kept = "".join(line.removeprefix("# too long: ") for line in text.splitlines() if line.startswith("# too long"))
    assert kept.encode() == long
    np.testing.assert_allclose(read("out.csv").field, FIELD)


def test_bytes_without_line_ends_are_bounded_and_told_as_such() -> None:
    transcript = Transcript("the board")
    for second in range(50):
        taken = transcript.take(b"21.7 0.4 -58.6 " * 1000, second / 100)
        assert taken.readings is None
    assert len(transcript._rest) <= MAX_LINE_BYTES
    transcript = Transcript("the board")
    transcript.take(b"21.7 0.4 -58.6 " * 20, 1.0)
    transcript.end(2.0)
    assert_sentences(transcript.nothing())


def test_a_layout_that_fits_none_of_the_lines_settles_nothing() -> None:
    """A time of day in front is no number: nothing is settled, and lines that follow and are understood still are."""
    transcript = Transcript("the board")
    assert transcript.take(b"12:30:05 1.0 2.0\n" * 30, 0.5).events == []
    assert transcript.statistics.form is None
    readings = transcript.take(raw(), 1.0).readings
    assert readings is not None
    assert len(readings) == 40


# what a crash leaves


def begun(rows: Iterable[str], torn: str = "") -> None:
    """A recording as it lies there after a crash, ten seconds old."""
    start = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(time.time() - 10))
    body = "".join(f"{row}\n" for row in rows)
    title = f"# flinders 0.1.0 record: the board, begun {start}.000Z\n"
    Path("old.csv").write_text(f"{title}{body}{torn}", encoding="utf-8")


HEADER = "t_s,mx_uT,my_uT,mz_uT"


def test_a_torn_recording_is_continued_and_nothing_of_it_lost() -> None:
    begun([HEADER, "0.1000,1.0,2.0,3.0", "0.2000,1.1,2.0,3.0"], torn="0.3000,1.2,2.0,-5")
    source = ScriptedSource([table()])
    resumed = ResumedRecording.of("old.csv")
    assert (resumed.header, resumed.rows[0]) == (HEADER, "0.1000,1.0,2.0,3.0")
    with FileSink("old.csv", resume=True) as sink:
        readings, _ = fed(Recorder(source, sink, resumed=resumed), source)
    text = Path("old.csv").read_text(encoding="utf-8")
    assert "# cut off: 0.3000,1.2,2.0,-5\n" in text
    assert text.count(f"\n{HEADER}\n") == 1
    kept = read("old.csv")
    np.testing.assert_allclose(kept.field, [[1.0, 2, 3], [1.1, 2, 3], *FIELD])
    assert kept.time is not None
    assert (np.diff(kept.time) > 0).all()
    assert 10 <= kept.time[2] < 14  # since the beginning of the first
    np.testing.assert_array_equal(readings.time, kept.time[2:])


@pytest.mark.parametrize(
    ("rows", "torn"),
    [([], ""), ([], "t_s,mx_"), ([HEADER], ""), ([HEADER, "# lost at 0.1 s"], "# back a"), ([], "# boot")],
)
def test_a_recording_that_ended_before_its_first_row_is_continued(rows: list[str], torn: str) -> None:
    begun(rows, torn)
    source = ScriptedSource([table()])
    with FileSink("old.csv", resume=True) as sink:
        fed(Recorder(source, sink, resumed=ResumedRecording.of("old.csv")), source)
    np.testing.assert_allclose(read("old.csv").field, FIELD)


def test_any_tear_is_mended() -> None:
    begun([HEADER, *[f"{n / 10:.4f},{n}.5,2.0,3.0" for n in range(30)]])
    whole = Path("old.csv").read_bytes()
    first = whole.index(b"\n") + 1
    for end in np.random.default_rng(0).integers(first, len(whole), 40).tolist():
        Path("old.csv").write_bytes(whole[:end])
        source = ScriptedSource([table()])
        with FileSink("old.csv", resume=True) as sink:
            fed(Recorder(source, sink, resumed=ResumedRecording.of("old.csv")), source)
        kept = whole[:end].rpartition(b"\n")[0]
        count = max(kept.count(b"\n") - 1, 0)
        np.testing.assert_allclose(read("old.csv").field[count:], FIELD)
        assert Path("old.csv").read_bytes().startswith(kept)


def test_another_sensor_does_not_go_on_with_a_recording() -> None:
    begun([HEADER, "0.1000,1.0,2.0,3.0"])
    source = ScriptedSource([raw()])
    recorder = Recorder(source, FileSink("old.csv", resume=True), resumed=ResumedRecording.of("old.csv"))
    with assert_raises(OutputError):
        fed(recorder, source)
    np.testing.assert_allclose(read("old.csv").field, [[1, 2, 3]])


def test_what_is_no_recording_is_not_continued() -> None:
    with assert_raises(OutputError):
        ResumedRecording.of("none.csv")
    Path("notes.csv").write_text("1,2,3\n", encoding="utf-8")
    with assert_raises(OutputError):
        ResumedRecording.of("notes.csv")
    for words, code in (
        (("-o", "notes.csv", "--resume"), 6),
        (("-o", "none.csv", "--resume"), 6),
        (("-o", "-", "--resume"), 2),
        (("-o", "notes.csv", "--resume", "--force"), 2),
    ):
        ended = CliRunner().invoke(main, ["record", "--udp", "50999", *words])
        assert ended.exit_code == code, ended.output
    assert Path("notes.csv").read_text(encoding="utf-8") == "1,2,3\n"
    assert not Path("none.csv").exists()


def test_one_file_has_one_recorder() -> None:
    with FileSink("out.csv") as sink:
        sink.write("1,2,3\n")
        for more in ({"resume": True}, {"force": True}):
            with assert_raises(OutputError):
                FileSink("out.csv", **more)
    assert Path("out.csv").read_text(encoding="utf-8") == "1,2,3\n"


def test_a_full_disk_leaves_no_half_line() -> None:
    """Under a limit on the size of a file: the last row that fits is whole, and nothing of the next is there."""
    code = (
        "import resource, sys; sys.dont_write_bytecode = True\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))\n"
        "from flinders.links.sinks import FileSink\n"
        "with FileSink('out.csv') as sink:\n"
        "    for n in range(1000): sink.write(f'{n},217,4,-586\\n')\n"
    )
    assert resource.RLIMIT_FSIZE
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert_sentences(ended.stderr.splitlines()[-1])
    lines = Path("out.csv").read_text(encoding="utf-8").split("\n")
    assert lines == [*(f"{n},217,4,-586" for n in range(len(lines) - 1)), ""]
    assert 2900 < Path("out.csv").stat().st_size <= 3000


def rows() -> int:
    """Number of lines in the recording."""
    return Path("out.csv").read_bytes().count(b"\n")


def test_a_recording_killed_and_continued_three_times_reads_as_one() -> None:
    code = "import sys; from flinders.cli import main; main(sys.argv[1:])"
    reading, writing = os.openpty()
    os.set_blocking(reading, False)
    sent = 0
    for attempt in range(3):
        words = ["record", "--serial", os.ttyname(writing), "-o", "out.csv", *["--resume"] * (attempt > 0)]
        running = subprocess.Popen([sys.executable, "-c", code, *words], stderr=subprocess.PIPE)
        assert running.stderr is not None
        assert b"recording" in running.stderr.readline()
        for _ in range(60):
            os.write(reading, raw(np.array([[sent / 10, 20.0, 30.0]])))
            sent += 1
            time.sleep(0.005)
        deadline = time.monotonic() + 60.0
        while rows() < 20 * (attempt + 1) and time.monotonic() < deadline:
            time.sleep(0.01)
        running.send_signal(signal.SIGKILL)
        running.communicate()
    os.close(reading)
    os.close(writing)
    samples = read("out.csv")
    assert samples.time is not None
    assert (np.diff(samples.time) > 0).all()
    assert (np.diff(samples.field[:, 0]) > 0).all()
    assert len(samples) >= sent - 3 * 40  # of each: twenty by which the layout is settled, and what the port holds
    assert Path("out.csv").read_text(encoding="utf-8").count("t_s,accel_x_g") == 1


def test_standard_output_that_is_closed_is_no_place_for_a_recording() -> None:
    code = "import sys; from flinders.cli import main; main(sys.argv[1:])"
    words = f"{sys.executable} -c '{code}' record --udp 50998 --seconds 1 -o - >&-"
    ended = subprocess.run(["/bin/sh", "-c", words], stderr=subprocess.PIPE, text=True, check=False)
    assert ended.returncode == 6, ended.stderr
    assert_sentences(ended.stderr)


def test_quiet_is_nothing() -> None:
    source = ScriptedSource([Silence(0.01)])
    with FileSink("out.csv") as sink:
        recorder = Recorder(source, sink)
        assert isinstance(recorder.next(0.01), FeedEvent)
        assert recorder.next(0.01) is None
