"""Calibrations of accelerometers and gyros in the form of each target that can represent them.

A calibration is ``corrected = matrix (raw − offset)``. Each form states which part of the matrix it can represent. The
target's own formula, with the numbers as written, is tried on gravity in all directions, and the tilt that results is
stated.

>>> sensor = Inertial(Triad(np.diag([0.995, 1.005, 1.0]), [0.2, -0.1, 0.3], "m/s2"))
>>> def halves(triad, asked):
...     return Numbers(lambda raw: raw - triad.offset, {"zero": triad.offset.tolist()})
>>> form = InertialForm(formula="c = m - zero", source="nobody", accelerometer=halves, holds="offset")
>>> write_inertial(form, sensor, who="a toy").checked
'checked: its own formula at rest in 400 attitudes, at most 0.29° of tilt and 0.50 % of length off'
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np

from flinders.core.inertial import STANDARD_GRAVITY, Inertial, Triad
from flinders.errors import NotExportable, figures
from flinders.geometry.sphere import fibonacci
from flinders.targets._numbers import round_to_single

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from flinders.arrays import Floats
    from flinders.core.inertial_record import InertialUnit

Holds: TypeAlias = Literal["all", "gains", "offset"]
"""Part of a calibration that a form can represent: offset and matrix, offset and three gains, or the offset alone."""

ATTITUDES: Final = fibonacci(400)
"""(400, 3) directions of gravity."""
MAX_TILT_DEG: Final = 0.5
"""Largest tilt in degrees that parts which a form omits may cause without `lossy`."""
NEGLIGIBLE_DEG, NEGLIGIBLE_SHARE = 1e-4, 1e-5


class Asked(NamedTuple):
    """Options of a form other than the numbers."""

    imu: int | None = None  # number of the IMU on the target; None for its first
    name: str | None = None  # prefix of names in generated code


FIRST_IMU: Final = Asked()


@dataclass(frozen=True, slots=True, eq=False)
class Numbers:
    """A correction in the form of a target."""

    apply: Callable[[Floats], Floats]  # formula of the target, with the numbers as they are stored
    values: Mapping[str, Any]  # numbers by their names on the target
    body: Sequence[str] = ()  # lines of the file; empty for a form in JSON


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialForm:
    """Form in which a target represents the calibrations of an accelerometer and a gyro."""

    formula: str  # formula that uses the numbers
    source: str  # source of the formula
    accelerometer: Callable[[Triad, Asked], Numbers] | None = None
    gyro: Callable[[Triad, Asked], Numbers] | None = None
    unit: InertialUnit | None = "m/s2"  # unit of the accelerations that are corrected; None for any unit
    gives: float | None = 1.0  # m/s² per unit of the output; None if the length of the output has no meaning
    holds: Holds = "all"  # part of an accelerometer's calibration that it represents
    holds_rates: Holds = "all"  # part of a gyro's calibration that it represents
    is_json: bool = False  # whether names and values are members of the only object in the file
    is_alone: bool = True  # whether they make a file without a magnetometer's calibration
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class InertialWritten:
    """Calibrations of an accelerometer and a gyro, as written for a target."""

    body: tuple[str, ...]
    values: dict[str, Any]
    notes: tuple[str, ...]
    checked: str  # errors of the formula, in words; empty without an accelerometer
    figures: dict[str, float]  # the same errors as numbers
    warnings: tuple[str, ...]


def write_inertial(
    form: InertialForm, inertial: Inertial, *, who: str, asked: Asked = FIRST_IMU, lossy: bool = False
) -> InertialWritten:
    """Write calibrations of an accelerometer and a gyro for a target, and check them with the target's own formula.

    Parameters
    ----------
    who : str
        Name of the target, for messages.
    asked : Asked
        Number of the IMU, and prefix of names in code.

    Raises
    ------
    UnitError
        If the form would need a conversion between counts and a unit.
    NotExportable
        For numbers that the target cannot represent, and for a tilt above 0.5° unless `lossy`.
    """
    body: list[str] = []
    values: dict[str, Any] = {}
    warnings, checked, deviation = list[str](), "", dict[str, float]()
    if inertial.accelerometer is not None and form.accelerometer is not None:
        triad = _in_unit(inertial.accelerometer, form, who)
        numbers = form.accelerometer(triad, asked)
        deviation = _deviation(triad, numbers.apply, form.gives)
        _refuse_lost(deviation["tilt_deg"], form, who, lossy=lossy)
        checked = _words(deviation)
        body += numbers.body
        values |= numbers.values
        warnings += _claims(inertial, _tilts(triad, numbers.apply))
    if inertial.gyro is not None and form.gyro is not None:
        numbers = form.gyro(inertial.gyro, asked)
        body += numbers.body
        values |= numbers.values
        warnings += _rates(inertial.gyro, form)
    sensors = [name for name in ("accelerometer", "gyro") if getattr(inertial, name) and getattr(form, name)]
    notes = (f"{' and '.join(sensors)}: {form.formula}", *form.notes)
    return InertialWritten(tuple(body), values, notes, checked, deviation, tuple(warnings))


def _in_unit(triad: Triad, form: InertialForm, who: str) -> Triad:
    """Correction of an accelerometer for readings in the unit of the target."""
    return triad if form.unit is None else triad.convert(form.unit, who=who)


def _deviation(triad: Triad, apply: Callable[[Floats], Floats], gives: float | None) -> dict[str, float]:
    """Errors of a formula at rest: largest tilt in degrees, and largest relative error of the length."""
    length = np.linalg.norm(apply(_at_rest(triad)), axis=1)
    share = 0.0 if gives is None else float(np.abs(length * gives / STANDARD_GRAVITY - 1.0).max())
    return {"attitudes": float(len(ATTITUDES)), "tilt_deg": float(_tilts(triad, apply).max()), "length_share": share}


def _at_rest(triad: Triad) -> Floats:
    """(N, 3) raw readings at rest, in all attitudes."""
    raw: Floats = np.linalg.solve(triad.matrix, STANDARD_GRAVITY * ATTITUDES.T).T + triad.offset
    return raw


def _tilts(triad: Triad, apply: Callable[[Floats], Floats]) -> Floats:
    """(N,) angles in degrees by which a formula tilts the vertical, at rest in all attitudes."""
    corrected = apply(_at_rest(triad))
    sine = np.linalg.norm(np.cross(corrected, ATTITUDES), axis=1) / np.linalg.norm(corrected, axis=1)
    tilts: Floats = np.rad2deg(np.arcsin(np.clip(sine, 0.0, 1.0)))
    return tilts


def _words(deviation: Mapping[str, float]) -> str:
    """The errors of a formula, in words."""
    tilt, share = deviation["tilt_deg"], deviation["length_share"]
    is_small = tilt < NEGLIGIBLE_DEG and share < NEGLIGIBLE_SHARE
    how = "less than" if is_small else "at most"
    off = f"{how} {figures(max(tilt, NEGLIGIBLE_DEG))}° of tilt and {figures(100.0 * max(share, NEGLIGIBLE_SHARE))} %"
    return f"checked: its own formula at rest in {len(ATTITUDES)} attitudes, {off} of length off"


def _refuse_lost(tilt_deg: float, form: InertialForm, who: str, *, lossy: bool) -> None:
    """Raise `NotExportable` if a form tilts the vertical too much, unless `lossy`."""
    room = {"all": "an offset and a matrix", "gains": "an offset and three gains", "offset": "an offset alone"}
    if tilt_deg > MAX_TILT_DEG and not lossy:
        raise NotExportable(
            f"{who} holds {room[form.holds]} of an accelerometer: the omitted parts tilt the vertical by up to "
            f"{figures(tilt_deg)}°",
            beyond=("accelerometer",),
            hint={"lossy": True},
            tilt_deg=tilt_deg,
        )


def _claims(inertial: Inertial, tilts: Floats) -> Iterator[str]:
    """Yield the accuracy of the vertical with the written numbers: its own error plus the `tilts` of the form."""
    if inertial.tilt_error is not None:
        error, bound = inertial.tilt_error, inertial.tilt_error.bound_95 + float(tilts.max())
        sigma = math.hypot(error.rms, float(np.sqrt(np.mean(tilts**2))))
        yield f"the vertical at rest is accurate to {figures(sigma)}° (1 σ; 95 % within {figures(bound)}°)"


def _rates(gyro: Triad, form: InertialForm) -> Iterator[str]:
    """Yield the parts of a gyro's calibration that a form omits."""
    left = np.abs(gyro.matrix - _kept_part(gyro.matrix, form.holds_rates)).max()
    if left > 1e-6:
        yield f"omitted: gains or misalignment of the gyro, up to {figures(100.0 * float(left))} % of a rate"


def _kept_part(matrix: Floats, holds: Holds) -> Floats:
    """(3, 3) part of a matrix that a form can represent."""
    if holds == "all":
        return matrix
    kept: Floats = np.diag(np.diag(matrix)) if holds == "gains" else np.eye(3)
    return kept


def offset_and_gains(triad: Triad) -> tuple[Floats, Floats]:
    """(3,) offset and (3,) gains of an accelerometer for forms without misalignment, as float32."""
    return round_to_single(triad.offset), round_to_single(np.diag(triad.matrix))
