"""``flinders send``: a calibration into a board or a vehicle, with the proof that it is there."""

from __future__ import annotations

import contextlib
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import click

from flinders.cli import _options
from flinders.cli._inputs import for_use, known_of, only, refuse_on_top
from flinders.cli._options import option
from flinders.cli._output import print_json, say
from flinders.cli._program import stopping
from flinders.errors import NotConfirmed, OutputError, OutputExists, UsageError, counted

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.fitting.result import Fit
    from flinders.live.mavlink import Vehicle
    from flinders.live.mavlink_parameters import ParameterChange, ParameterPlan
    from flinders.live.transports import ByteSource
    from flinders.targets import Export


@_options.command(
    "send",
    common=("port", "mavlink", "baud", "compass", "dry_run"),
    headings={"Vehicle": ("device_id", "system", "backup")},
    short_help="Send a calibration to a board or vehicle.",
    epilog="""\b
Example:
  flinders send --port /dev/ttyACM0 calibration.json
  flinders send --mavlink udp:127.0.0.1:14550 --dry-run calibration.json
  flinders send --mavlink /dev/ttyACM0 --compass 2 calibration.json

\b
Exit codes:
  4  refused: armed, another compass, or values that do not fit; nothing was changed
  5  no port, board or vehicle
  6  sent and not confirmed; says what the board or vehicle holds
""",
)
@click.argument("calibration", metavar="CALIBRATION")
@option("--port", metavar="PORT", help="A board that takes what MotionCal sends: /dev/ttyACM0, COM3.")
@option(
    "--mavlink",
    metavar="ADDRESS",
    help="A vehicle: udp:HOST:PORT to listen, udpout:HOST:PORT, tcp:HOST:PORT, or a serial port.",
)
@option("--baud", **_options.BAUD)
@option(
    "--compass",
    type=click.IntRange(0, 3),
    metavar="N",
    help="Which compass: ArduPilot's 1 to 3, PX4's 0 to 3 [default: by device id, that of the log, or the first].",
)
@option("--device-id", type=click.IntRange(1, 2**32 - 1), metavar="ID", help="Device id that the compass must have.")
@option("--system", type=click.IntRange(1, 255), metavar="N", help="Which vehicle, where several are on the link.")
@option(
    "--backup",
    metavar="FILE",
    help="Where the vehicle's values from before go [default: compass-before-TIME.param(s)].",
)
@option("--dry-run", is_flag=True, help="Show what would be sent or changed, and change nothing.")
@_options.as_json
def command(
    calibration: str,
    port: str | None,
    mavlink: str | None,
    baud: int,
    compass: int | None,
    device_id: int | None,
    system: int | None,
    backup: str | None,
    dry_run: bool,
    as_json: bool,
) -> None:
    """Send CALIBRATION to a board over a serial port, or to an ArduPilot or PX4 vehicle over MAVLink.

    A board gets the packet that MotionCal sends, and has to echo its values. Of a vehicle the compass parameters
    are set, each with read-back; the values from before are saved first, and put back where anything fails. An
    armed vehicle is refused, and so is one whose compass has another device id than the calibration is for.
    """
    if (port is None) == (mavlink is None):
        raise UsageError(_unclear(both=port is not None))
    if port is not None:
        vehicles = {"--compass": compass, "--device-id": device_id, "--system": system, "--backup": backup}
        if wrong := [name for name, value in vehicles.items() if value is not None]:
            raise UsageError(f"{', '.join(wrong)} goes with --mavlink: a board on --port has one compass")
        _to_board(for_use("send", calibration), port, baud, dry_run=dry_run, as_json=as_json)
        return
    fit = for_use("send", calibration)
    refuse_on_top(fit, "the vehicle")
    with contextlib.ExitStack() as stack:
        source = opened(str(mavlink), baud)
        stack.callback(source.close)
        _to_vehicle(
            fit,
            source,
            system=system,
            compass=compass,
            device_id=device_id,
            backup=backup,
            dry_run=dry_run,
            as_json=as_json,
        )


