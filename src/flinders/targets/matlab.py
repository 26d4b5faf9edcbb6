"""A function for MATLAB and Octave that corrects rows of readings, ``C = (D − b) A``, like the results of magcal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.targets._code_text import name_prefix
from flinders.targets._comments import PERCENT
from flinders.targets._numbers import RECORDED, Affine
from flinders.targets._target import ExportOptions, Target, Written

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration


def write(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the function. A is transposed, since readings are rows; results have the unit of the readings."""
    affine = Affine.of(calibration, RECORDED, who="MATLAB and Octave", acts="across")
    rows = "; ".join(" ".join(f"{value:.17g}" for value in row) for row in affine.matrix.T)
    body = [
        f"function C = {name_prefix('flinders', asked.name)}_correct(D)",
        "  b = [" + " ".join(f"{value:.17g}" for value in affine.offset) + "];",
        f"  A = [{rows}];",
        "  C = bsxfun(@minus, D, b) * A;",
        "end",
    ]
    return Written(affine.apply, body, {"A": affine.matrix.T, "b": affine.offset})


TARGETS: Final = (
    Target(
        name="matlab",
        use="MATLAB and Octave function",
        group="libraries, tools",
        suffix=".m",
        title="MATLAB and Octave",
        formula="C = (D - b) A, one reading per row",
        unit=RECORDED,
        keeps="all",
        storage="double, 17 digits",
        source="MathWorks, magcal",
        acts="across",
        comment=PERCENT,
        named=True,
        write=write,
    ),
)
