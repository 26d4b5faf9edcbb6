"""Readings that go through a calibration as they come: what ``flinders apply``, ``heading`` and ``swing`` share."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from flinders.cli._inputs import in_use, open_with, read_and_left_out, refuse_calibrations, site_of
from flinders.cli._output import bias_words, say, say_beyond
from flinders.cli._spelling import in_options
from flinders.errors import InputError, UsageError, counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.cli._options import Accelerometer, Place
    from flinders.comparison.comparison import Strength
    from flinders.core.compensation import Compensator
    from flinders.core.geomag import SiteField
    from flinders.core.samples import Recording, Samples
    from flinders.fitting.result import Fit
    from flinders.heading.compass import Compass, Headings
    from flinders.heading.smoothing import Filter

FOREIGN: Final = 3.0
"""Readings that come out so many times too long or too short are of another sensor or unit: refused."""
ODD, UNEVEN = 1.3, 0.1
"""Strength, as a factor, and spread, as a fraction, from which on a calibration of unknown accuracy does not suit."""
SUITED, LEAST_UNEVEN = 3.0, 0.02
"""Times what noise and claim make of the spread of one that states them; 2 % bend a heading by 3° and more.

Of 992 recordings that suit none is doubted (``python -m benchmarks.suitability``).
"""
OUTLYING, OUTLIERS = 3.0, 0.1
"""Times that spread from which on a reading is an outlier, and their share up to which a calibration may suit."""
ENOUGH_TO_JUDGE: Final = 1000
"""Readings of a stream after which the axes are looked at for the first time; at its end fewer will do."""
ENOUGH_TO_WEIGH: Final = 100
"""Readings of a block from which gravity is taken; of a recording in which an axis that never changes is stuck."""


class Smoother:
    """Filters samples as they come, and puts what was expected in the place of a spike."""

    def __init__(self, by: Filter) -> None:
        self._by, self._stream = by, by.start(centred=False)

    def __call__(self, samples: Samples) -> Samples:
        """The same samples with a smooth field."""
        return replace(samples, field=self._stream.push(samples.field, samples.time).field)

    def as_dict(self) -> dict[str, str | int | float]:
        """JSON-ready."""
        return {
            "name": self._by.name,  # of the filter
            "width": self._by.width,  # readings that it takes
            "lag_readings": self._by.lag,  # readings by which its output is late
            "spikes": self._stream.dropped,  # readings that it replaced
            "restarts": self._stream.restarts,  # how often it began anew, at a gap
        }

    def __str__(self) -> str:
        spikes, restarts = self._stream.dropped, self._stream.restarts
        dropped = f"; {counted(spikes, 'spike')} replaced by what was expected" if spikes else ""
        again = f"; started afresh {counted(restarts, 'time')}" if restarts else ""
        return f"filtered: {self._by}; what is written is {self._by.lag:g} readings late{dropped}{again}"


@dataclass(frozen=True, slots=True)
class Preparation:
    """What is done to samples before they are corrected: they are compensated, then filtered."""

    compensator: Compensator
    smoother: Smoother | None = None

    @classmethod
    def of(cls, compensator: Compensator, by: Filter | None) -> Preparation:
        """Prepare samples with a filter, if there is one."""
        return cls(compensator, None if by is None else Smoother(by))

    @property
    def is_nothing(self) -> bool:
        """Samples stay as they are."""
        return self.smoother is None and self.compensator.calibration.is_affine

    def __call__(self, samples: Samples) -> Samples:
        """Prepare a block."""
        compensated = self.compensator(samples)
        return compensated if self.smoother is None else self.smoother(compensated)

    def say(self) -> dict[str, Any]:
        """Say what the filter did, and what a disturbance went beyond; the same for JSON."""
        if self.smoother is None:
            return say_beyond(self.compensator)
        say(str(self.smoother))
        return {"filter": self.smoother.as_dict(), **say_beyond(self.compensator)}


class Corrector:
    """Applies the calibration of a fit block by block, and watches whether the result makes sense.

    `strength` is that of the readings corrected so far, `inliers` that of those that are no outliers of their block,
    and `spread_limit` what its spread is in readings that suit.
    """

    def __init__(self, fit: Fit, source: str) -> None:
        from flinders.comparison.comparison import Strength

        self._looks_like = ""
        self._calibration, self._source, self.spread_limit = fit.calibration, source, _spread_limit(fit)
        self.strength: Strength = Strength()
        self.inliers: Strength = Strength()
        self._lowest, self._highest = [math.inf] * 3, [-math.inf] * 3

    def __call__(self, readings: Floats) -> Floats:
        """Correct (N, 3) readings."""
        import numpy as np

        from flinders.comparison.comparison import Strength

        corrected = self._calibration.apply(readings)
        strength = np.linalg.norm(corrected, axis=1) / self._calibration.field_strength
        middle = float(np.median(strength))
        if self.strength.readings == 0 and not 1 / FOREIGN < middle < FOREIGN:
            raise InputError(
                f"corrected readings of {self._source} are {middle:.2g} times as long as the calibration's field "
                f"({self._calibration.field_strength:.4g} {self._calibration.unit}): it is for another sensor, unit or "
                "range; check --columns, or calibrate this sensor"
            )
        self._lowest = np.fmin.reduce(np.vstack([self._lowest, readings])).tolist()
        self._highest = np.fmax.reduce(np.vstack([self._highest, readings])).tolist()
        self.strength += Strength.of(strength)
        self.inliers += Strength.of(strength[np.abs(strength - middle) <= OUTLYING * self.spread_limit])
        return corrected

    def look_at(self, samples: Samples) -> None:
        """Look whether recorded samples, where nobody says that they are a magnetometer's, are something else."""
        if samples.nameless and not self._looks_like:
            from flinders.readers._likeness import doubt, looks_like

            what = doubt(samples)
            self._looks_like = what and looks_like(what, in_options({"columns": samples.nameless}))

    @property
    def is_plausible(self) -> bool:
        """Corrected readings, but for outliers, are about as long as the field, and as equally long as claimed."""
        readings, inliers = self.strength.readings, self.inliers
        if inliers.readings < (1.0 - OUTLIERS) * readings:
            return False
        return not readings or (1 / ODD < inliers.mean < ODD and inliers.spread < self.spread_limit)

    @property
    def stuck(self) -> str:
        """Axes that have the same value in so many readings, as ``x = 1.5, z = 7``; nothing where all change."""
        if self.strength.readings < ENOUGH_TO_WEIGH:
            return ""
        extremes = zip("xyz", self._lowest, self._highest, strict=True)
        return ", ".join(f"{axis} = {lowest:g}" for axis, lowest, highest in extremes if lowest == highest)

    @property
    def doubt(self) -> str:
        """Why readings do not suit, and what that may come from; nothing where they suit."""
        if self._looks_like:
            return self._looks_like
        if self.stuck:
            return (
                f"never changes in {self.strength.readings:,} readings: {self.stuck}. Check the wiring and the columns"
            )
        if self.is_plausible:
            return ""
        return (
            f"these readings do not suit the calibration: corrected, their strength is {self.strength.mean:.3f} of its "
            f"field and spreads by {self.strength.spread:.1%}, and {self.spread_limit:.1%} would be much: iron or "
            "currents have come or gone, or it is for another sensor, unit or place; see flinders check, or calibrate "
            "again"
        )

    def read_words(self, recording: Recording) -> str:
        """How many readings were corrected, and which lines were left out."""
        return read_and_left_out(self.strength.readings, getattr(recording, "skipped", ()))


