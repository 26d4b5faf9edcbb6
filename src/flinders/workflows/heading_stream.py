"""Headings of a stream of readings, block by block, with their expected error.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> tumble = simulate.tumble(seed=1)
>>> stream = HeadingStream.of(tumble.samples, calibrate.fit(tumble.samples), declination_deg=3.0)
>>> sum(len(headings) for _, _, headings in stream.headings())
3000
>>> stream.claim().dip_source, [note.code for note in stream.summary().notes]
('measured', ['mounting-unobserved'])
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from flinders.core.axes import Axes
from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.errors import UsageError, count_text, python_arguments
from flinders.heading.compass import LEVEL, Compass, Headings, HeadingSums
from flinders.heading.error_propagation import MAX_DIP_DEG, level_bound_deg, level_error, tilted_error
from flinders.readers import TextRecording
from flinders.workflows.correction import CorrectionStream
from flinders.workflows.heading_notes import HeadingClaim, heading_notes
from flinders.workflows.notes import limits_in_codes, limits_of
from flinders.workflows.suitability import MIN_READINGS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from flinders.arrays import Floats
    from flinders.core.geomag import SiteField
    from flinders.core.samples import Recording, Samples
    from flinders.errors import Spelling
    from flinders.fitting.result import Fit
    from flinders.heading.error_propagation import HeadingError
    from flinders.heading.smoothing import Filter
    from flinders.workflows.correction import CorrectionSummary
    from flinders.workflows.heading_notes import DipSource
    from flinders.workflows.notes import Note
    from flinders.workflows.suitability import CorrectionMonitor

MIN_JUDGED_READINGS: Final = 1000
"""Number of readings after which the axes of a stream are first checked; at the end of the stream fewer are enough."""


@dataclass(frozen=True, slots=True, eq=False)
class HeadingSummary:
    """Summary of headings: tilt and dip, expected error, and limits."""

    voyage: HeadingSums  #: numbers of readings with and without a heading, tilt, measured dip
    compass: Compass  #: formula, declination and axes of the acceleration
    site: SiteField | None  #: field at the place; None if the place is unknown
    claim: HeadingClaim
    #: length of corrected readings, and reasons if the readings do not suit the calibration
    correction: CorrectionSummary
    notes: tuple[Note, ...]  #: limits of the headings, and other notes on them

    def as_dict(self, spell: Spelling = python_arguments) -> dict[str, Any]:
        """JSON-ready fields."""
        claim = self.claim
        return {
            **self.voyage.as_dict(),
            "formula": self.compass.formula,  # formula of the tilt compensation
            # expected error of a level vehicle, with the dip for which it holds
            "heading_error_deg": _error(claim.level, bound_95=claim.bound_95_deg),
            # expected error at the tilt that 95 % of the readings do not exceed
            "tilted_heading_error_deg": _error(claim.tilted),
            "tilt_error_deg": claim.tilt_error_deg,  # 1 σ error from the accelerometer
            "mounting_error_deg": claim.mounting_error_deg,  # 1 σ error of the mounting; null if not stated
            "dip_from": claim.dip_source,  # ``given``, ``calibration``, ``model``, ``measured`` or ``assumed``
            # from magnetic to true headings; null if headings are magnetic
            "declination_deg": self.compass.declination_deg,
            # from magnetic headings to those from grid north; null unless requested
            "grid_declination_deg": self.compass.grid_declination_deg,
            # field at the place; null if the place is unknown
            "site": None if self.site is None else self.site.as_dict(),
            **self.correction.strength.as_dict(),
            "skipped": [str(entry) for entry in self.correction.skipped],  # lines that were not understood
            **self.correction.preparation.as_dict(),
            "limits": limits_of(self.notes, spell),  # what limits the headings, in words
        }

    def __str__(self) -> str:
        kind = "magnetic" if self.compass.declination_deg is None else "true"
        error, without = self.claim.level, self.voyage.without_heading
        parts = (
            count_text(self.voyage.readings - without, f"{kind} heading"),
            f"{count_text(without, 'reading')} without one" if without else "",
            "no error stated" if error is None else f"error {error.rms:.2g}° rms, {error.worst:.2g}° worst while level",
            limits_in_codes(self.notes),
        )
        return ", ".join(filter(None, parts))

    def __repr__(self) -> str:
        return f"HeadingSummary({self})"


def _error(error: HeadingError | None, **more: float | None) -> dict[str, float] | None:
    """JSON-ready heading error with the conditions for which it holds; None without an error."""
    if error is None:
        return None
    return error.as_dict(**{**more, "dip_deg": error.dip_deg, "tilt_deg": error.tilt_deg})  # type: ignore[arg-type]


@dataclass(eq=False)
class HeadingStream:
    """Headings of a recording, block by block, with a `summary` of the readings so far."""

    correction: CorrectionStream
    compass: Compass
    site: SiteField | None = None
    dip_deg: float | None = None  # dip in degrees that the caller gave; None for the default
    voyage: HeadingSums = field(default_factory=HeadingSums)  # statistics of the readings so far

    @classmethod
    def of(
        cls,
        recording: Recording,
        fit: Fit,
        *,
        site: SiteField | None = None,
        declination_deg: float | None = None,
        dip_deg: float | None = None,
        level: bool = False,
        acceleration: str | None = None,
        acceleration_axes: str = "x,y,z",
        formula: str = "exact",
        at: Mapping[str, float] | None = None,
        by: Filter | None = None,
        grid: bool = False,
    ) -> Self:
        """Headings of a recording in the unit and axes of a fit; the parameters are those of `headings`."""
        if site is not None and declination_deg is not None:
            raise UsageError("a site and a declination both give true north: leave one of them out")
        if grid and site is None:
            raise UsageError(
                "grid north depends on the place: give the site, or leave the grid out", hint={"site": None}
            )
        if level and (formula != "exact" or acceleration is not None):
            raise UsageError("level headings ignore tilt: leave the formula and the acceleration out")
        if acceleration is not None:
            _name_acceleration(recording, acceleration)
        declination_deg = declination_deg if site is None else site.declination_deg
        correction = CorrectionStream.of(recording, fit, at=at, by=by)
        calibration, aiding = correction.fit.calibration, fit.evidence.aiding
        from_grid_deg = site.grid_declination_deg if site is not None and grid else None
        shape = (calibration, LEVEL if level else formula, Axes.of(acceleration_axes))
        compass = Compass(*shape, declination_deg=declination_deg, grid_declination_deg=from_grid_deg)
        if not level and aiding is not None and aiding.acceleration_bias is not None:
            bias, matrix = aiding.acceleration_bias, aiding.acceleration_matrix
            compass = replace(compass, acceleration_bias=bias, acceleration_matrix=matrix)
        return cls(correction, compass, site, dip_deg)

    @property
    def fit(self) -> Fit:
        """Calibration, in the form for compensated readings."""
        return self.correction.fit

    @property
    def recording(self) -> Recording:
        """The recording that is read."""
        return self.correction.recording

    @property
    def corrector(self) -> CorrectionMonitor:
        """Monitor of the lengths of corrected readings."""
        return self.correction.corrector

    def __str__(self) -> str:
        """Description of the recording, with the columns of the accelerometer."""
        if self.compass.formula == LEVEL or not isinstance(self.recording, TextRecording):
            return str(self.recording)
        column = self.recording.layout.columns.of_kind("acceleration")
        return str(self.recording) + ("" if column is None else f"; acceleration {', '.join(column.names)}")

    def headings(self) -> Iterator[tuple[Floats, Samples, Headings]]:
        """Yield line numbers, readings and headings of each block.

        Raises `ForeignAxes` if accelerometer and magnetometer have different axes, and `NoAccelerometer` without one.
        """
        judged_next = MIN_JUDGED_READINGS
        for numbers, recorded in self._numbered_blocks():
            samples = self.correction.prepare(recorded)
            self.corrector(samples.field)
            self._set_gravity(samples)
            headings = self.compass.read(samples)
            self.voyage += HeadingSums.of(headings)
            if self.voyage.readings >= judged_next:
                judged_next = 2 * self.voyage.readings
                self._require_same_axes()
            yield numbers, samples, headings
        self._require_same_axes()

    def _numbered_blocks(self) -> Iterator[tuple[Floats, Samples]]:
        """Yield readings with their line numbers; without lines, with the numbers of the readings."""
        numbered = getattr(self.recording, "numbered_blocks", None)
        if numbered is not None:
            yield from numbered()
            return
        done = 0
        for block in self.recording.blocks():
            yield np.arange(done + 1.0, done + 1.0 + len(block)), block
            done += len(block)

    def _set_gravity(self, samples: Samples) -> None:
        """Determine gravity from the first block that is long enough, so that shaking in later blocks is detected."""
        if self.compass.gravity is not None or samples.acceleration is None or len(samples) < MIN_READINGS:
            return
        with np.errstate(over="ignore", invalid="ignore"):
            length = np.linalg.norm(samples.acceleration, axis=1)
        if np.isfinite(length).any():
            self.compass = replace(self.compass, gravity=float(np.nanmedian(length)))

    def _require_same_axes(self) -> None:
        """Raise `ForeignAxes` if accelerometer and magnetometer have different axes."""
        if self.compass.formula != LEVEL:
            dip_deg = self.site.inclination_deg if self.site else self.dip_deg
            self.voyage.frames.refuse_foreign(site_dip_deg=dip_deg, applied=self.compass.acceleration_axes)

    def site_dip(self) -> tuple[float, DipSource]:
        """Dip in degrees for which errors are stated, and the source of the dip."""
        is_level = self.compass.formula == LEVEL
        is_seen = not is_level and self.voyage.frames.readings
        own = self.fit.heading_error_deg.dip_deg
        known: dict[DipSource, float | None] = {
            "given": self.dip_deg,
            "calibration": own if is_level and self.fit.claim.plane == "xy" else None,
            "model": self.site.inclination_deg if self.site else None,
            "measured": self.voyage.frames.dip_deg[0] if is_seen else None,
            "assumed": ASSUMED_DIP_DEG,
        }
        finite = ((source, dip) for source, dip in known.items() if dip is not None and math.isfinite(dip))
        source, dip = next(finite)
        return float(np.clip(dip, -MAX_DIP_DEG, MAX_DIP_DEG)), source

    def down_in_body(self) -> Floats:
        """(3,) downward direction of the level vehicle, in corrected axes."""
        return np.array([0.0, 0.0, -1.0 if self.voyage.is_z_up else 1.0])

    def claim(self) -> HeadingClaim:
        """Expected heading errors at the dip of the site, for the level vehicle and at the recorded tilt."""
        dip_deg, source = self.site_dip()
        aiding = self.fit.evidence.aiding
        claim = HeadingClaim(
            dip_deg,
            source,
            tilt_error_deg=self._tilt_error_deg(),
            mounting_error_deg=None if aiding is None else aiding.alignment_error_deg(dip_deg),
        )
        if not self.fit.claim.states_uncertainty:
            return claim
        ellipsoid, covariance = self.fit.calibration.ellipsoid, self.fit.claim.claimed_covariance
        at: dict[str, Any] = {
            "dip_deg": dip_deg,
            "down": self.fit.calibration.rotation_matrix.T @ self.down_in_body(),  # in the ellipsoid's own axes
        }
        tilt_deg = self.voyage.tilt_deg
        return replace(
            claim,
            level=level_error(ellipsoid, covariance, **at),
            bound_95_deg=level_bound_deg(ellipsoid, covariance, **at),
            tilted=tilted_error(ellipsoid, covariance, tilt_deg=tilt_deg, **at) if tilt_deg >= 1.0 else None,
        )

    def _tilt_error_deg(self) -> float | None:
        """Scatter of headings by the measured tilt, 1 σ in degrees: scatter of the dip times the tangent of the dip."""
        frames = self.voyage.frames
        if self.compass.formula == LEVEL or not frames.readings:
            return None
        dip, scatter = frames.dip_deg
        return min(scatter * abs(math.tan(math.radians(dip))), 180.0)

    def summary(self) -> HeadingSummary:
        """Summary of the headings so far."""
        correction, claim = self.correction.summary(), self.claim()
        notes = heading_notes(self.voyage, self.compass, self.site, claim, correction.notes)
        return HeadingSummary(self.voyage, self.compass, self.site, claim, correction, notes)


def _name_acceleration(recording: Recording, columns: str) -> None:
    """Set the columns of the accelerometer in a text recording."""
    if not isinstance(recording, TextRecording):
        raise UsageError(
            f"{recording.source} is no text, so that its columns are known: leave the columns of the accelerometer out",
            hint={"acceleration": None},
        )
    recording.name_acceleration(columns)
