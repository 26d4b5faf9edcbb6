"""Magnetometers of one body, as values: each member, how well they agree, and all of them together.

>>> from flinders.errors import FitError
>>> silent = Member("aft", FitError("no readings"), FitError("no readings"))
>>> Together((silent,), "aft", Agreement(0, 0.0), is_joint=False)["aft"].axes
'x,y,z'
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.comparison.results import printed
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
    #: Fit or error: with the others; `Refused` carries the fit where there is one that cannot be trusted
    fit: Fit | FlindersError
    alone: Fit | FlindersError  #: Fit or error: what it finds by itself
    #: (3, 3): from its axes into those of the reference; its determinant is −1 where they are mirror images. None where
    #: it was not found.
    rotation: Floats | None = None
    rotation_sigma_deg: Floats | None = None  #: (3,): standard deviation of that about the axes of the reference
    axes: str = "x,y,z"  #: the nearest way to exchange axes: where each axis of the reference comes from
    misalignment_deg: float = 0.0  #: how far the rotation is from that
    length_ratio: float = 1.0  #: length of its readings over that of the reference's
    #: what its readings, averaged over a second, are usually off, in degrees of a level heading
    scatter_deg: float = 0.0
    delay_s: float = 0.0  #: by how much its clock is behind that of the reference, where that is proven
    delay_sigma_s: float = 0.0  #: its standard deviation
    copy_of: str = ""  #: the sensor whose readings it repeats; nothing where it has its own
    #: `fit` is `alone`, since with the others it was known clearly worse: corrected readings are in its own axes
    is_kept: bool = False
    joint_deg: float = 0.0  #: worst heading error with the others, of one that was kept
    findings: tuple[Finding, ...] = ()  #: what the others tell of it; those of `fit`, too, where that is a fit

    @property
    def is_mirrored(self) -> bool:
        """Its axes are a mirror image of those of the reference."""
        return self.rotation is not None and bool(np.linalg.det(self.rotation) < 0.0)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            **printed(
                self, "rotation", "rotation_sigma_deg", "axes", "misalignment_deg", "length_ratio", "scatter_deg"
            ),
            **printed(self, "delay_s", "copy_of"),
            # worst heading error that it claims by itself
            "alone_heading_error_deg": self.alone.heading_error_deg.worst if isinstance(self.alone, Fit) else None,
            **printed(self, "findings"),
        }


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How well the magnetometers agree."""

    instants: int  #: at which two or more were read
    seconds: float  #: from the first of those to the last
    disagreements: tuple[Disagreement, ...] = ()  #: stretches in which they do not, in the order of time
    #: of two: how far apart they are all the time, in degrees of heading, 1 σ, where nothing tells which is off; else 0
    apart_deg: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """Several magnetometers of one body."""

    members: tuple[Member, ...]
    reference: str  #: whose axes corrected readings of all are in
    agreement: Agreement
    #: the fits rest on all of them, but for those that are kept. Where the body was turned too little for that, none
    #: but one is left, or two disagree all the time, each has what it finds by itself.
    is_joint: bool
    #: corrected readings of all are in the axes of gyro and accelerometer, and not in those of the reference
    in_body: bool = False

    def __getitem__(self, name: str) -> Member:
        """One of them, by its name."""
        return next(member for member in self.members if member.name == name)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: what there is beside the fit of each."""
        names = [member.name for member in self.members]
        runs = [
            {**run.as_dict(), "sensor": None if run.sensor is None else names[run.sensor]}
            for run in self.agreement.disagreements
        ]
        known = printed(self, "reference", "is_joint", "in_body") | printed(self.agreement, "instants", "seconds")
        return {**known, "disagreements": runs}  # stretches of time, in their order
