"""``flinders send``: write a calibration to a board or a vehicle, and verify it there."""

from __future__ import annotations

import contextlib
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._inputs import load_for_use
from flinders.cli._output import lossy_if_agreed, print_json, say
from flinders.cli._signals import catch_stop_signals
from flinders.errors import NotConfirmed, OutputError, OutputExists, UsageError, count_text

if TYPE_CHECKING:
    from flinders.apps.vehicles.mavlink import Vehicle
    from flinders.apps.vehicles.mavlink_parameters import ParameterPlan
    from flinders.fitting.result import Fit
    from flinders.links.transports import ByteSource
    from flinders.targets.motioncal import MotionCalPacket


class Send(program.Group):
    """A calibration, and the board or vehicle that receives it."""

    calibration: str = program.argument("CALIBRATION")
    port: str | None = program.member(
        "--serial", metavar="PORT", help="A board that accepts MotionCal's packet: /dev/ttyACM0, COM3."
    )
    mavlink: str | None = program.member(
        "--mavlink", metavar="ADDRESS",
        help="A vehicle: udp:HOST:PORT to listen, udpout:HOST:PORT, tcp:HOST:PORT, or a serial port.",
    )  # fmt: skip
    baud: int = option.baud()
    compass: int | None = program.member(
        "--compass", type=click.IntRange(0, 3), metavar="N",
        help="Compass: ArduPilot's 1 to 3, PX4's 0 to 3 [default: by device id, by the log, or the first].",
    )  # fmt: skip
    device_id: int | None = program.member(
        "--device-id", type=click.IntRange(1, 2**32 - 1), metavar="ID", help="Device id that the compass must have."
    )
    system: int | None = program.member(
        "--system", type=click.IntRange(1, 255), metavar="N", help="MAVLink system, if several are on the link."
    )
    mounting: str | None = option.mounting()
    lossy: bool = option.lossy()
    backup: str | None = program.member(
        "--backup", metavar="FILE",
        help="File for the previous values of the vehicle [default: compass-before-TIME.param(s)].",
    )  # fmt: skip
    dry_run: bool = program.flag("--dry-run", "Show what would be sent or changed, and change nothing.")
    as_json: bool = option.as_json()

    def check(self) -> None:
        """Refuse none or several receivers, and options that do not belong to the receiver."""
        if self.port is not None and self.mavlink is not None:
            raise UsageError("--serial and --mavlink name two receivers: send to each with a command of its own")
        if self.port is None and self.mavlink is None:
            from flinders.links.serial_ports import describe_ports

            raise UsageError(
                f"no receiver: name the board's --serial port ({describe_ports()}), or the vehicle's --mavlink "
                "udp:127.0.0.1:14550"
            )
        of_vehicles = {
            "--compass": self.compass, "--device-id": self.device_id, "--system": self.system,
            "--mounting": self.mounting, "--backup": self.backup,
        }  # fmt: skip
        wrong = [name for name, value in of_vehicles.items() if value is not None]
        if self.port is not None and wrong:
            raise UsageError(f"{', '.join(wrong)} applies only to --mavlink: a board on --serial has one compass")


@program.command_of(
    "send",
    Send,
    common=("port", "mavlink", "baud", "compass", "dry_run"),
    headings={"Vehicle": ("device_id", "system", "mounting", "lossy", "backup")},
    epilog="""\b
Example:
  flinders send --serial /dev/ttyACM0 calibration.json
  flinders send --mavlink udp:127.0.0.1:14550 --dry-run calibration.json
  flinders send --mavlink /dev/ttyACM0 --compass 2 calibration.json

\b
Exit codes:
  4  refused: armed, another compass, or values that do not fit; nothing was changed
  5  no port, board or vehicle
  6  sent and not confirmed; the message states the values that the board or vehicle holds
""",
)
def command(options: Send) -> None:
    """Send CALIBRATION to a board over a serial port, or to an ArduPilot or PX4 vehicle over MAVLink.

    A board receives MotionCal's packet and has to echo its values. On a vehicle, the compass parameters are set and
    each is read back; the previous values are saved first, and restored if anything fails. A rotation of the
    calibration is set as the compass's new mounting. An armed vehicle is refused. So is a vehicle whose compass has
    a device id or mounting that differs from the calibration's.
    """
    options.check()
    fit = load_for_use("send", options.calibration)
    if options.port is not None:
        _to_board(fit, options.port, options)
        return
    from flinders.fitting.export import refuse_on_top
    from flinders.links.transports import open_link

    refuse_on_top(fit, "the vehicle")
    with contextlib.closing(open_link(str(options.mavlink), options.baud, what="--mavlink")) as link:
        _to_vehicle(fit, link, options)


# boards


