"""``flinders record``: what a running sensor sends, into a file."""

from __future__ import annotations

import contextlib
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from flinders.cli import _options
from flinders.cli._options import option
from flinders.cli._output import Outputs, print_json, say
from flinders.cli._program import stopping
from flinders.errors import UsageError, counted, figures

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.live.transcript import RecordingStatistics
    from flinders.live.transports import ByteSource


@dataclass(frozen=True)
class SerialWire(_options.OptionGroup):
    """What sends lines: one of a serial port, datagrams and a program."""

    port: str | None = _options.member("--serial", "port", metavar="PORT", help="A serial port: /dev/ttyACM0, COM3.")
    baud: int = _options.member("--baud", **_options.BAUD)
    udp: int | None = _options.member(
        "--udp", type=click.IntRange(1, 65535), metavar="PORT", help="Listen for datagrams on this port."
    )
    tcp: str | None = _options.member("--tcp", metavar="HOST:PORT", help="Connect to a program that sends lines.")

    def check(self) -> None:
        """See that one is named.

        Raises
        ------
        UsageError
        """
        given = sum(one is not None for one in (self.port, self.udp, self.tcp))
        if given > 1:
            raise UsageError("--serial, --udp and --tcp name several sensors: record each with a command of its own")
        if given == 0:
            from flinders.live.transports import ports_in_words

            raise UsageError(
                f"nothing to record: name a --serial port ({ports_in_words()}), or --udp PORT, --tcp HOST:PORT"
            )

    def opened(self) -> ByteSource:
        """Open what is named."""
        from flinders.live.transports import Serial, Tcp, Udp, host_and_port

        if self.udp is not None:
            return Udp(self.udp)
        if self.tcp is not None:
            return Tcp(*host_and_port(self.tcp, "--tcp"))
        return Serial(str(self.port), self.baud)


@_options.command(
    "record",
    common=("port", "udp", "tcp", "output", "seconds"),
    short_help="Record a running sensor.",
    epilog="""\b
Example:
  flinders record --serial /dev/ttyACM0 -o tumble.csv
  flinders record --udp 50100 --seconds 60 -o tumble.csv
  flinders record --serial /dev/ttyACM0 --seconds 60 -o - | flinders calibrate -
  flinders record --serial /dev/ttyACM0 --resume -o tumble.csv

\b
Exit codes:
  0  recorded, also where Ctrl-C ended it
  5  no port, or no reading came
  6  the file cannot be written or continued; what came before is saved
""",
)
@_options.groups(wire=SerialWire)
@option("-o", "--output", heading=_options.OUTPUT, metavar="FILE", help="Where to write; - for standard output.")
@option("--seconds", type=_options.positive, metavar="S", help="Stop after so long [default: at Ctrl-C].")
@option("--readings", type=click.IntRange(min=1), metavar="N", help="Stop after so many readings.")
@_options.some(_options.ColumnsOptions, "pattern")
@_options.force
@option(
    "--resume", heading=_options.OUTPUT, is_flag=True,
    help="Go on with the recording in the output file, which a crash has ended.",
)  # fmt: skip
@_options.as_json
def command(
    wire: SerialWire,
    output: str | None,
    seconds: float | None,
    readings: int | None,
    pattern: str | None,
    force: bool,
    resume: bool,
    as_json: bool,
) -> None:
    """Record what a sensor sends, as it arrives, as text that every command reads.

    Understood are numbers with labels (X: -20.8 Y: -20.2 Z: 26.1 uT), in tuples, or in a table, time stamps in
    front of them, JSON lines, MotionCal's Raw: lines, Adafruit's Uni: lines and magcc's datagrams; --pattern
    describes any other. A line that is not understood is kept as a comment. A crash loses at most a second; a
    port that goes away is waited for.
    """
    from flinders.live.recorder import Recorder, Resumed, ToFile, ToStandardOutput

    wire.check()
    if not output:
        raise UsageError("need a file to write: -o tumble.csv, or -o - for standard output")
    if resume and (force or output == "-"):
        raise UsageError(f"--resume goes on with a file: leave {'--force out' if force else 'it out with -o -'}")
    Outputs.of(("the recording", output), force=force or resume, as_json=as_json).check()
    resumed = Resumed.of(output) if resume else None
    with contextlib.ExitStack() as stack:
        source = wire.opened()
        stack.callback(source.close)
        sink = ToStandardOutput() if output == "-" else stack.enter_context(ToFile(output, force=force, resume=resume))
        stopped = stack.enter_context(stopping(patient=False))
        watch = stack.enter_context(_status())
        say(f"recording {source.name}{'' if seconds or readings else '; Ctrl-C ends it'}")
        record = Recorder(
            source,
            sink,
            seconds=seconds,
            readings=readings,
            pattern=pattern,
            resumed=resumed,
            stopped=stopped,
            say=watch.say,
            watch=watch.show,
        ).run()
    say(str(record))
    for line in _remarks(record, output):
        say(line)
    if as_json:
        print_json({**record.as_dict(), "written_to": output})


def _remarks(record: RecordingStatistics, output: str | None) -> Iterator[str]:
    """Say what to know of a recording, and what to type next."""
    if record.unknown:
        yield (
            f"! {counted(record.unknown, 'line')} not understood and kept as comments; the first is "
            f"{record.first_unknown!r}"
        )
    if output == "-":
        return
    yield f"written to {output}"
    form = record.form
    if form is not None and not record.unit:
        yield f"next: flinders calibrate {output} --columns X,Y,Z, the magnetometer's three of {form.header}"
    else:
        unit = "" if record.unit == "µT" else " --unit UNIT, the sensor's: uT, mG, G …"
        yield f"next: flinders calibrate {output}{unit}"


class _Status:
    """A line on a terminal that tells how it goes; what is said in between stands above it."""

    def __init__(self, *, is_shown: bool) -> None:
        self._is_shown, self._width = is_shown, 0

    def show(self, record: RecordingStatistics) -> None:
        """Write the line anew."""
        if self._is_shown:
            text = _in_short(record)
            self._put(f"\r{text.ljust(self._width)}")
            self._width = len(text)

    def say(self, message: str) -> None:
        """Say something in a line of its own."""
        self.clear()
        say(message)

    def clear(self) -> None:
        """Take the line away."""
        if self._width:
            self._put("\r" + " " * self._width + "\r")
            self._width = 0

    def _put(self, text: str) -> None:
        with contextlib.suppress(OSError, ValueError):
            click.echo(text, nl=False, err=True)


def _in_short(record: RecordingStatistics) -> str:
    """Readings, rate, strength and seconds on a line that fits any terminal."""
    parts = [counted(record.readings, "reading"), f"{figures(record.rate_hz, 3)} Hz" if record.rate_hz else "- Hz"]
    if record.strengths:
        parts.append(f"{figures(record.weakest, 3)} to {figures(record.strongest, 3)} {record.unit}")
    return "  ".join([*parts, f"{record.seconds:.0f} s"])


@contextlib.contextmanager
def _status() -> Iterator[_Status]:
    """Show how it goes where somebody watches."""
    status = _Status(is_shown=sys.stderr.isatty())
    try:
        yield status
    finally:
        status.clear()
