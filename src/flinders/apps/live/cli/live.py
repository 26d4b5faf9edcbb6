"""``flinders live``: calibrate on a page in the browser while the sensor is turned."""

from __future__ import annotations

import contextlib
import os
import shlex
import sys
import threading
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import load, stated_site
from flinders.cli._output import print_json, say
from flinders.errors import FlindersError, OutputError, UsageError
from flinders.foreign_errors import import_optional
from flinders.links.serial_ports import ANY_PORT, SERIAL_PORT, board_port, find_board_port

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from socket import socket
    from typing import TextIO

    from flinders.apps.live.hub import Hub
    from flinders.apps.live.messages import Kind, Previous
    from flinders.apps.live.session_file import Source
    from flinders.fitting.result import Fit
    from flinders.links.transports import ByteSource

PORT: Final = 8410
MAX_PORT: Final = 65535
SEED: Final = 1
"""Seed of the simulation; a fixed one gives the same sensor, so that a session can be resumed."""
SWITCH_S: Final = 0.0005
"""Longest time that a fit keeps the interpreter from a thread that waits for datagrams, s."""


class LineOptions(option.UnitsOptions, option.LinesOptions):
    """Options to read lines and recordings."""

    chip: str | None = option.chip()

    def of_reading(self) -> dict[str, Any]:
        """The given arguments of `flinders.open_recording`."""
        return {name: value for name, value in self.as_dict().items() if value is not None and name != "chip"}


class LiveSource(program.Group):
    """Source of the readings."""

    port: str | None = option.serial()
    baud: int = option.baud()
    udp: int | None = option.udp()
    tcp: str | None = option.tcp()
    mavlink: str | None = program.member(
        "--mavlink", metavar="LINK", help="A vehicle: udp:HOST:PORT, tcp:HOST:PORT or a serial port."
    )
    compass: int = program.member(
        "--compass", type=click.IntRange(1, 3), default=1, show_default=True, help="Number of the vehicle's compass."
    )
    ros2: str | None = option.ros2()
    imu_topic: str | None = option.imu_topic()
    replay: str | None = program.member(
        "--replay", metavar="LOG", help="Play back a recording, in any format that flinders reads."
    )
    speed: float | None = program.member(
        "--speed", type=program.positive, metavar="X", help="Speed of playback or simulation [default: 1]."
    )
    simulate: bool = program.flag("--simulate", "Simulate a sensor; the default if nothing is plugged in.")
    lines: LineOptions = program.group(LineOptions)

    def check(self) -> None:
        """Refuse several sources, and options that do not belong to the source.

        Raises `UsageError`.
        """
        sources = {
            "--serial": self.port, "--udp": self.udp, "--tcp": self.tcp, "--mavlink": self.mavlink,
            "--ros2": self.ros2, "--replay": self.replay, "--simulate": self.simulate,
        }  # fmt: skip
        named = [name for name, value in sources.items() if value not in (None, False)]
        if len(named) > 1:
            raise UsageError(f"{' and '.join(named)} name several sensors: show each on a page of its own")
        if self.speed is not None and self.replay is None and not self.simulate:
            raise UsageError("--speed needs --replay or --simulate: leave --speed out")
        if self.compass != 1 and self.mavlink is None:
            raise UsageError("--compass needs --mavlink: leave --compass out")
        if self.imu_topic is not None and self.ros2 is None:
            raise UsageError("--imu-topic needs --ros2: leave --imu-topic out")
        if self.port == ANY_PORT:
            board_port()  # reports a missing port at once, before anything is loaded
        self.lines.refuse_with(named)
        if self.lines.unit:
            from flinders.core.units import Unit

            Unit.of(self.lines.unit, self.lines.scale)

    def open_source(
        self,
        stack: contextlib.ExitStack,
        resume: str | None = None,
        heard: Callable[[ByteSource], ByteSource] = lambda wire: wire,
    ) -> Source:
        """Return the source that the options name; by default a plugged-in serial port.

        With nothing plugged in, it is the session to resume, without new readings, or else the simulation. `heard`
        wraps a wire that sends lines.
        """
        from flinders.apps.live.session_file import DEFAULT_TARGET, Source
        from flinders.links.feed_recording import RecordedFeed
        from flinders.links.feeds import NoSensor, Replay, feed_kind
        from flinders.links.recorder import Recorder
        from flinders.links.transports import open_lines, open_link
        from flinders.readers import open_recording

        reading = self.lines.of_reading()
        if self.replay is not None:
            recording = open_recording(self.replay, **reading)
            say(str(recording))
            site = stated_site(recording, "--dip or the page", z_down=program.is_typed("axes"))
            feed = Replay(recording, speed=self.speed or 1.0)
            target = getattr(recording, "autopilot", None) or DEFAULT_TARGET
            return Source("replay", partial(RecordedFeed, feed), site=site, target=target)
        if self.mavlink is not None:
            feed_of = feed_kind("mavlink")
            link = stack.enter_context(contextlib.closing(open_link(self.mavlink, self.baud, what="--mavlink")))
            vehicle = feed_of(link, self.compass)
            return Source("mavlink", partial(RecordedFeed, vehicle), target=getattr(vehicle, "target", DEFAULT_TARGET))
        if self.ros2 is not None:
            topic = feed_kind("ros2")(self.ros2, self.imu_topic, self.lines.unit)
            return Source("ros2", partial(RecordedFeed, topic), target=getattr(topic, "target", DEFAULT_TARGET))
        kind, port = self._lines(is_resumed=resume is not None)
        if kind == "file":
            return Source(kind, lambda _sink, resumed: NoSensor(str(resume)))  # noqa: ARG005 - signature of `Source.start`
        if kind == "simulated":
            from flinders.apps.live.simulated import SimulatedFeed

            return Source(kind, partial(RecordedFeed, SimulatedFeed(SEED, speed=self.speed or 1.0)))
        wire = open_lines(port=port, baud=self.baud, udp=self.udp, tcp=self.tcp)
        stack.enter_context(contextlib.closing(wire))
        lines = heard(wire)
        return Source(kind, partial(Recorder, lines, **reading), reading, None if kind == "udp" else lines)

    def _lines(self, *, is_resumed: bool) -> tuple[Kind, str | None]:
        """Kind and port of a source of lines; with nothing plugged in, kind of an earlier session or a simulation."""
        if self.udp is not None or self.tcp is not None:
            return "tcp" if self.udp is None else "udp", None
        if self.port is not None:
            return "serial", self.port
        port = None if self.simulate else find_board_port()
        if port is None and not self.simulate and is_resumed:
            say("nothing is plugged in: showing the session as recorded; name its source to continue it")
            return "file", None
        if port is None and not self.simulate:
            say("nothing is plugged in: showing a simulated sensor; flinders live --help lists the sources")
        return "simulated" if port is None else "serial", port


