"""`fit.plot()`: a figure of a fit, for a notebook without further packages, or on axes of matplotlib.

>>> import flinders
>>> fit = flinders.fit(flinders.simulate.tumble(seed=1).samples)
>>> fit.plot("residuals")
Figure(residuals: a notebook shows it, save("residuals.svg") writes it)
>>> from matplotlib.figure import Figure
>>> axes = Figure().subplots()
>>> fit.plot("strength", ax=axes) is axes
True

The readings are those of the fit (`Provenance.recording`); for a loaded fit they must be given.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

from flinders.core.figure import Figure
from flinders.errors import NeedsRecording, UsageError, did_you_mean
from flinders.errors import figures as digits
from flinders.fitting.export import refuse_unfit
from flinders.fitting.measurement_noise import gates_of
from flinders.report import figures
from flinders.report.charts import MAX_DOTS, as_file, row_of_charts, stack_panels, text, thin_out
from flinders.report.figure_data import FigureData
from flinders.report.maps import legend_row, tile_rules
from flinders.report.matplotlib import CORRECTED, draw_panel
from flinders.report.view import view_alone
from flinders.workflows.recordings import recording_for
from flinders.workflows.restoring import restore

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from matplotlib.axes import Axes

    from flinders.fitting.result import Fit
    from flinders.report.charts import Panel
    from flinders.workflows.recordings import AnyReadings

PANEL_HEIGHT: Final = 190.0
"""Height of a panel whose horizontal axis is time."""
GAP: Final = 20
"""Gap between figures side by side."""
LEGEND: Final = "heading error to expect; hatched: no reading"
"""Words ahead of the colours in a legend."""


def plot(
    fit: Fit, kind: str = "sphere", recording: AnyReadings | None = None, *, ax: Axes | None = None
) -> Figure | Axes:
    """Draw a fit, one of `KINDS`; parameters and errors are those of `Fit.plot`."""
    if kind not in KINDS:
        raise UsageError(f"figure {kind!r} is not known{did_you_mean(kind, KINDS)}: use one of {', '.join(KINDS)}")
    drawn, panels = KINDS[kind]
    if ax is None:
        return Figure(as_file(drawn(fit, recording), tile_rules()), kind)
    if kind == "sphere" and ax.name == "3d":
        return _in_space(ax, _with_surface(fit, recording))
    draw_panel(ax, panels(fit, recording)[-1])
    if kind == "sphere":
        ax.set_aspect("equal")
    return ax


def _with_readings(fit: Fit, recording: AnyReadings | None) -> FigureData:
    """The fit and its readings, ready to be drawn; the readings are the given ones, else those of the fit."""
    readings = fit.provenance.recording if recording is None else recording_for(recording, fit)
    if readings is None:
        raise NeedsRecording("the readings")
    if fit.evidence.coverage.by_cell is None:
        fit = restore(readings, fit).fit
    return FigureData.of(fit, readings)


def _with_surface(fit: Fit, recording: AnyReadings | None) -> FigureData:
    """The fit and its readings if they have an ellipsoid; raises `UsageError` for a fit without a correction."""
    drawn = _with_readings(fit, recording)
    if drawn.shown is None:
        raise UsageError("the readings were not corrected: draw the sphere, which shows them as they were recorded")
    return drawn


def _sphere(fit: Fit, recording: AnyReadings | None) -> str:
    """Readings before and after correction, and predicted errors by direction, side by side."""
    titled = figures.pictures(_with_readings(fit, recording), fit.claim.target_deg)
    wide = len(titled) * (figures.SIDE + GAP) - GAP
    heads = [
        text(place * (figures.SIDE + GAP) + figures.SIDE / 2.0, 16, title, kind="name")
        for place, (title, _) in enumerate(titled)
    ]
    has_errors = titled[-1][0] == figures.PREDICTED_TITLE
    legend = legend_row(wide, figures.SIDE + 38.0, fit.claim.target_deg, LEGEND) if has_errors else ""
    charts = [(figure, figures.SIDE, figures.SIDE) for _, figure in titled]
    return row_of_charts(
        "Readings before and after, and predicted error", charts, *heads, legend, gap=GAP, top=22.0, foot=26.0
    )


def _cloud(fit: Fit, recording: AnyReadings | None) -> tuple[Panel, ...]:
    """Corrected readings from the viewpoint of the sphere."""
    panel = figures.cloud(_with_surface(fit, recording), is_corrected=True)
    return (replace(panel, title="corrected readings"),)


def _in_space(axes: Axes, drawn: FigureData) -> Axes:
    """Corrected readings on three-dimensional axes."""
    x, y, z = thin_out(drawn.corrected[drawn.is_used], MAX_DOTS).T
    axes.scatter(x, y, zs=z, s=3, lw=0, color=CORRECTED)
    axes.set(xlabel=f"x, {drawn.unit}", ylabel=f"y, {drawn.unit}", zlabel=f"z, {drawn.unit}", aspect="equal")
    return axes


def _residuals(fit: Fit, recording: AnyReadings | None) -> tuple[Panel, ...]:
    """Residuals over time."""
    panel = figures.residuals_over_time(_with_surface(fit, recording))
    return (replace(panel, title="corrected length less the field; band: ± 2 σ, crosses: left out of the fit"),)


def _strength(fit: Fit, recording: AnyReadings | None) -> tuple[Panel, ...]:
    """Length of corrected readings over time."""
    drawn, gates = _with_surface(fit, recording), gates_of(fit)
    limit = None if gates is None else gates.strength_limit
    band = "" if limit is None else f"; band: not disturbed, ± {digits(limit)} {drawn.unit}"
    panel = figures.strength_over_time(drawn, limit)
    return (replace(panel, title=f"length of corrected readings; dotted: the field{band}"),)


def _deviation(fit: Fit, recording: AnyReadings | None = None) -> tuple[Panel, ...]:
    """Heading error over the heading, before and after correction."""
    del recording  # the deviation follows from the claim alone
    refuse_unfit(fit)
    if not fit.claim.states_uncertainty:
        raise UsageError(
            "the calibration states no uncertainty, and this figure needs it: calibrate again from the recording"
        )
    return figures.deviations(view_alone(fit), fit.claim.target_deg)


def _chart_of_panels(
    title: str, high: float, panels: Callable[[Fit, AnyReadings | None], tuple[Panel, ...]]
) -> Callable[[Fit, AnyReadings | None], str]:
    """Function that draws the panels of a fit, one below the other."""
    return lambda fit, recording: stack_panels(title, panels(fit, recording), wide=figures.WIDTH, high=high)


class FigureKind(NamedTuple):
    """A kind of figure that shows a fit and its readings."""

    chart: Callable[[Fit, AnyReadings | None], str]  #: draws it as SVG for a page
    #: makes its panels, of which single axes show the last
    panels: Callable[[Fit, AnyReadings | None], tuple[Panel, ...]]


KINDS: Final[Mapping[str, FigureKind]] = {
    "sphere": FigureKind(_sphere, _cloud),
    "residuals": FigureKind(_chart_of_panels("Residuals over time", PANEL_HEIGHT, _residuals), _residuals),
    "deviation": FigureKind(
        _chart_of_panels("Deviation over the heading, before and after", 120.0, _deviation), _deviation
    ),
    "strength": FigureKind(_chart_of_panels("Strength over time", PANEL_HEIGHT, _strength), _strength),
}
"""Kinds of figures by name."""