def _to_board(fit: Fit, port: str, options: Send) -> None:
    """Send MotionCal's packet and wait for the echo."""
    from flinders.apps.vehicles.sending import board_packet
    from flinders.links import motioncal
    from flinders.links.transports import Serial

    made = lossy_if_agreed(lambda lossy: board_packet(fit, lossy=lossy), lossy=options.lossy)
    packet = made.packet
    for warning in made.warnings:
        say(f"! {warning}")
    if options.dry_run:
        _show_packet(packet, port, options)
        return
    with contextlib.closing(Serial(port, options.baud)) as source:
        try:
            say(f"{port}: sending {len(packet.encode())} bytes")
            confirmed = motioncal.send(source, packet)
        except KeyboardInterrupt:
            say(f"! stopped: {motioncal.UNKNOWN_VALUES}; send again, or read the board's output with flinders record")
            raise
    say(f"{port}: {confirmed}")
    if options.as_json:
        sent = {"sent": True, "tries": confirmed.tries, "echo_decimals": confirmed.places}
        print_json({"port": port, **packet.as_dict(), **sent})


def _show_packet(packet: MotionCalPacket, port: str, options: Send) -> None:
    """Print the packet, and the echo that would be expected."""
    from flinders.links import motioncal

    if options.as_json:
        print_json({"port": port, **packet.as_dict(), "sent": False})
        return
    content = packet.encode()
    rows = [content[start : start + 16].hex(" ") for start in range(0, len(content), 16)]
    click.echo("\n".join([f"would send to {port} at {options.baud} baud:", *rows]))
    click.echo("and wait for:\n" + "\n".join(motioncal.echo_lines(packet)))


# vehicles


def _to_vehicle(fit: Fit, link: ByteSource, options: Send) -> None:
    """Set the compass parameters of a vehicle, or show the plan for them."""
    from flinders.apps.vehicles.mavlink import Vehicle
    from flinders.apps.vehicles.mavlink_parameters import TARGETS
    from flinders.core.files import write_text
    from flinders.targets import find

    if options.backup is not None:
        _refuse_backup(options.backup)
    say(f"waiting for a vehicle on {link.name}")
    vehicle = Vehicle.find(link, system=options.system)
    say(f"{vehicle.name}, {'ARMED' if vehicle.armed else 'disarmed'}")
    plan = _plan(fit, vehicle, options)
    if options.dry_run or not plan.pending:
        _show(plan, as_json=options.as_json)
        say(
            "nothing was changed" if plan.pending else f"{vehicle.name} holds these values already: nothing was changed"
        )
        return
    suffix = find(TARGETS[vehicle.autopilot]).suffix
    path = options.backup or f"compass-before-{datetime.now(UTC):%Y%m%dT%H%M%SZ}{suffix}"
    _refuse_backup(path)
    write_text(plan.backup(), path)
    say(f"the previous values are in {path}")
    if not options.as_json:
        click.echo(str(plan))
    _carry_out(plan, path)
    if options.as_json:
        print_json({**plan.as_dict(), "backup": path, "sent": True})
    say(
        f"{vehicle.name}: compass {plan.compass} holds the calibration, all {len(plan.changes)} values read back. "
        "Restart the vehicle, and check a known bearing before it moves"
    )


def _plan(fit: Fit, vehicle: Vehicle, options: Send) -> ParameterPlan:
    """Plan the parameters of the compass given by option or by the log, and print the plan's notes."""
    from flinders.apps.vehicles.sending import parameter_plan

    plan = lossy_if_agreed(
        lambda lossy: parameter_plan(
            vehicle,
            fit,
            compass=options.compass,
            device_id=options.device_id,
            mounting=options.mounting,
            lossy=lossy,
        ),
        lossy=options.lossy,
    )
    for note in plan.notes:
        say(f"! {note}")
    return plan


def _refuse_backup(path: str) -> None:
    """Refuse a backup path that is not a new regular file."""
    from flinders.core.files import refuse_existing

    if path in ("", "-"):
        raise UsageError(f"--backup {path!r}: need the name of a file that stays on the disk")
    try:
        refuse_existing(path)
    except OutputExists:
        raise OutputError(
            f"{path} exists: name another file with --backup, so that earlier values are not overwritten"
        ) from None


def _carry_out(plan: ParameterPlan, path: str) -> None:
    """Set the parameters; if that fails, add the path of the backup to the error."""
    with catch_stop_signals(patient=True) as stopped:
        try:
            plan.carry_out(stopped=stopped, say=say)
        except NotConfirmed as error:
            message = f"{error.message}. The previous values are in {path}"
            if not stopped():
                raise NotConfirmed(message) from None
            say(f"error: {message}")
            raise click.Abort from None


def _show(plan: ParameterPlan, *, as_json: bool) -> None:
    """Print each parameter of a plan before and after, without setting it."""
    if as_json:
        print_json({**plan.as_dict(), "backup": None, "sent": False})
        return
    click.echo(str(plan))
    if plan.pending:
        click.echo(f"{count_text(len(plan.pending), 'value')} would change")
