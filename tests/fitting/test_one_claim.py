"""One fit makes one claim: JSON, file, terminal, page, fleet, evaluate and compare state one number."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from rich.console import Console
from tests.program import flinders_
from tests.worlds import SENSOR, judged, with_slow_noise

from flinders import Fit, Samples, read, simulate
from flinders.comparison.comparison import compare
from flinders.comparison.evaluation import evaluate
from flinders.comparison.merging import merge
from flinders.fitting.batch import fit_batch
from flinders.fitting.claim import heading_words
from flinders.fitting.fit_file import fit_from, load
from flinders.fitting.fit_json import json_of
from flinders.fitting.result import bare_fit, document_of, with_calibration, with_name
from flinders.geometry.rotation import rotations
from flinders.likelihood.site_field import Site
from flinders.report.fit_pages import page_of_file, page_of_fit
from flinders.report.formatting import degrees
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
    "another dip": lambda: judged(SAMPLES, site=Site(inclination_deg=-70.0)),
    "known strength": lambda: judged(SAMPLES, site=Site(strength=48.0)),
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


@cache
def made(name: str) -> Fit:
    return FITS[name]()


@pytest.fixture(params=FITS)
def fit(request: pytest.FixtureRequest) -> Fit:
    return made(request.param)


def test_every_door_states_one_number(fit: Fit) -> None:
    claim, bound = fit.heading_error_deg.worst, fit.claim.heading_bound_deg
    assert fit.claim.level_error().worst == pytest.approx(claim, rel=1e-9)
    assert claim < bound < 4.0 * claim
    stated = json_of(fit)["heading_error_deg"]
    assert (stated["worst"], stated["bound_95"]) == (claim, bound)
    drawn = view(fit, SAMPLES).heading_error_deg
    assert drawn is None or (drawn.worst, drawn.bound_95) == (claim, bound)
    loaded = fit_from(document_of(fit))
    assert loaded.claim.level_error().worst == pytest.approx(claim, rel=1e-6)
    assert loaded.claim.heading_bound_deg == pytest.approx(bound, rel=1e-6)
    if fit.claim.alignment_error_deg is not None:
        assert loaded.claim.alignment_error_deg == pytest.approx(fit.claim.alignment_error_deg, rel=1e-6)


def test_the_terminal_says_it(fit: Fit) -> None:
    if fit.verdict != "refused":
        console = Console(file=io.StringIO(), width=200)
        console.print(page_of_fit(fit))
        assert heading_words(fit.claim).removesuffix(")") in console.file.getvalue()  # type: ignore[attr-defined]


def test_it_is_held_against_the_truth_and_against_other_calibrations(fit: Fit) -> None:
    claim, bound = fit.heading_error_deg.worst, fit.claim.heading_bound_deg
    compared = compare(fit, exact(fit))
    assert compared.claimed_deg is not None
    assert (compared.claimed_deg.worst, compared.claimed_bound_deg) == pytest.approx((claim, bound), rel=1e-3)
    found = evaluate(fit, Truth.of(RECORDING), dip_deg=fit.claim.known_dip_deg)
    assert found.claimed_heading_deg is not None
    assert found.claimed_heading_deg.worst == pytest.approx(claim, rel=1e-9)
    assert found.claimed_bound_deg == pytest.approx(bound, rel=1e-3)


def exact(fit: Fit) -> Fit:
    """The same without any uncertainty."""
    return replace(fit, claim=replace(fit.claim, covariance=np.zeros((9, 9)), structure_deg=0.0))


@pytest.mark.parametrize("aiding", [(), ("dip",)], ids=["alone", "with dip"])
def test_commands_file_and_page_state_one_number(
    aiding: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`calibrate`, its file, `evaluate`, `compare`, `check`, `heading` and the page, of one recording."""
    monkeypatch.chdir(tmp_path)
    flinders_("simulate", "three-axis", "-o", "hand.csv", "--seed", "7", "--readings", "1500")
    words = ("--with", ",".join(aiding)) if aiding else ()
    made = flinders_("calibrate", "hand.csv", *words, "-o", "fit.json", "--json").json
    fit = load("fit.json")
    bare_fit(fit.calibration).save("exact.json")
    stated = made["heading_error_deg"]
    claims = {
        "the file": json.loads(Path("fit.json").read_text())["fit"]["heading_error_deg"],
        "evaluate": flinders_("evaluate", "fit.json", "hand.truth.json", "--json").json["claimed_heading_deg"],
        "compare": flinders_("compare", "exact.json", "fit.json", "--json").json["claimed_deg"],
        "heading": flinders_(
            "heading", "fit.json", "hand.csv", "-o", "out.csv", "--dip", f"{stated['dip_deg']}", "--json"
        ).json["heading_error_deg"],
    }
    if not aiding:  # a check fits by the magnetometer alone
        claims["check"] = flinders_("check", "exact.json", "hand.csv", "--json").json["claimed_deg"]
    drawn = view(judged(read("hand.csv"), aiding=aiding), read("hand.csv")).heading_error_deg
    assert drawn is not None
    claims["the page"] = {"rms": drawn.rms, "worst": drawn.worst, "bound_95": drawn.bound_95}
    for place, claim in claims.items():
        for key in ("rms", "worst", "bound_95"):
            assert claim[key] == pytest.approx(stated[key], rel=1e-3), (place, key)
    printed = flinders_("calibrate", "hand.csv", *words).out, flinders_("show", "fit.json").out
    assert all(f"{stated['worst']:.2g}° (95 % within {stated['bound_95']:.2g}°" in page for page in printed)


