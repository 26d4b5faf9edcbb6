"""Old spellings of public names: they work, and warn."""

from __future__ import annotations

import pickle
from typing import TYPE_CHECKING, Any

import pytest

import flinders
from flinders import simulate
from flinders.deprecation import renamed_keywords
from flinders.findings import CATALOGUE, RENAMED
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from pathlib import Path

FLIGHT = simulate.tumble(seed=1, n=300).samples


@pytest.mark.parametrize("given", [{"aids": ()}, {"drivers": ()}])
def test_fit_takes_keywords_by_their_old_names(given: dict[str, tuple[str, ...]]) -> None:
    with pytest.warns(DeprecationWarning, match="goes with the next release"):
        fit = flinders.fit(FLIGHT, **given)  # type: ignore[arg-type]
    assert fit.as_dict() == flinders.fit(FLIGHT).as_dict()


def test_functions_with_old_keywords_can_be_sent_to_other_processes() -> None:
    assert pickle.loads(pickle.dumps(flinders.fit)) is flinders.fit


def test_both_names_at_once_are_refused() -> None:
    @renamed_keywords(drivers="disturbances")
    def fit(*, disturbances: str = "") -> str:
        return disturbances

    assert fit(disturbances="current") == "current"
    with pytest.raises(TypeError, match="give one"):
        fit(disturbances="current", drivers="current")  # type: ignore[call-arg]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("strays", "outliers"),
        ("slip", "axis_swap"),
        ("unfollowed", "unmodelled"),
        ("driven", "disturbances"),
        ("noise_undriven", "noise_uncompensated"),
        ("aids", "aiding"),
        ("held", "prior_influence"),
        ("unseen", "unobserved"),
    ],
)
def test_a_fit_has_attributes_by_their_old_names(old: str, new: str) -> None:
    fit = flinders.fit(FLIGHT)
    with pytest.warns(DeprecationWarning, match=new):
        assert getattr(fit, old) == getattr(fit, new)


def test_functions_and_attributes_of_calibrations_have_their_old_names_too() -> None:
    with pytest.warns(DeprecationWarning, match="fit_multi"):
        assert flinders.fit_together is flinders.fit_multi
    with pytest.warns(DeprecationWarning, match="disturbances"):
        assert flinders.fit(FLIGHT).calibration.drivers == ()


def test_simulations_and_summaries_have_their_old_names_too() -> None:
    with pytest.warns(DeprecationWarning, match="stationary"):
        tumble = simulate.tumble(seed=1, n=300, held=0.2, outliers=0.1)  # type: ignore[call-arg]
    same = simulate.tumble(seed=1, n=300, stationary=0.2, outliers=0.1)
    assert tumble.samples.field.tolist() == same.samples.field.tolist()
    with pytest.warns(DeprecationWarning, match="outliers"):
        assert tumble.strays is tumble.outliers
    summary = Summary.of(FLIGHT.field)
    with pytest.warns(DeprecationWarning, match="combined"):
        assert len(summary.beside(summary)) == 600


def test_judged_is_a_fit_and_still_loads(tmp_path: Path) -> None:
    fit = flinders.fit(FLIGHT)
    fit.save(tmp_path / "monday.json")
    with pytest.warns(DeprecationWarning, match="Fit"):
        judged: Any = flinders.Judged
    assert judged.load(tmp_path / "monday.json").name == str(tmp_path / "monday.json")
    with pytest.warns(DeprecationWarning, match="replace"):
        assert judged.from_fit(fit, name="monday").name == "monday"


def test_former_codes_of_findings_name_rows_of_today() -> None:
    assert not RENAMED.keys() & CATALOGUE.keys()
    assert RENAMED["departs"] == "sensor-deviates"
