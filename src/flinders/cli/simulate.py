"""``flinders simulate``: recordings with a known truth, of three axes in motion or of two that are swung."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import Outputs, error_words, print_json, print_result, say
from flinders.cli._program import GOOD, REFUSED
from flinders.errors import UsageError, counted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from flinders.comparison.evaluation import Recovery
    from flinders.simulate import Perturbation, Sensor, Simulated

MOTIONS: Final = {
    "hand": "tumbled by hand for a minute, smooth in time",
    "eight": "waved in figures of eight for a minute, as phones ask for",
    "uniform": "1,000 directions, all alike: the best there is",
    "tilted": "all headings in no order, tilted by up to 35°: a vehicle",
    "level": "all headings in no order, level: a boat, a robot on a floor",
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


def _several(count: int, what: str) -> Callable[[object], tuple[float, ...]]:
    """Make the type of an option that takes so many finite numbers with commas between them."""

    def numbers(value: object) -> tuple[float, ...]:
        parts = value if isinstance(value, tuple) else tuple(program.numbers_of(str(value)))
        if len(parts) != count:
            raise click.BadParameter(f"{str(value)!r}: need {what}")
        return parts

    return numbers


def _size(name: str, words: str, **more: Any) -> program.Field:
    """An option that takes µT."""
    size = program.within(0, sys.float_info.max, "0 or a number above it", zero=True)
    return program.member(name, type=size, metavar="UT", help=words, **more)


def _share(name: str, words: str) -> program.Field:
    """An option that takes a share of the readings."""
    share = program.within(0, 1, "a share of the readings, 0 to 1", zero=True)
    return program.member(name, type=share, default=0.0, metavar="SHARE", help=words)


class Simulation(program.Group):
    """The field, the seed, and where the recording and its truth go."""

    field_strength: float = option.field_strength(
        "Strength of the field in µT.", default=50.0, show_default=True, metavar="UT"
    )
    dip_deg: float = option.dip("Inclination of the field.", 60.0)
    seed: int = program.member(
        "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Another seed, other numbers."
    )
    output: str = option.output(
        "the recording", "Where to write the recording [default: standard output].", default="-", heading=program.OUTPUT
    )
    truth: str | None = program.member(
        "--truth", heading=program.OUTPUT, metavar="FILE",
        help="Where to write the truth [default: the recording's name, .truth.json].",
    )  # fmt: skip
    force: bool = option.force("Overwrite the files if they exist.")
    as_json: bool = option.as_json()

    @property
    def truth_path(self) -> str | None:
        """Where the truth goes."""
        from flinders.simulate.truth import truth_path

        return self.truth or (truth_path(self.output) if self.output not in ("", "-") else None)

    def check(self, inputs: Iterable[str] = (), *others: str | None, as_json: bool = False) -> None:
        """Find what could not be written before anything is simulated."""
        if "-" in (self.truth, *others):
            raise UsageError("standard output is for the recording: name a file for --truth and --polar")
        if self.truth and not self.output:
            raise UsageError("--truth goes with a recording: name a file for that with -o")
        files = (
            ("the recording", self.output),
            ("the truth", self.truth_path),
            *(("the table", path) for path in others),
        )
        Outputs.of(*files, force=self.force, as_json=as_json).check(inputs)

    def write(self, simulated: Simulated, *, bare: bool = False) -> None:
        """Write the recording, `bare` with the magnetic field alone, and its truth next to it; say what it is."""
        from dataclasses import replace

        from flinders.simulate.recording import lines, write_csv
        from flinders.simulate.truth import Truth, write

        samples = replace(simulated.samples, acceleration=None, rate=None) if bare else simulated.samples
        if self.output == "-":
            sys.stdout.writelines(f"{line}\n" for line in lines(samples))
        else:
            write_csv(samples, self.output, force=self.force)
        where = self.truth_path
        if where:
            write(Truth.of(simulated), where, force=self.force)
        say(_summary(simulated))
        if self.output != "-":
            say(f"the recording is in {self.output}")
        say(f"the truth is in {where}" if where else "the truth is not kept: name a file with -o or --truth")


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
    hard_iron: float | None = _size("--hard-iron", f"Offsets are drawn within ± this in µT [default: {HARD:g}].")
    noise: float | None = _size("--noise", f"White noise in µT, 1 σ per axis [default: {NOISE:g}].")
    resolution: float | None = program.member(
        "--resolution", type=program.positive, metavar="UT", help="Step of the converter in µT."
    )
    saturation: float | None = program.member(
        "--saturation", type=program.positive, metavar="UT", help="Where each axis saturates, in µT."
    )
    outliers: float = _share("--outliers", "Share of readings that are outliers.")
    stationary: float = _share("--stationary", "Share of readings in clumps: the sensor is not moved.")
    motor: float | None = _size("--motor", "Field of motors, in µT per ampere; adds their current.")
    drift: float | None = _size("--drift", "Drift of the offset, in µT per kelvin; adds the temperature.")
    step: float | None = _size("--step", "Step of the offset half way: something was moved.")
    field_step: float | None = program.member(
        "--field-step", type=program.within(-0.99, 10.0, "a share from -0.99 to 10, such as -0.1"), metavar="SHARE",
        help="From half way on the earth's field is stronger by this share.",
    )  # fmt: skip
    magnet: float | None = _size("--magnet", "A magnet passes after a third, so strong at its peak.")
    gyro_bias: tuple[float, ...] | None = program.member(
        "--gyro-bias", type=_several(3, "three numbers, such as 0.01,0,-0.02"), metavar="X,Y,Z",
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


class TwoAxis(Simulation):
    """A compass of two axes, and where its swing goes."""

    output: str = option.output(
        "the recording",
        "Also write the recording, and its truth.",
        default="",
        heading=program.OUTPUT,
        type=lambda path: "" if path == "-" else path,
    )
    points: int = program.member(
        "--points", type=click.IntRange(min=6), default=36, show_default=True,
        help="Headings, equally spaced from north on.",
    )  # fmt: skip
    scale: tuple[float, float] = program.member(
        "--scale", type=_several(2, "two numbers, such as 1.1,0.9"), default="1.1,0.9", show_default=True,
        metavar="X,Y", help="Scale of each axis.",
    )  # fmt: skip
    offset: tuple[float, float] = program.member(
        "--offset", type=_several(2, "two numbers, such as 10,-5"), default="10,-5", show_default=True, metavar="X,Y",
        help="Offset of each axis in µT.",
    )  # fmt: skip
    skew_deg: float = program.member(
        "--skew", type=program.within(-89, 89, "degrees from -89 to 89"), default=4.0, show_default=True,
        metavar="DEG", help="By how much the axes are not square.",
    )  # fmt: skip
    noise: float = _size("--noise", "White noise in µT, 1 σ per axis.", default=0.25, show_default=True)
    polar: str | None = program.member(
        "--polar",
        metavar="FILE",
        help="Also write radius, heading and its error at each point (FILE.csv), or draw the points (FILE.svg).",
    )


class CalibrationFlight(program.Group):
    """An aircraft, what it flies, and where the recording goes."""

    output: str = option.output(
        "the recording", "Where to write the recording [default: standard output].", default="-"
    )
    aircraft: int = program.member(
        "--aircraft", type=click.IntRange(min=0), default=1, show_default=True, metavar="N",
        help="Another number, another aircraft with its magnetometers.",
    )  # fmt: skip
    headings: str = program.member(
        "--headings", metavar="DEG,…", default="0,90,180,270", show_default=True, help="Flown one after the other."
    )
    seed: int = program.same_as(Simulation, "seed")
    force: bool = option.force()
    as_json: bool = option.as_json()


@click.group(
    "simulate",
    short_help="Simulate a recording whose truth is known.",
    epilog="""\b