def _spread_limit(fit: Fit) -> float:
    """The spread of lengths from which on readings do not suit, by the noise and the claim of a fit."""
    if not fit.claim.states_uncertainty:
        return UNEVEN
    noise = fit.noise / fit.calibration.ellipsoid.radius
    claimed = math.radians(fit.claim.direction_error_deg.worst)  # at any attitude
    return min(max(SUITED * math.hypot(noise, claimed), LEAST_UNEVEN), UNEVEN)


@dataclass(eq=False)
class HeadingLog:
    """A recording that is turned into headings, and whether its sensors and the calibration suit each other."""

    fit: Fit
    recording: Recording
    compass: Compass
    preparation: Preparation
    site: SiteField | None
    dip_deg: float | None  # as it was given

    def __post_init__(self) -> None:
        from flinders.heading.compass import Voyage

        self.corrector = Corrector(self.fit, self.recording.source)
        self.voyage = Voyage()  # what was read so far

    def __str__(self) -> str:
        """What was recognised, and which columns are taken for the accelerometer."""
        from flinders.readers import TextRecording

        if self.compass.formula == "level" or not isinstance(self.recording, TextRecording):
            return str(self.recording)
        column = self.recording.layout.columns.of_kind("acceleration")
        return str(self.recording) + ("" if column is None else f"; acceleration {', '.join(column.names)}")

    def headings(self) -> Iterator[tuple[Floats, Samples, Headings]]:
        """Yield the numbers of the readings, the readings, and their headings, block by block."""
        from flinders.heading.compass import Voyage

        judged_next = ENOUGH_TO_JUDGE
        for numbers, recorded in self._numbered():
            self.corrector.look_at(recorded)
            samples = self.preparation(recorded)
            self.corrector(samples.field)
            self._weigh(samples)
            headings = self.compass.read(samples)
            self.voyage += Voyage.of(headings)
            if self.voyage.readings >= judged_next:
                judged_next = 2 * self.voyage.readings
                self._judge()
            yield numbers, samples, headings
        self._judge()

    def _numbered(self) -> Iterator[tuple[Floats, Samples]]:
        """Readings and the numbers of their lines, or their own where there are no lines."""
        import numpy as np

        numbered = getattr(self.recording, "numbered_blocks", None)
        if numbered is not None:
            yield from numbered()
            return
        done = 0
        for block in self.recording.blocks():
            yield np.arange(done + 1.0, done + 1.0 + len(block)), block
            done += len(block)

    def _weigh(self, samples: Samples) -> None:
        """Take gravity from the first block that is long enough, so that shaking later on is seen."""
        import numpy as np

        if self.compass.gravity is not None or samples.acceleration is None or len(samples) < ENOUGH_TO_WEIGH:
            return
        with np.errstate(over="ignore", invalid="ignore"):
            length = np.linalg.norm(samples.acceleration, axis=1)
        if np.isfinite(length).any():
            self.compass = replace(self.compass, gravity=float(np.nanmedian(length)))

    def _judge(self) -> None:
        """Refuse an accelerometer that has other axes than the magnetometer."""
        if self.compass.formula != "level":
            dip_deg = self.site.inclination_deg if self.site else self.dip_deg
            self.voyage.frames.refuse_foreign(site_dip_deg=dip_deg, applied=self.compass.acceleration_axes)

    def site_dip(self) -> tuple[float, str]:
        """The dip for which errors are stated, in degrees, and where it comes from."""
        import numpy as np

        from flinders.heading.error_propagation import STEEPEST_DIP_DEG

        is_level = self.compass.formula == "level"
        is_seen = not is_level and self.voyage.frames.readings
        own = self.fit.heading_error_deg.dip_deg
        known = {
            "given": self.dip_deg,
            "calibration": own if is_level and self.fit.claim.plane == "xy" else None,
            "model": self.site.inclination_deg if self.site else None,
            "measured": self.voyage.frames.dip_deg[0] if is_seen else None,
        }
        finite = ((source, dip) for source, dip in known.items() if dip is not None and math.isfinite(dip))
        source, dip = next(finite, ("assumed", 60.0))
        return float(np.clip(dip, -STEEPEST_DIP_DEG, STEEPEST_DIP_DEG)), source

    @property
    def tilt_error_deg(self) -> float | None:
        """What the tilt by the accelerometer scatters headings by, 1 σ: scatter of the dip times its tangent."""
        frames = self.voyage.frames
        if self.compass.formula == "level" or not frames.readings:
            return None
        dip, scatter = frames.dip_deg
        return min(scatter * abs(math.tan(math.radians(dip))), 180.0)

    def mounting_error_deg(self, dip_deg: float) -> float | None:
        """What the rotation into the body adds to headings, 1 σ; None where the calibration claims none."""
        aiding = self.fit.evidence.aiding
        return None if aiding is None else aiding.alignment_error_deg(dip_deg)

    def down_in_body(self) -> Floats:
        """(3,) which way is down when the vehicle is level, in corrected axes."""
        import numpy as np

        return np.array([0.0, 0.0, -1.0 if self.voyage.is_z_up else 1.0])

    def down(self) -> Floats:
        """(3,) the same in the axes of the calibration's ellipsoid."""
        down: Floats = self.fit.calibration.rotation_matrix.T @ self.down_in_body()
        return down


