"""Lines that boards print, by docs/line-shapes.toml: those of a simulated recording, and the numbers in them."""

from __future__ import annotations

import string
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.core.samples import Samples

DOCS: Final = Path(__file__).parents[1] / "docs"
SHAPES: Final[list[dict[str, Any]]] = tomllib.loads((DOCS / "line-shapes.toml").read_text(encoding="utf-8"))["shape"]
IDS: Final = [shape["name"] for shape in SHAPES]
IN_UNIT: Final = {"uT": 1.0, "mG": 10.0, "G": 0.01, "nT": 1000.0, "mT": 1e-3, "T": 1e-6, "": 11.0}
"""Number that stands for 1 µT in each unit; for counts, a sensor with 11 counts per µT."""
WORDS: Final = ("N", "NNE", "SW")


class Printf(string.Formatter):
    """Format of numbers as a sketch prints them: whole numbers rounded, negative hexadecimal ones in 16 bits."""

    def format_field(self, value: Any, spec: str) -> str:  # noqa: ANN401 - as string.Formatter
        if spec[-1:] in tuple("dxX") and not isinstance(value, str):
            value = round(value)
        if spec[-1:] in tuple("xX"):
            value %= 1 << 16
        return str(super().format_field(value, spec))


def printed(shape: dict[str, Any], samples: Samples) -> tuple[list[list[str]], Floats]:
    """Lines of each reading, and the magnetometer's numbers in them."""
    formatter = Printf()
    acceleration, rate = np.asarray(samples.acceleration), np.asarray(samples.rate)
    scale = IN_UNIT[shape["unit"]] / shape.get("count", 1.0)
    readings, numbers = [], []
    for row, (field, a, g) in enumerate(zip(samples.field, acceleration, rate, strict=True)):
        values: dict[str, Any] = {f"v{number}": 7.5 * number + 0.25 * row for number in range(1, 30)}
        values |= dict(zip(("mx", "my", "mz"), field * scale, strict=True))
        values |= dict(zip(("cx", "cy", "cz"), field * 13, strict=True))
        values |= dict(zip(("ax", "ay", "az"), a, strict=True)) | dict(zip(("gx", "gy", "gz"), g, strict=True))
        values |= {"qw": 0.9, "qx": 0.1, "qy": 0.3, "qz": -0.3, "heading": 5.0 * row, "pitch": -3.5, "roll": 2.25}
        values |= {"t": 1000 + 20 * row, "n": row, "temp": 23.4}
        values |= {"word": WORDS[row % 3], "word2": WORDS[row % 2]}
        readings.append([formatter.format(line, **values) for line in shape["lines"]])
        numbers.append([_number(shape, formatter, name, values) for name in ("mx", "my", "mz")])
    return readings, np.array(numbers)


def _number(shape: dict[str, Any], formatter: Printf, name: str, values: dict[str, Any]) -> float:
    """A number of the magnetometer, with the digits that were printed."""
    fields = (field for line in shape["lines"] for _, *field in string.Formatter().parse(line))
    spec = next(str(spec) for field, spec, _ in fields if field == name)
    number = float(formatter.format_field(values[name], "d" if spec[-1:] in tuple("xX") else spec))
    return number * float(shape.get("count", 1.0))
