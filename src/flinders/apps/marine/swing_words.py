"""Words of a swing: its verdicts, notes and cells of tables, the same for the terminal and a certificate.

>>> from flinders.apps.marine.deviation import conformity, fit
>>> from flinders.apps.marine.swing_result import Swing
>>> curve = fit(range(0, 360, 45), [1.0, 2.0, 1.5, -0.2, -0.5, -0.8, -1.5, -0.7])
>>> account = SwingAccount(Swing(curve, conformity=conformity(curve, 5.0)), step_deg=45.0)
>>> [(one.title, one.verdict) for one in account.statements]
[('Good', 'good'), ('Within the limit', 'good')]
>>> account.statements[1].words
'the curve deviates by 2.1° ± 0.16° on 047°: within the limit of 5° by two standard deviations or more'
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.apps.marine.deviation import NAMES, eight_points_sigma
from flinders.apps.marine.swing_notes import COMPENSATION_ADVICE, READING_ADVICE, curve_sigma_deg
from flinders.errors import count_text, python_arguments
from flinders.geometry.angles import heading_text
from flinders.heading.stationary import hard_iron
from flinders.report.formatting import with_uncertainty

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flinders.apps.marine.deviation import Conformity, Deviation
    from flinders.apps.marine.standards import Standard
    from flinders.apps.marine.swing_result import Swing
    from flinders.arrays import Floats
    from flinders.errors import Spelling
    from flinders.heading.stationary import HalfTurn

MEANINGS: Final = (
    "compass turned, or a wrong reference",
    "hard iron, fore and aft",
    "hard iron, athwartships",
    "soft iron, along the axes",
    "soft iron, between the axes",
)
"""Cause of each coefficient."""

MIN_SIGMA_DEG: Final = 0.01
"""Smallest 1 σ that is shown, since readings of a compass are not exact."""
TITLES: Final = {"within": "Within the limit", "open": "Open", "beyond": "Beyond the limit"}
"""Title of each verdict on a limit."""
VERDICTS: Final = {"within": "good", "open": "limited", "beyond": "refused"}
"""Verdict of a statement, for each verdict on a limit."""

ADVICE: Final = {"open": READING_ADVICE, "beyond": COMPENSATION_ADVICE}
"""Remedy for each verdict on a limit."""


class Statement(NamedTuple):
    """A verdict on a swing."""

    title: str  # one to three words
    verdict: str  # ``good``, ``limited`` or ``refused``
    words: str  # the statement in a sentence
    more: tuple[str, ...] = ()  # basis of the statement
    notes: tuple[tuple[str, str], ...] = ()  # severity and words of each limit and each remark


class CardRow(NamedTuple):
    """A line of a deviation card, for one heading."""

    heading: str
    steer: str  # compass heading to steer for the magnetic heading of this line; a dash if it is ambiguous
    deviation: str  # deviation at that compass heading
    sigma: str  # 1 σ of the curve there; empty if it is not known
    magnetic: str  # magnetic heading for that compass heading


@dataclass(frozen=True, slots=True, eq=False)
class SwingAccount:
    """A swing, with its statements and tables in words."""

    swing: Swing
    step_deg: float  # step between the lines of the card
    spell: Spelling = python_arguments  # spelling of arguments

    @property
    def statements(self) -> list[Statement]:
        """Verdicts on the curve, on the limit and on the turns by 180°, if they exist."""
        swing = self.swing
        curve = None if swing.deviation is None else self._curve_statement(swing.deviation)
        said = "" if curve is None else " ".join(words for _, words in curve.notes)
        limit = None if swing.conformity is None else _limit_statement(swing.conformity, swing.rule, said)
        halves = _half_turn_statement(swing.halves, swing.target_deg) if swing.halves else None
        return [one for one in (curve, limit, halves) if one is not None]

    @property
    def rule_notes(self) -> list[str]:
        """Note that no limit was checked, for a rule whose limit is not known."""
        rule = self.swing.rule
        if rule is None or self.swing.conformity is not None:
            return []
        return [f"{rule.title}: no limit was checked; {limit_words(rule)}"]

    def _curve_statement(self, deviation: Deviation) -> Statement:
        said = tuple((note.severity, note.words(self.spell)) for note in self.swing.notes)
        site = () if self.swing.site is None else (str(self.swing.site),)
        is_limited = any(severity == "limits" for severity, _ in said)
        title, verdict = ("Limited", "limited") if is_limited else ("Good", "good")
        return Statement(title, verdict, swing_words(deviation), site, said)

    def coefficients(self, deviation: Deviation) -> dict[str, list[str]]:
        """Columns of the table of coefficients, by their headings."""
        rough = None if deviation.sigma_deg is None else eight_points_sigma(deviation.sigma_deg)
        columns = {"coefficient": list(NAMES)}
        if (before := self.swing.before) is not None:
            earlier = (before.a_deg, before.b_deg, before.c_deg)
            columns["before"] = [*(f"{value:+.1f}°" for value in earlier), "", ""]
        columns["least squares"] = _angles(deviation.coefficients_deg, deviation.sigmas_deg)
        if deviation.eight_point_coefficients is not None:
            columns["eight points"] = _angles(deviation.eight_point_coefficients, rough)
        if (expected := self.swing.expected) is not None:
            columns["claimed"] = ["", *(f"± {max(sigma, 0.001):.2g}°" for sigma in expected.sigmas_deg)]
        return {**columns, "what makes it": list(MEANINGS)}

    def card(self, deviation: Deviation) -> list[CardRow]:
        """Lines of the deviation card."""
        headings, values, sigmas = deviation.card(self.step_deg)
        steer = deviation.compass(headings) if deviation.is_one_to_one else np.full(len(headings), np.nan)
        known = [""] * len(headings) if sigmas is None else [sigma_words(sigma) for sigma in sigmas.tolist()]
        shown = [[heading_text(float(one)) for one in each] for each in (headings, steer, deviation.magnetic(headings))]
        return list(map(CardRow, shown[0], shown[1], map(east_or_west, values.tolist()), known, shown[2]))


def sigma_words(sigma_deg: float) -> str:
    """Format an uncertainty in degrees, at least `MIN_SIGMA_DEG`."""
    return f"± {max(sigma_deg, MIN_SIGMA_DEG):.2f}°"


def limit_words(rule: Standard) -> str:
    """The limit of a rule in words."""
    if rule.limit_deg is None:
        return "not in the seen texts of the rule: look it up in the rule, and give it with --limit DEG"
    return f"{rule.limit_deg:g}° on any heading"


def _limit_statement(conformity: Conformity, rule: Standard | None, said: str) -> Statement:
    """Statement on the limit, with a remedy unless the statement on the curve has it."""
    title, verdict = TITLES[conformity.verdict], VERDICTS[conformity.verdict]
    advice = ADVICE.get(conformity.verdict, "")
    words = f"{conformity_words(conformity)}{f'; {advice}' if advice and advice not in said else ''}"
    return Statement(title, verdict, words, () if rule is None else (rule.title,))


def conformity_words(conformity: Conformity) -> str:
    """Conformity with a limit, in words."""
    sigma = "" if conformity.sigma_deg is None else f" {sigma_words(conformity.sigma_deg)}"
    what = "a reading" if conformity.is_reading else "the curve"
    seen = f"{what} deviates by {conformity.largest_deg:.1f}°{sigma} on {heading_text(conformity.compass_deg, 0)}"
    limit = f"the limit of {conformity.limit_deg:g}°"
    return {
        "within": f"{seen}: within {limit} by two standard deviations or more",
        "open": f"{seen}: within {limit}, but not by two standard deviations",
        "beyond": f"{seen}: beyond {limit}",
    }[conformity.verdict]


def _angles(values: Floats, sigmas: Floats | None) -> list[str]:
    known = [None] * len(values) if sigmas is None else sigmas.tolist()
    return [_angle(*pair) for pair in zip(values.tolist(), known, strict=True)]


def _angle(value: float, sigma: float | None) -> str:
    """Format degrees with their uncertainty, if it is known and not negligible."""
    if sigma is None or sigma < 1e-6:
        return f"{round(value, 4) + 0.0:+.4f}°"
    return f"{with_uncertainty(float(value), float(sigma))}°"


def east_or_west(angle: float) -> str:
    """Format a deviation, east or west.

    >>> east_or_west(10.54), east_or_west(-0.04), east_or_west(-8.2)
    ('10.5° E', '0.0°  ', '8.2° W')
    """
    rounded = round(angle, 1)
    side = "E" if rounded > 0.0 else "W" if rounded < 0.0 else " "
    return f"{abs(rounded):.1f}° {side}"


def swing_words(deviation: Deviation) -> str:
    """Sentence about the deviation curve."""
    sigma = curve_sigma_deg(deviation)
    good = "" if sigma is None else f", known to {max(sigma, 0.005):.2f}° (1 σ) at worst"
    spread = deviation.sigma_deg
    scatter = "" if spread is None else f"; a heading scatters by {spread:.2f}°"
    count = count_text(len(deviation.compass_deg), "heading")
    return f"deviation up to {deviation.largest_deg:.1f}°{good}; {count}{scatter}"


def _iron_words(halves: Sequence[HalfTurn]) -> str:
    """Words about the hard iron from half turns, with its direction if that is known."""
    iron = hard_iron(halves)
    if iron is None:
        return (
            f"hard iron remains, {max(abs(half.error_deg) for half in halves) / 2.0:.1f}° of deviation on this heading"
        )
    return f"hard iron remains (B {iron[0]:+.1f}°, C {iron[1]:+.1f}°)"


def _half_turn_statement(halves: Sequence[HalfTurn], target_deg: float) -> Statement:
    """Statement on turns by 180°, which have to change the heading by 180°."""
    worst = max(abs(half.error_deg) for half in halves)
    advice = [("note", "one pair of headings shows hard iron in one direction only: add a pair at 90° to it")]
    notes = tuple(advice * (len(halves) < 2))
    if worst <= target_deg:
        words = f"half a turn is measured to {worst:.2f}°, within the target of {target_deg:g}°"
        return Statement("Passes", "good", words, notes=notes)
    words = (
        f"half a turn is off by {worst:.2f}°, more than the target of {target_deg:g}°: {_iron_words(halves)}, or "
        "the turn was not 180°; calibrate again"
    )
    return Statement("Fails", "refused", words, notes=notes)
