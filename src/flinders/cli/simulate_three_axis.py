"""``flinders simulate three-axis``: a three-axis sensor in motion, and whatever disturbs it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _program as program
from flinders.cli._output import print_json
from flinders.cli._program import GOOD
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.simulate import Perturbation, Sensor, Simulated

from flinders.cli._simulation import Simulation, several, size_option

MOTIONS: Final = {
    "hand": "tumbled by hand for a minute, smooth in time",
    "eight": "waved in figures of eight for a minute, as phones ask for",
    "uniform": "1,000 directions, all alike: the best there is",
    "tilted": "all headings in no order, tilted by up to 35°: a vehicle",
    "level": "all headings in no order, level: a robot on a floor",
    "drive": "through bends and over hills for five minutes, 6° at most",
    "flight": "banked turns, climbs and descents for five minutes, 35° at most",
    "swayed": "all headings in a minute, leaning by up to 35° to all sides",
    "wobble": "to and fro about each axis for ten seconds, 30° at most",
    "rocked": "sines in roll (5°), pitch (45°) and heading (360°): ten minutes",
    "sweeps": "around in the plane xy, then in yz, then in zx: a minute",
    "sweep-xy": "around in the plane xy alone: half a minute",
    "sweep-yz": "around in the plane yz alone",
    "sweep-zx": "around in the plane zx alone",
    "hemisphere": "half of all directions: never turned over",
    "clumped": "all directions, but held still for most of the time",
}
"""Those of `flinders.simulate.MOTIONS`, so that help needs no NumPy; a test holds the two together."""

SOFT, HARD, NOISE = 0.25, 100.0, 0.5
"""What a sensor has unless someone says otherwise: share of soft iron, µT of hard iron and of noise."""


def _share(name: str, words: str) -> program.Field:
    """An option that takes a share of the readings."""
    share = program.within(0, 1, "a share of the readings, 0 to 1", zero=True)
    return program.member(name, type=share, default=0.0, metavar="SHARE", help=words)


class ThreeAxis(Simulation):
    """A sensor of three axes, how it is moved, and what disturbs it."""

    motion: str = program.member(
        "--motion", type=click.Choice(tuple(MOTIONS)), default="hand", show_default=True, metavar="NAME",
        help="How the sensor is moved; see below.",
    )  # fmt: skip
    n: int | None = program.member(
        "--readings", type=click.IntRange(min=1), metavar="N", help="How many [default: the motion's own]."
    )
    rate_hz: float = program.member(
        "--rate", type=program.positive, default=50.0, show_default=True, metavar="HZ", help="Readings a second."
    )
    tilt_deg: float | None = program.member(
        "--tilt", type=program.within(0, 90, "degrees from 0 to 90", zero=True), metavar="DEG",
        help="Greatest tilt of tilted, drive and flight.",
    )  # fmt: skip
    sensor: str | None = program.member(
        "--sensor", metavar="TRUTH", help="The sensor of another simulated recording: its truth."
    )
    soft_iron: float | None = program.member(
        "--soft-iron", type=program.within(0, 0.45, "a share from 0 to 0.45", zero=True), metavar="SHARE",
        help=f"Scales are drawn within ± this of 1 [default: {SOFT:g}].",
    )  # fmt: skip
    hard_iron: float | None = size_option("--hard-iron", f"Offsets are drawn within ± this in µT [default: {HARD:g}].")
    noise: float | None = size_option("--noise", f"White noise in µT, 1 σ per axis [default: {NOISE:g}].")
    resolution: float | None = program.member(
        "--resolution", type=program.positive, metavar="UT", help="Step of the converter in µT."
    )
    saturation: float | None = program.member(
        "--saturation", type=program.positive, metavar="UT", help="Where each axis saturates, in µT."
    )
    outliers: float = _share("--outliers", "Share of readings that are outliers.")
    stationary: float = _share("--stationary", "Share of readings in clumps: the sensor is not moved.")
    motor: float | None = size_option("--motor", "Field of motors, in µT per ampere; adds their current.")
    drift: float | None = size_option("--drift", "Drift of the offset, in µT per kelvin; adds the temperature.")
    step: float | None = size_option("--step", "Step of the offset half way: something was moved.")
    field_step: float | None = program.member(
        "--field-step", type=program.within(-0.99, 10.0, "a share from -0.99 to 10, such as -0.1"), metavar="SHARE",
        help="From half way on the earth's field is stronger by this share.",
    )  # fmt: skip
    magnet: float | None = size_option("--magnet", "A magnet passes after a third, so strong at its peak.")
    gyro_bias: tuple[float, ...] | None = program.member(
        "--gyro-bias", type=several(3, "three numbers, such as 0.01,0,-0.02"), metavar="X,Y,Z",
        help="What the gyro reads at rest, in rad/s.",
    )  # fmt: skip
    magnetometer_only: bool = program.flag("--magnetometer-only", "Leave out acceleration and rate.")

    def simulated(self) -> Simulated:
        """Record, with what the options ask for."""
        import numpy as np

        from flinders.simulate import FieldStep, Imu, MotorCurrent, PassingMagnet, Step, ThermalDrift, tumble

        kinds: dict[str, Callable[[float], Perturbation]] = {
            "motor": MotorCurrent,
            "drift": ThermalDrift,
            "step": Step,
            "field_step": FieldStep,
            "magnet": lambda peak: PassingMagnet(peak, at=1 / 3),
        }
        return tumble(
            self.seed,
            motion=self.motion,
            n=self.n,
            rate_hz=self.rate_hz,
            tilt_deg=self.tilt_deg,
            stationary=self.stationary,
            sensor=self.simulated_sensor(),
            field_strength=self.field_strength,
            dip_deg=self.dip_deg,
            outliers=self.outliers,
            disturbances=[kind(value) for name, kind in kinds.items() if (value := getattr(self, name))],
            imu=None if self.gyro_bias is None else Imu(gyro_bias=np.array(self.gyro_bias)),
        )

    def simulated_sensor(self) -> Sensor:
        """Draw a sensor as `tumble` would, or take that of another recording."""
        from dataclasses import replace

        import numpy as np

        from flinders.simulate import Sensor
        from flinders.simulate.truth import read

        iron = {"--soft-iron": self.soft_iron, "--hard-iron": self.hard_iron}
        given = {"noise": self.noise, "resolution": self.resolution, "saturation": self.saturation}
        typed: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        if self.sensor is not None:
            if drawn := [word for word, value in iron.items() if value is not None]:
                raise UsageError(f"--sensor has iron of its own: leave {' and '.join(drawn)} out")
            return replace(read(self.sensor).as_sensor(), **typed)
        soft = SOFT if self.soft_iron is None else self.soft_iron
        hard = HARD if self.hard_iron is None else self.hard_iron
        stream = np.random.default_rng(self.seed).spawn(1)[0]
        return Sensor.random(stream, soft=soft, hard=hard, **{"noise": NOISE, **typed})


@program.command_of(
    "three-axis",
    ThreeAxis,
    common=("output", "motion", "n", "noise", "seed"),
    headings={
        "Motion": ("rate_hz", "tilt_deg", "stationary"),
        "Sensor": ("sensor", "soft_iron", "hard_iron", "resolution", "saturation", "gyro_bias", "magnetometer_only"),
        "Disturbances": ("outliers", "motor", "drift", "step", "field_step", "magnet"),
    },
    epilog="\b\nMotions:\n"
    + "\n".join(f"  {name:<12}{words}" for name, words in MOTIONS.items())
    + """\n\n\b
Example:
  flinders simulate three-axis -o tumble.csv
  flinders simulate three-axis -o drive.csv --motion drive --motor 0.2 --seed 7
  flinders simulate three-axis -o again.csv --sensor tumble.truth.json --seed 2
  flinders simulate three-axis | flinders calibrate - -o calibration.json
""",
)
def command(options: ThreeAxis) -> int:
    """Simulate a three-axis sensor in motion, and whatever disturbs it.

    Directions of what --motor, --drift, --step and --magnet add are drawn from the seed. Columns: time, magnetic
    field, and acceleration (specific force: level, −9.81 on z) and angular rate where the motion has them.
    """
    from flinders.simulate.truth import Truth

    options.check([options.sensor] if options.sensor else [], as_json=options.as_json)
    simulated = options.simulated()
    options.write(simulated, bare=options.magnetometer_only)
    if options.as_json:
        files = {"recording_file": options.output, "truth_file": options.truth_path}
        print_json({**files, **Truth.of(simulated).as_dict()})
    return GOOD