def open_log(
    command: str,
    calibration: str | None,
    recording: str,
    *,
    place: Place,
    accelerometer: Accelerometer,
    formula: str = "exact",
    declination_deg: float | None = None,
    dip_deg: float | None = None,
    fixed: tuple[str, ...] = (),
    by: Filter | None = None,
    has_stated_place: bool = False,
    **reading: Any,
) -> HeadingLog:
    """Open a recording with a calibration, or as it is, and find out where it was made.

    With `has_stated_place` a place that the log states counts as if it were given.
    """
    from flinders.core.axes import Axes
    from flinders.core.geomag import recorded_field
    from flinders.heading.compass import LEVEL, Compass

    _refuse_contradictions(place, accelerometer, formula, declination_deg)
    turned = Axes.of(accelerometer.acceleration_axes)
    if place.place is not None and place.date is not None:
        site_of(place.place, place.date)  # what is wrong with them is said before anything is read
    fit, compensator = (
        _as_it_is(recording, **reading) if calibration is None else in_use(command, calibration, [recording], fixed)
    )
    refuse_calibrations([recording])
    opened = open_with(fit, recording, once=True, **reading)
    if accelerometer.acceleration is not None:
        _name_acceleration(opened, accelerometer.acceleration)
    site = None if place.place is None else site_of(place.place, place.date, opened)
    if has_stated_place and place.place is None and declination_deg is None and dip_deg is None:
        site = recorded_field(opened)
        if site is not None:
            say(f"{opened.source}: the log says where and when: {site}; used, unless --at says otherwise")
    declination = declination_deg if site is None else site.declination_deg
    is_level = accelerometer.is_level
    compass = Compass(fit.calibration, LEVEL if is_level else formula, turned, declination)
    aiding = fit.evidence.aiding
    if not is_level and aiding is not None and aiding.acceleration_bias is not None:
        bias, matrix = aiding.acceleration_bias, aiding.acceleration_matrix
        gains = "" if matrix is None else ", and its gains and angles between its axes"
        say(f"{bias_words(bias)}, by {calibration}: removed{gains}")
        compass = replace(compass, acceleration_bias=bias, acceleration_matrix=matrix)
    return HeadingLog(fit, opened, compass, Preparation.of(compensator, by), site, dip_deg)


