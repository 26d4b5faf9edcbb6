"""``flinders simulate``: recordings with a known truth, of three axes in motion or of two that are swung."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli import _options
from flinders.cli._options import old_option as option
from flinders.cli._output import Outputs, print_json, say, show
from flinders.cli._program import GOOD, REFUSED
from flinders.errors import FitError, UsageError, counted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from flinders.simulate import Perturbation, Sensor, Simulated
    from flinders.simulate.two_axis import TwoAxis

MOTIONS: Final = {
    "hand": "tumbled by hand for a minute, smooth in time",
    "eight": "waved in figures of eight for a minute, as phones ask for",
    "uniform": "1,000 directions, all alike: the best there is",
    "tilted": "all headings in no order, tilted by up to 35°: a vehicle",
    "level": "all headings in no order, level: a boat, a robot on a floor",
    "drive": "through bends and over hills for five minutes, 6° at most",
    "flight": "banked turns, climbs and descents for five minutes, 35° at most",
    "swayed": "all headings in a minute, leaning by up to 35° to all sides",
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
        try:
            parts = tuple(float(part) for part in (value if isinstance(value, tuple) else str(value).split(",")))
        except ValueError:
            parts = ()
        if len(parts) != count or not all(map(math.isfinite, parts)):
            raise click.BadParameter(f"{str(value)!r}: need {what}")
        return parts

    return numbers


size = _options.within(0, sys.float_info.max, "0 or a number above it", zero=True)
share = _options.within(0, 1, "a share of the readings, 0 to 1", zero=True)


def _shared(where: str) -> Callable[[_options.Function], _options.Function]:
    """Where a recording goes, which is said in a few words, and what both kinds have."""

    def shared(function: _options.Function) -> _options.Function:
        for each in (
            _options.old_as_json,
            option(
                "--force", heading=_options.OUTPUT, is_flag=True, help="Overwrite the files if they exist."
            ),
            option(
                "--truth", heading=_options.OUTPUT, metavar="FILE",
                help="Where to write the truth [default: the recording's name, .truth.json].",
            ),
            option("-o", "--output", heading=_options.OUTPUT, default="-", metavar="FILE", help=where),
            option(
                "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Another seed, other numbers."
            ),
            _options.old_dip("Inclination of the field.", 60.0),
            _options.old_field_strength("Strength of the field in µT.", default=50.0, show_default=True, metavar="UT"),
        ):  # fmt: skip
            function = each(function)
        return function

    return shared


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


@command.command(
    "three-axis",
    cls=_options.Command,
    common=("output", "motion", "n", "noise", "seed"),
    headings={
        "Motion": ("rate_hz", "tilt_deg", "stationary"),
        "Sensor": ("sensor", "soft_iron", "hard_iron", "resolution", "limit", "gyro_bias", "magnetometer_only"),
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
@option(
    "--motion", type=click.Choice(tuple(MOTIONS)), default="hand", show_default=True, metavar="NAME",
    help="How the sensor is moved; see below.",
)  # fmt: skip
@option("--readings", "n", type=click.IntRange(min=1), metavar="N", help="How many [default: the motion's own].")
@option(
    "--rate",
    "rate_hz",
    type=_options.positive,
    default=50.0,
    show_default=True,
    metavar="HZ",
    help="Readings a second.",
)
@option(
    "--tilt", "tilt_deg", type=_options.within(0, 90, "degrees from 0 to 90", zero=True), metavar="DEG",
    help="Greatest tilt of tilted, drive and flight.",
)  # fmt: skip
@option("--sensor", metavar="TRUTH", help="The sensor of another simulated recording: its truth.")
@option(
    "--soft-iron", type=_options.within(0, 0.45, "a share from 0 to 0.45", zero=True), metavar="SHARE",
    help=f"Scales are drawn within ± this of 1 [default: {SOFT:g}].",
)  # fmt: skip
@option("--hard-iron", type=size, metavar="UT", help=f"Offsets are drawn within ± this in µT [default: {HARD:g}].")
@option("--noise", type=size, metavar="UT", help=f"White noise in µT, 1 σ per axis [default: {NOISE:g}].")
@option("--resolution", type=_options.positive, metavar="UT", help="Step of the converter in µT.")
@option(
    "--saturation", "limit", was=("--limit",), type=_options.positive, metavar="UT",
    help="Where each axis saturates, in µT.",
)  # fmt: skip
@option("--outliers", type=share, default=0.0, metavar="SHARE", help="Share of readings that are outliers.")
@option(
    "--stationary", was=("--held",), type=share, default=0.0, metavar="SHARE",
    help="Share of readings in clumps: the sensor is not moved.",
)  # fmt: skip
@option("--motor", type=size, metavar="UT", help="Field of motors, in µT per ampere; adds their current.")
@option("--drift", type=size, metavar="UT", help="Drift of the offset, in µT per kelvin; adds the temperature.")
@option("--step", type=size, metavar="UT", help="Step of the offset half way: something was moved.")
@option(
    "--field-step", type=_options.within(-0.99, 10.0, "a share from -0.99 to 10, such as -0.1"), metavar="SHARE",
    help="From half way on the earth's field is stronger by this share.",
)  # fmt: skip
@option("--magnet", type=size, metavar="UT", help="A magnet passes after a third, so strong at its peak.")
@option(
    "--gyro-bias", type=_several(3, "three numbers, such as 0.01,0,-0.02"), metavar="X,Y,Z",
    help="What the gyro reads at rest, in rad/s.",
)  # fmt: skip
@option("--magnetometer-only", is_flag=True, help="Leave out acceleration and rate.")
@_shared("Where to write the recording [default: standard output].")
def three_axis(
    output: str, truth: str | None, *, force: bool, as_json: bool, magnetometer_only: bool, **options: Any
) -> int:
    """Simulate a three-axis sensor in motion, and whatever disturbs it.

    Directions of what --motor, --drift, --step and --magnet add are drawn from the seed. Columns: time, magnetic
    field, and acceleration (specific force: level, −9.81 on z) and angular rate where the motion has them.
    """
    _check(output, truth, options["sensor"], force=force, as_json=as_json)
    simulated = _tumbled(options)
    _write(simulated, output, truth, force=force, bare=magnetometer_only)
    if as_json:
        _print_truth(simulated, output, truth)
    return GOOD


@command.command(
    "two-axis",
    cls=_options.Command,
    common=("output", "points", "noise", "seed", "polar"),
    headings={"Sensor": ("scale", "offset", "skew_deg")},
    short_help="A two-axis compass, swung around.",
    epilog="""\b
