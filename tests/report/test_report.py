"""A report says what the fit says, holds nothing that could be copied from a refusal, and needs no other file."""

from __future__ import annotations

import base64
import math
import re
import struct
from dataclasses import dataclass, replace
from functools import lru_cache
from html import unescape
from typing import TYPE_CHECKING, Any, Self
from xml.etree import ElementTree

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.trials import daily

import flinders
from flinders import simulate
from flinders.core.calibration import Calibration
from flinders.core.disturbance import Disturbance
from flinders.core.joining import Joined
from flinders.core.samples import Samples
from flinders.diagnostics.random_walk import walk_through
from flinders.errors import FitError, TooFewSamples
from flinders.fitting import calibrate
from flinders.fitting.fit_file import fit_from, load
from flinders.fitting.result import Fit, Refused, bare_fit, document_of, with_calibration
from flinders.geometry.rotation import rotations
from flinders.geometry.sphere import tile_indices, tiles
from flinders.likelihood.site_field import Site
from flinders.report import modules
from flinders.report.figure_data import FigureData
from flinders.report.figures import offset_over_time, projections
from flinders.report.formatting import degrees, mounting
from flinders.report.html import listings_of, page, python_of
from flinders.report.maps import coverage_map, error_map
from flinders.report.notebook import html_of
from flinders.report.terminal import plot
from flinders.report.view import tile_errors_deg
from flinders.workflows.restoring import restore

if TYPE_CHECKING:
    from pathlib import Path


LARGEST = 1_500_000
"""Bytes of a report of ten thousand readings."""


@dataclass(frozen=True)
class Page:
    """A report: all of it, and the words that a person reads."""

    text: str
    words: str

    @classmethod
    def of(cls, text: str) -> Self:
        seen = re.sub(r"<(script|style)\b.*?</\1>", "", text, flags=re.DOTALL)
        return cls(text, re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]*>", " ", seen))))


@lru_cache(maxsize=8)
def fitted(motion: str = "hand", n: int = 1000, seed: int = 2) -> tuple[Fit, Samples]:
    samples = simulate.tumble(seed=seed, n=n, motion=motion).samples
    return calibrate.fit(samples), samples


def flat() -> tuple[Refused, Samples]:
    samples = fitted("level")[1]
    turned = replace(samples, field=samples.field[:, [2, 0, 1]])
    with pytest.raises(Refused) as refused:
        calibrate.fit(turned)
    return refused.value, turned


def test_a_report_begins_with_the_verdict_in_words_and_degrees() -> None:
    fit, samples = fitted()
    words = Page.of(page(fit, samples)).words
    worst = degrees(fit.heading_error_deg.worst)
    order = (
        "Good",
        f"good to {worst}",
        "Before and after",
        "Findings and notes",
        "Seen along the axes",
        "Residuals",
    )
    assert [words.index(part) for part in order] == sorted(words.index(part) for part in order)
    assert f"Worst heading off by {worst}" in words


def test_a_limited_report_says_what_to_do() -> None:
    fit, samples = fitted("tilted")
    words = Page.of(page(fit, samples)).words
    assert "Limited" in words
    for finding in fit.findings:
        assert finding.severity == "note" or finding.remedy in words
        assert finding.fault[1:].rstrip(".") in words


def test_a_report_says_what_to_do_once() -> None:
    """Not again beside what follows from a finding, in the sentence above, or with each target's text."""
    short = simulate.tumble(seed=1, n=3000).samples[:150]
    with pytest.raises(Refused) as refused:
        calibrate.fit(short)
    assert [finding.code for finding in refused.value.fit.findings if "next_step" in finding.values]
    words = Page.of(page(refused.value, short)).words
    assert words.count("slowly once around") == 1 == words.count("do as above") - 1
    fit, samples = fitted("tilted")
    said = Page.of(page(fit, samples, listings=listings_of(fit))).words
    assert said.count("slowly once around") == 1 + sum(
        " ".join(listing.text.split()).count("slowly once around") for listing in listings_of(fit)
    )