def _unclear(*, both: bool) -> str:
    """Say that exactly one receiver has to be named."""
    if both:
        return "--port and --mavlink name two receivers: send to each with a command of its own"
    from flinders.live.transports import ports_in_words

    return f"no receiver: name the board's --port ({ports_in_words()}), or the vehicle's --mavlink udp:127.0.0.1:14550"


def _render(calibration: Calibration, target: str) -> Export:
    """Have a target's own formula run on the numbers that will be sent, and refuse what it cannot hold."""
    from flinders.targets import find

    return find(target).render(calibration)


# boards


def _to_board(fit: Fit, port: str, baud: int, *, dry_run: bool, as_json: bool) -> None:
    """Send MotionCal's packet and wait for the echo."""
    from flinders.live import motioncal
    from flinders.live.transports import Serial
    from flinders.targets.motioncal import MotionCalPacket

    export = _render(fit.calibration, "motioncal")
    packet = MotionCalPacket.of(fit.calibration)
    fields: dict[str, Any] = {
        "port": port,
        "packet": packet.encode().hex(),
        "offset_uT": packet.offset,
        "field_uT": packet.strength,
        "matrix": packet.matrix,
    }
    axes = fit.calibration.axes
    for warning in (
        *export.warnings,
        *[f"it acts in the sensor's own axes: go on mapping them to {axes} afterwards"] * (not axes.is_identity),
        "the packet also sets the offsets of accelerometer and gyroscope, to 0, as MotionCal does",
    ):
        say(f"! {warning}")
    if dry_run:
        if as_json:
            print_json({**fields, "sent": False})
        else:
            content = packet.encode()
            rows = [content[start : start + 16].hex(" ") for start in range(0, len(content), 16)]
            click.echo("\n".join([f"would send to {port} at {baud} baud:", *rows]))
            click.echo("and wait for:\n" + "\n".join(motioncal.echo_lines(packet)))
        return
    source = Serial(port, baud)
    try:
        say(f"{port}: sending {len(packet.encode())} bytes")
        confirmed = motioncal.send(source, packet)
    except KeyboardInterrupt:
        say(f"! stopped: {motioncal.EITHER}; send again, or see what it prints with flinders record")
        raise
    finally:
        source.close()
    say(f"{port}: {confirmed}")
    if as_json:
        print_json({**fields, "sent": True, "tries": confirmed.tries, "echo_decimals": confirmed.places})


# vehicles


def opened(address: str, baud: int) -> ByteSource:
    """Open what ``--mavlink`` names.

    Raises
    ------
    UsageError
        For an address that is none.
    LinkError
        Where it cannot be opened.
    """
    from flinders.live.transports import Serial, Tcp, Udp, host_and_port

    kind, colon, rest = address.partition(":")
    match kind.casefold() if colon else "":
        case "udp" | "udpin":
            host, port = host_and_port(rest if ":" in rest else f"0.0.0.0:{rest}", "--mavlink")
            return Udp(port, host)
        case "udpout":
            host, port = host_and_port(rest, "--mavlink")
            return Udp(port, host, speaks_first=True)
        case "tcp":
            return Tcp(*host_and_port(rest, "--mavlink"))
        case "serial":
            return Serial(rest, baud)
    if colon and not address.startswith(("/", ".")):
        raise UsageError(
            f"--mavlink {address!r}: need udp:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or a serial port such as "
            "/dev/ttyACM0 or COM3"
        )
    return Serial(address, baud)


