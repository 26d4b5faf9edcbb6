"""Layouts of the structs of `flinders.h`, as rows of NumPy structured arrays.

The members are parsed from the header, which documents them. A record is one row; records of many recordings are rows
of one array.

>>> RECORD["covariance"].shape, RECORD["noise"], "level_worst_deg" in RECORD.names
((81,), dtype('float64'), True)
"""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.native.build import SOURCE_FOLDER

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Records = NDArray[np.void]


def layout(name: str, real: type[np.floating]) -> np.dtype[np.void]:
    """Layout of a struct of flinders.h; `real` is the type of ``flinders_real``."""
    text = (SOURCE_FOLDER / "flinders.h").read_text(encoding="utf-8")
    body = re.sub(r"/\*.*?\*/", "", text.split(f"typedef struct {name} {{")[1].split("}")[0], flags=re.DOTALL)
    kinds = {"uint8_t": np.uint8, "int32_t": np.int32, "int64_t": np.int64, "flinders_real": real}
    members = re.findall(r"(\w+)\s+(\w+)(?:\[([\w *]+)\])?;", body)
    return np.dtype([(field, kinds[kind], _size(count)) for kind, field, count in members], align=True)


def _size(count: str) -> tuple[int, ...]:
    """Shape of a member from its count, a product of numbers or of constants; empty for a scalar."""
    return (math.prod(map(_number, count.split(" * "))),) if count else ()


def _number(word: str) -> int:
    """Value of a number or a constant; if the header defines a constant twice, the first, which is for computers."""
    if word.isdecimal():
        return int(word)
    headers = "".join((SOURCE_FOLDER / name).read_text(encoding="utf-8") for name in ("flinders_rules.h", "flinders.h"))
    found = re.search(rf"#define {word} (\d+)", headers)
    assert found is not None
    return int(found[1])


RECORD: Final = layout("flinders_record", np.float64)
"""Layout of a record."""

SUMS: Final = layout("flinders_sums", np.float64)
"""Layout of the sums of a recording; those of two recordings can be added."""

OPTIONS: Final = layout("flinders_options", np.float64)
"""Layout of the options of a fit."""

REQUEST: Final = layout("flinders_request", np.float64)
"""Layout of the request of a judgement."""

JUDGEMENT: Final = layout("flinders_judgement", np.float64)
"""Layout of a judgement."""

DISTURBANCE: Final = layout("flinders_disturbance", np.float64)
"""Layout of a regression on a disturbance."""

EARLIER: Final = layout("flinders_earlier", np.float64)
"""Layout of an earlier calibration as prior knowledge."""

CALIBRATED: Final = layout("flinders_calibrated", np.float64)
"""Layout of a calibration to compare."""

DIFFERENCE: Final = layout("flinders_difference", np.float64)
"""Layout of the difference of two calibrations."""

BELIEF: Final = layout("flinders_belief", np.float64)
"""Layout of the knowledge before the next reading."""

GOAL: Final = layout("flinders_goal", np.float64)
"""Layout of the goal of guidance."""

ADVICE: Final = layout("flinders_advice", np.float64)
"""Layout of the advice where to turn next."""

ROUTE: Final = layout("flinders_route", np.float64)
"""Layout of a path of directions."""

OUTLIER: Final = layout("flinders_outlier", np.float64)
"""Layout of a run of outliers."""

AXIS_CHANGE: Final = layout("flinders_axis_change", np.float64)
"""Layout of exchanges of axes."""

COVERAGE: Final = layout("flinders_coverage", np.float64)
"""Layout of the coverage of directions."""

SITE: Final = layout("flinders_site", np.float64)
"""Layout of the field of a place."""

VERTICAL: Final = layout("flinders_vertical", np.float64)
"""Layout of sums of accelerometer readings of a level turn."""

HEIGHTS: Final = layout("flinders_heights", np.float64)
"""Layout of the plane of a level turn."""

ONLINE: Final = layout("flinders_online", np.float64)
"""Layout of an online calibration."""

ONLINE_CLAIM: Final = layout("flinders_online_claim", np.float64)
"""Layout of the claim of an online calibration at a time."""

UNDETERMINED_STATUS: Final = 7
"""Status of a record whose readings do not determine all parameters, without a prior."""


@cache
def enum_value(name: str) -> int:
    """Value of an enumeration constant ``FLINDERS_name`` of flinders.h."""
    return int(re.findall(rf"FLINDERS_{name} = (\d+)", (SOURCE_FOLDER / "flinders.h").read_text(encoding="utf-8"))[0])


@cache
def defined_value(name: str) -> float:
    """Value of a defined constant ``FLINDERS_name`` of flinders.h."""
    return float(
        re.findall(rf"#define FLINDERS_{name} ([\d.e-]+)", (SOURCE_FOLDER / "flinders.h").read_text(encoding="utf-8"))[
            0
        ]
    )


def empty_row(fields: np.dtype[np.void]) -> Records:
    """One row of a layout filled with zeros; `numpy.zeros` is slower, as it sets each field separately."""
    return np.ndarray((), fields, bytearray(fields.itemsize))
