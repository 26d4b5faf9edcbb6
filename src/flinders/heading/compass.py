"""Headings of a recording, from calibration, accelerometer and declination, block by block.

>>> from flinders import simulate
>>> from flinders.geometry.angles import wrap_180
>>> from flinders.core.calibration import Calibration
>>> tumble = simulate.tumble(seed=1)
>>> samples = tumble.samples
>>> level = Compass(Calibration.identity(field_strength=50.0, raw=samples.unit), formula="level", declination_deg=10.0)
>>> headings = level.read(samples)
>>> len(headings), round(float(wrap_180(headings.true_deg[0] - headings.magnetic_deg[0])), 9)
(3000, 10.0)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.core.axes import Axes
from flinders.errors import NoAccelerometer, UsageError
from flinders.geometry.angles import wrap_360
from flinders.heading.attitude import FORMULAS, dip_deg, level_heading_deg, roll_pitch_deg
from flinders.heading.axis_consistency import Frames, median_length

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration
    from flinders.core.samples import Samples

LEVEL: Final = "level"
"""Name of the heading from two axes."""

STANDARD_GRAVITY: Final = 9.80665
"""Standard gravity in m/s²."""

RECORDED_AXES: Final = Axes()


@dataclass(frozen=True, slots=True, eq=False)
class Headings:
    """Headings of N readings in degrees, NaN for a reading without one; roll, pitch and dip need an accelerometer."""

    magnetic_deg: Floats  # (N,): magnetic headings, in [0, 360)
    strength: Floats  # (N,): lengths of the corrected readings, as shares of the calibration's field
    true_deg: Floats | None = None  # (N,): headings from true north, if the declination is known
    roll_deg: Floats | None = None  # (N,): roll of a body with x forward, y right, z down
    pitch_deg: Floats | None = None  # (N,): pitch of this body
    dip_deg: Floats | None = None  # (N,): measured inclination of the field
    # sums that test the axes of the accelerometer; for a level sensor they show whether z is down
    frames: Frames = field(default_factory=Frames)
    accelerated: int = 0  # count of readings with an acceleration other than gravity
    grid_deg: Floats | None = None  # (N,): headings from grid north, if the grid convergence is known

    def __len__(self) -> int:
        return len(self.magnetic_deg)

    @classmethod
    def concatenate(cls, blocks: Sequence[Headings]) -> Headings:
        """Concatenate headings of consecutive blocks of one recording."""
        named = [block.columns() for block in blocks] or [{}]
        columns = {name: np.concatenate([each[name] for each in named]) for name in named[0]}
        return cls(
            columns.get("heading_deg", np.empty(0)),
            columns.get("strength", np.empty(0)),
            columns.get("true_heading_deg"),
            columns.get("roll_deg"),
            columns.get("pitch_deg"),
            columns.get("dip_deg"),
            sum((block.frames for block in blocks), Frames()),
            sum(block.accelerated for block in blocks),
            columns.get("grid_heading_deg"),
        )

    def columns(self) -> dict[str, Floats]:
        """Known columns, by their names in a table."""
        named = {
            "heading_deg": self.magnetic_deg,
            "true_heading_deg": self.true_deg,
            "grid_heading_deg": self.grid_deg,
            "roll_deg": self.roll_deg,
            "pitch_deg": self.pitch_deg,
            "dip_deg": self.dip_deg,
            "strength": self.strength,
        }
        return {name: values for name, values in named.items() if values is not None}


@dataclass(frozen=True, slots=True, eq=False)
class Compass:
    """Calibration, formula and settings that turn readings into headings; `UsageError` for an unknown formula."""

    calibration: Calibration
    # name in `flinders.heading.attitude.FORMULAS`; or "level" for two axes of a sensor that is never tilted
    formula: str = "exact"
    acceleration_axes: Axes = RECORDED_AXES  # mapping of the acceleration to the axes of the field
    declination_deg: float | None = None  # true heading minus magnetic heading
    grid_declination_deg: float | None = None  # grid heading minus magnetic heading
    # length of the acceleration at rest, in the unit of the recording; None for the median length of each block
    gravity: float | None = None
    acceleration_bias: Floats | None = None  # (3,), m/s²: bias in the calibration's axes, which is subtracted
    acceleration_matrix: Floats | None = None  # (3, 3): matrix that is applied after the bias is subtracted

    def __post_init__(self) -> None:
        """Refuse an unknown formula."""
        if self.formula != LEVEL and self.formula not in FORMULAS:
            raise UsageError(f"formula {self.formula!r} is not known: use one of {', '.join((*FORMULAS, LEVEL))}")

    def read(self, samples: Samples) -> Headings:
        """Compute headings of readings in the calibration's unit and axes.

        Raises
        ------
        NoAccelerometer
            For samples without acceleration, unless the formula is ``level``.
        """
        corrected = self.calibration.apply(samples.field)
        with np.errstate(over="ignore", invalid="ignore"):
            strength = np.linalg.norm(corrected, axis=1) / self.calibration.field_strength
        if self.formula == LEVEL:
            magnetic = level_heading_deg(corrected)
            frames = Frames.of(corrected, np.broadcast_to([0.0, 0.0, -1.0], corrected.shape), gravity=1.0)
            true, grid = self._from_north(magnetic)
            return Headings(magnetic, strength, true, frames=frames, grid_deg=grid)
        if samples.acceleration is None:
            raise NoAccelerometer(
                f"no accelerometer among the columns of {samples.source}: the heading of a tilted sensor needs one; "
                "name its columns, or state that the sensor is always level",
                hint={"acceleration": None, "level": True},
            )
        force = self._specific_force(self.acceleration_axes.apply(samples.acceleration))
        magnetic = FORMULAS[self.formula](corrected, force)
        roll, pitch = roll_pitch_deg(force)
        frames = Frames.of(corrected, force, gravity=self.gravity)
        present = int(np.isfinite(force).all(axis=1).sum())
        true, grid = self._from_north(magnetic)
        return Headings(
            magnetic, strength, true, roll, pitch, dip_deg(corrected, force), frames, max(present - frames.readings, 0),
            grid,
        )  # fmt: skip

    def _specific_force(self, read: Floats) -> Floats:
        """(N, 3) readings of the accelerometer, corrected by its bias and matrix."""
        if self.acceleration_bias is not None:
            gravity = self.gravity
            if gravity is None:
                gravity = median_length(read) or 0.0
            read = read - self.acceleration_bias * (gravity / STANDARD_GRAVITY)
        force: Floats = read if self.acceleration_matrix is None else read @ self.acceleration_matrix.T
        return force

    def _from_north(self, magnetic: Floats) -> tuple[Floats | None, Floats | None]:
        """Headings from true north and from grid north, each None if its declination is unknown."""
        known = (self.declination_deg, self.grid_declination_deg)
        true, grid = (None if angle is None else wrap_360(magnetic + angle) for angle in known)
        return true, grid


@dataclass(frozen=True, slots=True, eq=False)
class HeadingSums:
    """Statistics of a stretch of headings, as sums that add."""

    readings: int = 0  # count of corrected readings
    without_heading: int = 0  # count of readings without a heading
    accelerated: int = 0  # count of readings with an acceleration other than gravity
    frames: Frames = field(default_factory=Frames)
    # (181,): histogram of the angle between z and down, in bins of 1°
    tilts: Floats = field(default_factory=lambda: np.zeros(181))

    @classmethod
    def of(cls, headings: Headings) -> Self:
        """Sum up a block."""
        without = int(np.isnan(headings.magnetic_deg).sum())
        tilts = np.zeros(181)
        if headings.roll_deg is not None and headings.pitch_deg is not None:
            upright = np.cos(np.deg2rad(headings.roll_deg)) * np.cos(np.deg2rad(headings.pitch_deg))
            angles = np.rad2deg(np.arccos(upright[np.isfinite(upright)].clip(-1.0, 1.0)))
            tilts = np.bincount(np.round(angles).astype(int), minlength=181).astype(float)
        return cls(len(headings), without, headings.accelerated, headings.frames, tilts)

    def __add__(self, other: HeadingSums) -> HeadingSums:
        return HeadingSums(
            self.readings + other.readings,
            self.without_heading + other.without_heading,
            self.accelerated + other.accelerated,
            self.frames + other.frames,
            self.tilts + other.tilts,
        )

    @property
    def has_none(self) -> bool:
        """Whether no reading has a heading."""
        return 0 < self.readings == self.without_heading

    @property
    def is_z_up(self) -> bool:
        """Whether the sensor was mounted with z up, by the majority of readings."""
        return bool(self.tilts[:90].sum() < self.tilts[91:].sum())

    @property
    def tilt_deg(self) -> float:
        """Tilt in whole degrees that 95 % of the readings do not exceed."""
        tilts = self.tilts[::-1] if self.is_z_up else self.tilts
        total = tilts.cumsum()
        return float(np.searchsorted(total, 0.95 * total[-1])) if total[-1] else 0.0

    def as_dict(self) -> dict[str, Any]:
        """Values for JSON, by name."""
        plain: dict[str, Any] = {"readings": self.readings, "without_heading": self.without_heading}
        if self.frames.readings:
            dip, scatter = self.frames.dip_deg
            plain |= {"accelerated": self.accelerated, "tilt_deg": self.tilt_deg, "is_z_up": self.is_z_up}
            plain["measured_dip_deg"] = dip  # mean over the attitudes
            plain["measured_dip_scatter_deg"] = scatter  # 1 σ over the attitudes
        return plain
