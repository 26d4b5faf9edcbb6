"""`Fit` is the only result: a calibration with what is known of it, and what to know about it.

>>> Finding("noise", "limits", 0.08, 0.05, "record away from iron").as_dict()["code"]
'noise'
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal

import numpy as np

from flinders.coverage import CELLS
from flinders.document import FindingRecord, Fitted, HeadingErrorRecord, write
from flinders.errors import FitError
from flinders.heading import direction_error_deg, raw_error
from flinders.quadric import Ellipsoid
from flinders.units import label

if TYPE_CHECKING:
    import os

    from flinders.arrays import Floats
    from flinders.calibration import Calibration
    from flinders.coverage import Coverage
    from flinders.document import Document, Provenance
    from flinders.heading import HeadingError

Severity = Literal["note", "limits", "refuses"]
Verdict = Literal["good", "limited", "refused"]

_VERDICTS: Final[dict[Severity, Verdict]] = {"note": "good", "limits": "limited", "refuses": "refused"}
_ORDER: Final[tuple[Severity, ...]] = ("refuses", "limits", "note")


@dataclass(frozen=True, slots=True)
class Finding:
    """Something to know about a fit.

    Attributes
    ----------
    code : str
        Stable name, one of `flinders.verdict.CODES`.
    severity : str
        ``note``: good to know; ``limits``: the calibration holds with limits; ``refuses``: it is not given.
    number : float
        What was found; its meaning and unit belong to the code.
    limit : float
        What it was held against.
    advice : str
        What was found, and what to do, in a sentence.
    """

    code: str
    severity: Severity
    number: float
    limit: float
    advice: str

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True)
class Stray:
    """A run of readings that do not belong to the rest.

    Attributes
    ----------
    first, last : int
        Rows, counted from 1.
    rows : int
        Strays among them.
    start, end : float, s
        Times of the first and the last; NaN without time.
    farthest : float
        Largest distance from the ellipsoid, in the unit of the readings.
    """

    first: int
    last: int
    rows: int
    start: float
    end: float
    farthest: float

    def as_dict(self) -> dict[str, int | float | None]:
        """JSON-ready fields; a time that is not known is None."""
        fields = dataclasses.asdict(self)
        return {name: None if value != value else value for name, value in fields.items()}  # noqa: PLR0124

    def __str__(self) -> str:
        rows = f"{self.rows:,} readings" if self.rows > 1 else "a reading"
        if np.isnan(self.start):
            return f"row {self.first}: {rows}" if self.first == self.last else f"rows {self.first}–{self.last}: {rows}"
        return f"{self.start:.1f} s: {rows}" if self.rows == 1 else f"{self.start:.1f}–{self.end:.1f} s: {rows}"


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A calibration, how it was found and how far to trust it.

    Attributes
    ----------
    calibration : Calibration
    method : str
        What was run in the end.
    covariance : (9, 9) float
        Of the offset b and the shape S = F W⁻¹, in the order b₁, b₂, b₃, S₁₁, S₂₂, S₃₃, S₁₂, S₁₃, S₂₃, in the
        square of the calibration's unit. Singular where the method holds some of them.
    noise : float
        Standard deviation of the readings' distance from the ellipsoid, in the calibration's unit.
    samples : int
        Readings used.
    coverage : Coverage
        Directions seen.
    heading_error_deg : HeadingError
        Expected of a level vehicle, 1 σ.
    target_deg : float
        The worst heading error that was asked for.
    held : float
        Share of the least known shape parameter that the prior speaks for, 0 to 1.
    textbook_heading_error_deg : HeadingError
        What the covariance for independent residuals would claim.
    independent_samples : float
        Independent readings that say as much as those used, whose residuals hang together.
    strays : tuple of Stray
        Runs of readings that were rejected.
    unseen : int
        Directions of parameter space of which the readings say nothing; the prior holds them.
    alignment_error_deg : float, optional
        Heading error (1 σ) from a mounting of the stated uncertainty, beside `heading_error_deg`.
    bias_deg : float
        Heading error (rms) that the method's own bias and misfit cost, as far as the readings show; in the covariance.
    findings : tuple of Finding
        Gravest first.
    """

    calibration: Calibration
    method: str
    covariance: Floats
    noise: float
    samples: int
    coverage: Coverage
    heading_error_deg: HeadingError
    target_deg: float = 1.0
    held: float = 0.0
    unseen: int = 0
    alignment_error_deg: float | None = None
    bias_deg: float = 0.0
    textbook_heading_error_deg: HeadingError | None = None
    independent_samples: float = np.inf
    strays: tuple[Stray, ...] = ()
    findings: tuple[Finding, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """``good``, ``limited`` or ``refused``: what the gravest finding says."""
        severities = {finding.severity for finding in self.findings}
        return next((_VERDICTS[severity] for severity in _ORDER if severity in severities), "good")

    @property
    def ellipsoid(self) -> Ellipsoid:
        """The ellipsoid that the calibration makes a sphere."""
        return Ellipsoid(self.calibration.offset, self.calibration.shape)

    @property
    def offset_sigma(self) -> Floats:
        """(3,) standard deviation of the offset, in the calibration's unit."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def uncorrected_heading_error_deg(self) -> HeadingError:
        """What the heading of the same vehicle errs by without the calibration, if the calibration is right."""
        return raw_error(self.ellipsoid, dip_deg=self.heading_error_deg.dip_deg)

    @property
    def uncorrected_strength(self) -> tuple[float, float]:
        """Mean length of the raw readings over the directions recorded, and its spread as a fraction of the mean."""
        readings = self.ellipsoid.centre + CELLS @ self.ellipsoid.shape
        lengths = np.linalg.norm(readings, axis=1)
        mean = float(np.average(lengths, weights=self.coverage.counts))
        spread = float(np.sqrt(np.average((lengths - mean) ** 2, weights=self.coverage.counts)))
        return mean, spread / mean

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: what ``--json`` prints."""
        raw, textbook = self.uncorrected_heading_error_deg, self.textbook_heading_error_deg
        direction = direction_error_deg(self.ellipsoid, self.covariance)
        return {
            "verdict": self.verdict,
            "method": self.method,
            "calibration": self.calibration.as_dict(),
            "heading_error_deg": {
                "rms": self.heading_error_deg.rms,
                "worst": self.heading_error_deg.worst,
                "dip_deg": self.heading_error_deg.dip_deg,
                "target_deg": self.target_deg,
            },
            "uncorrected_heading_error_deg": {"rms": raw.rms, "worst": raw.worst},
            "textbook_heading_error_deg": None if textbook is None else {"rms": textbook.rms, "worst": textbook.worst},
            "alignment_error_deg": self.alignment_error_deg,
            "direction_error_deg": {"rms": direction[0], "worst": direction[1]},
            "noise": self.noise,
            "samples": self.samples,
            "independent_samples": min(self.independent_samples, float(self.samples)),
            "strays": [stray.as_dict() for stray in self.strays],
            "coverage": self.coverage.as_dict(),
            "covariance": self.covariance.tolist(),
            "findings": [finding.as_dict() for finding in self.findings],
        }

    def to_document(self, provenance: Provenance | None = None) -> Document:
        """The calibration file with all of this in it."""
        fitted = Fitted(
            method=self.method,
            samples=self.samples,
            noise=self.noise,
            covariance=tuple(tuple(row) for row in self.covariance.tolist()),
            verdict=self.verdict,
            heading_error_deg=HeadingErrorRecord(
                rms=self.heading_error_deg.rms,
                worst=self.heading_error_deg.worst,
                dip_deg=self.heading_error_deg.dip_deg,
                target_deg=self.target_deg,
            ),
            coverage=self.coverage.as_dict(),
            findings=tuple(FindingRecord(**finding.as_dict()) for finding in self.findings),
        )
        return self.calibration.to_document(fit=fitted, provenance=provenance)

    def save(self, path: str | os.PathLike[str], *, force: bool = False, provenance: Provenance | None = None) -> None:
        """Write the calibration file, whole or not at all.

        Raises
        ------
        OutputExists
            Where there is a file already, unless `force`.
        OutputError
            Where it cannot be written.
        """
        write(self.to_document(provenance), path, force=force)

    def __repr__(self) -> str:
        error = self.heading_error_deg
        noise = f"{self.noise:.3g} {label(self.calibration.unit)}"
        return (
            f"Fit({self.verdict}, {self.method}, heading error {error.rms:.2g}° rms, {error.worst:.2g}° worst, "
            f"noise {noise}, {self.samples:,} readings)"
        )


class Refused(FitError):
    """A fit exists and is not fit for use: `fit` holds it with its findings, for those who want to look."""

    code: ClassVar[str] = "refused"

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        reasons = [finding for finding in fit.findings if finding.severity == "refuses"]
        super().__init__(
            "; ".join(finding.advice for finding in reasons), **{finding.code: finding.number for finding in reasons}
        )
