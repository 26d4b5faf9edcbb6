"""The magnetometer model of x-io's Fusion, for C and Python, and as it was up to version 1.1.

>>> import numpy as np
>>> from flinders.core.calibration import Calibration
>>> from flinders.exporters import Asked
>>> found = Calibration(np.diag([1.25, 1.0, 0.5]), [10.0, -20.0, 30.0], 50.0)
>>> print(write_old(found, Asked()).body[-1])
const FusionVector hardIronOffset = {12.5f, -20.0f, 15.0f};
>>> print(write(found, Asked()).body[-1])
const FusionVector hardIronOffset = {10.0f, -20.0f, 30.0f};
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from flinders.conventions._affine import OWN
from flinders.conventions.fusion import OldModel, of
from flinders.exporters._export import Written
from flinders.exporters._sheet import BLOCK, HASH, Sheet, digits

if TYPE_CHECKING:
    from collections.abc import Iterable

    from flinders.conventions._affine import Affine
    from flinders.core.calibration import Calibration
    from flinders.exporters._export import Asked

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


def write(calibration: Calibration, _asked: Asked) -> Written:
    """Write the constants for FusionModelMagnetic (FusionCalibrationMagnetic before 1.3), from 1.2.0 on."""
    note = "use: FusionModelMagnetic(u, softIronMatrix, hardIronOffset); before 1.3 it is FusionCalibrationMagnetic"
    return _constants(of(calibration), note)


def write_old(calibration: Calibration, _asked: Asked) -> Written:
    """Write the constants for FusionCalibrationMagnetic up to 1.1, whose offset is another."""
    note = "use: FusionCalibrationMagnetic(u, softIronMatrix, hardIronOffset); wrong from 1.2.0 on"
    return _constants(OldModel.of(calibration), note)


def write_python(calibration: Calibration, _asked: Asked) -> Written:
    """Write the arrays for imufusion.model_magnetic."""
    model = of(calibration)
    rows = [f"        [{_listed(row)}]," for row in model.matrix]
    body = [
        "import numpy as np", "", "soft_iron_matrix = np.array(", "    [", *rows, "    ]", ")",
        f"hard_iron_offset = np.array([{_listed(model.offset)}])",
    ]  # fmt: skip
    values = {"soft_iron_matrix": model.matrix, "hard_iron_offset": model.offset}
    return Written(model.apply, body, values, ["use: imufusion.model_magnetic(u, soft_iron_matrix, hard_iron_offset)"])


def _constants(model: Affine | OldModel, note: str) -> Written:
    """Matrix and offset in C."""
    rows = [f"    {_listed(row, 'f')}," for row in model.matrix]
    body = [
        "const FusionMatrix softIronMatrix = {", *rows, "};",
        f"const FusionVector hardIronOffset = {{{_listed(model.offset, 'f')}}};",
    ]  # fmt: skip
    return Written(model.apply, body, {"softIronMatrix": model.matrix, "hardIronOffset": model.offset}, [note])


def _listed(values: Iterable[float], suffix: str = "") -> str:
    return ", ".join(digits(value, suffix) for value in values)
