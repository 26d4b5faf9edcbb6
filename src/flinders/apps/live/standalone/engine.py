"""Data of the library for the page: sentences of the catalogue, tables, and layouts of structs.

The engine makes the verdict on the page, too; `static/standalone/findings.js` makes the sentences of findings.

>>> tables = data()
>>> [row["code"] for row in tables["rows"]][:3]
['one-plane', 'level-plane', 'heading-error']
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from flinders.core.calibration_file import PARAMETERS
from flinders.core.units import EARTH_FIELD_RANGE_UT
from flinders.diagnostics import axis_swap
from flinders.errors import Unmoved
from flinders.findings import CATALOGUE, limit_of
from flinders.findings.catalogue import ENGINE_FINDINGS, QUANTITIES_OF_A_FIT
from flinders.findings.headline import CAVEAT, LEADS, REACHES, SMALL_ERROR_DEG
from flinders.findings.poses import POSE_WORDS
from flinders.findings.row import CONDITIONS, words_of_conditions
from flinders.findings.words import STEPS, WHY_LARGE, Z_NOT_DOWN, Z_UNKNOWN
from flinders.fitting import advice, diagnosis, refreshing, verdict
from flinders.heading import path_planning
from flinders.native.faults import ANSWERS
from flinders.native.layouts import (
    ADVICE,
    AXIS_CHANGE,
    BELIEF,
    CALIBRATED,
    COVERAGE,
    DIFFERENCE,
    EARLIER,
    GOAL,
    JUDGEMENT,
    OPTIONS,
    OUTLIER,
    RECORD,
    REQUEST,
    ROUTE,
    SITE,
    VERTICAL,
    enum_value,
)

if TYPE_CHECKING:
    from types import ModuleType

    import numpy as np

    from flinders.findings import CatalogueRow, Condition


def _numbers_of(module: ModuleType, names: str, prefix: str = "") -> dict[str, Any]:
    """Constants of a module by name, with a prefix that makes the names unique."""
    return {f"{prefix}{name}": getattr(module, name) for name in names.split()}


NUMBERS: Final = {
    "EARTH_WEAKEST": EARTH_FIELD_RANGE_UT[0],
    "EARTH_STRONGEST": EARTH_FIELD_RANGE_UT[1],
    "COVERAGE_LIMIT": limit_of("coverage"),
    "OUTLIERS_LIMIT": limit_of("outliers"),
    "SMALL_ERROR_DEG": SMALL_ERROR_DEG,
    **_numbers_of(verdict, "MIN_IMPROVEMENT_SIGMAS MAX_OFFSET_SIGMA MIN_SHAPE_SIGMA"),
    **_numbers_of(advice, "MIN_SAVED_SHARE"),
    **_numbers_of(diagnosis, "MAX_DRIFT_READINGS"),
    **_numbers_of(path_planning, "READINGS_PER_DEG"),
    **_numbers_of(axis_swap, "MAX_NOISE", "SWAP_"),
}
"""Limits and constants that Python and JavaScript share."""

STRUCTS: Final = {
    "options": OPTIONS, "record": RECORD, "request": REQUEST, "judgement": JUDGEMENT, "belief": BELIEF, "goal": GOAL,
    "advice": ADVICE, "route": ROUTE, "outlier": OUTLIER, "change": AXIS_CHANGE, "coverage": COVERAGE,
    "site": SITE, "vertical": VERTICAL,
    "earlier": EARLIER, "calibrated": CALIBRATED, "difference": DIFFERENCE,
}  # fmt: skip
"""Structs of flinders.h that the page reads or writes."""


def data() -> dict[str, Any]:
    """Value of the key ``engine`` in `page.json`, JSON-ready; `static/standalone/data.d.ts` has its type."""
    return {
        "layouts": {name: _layout(struct) for name, struct in STRUCTS.items()},
        "listed": enum_value("OUTLIERS"),  # largest number of listed runs of outliers
        "rows": [_row(CATALOGUE[code]) for code in ENGINE_FINDINGS],
        "quantities": QUANTITIES_OF_A_FIT,
        "numbers": NUMBERS,
        "answers": ANSWERS,
        "said": {
            "left-out": CAVEAT,
            "unmoved": Unmoved.MESSAGE,
            "every-way": Unmoved.ALL_DIRECTIONS,
            "to-all-sides": refreshing.MOTION_WORDS,
            "other-recording": refreshing.OTHER_UNIT,
            "other-axes": refreshing.OTHER_AXES,
            "z-elsewhere": Z_NOT_DOWN,
            "z-open": Z_UNKNOWN,
        },
        "conditions": list(CONDITIONS),
        "resting": [words_of_conditions(_conditions(bits)) for bits in range(1 << len(CONDITIONS))],
        "parameters": PARAMETERS,
        "leads": LEADS,
        "reaches": [(None if math.isinf(end) else end, *words) for end, *words in REACHES],
        "steps": STEPS,
        "reasons": WHY_LARGE,
        "poses": POSE_WORDS,
        "turns": path_planning.TURNS,
        "swaps": axis_swap.SWAPS,
    }


def _conditions(bits: int) -> list[Condition]:
    """Conditions of a verdict, by the bits of a judgement."""
    return [code for place, code in enumerate(CONDITIONS) if bits >> place & 1]


def _row(row: CatalogueRow) -> dict[str, Any]:
    """Sentences of a finding of the engine, and the number and the limit that they state."""
    return {
        "code": row.code,
        "said": row.template,
        "why": row.plain.partition(". ")[0],
        "remedy": row.remedy,
        "affects": row.affects,
        "alarm": row.alarm,
        "number": row.rule.number or row.rule.quantity,
        "limit": row.rule.stated_limit,
        "values": row.names,
    }


def _layout(struct: np.dtype[np.void]) -> dict[str, Any]:
    """Size of a struct, and offset, kind and count of each of its fields; a count of 0 means a single number."""
    fields = {name: struct.fields[name] for name in struct.names or ()} if struct.fields else {}
    places = {
        name: (offset, kind.base.str[1:], kind.shape[0] if kind.shape else 0)
        for name, (kind, offset, *_) in fields.items()
    }
    return {"size": struct.itemsize, "fields": places}