def _to_vehicle(
    fit: Fit,
    source: ByteSource,
    *,
    system: int | None,
    compass: int | None,
    device_id: int | None,
    backup: str | None,
    dry_run: bool,
    as_json: bool,
) -> None:
    """Set the compass parameters of a vehicle, or show what they would be."""
    from flinders.core.files import write_text
    from flinders.live.mavlink import PX4, Vehicle
    from flinders.live.mavlink_parameters import ParameterPlan

    if backup is not None:
        _refuse_backup(backup)
    say(f"waiting for a vehicle on {source.name}")
    vehicle = Vehicle.find(source, system=system)
    say(f"{vehicle.name}, {'ARMED' if vehicle.armed else 'disarmed'}")
    target = "px4" if vehicle.autopilot == PX4 else "ardupilot"
    warnings = _render(fit.calibration, target).warnings
    if device_id is None:
        device_id = only(fit, known_of(fit, target, "device_id"), "the compasses with device id", "--device-id")
    if device_id is None and compass is None:
        compass = only(fit, known_of(fit, target, "compass"), "compass", "--compass")
    plan = ParameterPlan.of(vehicle, fit.calibration, compass=compass, device_id=device_id)
    path = backup or f"compass-before-{datetime.now(UTC):%Y%m%dT%H%M%SZ}.param{'s' * (plan.autopilot == PX4)}"
    for note in (*plan.notes, *warnings):
        say(f"! {note}")
    if dry_run or not plan.pending:
        _show(plan, as_json=as_json, written_to=None)
        say(
            "nothing was changed" if plan.pending else f"{plan.vehicle} holds these values already: nothing was changed"
        )
        return
    _refuse_backup(path)
    write_text(plan.backup(), path)
    say(f"the values from before are in {path}")
    _carry_out(plan, vehicle, path)
    _show(plan, as_json=as_json, written_to=path)
    say(
        f"{plan.vehicle}: compass {plan.compass} holds the calibration, all {len(plan.changes)} values read back. "
        "Restart the vehicle, and check a known bearing before it moves"
    )


def _refuse_backup(path: str) -> None:
    """See that the values from before have a place of their own, which lasts.

    Raises
    ------
    UsageError, OutputError
    """
    from flinders.core.files import refuse_existing

    if path in ("", "-"):
        raise UsageError(f"--backup {path!r}: need the name of a file, which is there when all else fails")
    try:
        refuse_existing(path)
    except OutputExists:
        raise OutputError(
            f"{path} exists, and may hold values that somebody needs: name another file with --backup"
        ) from None


def _carry_out(plan: ParameterPlan, vehicle: Vehicle, path: str) -> None:
    """Change the vehicle; where that fails, say where the old values are.

    Raises
    ------
    NotConfirmed
    """
    with stopping(patient=True) as stopped:
        try:
            plan.carry_out(vehicle, stopped=stopped, say=say)
        except NotConfirmed as error:
            message = f"{error}. The values from before are in {path}"
            if not stopped():
                raise NotConfirmed(message) from None
            say(f"error: {message}")
            raise click.Abort from None


def _show(plan: ParameterPlan, *, as_json: bool, written_to: str | None) -> None:
    """Print each parameter, before and after."""
    if as_json:
        print_json(
            {
                "vehicle": plan.vehicle,
                "compass": plan.compass,
                "device_id": plan.device_id,
                "parameters": [_as_dict(change) for change in plan.changes],
                "backup": written_to,
                "sent": written_to is not None,
                "notes": plan.notes,
            }
        )
        return
    width = max(len(change.new.name) for change in plan.changes)
    click.echo(f"{'compass ' + str(plan.compass):<{width}}  {'before':>12}  {'after':>12}   (device {plan.device_id})")
    for change in plan.changes:
        after = "the same" if change.is_none else f"{change.new.value:.6g}"
        click.echo(f"{change.new.name:<{width}}  {change.old.value:>12.6g}  {after:>12}")
    if written_to is None and plan.pending:
        click.echo(f"{counted(len(plan.pending), 'value')} would change")


def _as_dict(change: ParameterChange) -> dict[str, object]:
    return {"name": change.new.name, "before": change.old.value, "after": change.new.value}