def test_the_numbers_beside_a_projection_are_whole() -> None:
    """Also those of counts: the plot moves to the right, as far as the longest number needs."""
    samples = fitted()[1]
    for scale in (1.0, 300.0):
        counts = replace(samples, field=scale * samples.field)
        for drawing in projections(FigureData.of(calibrate.fit(counts), counts), is_corrected=False):
            numbers = re.findall(r'<text[^>]*x="([\d.]+)"[^>]*text-anchor="end"[^>]*>(−?[\d.]+)</text>', drawing)
            assert numbers
            assert all(float(right) >= 6.5 * len(number) for right, number in numbers), scale


def test_a_refused_report_has_figures_and_no_number_to_copy() -> None:
    refused, samples = flat()
    found = Page.of(page(refused, samples))
    assert "Refused" in found.words
    assert_sentences(found.words, about="plane")
    assert found.text.count('<svg class="figure"') == 4
    offset = refused.fit.calibration.offset
    assert not any(f"{value:.3f}" in found.text for value in offset)
    assert "offset" not in found.words
    assert "np.array" not in found.words


def test_a_refused_surface_is_drawn_and_not_told() -> None:
    """A recording of so few directions that the heading is refused, with a surface all the same."""
    samples = simulate.tumble(seed=3, n=60, motion="tilted").samples
    try:
        calibrate.fit(samples, target_deg=0.02)
    except Refused as refused:
        found = Page.of(page(refused, samples))
    else:
        pytest.fail("this fit was to be refused")
    assert "Refused" in found.words
    assert "Offset and matrix" not in found.words
    assert "Predicted heading error" in found.words


def test_a_refusal_without_a_fit_says_why() -> None:
    samples = Samples.of([[1.0, 2.0, 3.0], [1.5, 2.0, 3.0]], unit="uT")
    error = TooFewSamples(found=2, needed=10, method="likelihood")
    assert str(error) in Page.of(page(error, samples)).words
    assert str(error) in Page.of(page(error)).words


def test_ten_thousand_readings_make_less_than_a_megabyte_and_a_half() -> None:
    fit, samples = fitted(n=10_000)
    assert len(page(fit, samples).encode()) < LARGEST


def test_a_report_of_more_readings_is_no_larger() -> None:
    fit, samples = fitted(n=10_000)
    longer = Joined((samples,) * 5)
    drawn = FigureData.of(fit, longer)
    assert (drawn.total, len(drawn.raw), drawn.stride, drawn.clock) == (50_000, 10_000, 5, "reading")
    assert len(page(fit, longer).encode()) < LARGEST


def test_the_view_in_the_page_is_given_the_readings() -> None:
    fit, samples = fitted()
    held = re.search(r'"field":"([^"]*)"', page(fit, samples))
    assert held
    numbers = struct.unpack(f"<{3 * len(samples)}f", base64.b64decode(held[1]))
    npt.assert_allclose(np.reshape(numbers, (-1, 3)), samples.field, rtol=1e-6)


def test_the_policy_of_the_page_names_its_script_and_style_and_nothing_else() -> None:
    import hashlib

    text = page(*fitted())
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    assert policy
    rules = dict(rule.strip().split(" ", 1) for rule in unescape(policy[1]).split(";"))
    assert rules["default-src"] == "'none'"
    for kind, tag in (("script-src", '<script type="module">'), ("style-src", "<style>")):
        inside = text.split(tag, 1)[1].split("</", 1)[0] if kind == "style-src" else text.split(tag, 1)[1]
        inside = inside.split("</script>", 1)[0]
        digest = base64.b64encode(hashlib.sha256(inside.encode()).digest()).decode()
        assert rules[kind] == f"'sha256-{digest}'"
    assert " style=" not in text.split("<script", 1)[0]


