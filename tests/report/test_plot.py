"""`fit.plot`: the figures of a fit, as SVG and on axes of matplotlib, and what it refuses."""

from __future__ import annotations

import pickle
import re
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure
from tests.sentences import assert_raises

import flinders
from flinders.errors import NeedsRecording, NotExportable, OutputExists, UsageError
from flinders.fitting.fit_file import fit_from
from flinders.fitting.measurement_noise import gates_of
from flinders.fitting.result import Refused, bare_fit, document_of
from flinders.report.fit_figure import KINDS

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit


@pytest.fixture(scope="module")
def samples() -> Samples:
    return flinders.simulate.tumble(seed=2, n=400, motion="uniform").samples


@pytest.fixture(scope="module")
def fit(samples: Samples) -> Fit:
    return flinders.fit(samples)


def axes(**options: Any) -> Any:  # noqa: ANN401 - of two dimensions or three
    return Figure().add_subplot(**options)


@pytest.mark.parametrize("kind", KINDS)
def test_each_figure_is_svg_that_needs_no_file_and_no_script(fit: Fit, kind: str) -> None:
    shown = fit.plot(kind)._repr_svg_()
    ElementTree.fromstring(shown)
    assert "prefers-color-scheme: dark" in shown
    assert "var(" not in shown
    assert not re.search(r"<script|href=|url\(http", shown)


@pytest.mark.parametrize("kind", KINDS)
def test_each_figure_goes_into_axes_of_ones_own(fit: Fit, kind: str) -> None:
    own = axes()
    assert fit.plot(kind, ax=own) is own
    assert own.has_data()
    assert own.get_title()


def test_the_sphere_goes_into_axes_of_three_dimensions(fit: Fit, samples: Samples) -> None:
    own = axes(projection="3d")
    fit.plot(ax=own)
    x, y, z = own.collections[0]._offsets3d
    np.testing.assert_allclose(np.stack([x, y, z], axis=1), fit.calibration.apply(samples.field))


def test_the_strength_has_the_limit_of_a_disturbed_reading(fit: Fit) -> None:
    own, gates = axes(), gates_of(fit)
    fit.plot("strength", ax=own)
    assert gates is not None
    band = own.collections[0].get_paths()[0].get_extents()
    field = fit.calibration.field_strength
    assert (band.y0, band.y1) == pytest.approx((field - gates.strength_limit, field + gates.strength_limit))


def test_readings_left_out_of_the_fit_are_crosses(samples: Samples) -> None:
    struck = samples[:].field.copy()
    struck[100:104] += 60.0
    fit = flinders.fit(flinders.Samples.of(struck, unit="uT"))
    assert fit.evidence.outliers
    own = axes()
    fit.plot("residuals", ax=own)
    assert len(own.collections[-1].get_offsets()) == 4


def test_a_loaded_fit_is_drawn_as_the_fit_was_when_it_gets_its_readings(fit: Fit, samples: Samples) -> None:
    loaded = fit_from(document_of(fit))
    with pytest.raises(NeedsRecording):
        loaded.plot("residuals")
    assert loaded.plot("residuals", samples).svg == fit.plot("residuals").svg
    assert loaded.plot("residuals", samples.field).svg.count("<path") == fit.plot("residuals").svg.count("<path")
    assert loaded.plot("deviation").svg == fit.plot("deviation").svg


def test_a_pickled_fit_leaves_its_readings_behind(fit: Fit) -> None:
    assert fit.provenance.recording is not None
    assert pickle.loads(pickle.dumps(fit)).provenance.recording is None


def test_a_fit_that_states_no_uncertainty_has_no_deviation(fit: Fit, samples: Samples) -> None:
    bare = bare_fit(fit.calibration)
    assert bare.plot("residuals", samples).svg
    with pytest.raises(UsageError):
        bare.plot("deviation")


def test_a_refused_fit_shows_its_readings_and_no_number_of_the_calibration() -> None:
    with pytest.raises(Refused) as raised:
        flinders.fit(flinders.simulate.tumble(seed=3, motion="level", n=200).samples, method="minmax")
    refused = raised.value.fit
    assert "Before" in refused.plot("sphere").svg
    for kind in ("residuals", "strength"):
        with pytest.raises(UsageError):
            refused.plot(kind)
    with pytest.raises(NotExportable):
        refused.plot("deviation")


def test_an_unknown_figure_is_answered_with_the_one_that_is_like_it(fit: Fit) -> None:
    with assert_raises(UsageError):
        fit.plot("residual")


def test_a_figure_is_saved_as_svg_and_nothing_else(fit: Fit, tmp_path: Path) -> None:
    figure, path = fit.plot("deviation"), tmp_path / "deviation.svg"
    figure.save(path)
    assert path.read_text() == figure.svg
    with pytest.raises(OutputExists):
        figure.save(path)
    figure.save(path, force=True)
    with pytest.raises(UsageError):
        figure.save(tmp_path / "deviation.png")
