"""``flinders watch``: online calibration while a vehicle works."""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import clock_start, load, say_read
from flinders.cli._output import json_value, say
from flinders.cli._signals import catch_stop_signals
from flinders.errors import UnreadableInput, UsageError
from flinders.links.serial_ports import SERIAL_PORT

if TYPE_CHECKING:
    from collections.abc import Callable
    from datetime import datetime

    from flinders.apps.service.handover import Handover
    from flinders.apps.service.publishing import Publisher
    from flinders.apps.service.reports import Report
    from flinders.apps.service.sources import Source
    from flinders.apps.service.watching import Files, InitialSettings
    from flinders.core.samples import Recording
    from flinders.core.units import Unit
    from flinders.workflows.online import OnlineCalibration


class LineOptions(option.LinesOptions):
    """Options to read lines and recordings."""

    unit: str | None = program.same_as(option.UnitsOptions, "unit")


class WatchedSource(program.Group):
    """Source of the readings."""

    files: tuple[str, ...] = program.argument("[-|LOG...]", required=False, nargs=-1)
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
    replay: str | None = program.member(
        "--replay", metavar="LOG", help="Recordings, read at full speed, one after the other."
    )
    lines: LineOptions = program.group(LineOptions)

    def check(self) -> None:
        """Refuse no source, and several sources.

        Raises `UsageError`.
        """
        sources = {
            "--serial": self.port, "--udp": self.udp, "--tcp": self.tcp, "--mavlink": self.mavlink,
            "--ros2": self.ros2, "--replay": self.replay,
        }  # fmt: skip
        named = [name for name, value in sources.items() if value is not None]
        if len(named) > 1:
            raise UsageError(f"{' and '.join(named)} name several sensors: watch each with a command of its own")
        if self.files and self.replay is None and (named or self.files != ("-",)):
            word = self.files[0]
            source = "--serial" if SERIAL_PORT.match(word) else "--replay"
            raise UsageError(
                f"unexpected argument {word}: name one source by its option, as in flinders watch {source} {word}, or "
                "- for standard input"
            )
        if not named and not self.files:
            from flinders.links.serial_ports import describe_ports

            raise UsageError(
                f"nothing to watch: name a --serial port ({describe_ports()}), --udp PORT, --tcp HOST:PORT, "
                "--mavlink LINK, --ros2 TOPIC, --replay LOG, or - for standard input"
            )
        if self.compass != 1 and self.mavlink is None:
            raise UsageError("--compass needs --mavlink: leave --compass out")
        self.lines.refuse_with(named)
        if self.lines.unit:
            from flinders.core.units import Unit

            Unit.of(self.lines.unit)

    def open_source(
        self,
        stack: contextlib.ExitStack,
        calibration: OnlineCalibration | InitialSettings,
        *,
        is_published: bool = False,
    ) -> Source:
        """Open the named source; readings without a unit are in the calibration's unit.

        If readings are published again, each is passed on without batching.
        """
        from flinders.apps.service import sources
        from flinders.apps.service.watching import frame_in, since_of, unit_of
        from flinders.core.units import Unit
        from flinders.links.feeds import feed_kind
        from flinders.links.transports import StandardInput, open_lines, open_link

        reading: dict[str, Any] = {name: value for name, value in self.lines.as_dict().items() if value is not None}
        unit, since = unit_of(calibration), since_of(calibration)
        if unit is not None and self.lines.unit is None:
            reading |= {"unit": unit.name} if unit == Unit.of(unit.name) else {"unit": unit.name, "scale": unit.scale}
        if self.replay is not None:
            return self._recordings(stack, unit, frame_in(calibration))
        if self.files:
            return sources.of_pipe(StandardInput(), since, **reading)
        if self.mavlink is not None:
            feed_of = feed_kind("mavlink")
            link = stack.enter_context(contextlib.closing(open_link(self.mavlink, self.baud, what="--mavlink")))
            return sources.of_feed(feed_of(link, self.compass), since)
        if self.ros2 is not None:
            topic = feed_kind("ros2")(self.ros2, None, self.lines.unit)
            return sources.of_feed(topic, since, rests=not is_published)
        wire = open_lines(port=self.port, baud=self.baud, udp=self.udp, tcp=self.tcp)
        stack.enter_context(contextlib.closing(wire))
        return sources.of_wire(wire, since, **reading)

    def _recordings(self, stack: contextlib.ExitStack, unit: Unit | None, frame: str | None) -> Source:
        """Open recordings as one source, one after the other."""
        from flinders.apps.service.sources import of_recordings
        from flinders.core.samples import frame_of
        from flinders.estimators.data import CountedRecording
        from flinders.readers import TableRecording, TextRecording, open_recording
        from flinders.workflows.recordings import refuse_other_frame

        reading = {name: value for name, value in self.lines.as_dict().items() if value is not None}
        recordings = [open_recording(path, **reading) for path in (str(self.replay), *self.files)]
        for recording in recordings:
            if unit is not None and self.lines.unit is None and isinstance(recording, TextRecording | TableRecording):
                recording.unit = recording.unit if recording.states_unit else unit
            refuse_other_frame(frame or frame_of(recordings[0]), recording)
        parts = [CountedRecording(recording) for recording in recordings]
        for part in reversed(parts):
            stack.callback(say_read, part)
        return of_recordings(parts, [_start_time(recording) for recording in recordings])


