"""What the page's verdict takes from the program: rules, sentences, limits, tables, and where a record's fields lie.

JavaScript calculates the quantities (`static/standalone/verdict.js`). It applies the rows of the catalogue of which it
knows all `NAMES`; every other finding of one magnetometer is listed as not checked.

>>> tables = data()
>>> [row["code"] for row in tables["rows"]][:3], "level-plane" in tables["unchecked"]
(['one-plane', 'heading-error', 'corrected-before'], True)
"""

from __future__ import annotations

from string import Formatter
from typing import TYPE_CHECKING, Any, Final

import msgspec

from flinders.core.calibration_file import PARAMETERS
from flinders.core.units import EARTH_UT
from flinders.diagnostics import axis_swap, systematic
from flinders.errors import Unmoved
from flinders.estimators import auto
from flinders.findings import CATALOGUE, CAUSES, OF_ONE_MAGNETOMETER, fit, limit_of
from flinders.findings.row import OF_A_TUMBLE, TUMBLE_STATED
from flinders.fitting import advice, calibrate, result, shrinkage, verdict
from flinders.geometry.sphere import bisected, icosahedron
from flinders.heading import guidance, path_planning
from flinders.live import evaluation
from flinders.native.engine import AXIS_CHANGE, COVERAGE, OPTIONS, OUTLIER, RECORD, constant
from flinders.report.view import tiles_view
from flinders.summary import summary
from flinders.summary.coverage import CELLS

if TYPE_CHECKING:
    from collections.abc import Iterable
    from types import ModuleType

    import numpy as np

    from flinders.findings import CatalogueRow
    from flinders.findings.row import Rule

NAMES: Final = frozenset(
    {
        "again", "alternating_deg", "alternating_limit", "at_rest_share", "attitudes", "axis_lag", "axis_ratio",
        "backward_steps", "correlation", "covered", "distinct", "drift", "drift_allowed_deg", "drift_by_chance",
        "drift_deg", "farthest", "field_strength", "flatness", "flatness_limit", "halves", "hole_deg", "independent",
        "independent_needed", "independent_readings", "independent_share", "inflation", "is_in_counts", "is_planar",
        "is_relative", "is_unaligned", "lag_deg", "leave", "length", "longest_step_s", "movement", "nearest_earth",
        "next_correlation", "noise_lasts", "noise_share", "nonlinear_axis", "nonlinear_deg", "nonlinear_share",
        "nothing", "often", "outlier_share", "outliers", "path_correlation", "prior_share", "radius", "rail_share",
        "rails", "remedy", "repeated_share", "rests", "rests_count", "rings", "rows", "runs", "samples", "step",
        "strongest", "structure_deg", "structure_share", "swap", "swap_gain", "target_deg", "times_outside_earth",
        "uncorrected_deg", "unit", "unlike_correlation", "unobserved", "unsteady_deg", "unsteady_limit_deg",
        "usual_step_s", "weakest", "where_flat", "why", "worst_deg",
    }
)  # fmt: skip
"""Quantities and words that `verdict.js` knows."""

SAID: Final = {
    "one-plane": (
        "all readings lie {where_flat}: also turn the sensor about its other axes, onto its side and upside down. This "
        "page makes no calibration of a level turn: flinders calibrate does"
    )
}
"""Sentences of the page alone, by the code of their finding: where the program can do more."""


def _of(module: ModuleType, names: str, prefix: str = "") -> dict[str, Any]:
    """Numbers of a module, by their names with a prefix that tells them from those of others."""
    return {f"{prefix}{name}": getattr(module, name) for name in names.split()}


NUMBERS: Final = {
    "EARTH_WEAKEST": EARTH_UT[0],
    "EARTH_STRONGEST": EARTH_UT[1],
    "COVERAGE_LIMIT": limit_of("coverage"),
    "OUTLIERS_LIMIT": limit_of("outliers"),
    "WIDEST_OFFSET": shrinkage.OFFSETS[-1],
    **_of(result, "ALIKE"),
    **_of(verdict, "ALTERNATING UNSTEADY SWITCHING STEPS ENOUGH ENOUGH_CORRELATED NOT_BY_CHANCE"),
    **_of(guidance, "BATCH_SHARE EFFORT_DEG"),
    **_of(systematic, "BY_CHANCE"),
    **_of(summary, "FLAT FLATTEST FLAT_NOISE"),
    **_of(advice, "WORTH_IT"),
    **_of(calibrate, "LOOKED_AT SWAP_LAG_ONE"),
    **_of(path_planning, "FLAT STEPS THINNED", "PATH_"),
    **_of(path_planning, "BEAM READINGS_PER_DEG NEAREST_DEG FARTHEST_DEG DEPARTURE ARC_DEG ROUGHEST"),
    **_of(axis_swap, "MAX_NOISE", "SWAP_"),
    **_of(shrinkage, "PROBABLE FARTHEST UNKNOWN"),
    **_of(auto, "FEWEST_LEFT"),
    **_of(evaluation, "STALE_S STALE_ROWS FROZEN_ROWS FROZEN_S LIVELY MOVING STILL_S STILL_DEG"),
    **_of(evaluation, "CONVERGED CONVERGED_FRACTION CONVERGED_S DENSE OFFERED KNOWN_DEG SPEED_DEG"),
}
"""Limits and constants that both languages compare with."""


