"""The magnetometer model of x-io's Fusion, for C and Python; also in the form up to version 1.1.

From 1.2.0 on (September 2023) it is ``c = S (u − h)``. Up to 1.1 it was ``c = S u − h``: h is subtracted after the soft
iron. A calibration is corrected = W (raw − b), so

    S = W,   h = W b   (up to 1.1),   h = b   (from 1.2)

>>> from flinders.core.calibration import Calibration
>>> from flinders.targets import find
>>> calibration = Calibration(np.diag([1.25, 1.0, 0.5]), [10.0, -20.0, 30.0], 50.0)
>>> print(find("fusion-1.1").render(calibration).text.splitlines()[-1])
const FusionVector hardIronOffset = {12.5f, -20.0f, 15.0f};
>>> print(find("fusion").render(calibration).text.splitlines()[-1])
const FusionVector hardIronOffset = {10.0f, -20.0f, 30.0f};

Source: xioTechnologies/Fusion, ``FusionCalibration.h`` and its change in commit 15e463c. Numbers are single precision.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.targets._code_text import float32s
from flinders.targets._comments import BLOCK, HASH
from flinders.targets._inertial_forms import FUSION_C, FUSION_PYTHON
from flinders.targets._numbers import OWN, Affine, round_to_single
from flinders.targets._target import ExportOptions, Target, Written

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.calibration import Calibration


def write(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write the constants for FusionModelMagnetic (FusionCalibrationMagnetic before 1.3), from 1.2.0 on."""
    model = _model(calibration).single
    note = "use: FusionModelMagnetic(u, softIronMatrix, hardIronOffset); before 1.3 it is FusionCalibrationMagnetic"
    body, values = _constants(model.matrix, model.offset)
    return Written(model.apply, body, values, [note])


def write_old(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write the constants for FusionCalibrationMagnetic up to 1.1, whose offset is W b."""
    model = _model(calibration)
    with np.errstate(all="ignore"):
        matrix, offset = round_to_single(model.matrix), round_to_single(model.matrix @ model.offset)
    note = "use: FusionCalibrationMagnetic(u, softIronMatrix, hardIronOffset); wrong from 1.2.0 on"
    body, values = _constants(matrix, offset)
    return Written(lambda raw: raw @ matrix.T - offset, body, values, [note])


def write_python(calibration: Calibration, _asked: ExportOptions) -> Written:
    """Write the arrays for imufusion.model_magnetic."""
    model = _model(calibration).single
    rows = [f"        [{float32s(row)}]," for row in model.matrix]
    body = [
        "import numpy as np", "", "soft_iron_matrix = np.array(", "    [", *rows, "    ]", ")",
        f"hard_iron_offset = np.array([{float32s(model.offset)}])",
    ]  # fmt: skip
    values = {"soft_iron_matrix": model.matrix, "hard_iron_offset": model.offset}
    return Written(model.apply, body, values, ["use: imufusion.model_magnetic(u, soft_iron_matrix, hard_iron_offset)"])


def _model(calibration: Calibration) -> Affine:
    """Matrix and offset of the model from 1.2 on, in the recorded axes."""
    return Affine.of(calibration, OWN, who="Fusion")


def _constants(matrix: Floats, offset: Floats) -> tuple[list[str], dict[str, Floats]]:
    """Lines of C with matrix and offset, and both by name."""
    body = [
        "const FusionMatrix softIronMatrix = {",
        *(f"    {float32s(row, 'f')}," for row in matrix),
        "};",
        f"const FusionVector hardIronOffset = {{{float32s(offset, 'f')}}};",
    ]
    return body, {"softIronMatrix": matrix, "hardIronOffset": offset}


FUSION: Final = Target(
    name="fusion",
    use="x-io Fusion from 1.2.0, C",
    group="libraries, tools",
    suffix=".h",
    title="x-io Fusion from 1.2.0 on, C",
    formula="c = S (u - h)",
    unit=OWN,
    keeps="all",
    storage="float32",
    fed=True,
    source="FusionModel.h; before 1.3 FusionCalibration.h",
    comment=BLOCK,
    inertial=FUSION_C,
    write=write,
)
TARGETS: Final = (
    FUSION,
    replace(
        FUSION,
        name="fusion-python",
        use="x-io Fusion from 1.3.0, Python",
        suffix=".py",
        title="x-io Fusion from 1.3.0 on, Python",
        storage="float64",
        comment=HASH,
        inertial=FUSION_PYTHON,
        write=write_python,
    ),
    replace(
        FUSION,
        name="fusion-1.1",
        use="x-io Fusion up to 1.1, C",
        title="x-io Fusion up to 1.1, C",
        formula="c = S u - h",
        source="FusionCalibration.h before commit 15e463c",
        inertial=None,
        write=write_old,
    ),
)