def test_the_python_of_a_report_corrects_readings_as_recorded() -> None:
    from flinders.core.axes import Axes
    from flinders.core.units import Unit

    rng = np.random.default_rng(5)
    recorded = rng.normal(size=(20, 3)) * 400.0
    fit, _ = fitted()
    turned = replace(fit.calibration, raw=Unit.of("mG"), axes=Axes.of("y,-x,z"))
    space: dict[str, object] = {"raw": recorded}
    exec(python_of(turned), space)
    samples = Samples.of(recorded, unit="mG", axes="y,-x,z")
    npt.assert_allclose(np.asarray(space["corrected"], float), turned.apply(samples.field), rtol=1e-12)


def test_a_report_of_linearized_axes_gives_their_terms_and_offers_code_alone() -> None:
    _, samples = fitted()
    centre = samples.field.mean(axis=0)
    along = (samples.field - centre) / 50.0
    bent = replace(samples, field=samples.field + 50.0 * np.array([0.0, 0.06, 0.0]) * along**3)
    fit = calibrate.fit(bent, linearize=True)
    text = page(fit, bent)
    assert "matrix · (d − (quadratic + cubic · d) · d²)" in text
    assert re.search(r"cubic, %</th>(<td>−?\d+\.\d</td>){3}", text)
    assert "quadratic = np.array" in unescape(text)
    assert {each.filename for each in listings_of(fit)} == {"c.h", "arduino.ino", "micropython.py"}
    assert "quadratic" not in Page.of(page(*fitted())).words


def test_modules_are_joined_and_nothing_of_their_imports_is_left() -> None:
    text = modules.join_modules()
    assert "const m0 = (() => {" in text
    assert not re.search(r"^(?:import|export)\b", text, re.MULTILINE)
    assert len(re.findall(r"^const m\d+ = ", text, re.MULTILINE)) >= 9


@pytest.mark.parametrize(
    "line", ['import x from "./x.js";', 'import * as x from "./x.js";', "export default 1;", "export let x = 1;"]
)
def test_a_module_in_another_form_is_refused(line: str) -> None:
    with assert_raises(modules.NotJoined):
        modules._wrap_module("m0", f"{line}\n", {})


def test_a_report_without_the_bundle_has_all_but_the_view(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = modules.asset

    def without(path: str) -> str:
        if path.startswith("static/vendor/"):
            raise FileNotFoundError(path)
        return whole(path)

    monkeypatch.setattr(modules, "asset", without)
    modules.join_modules.cache_clear()
    text = page(*fitted())
    assert 'id="scene"' not in text
    assert "theming" in text
    assert text.count('<svg class="figure"') == 16


def test_the_map_keeps_areas() -> None:
    """Each tile has its share of the two discs, to within what the straight edges and the rim cut."""
    fit, samples = fitted()
    drawn = FigureData.of(fit, samples)
    assert drawn.view is not None
    from flinders.report.maps import hemisphere

    def area(ring: np.ndarray) -> float:
        x, y = ring.T
        return abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))) / 2.0

    inner = {tile: ring for tile, ring in hemisphere(1.0).items() if tiles().centres[tile, 2] > 0.15}
    shares = np.array([area(ring) / (4.0 * np.pi) for ring in inner.values()])
    expected = tiles().areas[list(inner)] / (4.0 * np.pi)
    npt.assert_allclose(shares, expected, rtol=0.03)
    for figure in (error_map(drawn.view, 1.0), coverage_map(drawn.view)):
        assert figure.count("clip-path") == 2


def test_projections_hold_the_readings_and_the_outline_of_the_ellipsoid() -> None:
    fit, samples = fitted()
    drawn = FigureData.of(fit, samples)
    from flinders.report.figures import outline

    edge = outline(drawn, (0, 1), is_corrected=False)
    far = samples.field[:, :2]
    assert (edge.min(axis=0) < far.min(axis=0) + 5.0 * fit.evidence.noise).all()
    assert (edge.max(axis=0) > far.max(axis=0) - 5.0 * fit.evidence.noise).all()
    radii = np.linalg.norm(outline(drawn, (0, 2), is_corrected=True), axis=1)
    npt.assert_allclose(radii, fit.calibration.field_strength, rtol=1e-9)
    assert len(projections(drawn, is_corrected=True)) == 3


