"""Notes on a swing: limits of its curve with remedies, corrections of a log, and further remarks.

>>> from flinders.apps.marine.deviation import fit
>>> swing = fit([0, 70, 140, 220, 290], [1.0, 4.0, 0.0, -3.0, -3.0])
>>> [note.code for note in curve_notes(swing, None, target_deg=1.0)]
['no-redundancy', 'argument']
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.apps.marine.deviation import ADVISED_HEADINGS, CONTRADICTION_PROBABILITY, LARGE_DEVIATION_DEG, MAX_GAP_DEG
from flinders.geometry.angles import heading_text
from flinders.workflows.notes import Note

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from flinders.apps.marine.deviation import Deviation, Expected

LARGE_A_DEG: Final = 1.0
"""Largest coefficient A, in degrees, for which the mounting is not questioned; three times its 1 σ is allowed too."""

MAX_RESIDUAL_RATIO: Final = 3.0
"""Largest residual of a heading in units of its 1 σ; beyond it, the heading should be taken again."""

READING_ADVICE: Final = "swing on more headings, or read them better"
"""Remedy for an uncertain deviation curve."""
COMPENSATION_ADVICE: Final = "compensate or calibrate first, then swing again"
"""Remedy for large deviations."""

SENTENCES: Final[Mapping[str, str]] = {
    "no-redundancy": (
        "five coefficients fit any five headings: their uncertainty is not known. Swing on {advised} headings, or give "
        "the uncertainty of each heading with {sigma_deg}"
    ),
    "gap": "no heading in {gap_deg:.0f}° of the circle: the curve is a guess there; swing all round",
    "uncertain": (
        f"the curve is known to {{worst_deg:.2f}}° (1 σ) at worst, the target is {{target_deg:g}}°: {READING_ADVICE}"
    ),
    "ambiguous": (
        "the deviation falls faster than the heading grows: one magnetic heading has several compass headings, and a "
        f"card is not valid; {COMPENSATION_ADVICE}"
    ),
    "outlier": "the heading {heading} is {ratio:.1f} σ off the curve: take it again",
    "large": f"beyond {{large_deg:.0f}}° the formula of five coefficients is rough: {COMPENSATION_ADVICE}",
    "large-ambiguous": "beyond {large_deg:.0f}° the formula of five coefficients is rough",
    "few-headings": "{advised} headings, each 45° from the last, make a better swing",
    "large-a": "A this large is seldom iron: check the mounting of the compass, and the reference of the headings",
    "argument": "the argument is the heading by compass; B and C change with the latitude",
    "contradicts-calibration": (
        "B to E are larger than the uncertainty of swing and calibration allows (χ² {chi_square:.0f} for {freedom}): "
        "iron was added or removed since the calibration, or the known headings are wrong"
    ),
    "claimed": (
        "claimed: 1 σ of B to E from the uncertainty of the calibration, the same on all headings; this error is part "
        "of the curve, not of its 1 σ"
    ),
    "current": (
        "the speeds of the legs show a current of {speed:.2f} m/s towards {towards_deg:03.0f}° magnetic, which was "
        "removed"
    ),
    "leeway": "leeway is assumed as 0 ± {crab_deg:g}° (1 σ), which is in the uncertainty of B and C",
    "lag": "the compass lags by {lag_s:.2f} ± {sigma_s:.2f} s (1 σ), which was corrected",
    "one-way": (
        "turned in one direction only, so that a lag of 0 ± {sigma_s:g} s (1 σ) is in the uncertainty of A: turn both "
        "ways"
    ),
}
"""Sentence of each code, with places for values and for the arguments of `SwingNote.arguments`."""


class SwingNote(Note):
    """A note on a swing."""

    __slots__ = ()
    sentences: ClassVar = SENTENCES
    arguments: ClassVar = ("sigma_deg",)


def curve_notes(deviation: Deviation, expected: Expected | None, *, target_deg: float) -> tuple[SwingNote, ...]:
    """Notes on a curve: first those of severity ``limits``, which a good curve does not have, then remarks.

    Parameters
    ----------
    expected : Expected, optional
        Claim of the calibration about B to E.
    target_deg : float, degrees
        Largest 1 σ of the curve that is good enough.
    """
    return (*_limits(deviation, target_deg), *_remarks(deviation), *_claims(deviation, expected))


def curve_sigma_deg(deviation: Deviation) -> float | None:
    """Largest 1 σ of the curve, in degrees; None if it is not known."""
    sigma = deviation.sigma_at(np.arange(360.0))
    return None if sigma is None else float(sigma.max())


def _limits(deviation: Deviation, target_deg: float) -> Iterator[SwingNote]:
    if deviation.covariance is None:
        yield SwingNote("no-redundancy", "limits", {"advised": ADVISED_HEADINGS})
    if deviation.widest_gap_deg > MAX_GAP_DEG:
        yield SwingNote("gap", "limits", {"gap_deg": deviation.widest_gap_deg})
    sigma = curve_sigma_deg(deviation)
    if sigma is not None and sigma > target_deg:
        yield SwingNote("uncertain", "limits", {"worst_deg": sigma, "target_deg": target_deg})
    if not deviation.is_one_to_one:
        yield SwingNote("ambiguous", "limits")
    if (worst := _outlier(deviation)) is not None:
        place, ratio = worst
        heading = heading_text(float(deviation.compass_deg[place]))
        yield SwingNote("outlier", "limits", {"heading": heading, "ratio": ratio})


def _outlier(deviation: Deviation) -> tuple[int, float] | None:
    """Index of the worst observation, and its residual over the given 1 σ; None if no residual is too large."""
    if deviation.chi_square is None or deviation.freedom < 1 or not deviation.sigma_deg:
        return None
    given = deviation.sigma_deg / max(1.0, (deviation.chi_square / deviation.freedom) ** 0.5)
    ratios = np.abs(deviation.residual_deg) / given
    place = int(ratios.argmax())
    return (place, float(ratios[place])) if ratios[place] > MAX_RESIDUAL_RATIO else None


def _remarks(deviation: Deviation) -> Iterator[SwingNote]:
    if deviation.largest_deg > LARGE_DEVIATION_DEG:
        code = "large" if deviation.is_one_to_one else "large-ambiguous"
        yield SwingNote(code, values={"large_deg": LARGE_DEVIATION_DEG})
    if len(deviation.compass_deg) < ADVISED_HEADINGS and deviation.covariance is not None:
        yield SwingNote("few-headings", values={"advised": ADVISED_HEADINGS})
    a, sigmas = float(deviation.coefficients_deg[0]), deviation.sigmas_deg
    if round(abs(a), 6) > max(LARGE_A_DEG, 0.0 if sigmas is None else 3.0 * float(sigmas[0])):
        yield SwingNote("large-a")
    yield SwingNote("argument")


def _claims(deviation: Deviation, expected: Expected | None) -> Iterator[SwingNote]:
    """Yield notes on the claim of the calibration about B to E, and on its contradiction by the swing."""
    if expected is None:
        return
    test = expected.chance(deviation)
    if test is not None and test[2] < CONTRADICTION_PROBABILITY:
        yield SwingNote("contradicts-calibration", values={"chi_square": test[0], "freedom": test[1]})
    yield SwingNote("claimed")