def _as_it_is(recording: str, **reading: Any) -> tuple[Fit, Compensator]:
    """A calibration that changes nothing, for a recording as it is."""
    import numpy as np

    from flinders.core.calibration import Calibration
    from flinders.core.compensation import Compensator
    from flinders.fitting.result import Fit
    from flinders.readers import open_recording

    opened = open_recording(recording, **reading)
    length = float(np.median(np.linalg.norm(next(iter(opened.blocks())).field, axis=1)))
    calibration = Calibration.identity(field_strength=length, raw=opened.unit, axes=opened.axes)
    return Fit.of(calibration, name="no calibration"), Compensator(calibration)


def _name_acceleration(recording: Recording, columns: str) -> None:
    """Name the columns of the accelerometer in a text."""
    from flinders.readers import TextRecording

    if not isinstance(recording, TextRecording):
        raise UsageError(f"{recording.source} is no text: its columns are known, leave --acceleration out")
    recording.name_acceleration(columns)


def _refuse_contradictions(
    place: Place, accelerometer: Accelerometer, formula: str, declination_deg: float | None
) -> None:
    """Refuse options of which one would be ignored."""
    if accelerometer.is_level and formula != "exact":
        raise UsageError(f"--level takes no tilt off, --formula {formula} does: leave one of them out")
    if accelerometer.is_level and accelerometer.acceleration is not None:
        raise UsageError("--level uses no accelerometer, --acceleration names one: leave one of them out")
    if place.place is not None and declination_deg is not None:
        raise UsageError("--at and --declination both say where true north is: leave one of them out")
    place.check()