Example:
  flinders simulate two-axis
  flinders simulate two-axis --scale 1.2,0.9 --offset 12,-8 --skew 5
  flinders simulate two-axis -o swing.csv --polar rose.csv
""",
)
@option(
    "--points",
    type=click.IntRange(min=6),
    default=36,
    show_default=True,
    help="Headings, equally spaced from north on.",
)
@option(
    "--scale", type=_several(2, "two numbers, such as 1.1,0.9"), default="1.1,0.9", show_default=True, metavar="X,Y",
    help="Scale of each axis.",
)  # fmt: skip
@option(
    "--offset", type=_several(2, "two numbers, such as 10,-5"), default="10,-5", show_default=True, metavar="X,Y",
    help="Offset of each axis in µT.",
)  # fmt: skip
@option(
    "--skew", "skew_deg", type=_options.within(-89, 89, "degrees from -89 to 89"), default=4.0, show_default=True,
    metavar="DEG", help="By how much the axes are not square.",
)  # fmt: skip
@option("--noise", type=size, default=0.25, show_default=True, metavar="UT", help="White noise in µT, 1 σ per axis.")
@option("--polar", metavar="FILE", help="Also write radius, heading and its error at each point.")
@_shared("Also write the recording, and its truth.")
def two_axis(output: str, truth: str | None, polar: str | None, *, force: bool, as_json: bool, **options: Any) -> int:
    """Swing a two-axis compass around, calibrate it, and show what was found beside what is true.

    Without -o nothing but the table is printed. Where noise or too few points leave no calibration that could be
    used, the table is printed all the same, and the exit code is 4. The recording has a third column that reads
    nothing; calibrate it with flinders two-axis.
    """
    from flinders.report.comparison_pages import of_recovery

    output = "" if output == "-" else output
    if polar and Path(polar).suffix.lower() == ".svg":
        raise UsageError(f"--polar {polar}: a table is written, name it .csv; flinders two-axis --polar draws")
    _check(output, truth, None, polar, force=force, as_json=False)
    swung = _Swung(**options)
    if output:
        _write(swung.simulated, output, truth, force=force, bare=False)
    if polar:
        _write_polar(swung, polar, force=force)
    if as_json:
        print_json(swung.as_dict())
    else:
        show(of_recovery(swung.compass, swung.recovered, swung.polar))
    if swung.refusal is not None:
        say(f"refused: this would be no calibration to use; {swung.refusal}")
        return REFUSED
    return GOOD


class _Swung:
    """A swing, and what a calibration makes of it."""

    def __init__(
        self, *, points: int, scale: tuple[float, float], offset: tuple[float, float], skew_deg: float, noise: float,
        seed: int, field_strength: float, dip_deg: float,
    ) -> None:  # fmt: skip
        import numpy as np

        from flinders.fitting.calibrate import fit
        from flinders.simulate import TwoAxis, swing
        from flinders.simulate.two_axis import Polar

        self.compass = TwoAxis(scale, offset, skew_deg, noise)
        self.simulated = swing(self.compass, seed=seed, points=points, field_strength=field_strength, dip_deg=dip_deg)
        self.refusal: FitError | None = None
        try:
            result = fit(self.simulated.samples, method="level", field_strength=field_strength, dip_deg=dip_deg)
        except FitError as refusal:
            if getattr(refusal, "fit", None) is None:
                raise
            result, self.refusal = refusal.fit, refusal  # type: ignore[attr-defined]
        calibration, dip = result.calibration, math.radians(dip_deg)
        shape = field_strength * np.linalg.inv(calibration.matrix)
        centre = calibration.offset[:2] + math.sin(dip) * shape[:2, 2]
        horizontal = field_strength * math.cos(dip)
        ellipse = math.cos(dip) * shape[:2, :2]
        self.recovered: TwoAxis = TwoAxis.from_ellipse(centre, ellipse, horizontal, noise=result.noise or 0.0)
        self.polar = Polar.of(self.simulated, calibration.matrix, calibration.offset)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        from flinders.report.comparison_pages import recovery_rows

        names = ("scale_x", "scale_y", "offset_x", "offset_y", "skew_deg", "noise")
        pairs = {
            name: {"true": true, "found": estimate}
            for name, (_, true, estimate, _) in zip(names, recovery_rows(self.compass, self.recovered), strict=True)
        }
        verdict = "limited" if self.refusal is None else "refused"
        return {"verdict": verdict, "recovery": pairs, "polar": self.polar.as_dict(), "unit": "uT"}


def _tumbled(options: dict[str, Any]) -> Simulated:
    """Record, with what the options ask for."""
    from flinders.simulate import FieldStep, Imu, MotorCurrent, PassingMagnet, Step, ThermalDrift, tumble

    kinds: dict[str, Callable[[float], Perturbation]] = {
        "motor": MotorCurrent,
        "drift": ThermalDrift,
        "step": Step,
        "field_step": FieldStep,
        "magnet": lambda peak: PassingMagnet(peak, at=1 / 3),
    }
    wanted = {name: options.pop(name) for name in kinds}
    iron = {name: options.pop(name) for name in ("sensor", "soft_iron", "hard_iron", "noise", "resolution", "limit")}
    bias = options.pop("gyro_bias")
    return tumble(
        sensor=_sensor(options["seed"], **iron),
        disturbances=[kinds[name](value) for name, value in wanted.items() if value],
        imu=None if bias is None else Imu(gyro_bias=bias),
        **options,
    )


def _sensor(
    seed: int, *, sensor: str | None, soft_iron: float | None, hard_iron: float | None, noise: float | None,
    resolution: float | None, limit: float | None,
) -> Sensor:  # fmt: skip
    """Draw a sensor as `tumble` would, or take that of another recording.

    Raises
    ------
    UsageError
        Where both are asked for.
    """
    from dataclasses import replace

    import numpy as np

    from flinders.simulate import Sensor
    from flinders.simulate.truth import read

    if sensor is not None:
        drawn = [word for word, value in (("--soft-iron", soft_iron), ("--hard-iron", hard_iron)) if value is not None]
        if drawn:
            raise UsageError(f"--sensor has iron of its own: leave {' and '.join(drawn)} out")
        known = read(sensor).as_sensor()
        given: dict[str, Any] = {"noise": noise, "resolution": resolution, "limit": limit}
        return replace(known, **{name: value for name, value in given.items() if value is not None})
    return Sensor.random(
        np.random.default_rng(seed).spawn(1)[0],
        soft=SOFT if soft_iron is None else soft_iron,
        hard=HARD if hard_iron is None else hard_iron,
        noise=NOISE if noise is None else noise,
        resolution=resolution,
        limit=limit,
    )


def _check(output: str, truth: str | None, sensor: str | None, *others: str | None, force: bool, as_json: bool) -> None:
    """Find what could not be written before anything is simulated.

    Raises
    ------
    UsageError
        Where two results would go to one place.
    OutputError
        Where a file is in the way, or could not be written.
    """
    from flinders.simulate.truth import truth_path

    if "-" in (truth, *others):
        raise UsageError("standard output is for the recording: name a file for --truth and --polar")
    if truth and not output:
        raise UsageError("--truth goes with a recording: name a file for that with -o")
    truth = truth or (truth_path(output) if output not in ("", "-") else None)
    files = ("the recording", output), ("the truth", truth), *(("the table", path) for path in others)
    Outputs.of(*files, force=force, as_json=as_json).check([sensor] if sensor else [])


def _write(simulated: Simulated, output: str, truth: str | None, *, force: bool, bare: bool) -> None:
    """Write the recording, and its truth next to it; say what it is."""
    from dataclasses import replace

    from flinders.simulate.table import lines, write_csv
    from flinders.simulate.truth import Truth, truth_path, write

    samples = replace(simulated.samples, acceleration=None, rate=None) if bare else simulated.samples
    where = truth or (truth_path(output) if output != "-" else None)
    if output == "-":
        sys.stdout.writelines(f"{line}\n" for line in lines(samples))
    else:
        write_csv(samples, output, force=force)
    if where:
        write(Truth.of(simulated), where, force=force)
    say(_summary(simulated))
    if output != "-":
        say(f"the recording is in {output}")
    say(f"the truth is in {where}" if where else "the truth is not kept: name a file with -o or --truth")


def _summary(simulated: Simulated) -> str:
    """Say in a line what was simulated."""
    samples, sensor = simulated.samples, simulated.sensor
    parts = [f"simulated: {counted(len(samples), 'reading')}, {simulated.motion}"]
    if samples.time is not None and simulated.rate_hz:
        parts[0] += f", {len(samples) / simulated.rate_hz:g} s"
    offset = sensor.offset if samples.time is not None else sensor.offset[:2]  # a swing has two axes, and no clock
    parts.append(f"offset {math.hypot(*offset):.3g} µT, {sensor.noise:g} µT of noise")
    if outliers := int(simulated.outliers.sum()):
        parts.append(counted(outliers, "stray"))
    return "; ".join([*parts, *simulated.disturbances])


def _print_truth(simulated: Simulated, output: str, truth: str | None) -> None:
    """Print what is true, and where it is."""
    from flinders.simulate.truth import Truth, truth_path

    print_json({"recording_file": output, "truth_file": truth or truth_path(output), **Truth.of(simulated).as_dict()})


def _write_polar(swung: _Swung, path: str, *, force: bool) -> None:
    """Write a swing in polar coordinates."""
    from flinders.core.files import replacing

    columns: dict[str, Iterable[float]] = swung.polar.as_dict()  # type: ignore[assignment]
    with replacing(path, force=force) as file:
        file.write(",".join(columns) + "\n")
        file.writelines(
            ",".join(f"{round(value, 4) + 0.0:.4f}" for value in row) + "\n"
            for row in zip(*columns.values(), strict=True)
        )
    say(f"polar coordinates are in {path}")
