"""Options of ``flinders calibrate``: recordings, site, aiding sensors, estimation and output files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._completion import complete_methods
from flinders.cli._inputs import site_of, stated_site
from flinders.cli._output import Output, refuse_twice
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from flinders.core.geomag import FieldModel
    from flinders.estimators import Estimator
    from flinders.fitting.aiding import Instruments
    from flinders.heading.smoothing import Filter
    from flinders.likelihood.site_field import Site

TRACES: Final = (".svg", ".csv")
"""Accepted suffixes of the file of ``--convergence``: a drawing or a table."""


def _prior(value: str) -> float | str:
    """Read the value of ``--prior``: a number or the word none, since `None` means that the option was not given."""
    number = program.number_within(0, 100, "a number above 0, up to 100, such as 0.3; or none")
    return "none" if value.strip().casefold() == "none" else number(value)


class OutputOptions(program.Group, heading=program.OUTPUT):
    """Output files and output formats."""

    output: str | None = option.output(
        "the calibration", "Calibration file to write, or - for standard output; without it nothing is written."
    )
    report: str | None = program.member(
        "--report",
        what="the HTML report",
        metavar="FILE.html",
        help="Also write a report with figures, in one HTML file.",
    )
    report_text: str | None = program.member(
        "--report-text", what="the report", metavar="FILE",
        help="Also write a page in plain words for the users of the compass, or - for standard output.",
    )  # fmt: skip
    exported: tuple[str, ...] = program.member(
        "--export", multiple=True, metavar="TARGET[:FILE]",
        help=(
            "Also write the calibration for a target of `flinders targets` [FILE: the target's name with its "
            "suffix]; may be given several times."
        ),
    )  # fmt: skip
    convergence: str | None = program.member(
        "--convergence", what="the convergence", metavar="FILE",
        help="Also draw (FILE.svg) or list (FILE.csv) how the estimate converges, for iterative methods.",
    )  # fmt: skip
    verbose: bool = program.flag("--verbose", "Also print notes that apply to nearly every calibration.")
    plots: bool = program.member("--plot/--no-plot", default=True, help="Draw the readings, on a terminal.")
    force: bool = option.force()
    as_json: bool = option.as_json()

    @property
    def exports(self) -> tuple[tuple[str, str], ...]:
        """Target and file of each ``--export``."""
        if not self.exported:
            return ()
        from flinders.cli.export import split_exports

        return split_exports(self.exported)

    def named_files(self) -> Iterator[Output]:
        """Yield all output files, each with its name in messages."""
        yield from super().named_files()
        for target, path in self.exports:
            yield Output(f"the export to {target}", path, "--export TARGET:FILE")

    @property
    def of_readings(self) -> dict[str, object]:
        """Output files that only the calibration of a single magnetometer has, by their options."""
        return {"--report": self.report, "--report-text": self.report_text, "--convergence": self.convergence}

    def refuse_convergence(self, method: str) -> None:
        """Refuse ``--convergence`` for a method without iterations, or for a file with another suffix than `TRACES`."""
        if self.convergence is None:
            return
        from flinders.estimators import METHODS
        from flinders.estimators.trace import SequentialEstimator

        watched = [name for name, kind in METHODS.items() if issubclass(kind, SequentialEstimator)]
        if method not in watched:
            raise UsageError(
                f"--convergence needs --method {' or '.join(watched)}: {method} uses all readings at once, "
                "without iterations that could be shown"
            )
        if Path(self.convergence).suffix.lower() not in TRACES:
            raise UsageError(
                f"--convergence {self.convergence}: need a name that ends in {' (drawing) or '.join(TRACES)} (table)"
            )


class Estimation(program.Group, heading=program.METHOD):
    """The method of estimation and its options."""

    method: str = program.member(
        "--method", default="auto", show_default=True, metavar="NAME", help="One of `flinders methods`.",
        shell_complete=complete_methods,
    )  # fmt: skip
    method_options: tuple[str, ...] = program.member(
        "--option", multiple=True, metavar="NAME=VALUE",
        help="An option of the method, as `flinders methods` lists them; may be given several times.",
    )  # fmt: skip
    minmax: str | None = program.member(
        "--minmax", metavar="X0,X1,Y0,Y1,Z0,Z1",
        help="Smallest and largest reading of each axis, typed in place of a recording.",
    )  # fmt: skip
    prior: float | str | None = program.member(
        "--prior", type=_prior, metavar="SIGMA|none",
        help="Prior standard deviation of the soft iron, for directions without readings [default: 0.3].",
    )  # fmt: skip
    robust: bool = program.flag("--robust", "Always search for outliers, even if the residuals do not suggest any.")
    linearize: bool = program.flag(
        "--linearize", "Correct the nonlinearity of the axes, for targets that support it: c, arduino, micropython."
    )
    even_if_refused: bool = program.flag(
        "--even-if-refused", "For a published recipe, also print refused numbers, marked as such."
    )
    alignment_sigma_deg: float | None = program.member(
        "--alignment-sigma", type=program.positive, metavar="DEG",
        help="Uncertainty of the mounting, 1 σ about each axis; the heading error from it is stated separately.",
    )  # fmt: skip

    @property
    def estimator(self) -> Estimator:
        """The estimator of the typed method, with its options."""
        from flinders.estimators import method_class

        method = cast("Any", method_class(self.method))
        self._refuse_of_others()
        own: dict[str, Any] = {"robust": True} if self.robust else {}
        if self.prior is not None:
            own["prior"] = None if self.prior == "none" else self.prior
        return cast("Estimator", method(**own, **(self._typed_options(method, own) if self.method_options else {})))

    def _typed_options(self, method: type[Estimator], own: Iterable[str]) -> dict[str, Any]:
        """Read the values of ``--option``, which may not repeat the options in `own`."""
        from flinders.cli.methods import parse_options

        typed = parse_options(self.method_options, method)
        for name in set(own).intersection(typed):
            raise UsageError(f"--{name} and --option {name} set the same option: give one of them")
        return typed

    def _refuse_of_others(self) -> None:
        """Refuse options of a method that was not chosen; all methods are imported only if such an option is given."""
        if self.even_if_refused:
            self._refuse_but_recipes()
        if self.robust and self.method != "auto":
            raise UsageError(
                "--robust needs --method auto: leave --robust out"
                + ("" if self.method == "robust" else f", or use --method robust instead of {self.method}")
            )
        if self.prior is None:
            return
        from flinders.estimators import METHODS

        with_prior = [name for name, kind in METHODS.items() if "prior" in getattr(kind, "__dataclass_fields__", {})]
        if self.method not in with_prior:
            raise UsageError(
                f"--prior needs --method {' or '.join(with_prior)}: {self.method} has none, leave --prior out"
            )

    def _refuse_but_recipes(self) -> None:
        """Refuse ``--even-if-refused`` for a method that is not a published recipe."""
        from flinders.estimators import ROWS

        recipes = [name for name, row in ROWS.items() if row.is_recipe]
        if self.method not in recipes:
            raise UsageError(f"--even-if-refused needs --method {' or '.join(recipes)}: leave it out")


class Sensors(program.Group):
    """Choice of one of several magnetometers, or of a joint fit of all."""

    sensor: str | None = option.sensor(
        "Name or serial number to store; for a log, which magnetometer, by number or name, or all of them.", "NAME|all"
    )
    joint: bool = program.flag(
        "--joint", "With --sensor all: fit the magnetometers of one body jointly, and report which of them deviates.",
        heading=program.METHOD,
    )  # fmt: skip
    reference: str | None = program.member(
        "--reference", heading=program.METHOD, metavar="NAME",
        help="With --joint: magnetometer that the others are rotated to, by number or name [default: the first].",
    )  # fmt: skip

    def calibrates_all(self, recordings: Sequence[str]) -> bool:
        """Whether all magnetometers of a recording are calibrated, each with its own result."""
        is_all = self.sensor is not None and self.sensor.strip().casefold() == "all"
        if is_all and len(recordings) > 1:
            raise UsageError(
                "--sensor all needs one file of several magnetometers: give one file, or leave --sensor out"
            )
        if self.joint and not is_all:
            raise UsageError("--joint needs --sensor all: it takes all magnetometers of a log or table")
        if self.reference is not None and not self.joint:
            raise UsageError("--reference needs --joint: otherwise no axes are rotated")
        return is_all


class SiteOptions(program.Group, heading=program.SITE):
    """Place and day of a recording."""

    place: str | None = program.member(
        "--at", metavar="LAT,LON[,ALT]|none",
        help=(
            "Site of the recording: the fit uses the dip and the strength of a field model there; needs --date "
            "[default: the position in a log; none ignores that position]."
        ),
    )  # fmt: skip
    date: str | None = program.member("--date", metavar="DAY", help="Day of the recording, such as 2026-11-21.")
    model: FieldModel | None = option.field_model()
    gain_sigma: float | None = program.member(
        "--gain-sigma", type=program.number_within(0, 1, "a share above 0, up to 1, such as 0.01"), metavar="SHARE",
        help="With --at: uncertainty of the sensor's mean gain, 1 σ [default: 0.05].",
    )  # fmt: skip

    def typed_site(self) -> Site | None:
        """The site of ``--at``. Its axes are the vehicle's, with z down, if axes were typed."""
        if self.place is None or self.is_left_out:
            if self.date is not None:
                raise UsageError("--date needs --at: give both, or neither")
            if self.gain_sigma is not None:
                raise UsageError("--gain-sigma needs --at: without a field strength the gain is not estimated")
            if self.model is not None:
                raise UsageError("--field-model needs --at: give both, or neither")
            return None
        if self.date is None:
            raise UsageError(
                "the field changes over the years: give the day of the recording with --at, such as --date "
                "2026-11-21, or leave --at out"
            )
        from flinders.likelihood.site_field import Site

        return Site.of(site_of(self.place, self.date, model=self.model), **self._more)

    @property
    def is_left_out(self) -> bool:
        """Whether the position in a log is ignored (``--at none``)."""
        return self.place is not None and self.place.strip().casefold() == "none"

    def told_by(self, log: object) -> Site | None:
        """The site stated in a log or by one of its magnetometers, after a notice; None if ``--at`` was given."""
        return stated_site(log, "--at", **self._more) if self.place is None else None

    @property
    def _more(self) -> dict[str, Any]:
        """Arguments of `Site` other than the field."""
        gain = {} if self.gain_sigma is None else {"gain_sigma": self.gain_sigma}
        return {"z_down": program.is_typed("axes"), **gain}


