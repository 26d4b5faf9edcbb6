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

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

import msgspec
import numpy as np

from flinders.core.compensation import compensated
from flinders.core.samples import Samples, singles
from flinders.core.units import label
from flinders.diagnostics.random_walk import FEWEST, random_walk_of
from flinders.report.view import lengths_off, view

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.diagnostics.random_walk import RandomWalk
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Plane
    from flinders.report.view import Shown, View

MOST: Final = 10_000
"""Readings that are drawn; of a longer recording every k-th."""


@dataclass(frozen=True, slots=True, eq=False)
class FigureData:
    """A fit and readings, ready to be drawn.

    Attributes
    ----------
    view : View or None
        None where there is no fit at all.
    whole : Samples
        All readings, without what the calibration follows.
    raw : (n, 3) float, in `unit`
        Every `stride`-th of them.
    recorded : (n, 3) float, in `unit`
        The same as they were recorded.
    driving : dict of str to (n,) float
        What drives the offset, by name, where the calibration follows anything.
    when : (n,) float
        Seconds since the first, or numbers of readings, as `clock` says.
    clock : str
        ``s`` where the recording is one and its time ascends, else ``reading``.
    is_used : (n,) bool
        Those that the fit did not leave out.
    total : int
        Readings of the whole recording.
    stride : int
    unit : str
        ``µT`` or ``counts``.
    plane : str, optional
        That of a fit to readings of one plane.
    """

    view: View | None
    whole: Samples
    raw: Floats
    recorded: Floats
    driving: dict[str, Floats]
    when: Floats
    clock: str
    is_used: NDArray[np.bool_]
    total: int
    stride: int
    unit: str
    plane: Plane | None = None

    @classmethod
    def of(cls, fit: Fit | None, recording: Recording, *, most: int = MOST) -> Self:
        """Go through a recording once.

        Parameters
        ----------
        fit : Fit or None
            Good, limited or refused; None where the recording gave none.
        recording : Recording
            The readings that were fitted, as they were recorded.
        most : int
            Readings that are kept for drawing; the `View` counts them all.

        Raises
        ------
        InputError
            For a recording that cannot be read, or lacks what the calibration follows.
        """
        disturbances = () if fit is None else fit.calibration.disturbances
        recorded, driving = (
            _whole(recording),
            {disturbance.name: _column(recording, disturbance.name) for disturbance in disturbances},
        )
        samples = recorded if fit is None or not disturbances else _whole(compensated(recording, fit.calibration))
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
            {name: values[::stride] for name, values in driving.items()},
            when[::stride],
            clock,
            is_used[::stride],
            len(samples),
            stride,
            label(recording.unit.inside),
            None if fit is None else fit.plane,
        )

    def without_claims(self) -> Self:
        """The same of a calibration that states no uncertainty: nothing is known of the errors to expect."""
        if self.view is None:
            return self
        view = msgspec.structs.replace(
            self.view,
            heading_error_deg=None,
            attitude_limit_deg=None,
            any_attitude_deg=None,
            offset_sigma=None,
            matrix_sigma=None,
            tiles_deg=(None,) * len(self.view.tiles_deg),
            guidance=None,
            turn=None,
        )
        return replace(self, view=view)

    @property
    def shown(self) -> Shown | None:
        """The correction that readings are drawn under; None where there is none."""
        return None if self.view is None else self.view.shown

    @property
    def corrected(self) -> Floats:
        """(n, 3) readings under that correction; empty where there is none."""
        return np.empty((0, 3)) if self.shown is None else _under(self.shown, self.raw)

    def strengths(self, *, is_compensated: bool) -> Floats:
        """(n,) lengths of the corrected readings: with what drives the offset taken off, and not."""
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
        return random_walk_of(self.whole.field, time - time[0], fit.ellipsoid, plane=self.plane, dip_deg=dip)

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
    seen = view(fit, samples, goal="heading" if fit.heading_error_deg.worst > fit.target_deg else "attitude")
    return msgspec.structs.replace(seen, guidance=None) if fit.verdict == "good" else seen


def _whole(recording: Recording) -> Samples:
    """All readings in memory, with their time where every block has it."""
    if isinstance(recording, Samples):
        return recording
    blocks = list(recording.blocks())
    if not blocks:
        return Samples.of(np.empty((0, 3)), unit=recording.unit)
    times = [block.time for block in blocks if block.time is not None]
    return Samples(
        np.concatenate([block.field for block in blocks]),
        unit=blocks[0].unit,
        axes=blocks[0].axes,
        time=np.concatenate(times) if len(times) == len(blocks) else None,
        source=recording.source,
    )


def _column(recording: Recording, name: str) -> Floats:
    """(N,) what drives the offset, of all readings."""
    columns = (block.driving(name) for block in recording.blocks())
    return np.concatenate([column for column in columns if column is not None] or [np.empty(0)])


def _when(samples: Samples, *, is_one: bool) -> tuple[Floats, str]:
    """Where readings stand along an axis of time, and what its numbers are."""
    time = samples.time
    if time is not None and is_one and len(time) and np.isfinite(time).all() and (np.diff(time) >= 0.0).all():
        return time - time[0], "s"
    return np.arange(1.0, len(samples) + 1.0), "reading"
