"""What a notebook draws of a fit: the predicted error over the sphere, and the deviation over the heading.

>>> from flinders import simulate
>>> from flinders.fitting import calibrate
>>> shown = pictures(calibrate.fit(simulate.tumble(seed=1).samples))
>>> shown.count("<img "), "<script" in shown
(2, False)
"""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING

from flinders.report import figures
from flinders.report.charts import as_file
from flinders.report.colours import STEPS, colour_of
from flinders.report.view import view_alone

if TYPE_CHECKING:
    from flinders.fitting.result import Fit
    from flinders.report.colours import Theme


def pictures(fit: Fit) -> str:
    """Sphere and deviation of a fit that states its uncertainty, as HTML: images, whose styles stay in them."""
    view = view_alone(fit)
    drawn = (
        (figures.ball(view, fit.target_deg), "Predicted heading error in each direction", "14rem"),
        (figures.deviation(view, fit.target_deg), "Deviation over the heading, before and after", "32rem"),
    )
    least, *_, most, _ = (words for _, words in figures.error_legend(fit.target_deg))
    caption = f"Sphere: heading error to expect where the field points, from {least} (green) to {most} (red)"
    unseen = "" if all(view.tiles_seen) else "; hatched where no reading was taken"
    return f"<div>{''.join(_image(*each) for each in drawn)}<br><small>{caption}{unseen}.</small></div>"


def _image(chart: str, title: str, width: str) -> str:
    """A chart as an image that needs no file."""
    dark = f"@media (prefers-color-scheme: dark) {{ {_map_colours('dark')} }}"
    content = base64.b64encode(as_file(chart, f"{_map_colours('light')} {dark}").encode()).decode()
    style = f"width: {width}; max-width: 100%; vertical-align: middle"
    return f'<img alt="{title}" style="{style}" src="data:image/svg+xml;base64,{content}">'


def _map_colours(theme: Theme) -> str:
    """Rules of the classes that tiles have."""
    classes = (*(f"e{step}" for step in range(STEPS)), "unknown")
    return " ".join(f".{name} {{ fill: {colour_of(name, theme)} }}" for name in classes)
