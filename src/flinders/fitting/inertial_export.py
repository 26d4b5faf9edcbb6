"""Export of the calibration of an accelerometer and a gyro to a target, with a magnetometer or alone.

A fit with aiding sensors has both calibrations in the axes of corrected readings. For a target that corrects recorded
readings they are converted to the recorded axes. An autopilot logs accelerations and rates after its own calibration,
so that a calibration from such a log cannot be exported to that autopilot.

>>> import numpy as np
>>> from flinders.core.inertial import Triad
>>> from flinders.targets import find
>>> sensor = Inertial(Triad(np.diag([0.99, 1.01, 1.0]), [0.2, -0.1, 0.3], "m/s2"))
>>> print(export_inertial(find("yaml"), sensor).text.splitlines()[0])
# plain YAML: corrected = matrix (raw - offset)
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from flinders.core.inertial import Inertial
from flinders.errors import NotExportable, UsageError
from flinders.targets import Export, registry
from flinders.targets._inertial import FIRST_IMU, write_inertial
from flinders.targets._numbers import unmapping_matrix

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.core.inertial import Triad
    from flinders.fitting.result import Fit
    from flinders.targets import Target
    from flinders.targets._inertial import Asked, InertialForm, InertialWritten

SENSORS: Final = ("accelerometer", "gyro")
"""Sensors that can be exported with a magnetometer."""


def inertial_of(fit: Fit, target: Target, sensors: Sequence[str]) -> Inertial:
    """Calibrations of the requested `sensors` by a fit, in the axes of the target; empty without `sensors`.

    Raises
    ------
    UsageError
        For sensors that are unknown, that the target does not hold, or that the fit did not calibrate.
    NotExportable
        For a fit of an autopilot's log with this autopilot as target, because it logs accelerations after its own
        calibration.
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
                f"{fit.provenance.name} has no calibration of the {name}: calibrate the magnetometer with {aid}, or "
                "the accelerometer alone with flinders accelerometer",
                hint={"aiding": aid},
            )
    if any(file.autopilot == target.family for file in fit.provenance.files):
        raise NotExportable(
            f"{fit.provenance.name} was made from accelerations and rates that {target.title} had already corrected. "
            f"Its numbers add to the calibration on board, but {target.title} would replace that calibration by them: "
            "record raw accelerations and rates",
            beyond=tuple(sensors),
        )
    accelerometer, gyro = (
        _in_axes(own, fit, target) if own is not None and name in sensors else None
        for name, own in zip(SENSORS, (found.accelerometer, found.gyro), strict=True)
    )
    return replace(found, accelerometer=accelerometer, gyro=gyro)


def form_of(target: Target, sensors: Sequence[str]) -> InertialForm:
    """Form in which a target holds the calibrations of `sensors`.

    Raises `UsageError` if the target holds none of these, or for an unknown sensor.
    """
    unknown = [name for name in sensors if name not in SENSORS]
    if unknown:
        raise UsageError(f"sensor {unknown[0]!r} is not known: use {' or '.join(SENSORS)}")
    lacking = [name for name in sensors if target.inertial is None or getattr(target.inertial, name) is None]
    if target.inertial is None or lacking:
        takes = [each.name for each in registry().values() if each.inertial and getattr(each.inertial, lacking[0])]
        raise UsageError(f"{target.title} holds no {lacking[0]}: use one of {', '.join(takes)}", hint={"target": None})
    return target.inertial


def add_inertial(
    export: Export, target: Target, inertial: Inertial, asked: Asked = FIRST_IMU, *, lossy: bool = False
) -> Export:
    """Add accelerometer and gyro to the export of a magnetometer's calibration; raises as `write_inertial`."""
    if not inertial or target.inertial is None:
        return export
    form = target.inertial
    made = write_inertial(form, inertial, who=target.title, asked=asked, lossy=lossy)
    if form.is_json:
        text = json.dumps({**json.loads(export.text), **made.values}, indent=1, default=_to_list) + "\n"
    else:
        remarks = [*made.notes, *made.warnings, *([made.checked] if made.checked else [])]
        comments = target.comment.lines(remarks) if target.comment else []
        text = export.text + "\n".join([*comments, *made.body, ""])
    fields = {**export.fields, "inertial": _fields(form, made)}
    checked = (
        f"{export.checked}; accelerometer: {made.checked.removeprefix('checked: ')}" if made.checked else export.checked
    )
    return replace(export, text=text, fields=fields, checked=checked, warnings=(*export.warnings, *made.warnings))


def export_inertial(target: Target, inertial: Inertial, asked: Asked = FIRST_IMU, *, lossy: bool = False) -> Export:
    """Export the calibrations of accelerometer and gyro alone, as far as the target can hold them.

    Raises
    ------
    UsageError
        For a target that holds neither, or holds them only in one file with its magnetometer.
    NotExportable, UnitError
        As `flinders.targets._inertial.write_inertial`.
    """
    form = form_of(target, ["accelerometer"] if inertial.accelerometer else ["gyro"])
    if not form.is_alone:
        raise UsageError(
            f"a file of {target.title} also holds the calibration of the magnetometer, which would be lost: calibrate "
            "the magnetometer with dip, and export that calibration with its accelerometer",
            hint={"aiding": "dip"},
        )
    made = write_inertial(form, inertial, who=target.title, asked=asked, lossy=lossy)
    remarks = [
        f"{target.title}: {form.formula}",
        *form.notes,
        *made.warnings,
        *([made.checked] if made.checked else []),
    ]
    comments = target.comment.lines(remarks) if target.comment else []
    body = json.dumps(made.values, indent=1, default=_to_list).splitlines() if form.is_json else made.body
    text = "\n".join([*comments, *body, ""])
    fields = {"target": target.name, **_fields(form, made)}
    return Export(target.name, text, fields, made.checked, made.warnings, has_comments=bool(comments))


def _fields(form: InertialForm, made: InertialWritten) -> dict[str, Any]:
    """Fields of the export in JSON."""
    return {
        "formula": form.formula,
        "values": dict(made.values),
        "checked": made.figures,
        "notes": list(made.notes),
    }


def _to_list(value: Any) -> Any:  # noqa: ANN401 - an array within JSON
    """An array as nested lists."""
    return value.tolist()


def _in_axes(triad: Triad, fit: Fit, target: Target) -> Triad:
    """Calibration of a sensor in the axes of the readings that a target corrects."""
    calibration = fit.calibration
    if calibration.axes.is_identity or target.acts == "mapped":
        return triad
    back = unmapping_matrix(calibration)
    recorded = triad.map_axes(back)
    return recorded if target.acts == "recorded" else replace(recorded, matrix=back.T @ recorded.matrix)
