"""Calibrates a fleet: recordings of many units are read, and one table of calibrations is written.

>>> from flinders import simulate
>>> from flinders.apps.fleet import fit_many
>>> rows = fit_many({"A17": simulate.tumble(seed=1).samples, "B02": [[1.0, 2.0, 3.0]]})
>>> rows.unit.tolist(), rows.verdict.tolist(), rows.code.tolist()
(['A17', 'B02'], ['good', 'refused'], ['', 'too-few-samples'])

A file, or a range of its row groups, is one unit of work with one output file, so that a stopped run continues where it
stopped. See `docs/fleet/fleet.md`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.core.lazy import lazy_getattr

if TYPE_CHECKING:
    from flinders.apps.fleet.results import UnitResult as UnitResult
    from flinders.apps.fleet.results import UnitResults as UnitResults
    from flinders.apps.fleet.worker import fit_many as fit_many

PUBLIC = {
    "UnitResult": "results",
    "UnitResults": "results",
    "fit_many": "worker",
}

if not TYPE_CHECKING:
    __getattr__ = lazy_getattr(__name__, PUBLIC)
