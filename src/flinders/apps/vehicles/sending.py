"""Makes the packet for a board, or the parameter plan for a vehicle, from a fit; other modules send them.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> fit = calibrate.fit(simulate.tumble(seed=1).samples)
>>> packet = board_packet(fit)
>>> len(packet.packet.encode()), [warning.partition(",")[0] for warning in packet.warnings]
(68, ['the packet also sets the offsets of accelerometer and gyroscope'])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from flinders.apps.vehicles.mavlink_parameters import TARGETS, ParameterPlan
from flinders.fitting.export import known_numbers, mounting_of, only_number, refuse_on_top, refuse_unfit
from flinders.targets import ExportOptions, find
from flinders.targets.motioncal import MotionCalPacket

if TYPE_CHECKING:
    from flinders.apps.vehicles.mavlink import Vehicle
    from flinders.fitting.result import Fit


@dataclass(frozen=True, slots=True)
class BoardPacket:
    """The packet that MotionCal sends to a board."""

    packet: MotionCalPacket
    warnings: tuple[str, ...]  #: warnings for the user, a sentence each


def board_packet(fit: Fit, *, lossy: bool = False) -> BoardPacket:
    """Make the packet of a fit; `flinders.links.motioncal.send` sends it.

    Raises
    ------
    NotExportable
        For a refused fit, or a loss of more than 0.5° of heading without `lossy`.
    UnitError
        For a calibration in counts.
    """
    refuse_unfit(fit)
    export = find("motioncal").render(fit.calibration, asked=ExportOptions(lossy=lossy))
    axes = fit.calibration.axes
    warnings = (
        *export.warnings,
        *[f"it acts in the sensor's own axes: go on mapping them to {axes} afterwards"] * (not axes.is_identity),
        "the packet also sets the offsets of accelerometer and gyroscope, to 0, as MotionCal does",
    )
    return BoardPacket(MotionCalPacket.of(fit.calibration), warnings)


def parameter_plan(
    vehicle: Vehicle,
    fit: Fit,
    *,
    compass: int | None = None,
    device_id: int | None = None,
    mounting: str | None = None,
    lossy: bool = False,
) -> ParameterPlan:
    """Plan the parameters of a vehicle's compass; `ParameterPlan.carry_out` sets them.

    Parameters
    ----------
    vehicle : Vehicle
        Vehicle on its link, from `Vehicle.find`.
    fit : Fit
    compass, device_id : int, optional
        Compass as in `ParameterPlan.of`; by default the compass of the fit's logs.
    mounting : str, optional
        Mounting of the compass during the recording, in the autopilot's notation; by default from the logs.
    lossy : bool
        Accept parameters that lose more than 0.5° of heading.

    Raises
    ------
    NotExportable
        For a refused fit, for readings that were corrected on board, and as `ParameterPlan.of`.
    UsageError
        For a fit of several compasses, or for a mounting unknown to the autopilot.
    NotSent, UnitError, LinkError
        As `ParameterPlan.of`.
    """
    target = TARGETS[vehicle.autopilot]
    refuse_unfit(fit)
    refuse_on_top(fit, "the vehicle")
    matrix = mounting_of(fit, find(target), mounting)
    if device_id is None:
        known = known_numbers(fit, target, "device_id")
        device_id = only_number(fit, known, "the compasses with device id", "device_id")
    if device_id is None and compass is None:
        compass = only_number(fit, known_numbers(fit, target, "compass"), "compass", "compass")
    return ParameterPlan.of(
        vehicle, fit.calibration, compass=compass, device_id=device_id, mounting=matrix, lossy=lossy
    )
