"""Comparison of several recordings of one sensor with each other.

Each recording is fitted separately. If the fits scatter by more than they claim, something changed between recordings:
a battery was moved, the place is another one, the cover was put on. The residuals of a joint fit hardly show this.

>>> from flinders.geometry.ellipsoid import Ellipsoid
>>> sphere, moved = (Ellipsoid(np.array([x, 0.0, 0.0]), 50.0 * np.eye(3)) for x in (0.0, 3.0))
>>> claimed = np.diag([0.01] * 9)
>>> days = RecordingFit("monday", 500, sphere, claimed), RecordingFit("tuesday", 500, moved, claimed)
>>> repeats = compare_recordings(days, dip_deg=60.0)
>>> repeats.most_deviating.source, round(repeats.most_deviating.difference_deg), repeats.p_value < 1e-6
('monday', 7, True)
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.heading.error_propagation import level_error
from flinders.summary.pooling import chi_square_of, differences_from_others, p_value_of, pool

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.arrays import Floats
    from flinders.geometry.ellipsoid import Ellipsoid


@dataclass(frozen=True, slots=True, eq=False)
class RecordingFit:
    """Separate fit of one recording of several."""

    source: str
    samples: int  #: readings used
    ellipsoid: Ellipsoid
    covariance: Floats  #: (9, 9): covariance of offset b and shape S, in unit²

    @property
    def parameters(self) -> Floats:
        """(9,) offset and shape."""
        return self.ellipsoid.parameters


@dataclass(frozen=True, slots=True)
class Repeat:
    """Comparison of one recording with the others."""

    source: str  #: name of the recording
    samples: int  #: readings used
    claimed_deg: float  #: worst level heading error that the separate fit claims, 1 σ
    difference_deg: float  #: worst level heading difference of this recording from the others
    difference_sigma_deg: float  #: standard deviation of `difference_deg` by both claims
    offset_difference: float  #: distance of the offset from that of the others, in the unit of the readings
    p_value: float  #: probability that one of so many recordings differs as much by chance, over all nine parameters


@dataclass(frozen=True, slots=True, eq=False)
class Repeats:
    """Comparison of recordings of one sensor."""

    #: comparison of each recording with the others, in the order given; recordings without a separate fit are left out
    parts: tuple[Repeat, ...]
    scatter: Floats  #: (9, 9): covariance that the scatter adds to that of a joint fit, in unit²
    scatter_deg: float  #: worst level heading error (1 σ) from the scatter alone
    p_value: float  #: probability of as much scatter by chance

    @property
    def most_deviating(self) -> Repeat:
        """The recording with the smallest p-value."""
        return min(self.parts, key=lambda part: (part.p_value, -part.difference_deg))

    def as_dict(self) -> dict[str, Any]:
        """Values for JSON, by name."""
        return {
            "p_value": self.p_value,
            "scatter_deg": self.scatter_deg,
            "parts": [dataclasses.asdict(part) for part in self.parts],
        }


def compare_recordings(parts: Sequence[RecordingFit], *, dip_deg: float) -> Repeats:
    """Compare two or more recordings of one sensor; headings are those of a level vehicle at `dip_deg`."""
    parameters, covariances = [part.parameters for part in parts], [part.covariance for part in parts]
    together = pool(parameters, covariances)
    middle = parts[0].ellipsoid
    repeats = []
    for part, (off, covariance) in zip(parts, differences_from_others(parameters, covariances), strict=True):
        alone = p_value_of(*chi_square_of(off, covariance))
        repeats.append(
            Repeat(
                source=part.source,
                samples=part.samples,
                claimed_deg=level_error(part.ellipsoid, part.covariance, dip_deg=dip_deg).worst,
                difference_deg=level_error(part.ellipsoid, np.outer(off, off), dip_deg=dip_deg).worst,
                difference_sigma_deg=level_error(part.ellipsoid, covariance, dip_deg=dip_deg).worst,
                offset_difference=float(np.linalg.norm(off[:3])),
                p_value=min(1.0, alone * len(parts)),
            )
        )
    return Repeats(
        parts=tuple(repeats),
        scatter=together.prediction_scatter,
        scatter_deg=level_error(middle, together.prediction_scatter, dip_deg=dip_deg).worst,
        p_value=together.p_value,
    )
