"""One fit makes one claim: JSON, file, terminal, page, fleet, evaluate and compare state one number."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from rich.console import Console
from tests.worlds import SENSOR, judged, with_slow_noise

from flinders import Fit, Samples, simulate
from flinders.comparison.comparison import compare
from flinders.comparison.evaluation import evaluate
from flinders.comparison.merging import merge
from flinders.fitting.batch import fit_batch
from flinders.report.fit_pages import of_fit
from flinders.report.view import view
from flinders.simulate.truth import Truth

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.arrays import Floats

RECORDING: Final = simulate.tumble(seed=1, n=1500, sensor=SENSOR)
SAMPLES: Final = RECORDING.samples


def structured(field: Floats) -> Floats:
    """Readings that are longer in some directions."""
    local = field - SENSOR.offset
    x, y, z = (local / np.linalg.norm(local, axis=1)[:, np.newaxis]).T
    longer: Floats = field + 0.01 * (np.sqrt(105.0) * x * y * z)[:, np.newaxis] * local
    return longer


def bent(field: Floats) -> Floats:
    """Readings of which the first axis is not linear."""
    read: Floats = field + 1.5 * ((field - SENSOR.offset)[:, :1] / 50.0) ** 2 * np.array([1.0, 0.0, 0.0])
    return read


def late(field: Floats) -> Floats:
    """Readings of which the first axis is late."""
    return np.column_stack([np.roll(field[:, 0], 1), field[:, 1:]])[1:]


def disturbed(field: Floats) -> Floats:
    """Readings with a disturbance that lasts for some hundred of them."""
    return with_slow_noise(field, sigma=0.5, memory=200.0)


def in_ut(field: Floats) -> Samples:
    """Readings in the unit of the recording."""
    return Samples.of(field, unit="uT")


FITS: Final[dict[str, Callable[[], Fit]]] = {
    "clean": lambda: judged(SAMPLES),
    "another dip": lambda: judged(SAMPLES, dip_deg=-70.0),
    "known strength": lambda: judged(SAMPLES, field_strength=48.0),
    "few readings": lambda: judged(in_ut(SAMPLES.field[::100])),
    "closed form": lambda: judged(SAMPLES, method="consistent"),
    "slow noise": lambda: judged(in_ut(disturbed(SAMPLES.field))),
    "structure": lambda: judged(in_ut(structured(SAMPLES.field))),
    "a nonlinear axis": lambda: judged(in_ut(bent(SAMPLES.field))),
    "a late axis": lambda: judged(in_ut(late(SAMPLES.field))),
    "part of the sphere": lambda: judged(simulate.tumble(seed=1, motion="tilted").samples),
    "a level turn": lambda: judged(simulate.tumble(seed=1, motion="level").samples),
    "with dip": lambda: judged(simulate.tumble(seed=1, motion="swayed", n=1500).samples, aiding=("dip",)),
}


@pytest.fixture(params=FITS)
def fit(request: pytest.FixtureRequest) -> Fit:
    return FITS[request.param]()


def test_every_door_states_one_number(fit: Fit) -> None:
    claim, bound = fit.heading_error_deg.worst, fit.heading_bound_deg
    assert fit.level_error().worst == pytest.approx(claim, rel=1e-9)
    assert claim < bound < 4.0 * claim
    stated = fit.as_dict()["heading_error_deg"]
    assert (stated["worst"], stated["bound_95"]) == (claim, bound)
    drawn = view(fit, SAMPLES).heading_error_deg
    assert drawn is None or (drawn.worst, drawn.bound_95) == (claim, bound)
    loaded = Fit.from_document(fit.to_document())
    assert loaded.level_error().worst == pytest.approx(claim, rel=1e-6)
    assert loaded.heading_bound_deg == pytest.approx(bound, rel=1e-6)


def test_the_terminal_says_it(fit: Fit) -> None:
    if fit.verdict != "refused":
        console = Console(file=io.StringIO(), width=200)
        console.print(of_fit(fit))
        assert fit.heading_words.removesuffix(")") in console.file.getvalue()  # type: ignore[attr-defined]


def test_it_is_held_against_the_truth_and_against_other_calibrations(fit: Fit) -> None:
    exact = replace(fit, covariance=np.zeros((9, 9)), distortion=0.0, nonlinearity=None, axis_lag=None)
    compared = compare(fit, exact).claimed_deg
    assert compared is not None
    assert compared.worst == pytest.approx(fit.heading_error_deg.worst, rel=1e-3)
    if fit.plane is None:
        truth = Truth.of(RECORDING)
        claimed = evaluate(fit, truth, dip_deg=fit.known_dip_deg).claimed_heading_deg
        assert claimed is not None
        assert claimed.worst == pytest.approx(fit.heading_error_deg.worst, rel=1e-9)


@pytest.mark.parametrize("change", [structured, bent, late, disturbed])
def test_a_fleet_states_it(change: Callable[[Floats], Floats]) -> None:
    samples = in_ut(change(SAMPLES.field))
    fit, columns = judged(samples), fit_batch([samples])
    assert columns.by_record.all() or fit.verdict == "refused"
    assert columns.worst_deg[0] == pytest.approx(fit.heading_error_deg.worst, rel=1e-9)
    assert fit.verdict == "refused" or columns.bound_deg[0] == pytest.approx(fit.heading_bound_deg, rel=1e-3)


def test_a_merged_calibration_has_what_belongs_to_the_direction() -> None:
    """Two recordings of one sensor do not average it out."""
    parts = [
        replace(judged(in_ut(structured(simulate.tumble(seed=seed, n=1500, sensor=SENSOR).samples.field))), name=name)
        for seed, name in ((1, "a"), (2, "b"))
    ]
    merged = merge(parts)
    assert merged.structure_deg == pytest.approx(max(part.structure_deg for part in parts), rel=0.05)
    assert merged.heading_error_deg.worst > merged.structure_deg


def test_what_belongs_to_the_direction_is_in_the_claim() -> None:
    """Else the doors above would agree on too small a number."""
    for name in ("structure", "a nonlinear axis", "a late axis"):
        fit = FITS[name]()
        assert fit.heading_error_deg.worst > fit.structure_deg > 0.1, name
