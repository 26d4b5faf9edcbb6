"""A recording as headings: what ``flinders heading`` and ``flinders swing`` share."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from flinders.cli import _disturbances
from flinders.cli._inputs import agree, is_calibration, load, site_of
from flinders.cli._output import bias_words, say
from flinders.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.cli._filters import Smoother
    from flinders.cli._options import Accelerometer, Place
    from flinders.core.compensation import Compensator
    from flinders.core.geomag import SiteField
    from flinders.core.samples import Recording, Samples
    from flinders.fitting.result import Fit
    from flinders.heading.compass import Compass, Headings, Voyage

ENOUGH_TO_JUDGE: Final = 1000
"""Readings of a stream after which the axes are looked at for the first time; at its end fewer will do."""
ENOUGH_TO_WEIGH: Final = 100
"""Readings of a block from which gravity is taken."""


@dataclass(slots=True, eq=False)
class HeadingLog:
    """A recording that is turned into headings.

    Attributes
    ----------
    fit : Fit
        The calibration and what it claims.
    recording : Recording
        In its unit and axes.
    compass : Compass
    site : SiteField, optional
    smoother : Smoother, optional
        What the readings go through.
    settler : Compensator, optional
        What takes off that which drives their offset, before that.
    """

    fit: Fit
    recording: Recording
    compass: Compass
    site: SiteField | None
    smoother: Smoother | None = None
    settler: Compensator | None = None

    def __str__(self) -> str:
        """What was recognised, and which columns are taken for the accelerometer."""
        from flinders.readers import TextRecording

        told = str(self.recording)
        if self.compass.formula == "level" or not isinstance(self.recording, TextRecording):
            return told
        column = self.recording.layout.columns.of_kind("acceleration")
        return told if column is None else f"{told}; acceleration {', '.join(column.names)}"

    def blocks(self) -> Iterator[tuple[Floats, Samples]]:
        """Readings, smooth where that was asked for, and the numbers of their lines."""
        for numbers, recorded in self._numbered():
            samples = recorded if self.settler is None else self.settler(recorded)
            yield numbers, samples if self.smoother is None else self.smoother.smoothed(samples)

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


class Watch:
    """Goes through a recording, and looks whether sensors and calibration suit each other.

    Attributes
    ----------
    log : HeadingLog
    corrector : Corrector
        Watches the length of the corrected readings.
    voyage : Voyage
        What was read so far.
    """

    def __init__(self, log: HeadingLog, dip_deg: float | None = None) -> None:
        from flinders.cli.apply import Corrector
        from flinders.heading.compass import Voyage

        self.log, self.voyage = log, Voyage()
        self.corrector = Corrector(log.fit.calibration, log.recording.source)
        self._site_dip = log.site.inclination_deg if log.site else dip_deg
        self._next = ENOUGH_TO_JUDGE

    def headings(self) -> Iterator[tuple[Floats, Samples, Headings]]:
        """Yield the numbers of the readings, the readings, and their headings, block by block.

        Raises
        ------
        InputError
            Where the readings are of another sensor, or the accelerometer is missing or has other axes.
        """
        from flinders.heading.compass import Voyage

        for numbers, samples in self.log.blocks():
            self.corrector(samples.field)
            self._weigh(samples)
            headings = self.log.compass.read(samples)
            self.voyage += Voyage.of(headings)
            if self.voyage.readings >= self._next:  # each time there are twice as many
                self._judge()
            yield numbers, samples, headings
        self._judge()

    def _weigh(self, samples: Samples) -> None:
        """Take gravity from the first block that is long enough, so that shaking later on is seen."""
        import numpy as np

        compass = self.log.compass
        if compass.gravity is not None or samples.acceleration is None or len(samples) < ENOUGH_TO_WEIGH:
            return
        with np.errstate(over="ignore", invalid="ignore"):
            length = np.linalg.norm(samples.acceleration, axis=1)
        if np.isfinite(length).any():
            self.log.compass = replace(compass, gravity=float(np.nanmedian(length)))

    def _judge(self) -> None:
        self._next = 2 * self.voyage.readings
        if self.log.compass.formula == "level":
            return
        self.voyage.frames.refuse_foreign(site_dip_deg=self._site_dip, applied=self.log.compass.acceleration_axes)


def open_log(
    command: str,
    calibration: str,
    recording: str,
    *,
    place: Place,
    accelerometer: Accelerometer,
    formula: str = "exact",
    declination_deg: float | None = None,
    fixed: tuple[str, ...] = (),
    **options: Any,
) -> HeadingLog:
    """Open a recording with a calibration, and find out where it was made.

    Raises
    ------
    UsageError
        For options that contradict each other, or a recording that is a calibration.
    InputError
        For what cannot be read.
    """
    from flinders.core.axes import Axes
    from flinders.heading.compass import LEVEL, Compass
    from flinders.readers import TextRecording, open_recording

    _refuse_contradictions(place, accelerometer, formula, declination_deg)
    acceleration, is_level = accelerometer.acceleration, accelerometer.is_level
    turned = Axes.of(accelerometer.acceleration_axes)
    if place.place is not None and place.date is not None:
        site_of(place.place, place.date)  # what is wrong with them is said before anything is read
    fit, settler = _disturbances.settler_of(load(command, calibration, [recording]), fixed)
    if is_calibration(recording):
        raise UsageError(f"{recording} is a calibration too: give a recording after it")
    opened = open_recording(recording, axes=str(fit.calibration.axes), once=True, **options)
    if acceleration is not None:
        if not isinstance(opened, TextRecording):
            raise UsageError(f"{recording} is no text: its columns are known, leave --acceleration out")
        opened.name_acceleration(acceleration)
    agree(fit.calibration, opened)
    site = None if place.place is None else site_of(place.place, place.date, opened)
    declination = declination_deg if site is None else site.declination_deg
    bias = None if is_level or fit.aiding is None else fit.aiding.acceleration_bias
    if bias is not None:
        say(f"{bias_words(bias)}, by {calibration}: taken off")
    compass = Compass(fit.calibration, LEVEL if is_level else formula, turned, declination, acceleration_bias=bias)
    return HeadingLog(fit, opened, compass, site, settler=settler)


def site_dip(log: HeadingLog, voyage: Voyage, given: float | None = None) -> tuple[float, str]:
    """The dip for which errors are told, in degrees, and where it comes from."""
    import numpy as np

    from flinders.heading.compass import LEVEL
    from flinders.heading.error_propagation import STEEPEST_DIP_DEG

    tilted = log.compass.formula != LEVEL and voyage.frames.readings
    known = {
        "given": given,
        "calibration": _own_dip(log),
        "model": log.site.inclination_deg if log.site else None,
        "seen": voyage.frames.dip_deg[0] if tilted else float("nan"),
        "assumed": 60.0,
    }
    source, dip = next((name, found) for name, found in known.items() if found is not None and np.isfinite(found))
    return float(np.clip(dip, -STEEPEST_DIP_DEG, STEEPEST_DIP_DEG)), source


def _own_dip(log: HeadingLog) -> float | None:
    """The dip that the calibration of a level turn rests on: level headings are as good as that says, and no better."""
    from flinders.heading.compass import LEVEL

    dip_deg = log.fit.heading_error_deg.dip_deg
    return dip_deg if log.compass.formula == LEVEL and log.fit.plane == "xy" and not math.isnan(dip_deg) else None


def down(log: HeadingLog, voyage: Voyage) -> Floats:
    """(3,) which way is down when the vehicle is level, in the axes of the calibration's ellipsoid."""
    import numpy as np

    down: Floats = log.fit.calibration.rotation_matrix.T @ np.array([0.0, 0.0, -1.0 if voyage.is_z_up else 1.0])
    return down


def _refuse_contradictions(
    place: Place, accelerometer: Accelerometer, formula: str, declination_deg: float | None
) -> None:
    """Refuse options of which one would be ignored.

    Raises
    ------
    UsageError
        Naming both.
    """
    if accelerometer.is_level and formula != "exact":
        raise UsageError(f"--level takes no tilt off, --formula {formula} does: leave one of them out")
    if accelerometer.is_level and accelerometer.acceleration is not None:
        raise UsageError("--level uses no accelerometer, --acceleration names one: leave one of them out")
    if place.place is not None and declination_deg is not None:
        raise UsageError("--at and --declination both say where true north is: leave one of them out")
    place.check()
