"""What a swing says: its verdicts, notes and the cells of its tables, the same on the terminal and on a certificate.

>>> from flinders.apps.marine.deviation import conformity, fit
>>> from flinders.apps.marine.swing_result import Swing
>>> curve = fit(range(0, 360, 45), [1.0, 2.0, 1.5, -0.2, -0.5, -0.8, -1.5, -0.7])
>>> account = SwingAccount(Swing(curve, conformity=conformity(curve, 5.0)), step_deg=45.0)
>>> [(one.title, one.verdict) for one in account.statements]
[('Good', 'good'), ('Within the limit', 'good')]
>>> account.statements[1].words
'the curve deviates by 2.1° ± 0.16° on 047°: within the limit of 5°, with two standard deviations to spare'
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.apps.marine.deviation import NAMES, eight_points_sigma
from flinders.apps.marine.swing_notes import COMPENSATE, READ_BETTER, curve_sigma_deg
from flinders.errors import counted, in_python
from flinders.geometry.angles import shown_heading
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
"""What makes each coefficient."""

LEAST_SIGMA_DEG: Final = 0.01
"""A smaller 1 σ is shown as this: readings of a compass are not exact."""
TITLES: Final = {"within": "Within the limit", "open": "Open", "beyond": "Beyond the limit"}
"""What each verdict on a limit is called."""
VERDICTS: Final = {"within": "good", "open": "limited", "beyond": "refused"}
"""The verdict of a calibration that each is like."""

ADVICE: Final = {"open": READ_BETTER, "beyond": COMPENSATE}
"""What to do about each verdict on a limit."""


class Statement(NamedTuple):
    """A verdict on a swing."""

    title: str  # in a word or three
    verdict: str  # ``good``, ``limited`` or ``refused``
    words: str
    more: tuple[str, ...] = ()  # what it rests on
    notes: tuple[tuple[str, str], ...] = ()  # severity and words of what limits it, and of what else to know


class CardRow(NamedTuple):
    """A line of a deviation card, for one heading."""

    heading: str
    steer: str  # compass heading to steer for that magnetic heading; a dash where the curve does not tell
    deviation: str  # at that heading by compass
    sigma: str  # 1 σ of the curve there, or nothing
    magnetic: str  # magnetic heading for that heading by compass


@dataclass(frozen=True, slots=True, eq=False)
class SwingAccount:
    """A swing, and what it says."""

    swing: Swing
    step_deg: float  # between the lines of the card
    spell: Spelling = in_python  # how arguments are named

    @property
    def statements(self) -> list[Statement]:
        """Verdicts on the curve, on the limit and on the turns by 180°, as far as there is each."""
        swing = self.swing
        curve = None if swing.deviation is None else self._of_curve(swing.deviation)
        said = "" if curve is None else " ".join(words for _, words in curve.notes)
        limit = None if swing.conformity is None else _of_limit(swing.conformity, swing.rule, said)
        halves = _of_half_turns(swing.halves, swing.target_deg) if swing.halves else None
        return [one for one in (curve, limit, halves) if one is not None]

    @property
    def rule_notes(self) -> list[str]:
        """That no limit was checked, of a rule whose limit is not known."""
        rule = self.swing.rule
        if rule is None or self.swing.conformity is not None:
            return []
        return [f"{rule.title}: no limit was checked; {limit_words(rule)}"]

    def _of_curve(self, deviation: Deviation) -> Statement:
        said = tuple((note.severity, note.words(self.spell)) for note in self.swing.notes)
        site = () if self.swing.site is None else (str(self.swing.site),)
        is_limited = any(severity == "limits" for severity, _ in said)
        title, verdict = ("Limited", "limited") if is_limited else ("Good", "good")
        return Statement(title, verdict, swing_words(deviation), site, said)

    def coefficients(self, deviation: Deviation) -> dict[str, list[str]]:
        """Cells of the table of coefficients, by the heading of each column."""
        rough = None if deviation.sigma_deg is None else eight_points_sigma(deviation.sigma_deg)
        columns = {"coefficient": list(NAMES)}
        if (before := self.swing.before) is not None:
            earlier = (before.a_deg, before.b_deg, before.c_deg)
            columns["before"] = [*(f"{value:+.1f}°" for value in earlier), "", ""]
        columns["least squares"] = _angles(deviation.coefficients_deg, deviation.sigmas_deg)
        if deviation.eight is not None:
            columns["eight points"] = _angles(deviation.eight, rough)
        if (expected := self.swing.expected) is not None:
            columns["claimed"] = ["", *(f"± {max(sigma, 0.001):.2g}°" for sigma in expected.sigmas_deg)]
        return {**columns, "what makes it": list(MEANINGS)}

    def card(self, deviation: Deviation) -> list[CardRow]:
        """Lines of the deviation card."""
        headings, values, sigmas = deviation.card(self.step_deg)
        steer = deviation.compass(headings) if deviation.is_one_to_one else np.full(len(headings), np.nan)
        known = [""] * len(headings) if sigmas is None else [sigma_words(sigma) for sigma in sigmas.tolist()]
        shown = [
            [shown_heading(float(one)) for one in each] for each in (headings, steer, deviation.magnetic(headings))
        ]
        return list(map(CardRow, shown[0], shown[1], map(sided, values.tolist()), known, shown[2]))


def sigma_words(sigma_deg: float) -> str:
    """An uncertainty in degrees, no smaller than `LEAST_SIGMA_DEG`."""
    return f"± {max(sigma_deg, LEAST_SIGMA_DEG):.2f}°"


def limit_words(rule: Standard) -> str:
    """The limit of a rule in words."""
    if rule.limit_deg is None:
        return "not in what was seen of the rule: read it there, and give it with --limit DEG"
    return f"{rule.limit_deg:g}° on any heading"


def _of_limit(conformity: Conformity, rule: Standard | None, said: str) -> Statement:
    """Whether the curve keeps the limit, with what to do unless that was said of the curve."""
    title, verdict = TITLES[conformity.verdict], VERDICTS[conformity.verdict]
    advice = ADVICE.get(conformity.verdict, "")
    words = f"{conformity_words(conformity)}{f'; {advice}' if advice and advice not in said else ''}"
    return Statement(title, verdict, words, () if rule is None else (rule.title,))


def conformity_words(conformity: Conformity) -> str:
    """How a curve keeps a limit, in words."""
    sigma = "" if conformity.sigma_deg is None else f" {sigma_words(conformity.sigma_deg)}"
    what = "a reading" if conformity.is_reading else "the curve"
    seen = f"{what} deviates by {conformity.largest_deg:.1f}°{sigma} on {shown_heading(conformity.compass_deg, 0)}"
    limit = f"the limit of {conformity.limit_deg:g}°"
    return {
        "within": f"{seen}: within {limit}, with two standard deviations to spare",
        "open": f"{seen}: within {limit}, but not by two standard deviations",
        "beyond": f"{seen}: beyond {limit}",
    }[conformity.verdict]


def _angles(values: Floats, sigmas: Floats | None) -> list[str]:
    known = [None] * len(values) if sigmas is None else sigmas.tolist()
    return [_angle(*pair) for pair in zip(values.tolist(), known, strict=True)]


def _angle(value: float, sigma: float | None) -> str:
    """Degrees, with what is known of their uncertainty; a curve through noiseless points has next to none."""
    if sigma is None or sigma < 1e-6:
        return f"{round(value, 4) + 0.0:+.4f}°"
    return f"{with_uncertainty(float(value), float(sigma))}°"


def sided(angle: float) -> str:
    """A deviation, east or west.

    >>> sided(10.54), sided(-0.04), sided(-8.2)
    ('10.5° E', '0.0°  ', '8.2° W')
    """
    rounded = round(angle, 1)
    side = "E" if rounded > 0.0 else "W" if rounded < 0.0 else " "
    return f"{abs(rounded):.1f}° {side}"


def swing_words(deviation: Deviation) -> str:
    """The curve in a sentence."""
    sigma = curve_sigma_deg(deviation)
    good = "" if sigma is None else f", known to {max(sigma, 0.005):.2f}° (1 σ) at worst"
    spread = deviation.sigma_deg
    scatter = "" if spread is None else f"; a heading scatters by {spread:.2f}°"
    count = counted(len(deviation.compass_deg), "heading")
    return f"deviation up to {deviation.largest_deg:.1f}°{good}; {count}{scatter}"


def _blame(halves: Sequence[HalfTurn]) -> str:
    """Hard iron that half turns show, as far as its direction is known."""
    iron = hard_iron(halves)
    if iron is None:
        return (
            f"hard iron is left, {max(abs(half.error_deg) for half in halves) / 2.0:.1f}° of deviation on this heading"
        )
    return f"hard iron is left (B {iron[0]:+.1f}°, C {iron[1]:+.1f}°)"


def _of_half_turns(halves: Sequence[HalfTurn], target_deg: float) -> Statement:
    """Whether turns by 180° turn the heading by 180°."""
    worst = max(abs(half.error_deg) for half in halves)
    advice = [("note", "one pair of headings sees one direction of hard iron: add a pair at 90° to it")]
    notes = tuple(advice * (len(halves) < 2))
    if worst <= target_deg:
        words = f"half a turn is measured to {worst:.2f}°, within the target of {target_deg:g}°"
        return Statement("Passes", "good", words, notes=notes)
    words = (
        f"half a turn is off by {worst:.2f}°, more than the target of {target_deg:g}°: {_blame(halves)}, or the turn "
        "was not 180°; calibrate again"
    )
    return Statement("Fails", "refused", words, notes=notes)