def _port(value: object) -> int | str:
    """Read the value of ``--port``: a number, or the name of a serial port."""
    text = str(value)
    if SERIAL_PORT.match(text):
        return text
    if text.isascii() and text.isdigit() and int(text) <= MAX_PORT:
        return int(text)
    raise click.BadParameter(
        f"{text!r}: need the number of the page's port, from 0 to {MAX_PORT}; a serial port is /dev/ttyACM0 or COM3"
    )


class ServedPage(program.Group):
    """Address of the page."""

    host: str = program.member(
        "--host", default="127.0.0.1", show_default=True, metavar="ADDRESS",
        help="Address to listen on; with 0.0.0.0 other machines reach the page, with a token.",
    )  # fmt: skip
    web_port: int | str = program.member(
        "--port", type=_port, default=PORT, show_default=True, metavar="N",
        help="Number of the page's port; 0 for any free one. The name of a serial port counts as --serial.",
    )  # fmt: skip
    opens: bool | None = program.member(
        "--open/--no-open", default=None, help="Open a browser [default: if there is a screen]."
    )

    def check(self) -> None:
        """Refuse an empty address; raises `UsageError`."""
        if not self.host:
            raise UsageError("--host needs an address: 127.0.0.1 for this machine only, 0.0.0.0 for all")

    def open_listener(self) -> socket:
        """Open the socket to serve the page on."""
        from flinders.apps.live.access import open_listener

        return open_listener(self.host, int(self.web_port))


