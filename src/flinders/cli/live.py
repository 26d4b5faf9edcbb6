"""``flinders live``: the page on which a calibration is made while the sensor is turned."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import threading
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _options
from flinders.cli._options import option
from flinders.cli._output import print_json, say
from flinders.errors import MissingExtra, OutputError, UsageError, counted

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.core.axes import Axes
    from flinders.fitting.result import Fit
    from flinders.live.access import Tokens
    from flinders.live.buffer import Timeline
    from flinders.live.feeds import Feed
    from flinders.live.hub import Supply
    from flinders.live.messages import Kind
    from flinders.live.recorder import Patient, Resumed, Sink
    from flinders.live.session import Session
    from flinders.live.session_file import Edits
    from flinders.live.transports import ByteSource

ANY_PORT: Final = "?"
"""``--serial`` without a port."""
PORT: Final = 8410
OF_LINES: Final = ("columns", "pattern", "unit", "scale")
"""Options of what arrives as lines, or is played back."""
SWITCH_S: Final = 0.0005
"""Seconds that a fit may keep the interpreter from whoever waits for a datagram."""
SEED: Final = 1
"""Of the simulation, always the same sensor: a session of it can be resumed."""


@_options.command(
    "live",
    common=("port", "udp", "tcp", "mavlink", "replay", "simulate", "unit", "output"),
    headings={
        "Source": ("baud", "compass", "speed"),
        "Session": ("previous", "resume"),
        "Page": ("host", "web_port", "opens"),
    },
    short_help="Calibrate on a page, while the sensor is turned.",
    epilog="""\b
Example:
  flinders live --serial
  flinders live --udp 50100 --unit mG
  flinders live --mavlink udp:0.0.0.0:14550
  flinders live --replay tumble.csv --speed 5
  flinders live --simulate