def data() -> dict[str, Any]:
    """The key ``engine`` of `page.json`, JSON-ready; `static/standalone/data.d.ts` has its type."""
    checked = rows()
    return {
        "layouts": {
            "record": _layout(RECORD),
            "options": _layout(OPTIONS),
            "outlier": {**_layout(OUTLIER), "room": constant("OUTLIERS")},  # runs that are listed
            "change": _layout(AXIS_CHANGE),
            "coverage": _layout(COVERAGE),
        },
        "rows": [_row(row) for row in checked],
        "unchecked": unchecked(),
        "causes": [cause._asdict() for cause in CAUSES],
        "numbers": NUMBERS,
        "said": {**evaluation.SAID, "unmoved": Unmoved.SAID, "every-way": Unmoved.EVERY_WAY},
        "condition": TUMBLE_STATED.partition(":")[0],
        "conditions": OF_A_TUMBLE,
        "parameters": PARAMETERS,
        "disturbed": sorted(evaluation.DISTURBED),
        "at_once": sorted(evaluation.AT_ONCE),
        "informative": evaluation.INFORMATIVE,
        "other_units": evaluation.OTHER_UNITS,
        "poses": [
            {"down": pose.down.tolist(), "words": pose.words, "effort": pose.effort}
            for pose in guidance.POSES["sensor"]
        ],
        "cells": CELLS.tolist(),
        "nodes": bisected(*icosahedron())[0].tolist(),
        "turns": path_planning.TURNS["sensor"],
        "tiles": msgspec.to_builtins(tiles_view()),
        "swaps": axis_swap.SWAPS,
        "shrinkage": {
            "priors": [prior.diagonal().tolist() for prior in shrinkage.PRIORS],
            "departures": shrinkage.DEPARTURES.ravel().tolist(),
            "parameters": shrinkage.PARAMETERS.ravel().tolist(),
            "size": shrinkage.SIZE.tolist(),
        },
    }


def rows() -> list[CatalogueRow]:
    """Rows of the catalogue that the page applies, in the order in which `flinders.fitting.verdict.judge` does."""
    codes = ("alternating", "outliers", *verdict.OF_CALIBRATION, "saturated", *verdict.OF_RECORDING)
    return [row for row in (*fit.ROWS, *(CATALOGUE[code] for code in codes)) if _is_checked(row)]


def unchecked() -> list[str]:
    """Codes of the findings of one magnetometer that the page does not make."""
    checked = {row.code for row in rows()}
    return [row.code for row in OF_ONE_MAGNETOMETER if row.code not in checked]


def _is_checked(row: CatalogueRow) -> bool:
    """Whether the page knows all that a row compares and says."""
    return row.rule.names | set(_fields(row.said)) <= NAMES


def _fields(sentence: str) -> Iterable[str]:
    """Names in the braces of a sentence."""
    return (name for _, name, _, _ in Formatter().parse(sentence) if name)


def _row(row: CatalogueRow) -> dict[str, Any]:
    return {
        "code": row.code,
        "is_of_recording": row.code in verdict.OF_THE_RECORDING,
        "rule": _rule(row.rule),
        "said": SAID.get(row.code, row.said),
        "alarm": row.alarm,
    }


def _rule(rule: Rule) -> dict[str, Any]:
    return {
        "quantity": rule.quantity,
        "comparison": rule.comparison,
        "grades": rule.grades,
        "needs": rule.needs,
        "number": rule.number,
        "limit": rule.limit,
    }


def _layout(struct: np.dtype[np.void]) -> dict[str, Any]:
    """Size of a struct, and offset, kind and count of each of its fields; a count of 0 is a number by itself."""
    fields = {name: struct.fields[name] for name in struct.names or ()} if struct.fields else {}
    places = {
        name: (offset, kind.base.str[1:], kind.shape[0] if kind.shape else 0)
        for name, (kind, offset, *_) in fields.items()
    }
    return {"size": struct.itemsize, "fields": places}
