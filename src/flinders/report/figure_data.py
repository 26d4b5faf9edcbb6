"""Data of figures: a fit as a `View`, and some of its readings.

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

from flinders.core.compensation import compensate_recording
from flinders.core.joining import read_into_memory, single_recordings
from flinders.core.units import unit_label
from flinders.diagnostics.random_walk import MIN_READINGS, random_walk_of
from flinders.report.view import excess_lengths, view

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording, Samples
    from flinders.diagnostics.random_walk import RandomWalk
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Plane
    from flinders.report.view import Shown, View

MAX_READINGS: Final = 10_000
"""Largest number of readings that are drawn; of a longer recording, every k-th is drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class FigureData:
    """A fit and its readings, ready to be drawn; fields are in `unit`."""

    view: View | None  # None without a fit
    whole: Samples  # all readings, without modelled disturbances
    raw: Floats  # (n, 3): every `stride`-th of the readings in `whole`
    recorded: Floats  # (n, 3): the same readings as they were recorded
    driving: dict[str, Floats]  # (n,) values of the modelled disturbances, by name
    when: Floats  # (n,): s since the first reading, or the number of the reading, by `clock`
    clock: str  # "s" for a single recording with ascending times, else "reading"
    is_used: NDArray[np.bool_]  # (n,): whether the fit used the reading
    total: int  # number of readings in the whole recording
    stride: int
    unit: str  # "µT" or "counts"
    plane: Plane | None = None  # plane of a fit to readings of one plane

    @classmethod
    def of(cls, fit: Fit | None, recording: Recording, *, most: int = MAX_READINGS) -> Self:
        """Collect the data of a figure in one pass over a recording.

        Parameters
        ----------
        fit : Fit or None
            Good, limited or refused; None for a recording that gave no fit.
        recording : Recording
            The fitted readings, as recorded. `InputError` is raised if they cannot be read or lack a modelled
            disturbance.
        most : int
            Largest number of readings that are drawn; the `View` uses all of them.
        """
        recorded = read_into_memory(recording)
        followed = {} if fit is None else {one.name: one for one in fit.calibration.disturbances}
        samples = recorded if fit is None else read_into_memory(compensate_recording(recording, fit.calibration))
        seen = None if fit is None else _view_with_guidance(fit, samples)
        is_used = np.ones(len(samples), bool)
        for first, last in () if seen is None else seen.rejected:
            is_used[first : last + 1] = False
        stride = max(1, -(-len(samples) // most))
        when, clock = _time_axis(samples, is_one=len(list(single_recordings(recording))) == 1)
        return cls(
            seen,
            samples,
            samples.field[::stride],
            recorded.field[::stride],
            {
                name: one.numbers(column[::stride])
                for name, one in followed.items()
                if (column := recorded.disturbance_values(name)) is not None
            },
            when[::stride],
            clock,
            is_used[::stride],
            len(samples),
            stride,
            unit_label(recording.unit.inside),
            None if fit is None else fit.claim.plane,
        )

    @property
    def shown(self) -> Shown | None:
        """Correction of the drawn readings; None if the fit has none."""
        return None if self.view is None else self.view.shown

    @property
    def corrected(self) -> Floats:
        """(n, 3) corrected readings; empty without a correction."""
        return np.empty((0, 3)) if self.shown is None else _apply_correction(self.shown, self.raw)

    def strengths(self, *, is_compensated: bool) -> Floats:
        """(n,) lengths of corrected readings; with `is_compensated` without the effect of modelled disturbances."""
        if self.shown is None:
            return np.empty(0)
        strengths: Floats = np.linalg.norm(
            _apply_correction(self.shown, self.raw if is_compensated else self.recorded), axis=1
        )
        return strengths

    def random_walk(self, fit: Fit) -> RandomWalk | None:
        """Random walk of the offset within a recording; None without times, or for few readings."""
        time = self.whole.time
        if time is None or self.clock != "s" or self.total < MIN_READINGS or not time[-1] > time[0]:
            return None
        dip = fit.heading_error_deg.dip_deg
        ellipsoid = fit.calibration.ellipsoid
        return random_walk_of(self.whole.field, time - time[0], ellipsoid, plane=self.plane, dip_deg=dip)

    @property
    def shape(self) -> Floats | None:
        """(3, 3) S of the ellipsoid raw = offset + S u, which the correction maps to a sphere; None without one."""
        if self.shown is None:
            return None
        shape: Floats = self.shown.strength * np.linalg.inv(self.shown.matrix)
        return shape

    @property
    def residuals(self) -> Floats:
        """(n,) length of each corrected reading minus the field strength; empty without a correction."""
        return np.empty(0) if self.shown is None else excess_lengths(self.corrected, self.shown.strength, self.plane)


def _apply_correction(shown: Shown, field: Floats) -> Floats:
    """(n, 3) readings after a correction."""
    corrected: Floats = (field - shown.offset) @ np.transpose(shown.matrix)
    return corrected


def _view_with_guidance(fit: Fit, samples: Samples) -> View:
    """View with guidance for the next goal that is not met: headings, then all attitudes; none for a good fit."""
    seen = view(fit, samples, goal="heading" if fit.heading_error_deg.worst > fit.claim.target_deg else "attitude")
    return msgspec.structs.replace(seen, guidance=None) if fit.verdict == "good" else seen


def _time_axis(samples: Samples, *, is_one: bool) -> tuple[Floats, str]:
    """Positions of readings along the time axis, and the unit of its numbers."""
    time = samples.time
    if time is not None and is_one and len(time) and np.isfinite(time).all() and (np.diff(time) >= 0.0).all():
        return time - time[0], "s"
    return np.arange(1.0, len(samples) + 1.0), "reading"