def with_serial_port(source: LiveSource, page: ServedPage) -> tuple[LiveSource, ServedPage]:
    """Use a serial port that was typed as ``--port`` as the source, and serve the page on its default port."""
    if isinstance(page.web_port, int):
        return source, page
    if source.port is not None:
        raise UsageError(f"--serial {source.port} and --port {page.web_port} name two serial ports: name one")
    say(f"{page.web_port} is a serial port: read as --serial {page.web_port}; --port N is the port of the page")
    return replace(source, port=page.web_port), replace(page, web_port=PORT)


class Live(program.Group):
    """A sensor, its recording, and the page that shows it."""

    source: LiveSource = program.group(LiveSource)
    axes: str = program.same_as(option.AxesOptions, "axes")
    target_deg: float | None = option.target("Target of the worst heading error, degrees [default: 1].", None)
    dip_deg: float | None = option.dip("Inclination of the field at the site, degrees [default: of the log, else 60].")
    previous: str | None = program.member(
        "--previous", metavar="CALIBRATION", help="Earlier calibration file of this sensor, to compare with."
    )
    refresh: bool = program.flag("--refresh", "Keep the soft iron of --previous, and estimate the hard iron again.")
    output: str | None = option.output(
        "the recording", "File of the recording [default: a new file in the folder flinders-sessions]."
    )
    resume: str | None = program.member(
        "--resume", metavar="SESSION", help="Continue a recording of this command, also after a crash."
    )
    page: ServedPage = program.group(ServedPage)
    as_json: bool = option.as_json()

    @classmethod
    def from_values(cls, values: dict[str, Any]) -> Self:
        """Take the values of the command, with those of the chip."""
        return super().from_values(option.with_chip(values))

    def check(self) -> None:
        """Refuse several sources, and an unusable place for the recording.

        Raises `UsageError`; `OutputError` if the file exists.
        """
        self.source.check()
        self.page.check()
        if self.refresh and self.previous is None:
            raise UsageError("--refresh renews an earlier calibration: name its file with --previous")
        if self.output is not None and Path(self.output).is_file():
            raise OutputError(
                f"{self.output} exists: give another name, or continue that recording with --resume {self.output}"
            )
        if self.output == "-":
            raise UsageError("the recording needs a regular file, which is read again: name one with -o")
        if self.output is not None and self.resume is not None:
            raise UsageError("--resume continues its own file: leave --output out")


@program.command_of(
    "live",
    Live,
    common=("port", "udp", "tcp", "mavlink", "ros2", "replay", "simulate", "output"),
    headings={
        "Source": ("baud", "compass", "imu_topic", "speed"),
        "Session": ("previous", "refresh", "resume"),
        "Page": ("host", "web_port", "opens"),
    },
    epilog="""\b
Example:
  flinders live --serial
  flinders live --udp 50100 --unit mG
  flinders live --mavlink udp:0.0.0.0:14550
  flinders live --ros2 /imu/mag --imu-topic /imu/data
  flinders live --replay tumble.csv --speed 5
  flinders live --simulate
""",
)
def command(options: Live) -> None:
    """Calibrate a sensor on a page in the browser, while you turn it.

    The page shows the quality of the calibration so far and the next turn to make, and exports the calibration when it
    is good. All readings are recorded; Ctrl-C ends the session, and `flinders calibrate` reads the recording.
    """
    named, page = with_serial_port(options.source, options.page)
    options = replace(options, source=named, page=page)
    options.check()
    for package in ("starlette", "uvicorn", "websockets", "segno"):
        import_optional(package, "live", "the live page")
    sys.setswitchinterval(SWITCH_S)
    import msgspec

    from flinders.apps.live.access import Gate, Tokens, own_names, serve
    from flinders.apps.live.hub import Hub
    from flinders.apps.live.server import application
    from flinders.apps.live.session_file import open_session
    from flinders.apps.live.standalone.package import live_data
    from flinders.core.axes import Axes

    axes = Axes.of(options.axes)
    previous, renewed = _previous(options)
    with contextlib.ExitStack() as stack:
        listener = stack.enter_context(contextlib.closing(options.page.open_listener()))
        source = options.source.open_source(stack, options.resume)
        supply = stack.enter_context(open_session(source, axes, output=options.output, resume=options.resume, say=say))
        supply = replace(supply, edits=msgspec.structs.replace(supply.edits, **_given_edits(options)))
        port = listener.getsockname()[1]
        gate = Gate.of(options.page.host, port, own_names())
        tokens = Tokens() if gate.is_open else None
        hub = Hub(supply, previous, renewed)
        if hub.warning:
            say(f"{supply.path}: {hub.warning}")
        if hub.source.name != str(hub.supply.path):  # a session without a sensor is its own source
            say(f"{hub.source.name}, recorded in {hub.supply.path}")
        announce(port, tokens.current if tokens else None, options.page, as_json=options.as_json)
        serve(application(hub, gate, tokens, say, live_data), listener)
        if hub.failure is not None:
            raise hub.failure
    is_there = supply.path.exists()
    for line in _last_words(hub) if is_there else ("no reading arrived, nothing was recorded",):
        say(line)
    if options.as_json:
        print_json(_as_dict(hub, str(supply.path) if is_there else None))


