"""Result of a compass swing: deviation curve, conformity with a limit, half turns, verdict.

>>> from flinders.apps.marine.deviation import conformity, fit
>>> curve = fit(range(0, 360, 45), [1.0, 2.0, 1.5, -0.2, -0.5, -0.8, -1.5, -0.7])
>>> Swing(curve).verdict, Swing(curve, target_deg=0.1).verdict, Swing(curve, conformity=conformity(curve, 2.0)).verdict
('good', 'limited', 'limited')
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flinders.apps.marine.swing_notes import curve_notes
from flinders.errors import python_arguments
from flinders.heading.stationary import hard_iron
from flinders.workflows.notes import limits_of

if TYPE_CHECKING:
    from flinders.apps.marine.compensation import Compensation
    from flinders.apps.marine.deviation import Conformity, Deviation, Expected
    from flinders.apps.marine.legs import LoggedSwing
    from flinders.apps.marine.standards import Standard
    from flinders.core.geomag import SiteField
    from flinders.errors import Spelling
    from flinders.findings import Verdict
    from flinders.heading.stationary import HalfTurn, Rest
    from flinders.workflows.notes import Note


@dataclass(frozen=True, slots=True, eq=False)
class Swing:
    """Deviation of a compass; for a recording also its rests, and the claim of its calibration."""

    deviation: Deviation | None  # deviation curve; None without known headings
    target_deg: float = 1.0  # largest error of half turns, and 1 σ of the curve, that is good enough
    site: SiteField | None = None  # source of the declination
    rests: tuple[Rest, ...] = ()  # stretches of one heading
    halves: tuple[HalfTurn, ...] = ()  # pairs of headings that are half a turn apart
    expected: Expected | None = None  # expected deviation from the uncertainty of the calibration
    rule: Standard | None = None  # rule by which the compass was swung
    conformity: Conformity | None = None  # comparison with a limit; None without a limit
    before: Compensation | None = None  # coefficients before the compass was compensated
    logged: LoggedSwing | None = None  # readings from a boat's log
    doubts: tuple[Note, ...] = ()  # notes on readings that do not fit their calibration

    @property
    def notes(self) -> tuple[Note, ...]:
        """Notes on the curve, those that limit its use first."""
        curve = self.deviation
        return () if curve is None else curve_notes(curve, self.expected, target_deg=self.target_deg)

    @property
    def half_turns_pass(self) -> bool | None:
        """Whether all half turns are within the target; None without half turns."""
        return all(abs(half.error_deg) <= self.target_deg for half in self.halves) if self.halves else None

    @property
    def verdict(self) -> Verdict:
        """Verdict: ``good``, ``limited`` or ``refused``.

        It is ``good`` if no note limits the curve, the curve is within the limit of the rule, and the half turns of a
        recording are within the target. It is ``refused`` if there is no curve and half turns miss the target.
        """
        is_missed = bool(self.rests) and self.half_turns_pass is False
        if self.deviation is None:
            return "refused" if is_missed else "good"
        is_open = self.conformity is not None and self.conformity.verdict != "within"
        return "limited" if is_missed or is_open or limits_of(self.notes) else "good"

    def as_dict(self, spell: Spelling = python_arguments) -> dict[str, Any]:
        """JSON-ready fields of a swing: curve, verdict, conformity, rests and half turns."""
        deviation, iron = self.deviation, hard_iron(self.halves)
        return {
            "deviation": None if deviation is None else deviation.as_dict(),
            "limits": limits_of(self.notes, spell),  # limits of the card, in words
            # expected deviation from the uncertainty of the calibration
            "calibration": None if self.expected is None else self.expected.as_dict(deviation),
            "site": None if self.site is None else self.site.as_dict(),
            "conformity": None if self.conformity is None else self.conformity.as_dict(),
            "before": None if self.before is None else self.before.as_dict(),
            "logged": None if self.logged is None else self.logged.as_dict(),
            "rests": [rest.as_dict() for rest in self.rests],  # stretches of one heading
            "half_turns": [half.as_dict() for half in self.halves],  # pairs of rests, half a turn apart
            "hard_iron_deg": None if iron is None else {"B": iron[0], "C": iron[1]},  # B and C from half turns
            "half_turns_pass": self.half_turns_pass,  # whether all half turns are within `target_deg`
            "target_deg": self.target_deg,  # largest error of half turns, and 1 σ of the curve, that is good enough
        }
