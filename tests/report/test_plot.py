"""`fit.plot`: the parts that it draws, and what it refuses."""

from __future__ import annotations

import io
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from tests.trials import nightly

import flinders
from flinders.errors import MissingExtra, NotExportable, UsageError
from flinders.fitting.fit_file import fit_from
from flinders.fitting.result import Judgement, bare_fit, document_of

if TYPE_CHECKING:
    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def samples() -> Samples:
    return flinders.simulate.tumble(seed=2, n=400, motion="uniform").samples


@pytest.fixture(scope="module")
def fit(samples: Samples) -> Fit:
    return flinders.fit(samples)


@pytest.mark.parametrize("what", ["all", *map(nightly, ("deviation", "projections", "residuals", "coverage"))])
def test_each_part_is_drawn(fit: Fit, samples: Samples, what: str) -> None:
    written = io.BytesIO()
    fit.plot(samples, what).savefig(written, format="svg")
    assert len(written.getvalue()) > 20_000


def test_what_a_fit_does_not_state_is_not_drawn(fit: Fit, samples: Samples) -> None:
    bare = bare_fit(fit.calibration)
    assert bare.plot(samples, "residuals").axes
    with pytest.raises(UsageError, match="states no uncertainty"):
        bare.plot(samples, "deviation")


def test_a_fit_of_a_file_is_drawn_as_the_fit(fit: Fit, samples: Samples) -> None:
    loaded = fit_from(document_of(fit))
    assert len(loaded.plot(samples).axes) == len(fit.plot(samples).axes)


def test_an_unknown_part_and_a_refused_fit_are_refused(fit: Fit, samples: Samples) -> None:
    with pytest.raises(UsageError, match="projections"):
        fit.plot(samples, "art")
    with pytest.raises(NotExportable):
        replace(fit, judgement=Judgement(stated_verdict="refused")).plot(samples)


def test_without_matplotlib_it_says_what_to_install(
    fit: Fit, samples: Samples, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtra, match=r"drawing figures needs matplotlib.*pip install 'flinders\[plot\]'"):
        fit.plot(samples)