def _last_words(hub: Hub) -> Iterator[str]:
    """Yield the lines printed at the end: the path of the recording, and the next command."""
    from flinders.report.formatting import duration_words
    from flinders.report.recording import calibrate_command

    path, finished_s = str(hub.supply.path), hub.edits.finished_s
    if finished_s is None:
        yield f"recorded in {path}"
        yield f"next: {calibrate_command(path)}"
    else:
        finished = f"the calibration that was finished at {duration_words(finished_s)}"
        yield f"recorded in {path}, with {finished}: the page shows and exports it again"
        yield f"next: {shlex.join(['flinders', 'live', '--resume', path])}"


def _given_edits(options: Live) -> dict[str, Any]:
    """Edits that were given as options; they take precedence over those in the file of an earlier session."""
    chosen = {"target_deg": options.target_deg, "dip_deg": options.dip_deg, "refreshing": options.refresh or None}
    return {name: value for name, value in chosen.items() if value is not None}


def _previous(options: Live) -> tuple[Previous, Fit | None]:
    """Read the file of an earlier calibration, and return it with its fit."""
    from flinders.apps.live.messages import Previous
    from flinders.fitting.refreshing import refuse_unfit

    if options.previous is None:
        return Previous(), None
    fit = load("live --previous", options.previous)
    if options.refresh:
        refuse_unfit(fit)
    return Previous(Path(options.previous).name, Path(options.previous).read_text(encoding="utf-8")), fit


def _as_dict(hub: Hub, recording: str | None) -> dict[str, Any]:
    """JSON-ready state at the end: the recording, the number of readings, and the fit of all."""
    from flinders.fitting.fit_json import json_of
    from flinders.fitting.result import Refused

    made = hub.finish_now()
    found = made.outcome.fit if isinstance(made.outcome, Refused) else made.outcome
    fit = None if isinstance(found, FlindersError) else found
    return {
        "recording": recording,  # file that was written
        "readings": hub.log.buffer.total,  # received
        "fit": None if fit is None else json_of(fit),  # of all readings but those left out; null without a fit
        "refusal": made.refusal if fit is None else "",  # reason for the missing fit
    }


def draw_address(address: str, stream: TextIO) -> None:
    """Draw an address as a QR code of half blocks, for the camera of a phone on the same network."""
    import segno

    segno.make(address, micro=False).terminal(out=stream, compact=True)


def announce(port: int, token: str | None, page: ServedPage, *, as_json: bool) -> None:
    """Print the address of the page, and open a browser if there is a screen."""
    from flinders.apps.live.access import page_addresses

    address, *others = page_addresses(page.host, port, token)
    if token is not None:
        say("the address admits one browser; the next browser needs the address printed then:")
    if as_json:
        say(address)
    else:
        click.echo(address)
    for other in others:
        say(f"or {other}")
    if token is not None and sys.stderr.isatty():
        draw_address(address, sys.stderr)
    if _has_screen() if page.opens is None else page.opens:
        threading.Thread(target=_open_browser, args=(address,), daemon=True).start()


def _open_browser(address: str) -> None:
    import webbrowser

    with contextlib.suppress(webbrowser.Error, OSError):
        webbrowser.open(address)


def _has_screen() -> bool:
    """Whether the program runs in a terminal of a machine with a screen."""
    if not sys.stdout.isatty():
        return False
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