def test_a_calibration_that_was_written_gives_the_same_report_numbers() -> None:
    for motion in ("hand", "tilted", "level"):
        fit, samples = fitted(motion)
        again = restore(samples, fit_from(document_of(fit))).fit
        assert again.verdict == fit.verdict
        assert again.claim.plane == fit.claim.plane
        npt.assert_allclose(again.heading_error_deg.worst, fit.heading_error_deg.worst, rtol=1e-6)
        npt.assert_allclose(again.heading_error_deg.rms, fit.heading_error_deg.rms, rtol=1e-6)
        npt.assert_allclose(again.evidence.noise, fit.evidence.noise)
        assert restore(samples, fit).notes == ()


@pytest.mark.parametrize("known", daily(["shown", "elsewhere", "open"]))
def test_what_is_known_of_z_at_a_level_turn_is_told_of_the_file_as_of_the_fit(known: str, tmp_path: Path) -> None:
    samples = fitted("level")[1]
    felt = np.tile([0.0, 0.0, -9.81 if known == "shown" else 9.81], (len(samples), 1))
    turned = replace(samples, acceleration=None if known == "open" else felt)
    fit = calibrate.fit(turned, site=Site(50.0, 60.0, gain_sigma=0.05, inclination_sigma_deg=1.0))
    fit.save(tmp_path / "calibration.json")
    again = restore(turned, tmp_path / "calibration.json").fit
    assert again.evidence.z_down is fit.evidence.z_down is {"shown": True, "elsewhere": False, "open": None}[known]
    advice = next(finding.advice for finding in fit.findings if finding.code == "level-plane")
    assert advice[1:].rstrip(".") in Page.of(page(again, turned)).words


def test_what_belongs_to_the_direction_is_found_in_the_file_again() -> None:
    fit, samples = fitted()
    error = fit.heading_error_deg.add_independent(0.7)
    bent = replace(fit, claim=replace(fit.claim, structure_deg=0.7, heading_error_deg=error))
    again = restore(samples, fit_from(document_of(bent))).fit
    assert again.claim.structure_deg == 0.7
    level = fit.calibration.ellipsoid.radius * math.cos(math.radians(fit.claim.known_dip_deg))
    npt.assert_allclose(again.evidence.residuals.distortion, math.radians(0.7) * level, rtol=1e-6)
    npt.assert_allclose(again.claim.attitude_limit_deg, bent.claim.attitude_limit_deg, rtol=1e-6)


def test_a_calibration_without_uncertainty_claims_nothing() -> None:
    fit, samples = fitted()
    unstated = restore(samples, fit.calibration).fit
    assert [finding.code for finding in unstated.findings] == ["no-uncertainty"]
    found = Page.of(page(unstated, samples))
    assert_sentences(found.words, about="unknown quality")
    assert_sentences(found.words, about="uncertainty")
    assert "Worst heading off by" not in found.words
    assert "±" not in found.words.split("How to apply it")[0].split("Offset and matrix")[1].split("The number after")[0]


def test_a_calibration_of_another_sensor_is_doubted() -> None:
    fit, _ = fitted()
    other = simulate.tumble(seed=9, n=500).samples
    assert [note.code for note in restore(other, fit).notes] == ["odd-strength"]


def driven() -> tuple[Fit, Samples]:
    motors = simulate.MotorCurrent(per_ampere=[0.5, 0.0, -0.3], amperes=20.0)
    flight = simulate.tumble(seed=3, n=1500, disturbances=[motors]).samples
    return calibrate.fit(flight, disturbances=("current",)), flight


def test_what_the_offset_follows_is_taken_off_before_anything_is_drawn() -> None:
    fit, flight = driven()
    drawn = FigureData.of(fit, flight)
    assert drawn.residuals[drawn.is_used].std() == pytest.approx(fit.evidence.noise, rel=0.05)
    left_in, taken_off = (drawn.strengths(is_compensated=is_compensated).std() for is_compensated in (False, True))
    assert left_in > 4.0 * taken_off
    npt.assert_array_equal(drawn.recorded, flight.field)


