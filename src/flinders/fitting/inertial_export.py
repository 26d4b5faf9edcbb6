"""An accelerometer and a gyro written for a target: beside the calibration of a magnetometer, or by themselves.

A fit with aiding sensors has both in the axes in which it corrects; a target that corrects readings as they were
recorded gets them in those. What an autopilot logs is after its own calibration, and is not written back to it.

>>> import numpy as np
>>> from flinders.core.inertial import Triad
>>> from flinders.targets import find
>>> sensor = Inertial(Triad(np.diag([0.99, 1.01, 1.0]), [0.2, -0.1, 0.3], "m/s2"))
>>> print(alone(find("yaml"), sensor).text.splitlines()[0])
# plain YAML: corrected = matrix (raw - offset)
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from flinders.core.inertial import Inertial
from flinders.errors import NotExportable, UsageError
from flinders.targets import Export, registry
from flinders.targets._inertial import FIRST, written
from flinders.targets._numbers import unmapped

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.inertial import Triad
    from flinders.fitting.result import Fit
    from flinders.targets import Target
    from flinders.targets._inertial import Asked, InertialForm, InertialWritten

SENSORS: Final = ("accelerometer", "gyro")
"""What can be written beside a magnetometer."""


def inertial_of(fit: Fit, target: Target, sensors: Sequence[str]) -> Inertial:
    """What a fit found of these sensors, in the axes of the target; nothing where none is asked for.

    Raises
    ------
    UsageError
        For sensors that are not known, that the target does not hold, or that the fit found nothing of.
    NotExportable
        For a fit to an autopilot's log, and for that autopilot: its accelerations are after the calibration on board.
    """
    if not sensors:
        return Inertial()
    form_of(target, sensors)
    aiding = fit.evidence.aiding
    found = Inertial() if aiding is None else aiding.inertial()
    for name in sensors:
        if getattr(found, name) is None:
            aid = {"accelerometer": "dip", "gyro": "rate"}[name]
            raise UsageError(
                f"{fit.provenance.name} knows nothing of the {name}: calibrate with {aid}, or the accelerometer by "
                "itself with flinders accelerometer",
                hint={"aiding": aid},
            )
    if any(file.autopilot == target.family for file in fit.provenance.files):
        raise NotExportable(
            f"accelerations and rates of {fit.provenance.name} are as {target.title} logs them, after the calibration "
            f"on board: what was found comes on top of that, and {target.title} would put it in its place",
            beyond=tuple(sensors),
        )
    accelerometer, gyro = (
        _in_axes(own, fit, target) if own is not None and name in sensors else None
        for name, own in zip(SENSORS, (found.accelerometer, found.gyro), strict=True)
    )
    return replace(found, accelerometer=accelerometer, gyro=gyro)


def form_of(target: Target, sensors: Sequence[str]) -> InertialForm:
    """Form in which a target holds accelerometer or gyro; `UsageError` where it holds none, or for another sensor."""
    unknown = [name for name in sensors if name not in SENSORS]
    if unknown:
        raise UsageError(f"sensor {unknown[0]!r} is not known: use {' or '.join(SENSORS)}")
    lacking = [name for name in sensors if target.inertial is None or getattr(target.inertial, name) is None]
    if target.inertial is None or lacking:
        takes = [each.name for each in registry().values() if each.inertial and getattr(each.inertial, lacking[0])]
        raise UsageError(f"{target.title} holds no {lacking[0]} here: {', '.join(takes)} do", hint={"target": None})
    return target.inertial


def beside(export: Export, target: Target, inertial: Inertial, asked: Asked = FIRST, *, lossy: bool = False) -> Export:
    """An export of a magnetometer's calibration with that of an accelerometer and a gyro; raises as `written`."""
    if not inertial or target.inertial is None:
        return export
    form = target.inertial
    made = written(form, inertial, who=target.title, asked=asked, lossy=lossy)
    if form.is_json:
        text = json.dumps({**json.loads(export.text), **made.values}, indent=1, default=_listed) + "\n"
    else:
        remarks = [*made.notes, *made.warnings, *([made.checked] if made.checked else [])]
        comments = target.comment.lines(remarks) if target.comment else []
        text = export.text + "\n".join([*comments, *made.body, ""])
    fields = {**export.fields, "inertial": _fields(form, made)}
    checked = (
        f"{export.checked}; accelerometer: {made.checked.removeprefix('checked: ')}" if made.checked else export.checked
    )
    return replace(export, text=text, fields=fields, checked=checked, warnings=(*export.warnings, *made.warnings))


def alone(target: Target, inertial: Inertial, asked: Asked = FIRST, *, lossy: bool = False) -> Export:
    """An accelerometer and a gyro by themselves, as far as the target holds them.

    Raises
    ------
    UsageError
        For a target that holds neither, or in one file with its magnetometer alone.
    NotExportable, UnitError
        As `flinders.targets._inertial.written`.
    """
    form = form_of(target, ["accelerometer"] if inertial.accelerometer else ["gyro"])
    if not form.is_alone:
        raise UsageError(
            f"a file of {target.title} holds the magnetometer too, and would take its calibration away: calibrate with "
            "dip, and write that with its accelerometer",
            hint={"aiding": "dip"},
        )
    made = written(form, inertial, who=target.title, asked=asked, lossy=lossy)
    remarks = [
        f"{target.title}: {form.formula}",
        *form.notes,
        *made.warnings,
        *([made.checked] if made.checked else []),
    ]
    comments = target.comment.lines(remarks) if target.comment else []
    body = json.dumps(made.values, indent=1, default=_listed).splitlines() if form.is_json else made.body
    text = "\n".join([*comments, *body, ""])
    fields = {"target": target.name, **_fields(form, made)}
    return Export(target.name, text, fields, made.checked, made.warnings, has_comments=bool(comments))


def _fields(form: InertialForm, made: InertialWritten) -> dict[str, Any]:
    """What is written, for programs."""
    return {
        "formula": form.formula,
        "values": dict(made.values),
        "checked": made.figures,
        "notes": list(made.notes),
    }


def _listed(value: Any) -> Any:  # noqa: ANN401 - an array within JSON
    """An array as lists."""
    return value.tolist()


def _in_axes(triad: Triad, fit: Fit, target: Target) -> Triad:
    """The sensor in the axes in which a target corrects it."""
    calibration = fit.calibration
    if calibration.axes.is_identity or target.acts == "mapped":
        return triad
    back = unmapped(calibration)
    recorded = triad.turned(back)
    return recorded if target.acts == "recorded" else replace(recorded, matrix=back.T @ recorded.matrix)
