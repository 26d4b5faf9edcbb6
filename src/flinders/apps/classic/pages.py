"""Pages of the terminal: a turn in one plane, and a simulated swing compared with its truth.

>>> from flinders.geometry.plane import PlaneEllipse, Turn
>>> heading = np.radians(np.arange(0, 360, 10))
>>> points = np.stack([30 * np.cos(heading) + 10, -20 * np.sin(heading) - 5], axis=1)
>>> turn = Turn.of("xy", points, PlaneEllipse.of_points(points))
>>> [row[:2] for row in plane_rows(turn, "µT")][1:4]
[('mean Hx', '10.0000 µT'), ('mean Hy', '-5.0000 µT'), ('eigenvalues', '450.000, 200.000')]
>>> spacing_words(turn, 1.0, is_mean=True)
'36 points, widest gap 10°, first harmonic 0.000, second 0.000: evenly spaced, the mean can be trusted'
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from rich.console import Group
from rich.table import Column
from rich.text import Text

from flinders.apps.classic.composition import turns_of
from flinders.apps.classic.two_axis_recipe import TwoAxisRecipe
from flinders.core.units import unit_label
from flinders.errors import count_text, figures, python_arguments
from flinders.findings.words import turns
from flinders.fitting.result import Fit
from flinders.geometry.plane import turn_axis
from flinders.report.fit_pages import findings, lead, numbers, page_of_fit, verdict_line
from flinders.report.formatting import (
    angle,
    degrees,
)
from flinders.report.terminal import page, table

if TYPE_CHECKING:
    from rich.console import RenderableType

    from flinders.apps.classic.simulate_two_axis import Polar, TwoAxis
    from flinders.arrays import Floats
    from flinders.errors import Spelling
    from flinders.fitting.result import Fit
    from flinders.geometry.plane import Turn

if TYPE_CHECKING:
    from rich.console import RenderableType

    from flinders.errors import Spelling
    from flinders.geometry.plane import PlaneEllipse, Turn

NEGLIGIBLE_SHARE: Final = 0.1
"""Largest heading error of the mean without a remark, as a share of the target."""


def of_turn(
    fit: Fit, turn: Turn, spell: Spelling = python_arguments, *, composed: Fit | None, after: str | None
) -> RenderableType:
    """Lay out a turn in one plane, its calibration, and its composition with the loaded one."""
    mean_style, least_style = ("bold", "") if is_mean(fit) else ("", "bold")
    headings = (
        f"plane {turn.plane}, turned about {turn_axis(turn.plane)}",
        Column("mean and scatter", justify="right", style=mean_style),
        Column("least squares", justify="right", style=least_style),
    )
    recipe = table(headings, plane_rows(turn, unit_label(fit.calibration.unit)))
    words = spacing_words(turn, fit.claim.target_deg, is_mean=is_mean(fit))
    more = [] if composed is None else [_composition(composed, after, spell)]
    return Group(page(recipe, words), page_of_fit(fit, spell), *more)


def is_mean(fit: Fit) -> bool:
    """Whether the offset is the mean of the points."""
    return fit.evidence.method == f"{TwoAxisRecipe.name} {fit.claim.plane}"


def plane_rows(turn: Turn, unit: str) -> list[tuple[str, str, str]]:
    """Rows of the recipe: name, value from mean and scatter, and value from least squares."""
    points, axes = f"{turn.spacing.points:,}", ["xyz".index(axis) + 1 for axis in turn.plane]
    entries = [f"S{row}{column}" for row in axes for column in axes]
    means = [f"mean H{axis}" for axis in turn.plane]
    names = (*means, "eigenvalues", "semi-axes", "axis ratio", "skew angle", *entries)
    cells = (_ellipse_cells(ellipse, unit) for ellipse in (turn.recipe, turn.ellipse))
    return [("points", points, points), *zip(names, *cells, strict=True)]


def _ellipse_cells(ellipse: PlaneEllipse, unit: str) -> list[str]:
    """Cells of a table for an ellipse: mean, eigenvalues and further quantities of the recipe."""
    first, second = (figures(value, 6) for value in ellipse.eigenvalues.tolist())
    long, short = (figures(axis, 6) for axis in ellipse.semi_axes.tolist())
    return [
        *(f"{value:.4f} {unit}" for value in ellipse.centre.tolist()),
        f"{first}, {second}",
        f"{long}, {short} {unit}",
        f"{ellipse.ratio:.5f}",
        f"{ellipse.direction_deg + 0.0:+.3f}°",
        *(f"{entry + 0.0:+.6f}" for entry in ellipse.matrix.ravel().tolist()),
    ]


def spacing_words(turn: Turn, target_deg: float, *, is_mean: bool) -> str:
    """Sentence about the spacing of the points, and whether their mean is the centre."""
    spacing = turn.spacing
    instead = "" if spacing.is_even(within_deg=target_deg) or not is_mean else "; use --method ellipse"
    return (
        f"{count_text(spacing.points, 'point')}, widest gap {spacing.widest_gap_deg:.0f}°, first harmonic "
        f"{spacing.first_harmonic:.3f}, second {spacing.second_harmonic:.3f}: "
        f"{evenness(turn, target_deg, is_mean=is_mean)}{instead}"
    )


def evenness(turn: Turn, target_deg: float, *, is_mean: bool) -> str:
    """Words about the heading error that an uneven spacing of the points causes if their mean is the offset."""
    spacing = turn.spacing
    if spacing.cost_deg < NEGLIGIBLE_SHARE * target_deg:
        return "evenly spaced, the mean can be trusted"
    verb = "makes" if is_mean else "would make"
    cost = f"the mean {verb} the heading wrong by up to {degrees(spacing.cost_deg)}"
    if spacing.is_even(within_deg=target_deg):
        return f"{cost}, within the target of {target_deg:g}°"
    return f"not evenly spaced, {cost}"


def _composition(composed: Fit, after: str | None, spell: Spelling) -> RenderableType:
    """Lay out the composed calibration to load, its claim, and its findings."""
    error = composed.heading_error_deg
    basis = f"{turns(turns_of(composed))}; level, dip {error.dip_deg:.3g}°"
    said = verdict_line(composed.verdict, lead(composed), basis)
    title = Text(f"composed with {after}, to be loaded in its place", "bold")
    result = Group(title, numbers(composed.calibration, np.full(3, np.nan), composed.evidence.noise))
    return Group(page(result, said), findings(composed.findings, spell))


def of_recovery(true: TwoAxis, estimate: TwoAxis, polar: Polar, turn: Turn) -> RenderableType:
    """Lay out a swung two-axis compass: its parameters, true and estimated, the recipe, headings before and after."""
    rows = [
        (name, f"{expected:.4f}{unit}", f"{value:.4f}{unit}", f"{round(value - expected, 4) + 0.0:+.4f}{unit}")
        for name, expected, value, unit in recovery_rows(true, estimate)
    ]
    headings = [
        ("raw", *_heading_cells(polar.raw_error_deg, polar.raw_radius)),
        ("corrected", *_heading_cells(polar.corrected_error_deg, polar.corrected_radius)),
    ]
    return page(
        table(("parameter", "true", "found", "error"), rows),
        table(("recipe", "mean and scatter", "least squares"), plane_rows(turn, "µT")),
        table(("heading", "error, rms", "worst", "radius"), headings),
    )


def recovery_rows(true: TwoAxis, estimate: TwoAxis) -> list[tuple[str, float, float, str]]:
    """Name, true value, estimate and unit of each parameter."""
    return [
        ("scale x", true.scale[0], estimate.scale[0], ""),
        ("scale y", true.scale[1], estimate.scale[1], ""),
        ("offset x", true.offset[0], estimate.offset[0], " µT"),
        ("offset y", true.offset[1], estimate.offset[1], " µT"),
        ("skew", true.skew_deg, estimate.skew_deg, "°"),
        ("noise", true.noise, estimate.noise, " µT"),
    ]


def _heading_cells(errors: Floats, radius: Floats) -> tuple[str, str, str]:
    """Cells of rms and worst error, and of the range of the radius."""
    rms, worst = float(np.sqrt(np.mean(errors**2))), float(np.abs(errors).max())
    return angle(rms), angle(worst), f"{radius.min():.2f} to {radius.max():.2f} µT"