def test_a_report_tells_what_the_offset_follows_and_its_python_does_so_too() -> None:
    fit, flight = driven()
    found = Page.of(page(fit, flight))
    assert "Modelled disturbances" in found.words
    assert "Current, µT per A" in found.words
    sigma = np.sqrt(np.diag(fit.evidence.disturbances.covariance)[9:12])  # type: ignore[arg-type]
    assert f"± {sigma[0]:.4f}" in found.words
    assert flight.current is not None
    names: dict[str, Any] = {"raw": flight.field, "current": flight.current}
    exec(python_of(fit.calibration), names)
    npt.assert_allclose(names["corrected"], fit.calibration.apply(flight.field, current=flight.current), atol=1e-9)


def test_python_of_a_growing_scale_divides_by_it() -> None:
    warm = Disturbance(
        "temperature", np.array([0.1, 0.0, -0.2]), reference=20.0, lowest=10.0, highest=30.0, gain_per_unit=0.002
    )
    calibration = replace(fitted()[0].calibration, disturbances=(warm,))
    rows, celsius = np.array([[20.0, 5.0, -40.0], [10.0, 30.0, 20.0]]), np.array([12.0, 28.0])
    names: dict[str, Any] = {"raw": rows, "temperature": celsius}
    exec(python_of(calibration), names)
    npt.assert_allclose(names["corrected"], calibration.apply(rows, temperature=celsius), atol=1e-9)


def test_a_rotation_that_was_found_is_not_said_to_be_unseen() -> None:
    boat = simulate.tumble(seed=1, motion="swayed", n=1500).samples
    fit = calibrate.fit(boat, aiding=("rate", "dip"))
    text = Page.of(page(fit, boat)).words
    assert ("a magnetometer cannot observe" in text, "gyro and accelerometer" in text) == (False, True)
    assert_sentences(mounting(fit))
    fit = fitted()[0]
    stated = replace(fit, claim=replace(fit.claim, alignment_error_deg=0.5))
    assert_sentences(mounting(stated))


CONSTANT = "Was the calibration constant?"


def test_a_report_says_for_how_long_the_calibration_holds_as_the_terminal_does() -> None:
    for motion in ("hand", "level"):
        fit, samples = fitted(motion)
        dip = fit.heading_error_deg.dip_deg
        walk = walk_through(samples, fit.calibration.ellipsoid, plane=fit.claim.plane, dip_deg=dip)
        told = Page.of(page(fit, samples)).words.split(CONSTANT)[1]
        assert f"T{walk.words('µT', dip_deg=dip)[1:]}." in told
        assert_sentences(told, about="relative to")


def test_a_refused_recording_that_changed_shows_how_and_not_for_how_long_it_holds() -> None:
    moved = simulate.tumble(seed=3, disturbances=[simulate.Step([6.0, 0.0, -4.0], at=0.5)]).samples
    with pytest.raises(Refused) as refused:
        calibrate.fit(moved)
    told = Page.of(page(refused.value, moved)).words.split(CONSTANT)[1].split("Origin")[0]
    assert_sentences(told, about="moved")
    assert "° of heading (1 σ" not in told


def test_without_times_of_one_recording_or_with_few_readings_no_path_is_drawn() -> None:
    fit, samples = fitted()
    for other in (replace(samples, time=None), Joined((samples, samples)), samples[:90]):
        assert CONSTANT not in page(fit, other)


def test_of_a_recording_that_does_not_go_with_the_calibration_no_path_is_drawn() -> None:
    other = simulate.tumble(seed=9, n=500).samples
    for judged in (fitted()[0], bare_fit(fitted()[0].calibration), fitted("level")[0]):
        assert CONSTANT not in page(restore(other, judged).fit, other)
    assert CONSTANT in page(restore(fitted()[1], fitted()[0].calibration).fit, fitted()[1])