class Watch(program.Group):
    """A source, the initial calibration, and the outputs."""

    source: WatchedSource = program.group(WatchedSource)
    calibration: str | None = program.member(
        "--previous", metavar="CALIBRATION", help="Initial calibration file [default: estimated from the readings]."
    )
    walk: float | None = program.member(
        "--walk", type=program.positive, metavar="RATE",
        help="Random walk of this unit's offset in an hour, 1 σ, in µT or counts. A factor of two is exact enough.",
    )  # fmt: skip
    history: str | None = program.member(
        "--history", metavar="HISTORY", help="Estimate the random walk of this unit's offset from an earlier state."
    )
    axes: str = program.same_as(option.AxesOptions, "axes")
    target_deg: float = option.target()
    dip_deg: float | None = option.dip("Inclination of the field at the site [default: 60].")
    lock: bool = program.flag(
        "--lock", "Keep the calibration in force, despite newer estimates.", heading=program.METHOD
    )
    state: str | None = program.member(
        "--state",
        metavar="FILE",
        help="State file: continue from it if it exists, and update it.",
        heading=program.OUTPUT,
    )
    every: float = program.member(
        "--every", type=program.positive, default=60.0, show_default=True, metavar="S",
        help="Interval in s at which files are written, and the state is printed with --json.", heading=program.OUTPUT,
    )  # fmt: skip
    adopted: str | None = program.member(
        "--adopted", metavar="FILE|FOLDER", help="File or folder for each calibration that comes into force.",
        heading=program.OUTPUT,
    )  # fmt: skip
    status: str | None = program.member(
        "--status", metavar="FILE", help="File with the state as JSON.", heading=program.OUTPUT
    )
    prometheus: str | None = program.member(
        "--prometheus", metavar="FILE", help="File for Prometheus's node exporter.", heading=program.OUTPUT
    )
    page: str | None = program.member(
        "--page", metavar="FILE.html", help="Page with the state, its history and events.",
        heading=program.OUTPUT,
    )  # fmt: skip
    send: str | None = program.member(
        "--send", metavar="FOLDER", heading=program.OUTPUT,
        help="Send calibrations to the disarmed vehicle of --mavlink; its previous values go into this folder.",
    )  # fmt: skip
    send_interval_s: float = program.member(
        "--send-interval", type=program.positive, default=3600.0, show_default=True, metavar="S",
        help="Shortest time between two calibrations that are sent, in s.", heading=program.OUTPUT,
    )  # fmt: skip
    publish: str | None = program.member(
        "--publish", is_flag=False, flag_value="", metavar="[TOPIC]", heading=program.OUTPUT,
        help="With --ros2: publish corrected readings [default: /imu/mag_corrected], diagnostics, and the calibration.",
    )  # fmt: skip
    as_json: bool = program.flag(
        "--json", "Print each event, and the state periodically, as a line of JSON.", heading=program.OUTPUT
    )

    def check(self) -> None:
        """Refuse other than one source, and files that cannot be written.

        Raises `UsageError`; `OutputError` if a file cannot be written.
        """
        from flinders.cli._output import refuse_to_overwrite
        from flinders.core.files import refuse_existing

        self.source.check()
        self._check_sending()
        if self.publish is not None and self.source.ros2 is None:
            raise UsageError("--publish needs --ros2: leave --publish out; for other programs use --adopted or --json")
        if self.walk is not None and self.history is not None:
            raise UsageError("--walk and --history both give the random walk of the offset: leave one out")
        read = [*self.source.files, *filter(None, (self.source.replay, self.calibration, self.history))]
        files = {
            "--state": self.state, "--status": self.status, "--prometheus": self.prometheus, "--page": self.page,
            "--adopted": None if self.adopted is None or Path(self.adopted).is_dir() else self.adopted,
        }  # fmt: skip
        seen: dict[str, str] = {}
        for name, path in files.items():
            if path is None:
                continue
            if path == "-":
                raise UsageError(f"{name} needs a regular file, which is replaced; use --json to print the state")
            if other := seen.get(os.path.realpath(path)):
                raise UsageError(f"{path} is given for {other} and for {name}: give two different files")
            seen[os.path.realpath(path)] = name
            refuse_to_overwrite(path, read)
            refuse_existing(path, force=True)

    def _check_sending(self) -> None:
        """Refuse --send for a source that cannot receive calibrations, or without a folder for previous values."""
        if self.send is None:
            if program.is_typed("send_interval_s"):
                raise UsageError("--send-interval needs --send: leave --send-interval out")
            return
        if self.source.mavlink is None:
            raise UsageError(
                "--send needs --mavlink: a board on a wire does not report its previous values, so that nobody "
                "could restore them. Write calibrations with --adopted, and send one with flinders send"
            )
        if not Path(self.send).is_dir():
            raise UsageError(f"--send {self.send}: need an existing folder, for the vehicle's previous values")

    def handover(self, source: Source, stopped: Callable[[], bool]) -> Handover | None:
        """Return the sender of calibrations; None without --send."""
        if self.send is None or source.recipient is None:
            return None
        from flinders.apps.service.handover import Handover

        return Handover(source.recipient, self.send, interval_s=self.send_interval_s, stopped=stopped, say=say)

    def publisher(self, source: Source) -> Publisher | None:
        """Return the publisher of corrected readings; None without --publish."""
        if self.publish is None:
            return None
        from flinders.links.feeds import publisher_kind

        open_publisher: Callable[..., Publisher] = publisher_kind("ros2")
        return open_publisher(source.feed, *([self.publish] if self.publish else []))

    def initial_calibration(self) -> OnlineCalibration | InitialSettings:
        """Return the calibration of the state file if it exists, else the settings to begin one."""
        from flinders.apps.service.watching import InitialSettings
        from flinders.core.axes import Axes
        from flinders.workflows.online import OnlineCalibration

        Axes.of(self.axes)
        if self.state is not None and Path(self.state).exists():
            online = OnlineCalibration.load(self.state)
            self._refuse_others(online.state.target_deg)
            begins = {"--previous": self.calibration, "--walk": self.walk, "--history": self.history}
            unused = " and ".join(name for name, value in begins.items() if value is not None)
            words = f"; {unused} is not used" if unused else ""
            words += "; it comes from another release, whose evidence is left out" if online.is_converted else ""
            say(f"{self.state}: continues{words}")
            return online
        walk = self.known_walk()
        if self.calibration is None:
            return InitialSettings(None, self.axes, self.target_deg, self.dip_deg, **walk)
        if program.is_typed("axes"):
            raise UsageError("--previous already states the axes: leave --axes or --previous out")
        start = load("watch --previous", self.calibration)
        begun = InitialSettings(start, target_deg=self.target_deg, dip_deg=self.dip_deg, **walk)
        begun.calibration(start.calibration.raw)  # raises before anything is opened
        return begun

    def known_walk(self) -> dict[str, Any]:
        """Return the random walk of the unit's offset from its history, as keywords; `UsageError` for a short one."""
        from flinders.core.units import unit_label
        from flinders.workflows.offset_history import OffsetHistory
        from flinders.workflows.walk import MIN_STEPS

        if self.history is None:
            return {"walk": self.walk}
        history = OffsetHistory.read(self.history)
        if (walk := history.walk) is None:
            found = len(history.estimates.time_s)
            raise UsageError(
                f"{self.history} is too short for a random walk: it has {found} estimates of the offset at intervals "
                f"of two hours, need {MIN_STEPS + 1}; give a longer history, or the random walk by --walk"
            )
        say(f"{self.history}: the random walk of this unit's offset is {walk}, in {unit_label(history.unit)}")
        return {"walk": walk, "walk_unit": history.unit}

    def _refuse_others(self, target_deg: float) -> None:
        """Refuse options that contradict the state from which the calibration continues."""
        if program.is_typed("target_deg") and self.target_deg != target_deg:
            raise UsageError(
                f"--target is {self.target_deg:g}°, but {self.state} has {target_deg:g}°: leave --target out, or "
                "give another state file to begin again"
            )

    @property
    def files(self) -> Files:
        """Return the files to write."""
        from flinders.apps.service.watching import Files

        return Files(self.state, self.adopted, self.status, self.prometheus, self.page)


