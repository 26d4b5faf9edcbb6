"""Options of ``flinders calibrate``: what is written, the method, the sensors, the site, and what else was recorded."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import click

from flinders.cli._inputs import site_of
from flinders.cli._options import AIDING, METHOD, OUTPUT, RECORDING, SITE, Group, member, positive, within
from flinders.cli._output import Outputs
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

ALL: Final = "all"
"""``--sensor`` for each magnetometer of a log or table."""


def _prior(value: str) -> float | str:
    """Read the value of ``--prior``: a number, or none, which `None` cannot say, as that is "not given"."""
    number = within(0, 100, "a number above 0, up to 100, such as 0.3; or none")
    return "none" if value.strip().casefold() == "none" else number(value)


class OutputOptions(Group):
    """What is written where."""

    output: str | None = member(
        "-o", "--output", heading=OUTPUT, metavar="FILE",
        help="Calibration file to write, or - for standard output; without it nothing is written.",
    )  # fmt: skip
    report: str | None = member(
        "--report", heading=OUTPUT, metavar="FILE.html", help="Also write a report with figures, in one HTML file."
    )
    report_text: str | None = member(
        "--report-text", heading=OUTPUT, metavar="FILE",
        help="Also write a page of plain words for those who will use the compass, or - for standard output.",
    )  # fmt: skip
    exported: tuple[str, ...] = member(
        "--export", heading=OUTPUT, multiple=True, metavar="TARGET[:FILE]",
        help="Also write it for one of `flinders targets` [FILE: the target's name with its ending]; may be given "
        "several times.",
    )  # fmt: skip
    convergence: str | None = member(
        "--convergence", heading=OUTPUT, metavar="FILE",
        help="Also draw (FILE.svg) or list (FILE.csv) how the estimate converges, for methods that can be watched.",
    )  # fmt: skip
    plots: bool = member("--plot/--no-plot", heading=OUTPUT, default=True, help="Draw the readings, on a terminal.")
    force: bool = member("--force", heading=OUTPUT, is_flag=True, help="Overwrite the output file if it exists.")
    as_json: bool = member("--json", heading=OUTPUT, is_flag=True, help="Print the result as JSON on standard output.")

    @property
    def exports(self) -> tuple[tuple[str, str], ...]:
        """Target and file of each export."""
        if not self.exported:
            return ()
        from flinders.cli.export import named

        return named(self.exported)

    @property
    def outputs(self) -> Outputs:
        """All files, by what they are called in a message."""
        return Outputs.of(
            ("the calibration", self.output),
            ("the HTML report", self.report, "--report"),
            ("the report", self.report_text, "--report-text"),
            ("the convergence", self.convergence, "--convergence"),
            *((f"the export to {target}", path, "--export TARGET:FILE") for target, path in self.exports),
            force=self.force,
            as_json=self.as_json,
        )

    @property
    def of_one_sensor(self) -> dict[str, str | None]:
        """Files that there are of one magnetometer alone, by their options."""
        return {
            "--report": self.report,
            "--report-text": self.report_text,
            "--convergence": self.convergence,
            "--export": ", ".join(self.exported) or None,
        }


class Estimation(Group):
    """The method of estimation and its options."""

    method: str = member(
        "--method", heading=METHOD, default="auto", show_default=True, metavar="NAME", help="One of `flinders methods`."
    )
    method_options: tuple[str, ...] = member(
        "--option", heading=METHOD, multiple=True, metavar="NAME=VALUE",
        help="An option of the method, as `flinders methods` lists them; may be given several times.",
    )  # fmt: skip
    minmax: str | None = member(
        "--minmax", heading=METHOD, metavar="X0,X1,Y0,Y1,Z0,Z1",
        help="Smallest and largest reading of each axis, typed in place of a recording.",
    )  # fmt: skip
    prior: float | str | None = member(
        "--prior", heading=METHOD, type=_prior, metavar="SIGMA|none",
        help="Prior standard deviation of the soft iron, for directions that were not seen [default: 0.3].",
    )  # fmt: skip
    robust: bool = member(
        "--robust", heading=METHOD, is_flag=True, help="Look for outliers whether or not the residuals ask for it."
    )
    alignment_sigma_deg: float | None = member(
        "--alignment-sigma", heading=METHOD, type=positive, metavar="DEG",
        help="How well the mounting is known, 1 σ about each axis: its heading error is stated on its own.",
    )  # fmt: skip

    def as_options(self) -> dict[str, Any]:
        """Options of `flinders.fit`, but for those of the method itself."""
        options: dict[str, Any] = {"method": self.method, "alignment_sigma_deg": self.alignment_sigma_deg}
        if self.prior is not None:
            options["prior"] = None if self.prior == "none" else self.prior
        return options | ({"robust": True} if self.robust else {})

    def own_options(self, taken: Iterable[str]) -> dict[str, Any]:
        """Options of the method itself.

        Raises
        ------
        UsageError
            For those that the method has not, values that it cannot take, or what another option says already.
        """
        if not self.method_options:
            return {}
        from flinders.cli.methods import parsed
        from flinders.estimators import METHODS

        method = METHODS[self.method]
        own = parsed(self.method_options, method)
        twice = [name for name in own if name in taken]
        if twice:
            raise UsageError(f"--{twice[0]} and --option {twice[0]} say the same: give one of them")
        method(**own)
        return own

    def check(self) -> None:
        """Find what cannot work before anything is read.

        Raises
        ------
        UsageError
            For a method that is not known, or options that go with another one.
        """
        from flinders.estimators import METHODS, method_of

        method_of(self.method)
        if self.robust and self.method != "auto":
            raise UsageError(
                f"--robust goes with --method auto: leave it out, or use --method robust instead of {self.method}"
            )
        if self.prior is None:
            return
        with_prior = [name for name, kind in METHODS.items() if "prior" in getattr(kind, "__dataclass_fields__", {})]
        if self.method not in with_prior:
            raise UsageError(
                f"--prior goes with --method {' or '.join(with_prior)}: {self.method} has none, leave --prior out"
            )


class Sensors(Group):
    """Which of several magnetometers, and whether they are fitted jointly."""

    sensor: str | None = member(
        "--sensor", heading=RECORDING, metavar="NAME|all",
        help="Name or serial number to store; of a log, which magnetometer, by number or name, or all of them.",
    )  # fmt: skip
    joint: bool = member(
        "--joint", was=("--together",), heading=METHOD, is_flag=True,
        help="With --sensor all: fit the magnetometers of one body jointly, and say which of them deviates.",
    )  # fmt: skip
    reference: str | None = member(
        "--reference", heading=METHOD, metavar="NAME",
        help="With --joint: into whose axes the others are turned, by number or name [default: the first].",
    )  # fmt: skip

    def are_all(self, recordings: Sequence[str]) -> bool:
        """Whether each of several magnetometers is calibrated.

        Raises
        ------
        UsageError
            Where several files are to be, or options go with that which was not asked for.
        """
        is_all = self.sensor is not None and self.sensor.strip().casefold() == ALL
        if is_all and len(recordings) > 1:
            raise UsageError("--sensor all goes with one file of several magnetometers: give one, or leave it out")
        if self.joint and not is_all:
            raise UsageError("--joint goes with --sensor all: it takes all magnetometers of a log or table")
        if self.reference is not None and not self.joint:
            raise UsageError("--reference goes with --joint: without it nothing is turned into other axes")
        return is_all


class SiteOptions(Group):
    """Where and when a recording was made."""

    place: str | None = member(
        "--at", heading=SITE, metavar="LAT,LON[,ALT]",
        help="Site of the recording: its dip and strength then count (World Magnetic Model; with --date).",
    )  # fmt: skip
    date: str | None = member("--date", heading=SITE, metavar="DAY", help="Day of the recording, such as 2026-11-21.")
    gain_sigma: float | None = member(
        "--gain-sigma", heading=SITE, type=within(0, 1, "a share above 0, up to 1, such as 0.01"), metavar="SHARE",
        help="With --at: how well the sensor's mean gain is known, 1 σ [default: 0.05].",
    )  # fmt: skip

    def as_options(self) -> dict[str, Any]:
        """Options of `flinders.fit`: the dip is that of the site, unless ``--dip`` was given.

        Axes that were typed are those of the vehicle, z down.

        Raises
        ------
        UsageError
            For a site without a date or beyond what the model holds, and for what goes with a site where there is none.
        """
        if self.place is None:
            if self.date is not None:
                raise UsageError("--date goes with --at: give both, or neither")
            if self.gain_sigma is not None:
                raise UsageError("--gain-sigma goes with --at: without the strength of a site no gain is looked at")
            return {}
        if self.date is None:
            raise UsageError(
                "the field changes with the years: give the day of the recording with --at, such as --date "
                "2026-11-21, or leave --at out"
            )
        from flinders.likelihood.site_field import Site

        site = replace(Site.of(site_of(self.place, self.date)), z_down=_is_typed("axes"))
        dip = {} if _is_typed("dip_deg") else {"dip_deg": site.inclination_deg}
        return {"site": site if self.gain_sigma is None else replace(site, gain_sigma=self.gain_sigma), **dip}


def _is_typed(name: str) -> bool:
    """Whether an option was given on the command line."""
    context = click.get_current_context(silent=True)
    return context is not None and context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE


class AidingOptions(Group):
    """What else was recorded and counts: aiding sensors, and disturbances that the offset follows."""

    names: tuple[str, ...] = member(
        "--with", heading=AIDING, multiple=True, metavar="NAME,…",
        help="What else was recorded and shall count: current, throttle, temperature, which the offset then follows "
        "(currents, throttles: of each motor; current2: of one); rate, dip, tilt, attitude, or auto.",
    )  # fmt: skip
    gyro_scale: float | None = member(
        "--gyro-scale", heading=AIDING,
        type=within(0, 0.5, "a share from 0 to 0.5, such as 0.02; 0 where the gyro is calibrated", zero=True),
        metavar="SHARE",
        help="With --with rate: what the gyro's scales may be off by, 1 σ; 0 where it is calibrated [default: 0.02].",
    )  # fmt: skip
    acceleration_bias: float | None = member(
        "--accelerometer-bias", heading=AIDING,
        type=within(0, 2, "m/s² from 0 to 2, such as 0.05; 0 where the accelerometer is calibrated", zero=True),
        metavar="M/S2",
        help="With --with dip: what the accelerometer may be off by, 1 σ; 0 where it is calibrated [default: 0.3].",
    )  # fmt: skip
    previous: str | None = member(
        "--previous", heading=AIDING, metavar="CALIBRATION",
        help="With --with and a sensor that was not turned: the calibration that the disturbances belong to.",
    )  # fmt: skip

    def as_options(self) -> dict[str, Any]:
        """Options of `flinders.fit`.

        Raises
        ------
        UsageError
            For what nothing is known of, or what goes with a sensor or disturbance that does not count.
        """
        aids, disturbances = recorded(self.names)
        options: dict[str, Any] = {}
        if aids:
            options["aiding"] = "auto" if aids == ("auto",) else aids
        if disturbances:
            options["disturbances"] = disturbances
        if self.gyro_scale is not None:
            if not {"rate", "auto"} & set(aids):
                raise UsageError("--gyro-scale goes with --with rate or auto: leave it out, or name the gyro")
            options["gyro_scale"] = self.gyro_scale
        if self.acceleration_bias is not None:
            if not {"dip", "auto"} & set(aids):
                raise UsageError(
                    "--accelerometer-bias goes with --with dip or auto: leave it out, or name the accelerometer"
                )
            options["acceleration_bias"] = self.acceleration_bias
        if self.previous is not None and not disturbances:
            raise UsageError(
                "--previous goes with --with current, currents, throttle, throttles or temperature: say which to find"
            )
        return options


def recorded(words: Iterable[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Split what stands after ``--with`` into aiding sensors and disturbances.

    Raises
    ------
    UsageError
        Where ``auto`` stands with other aiding sensors, nothing stands there, or something that nothing is known of.

    Examples
    --------
    >>> recorded(["rate,dip", "current"])
    (('rate', 'dip'), ('current',))
    """
    words = list(words)
    if not words:
        return (), ()
    from flinders.core.disturbance import BY_KEY, KINDS, MOTORS
    from flinders.estimators.aiding import AIDS
    from flinders.fitting.aiding import AUTO

    names = list(dict.fromkeys(name.strip() for word in words for name in word.split(",") if name.strip()))
    if not names:
        raise UsageError("--with names nothing: say what else was recorded, such as --with rate,dip, or --with auto")
    sensors = tuple(name for name in names if name in (AUTO, *AIDS))
    if AUTO in sensors and len(sensors) > 1:
        raise UsageError(f"--with {','.join(sensors)}: auto takes what the recording contains, name nothing beside it")
    known = {*BY_KEY.values(), *MOTORS.values()}
    for name in names:
        if name not in sensors and name not in known:
            raise UsageError(
                f"--with {name}: need one of {', '.join((AUTO, *AIDS, *KINDS, *MOTORS.values()))} (rate is that of a "
                "gyro; currents and throttles are those of each motor, and current2 that of one)"
            )
    return sensors, tuple(name for name in names if name in known)