def test_the_path_of_an_offset_is_drawn_for_the_axes_that_were_seen() -> None:
    for motion, axes in (("hand", "xyz"), ("level", "xy")):
        fit, samples = fitted(motion)
        drawn = FigureData.of(fit, samples)
        walk = drawn.random_walk(fit)
        assert walk is not None
        figure = offset_over_time(walk, drawn.unit, drawn.plane)
        assert [axis for axis in "xyz" if f">{axis}, µT<" in figure] == list(axes)
        assert figure.count('class="band"') == len(axes)


def test_the_map_is_in_the_axes_of_corrected_readings() -> None:
    """A rotation turns the map with the readings: each tile has the error of the direction that is turned into it."""
    fit, _ = fitted("tilted")
    turn = rotations(np.array([[0.2, -0.4, 0.9]]))[0]
    matrix = turn @ fit.calibration.matrix
    turned = with_calibration(fit, replace(fit.calibration, matrix=matrix, rotation="estimated"))
    errors, moved = tile_errors_deg(fit), tile_errors_deg(turned)
    there = tile_indices(tiles().centres @ turn)
    npt.assert_allclose(moved, errors[there], rtol=0.25)
    assert np.abs(moved - errors).max() > 4.0 * np.abs(moved - errors[there]).max(), (
        "or the turn is too small to be told"
    )


def test_residuals_of_a_level_turn_are_those_of_its_circle() -> None:
    fit, samples = fitted("level")
    drawn = FigureData.of(fit, samples)
    assert drawn.residuals[drawn.is_used].std() == pytest.approx(fit.evidence.noise, rel=0.1)


def test_a_terminal_shows_before_after_and_a_map_in_twelve_lines() -> None:
    fit, samples = fitted("tilted")
    shown = plot(FigureData.of(fit, samples), fit).plain
    lines = shown.splitlines()
    assert len(lines) == 12
    assert max(map(len, lines)) <= 80
    half = [line[46:] for line in lines[1:11]]
    assert set(half[0]) <= {"█", "▒"}, "level is within the target, and recorded"
    assert set("".join(half[6:])) <= {"·", "░"}, "nothing was recorded below"


def test_a_terminal_of_plain_letters_and_one_that_is_narrow() -> None:
    fit, samples = fitted()
    drawn = FigureData.of(fit, samples)
    assert plot(drawn, fit, is_plain=True).plain.replace("°", "").isascii()
    assert max(map(len, plot(drawn, fit, width=60).plain.splitlines())) <= 46


def test_a_notebook_shows_a_fit_and_escapes_its_sensor() -> None:
    fit, _ = fitted()
    named = replace(fit.calibration, sensor="<script>alert(1)</script>")
    for shown in (named._repr_html_(), html_of(replace(fit, calibration=named))):
        assert "<script" not in shown
        assert "offset, µT" in shown
        assert len(re.sub(r"base64,[\w+/=]+", "", shown)) < 2000
    assert degrees(fit.heading_error_deg.worst) in html_of(fit)
    assert "± " in html_of(fit)
    assert vars(flinders.Fit)["_repr_html_"](fit) == html_of(fit)  # which a notebook calls


def test_a_notebook_shows_no_number_of_a_refused_fit() -> None:
    refused, _ = flat()
    shown = html_of(refused.fit)
    assert "<table" not in shown
    assert "one plane" in shown


def test_a_notebook_shows_sphere_and_deviation_as_an_image_that_needs_no_file(tmp_path: Path) -> None:
    fit, _ = fitted()
    fit.save(tmp_path / "c.json")
    for each in (fit, load(tmp_path / "c.json")):
        ((title, image),) = re.findall(
            r'<img alt="([^"]+)"[^>]* src="data:image/svg\+xml;base64,([^"]+)"', html_of(each)
        )
        assert_sentences(title)
        assert len(ElementTree.fromstring(base64.b64decode(image)).findall("{*}svg")) == 2
    assert "<img" not in html_of(bare_fit(fit.calibration))


def test_an_identity_is_shown_too() -> None:
    assert "corrected = matrix" in Calibration.identity()._repr_html_()


def test_an_error_of_another_kind_is_a_report_too() -> None:
    assert "Nothing came." in Page.of(page(FitError("nothing came"))).words