Example:
  flinders simulate three-axis -o tumble.csv --motion hand --seed 1
  flinders calibrate tumble.csv -o calibration.json
  flinders evaluate calibration.json tumble.truth.json
  flinders simulate two-axis -o swing.csv --skew 5 --json
""",
)
def command() -> None:
    """Simulate a recording of a sensor with hard and soft iron, and keep what is true of it beside it.

    The recording is CSV as a logger writes it. What is true (sensor, field, motion, seed) goes into a file of its
    own, which `flinders evaluate` holds a calibration against. The same seed gives the same bytes.
    """


@program.command_of(
    "three-axis",
    ThreeAxis,
    command,
    common=("output", "motion", "n", "noise", "seed"),
    headings={
        "Motion": ("rate_hz", "tilt_deg", "stationary"),
        "Sensor": ("sensor", "soft_iron", "hard_iron", "resolution", "saturation", "gyro_bias", "magnetometer_only"),
        "Disturbances": ("outliers", "motor", "drift", "step", "field_step", "magnet"),
    },
    short_help="A three-axis sensor in motion.",
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
def three_axis(options: ThreeAxis) -> int:
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


@program.command_of(
    "two-axis",
    TwoAxis,
    command,
    common=("output", "points", "noise", "seed", "polar"),
    headings={"Sensor": ("scale", "offset", "skew_deg")},
    short_help="A two-axis compass, swung around.",
    epilog="""\b
