"""Flinders calibrates three-axis magnetometers, and states the heading error to expect.

>>> import flinders
>>> recording = flinders.simulate.tumble(seed=1)
>>> fit = flinders.fit(recording.samples)
>>> fit.verdict
'good'
>>> corrected = fit.calibration.apply(recording.samples.field)

A name is imported at its first use, which keeps the import of the package fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from flinders.core import plugins
from flinders.core.above import UPPER_FUNCTIONS
from flinders.core.lazy import lazy_getattr
from flinders.core.version import VERSION

if TYPE_CHECKING:
    from matplotlib.axes import Axes as PlotAxes

    from flinders import errors as errors
    from flinders import estimators as estimators
    from flinders import simulate as simulate
    from flinders.apps import board as board
    from flinders.apps import classic as classic
    from flinders.apps import fleet as fleet
    from flinders.apps import live as live
    from flinders.apps import marine as marine
    from flinders.apps import service as service
    from flinders.apps import survey as survey
    from flinders.apps import vehicles as vehicles
    from flinders.apps.classic.methods import compare_methods as compare_methods
    from flinders.apps.fleet import fit_many as fit_many
    from flinders.apps.live.guided import Session as Session
    from flinders.apps.live.station.gauge import gauge_study as gauge_study
    from flinders.apps.marine.compass_swing import swing as swing
    from flinders.apps.survey.aeromagnetic import tolles_lawson as tolles_lawson
    from flinders.apps.survey.calibration import fit_survey as fit_survey
    from flinders.apps.survey.shots import read_shots as read_shots
    from flinders.comparison.comparison import compare as compare
    from flinders.comparison.merging import merge as merge
    from flinders.comparison.multi_sensor import fit_multi as fit_multi
    from flinders.core import units as units
    from flinders.core.axes import Axes as Axes
    from flinders.core.calibration import Calibration as Calibration
    from flinders.core.chips import find_chip as find_chip
    from flinders.core.figure import Figure
    from flinders.core.samples import Samples as Samples
    from flinders.core.units import Unit as Unit
    from flinders.errors import FitError as FitError
    from flinders.errors import FlindersError as FlindersError
    from flinders.findings import Finding as Finding
    from flinders.findings.explanation import explain as explain
    from flinders.fitting.aiding import Instruments as Instruments
    from flinders.fitting.axis_extremes import from_extremes as from_extremes
    from flinders.fitting.calibrate import fit as fit
    from flinders.fitting.fit_file import load as load
    from flinders.fitting.known_heading import refresh_at_headings as refresh_at_headings
    from flinders.fitting.known_heading import refresh_on_courses as refresh_on_courses
    from flinders.fitting.refreshing import refresh as refresh
    from flinders.fitting.result import Fit as Fit
    from flinders.likelihood.site_field import Site as Site
    from flinders.readers import open_log as open_log
    from flinders.readers import open_recording as open_recording
    from flinders.readers import read as read
    from flinders.summary.summary import Summary as Summary
    from flinders.workflows.accelerometer import calibrate_accelerometer as calibrate_accelerometer
    from flinders.workflows.bench import fit_bench as fit_bench
    from flinders.workflows.checking import check as check
    from flinders.workflows.correction import apply as apply
    from flinders.workflows.exporting import export as export
    from flinders.workflows.exporting import measurement_noise as measurement_noise
    from flinders.workflows.heading_series import headings as headings
    from flinders.workflows.log_headings import heading_history as heading_history
    from flinders.workflows.offset_history import OffsetHistory as OffsetHistory
    from flinders.workflows.onboard import judge_onboard as judge_onboard
    from flinders.workflows.online import OnlineCalibration as OnlineCalibration
    from flinders.workflows.planning import plan as plan
    from flinders.workflows.recording_contents import contents as contents
    from flinders.workflows.recordings import AnyReadings
    from flinders.workflows.sensors import fit_each as fit_each

__version__: Final = VERSION

_HOMES: Final = {
    "Axes": "core.axes",
    "Calibration": "core.calibration",
    "Finding": "findings",
    "Fit": "fitting.result",
    "FitError": "errors",
    "FlindersError": "errors",
    "Instruments": "fitting.aiding",
    "OffsetHistory": "workflows.offset_history",
    "OnlineCalibration": "workflows.online",
    "Samples": "core.samples",
    "Site": "likelihood.site_field",
    "Summary": "summary.summary",
    "Unit": "core.units",
    "apply": "workflows.correction",
    "calibrate_accelerometer": "workflows.accelerometer",
    "check": "workflows.checking",
    "compare": "comparison.comparison",
    "contents": "workflows.recording_contents",
    "errors": "errors",
    "estimators": "estimators",
    "explain": "findings.explanation",
    "find_chip": "core.chips",
    "export": "workflows.exporting",
    "fit": "fitting.calibrate",
    "fit_multi": "comparison.multi_sensor",
    "fit_bench": "workflows.bench",
    "fit_each": "workflows.sensors",
    "from_extremes": "fitting.axis_extremes",
    "heading_history": "workflows.log_headings",
    "headings": "workflows.heading_series",
    "judge_onboard": "workflows.onboard",
    "load": "fitting.fit_file",
    "measurement_noise": "workflows.exporting",
    "merge": "comparison.merging",
    "open_log": "readers",
    "open_recording": "readers",
    "plan": "workflows.planning",
    "read": "readers",
    "refresh": "fitting.refreshing",
    "refresh_at_headings": "fitting.known_heading",
    "refresh_on_courses": "fitting.known_heading",
    "simulate": "simulate",
    "units": "core.units",
}
"""Module that defines each public name; a name equal to its module's last part is the module itself."""


def _public_names() -> dict[str, str]:
    """Public names with their modules, of the library and of the packages of `flinders.apps`."""
    added = {name: f"{app}.{module}".removeprefix("flinders.") for name, app, module in plugins.app_rows("PUBLIC")}
    return {**_HOMES, **added, **{app: f"apps.{app}" for app in plugins.apps()}}


if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        return __dir__() if name == "__all__" else lazy_getattr(__name__, _public_names())(name)


def _fit_html(fit: Fit) -> str:
    """HTML of a fit for a notebook."""
    from flinders.report.notebook import html_of

    return html_of(fit)


def _plot(
    fit: Fit, kind: str, recording: AnyReadings | None = None, *, ax: PlotAxes | None = None
) -> Figure | PlotAxes:
    """Draw a fit by `flinders.report.fit_figure.plot`."""
    from flinders.report.fit_figure import plot

    return plot(fit, kind, recording, ax=ax)


def _correct_frame(calibration: Calibration, frame: Any, **options: Any) -> Any:  # noqa: ANN401 - any frame
    """Correct a data frame by `flinders.workflows.frames.correct_frame`."""
    from flinders.workflows.frames import correct_frame

    return correct_frame(calibration, frame, **options)


def __dir__() -> list[str]:
    return sorted([*_public_names(), "__version__"])


UPPER_FUNCTIONS.update(html=_fit_html, plot=_plot, correct_frame=_correct_frame)
