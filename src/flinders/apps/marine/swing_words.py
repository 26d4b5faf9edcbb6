"""What a swing says: its verdicts, notes and the cells of its tables, the same on the terminal and on a certificate.

>>> from flinders.apps.marine.deviation import conformity, fit
>>> swing = fit(range(0, 360, 45), [1.0, 2.0, 1.5, -0.2, -0.5, -0.8, -1.5, -0.7])
>>> account = SwingAccount(swing, target_deg=1.0, step_deg=45.0, conformity=conformity(swing, 5.0))
>>> [(one.title, one.verdict) for one in account.statements]
[('Good', 'good'), ('Within the limit', 'good')]
>>> account.statements[1].words
'the curve deviates by 2.1° ± 0.16° on 047°: within the limit of 5°, with two standard deviations to spare'
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flinders.apps.marine.deviation import ADVISED, CHANCE, LARGE_DEG, NAMES, WIDEST_GAP_DEG, eight_points_sigma
from flinders.errors import counted
from flinders.geometry.angles import shown_heading
from flinders.heading.stationary import hard_iron
from flinders.report.formatting import with_uncertainty

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flinders.apps.marine.compensation import Compensation
    from flinders.apps.marine.deviation import Conformity, Deviation, Expected
    from flinders.apps.marine.legs import LoggedSwing
    from flinders.apps.marine.standards import Standard
    from flinders.arrays import Floats
    from flinders.core.geomag import SiteField
    from flinders.heading.stationary import HalfTurn, Rest

MEANINGS: Final = (
    "compass turned, or a wrong reference",
    "hard iron, fore and aft",
    "hard iron, athwartships",
    "soft iron, along the axes",
    "soft iron, between the axes",
)
"""What makes each coefficient."""

LARGE_A_DEG: Final = 1.0
"""A beyond this, and three times its 1 σ, asks for another look at how the compass sits."""


LEAST_SIGMA_DEG: Final = 0.01
"""A smaller 1 σ is shown as this: readings of a compass are not exact."""
TITLES: Final = {"within": "Within the limit", "open": "Open", "beyond": "Beyond the limit"}
"""What each verdict on a limit is called."""
VERDICTS: Final = {"within": "good", "open": "limited", "beyond": "refused"}
"""The verdict of a calibration that each is like."""

READ_BETTER: Final = "swing on more headings, or read them better"
COMPENSATE: Final = "compensate or calibrate first, then swing again"
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
    """A swing, what it was asked, and what it says."""

    deviation: Deviation | None  # the curve, where headings are known
    target_deg: float  # what 1 σ of the curve may be, and a turn by 180° may miss
    step_deg: float  # between the lines of the card
    site: SiteField | None = None  # where the declination comes from
    rests: Sequence[Rest] = ()
    halves: Sequence[HalfTurn] = ()
    expected: Expected | None = None  # what the calibration claims
    logged: LoggedSwing | None = None  # readings from a boat's log
    rule: Standard | None = None  # by which the compass was swung
    conformity: Conformity | None = None  # how the curve keeps the limit
    before: Compensation | None = None  # coefficients before the compass was compensated

    @property
    def statements(self) -> list[Statement]:
        """Verdicts on the curve, on the limit and on the turns by 180°, as far as there is each."""
        curve = None if self.deviation is None else self._of_curve(self.deviation)
        said = "" if curve is None else " ".join(words for _, words in curve.notes)
        limit = None if self.conformity is None else _of_limit(self.conformity, self.rule, said)
        halves = _of_half_turns(self.halves, self.target_deg) if self.halves else None
        return [one for one in (curve, limit, halves) if one is not None]

    @property
    def rule_notes(self) -> list[str]:
        """That no limit was checked, of a rule whose limit is not known."""
        if self.rule is None or self.conformity is not None:
            return []
        return [f"{self.rule.title}: no limit was checked; {limit_words(self.rule)}"]

    def _of_curve(self, deviation: Deviation) -> Statement:
        reasons = limits(deviation, self.target_deg)
        said = [("limits", reason) for reason in reasons]
        said += [("note", note) for note in (*_notes(deviation), *_claims(deviation, self.expected))]
        site = () if self.site is None else (str(self.site),)
        title, verdict = ("Limited", "limited") if reasons else ("Good", "good")
        return Statement(title, verdict, swing_words(deviation), site, tuple(said))

    def coefficients(self, deviation: Deviation) -> dict[str, list[str]]:
        """Cells of the table of coefficients, by the heading of each column."""
        rough = None if deviation.sigma_deg is None else eight_points_sigma(deviation.sigma_deg)
        columns = {"coefficient": list(NAMES)}
        if self.before is not None:
            earlier = (self.before.a_deg, self.before.b_deg, self.before.c_deg)
            columns["before"] = [*(f"{value:+.1f}°" for value in earlier), "", ""]
        columns["least squares"] = _angles(deviation.coefficients_deg, deviation.sigmas_deg)
        if deviation.eight is not None:
            columns["eight points"] = _angles(deviation.eight, rough)
        if self.expected is not None:
            columns["claimed"] = ["", *(f"± {max(sigma, 0.001):.2g}°" for sigma in self.expected.sigmas_deg)]
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


def limits(deviation: Deviation, target_deg: float) -> tuple[str, ...]:
    """What a curve falls short of, each with what to do; nothing of a good one that is known to `target_deg`."""
    reasons = []
    if deviation.covariance is None:
        reasons.append(
            f"five coefficients go through any five headings: nothing tells how good they are. Swing on {ADVISED} "
            "headings, or say with --sigma how well each was read"
        )
    if deviation.widest_gap_deg > WIDEST_GAP_DEG:
        reasons.append(
            f"no heading in {deviation.widest_gap_deg:.0f}° of the circle: the curve is a guess there; swing all round"
        )
    sigma = _sigma(deviation)
    if sigma is not None and sigma > target_deg:
        reasons.append(
            f"the curve is known to {sigma:.2f}° (1 σ) at worst, the target is {target_deg:g}°: {READ_BETTER}"
        )
    if not deviation.is_one_to_one:
        reasons.append(
            "the curve falls faster than the heading grows: one magnetic heading has several by compass, and no card "
            f"holds; {COMPENSATE}"
        )
    worst = _worst(deviation)
    if worst is not None:
        place, ratio = worst
        heading = shown_heading(float(deviation.compass_deg[place]))
        reasons.append(f"the heading {heading} is {ratio:.1f} σ off the curve: take it again")
    return tuple(reasons)


def _worst(deviation: Deviation) -> tuple[int, float] | None:
    """The observation that is farthest off, where that is too far: three times the 1 σ that was given."""
    if deviation.chi_square is None or deviation.freedom < 1 or not deviation.sigma_deg:
        return None
    given = deviation.sigma_deg / max(1.0, (deviation.chi_square / deviation.freedom) ** 0.5)
    ratios = np.abs(deviation.residual_deg) / given
    place = int(ratios.argmax())
    return (place, float(ratios[place])) if ratios[place] > 3.0 else None


def _sigma(deviation: Deviation) -> float | None:
    """1 σ of the curve where it is known worst."""
    sigma = deviation.sigma_at(np.arange(360.0))
    return None if sigma is None else float(sigma.max())


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
    sigma = _sigma(deviation)
    good = "" if sigma is None else f", known to {max(sigma, 0.005):.2f}° (1 σ) at worst"
    spread = deviation.sigma_deg
    scatter = "" if spread is None else f"; a heading scatters by {spread:.2f}°"
    count = counted(len(deviation.compass_deg), "heading")
    return f"deviation up to {deviation.largest_deg:.1f}°{good}; {count}{scatter}"


def _notes(deviation: Deviation) -> Iterator[str]:
    if deviation.largest_deg > LARGE_DEG:
        advice = f": {COMPENSATE} for what is left" if deviation.is_one_to_one else ""
        yield f"beyond {LARGE_DEG:.0f}° the formula of five coefficients is rough{advice}"
    if len(deviation.compass_deg) < ADVISED and deviation.covariance is not None:
        yield f"{ADVISED} headings, each 45° from the last, make a better swing"
    a, sigmas = float(deviation.coefficients_deg[0]), deviation.sigmas_deg
    if round(abs(a), 6) > max(LARGE_A_DEG, 0.0 if sigmas is None else 3.0 * float(sigmas[0])):
        yield "A this large is seldom iron: look at how the compass sits, and at the reference of the headings"
    yield "the argument is the heading by compass; B and C change with the latitude"


def _claims(deviation: Deviation, expected: Expected | None) -> Iterator[str]:
    """What the calibration claims of B to E, and whether the swing bears it out."""
    if expected is None:
        return
    test = expected.chance(deviation)
    if test is not None and test[2] < CHANCE:
        yield (
            f"B to E are more than swing and calibration explain (χ² {test[0]:.0f} for {test[1]}): iron has come or "
            "gone since it was made, or the known headings are off"
        )
    yield (
        "claimed: what the calibration's own 1 σ makes of B to E, the same on all headings; it is in the curve, and "
        "not in the 1 σ of that"
    )


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
