"""What a notebook shows of a result is one line, with its numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.sentences import assert_sentences

import flinders
from flinders.core.geomag import site_field

if TYPE_CHECKING:
    from pathlib import Path

    from flinders.core.samples import Samples
    from flinders.fitting.result import Fit


@pytest.fixture(scope="module")
def samples() -> Samples:
    return flinders.simulate.tumble(seed=1).samples


@pytest.fixture(scope="module")
def fit(samples: Samples) -> Fit:
    return flinders.fit(samples)


def test_a_correction_shows_its_readings_and_their_strength(samples: Samples, fit: Fit) -> None:
    corrected = flinders.apply(samples, fit)
    words = repr(corrected).removeprefix("Corrected")
    assert repr(corrected.summary) == f"CorrectionSummary{words}"
    assert_sentences(words)
    foreign = flinders.apply(flinders.simulate.tumble(seed=2).samples, fit)
    assert repr(foreign).endswith("limited by unsuited)")


def test_headings_show_their_error_and_what_limits_them(samples: Samples, fit: Fit) -> None:
    found = flinders.headings(samples, fit)
    words = repr(found).removeprefix("HeadingSeries")
    assert repr(found.summary) == f"HeadingSummary{words}"
    assert_sentences(words)
    elsewhere = flinders.headings(samples, fit, site=site_field(51.0, 4.0, year=2026.4))
    assert "true headings" in repr(elsewhere)
    assert_sentences(repr(elsewhere))
    assert "no error stated" in repr(flinders.headings(samples, fit.calibration))


def test_a_check_shows_the_verdict_and_the_difference(samples: Samples, fit: Fit) -> None:
    held = repr(flinders.check(flinders.simulate.tumble(seed=1, n=2000).samples, fit))
    assert held.startswith("Check(holds, heading difference 0.0")
    assert held.endswith(", target 1°, fresh fit good)")
    assert repr(flinders.check(flinders.simulate.tumble(seed=2).samples, fit)).startswith("Check(fails, ")
    refused = flinders.check(samples[:60], fit)
    assert refused.refusal is not None
    assert_sentences(repr(refused))


def test_contents_show_the_magnetometers(samples: Samples, tmp_path: Path) -> None:
    flinders.simulate.write_csv(samples, tmp_path / "one.csv")
    found = flinders.contents(tmp_path / "one.csv")
    words = repr(found).removeprefix("Contents(one.csv, text: ")
    assert repr(found.sensors[0]) == f"RecordedSensor(1, {words}"
    assert_sentences(words)
    both = np.column_stack([samples.field, 2.0 * samples.field])[:500]
    np.savetxt(tmp_path / "two.csv", both, delimiter=",", header="m1x,m1y,m1z,m2x,m2y,m2z", comments="")
    two = "Contents(two.csv, text: 2 magnetometers: 1 m1, 2 m2)"
    assert repr(flinders.contents(tmp_path / "two.csv", unit="uT")) == two