Example:
  flinders simulate two-axis
  flinders simulate two-axis --scale 1.2,0.9 --offset 12,-8 --skew 5
  flinders simulate two-axis -o swing.csv --polar rose.svg
""",
)
def two_axis(options: TwoAxis) -> int:
    """Swing a two-axis compass around, calibrate it, and show what was found beside what is true.

    Without -o nothing but the table is printed. Where noise or too few points leave no calibration that could be
    used, the table is printed all the same, and the exit code is 4. The recording has a third column that reads
    nothing; calibrate it with flinders two-axis.
    """
    from flinders.comparison.evaluation import recover
    from flinders.report.comparison_pages import of_recovery
    from flinders.simulate import TwoAxis as Compass

    options.check((), options.polar)
    recovery = recover(
        Compass(options.scale, options.offset, options.skew_deg, options.noise),
        seed=options.seed,
        points=options.points,
        field_strength=options.field_strength,
        dip_deg=options.dip_deg,
    )
    if options.output:
        options.write(recovery.swung)
    if options.polar:
        _write_polar(recovery, options.polar, force=options.force)
    print_result(
        recovery.as_dict,
        lambda: of_recovery(recovery.true, recovery.estimate, recovery.polar, recovery.turn),
        as_json=options.as_json,
    )
    if recovery.refusal is not None:
        say(f"refused: this would be no calibration to use; {error_words(recovery.refusal)}")
        return REFUSED
    return GOOD


@program.command_of(
    "aircraft",
    CalibrationFlight,
    command,
    short_help="An aircraft with a scalar magnetometer, on a calibration flight.",
    epilog="""\b
Example:
  flinders simulate aircraft -o box.csv
  flinders simulate aircraft -o lines.csv --headings 45,225 --seed 2
""",
)
def aircraft(options: CalibrationFlight) -> int:
    """Fly rolls of 10°, pitches and yaws of 5° on several headings, in an aircraft with a field of its own.

    Columns: time, vector magnetometer in the axes of the aircraft, and the scalar magnetometer as a reference strength.
    """
    import numpy as np

    from flinders.simulate import Aircraft, calibration_flight, fluxgate
    from flinders.simulate.recording import lines

    outputs = options.checked_outputs()
    headings = program.numbers_of(options.headings)
    if not headings:
        raise UsageError(f"--headings {options.headings!r}: need degrees, such as 0,90,180,270")
    built = np.random.default_rng(options.aircraft)
    flight = calibration_flight(
        options.seed, headings_deg=headings, aircraft=Aircraft.random(built), vector=fluxgate(built)
    )
    outputs.write("".join(f"{line}\n" for line in lines(flight.samples)), options.output)
    outputs.say_written()
    if options.as_json:
        print_json(flight.as_dict())
    return GOOD


def _summary(simulated: Simulated) -> str:
    """Say in a line what was simulated."""
    samples, sensor = simulated.samples, simulated.sensor
    parts = [f"simulated: {counted(len(samples), 'reading')}, {simulated.motion}"]
    if samples.time is not None and simulated.rate_hz:
        parts[0] += f", {len(samples) / simulated.rate_hz:g} s"
    offset = sensor.offset if samples.time is not None else sensor.offset[:2]  # a swing has two axes, and no clock
    parts.append(f"offset {math.hypot(*offset):.3g} µT, {sensor.noise:g} µT of noise")
    if outliers := int(simulated.outliers.sum()):
        parts.append(counted(outliers, "outlier"))
    return "; ".join([*parts, *simulated.disturbances])


def _write_polar(recovery: Recovery, path: str, *, force: bool) -> None:
    """Draw a swing, or write it in polar coordinates."""
    from flinders.core.files import replacing, write_text
    from flinders.report.drawings import turn_drawing

    if Path(path).suffix.lower() == ".svg":
        write_text(turn_drawing(recovery.turn, recovery.fit), path, force=force)
        say(f"drawn in {path}")
        return
    columns = recovery.polar.as_dict()
    with replacing(path, force=force) as file:
        file.write(",".join(columns) + "\n")
        file.writelines(
            ",".join(f"{round(value, 4) + 0.0:.4f}" for value in row) + "\n"
            for row in zip(*columns.values(), strict=True)
        )
    say(f"polar coordinates are in {path}")