class AidingOptions(program.Group, heading=program.AIDING):
    """Further recorded quantities: aiding sensors, and disturbances that change the offset."""

    names: tuple[str, ...] = program.member(
        "--with", multiple=True, metavar="NAME,…", keywords=("aiding", "disturbances"),
        help=(
            "Other recorded quantities to use. Disturbances of the offset: current, throttle, temperature, currents "
            "or throttles of each motor, current2 of one motor, or any column by its name, such as wheel_speed_rpm "
            "or BAT.Curr. Aiding sensors: rate, dip, tilt, attitude, or auto."
        ),
    )  # fmt: skip
    gyro_scale_sigma: float | None = program.member(
        "--gyro-scale", metavar="SHARE",
        type=program.number_within(
            0, 0.5, "a share from 0 to 0.5, such as 0.02; 0 if the gyro is calibrated", zero=True
        ),
        help="With --with rate: uncertainty of the gyro's scales, 1 σ; 0 for a calibrated gyro [default: 0.02].",
    )  # fmt: skip
    acceleration_bias_sigma: float | None = program.member(
        "--accelerometer-bias", metavar="M/S2",
        type=program.number_within(
            0, 2, "m/s² from 0 to 2, such as 0.05; 0 if the accelerometer is calibrated", zero=True
        ),
        help="With --with dip: uncertainty of the accelerometer's bias, 1 σ; 0 for a calibrated one [default: 0.3].",
    )  # fmt: skip
    acceleration_gain_sigma: float | None = program.member(
        "--accelerometer-gain", metavar="SHARE",
        type=program.number_within(
            0, 0.5, "a share from 0 to 0.5, such as 0.02; 0 if the accelerometer is calibrated", zero=True
        ),
        help=(
            "With --with dip: uncertainty of the accelerometer's gains, and of the angles of its axes (rad), 1 σ "
            "[default: 0.02]."
        ),
    )  # fmt: skip
    previous: str | None = program.member(
        "--previous", metavar="CALIBRATION",
        help="With --with, for a sensor that was held still: calibration to which the disturbances are added.",
    )  # fmt: skip

    def as_options(self) -> dict[str, Any]:
        """Arguments `aiding` and `disturbances` of `flinders.fit`."""
        aiding, disturbances = split_recorded_names(self.names)
        if self.gyro_scale_sigma is not None and not {"rate", "auto"} & set(aiding):
            raise UsageError("--gyro-scale needs --with rate or auto: leave --gyro-scale out, or add rate to --with")
        for name, value in (("bias", self.acceleration_bias_sigma), ("gain", self.acceleration_gain_sigma)):
            if value is not None and not {"dip", "auto"} & set(aiding):
                raise UsageError(f"--accelerometer-{name} needs --with dip or auto: leave it out, or add dip to --with")
        if self.previous is not None and not disturbances:
            raise UsageError(
                "--previous needs the disturbances of --with: name current, currents, throttle, throttles, "
                "temperature or another column, or leave --previous out"
            )
        instruments = self._instruments(aiding) if aiding else ()
        options = {"aiding": instruments, "disturbances": disturbances}
        return {name: value for name, value in options.items() if value}

    def _instruments(self, names: tuple[str, ...]) -> Instruments:
        """The aiding sensors, with the errors that were typed."""
        from flinders.fitting.aiding import Instruments

        sigmas = ("gyro_scale_sigma", "acceleration_bias_sigma", "acceleration_gain_sigma")
        typed = {name: value for name in sigmas if (value := getattr(self, name)) is not None}
        return Instruments(names, **typed)


