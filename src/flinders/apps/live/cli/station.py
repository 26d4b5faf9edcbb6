"""``flinders station``: test units of a production line on a page for an operator."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from flinders.apps.live.cli.live import SWITCH_S, LiveSource, ServedPage, announce, with_serial_port
from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import print_json, say
from flinders.foreign_errors import import_optional

if TYPE_CHECKING:
    from flinders.apps.live.station.bench import Station
    from flinders.apps.live.station.folder import StationFolder
    from flinders.apps.live.station.plan import Plan
    from flinders.apps.live.station.recordings import SerialNumberSource
    from flinders.links.transports import ByteSource

FOLDER: Final = "flinders-station"


class StationOptions(program.Group):
    """A sensor, the pass limits, and the folder of the results."""

    plan: str | None = program.argument("[PLAN.toml]", required=False)
    source: LiveSource = program.group(LiveSource)
    axes: str = program.same_as(option.AxesOptions, "axes")
    folder: str = program.member(
        "-o", "--output", default=FOLDER, show_default=True, metavar="FOLDER",
        help="Folder of the table, the recordings and the calibrations.",
    )  # fmt: skip
    operator: str = program.member(
        "--operator", default="", metavar="NAME", help="Name of the operator; the page can change it."
    )
    name: str = program.member("--name", default="", metavar="NAME", help="Name of the station, written to each row.")
    targets: tuple[str, ...] = program.member(
        "--for",
        multiple=True,
        metavar="TARGET",
        help="Export each unit that passes for a target, in addition to those of the plan.",
    )
    page: ServedPage = program.group(ServedPage)
    as_json: bool = option.as_json()

    @classmethod
    def from_values(cls, values: dict[str, Any]) -> Self:
        """Take the values of the command, with those of the chip."""
        return super().from_values(option.with_chip(values))


@program.command_of(
    "station",
    StationOptions,
    common=("port", "udp", "tcp", "simulate", "folder", "operator", "name", "targets"),
    headings={
        "Source": ("baud", "mavlink", "compass", "ros2", "imu_topic", "replay", "speed"),
        "Page": ("host", "web_port", "opens"),
    },
    epilog="""\b
Example:
  flinders station line-3.toml --serial /dev/ttyACM0 -o line-3
  flinders station --simulate
""",
)
def command(options: StationOptions) -> None:
    """Test units of a production line: serial number, motion, pass or fail, next unit by one key.

    PLAN.toml has the pass limits, the motion and the exports. The folder receives a table with one row a test, and
    recording and calibration of each test by serial number and time.
    """
    source, page = with_serial_port(options.source, options.page)
    options = dataclasses.replace(options, source=source, page=page)
    options.source.check()
    options.page.check()
    for package in ("starlette", "uvicorn", "websockets", "segno"):
        import_optional(package, "live", "the page of a station")
    sys.setswitchinterval(SWITCH_S)
    from msgspec.structs import replace

    from flinders.apps.live.access import Gate, Tokens, own_names, serve
    from flinders.apps.live.server import application
    from flinders.apps.live.standalone.package import live_data
    from flinders.apps.live.station.folder import StationFolder
    from flinders.apps.live.station.plan import Exports, Plan, read_plan
    from flinders.apps.live.station.routes import routes_of
    from flinders.targets import find

    plan = Plan() if options.plan is None else read_plan(options.plan)
    plan = replace(plan, export=Exports(targets=tuple(dict.fromkeys((*plan.export.targets, *options.targets)))))
    for target in plan.export.targets:
        find(target)
    with contextlib.ExitStack() as stack:
        listener = stack.enter_context(contextlib.closing(options.page.open_listener()))
        folder = stack.enter_context(contextlib.closing(StationFolder(Path(options.folder))))
        station = _station(options, plan, folder, stack)
        _say_interrupted(station)
        port = listener.getsockname()[1]
        gate = Gate.of(options.page.host, port, own_names())
        tokens = Tokens() if gate.is_open else None
        say(f"{station.hub.source.name}, tests in {folder.table.path}")
        announce(port, tokens.current if tokens else None, options.page, as_json=options.as_json)
        serve(application(station.hub, gate, tokens, say, live_data, routes_of(station)), listener)
        _say_interrupted(station)
        if station.hub.failure is not None:
            raise station.hub.failure
        say(f"{station.state.passed} passed, {station.state.failed} failed: {folder.table.path}")
        if options.as_json:
            print_json(_as_dict(station))


def _station(options: StationOptions, plan: Plan, folder: StationFolder, stack: contextlib.ExitStack) -> Station:
    """Return the test bench with its sensor."""
    from flinders.apps.live.hub import Hub
    from flinders.apps.live.messages import Edits
    from flinders.apps.live.session_file import Supply
    from flinders.apps.live.station.bench import Station
    from flinders.apps.live.station.recordings import SerialNumberSource, UnitSink
    from flinders.core.axes import Axes

    boards: list[SerialNumberSource] = []

    def heard(wire: ByteSource) -> ByteSource:
        if plan.serial.board_line is None:
            return wire
        boards.append(SerialNumberSource(wire, plan.serial.board_line))
        return boards[0]

    axes = Axes.of(options.axes)
    source, sink = options.source.open_source(stack, heard=heard), UnitSink(say)
    edits = Edits(paused_s=0.0, target_deg=plan.limits.heading_error_deg, dip_deg=plan.site.dip_deg, site=source.site)
    reading = {**source.reading, "axes": str(axes)}
    feed = source.start(sink, resumed=None)
    supply = Supply(feed, source.kind, sink, folder.path, axes, source.board, reading, edits)
    board = boards[0] if boards else None
    return Station(Hub(supply), sink, folder, plan, operator=options.operator, name=options.name, board=board)


def _say_interrupted(station: Station) -> None:
    """Write the row of an interrupted test, and report it."""
    test = station.recover()
    if test is not None:
        say(f"{test.serial} was interrupted during its test: its recording is kept; test it again")


def _as_dict(station: Station) -> dict[str, Any]:
    """JSON-ready results since the program was started."""
    return {
        "table": str(station.folder.table.path),  # file with a row for each test
        "passed": station.state.passed,  # tests since the program was started
        "failed": station.state.failed,  # tests since the program was started
    }
