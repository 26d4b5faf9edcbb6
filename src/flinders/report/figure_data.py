"""What figures are made of: a fit as a `View`, and some of the readings that it came from.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> samples = simulate.tumble(seed=1).samples
>>> drawn = FigureData.of(calibrate.fit(samples), samples, most=1000)
>>> len(drawn.raw), drawn.total, drawn.stride, drawn.clock
(1000, 3000, 3, 's')
>>> bool(np.linalg.norm(drawn.corrected, axis=1).std() < 1.1 * drawn.view.noise)
True
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Self

import msgspec
import numpy as np

from flinders.core.compensation import compensated
from flinders.core.joining import in_memory, singles
from flinders.core.units import label
from flinders.diagnostics.random_walk import FEWEST, random_walk_of
from flinders.report.view import lengths_off, view

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.diagnostics.random_walk import RandomWalk
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Plane
    from flinders.report.view import Shown, View

MOST: Final = 10_000
"""Readings that are drawn; of a longer recording every k-th."""


@dataclass(frozen=True, slots=True, eq=False)
class FigureData:
    """A fit and readings, ready to be drawn; fields are in `unit`."""

    view: View | None  # None where there is no fit at all
    whole: Samples  # all readings, without what the calibration follows
    raw: Floats  # (n, 3), every `stride`-th of them
    recorded: Floats  # (n, 3), the same as they were recorded
    driving: dict[str, Floats]  # (n,) what drives the offset, by name, where the calibration follows anything
    when: Floats  # (n,) seconds since the first, or numbers of readings, as `clock` says
    clock: str  # "s" where the recording is one and its time ascends, else "reading"
    is_used: NDArray[np.bool_]  # (n,) those that the fit did not leave out
    total: int  # readings of the whole recording
    stride: int
    unit: str  # "µT" or "counts"
    plane: Plane | None = None  # that of a fit to readings of one plane

    @classmethod
    def of(cls, fit: Fit | None, recording: Recording, *, most: int = MOST) -> Self:
        """Go through a recording once.

        Parameters
        ----------
        fit : Fit or None
            Good, limited or refused; None where the recording gave none.
        recording : Recording
            The readings that were fitted, as they were recorded; `InputError` where they cannot be read, or lack what
            the calibration follows.
        most : int
            Readings that are drawn, at most; the `View` counts them all.
        """
        recorded = in_memory(recording)
        followed = {} if fit is None else {one.name: one for one in fit.calibration.disturbances}
        samples = recorded if fit is None else in_memory(compensated(recording, fit.calibration))
        seen = None if fit is None else _seen(fit, samples)
        is_used = np.ones(len(samples), bool)
        for first, last in () if seen is None else seen.rejected:
            is_used[first : last + 1] = False
        stride = max(1, -(-len(samples) // most))
        when, clock = _when(samples, is_one=len(list(singles(recording))) == 1)
        return cls(
            seen,
            samples,
            samples.field[::stride],
            recorded.field[::stride],
            {
                name: one.numbers(column[::stride])
                for name, one in followed.items()
                if (column := recorded.driving(name)) is not None
            },
            when[::stride],
            clock,
            is_used[::stride],
            len(samples),
            stride,
            label(recording.unit.inside),
            None if fit is None else fit.claim.plane,
        )

    @property
    def shown(self) -> Shown | None:
        """The correction that readings are drawn under; None where there is none."""
        return None if self.view is None else self.view.shown

    @property
    def corrected(self) -> Floats:
        """(n, 3) readings under that correction; empty where there is none."""
        return np.empty((0, 3)) if self.shown is None else _under(self.shown, self.raw)

    def strengths(self, *, is_compensated: bool) -> Floats:
        """(n,) lengths of the corrected readings: with what drives the offset removed, and not."""
        if self.shown is None:
            return np.empty(0)
        strengths: Floats = np.linalg.norm(_under(self.shown, self.raw if is_compensated else self.recorded), axis=1)
        return strengths

    def walk(self, fit: Fit) -> RandomWalk | None:
        """How the offset moved over the seconds of one recording; None without times, or for few readings."""
        time = self.whole.time
        if time is None or self.clock != "s" or self.total < FEWEST or not time[-1] > time[0]:
            return None
        dip = fit.heading_error_deg.dip_deg
        ellipsoid = fit.calibration.ellipsoid
        return random_walk_of(self.whole.field, time - time[0], ellipsoid, plane=self.plane, dip_deg=dip)

    @property
    def shape(self) -> Floats | None:
        """(3, 3) S of the ellipsoid raw = offset + S u that the correction makes a sphere; None where there is none."""
        if self.shown is None:
            return None
        shape: Floats = self.shown.strength * np.linalg.inv(self.shown.matrix)
        return shape

    @property
    def residuals(self) -> Floats:
        """(n,) how much longer each corrected reading is than the field; empty where there is no correction."""
        return np.empty(0) if self.shown is None else lengths_off(self.corrected, self.shown.strength, self.plane)


def _under(shown: Shown, field: Floats) -> Floats:
    """(n, 3) readings under a correction."""
    corrected: Floats = (field - shown.offset) @ np.transpose(shown.matrix)
    return corrected


def _seen(fit: Fit, samples: Samples) -> View:
    """The view, with advice for what is still to be reached: headings, then all attitudes, then nothing."""
    seen = view(fit, samples, goal="heading" if fit.heading_error_deg.worst > fit.claim.target_deg else "attitude")
    return msgspec.structs.replace(seen, guidance=None) if fit.verdict == "good" else seen


def _when(samples: Samples, *, is_one: bool) -> tuple[Floats, str]:
    """Where readings stand along an axis of time, and what its numbers are."""
    time = samples.time
    if time is not None and is_one and len(time) and np.isfinite(time).all() and (np.diff(time) >= 0.0).all():
        return time - time[0], "s"
    return np.arange(1.0, len(samples) + 1.0), "reading"
