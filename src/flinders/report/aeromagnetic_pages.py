"""A Tolles–Lawson compensation as pages for the terminal: coefficients, and what is left of the aircraft."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rich.table import Column

from flinders.errors import counted, figures
from flinders.estimators.tolles_lawson_terms import BAND_HZ, NAMES
from flinders.report.formatting import with_uncertainty, written_time
from flinders.report.terminal import facts, notes, page, table, verdict

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import RenderableType

    from flinders.estimators.tolles_lawson import Compensated, TollesLawson

UNITS: Final = {"permanent": "nT", "induced": "nT at 50 µT", "eddy": "nT s at 50 µT"}


def of_tolles_lawson(fit: TollesLawson) -> RenderableType:
    """Lay out a fit: its verdict, what limits it, the coefficients and how they were found."""
    words = f"the compensation makes readings {fit.improvement:.1f} times as quiet (improvement ratio, held out)"
    known = [
        ("flight", f"{counted(fit.readings, 'reading')} in {written_time(fit.seconds)} without gaps"),
        ("before", f"{_nanotesla(fit.before)}, standard deviation from {BAND_HZ[0]:g} to {BAND_HZ[1]:g} Hz"),
        ("held out", f"{_nanotesla(fit.held_out)}, each fifth of the half minutes by the others' coefficients"),
        ("claim", f"{_nanotesla(fit.as_flown)} (1 σ) as flown, {_nanotesla(fit.on_any_heading)} on any heading"),
        ("ridge", f"{fit.ridge:.1g} of the sum of squares of each term, by cross-validation"),
    ]
    limits = notes(("limits", limit) for limit in fit.limits) if fit.limits else None
    coefficients = table(("coefficient", "", Column("")), _rows(fit))
    return page(verdict(fit.verdict.upper(), fit.verdict, words), limits, coefficients, facts(known))


def of_compensated(compensated: Compensated) -> RenderableType:
    """Lay out what coefficients leave of another recording."""
    ratio = compensated.before / compensated.after
    return facts(
        [
            (
                "before",
                f"{_nanotesla(compensated.before)}, standard deviation from {BAND_HZ[0]:g} to {BAND_HZ[1]:g} Hz",
            ),
            ("after", f"{_nanotesla(compensated.after)}: improvement ratio {ratio:.1f}"),
            ("claim", f"{_nanotesla(compensated.claimed)} (1 σ) by the coefficients, of these readings"),
            ("expected", f"{_nanotesla(compensated.expected)}, with noise and ground as on the calibration flight"),
        ]
    )


def _rows(fit: TollesLawson) -> Iterator[tuple[str, str, str]]:
    """Each coefficient with its uncertainty and unit."""
    for name, value, sigma in zip(NAMES, fit.coefficients.tolist(), fit.sigma.tolist(), strict=True):
        yield name, with_uncertainty(value, sigma), UNITS[name.split()[0]]


def _nanotesla(value: float) -> str:
    """A field with two digits."""
    return f"{figures(value)} nT"
