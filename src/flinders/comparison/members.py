"""Results for several magnetometers of one body: each member, their agreement, and all together.

>>> from flinders.errors import FitError
>>> silent = Member("aft", FitError("no readings"), FitError("no readings"))
>>> MultiFit((silent,), "aft", Agreement(0, 0.0), is_joint=False)["aft"].axes
'x,y,z'
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.comparison.results import json_attributes
from flinders.fitting.result import Fit

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.comparison.agreement import Disagreement
    from flinders.errors import FlindersError
    from flinders.findings import Finding


@dataclass(frozen=True, slots=True, eq=False)
class Member:
    """One of the magnetometers."""

    name: str
    #: fit together with the others, or its error; `Refused` carries a fit that cannot be trusted
    fit: Fit | FlindersError
    alone: Fit | FlindersError  #: fit of this sensor's readings alone, or its error
    #: (3, 3): rotation from the sensor's axes to those of the reference, with determinant −1 if they are mirror images;
    #: None if unknown
    rotation: Floats | None = None
    #: (3,): 1 σ of `rotation` about each axis of the reference
    rotation_sigma_deg: Floats | None = None
    axes: str = "x,y,z"  #: exchange of axes that is nearest to `rotation`: the sensor's axis for each reference axis
    misalignment_deg: float = 0.0  #: angle between `rotation` and the exchange `axes`
    length_ratio: float = 1.0  #: ratio of the length of readings to that of the reference's readings
    #: usual error of readings averaged over 1 s, in degrees of a level heading
    scatter_deg: float = 0.0
    delay_s: float = 0.0  #: delay of the sensor's clock behind that of the reference; 0 if not significant
    delay_sigma_s: float = 0.0  #: standard deviation of `delay_s`
    copy_of: str = ""  #: name of the sensor whose readings this one repeats; empty if it has its own
    #: whether `fit` is `alone`, because the joint fit was clearly worse for this sensor; corrected readings are then in
    #: the sensor's own axes
    is_kept: bool = False
    joint_deg: float = 0.0  #: worst heading error of the joint fit, if `is_kept`
    #: findings from the comparison with the others, and those of `fit` if it is a fit
    findings: tuple[Finding, ...] = ()

    @property
    def is_mirrored(self) -> bool:
        """Whether its axes are a mirror image of those of the reference."""
        return self.rotation is not None and bool(np.linalg.det(self.rotation) < 0.0)

    def as_dict(self) -> dict[str, Any]:
        """Values for JSON, by name."""
        return {
            **json_attributes(
                self, "rotation", "rotation_sigma_deg", "axes", "misalignment_deg", "length_ratio", "scatter_deg"
            ),
            **json_attributes(self, "delay_s", "copy_of"),
            # claimed worst heading error of the fit alone
            "alone_heading_error_deg": self.alone.heading_error_deg.worst if isinstance(self.alone, Fit) else None,
            **json_attributes(self, "findings"),
        }


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """Agreement of the magnetometers over time."""

    instants: int  #: count of times at which two or more were read
    seconds: float  #: duration from the first to the last of these times
    disagreements: tuple[Disagreement, ...] = ()  #: stretches of disagreement, in the order of time
    #: for two sensors: constant difference in degrees of heading, 1 σ, if it is unknown which one is wrong; else 0
    apart_deg: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class MultiFit:
    """Several magnetometers of one body."""

    members: tuple[Member, ...]
    reference: str  #: name of the sensor whose axes all corrected readings have
    agreement: Agreement
    #: whether the sensors were fitted together, except those with `Member.is_kept`. If the body was turned too little,
    #: only one sensor remains, or two disagree all the time, each has the fit of its own readings.
    is_joint: bool
    #: whether corrected readings are in the axes of gyro and accelerometer, instead of those of the reference
    in_body: bool = False

    def __getitem__(self, name: str) -> Member:
        """The member with a name."""
        return next(member for member in self.members if member.name == name)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, without the fits of the members."""
        names = [member.name for member in self.members]
        runs = [
            {**run.as_dict(), "sensor": None if run.sensor is None else names[run.sensor]}
            for run in self.agreement.disagreements
        ]
        known = json_attributes(self, "reference", "is_joint", "in_body") | json_attributes(
            self.agreement, "instants", "seconds"
        )
        return {**known, "disagreements": runs}  # stretches of time, in their order
