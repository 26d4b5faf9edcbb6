"""The magnetometer model of x-io's Fusion, for C and Python, and as it was up to version 1.1.

>>> import numpy as np
>>> from flinders.calibration import Calibration
>>> found = Calibration(np.diag([1.25, 1.0, 0.5]), [10.0, -20.0, 30.0], 50.0)
>>> print(render_old(found, target="fusion-1.1").text.splitlines()[-1])
const FusionVector hardIronOffset = {12.5f, -20.0f, 15.0f};
>>> print(render(found, target="fusion").text.splitlines()[-1])
const FusionVector hardIronOffset = {10.0f, -20.0f, 30.0f};
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from flinders.conventions._affine import OWN
from flinders.conventions.fusion import OldModel, of
from flinders.exporters._export import NOTHING_MORE, Asked, Export
from flinders.exporters._sheet import BLOCK, HASH, Sheet, digits

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flinders.arrays import Floats
    from flinders.calibration import Calibration

SHEET: Final = Sheet(
    title="x-io Fusion from 1.2.0 on, C",
    formula="c = S (u - h)",
    unit=OWN,
    keeps="all",
    storage="float32",
    fed=True,
    source="FusionModel.h; before 1.3 FusionCalibration.h",
    comment=BLOCK,
)
PYTHON: Final = replace(SHEET, title="x-io Fusion from 1.3.0 on, Python", storage="float64", comment=HASH)
OLD: Final = replace(
    SHEET,
    title="x-io Fusion up to 1.1, C",
    formula="c = S u - h",
    source="FusionCalibration.h before commit 15e463c",
)


def render(calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE) -> Export:
    """Write the constants for FusionModelMagnetic (FusionCalibrationMagnetic before 1.3), from 1.2.0 on."""
    model = of(calibration)
    body = _constants(model.matrix, model.offset)
    values = {"softIronMatrix": model.matrix, "hardIronOffset": model.offset}
    notes = ["use: FusionModelMagnetic(u, softIronMatrix, hardIronOffset); before 1.3 it is FusionCalibrationMagnetic"]
    return SHEET.export(
        calibration, model.apply, body, target=target, about=about, asked=asked, values=values, notes=notes
    )


def render_old(
    calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE
) -> Export:
    """Write the constants for FusionCalibrationMagnetic up to 1.1, whose offset is another."""
    model = OldModel.of(calibration)
    body = _constants(model.matrix, model.offset)
    values = {"softIronMatrix": model.matrix, "hardIronOffset": model.offset}
    notes = ["use: FusionCalibrationMagnetic(u, softIronMatrix, hardIronOffset); wrong from 1.2.0 on"]
    return OLD.export(
        calibration, model.apply, body, target=target, about=about, asked=asked, values=values, notes=notes
    )


def render_python(
    calibration: Calibration, *, target: str, about: Sequence[str] = (), asked: Asked = NOTHING_MORE
) -> Export:
    """Write the arrays for imufusion.model_magnetic."""
    model = of(calibration)
    rows = [f"        [{_listed(row)}]," for row in model.matrix]
    body = [
        "import numpy as np", "", "soft_iron_matrix = np.array(", "    [", *rows, "    ]", ")",
        f"hard_iron_offset = np.array([{_listed(model.offset)}])",
    ]  # fmt: skip
    values = {"soft_iron_matrix": model.matrix, "hard_iron_offset": model.offset}
    notes = ["use: imufusion.model_magnetic(u, soft_iron_matrix, hard_iron_offset)"]
    return PYTHON.export(
        calibration, model.apply, body, target=target, about=about, asked=asked, values=values, notes=notes
    )


def _constants(matrix: Floats, offset: Floats) -> list[str]:
    rows = [f"    {_listed(row, 'f')}," for row in matrix]
    return [
        "const FusionMatrix softIronMatrix = {", *rows, "};",
        f"const FusionVector hardIronOffset = {{{_listed(offset, 'f')}}};",
    ]  # fmt: skip


def _listed(values: Iterable[float], suffix: str = "") -> str:
    return ", ".join(digits(value, suffix) for value in values)
