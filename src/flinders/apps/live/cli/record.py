"""``flinders record``: record a running sensor to a file."""

from __future__ import annotations

import contextlib
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import Outputs, print_json, say, working
from flinders.cli._signals import catch_stop_signals
from flinders.errors import FlindersError, UsageError, count_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flinders.links.recording_statistics import RecordingStatistics
    from flinders.links.sinks import Sink
    from flinders.links.transports import ByteSource


class Wire(program.Group):
    """Source of lines: a serial port, datagrams or a program."""

    port: str | None = option.serial()
    baud: int = option.baud()
    udp: int | None = option.udp()
    tcp: str | None = option.tcp()


class Topic(program.Group):
    """A topic of ROS 2, which sends messages instead of lines."""

    ros2: str | None = option.ros2()
    imu_topic: str | None = option.imu_topic()
    unit: str | None = program.member(
        "--unit", metavar="UNIT", help="With --ros2: unit that the driver writes in place of tesla."
    )

    def check(self) -> None:
        """Refuse options of a topic without one; raises `UsageError`."""
        if self.ros2 is None and (wrong := self.typed_options()):
            raise UsageError(f"{', '.join(wrong)} applies only to --ros2: leave it out")
        if self.unit is not None:
            from flinders.core.units import Unit

            Unit.of(self.unit)


class Record(program.Group):
    """A sensor, and the file of its recording."""

    wire: Wire = program.group(Wire)
    topic: Topic = program.group(Topic)
    output: str | None = option.output("the recording", "File to write; - for standard output.", heading=program.OUTPUT)
    seconds: float | None = program.member(
        "--seconds", type=program.positive, metavar="S", help="Duration, s [default: until Ctrl-C]."
    )
    readings: int | None = program.member(
        "--readings", type=click.IntRange(min=1), metavar="N", help="Stop after this number of readings."
    )
    pattern: str | None = program.same_as(option.ColumnsOptions, "pattern")
    force: bool = option.force()
    resume: bool = program.flag(
        "--resume", "Continue the recording in the output file after a crash.", heading=program.OUTPUT
    )
    as_json: bool = option.as_json()

    def check(self) -> None:
        """Refuse other than one source and one file."""
        self.topic.check()
        wire = {"--serial": self.wire.port, "--udp": self.wire.udp, "--tcp": self.wire.tcp, "--ros2": self.topic.ros2}
        senders = sum(one is not None for one in wire.values())
        if senders > 1:
            *names, last = wire
            words = f"{', '.join(names)} and {last}"
            raise UsageError(f"{words} name several sensors: record each with a command of its own")
        if senders == 0:
            from flinders.links.serial_ports import describe_ports

            raise UsageError(
                f"nothing to record: name a --serial port ({describe_ports()}), or --udp PORT, --tcp HOST:PORT, "
                "--ros2 TOPIC"
            )
        if self.pattern is not None and self.topic.ros2 is not None:
            raise UsageError("--pattern describes lines, and --ros2 sends none: leave --pattern out")
        if self.pattern is not None:
            from flinders.readers.dialects.pattern import Pattern

            Pattern.of(self.pattern)
        if not self.output:
            raise UsageError("need a file to write: -o tumble.csv, or -o - for standard output")
        if self.resume and (self.force or self.output == "-"):
            raise UsageError(
                f"--resume continues a file: leave {'--force out' if self.force else '--resume out with -o -'}"
            )

    def open_recorder(self, stack: contextlib.ExitStack) -> tuple[str, Callable[..., RecordingStatistics]]:
        """Return the name of the source, and a function that records it, with arguments as `Recorder`."""
        if self.topic.ros2 is None:
            from flinders.links.transports import open_lines

            source = stack.enter_context(contextlib.closing(open_lines(**self.wire.as_dict())))
            return source.name, partial(_record, source, self.pattern)
        from flinders.links.feed_recording import record_feed
        from flinders.links.feeds import feed_kind

        feed = feed_kind("ros2")(self.topic.ros2, self.topic.imu_topic, self.topic.unit)
        return feed.name, partial(record_feed, feed)