@program.command_of(
    "watch",
    Watch,
    common=("port", "udp", "tcp", "mavlink", "ros2", "replay", "state", "as_json"),
    headings={"Source": ("baud", "compass"), "Begin": ("calibration", "walk", "history")},
    epilog="""\b
Example:
  flinders watch --serial /dev/ttyACM0 --state compass.state
  flinders watch --udp 50100 --unit mG --state compass.state --prometheus compass.prom --page compass.html
  flinders watch --mavlink udp:0.0.0.0:14550 --adopted calibration.json
  flinders watch --ros2 /imu/mag --publish /imu/mag_corrected --state compass.state
  flinders watch --replay monday.csv tuesday.csv --json

\b
Exit codes:
  0  ended by Ctrl-C or a signal, or read to the end
  5  no port, or no reading arrived
  6  the state, or the calibration that came into force, cannot be written, or another program uses that state
""",
)
def command(options: Watch) -> None:
    """Keep a sensor calibrated while its vehicle works.

    Readings of ordinary use are enough: the first calibration is made as soon as they allow it, and improves with every
    turn of the vehicle. The expected heading error is known at any time, also between updates. The command
    distinguishes passing disturbances, such as iron near the road, from an offset that has moved.
    """
    from flinders.apps.service.watching import Watch as Watching
    from flinders.core.files import lock_path

    options.check()
    with contextlib.ExitStack() as stack:
        if options.state is not None:
            stack.enter_context(lock_path(options.state))
        calibration = options.initial_calibration()
        source = options.source.open_source(stack, calibration, is_published=options.publish is not None)
        stopped = stack.enter_context(catch_stop_signals(patient=False))
        say(f"watching {source.name}{'' if options.source.replay else '; Ctrl-C ends it'}")
        watching = Watching(
            source,
            calibration,
            files=options.files,
            every=options.every,
            is_locked=options.lock,
            handover=options.handover(source, stopped),
            publisher=options.publisher(source),
            tell=_json if options.as_json else _change_printer(),
            say=say,
            stopped=stopped,
        )
        report = watching.run()
    if not report.readings and not stopped():
        raise UnreadableInput(f"no reading of {report.source}: name its columns with --columns, and its --unit")
    say(f"{report.readings:,} readings; {report.line()}")


def _json(report: Report) -> None:
    """Print a report as a line of JSON."""
    click.echo(json.dumps(json_value(report.as_dict())))


def _start_time(recording: Recording) -> float:
    """Start of a recording's times, s from 1970; 0 if unknown."""
    from flinders.apps.service.sources import first_time

    begun: datetime | None = getattr(recording, "start_time", None)  # for a vehicle's log: its first reading
    return clock_start(recording) if begun is None else begun.timestamp() - first_time(recording)


def _change_printer() -> Callable[[Report], None]:
    """Return a function that prints a line for each change, except for a new estimate that comes into force."""
    last: list[Any] = [None, None]

    def tell(report: Report) -> None:
        is_same = report.event == "adopted" and last in ([report.time_s, "learnt"], [report.time_s, "moved"])
        last[:] = [report.time_s, report.event]
        if report.kind == "source" or report.event == "waits":
            say(report.line())
        elif report.kind == "send" or (report.kind == "event" and not is_same):
            click.echo(report.line())

    return tell
