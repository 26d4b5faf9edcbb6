"""Shots of a survey instrument: readings of its magnetometer and accelerometer, one of both for each shot.

>>> shots = Shots(np.ones((3, 3)), np.ones((3, 3)), groups=np.array([1, 1, 2]))
>>> len(shots[shots.groups == 1]), shots.numbers
(2, (1, 2, 3))
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal, Self

import numpy as np

from flinders.arrays import table
from flinders.core.axes import Axes
from flinders.core.units import Unit
from flinders.errors import ArrayError, NoAccelerometer, UsageError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flinders.arrays import Floats
    from flinders.core.samples import Samples

Pointing = Literal["x", "y", "z"]

UNSTATED: Final = Unit.of()
AS_RECORDED: Final = Axes()

FORWARD_RIGHT_DOWN: Final[dict[Pointing, Axes]] = {"x": Axes(), "y": Axes.of("y,x,-z"), "z": Axes.of("z,x,y")}
"""Forward, right and down of an instrument, by the axis of its laser."""

PROCEDURE: Final = np.array([
    (0, 0), (90, 0), (0, 90), (180, 0), (270, 0), (0, -90),
    (45, 35.26), (135, -35.26), (225, 35.26), (315, -35.26), (45, -35.26), (135, 35.26), (225, -35.26), (315, 35.26),
])  # fmt: skip
"""(14, 2) azimuth and inclination in degrees: to the sides and corners of a cube, each with four rolls 90° apart."""

ROLLS_DEG: Final = np.array([0.0, 90.0, 180.0, 270.0])


@dataclass(frozen=True, slots=True, eq=False)
class Shots:
    """Readings of a survey instrument, one of both sensors for each shot.

    Attributes
    ----------
    magnetic : (N, 3) float, in `unit`
    gravity : (N, 3) float, any unit
        Points down: the opposite of the specific force of `flinders.core.samples.Samples`.
    groups : (N,) int, optional
        Alike for shots in the same direction; None where nobody wrote that down.
    numbers : tuple of int
        What the file calls each shot; by default 1, 2, 3, …
    pointing : str
        Which axis is that of the laser: x, y or z.
    unit : Unit
        Of the magnetometer.
    axes, acceleration_axes : Axes
        How the recorded axes of each sensor were turned into those of the instrument, right-handed.
    source : str

    Raises
    ------
    ArrayError
        For arrays of another shape or length, or values that are not finite.
    """

    magnetic: Floats
    gravity: Floats
    groups: NDArray[np.intp] | None = None
    numbers: tuple[int, ...] = ()
    pointing: Pointing = "x"
    unit: Unit = UNSTATED
    axes: Axes = AS_RECORDED
    acceleration_axes: Axes = AS_RECORDED
    source: str = "shots"

    @classmethod
    def of(cls, samples: Samples, axes: Axes, acceleration_axes: Axes, pointing: Pointing) -> Self:
        """Take each reading of a recording as a shot, in recorded axes; `NoAccelerometer` where it has none."""
        if samples.acceleration is None:
            raise NoAccelerometer(
                f"{samples.source} has no accelerometer: a survey instrument needs columns of both sensors, one shot a "
                "line"
            )
        return cls(
            axes.apply(samples.field), acceleration_axes.apply(-samples.acceleration), pointing=pointing,
            unit=samples.unit, axes=axes, acceleration_axes=acceleration_axes, source=samples.source,
        )  # fmt: skip

    def __post_init__(self) -> None:
        """Check the arrays."""
        for name in ("magnetic", "gravity"):
            object.__setattr__(self, name, table(getattr(self, name), name))
        if not self.numbers:
            object.__setattr__(self, "numbers", tuple(range(1, len(self) + 1)))
        for name in ("gravity", "groups", "numbers"):
            values = getattr(self, name)
            if values is not None and len(values) != len(self):
                raise ArrayError(f"{name} has {len(values)} rows, and magnetic {len(self)}: need one for each shot")
        if self.pointing not in FORWARD_RIGHT_DOWN:
            raise UsageError(f"pointing is {self.pointing!r}: need x, y or z")

    def __len__(self) -> int:
        return len(self.magnetic)

    def __getitem__(self, rows: NDArray[np.bool_]) -> Self:
        """Those of the shots for which (N,) `rows` is true."""
        return replace(
            self,
            magnetic=self.magnetic[rows],
            gravity=self.gravity[rows],
            groups=None if self.groups is None else self.groups[rows],
            numbers=tuple(np.array(self.numbers)[rows].tolist()),
        )
