"""Notes on a swing: what limits its curve, with what to do, what was taken out of a log, and what else to know.

>>> from flinders.apps.marine.deviation import fit
>>> swing = fit([0, 70, 140, 220, 290], [1.0, 4.0, 0.0, -3.0, -3.0])
>>> [note.code for note in curve_notes(swing, None, target_deg=1.0)]
['no-redundancy', 'argument']
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flinders.apps.marine.deviation import ADVISED, CHANCE, LARGE_DEG, WIDEST_GAP_DEG
from flinders.geometry.angles import shown_heading
from flinders.workflows.notes import Note

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from flinders.apps.marine.deviation import Deviation, Expected

LARGE_A_DEG: Final = 1.0
"""A beyond this, and three times its 1 σ, asks for another look at how the compass sits."""

MAX_RATIO: Final = 3.0
"""Residual of a heading, in its own 1 σ, from which on it is to be taken again."""

READ_BETTER: Final = "swing on more headings, or read them better"
COMPENSATE: Final = "compensate or calibrate first, then swing again"

SENTENCES: Final[Mapping[str, str]] = {
    "no-redundancy": (
        "five coefficients go through any five headings: nothing tells how good they are. Swing on {advised} "
        "headings, or say with {sigma_deg} how well each was read"
    ),
    "gap": "no heading in {gap_deg:.0f}° of the circle: the curve is a guess there; swing all round",
    "uncertain": (
        f"the curve is known to {{worst_deg:.2f}}° (1 σ) at worst, the target is {{target_deg:g}}°: {READ_BETTER}"
    ),
    "ambiguous": (
        "the curve falls faster than the heading grows: one magnetic heading has several by compass, and no card "
        f"holds; {COMPENSATE}"
    ),
    "outlier": "the heading {heading} is {ratio:.1f} σ off the curve: take it again",
    "large": f"beyond {{large_deg:.0f}}° the formula of five coefficients is rough: {COMPENSATE} for what is left",
    "large-ambiguous": "beyond {large_deg:.0f}° the formula of five coefficients is rough",
    "few-headings": "{advised} headings, each 45° from the last, make a better swing",
    "large-a": "A this large is seldom iron: look at how the compass sits, and at the reference of the headings",
    "argument": "the argument is the heading by compass; B and C change with the latitude",
    "contradicts-calibration": (
        "B to E are more than swing and calibration explain (χ² {chi_square:.0f} for {freedom}): iron has come or "
        "gone since it was made, or the known headings are off"
    ),
    "claimed": (
        "claimed: what the calibration's own 1 σ makes of B to E, the same on all headings; it is in the curve, and "
        "not in the 1 σ of that"
    ),
    "current": (
        "the speeds of the legs show a current of {speed:.2f} m/s towards {towards_deg:03.0f}° magnetic: taken out"
    ),
    "leeway": "leeway is taken as 0 ± {crab_deg:g}° (1 σ), which is in the uncertainty of B and C",
    "lag": "the compass lags by {lag_s:.2f} ± {sigma_s:.2f} s (1 σ), which was taken out",
    "one-way": ("turned one way alone, a lag of 0 ± {sigma_s:g} s (1 σ) is in the uncertainty of A: turn both ways"),
}
"""Formats of the values of each code, and of the arguments of `SwingNote.arguments`."""


class SwingNote(Note):
    """A note on a swing."""

    __slots__ = ()
    sentences: ClassVar = SENTENCES
    arguments: ClassVar = ("sigma_deg",)


def curve_notes(deviation: Deviation, expected: Expected | None, *, target_deg: float) -> tuple[SwingNote, ...]:
    """What a curve falls short of, then what else to know; ``limits`` are none of a good one that is known well enough.

    Parameters
    ----------
    expected : Expected, optional
        What the calibration claims of B to E.
    target_deg : float, degrees
        What 1 σ of the curve may be.
    """
    return (*_limits(deviation, target_deg), *_remarks(deviation), *_claims(deviation, expected))


def curve_sigma_deg(deviation: Deviation) -> float | None:
    """1 σ of the curve where it is known worst."""
    sigma = deviation.sigma_at(np.arange(360.0))
    return None if sigma is None else float(sigma.max())


def _limits(deviation: Deviation, target_deg: float) -> Iterator[SwingNote]:
    if deviation.covariance is None:
        yield SwingNote("no-redundancy", "limits", {"advised": ADVISED})
    if deviation.widest_gap_deg > WIDEST_GAP_DEG:
        yield SwingNote("gap", "limits", {"gap_deg": deviation.widest_gap_deg})
    sigma = curve_sigma_deg(deviation)
    if sigma is not None and sigma > target_deg:
        yield SwingNote("uncertain", "limits", {"worst_deg": sigma, "target_deg": target_deg})
    if not deviation.is_one_to_one:
        yield SwingNote("ambiguous", "limits")
    if (worst := _outlier(deviation)) is not None:
        place, ratio = worst
        heading = shown_heading(float(deviation.compass_deg[place]))
        yield SwingNote("outlier", "limits", {"heading": heading, "ratio": ratio})


def _outlier(deviation: Deviation) -> tuple[int, float] | None:
    """The observation that is farthest off, where that is too far for the 1 σ that was given."""
    if deviation.chi_square is None or deviation.freedom < 1 or not deviation.sigma_deg:
        return None
    given = deviation.sigma_deg / max(1.0, (deviation.chi_square / deviation.freedom) ** 0.5)
    ratios = np.abs(deviation.residual_deg) / given
    place = int(ratios.argmax())
    return (place, float(ratios[place])) if ratios[place] > MAX_RATIO else None


def _remarks(deviation: Deviation) -> Iterator[SwingNote]:
    if deviation.largest_deg > LARGE_DEG:
        code = "large" if deviation.is_one_to_one else "large-ambiguous"
        yield SwingNote(code, values={"large_deg": LARGE_DEG})
    if len(deviation.compass_deg) < ADVISED and deviation.covariance is not None:
        yield SwingNote("few-headings", values={"advised": ADVISED})
    a, sigmas = float(deviation.coefficients_deg[0]), deviation.sigmas_deg
    if round(abs(a), 6) > max(LARGE_A_DEG, 0.0 if sigmas is None else 3.0 * float(sigmas[0])):
        yield SwingNote("large-a")
    yield SwingNote("argument")


def _claims(deviation: Deviation, expected: Expected | None) -> Iterator[SwingNote]:
    """What the calibration claims of B to E, and whether the swing bears it out."""
    if expected is None:
        return
    test = expected.chance(deviation)
    if test is not None and test[2] < CHANCE:
        yield SwingNote("contradicts-calibration", values={"chi_square": test[0], "freedom": test[1]})
    yield SwingNote("claimed")
