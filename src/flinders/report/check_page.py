"""The check of a calibration on another recording, as a page for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.errors import in_python
from flinders.report.comparison_pages import of_comparison, of_untold
from flinders.workflows.onboard import NAME

if TYPE_CHECKING:
    from rich.console import RenderableType

    from flinders.errors import Spelling
    from flinders.workflows.checking import Check


def of_check(checked: Check, spell: Spelling = in_python) -> RenderableType:
    """Lay out a check: the comparison; of a recording that cannot be fitted, what it tells all the same."""
    if checked.comparison is None or checked.fresh_strength is None:
        return of_untold(checked.known, checked.fresh, checked.strength, spell)
    strengths = checked.strength, checked.fresh_strength
    own, fresh = checked.made_from, checked.fresh
    name = NAME if checked.known.provenance.name == NAME else "the calibration"
    return of_comparison(checked.comparison, spell, fresh=fresh, strengths=strengths, own=own, name=name)
