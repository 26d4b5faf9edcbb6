"""``flinders simulate three-axis``: simulate a three-axis sensor in motion, with disturbances."""

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

from flinders.cli._simulation import Simulation, numbers_type, size_option

MOTIONS: Final = {
    "hand": "tumbled by hand for a minute, smooth in time",
    "eight": "waved in figures of eight for a minute, as phones ask for",
    "uniform": "1,000 directions, evenly spread: the best possible",
    "tilted": "all headings in random order, tilted by up to 35°: a vehicle",
    "level": "all headings in random order, level: a robot on a floor",
    "drive": "through bends and over hills for five minutes, up to 6° of tilt",
    "flight": "banked turns, climbs and descents for five minutes, up to 35°",
    "swayed": "all headings in a minute, leaning by up to 35° to all sides",
    "wobble": "to and fro about each axis for ten seconds, up to 30°",
    "rocked": "sines in roll (5°), pitch (45°) and heading (360°): ten minutes",
    "sweeps": "around in the plane xy, then in yz, then in zx: a minute",
    "sweep-xy": "around in the plane xy only: half a minute",
    "sweep-yz": "around in the plane yz only",
    "sweep-zx": "around in the plane zx only",
    "hemisphere": "half of all directions: never upside down",
    "clumped": "all directions, but held still most of the time",
}
"""Copy of the names in `flinders.simulate.MOTIONS`, so that help needs no NumPy; a test compares the two."""

DEFAULT_SOFT_IRON, DEFAULT_HARD_IRON_UT, DEFAULT_NOISE_UT = 0.25, 100.0, 0.5
"""Defaults of a simulated sensor: soft iron as a fraction of 1, hard iron and noise in µT."""


def _share(name: str, words: str) -> program.Field:
    """An option whose value is a fraction of the readings."""
    share = program.number_within(0, 1, "a share of the readings, 0 to 1", zero=True)
    return program.member(name, type=share, default=0.0, metavar="SHARE", help=words)


class ThreeAxis(Simulation):
    """A three-axis sensor, its motion and its disturbances."""

    motion: str = program.member(
        "--motion", type=click.Choice(tuple(MOTIONS)), default="hand", show_default=True, metavar="NAME",
        help="Motion of the sensor; see below.",
    )  # fmt: skip
    n: int | None = program.member(
        "--readings", type=click.IntRange(min=1), metavar="N", help="Number of readings [default: the motion's own]."
    )
    rate_hz: float = program.member(
        "--rate", type=program.positive, default=50.0, show_default=True, metavar="HZ", help="Readings per second."
    )
    tilt_deg: float | None = program.member(
        "--tilt", type=program.number_within(0, 90, "degrees from 0 to 90", zero=True), metavar="DEG",
        help="Largest tilt, for the motions tilted, drive and flight.",
    )  # fmt: skip
    sensor: str | None = program.member(
        "--sensor", metavar="TRUTH", help="Use the sensor of another simulated recording, from its truth."
    )
    soft_iron: float | None = program.member(
        "--soft-iron", type=program.number_within(0, 0.45, "a share from 0 to 0.45", zero=True), metavar="SHARE",
        help=f"Scale factors are drawn from 1 ± SHARE [default: {DEFAULT_SOFT_IRON:g}].",
    )  # fmt: skip
    hard_iron: float | None = size_option(
        "--hard-iron", f"Offsets are drawn within ± this, in µT [default: {DEFAULT_HARD_IRON_UT:g}]."
    )
    noise: float | None = size_option("--noise", f"White noise in µT, 1 σ per axis [default: {DEFAULT_NOISE_UT:g}].")
    resolution: float | None = program.member(
        "--resolution", type=program.positive, metavar="UT", help="Step of the converter in µT."
    )
    saturation: float | None = program.member(
        "--saturation", type=program.positive, metavar="UT", help="Where each axis saturates, in µT."
    )
    outliers: float = _share("--outliers", "Share of readings that are outliers.")
    stationary: float = _share("--stationary", "Share of readings without motion, in clumps.")
    motor: float | None = size_option("--motor", "Field of motors, in µT per ampere; adds a column of their current.")
    drift: float | None = size_option("--drift", "Drift of the offset, in µT per kelvin; adds the temperature column.")
    step: float | None = size_option("--step", "Step of the offset half way, in µT, as after a change of the vehicle.")
    field_step: float | None = program.member(
        "--field-step", type=program.number_within(-0.99, 10.0, "a share from -0.99 to 10, such as -0.1"),
        metavar="SHARE", help="Relative change of the earth's field from half way on.",
    )  # fmt: skip
    magnet: float | None = size_option("--magnet", "Peak field in µT of a magnet that passes after a third.")
    gyro_bias: tuple[float, ...] | None = program.member(
        "--gyro-bias", type=numbers_type(3, "three numbers, such as 0.01,0,-0.02"), metavar="X,Y,Z",
        help="Bias of the gyro, in rad/s.",
    )  # fmt: skip
    magnetometer_only: bool = program.flag("--magnetometer-only", "Leave out acceleration and rate.")

    def simulate_recording(self) -> Simulated:
        """Simulate the recording with all options."""
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
        """Draw a random sensor as `tumble` does, or take the sensor of another recording's truth."""
        from dataclasses import replace

        import numpy as np

        from flinders.simulate import Sensor
        from flinders.simulate.truth import read

        iron = {"--soft-iron": self.soft_iron, "--hard-iron": self.hard_iron}
        given = {"noise": self.noise, "resolution": self.resolution, "saturation": self.saturation}
        typed: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        if self.sensor is not None:
            if drawn := [word for word, value in iron.items() if value is not None]:
                raise UsageError(f"--sensor already states soft and hard iron: leave {' and '.join(drawn)} out")
            return replace(read(self.sensor).as_sensor(), **typed)
        soft = DEFAULT_SOFT_IRON if self.soft_iron is None else self.soft_iron
        hard = DEFAULT_HARD_IRON_UT if self.hard_iron is None else self.hard_iron
        stream = np.random.default_rng(self.seed).spawn(1)[0]
        return Sensor.random(stream, soft=soft, hard=hard, **{"noise": DEFAULT_NOISE_UT, **typed})


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
    """Simulate a three-axis sensor in motion, with disturbances.

    The directions of --motor, --drift, --step and --magnet are drawn from the seed. Columns are time, magnetic field
    and, for motions that have them, acceleration (specific force: level, −9.81 on z) and angular rate.
    """
    from flinders.simulate.truth import Truth

    options.check([options.sensor] if options.sensor else [], as_json=options.as_json)
    simulated = options.simulate_recording()
    options.write(simulated, bare=options.magnetometer_only)
    if options.as_json:
        files = {"recording_file": options.output, "truth_file": options.truth_path}
        print_json({**files, **Truth.of(simulated).as_dict()})
    return GOOD