@pytest.mark.parametrize("change", [structured, bent, late, disturbed])
def test_a_fleet_states_it(change: Callable[[Floats], Floats]) -> None:
    samples = in_ut(change(SAMPLES.field))
    fit, columns = judged(samples), fit_batch([samples])
    assert columns.by_record.all() or fit.verdict == "refused"
    assert columns.worst_deg[0] == pytest.approx(fit.heading_error_deg.worst, rel=1e-9)
    assert fit.verdict == "refused" or columns.bound_95_deg[0] == pytest.approx(fit.claim.heading_bound_deg, rel=1e-3)


def test_what_the_mounting_adds_is_said_wherever_the_rotation_was_seen() -> None:
    """By the terminal, of a fit and of its file, and by the file."""
    fit = made("with dip")
    loaded = fit_from(document_of(fit))
    for page in (page_of_fit(fit), page_of_file(loaded, is_verbose=False)):
        console = Console(file=io.StringIO(), width=200)
        console.print(page)
        assert f"adds {degrees(fit.claim.alignment_error_deg or 0.0)} (1 σ)" in console.file.getvalue()  # type: ignore[attr-defined]


def test_before_and_after_are_of_the_same_axes() -> None:
    """The turn that a page draws is that of the numbers beside it, also where the sensor sits turned in the body."""
    fit = made("clean")
    turn = rotations(np.array([[0.3, -0.2, 1.4]]))[0]
    turned = replace(fit.calibration, matrix=turn @ fit.calibration.matrix, rotation="composed")
    mounted = with_calibration(fit, turned)
    drawn = view(mounted, SAMPLES).turn
    assert drawn is not None
    assert max(map(abs, drawn.before_deg)) == pytest.approx(mounted.claim.uncorrected_heading_error_deg.worst, abs=1e-3)


def test_a_merged_calibration_has_what_belongs_to_the_direction() -> None:
    """Two recordings of one sensor do not average it out."""
    parts = [
        with_name(judged(in_ut(structured(simulate.tumble(seed=seed, n=1500, sensor=SENSOR).samples.field))), name)
        for seed, name in ((1, "a"), (2, "b"))
    ]
    merged = merge(parts)
    assert merged.claim.structure_deg == pytest.approx(max(part.claim.structure_deg for part in parts), rel=0.05)
    assert merged.heading_error_deg.worst > merged.claim.structure_deg


def test_what_belongs_to_the_direction_is_in_the_claim() -> None:
    """Else the doors above would agree on too small a number."""
    for name in ("structure", "a nonlinear axis", "a late axis"):
        fit = made(name)
        assert fit.heading_error_deg.worst > fit.claim.structure_deg > 0.1, name