def split_recorded_names(words: Iterable[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Split the values of ``--with`` into aiding sensors and disturbances.

    A name of an aiding sensor or of a known disturbance takes precedence over a column of the same name.

    >>> split_recorded_names(["rate,dip", "current", "wheel_rpm"])
    (('rate', 'dip'), ('current', 'wheel_rpm'))
    """
    words = list(words)
    if not words:
        return (), ()
    from flinders.core.disturbance import MOTORS, kind_of
    from flinders.estimators.aiding import AIDING_TERMS
    from flinders.fitting.aiding import AUTO

    names = list(dict.fromkeys(name.strip() for word in words for name in word.split(",") if name.strip()))
    if not names:
        raise UsageError("--with has no names: give some, such as --with rate,dip, or --with auto")
    sensors = tuple(name for name in names if name in (AUTO, *AIDING_TERMS))
    if AUTO in sensors and len(sensors) > 1:
        raise UsageError(f"--with {','.join(sensors)}: auto uses everything in the recording: give auto alone")
    disturbances = tuple(name for name in names if name not in sensors)
    for name in disturbances:
        if name not in MOTORS.values():
            kind_of(name)
    return sensors, disturbances


class Calibrate(program.Group):
    """Recordings, options for reading and fitting them, and output files."""

    recordings: tuple[str, ...] = program.argument("RECORDING...", nargs=-1, required=False)
    reading: option.ReadingByChip = program.group(option.ReadingByChip)
    sensors: Sensors = program.group(Sensors)
    site: SiteOptions = program.group(SiteOptions)
    aiding: AidingOptions = program.group(AidingOptions)
    estimation: Estimation = program.group(Estimation)
    files: OutputOptions = program.group(OutputOptions)
    field_strength: float | None = option.field_strength()
    by: Filter | None = option.smoothing()
    judgement: option.Judgement = program.group(option.Judgement)
    history: str | None = option.history("History of this unit by flinders watch, for the drift rate of its offset.")

    @property
    def of_extremes(self) -> dict[str, Any]:
        """Arguments of `from_extremes`."""
        asked = {"field_strength": self.field_strength, "sensor": self.sensors.sensor}
        return asked | self.judgement.as_dict(if_typed=["dip_deg"])

    def site_with(self, known: Site | None) -> Site | None:
        """A copy of the known site with the typed strength, dip and mounting."""
        from flinders.likelihood.site_field import Site

        dip_deg = self.judgement.dip_deg if program.is_typed("dip_deg") else None
        sigma_deg = self.estimation.alignment_sigma_deg
        if self.field_strength is None and dip_deg is None and sigma_deg is None:
            return known
        site = Site.merge_stated(known, strength=self.field_strength, inclination_deg=dip_deg)
        return site if sigma_deg is None else replace(site or Site(), alignment_sigma_deg=sigma_deg)

    def of_fit(self) -> dict[str, Any]:
        """The arguments of `flinders.fit`, except a site stated in a log.

        Impossible options are refused before the recording is read, as it may be long or still arriving.
        """
        from flinders.core.units import Unit

        if self.reading.unit:
            Unit.of(self.reading.unit, self.reading.scale)
        refuse_twice(self.recordings)
        asked: dict[str, Any] = {
            "method": self.estimation.estimator,
            "target_deg": self.judgement.target_deg,
            "sensor": self.sensors.sensor,
            "linearize": self.estimation.linearize,
        }
        self.files.refuse_convergence(self.estimation.method)
        asked |= self.aiding.as_options()
        return {**asked, "site": self.site_with(self.site.typed_site())}
