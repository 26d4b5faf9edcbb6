"""Published recipes, each under its own name, as in papers, data sheets and course notes.

They serve to reproduce a recipe, or to measure its error; `flinders.fit` is better in every case that we know.

- ``recipes``: estimators after their papers; `two_axis_recipe`: mean and scatter of a turn in one plane
- `two_axis_turn`: the use case, a turn in one plane, and plane after plane
- `methods`: every method on one recording, side by side
- `composition`: one turn after another, each with the last calibration loaded
- `budget`, `budget_relations`: stray fields of wires and magnets; `adis16480`: registers of ADIS16480 and 16488
- `simulate_two_axis`: a two-axis compass with known truth; `recovery`: true parameters, and those that the recipe finds
- `pages`, `methods_page`, `budget_page`, `turn_drawing`: pages of the terminal and drawings; ``cli``: commands
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.core.lazy import lazy_getattr

if TYPE_CHECKING:
    from flinders.apps.classic.budget_relations import stray_budget as stray_budget
    from flinders.apps.classic.methods import compare_methods as compare_methods
    from flinders.apps.classic.simulate_two_axis import Polar as Polar
    from flinders.apps.classic.simulate_two_axis import TwoAxis as TwoAxis
    from flinders.apps.classic.simulate_two_axis import swing as swing
    from flinders.apps.classic.two_axis_turn import TwoAxisFit as TwoAxisFit
    from flinders.apps.classic.two_axis_turn import read_turn as read_turn
    from flinders.apps.classic.two_axis_turn import two_axis as two_axis

PUBLIC = {
    "Polar": "simulate_two_axis",
    "TwoAxis": "simulate_two_axis",
    "TwoAxisFit": "two_axis_turn",
    "compare_methods": "methods",
    "read_turn": "two_axis_turn",
    "stray_budget": "budget_relations",
    "swing": "simulate_two_axis",
    "two_axis": "two_axis_turn",
}

if not TYPE_CHECKING:
    __getattr__ = lazy_getattr(__name__, PUBLIC)