""",
)
@option(
    "--serial", "port", is_flag=False, flag_value=ANY_PORT, metavar="[PORT]",
    help="A serial port: /dev/ttyACM0, COM3; without a name the one that is plugged in.",
)  # fmt: skip
@option("--baud", **_options.BAUD)
@option("--udp", type=click.IntRange(1, 65535), metavar="PORT", help="Listen for datagrams on this port.")
@option("--tcp", metavar="HOST:PORT", help="Connect to a program that sends lines.")
@option("--mavlink", metavar="LINK", help="A vehicle: udp:HOST:PORT, tcp:HOST:PORT or a serial port.")
@option("--compass", type=click.IntRange(1, 3), default=1, show_default=True, help="Which of the vehicle's.")
@option("--replay", metavar="LOG", help="Play a recording back, any that flinders reads.")
@option("--speed", type=_options.positive, metavar="X", help="So many times as fast [default: 1].")
@option("--simulate", is_flag=True, help="A simulated sensor; also where nothing is plugged in.")
@_options.some(_options.ReadingOptions, "columns", "pattern", "unit", "scale", "axes")
@_options.target("Worst heading error that is good enough [default: 1].", None)
@_options.dip("Inclination of the field at the site [default: 60].")
@option("--previous", metavar="CALIBRATION", help="A calibration file of this sensor to compare with.")
@option("-o", "--output", metavar="FILE", help="Where to record [default: a new file in the folder flinders-sessions].")
@option("--resume", metavar="SESSION", help="Go on with a recording of this command, however it was ended.")
@option(
    "--host", default="127.0.0.1", show_default=True, metavar="ADDRESS",
    help="Where to listen; other machines reach 0.0.0.0, with a token.",
)  # fmt: skip
@option(
    "--port", "web_port", type=click.IntRange(0, 65535), default=PORT, show_default=True, metavar="N",
    help="Port of the page; 0 for any that is free.",
)  # fmt: skip
@option("--open/--no-open", "opens", default=None, help="Open a browser [default: where there is a screen].")
@_options.as_json
def command(
    target_deg: float | None,
    dip_deg: float | None,
    previous: str | None,
    output: str | None,
    resume: str | None,
    host: str,
    web_port: int,
    opens: bool | None,
    axes: str,
    as_json: bool,
    **source: Any,
) -> None:
    """Calibrate a sensor on a page in the browser, while you turn it.

    The page shows how good the calibration is by now, which way to turn next, and exports it when it is good. All that
    arrives is recorded as it comes; Ctrl-C ends it, and `flinders calibrate` reads the recording.
    """
    _refuse_unclear(source, output, resume, host)
    sys.setswitchinterval(SWITCH_S)
    from flinders.core.axes import Axes
    from flinders.live.access import Gate, Tokens, listening, serve
    from flinders.live.hub import Hub
    from flinders.live.server import application

    turned = Axes.of(axes)
    loaded = None if previous is None else _loaded(previous)
    listener = listening(host, web_port)
    with contextlib.ExitStack() as stack:
        stack.callback(listener.close)
        supply, session, timeline = _begun(stack, source, turned, output, resume)
        session = _as_asked(session, target_deg, dip_deg, loaded)
        number = listener.getsockname()[1]
        gate = Gate.of(host, number, _own_names())
        tokens = Tokens() if gate.is_open else None
        hub = Hub(session, supply, timeline=timeline)
        _announce(host, number, tokens, session, opens=opens, tell=say if as_json else click.echo)
        serve(application(hub, gate, tokens, say), listener)
        if hub.failure is not None:
            raise hub.failure
    is_there = supply.path is not None and supply.path.exists()
    say(f"recorded in {supply.path}: flinders calibrate {supply.path}" if is_there else "nothing came to be recorded")
    if as_json:
        print_json(_ended(hub.session, str(supply.path) if is_there else None))


def _loaded(previous: str) -> Fit:
    from flinders.fitting.result import Fit

    return Fit.load(previous)


def _ended(session: Session, recording: str | None) -> dict[str, Any]:
    """What there was when the page was closed: the recording, how far it had come, and the newest fit."""
    from flinders.live.page_state import session_state

    evaluated, shown = session.shown.evaluated, session_state(session)
    return {
        "recording": recording,
        "readings": shown.readings,
        "phase": shown.phase,
        "words": shown.words,
        "fit": None if evaluated is None or evaluated.fit is None else evaluated.fit.as_dict(),
    }


def _refuse_unclear(source: dict[str, Any], output: str | None, resume: str | None, host: str) -> None:
    """See that one source is named, that options go with it, and that the recording can go where it shall.

    Raises
    ------
    UsageError
    OutputError
        Where a file is in the way.
    """
    names = ("port", "udp", "tcp", "mavlink", "replay", "simulate")
    given = [name for name in names if source[name] not in (None, False)]
    options = ["--serial" if name == "port" else f"--{name}" for name in given]
    if len(given) > 1:
        raise UsageError(f"{' and '.join(options)} name several sensors: show each on a page of its own")
    kind = given[0] if given else "simulate"
    if source["speed"] is not None and kind != "replay":
        raise UsageError("--speed goes with --replay: leave it out")
    if source["compass"] != 1 and kind != "mavlink":
        raise UsageError("--compass goes with --mavlink: leave it out")
    if given and kind in ("mavlink", "simulate"):
        wrong = [f"--{name}" for name in OF_LINES if source[name] is not None]
        if wrong:
            raise UsageError(f"{', '.join(wrong)} goes with lines and recordings: {options[0]} knows its unit")
    if source["unit"]:
        from flinders.core.units import Unit

        Unit.of(source["unit"], source["scale"])
    if not host:
        raise UsageError("--host needs an address: 127.0.0.1 for this machine only, 0.0.0.0 for all")
    if output is not None and Path(output).is_file():
        raise OutputError(f"{output} exists: give another name, or go on with it with --resume {output}")
    if output == "-":
        raise UsageError("the recording goes into a file that is read again: name one with -o")
    if output is not None and resume is not None:
        raise UsageError("--resume goes on with its own file: leave --output out")


@dataclass(frozen=True, slots=True)
class _Source:
    """What was named: how a feed is made of it that records into a sink, and how the recording is read."""

    kind: Kind
    feed: Callable[[Sink, Resumed | None], Feed]
    reading: dict[str, Any]
    board: ByteSource | None = None


def _begun(
    stack: contextlib.ExitStack, source: dict[str, Any], axes: Axes, output: str | None, resume: str | None
) -> tuple[Supply, Session, Timeline]:
    """Open source and file, and take up what a session that is continued holds."""
    from flinders.live.hub import Supply
    from flinders.live.messages import SourceState
    from flinders.live.recorder import Patient, Resumed, ToFile
    from flinders.live.session_file import Edits, default_path

    resumed = None if resume is None else Resumed.of(resume)
    edits = Edits() if resume is None else Edits.read(resume)
    found = _source(source, stack)
    path = Path(resume or output or default_path(datetime.now(UTC)))
    sink = Patient(ToFile(path, resume=resume is not None), say)
    stack.callback(_close, sink, path)
    reading = {**found.reading, "axes": str(axes)}
    has_rows = resumed is not None and resumed.header is not None
    session, timeline = _continued(path if has_rows else None, edits, axes, reading)
    feed = found.feed(sink, resumed)
    state = SourceState(feed.name, found.kind, "waiting", "")
    supply = Supply(
        feed,
        sink,
        path,
        axes,
        board=found.board,
        reading=reading,
        hint=lambda: _hint(feed),
        unrecorded=lambda: sink.why,
    )
    session = replace(session, source=state, recording=str(path), has_board=found.board is not None)
    return supply, session, timeline


def _close(sink: Patient, path: Path) -> None:
    """Close the recording; one with nothing in it goes.

    Raises
    ------
    OutputError
        Where not all that came is in it.
    """
    try:
        sink.close()
    finally:
        with contextlib.suppress(OSError):
            if not path.stat().st_size:
                path.unlink()


def _source(source: dict[str, Any], stack: contextlib.ExitStack) -> _Source:
    """Open what was named; a port where one is plugged in, and else the simulation, where nothing was."""
    named = {name: source[name] for name in OF_LINES if source[name] is not None}
    if source["replay"] is not None:
        return _replay(source["replay"], source["speed"] or 1.0, named)
    if source["mavlink"] is not None:
        return _vehicle(source, stack)
    wire = None if source["simulate"] else _wire(source)
    if wire is None:
        if not source["simulate"]:
            say("nothing is plugged in: this is a simulated sensor; flinders live --help names the sources there are")
        return _simulation()
    kind, opened = wire
    stack.callback(opened.close)
    from flinders.live.recorder import Recorder

    def recorder(sink: Sink, resumed: Resumed | None) -> Recorder:
        return Recorder(opened, sink, resumed=resumed, **named)

    return _Source(kind, recorder, named, None if kind == "udp" else opened)


def _hint(feed: Feed) -> str:
    """Why no reading comes of lines that do: nobody can tell which of their numbers are the field."""
    recorded = getattr(feed, "statistics", None)
    if recorded is None or not recorded.readings or recorded.form is None:
        return ""
    lines = counted(recorded.readings, "line")
    return (
        f"{lines} of numbers came, and which are the magnetometer's is not clear: start again with --columns X,Y,Z, "
        f"three of {recorded.form.header}, and with --unit; what came is recorded"
    )


def _wire(source: dict[str, Any]) -> tuple[Kind, ByteSource] | None:
    """Open what sends lines; None where none is named and none is plugged in."""
    from flinders.live.transports import Serial, Tcp, Udp, host_and_port

    if source["udp"] is not None:
        return "udp", Udp(source["udp"])
    if source["tcp"] is not None:
        return "tcp", Tcp(*host_and_port(source["tcp"], "--tcp"))
    port = source["port"]
    if port is None or port == ANY_PORT:
        port = _only_port(is_asked=port is not None)
    return None if port is None else ("serial", Serial(port, source["baud"]))


def _only_port(*, is_asked: bool) -> str | None:
    """The one port that a board is plugged into; None where there is none and none was asked for.

    Raises
    ------
    UsageError
        Where there are several, or none although one was asked for.
    MissingExtra
        Where ports cannot be listed, and one was asked for.
    """
    from flinders.live.transports import ports, ports_in_words

    try:
        there = ports()
    except MissingExtra:
        if is_asked:
            raise
        return None
    plugged = [port for port in there if "(" in port] or (there if is_asked else [])
    if len(plugged) == 1:
        return plugged[0].partition(" (")[0]
    if not plugged and not is_asked:
        return None
    if not plugged:
        raise UsageError(f"--serial: {ports_in_words()}")
    raise UsageError(f"several ports: {', '.join(plugged)}: name one, such as --serial {plugged[0].partition(' (')[0]}")


def _vehicle(source: dict[str, Any], stack: contextlib.ExitStack) -> _Source:
    from flinders.cli.send import opened as link_of
    from flinders.live.feeds import RecordedFeed
    from flinders.live.mavlink import Telemetry

    link = link_of(source["mavlink"], source["baud"])
    stack.callback(link.close)
    feed = Telemetry(link, compass=source["compass"])
    return _Source("mavlink", lambda sink, resumed: RecordedFeed(feed, sink, resumed=resumed), {})


def _replay(log: str, speed: float, named: dict[str, Any]) -> _Source:
    from flinders.live.feeds import RecordedFeed, Replay
    from flinders.readers import open_recording

    recording = open_recording(log, **named)
    say(str(recording))
    feed = Replay(recording, speed=speed)
    return _Source("replay", lambda sink, resumed: RecordedFeed(feed, sink, resumed=resumed), {})


def _simulation() -> _Source:
    from flinders.live.feeds import RecordedFeed
    from flinders.live.simulated import SimulatedFeed

    return _Source("simulated", lambda sink, resumed: RecordedFeed(SimulatedFeed(SEED), sink, resumed=resumed), {})


def _continued(path: Path | None, edits: Edits, axes: Axes, reading: dict[str, Any]) -> tuple[Session, Timeline]:
    """A new session, or the one that a file holds."""
    from flinders.live.buffer import Exclusions, Timeline
    from flinders.live.session import Series, Session

    live, timeline = Series(axes=axes), Timeline()
    if path is not None:
        from flinders.live.evaluation import load

        before = () if edits.begun_s is None else ((-math.inf, edits.begun_s),)
        read, _, timeline = load(path, path.name, before, **reading)
        say(f"{path}: goes on after {counted(read.buffer.total, 'reading')}")
        exclusions = Exclusions(edits.excluded)
        live = replace(read, axes=axes, frame=live.frame, exclusions=exclusions, begun_s=edits.begun_s, key=1)
    session = Session(live=live, target_deg=edits.target_deg, dip_deg=edits.dip_deg, goal=edits.goal, keys=live.key)
    return session, timeline


def _as_asked(session: Session, target_deg: float | None, dip_deg: float | None, previous: Fit | None) -> Session:
    """What was typed goes before what the file says."""
    asked = {"target_deg": target_deg, "dip_deg": dip_deg, "previous": previous}
    return replace(session, **{name: value for name, value in asked.items() if value is not None})  # type: ignore[arg-type]


def _own_names() -> tuple[str, ...]:
    import socket

    name = socket.gethostname()
    return (name, name.partition(".")[0])


def _announce(
    host: str,
    port: int,
    tokens: Tokens | None,
    session: Session,
    *,
    opens: bool | None,
    tell: Callable[[str], object],
) -> None:
    """Say where the page is, and open it where there is somebody to see it."""
    query = f"?token={tokens.current}" if tokens else ""
    shown = _reached_at() if host in ("0.0.0.0", "::") else host
    named = f"[{shown}]" if ":" in shown else shown
    address = f"http://{named}:{port}/{query}"
    say(f"{session.source.name}, recorded in {session.recording}")
    if tokens:
        say("for one browser; who opens it next needs the address that is printed then:")
    tell(address)
    if has_screen() if opens is None else opens:
        threading.Thread(target=_open_browser, args=(address,), daemon=True).start()


def _open_browser(address: str) -> None:
    import webbrowser

    with contextlib.suppress(webbrowser.Error, OSError):
        webbrowser.open(address)


def has_screen() -> bool:
    """Whether somebody sits at a terminal of a machine with a screen."""
    if not sys.stdout.isatty():
        return False
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _reached_at() -> str:
    """The address of this machine on its network, as far as it has one; nothing is sent to find out."""
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return "127.0.0.1"