def _record(source: ByteSource, pattern: str | None, sink: Sink, **how: Any) -> RecordingStatistics:
    """Record the lines of a source to a file; `how` are further arguments of `Recorder`."""
    from flinders.links.recorder import Recorder

    return Recorder(source, sink, pattern=pattern, **how).run()


@program.command_of(
    "record",
    Record,
    common=("port", "udp", "tcp", "ros2", "output", "seconds"),
    headings={"Source": ("baud", "imu_topic", "unit")},
    epilog="""\b
Example:
  flinders record --serial /dev/ttyACM0 -o tumble.csv
  flinders record --udp 50100 --seconds 60 -o tumble.csv
  flinders record --ros2 /imu/mag --seconds 60 -o tumble.csv
  flinders record --serial /dev/ttyACM0 --seconds 60 -o - | flinders calibrate -
  flinders record --serial /dev/ttyACM0 --resume -o tumble.csv

\b
Exit codes:
  0  recorded, also if ended by Ctrl-C
  5  no port, or no reading arrived
  6  the file cannot be written or continued; earlier readings are saved
""",
)
def command(options: Record) -> None:
    """Record what a sensor sends, as it arrives, as text that every command reads.

    Known formats: numbers with labels (X: -20.8 Y: -20.2 Z: 26.1 uT), in tuples or in a table, with or without time
    stamps in front; JSON lines, MotionCal's Raw: lines, Adafruit's Uni: lines and magcc's datagrams. --pattern
    describes any other. Lines in an unknown format are kept as comments. A crash loses at most one second; the
    command waits for a port that disappears.
    """
    from flinders.links.recording_text import ResumedRecording
    from flinders.links.sinks import FileSink, StandardOutputSink

    options.check()
    path, is_resumed = str(options.output), options.resume
    Outputs.of(("the recording", path), force=options.force or is_resumed, as_json=options.as_json).check()
    resumed = ResumedRecording.of(path) if is_resumed else None
    with contextlib.ExitStack() as stack:
        name, run = options.open_recorder(stack)
        sink = (
            StandardOutputSink()
            if path == "-"
            else stack.enter_context(FileSink(path, force=options.force, resume=is_resumed))
        )
        stopped = stack.enter_context(catch_stop_signals(patient=False))
        status = stack.enter_context(working())
        say(f"recording {name}{'' if options.seconds or options.readings else '; Ctrl-C ends it'}")
        statistics = run(
            sink,
            seconds=options.seconds,
            readings=options.readings,
            resumed=resumed,
            stopped=stopped,
            say=say,
            watch=None if status is None else lambda statistics: status(statistics.brief),
        )
    say(str(statistics))
    for line in _remarks(statistics, path):
        say(line)
    if options.as_json:
        print_json({**statistics.as_dict(), "written_to": path})


def _remarks(record: RecordingStatistics, output: str) -> Iterator[str]:
    """Yield notes on a recording, and the next command."""
    if record.accompanying:
        yield f"{count_text(record.accompanying, 'accompanying line')} kept as comments"
    if lost := record.unknown - record.accompanying:
        yield (
            f"! {count_text(lost, 'line')} of unknown format, kept as comments; the first is {record.first_unknown!r}"
        )
    if output == "-":
        return
    from flinders.core.units import COUNTS
    from flinders.report.recording import calibrate_command

    yield f"written to {output}"
    if not record.unit:
        yield from _unclear(output)
        return
    if record.unit == COUNTS:
        yield "the lines name no unit: calibrate in counts, or give the unit with --unit"
    yield f"next: {calibrate_command(output)}"


def _unclear(output: str) -> Iterator[str]:
    """Yield notes on a table with an unclear magnetometer: candidate columns, and a command that decides by values."""
    from flinders.readers import open_recording
    from flinders.readers._likeness import XYZ
    from flinders.report.recording import calibrate_command

    try:
        open_recording(output)
    except FlindersError as error:
        yield f"! {error.message}"
        columns = error.hint.get("columns")
        if isinstance(columns, str) and columns != XYZ["columns"]:
            yield f"next: {calibrate_command(output, '--columns', columns)}"
    else:
        yield f"next: {calibrate_command(output)}"
