"""Betaflight's model file: what the Configurator's own functions make of it, and models that it wrote, read.

Its functions stand here once more, line by line as its sources have them; numbers of a published model are those of
``reference_flight1_mag_model.json`` in its tests.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests.sentences import assert_raises, assert_sentences
from tests.targets.test_import_command import run
from tests.vehicles.test_mountings import HARD, SOFT, anyhow, right_angles

import flinders
from flinders import simulate
from flinders.apps.vehicles.targets.betaflight import MOUNTINGS
from flinders.apps.vehicles.targets.betaflight_model import LABELS
from flinders.apps.vehicles.targets.betaflight_schema import quality_bounds
from flinders.arrays import to_floats
from flinders.core.calibration import Calibration
from flinders.core.samples import Samples
from flinders.core.units import Unit
from flinders.errors import DocumentError, NotExportable
from flinders.fitting.measurement_noise import noise_of
from flinders.targets import ExportOptions, find, read_back
from flinders.targets._mounting import angles, euler

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import ArrayLike

    from flinders.arrays import Floats
    from flinders.fitting.result import Fit

COUNT_UT = 0.04
FIELD_UT = 50.0
READINGS = 2000.0 * np.random.default_rng(4).normal(size=(50, 3))
"""Counts of a sensor, in its own axes."""


# the Configurator

ALIGNMENT_MATRICES = {
    1: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], 2: [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
    3: [[-1, 0, 0], [0, -1, 0], [0, 0, 1]], 4: [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    5: [[-1, 0, 0], [0, 1, 0], [0, 0, -1]], 6: [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
    7: [[1, 0, 0], [0, -1, 0], [0, 0, -1]], 8: [[0, -1, 0], [-1, 0, 0], [0, 0, -1]],
}  # fmt: skip
ALIGNMENT_LABELS = [
    "CW 0°",
    "CW 90°",
    "CW 180°",
    "CW 270°",
    "CW 0° flip",
    "CW 90° flip",
    "CW 180° flip",
    "CW 270° flip",
]


def matrix_to_euler(m: Floats) -> dict[str, float]:
    """matrixToEuler of magCharacterization.js, away from a pitch of 90°."""
    pitch = -np.arcsin(np.clip(m[2][0], -1, 1))
    turns = {"roll": np.arctan2(m[2][1], m[2][2]), "pitch": pitch, "yaw": np.arctan2(m[1][0], m[0][0])}
    return {name: float(np.rad2deg(turn)) for name, turn in turns.items()}


def euler_to_matrix(own: dict[str, float]) -> Floats:
    """eulerToMatrix of magAlignment.js."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(r := np.deg2rad([own[name] for name in ("roll", "pitch", "yaw")])), np.sin(r)
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])  # fmt: skip


def matrix_of(number: int, own: dict[str, float] | None) -> Floats:
    """currentMatrixOf and proposedMatrixOf of magCharacterizationCompute.ts."""
    if number == 9:
        assert own
        return euler_to_matrix(own)
    return to_floats(ALIGNMENT_MATRICES[max(number, 1)])


def corrected(model: dict[str, Any], raw: Floats) -> Floats:
    """applyEllipsoidCorrection of ellipsoidFit.ts."""
    correction = model["ellipsoid_correction"]
    return to_floats((raw - axes_of(correction["center"])) @ np.array(correction["soft_iron"]).T)


def axes_of(vector: dict[str, float]) -> Floats:
    return np.array([vector[axis] for axis in "xyz"])


def by_axis(vector: Floats) -> dict[str, float]:
    return dict(zip("xyz", vector.tolist(), strict=True))


def configurator_model(proposed: Floats, number: int, own: dict[str, float] | None, *, is_captured: bool) -> str:
    """buildCharacterizationModel and computeCalFromEllipsoid, of a sensor with SOFT and HARD without any noise.

    In the axes of the capture, whose offset was in force, or in those of the sensor, as characterizeTumble has it.
    """
    capture, zero = matrix_of(number, own), np.array([40.0, -12.0, 7.0])
    inverse = SOFT * COUNT_UT / FIELD_UT
    soft, centre, across = inverse, OFFSET, proposed
    if is_captured:
        soft, centre, across = capture @ inverse @ capture.T, capture @ OFFSET - zero, proposed @ capture.T
    upper = np.linalg.cholesky(soft.T @ soft).T  # the factor that fitEllipsoid takes
    bias = centre + zero if is_captured else centre
    return json.dumps({
        "$schema": "https://betaflight.com/blackbox/mag-characterization-model/2.2",
        "version": "2.2",
        "captured_under": {
            "alignment": number, "custom_angles": own, "mag_zero": by_axis(zero), "mag_zero_known": True,
        },
        "ellipsoid_correction": {
            "center": by_axis(centre), "soft_iron": upper.tolist(), "radius": 0.9998, "residual_rms": 0.0059,
        },
        "geo_reference": {
            "latitude_deg": None, "longitude_deg": None, "declination_deg": -15.3, "inclination_deg": 70.9,
            "field_strength_nt": 1e3 * FIELD_UT,
        },
        "alignment": {"preset": 9, "label": "CUSTOM", "euler_zyx_deg": matrix_to_euler(proposed)},
        "hard_iron": by_axis(np.rint(across @ bias)),
        "quality": {"mean_residual_deg": 1.8, "sample_count": 250, "frob_norm": 0.4, "cost": 0.021},
        "quality_assessment": None,
        "downstream_fusion": {"frame": "FRD", "nt_per_corrected_unit": 50010.0, "gauss_per_corrected_unit": 0.5001},
    })  # fmt: skip


OFFSET = HARD / COUNT_UT
"""Counts, axes of the sensor."""


def field_of(raw: Floats) -> Floats:
    """(N, 3) what the sensor sees over the strength of the field, in its own axes."""
    return to_floats((raw - OFFSET) @ (SOFT * COUNT_UT / FIELD_UT).T)


def recorded(in_force: Floats, truth: Floats) -> Calibration:
    """What a fit finds of a sensor that is mounted by `truth`, and by `in_force` as the board has it."""
    raw = Unit.of("counts", COUNT_UT)
    return Calibration(
        truth @ SOFT @ in_force.T, in_force @ HARD, FIELD_UT, True, "estimated", raw=raw, frame="vehicle"
    )


def model_of(calibration: Calibration, **asked: Any) -> dict[str, Any]:
    model: dict[str, Any] = json.loads(find("betaflight-model").render(calibration, asked=ExportOptions(**asked)).text)
    return model


# written


def test_mountings_are_those_of_the_configurator() -> None:
    for number in range(8):
        npt.assert_array_equal(MOUNTINGS.rotation(number), ALIGNMENT_MATRICES[number + 1])
        assert dict(zip(("roll", "pitch", "yaw"), angles(MOUNTINGS.rotation(number)), strict=True)) == pytest.approx(
            matrix_to_euler(MOUNTINGS.rotation(number))
        )
    assert list(LABELS) == ALIGNMENT_LABELS


@pytest.mark.parametrize("in_force", ["CW270FLIP", "12.3,-20,100.5"])
def test_the_configurators_functions_give_the_field_of_the_vehicle(in_force: str) -> None:
    """Mounted by 24 right angles and 20 others; and what is read back does the same after the board took it."""
    now = MOUNTINGS.read(in_force)
    for truth in (*right_angles(), *anyhow(20)):
        text = find("betaflight-model").render(recorded(now, truth), asked=ExportOptions(mounting=now)).text
        model = json.loads(text)
        under, asked = model["captured_under"], model["alignment"]
        capture = matrix_of(under["alignment"], under["custom_angles"])
        proposed = matrix_of(asked["preset"], asked["euler_zyx_deg"])
        found = corrected(model, READINGS @ now.T) @ (proposed @ capture.T).T
        npt.assert_allclose(found, field_of(READINGS) @ truth.T, atol=1e-9)
        npt.assert_allclose(proposed, truth, atol=0.004)  # tenths of a degree
        npt.assert_allclose(axes_of(model["hard_iron"]), proposed @ OFFSET, atol=0.51)
        _, back = read_back(text.encode(), "model.json")
        out = back.apply(READINGS @ proposed.T) / back.field_strength
        npt.assert_allclose(out, field_of(READINGS) @ truth.T, atol=1e-9)


def test_without_a_mounting_the_rotation_is_in_the_soft_iron() -> None:
    model = model_of(recorded(np.eye(3), euler(3.0, -8.0, 40.0)))
    assert model["alignment"] is None
    assert model["captured_under"] is None
    npt.assert_allclose(corrected(model, READINGS), field_of(READINGS) @ euler(3.0, -8.0, 40.0).T, atol=1e-9)


def test_a_small_rotation_leaves_the_mounting_and_is_not_lost() -> None:
    now = MOUNTINGS.read("CW270FLIP")
    small = euler(0.0, 0.0, 0.2) @ now
    model = model_of(recorded(now, small), mounting=now)
    assert (model["alignment"]["preset"], model["captured_under"]["alignment"]) == (8, 8)
    npt.assert_allclose(corrected(model, READINGS @ now.T), field_of(READINGS) @ small.T, atol=1e-9)


@pytest.fixture(scope="module")
def fit() -> Fit:
    """Of readings in counts of known scale, in the axes of the vehicle, with noise of 1 % of the field."""
    sensor = simulate.Sensor(SOFT, HARD, noise=0.5)
    field = simulate.tumble(seed=2, sensor=sensor).samples.field
    samples = Samples.of(field / COUNT_UT, unit="counts", scale=COUNT_UT)
    return flinders.fit(samples, site=flinders.Site(strength=FIELD_UT, inclination_deg=65.0))


def test_scale_and_place_are_those_of_the_fit(fit: Fit) -> None:
    model = json.loads(flinders.export(fit, "betaflight-model").text)
    fusion, place, radius = model["downstream_fusion"], model["geo_reference"], model["ellipsoid_correction"]["radius"]
    assert place["field_strength_nt"] == pytest.approx(1e3 * FIELD_UT)
    assert place["inclination_deg"] == pytest.approx(65.0)
    assert fusion["nt_per_corrected_unit"] == pytest.approx(place["field_strength_nt"] / radius)
    assert fusion["gauss_per_corrected_unit"] == pytest.approx(place["field_strength_nt"] / radius / 1e5)
    assert place["declination_deg"] is fusion["earth_field_ned_gauss"] is place["latitude_deg"] is None


def test_the_residual_is_that_of_the_configurator_on_the_readings(fit: Fit) -> None:
    """computeRadiusAndResidual: the lengths of corrected readings about 1."""
    model = json.loads(flinders.export(fit, "betaflight-model").text)
    sensor = simulate.Sensor(SOFT, HARD, noise=0.5)
    raw = simulate.tumble(seed=3, sensor=sensor).samples.field / COUNT_UT
    lengths = np.linalg.norm(corrected(model, raw), axis=1)
    assert model["ellipsoid_correction"]["residual_rms"] == pytest.approx(np.sqrt(np.mean((lengths - 1) ** 2)), rel=0.1)


def test_the_noise_of_a_filter_has_the_error_of_the_calibration_in_it(fit: Fit) -> None:
    model = json.loads(flinders.export(fit, "betaflight-model").text)
    noise = noise_of(fit)
    assert noise is not None
    gauss = model["downstream_fusion"]["gauss_per_corrected_unit"]
    white = gauss * model["ellipsoid_correction"]["residual_rms"]
    sigma = model["downstream_fusion"]["mag_noise_gauss"]
    kept = noise.horizontal * np.deg2rad(noise.heading_calibration_deg) / 100.0  # µT in gauss
    assert sigma["sigma"] == pytest.approx(np.hypot(white, kept))
    assert sigma["sigma_xy"] == pytest.approx(noise.axis / 100.0)
    assert sigma["sigma_z"] == pytest.approx(np.sqrt(noise.field_covariance[2, 2]) / 100.0)
    assert kept > 0.02 * white


def test_what_is_not_known_is_null_and_said(fit: Fit) -> None:
    bare = find("betaflight-model").render(Calibration(np.eye(3), np.array([10.0, 20.0, 30.0]), 400.0))
    model = json.loads(bare.text)
    assert model["ellipsoid_correction"]["residual_rms"] is None
    assert model["geo_reference"]["field_strength_nt"] is None
    assert set(model["downstream_fusion"]["mag_noise_gauss"].values()) == {None}
    assert sum("null" in note for note in bare.fields["notes"]) == 4
    assert sum("null" in note for note in flinders.export(fit, "betaflight-model").export.fields["notes"]) == 2


def test_an_offset_that_the_board_cannot_hold_is_refused() -> None:
    with assert_raises(NotExportable):
        model_of(Calibration(np.eye(3), np.array([40_000.0, 0, 0]), 500.0))


@pytest.mark.parametrize(
    ("soft_iron", "strength_nt", "wanted"),
    [
        (np.eye(3), 5000.0, (False, True, True)),
        (np.eye(3), 200_000.0, (False, True, True)),
        ([[6.108e-4, 2.1e-5, 0], [0, 6.125e-4, 0], [0, 0, 6.214e-4]], 53_998.0, (True, True, True)),
        (np.diag([5, 0.1, 1]), 53_000.0, (True, True, False)),
        (np.diag([0.0008, 0.0010, 0.0009]), 50_000.0, (True, True, True)),
        (np.eye(3), None, (None, True, True)),
        (np.ones((3, 3)), 50_000.0, (True, False, True)),
    ],
)
def test_the_bounds_are_those_of_the_configurators_tests(
    soft_iron: ArrayLike, strength_nt: float | None, wanted: tuple[bool | None, ...]
) -> None:
    bounds = quality_bounds(to_floats(soft_iron), strength_nt)
    found = (bounds.field_strength_ok, bounds.soft_iron_offdiag_ok, bounds.soft_iron_anisotropy_ok)
    assert found == wanted
    assert bounds.bounds_ok == all(wanted)


# read


@pytest.mark.parametrize("is_captured", [True, False])
@pytest.mark.parametrize("own", [None, {"roll": 10.0, "pitch": -5.0, "yaw": 33.0}])
def test_models_in_either_axes_are_the_same_calibration(is_captured: bool, own: dict[str, float] | None) -> None:
    """For readings with the proposed align_mag, less nothing; lengths are relative, and the rotation is one's own."""
    proposed = euler(-172.0, 2.0, -88.0)
    text = configurator_model(proposed, 8 if own is None else 9, own, is_captured=is_captured)
    name, back = read_back(text.encode(), "model.json")
    assert (name, back.frame, back.unit, back.field_strength_known) == ("betaflight-model", "vehicle", "counts", False)
    assert np.linalg.det(back.matrix) == pytest.approx(1.0)
    npt.assert_allclose(back.offset, proposed @ OFFSET, atol=1e-6)
    whole = (SOFT * COUNT_UT / FIELD_UT) @ proposed.T
    gram = back.matrix.T @ back.matrix / back.field_strength**2
    npt.assert_allclose(gram, whole.T @ whole / 0.9998**2, rtol=1e-9, atol=1e-15)
    assert read_back(text.encode(), "model.json", strength=1200.0)[1].field_strength == 1200.0


def test_a_published_model_is_read() -> None:
    """In the axes of its capture; its hard iron is what the proposed mounting makes of its centre."""
    _, back = read_back(published().encode(), "model.json")
    npt.assert_allclose(back.offset, [691, 104, 222], atol=0.51)
    assert back.field_strength == pytest.approx(0.99958 / 0.000614842, rel=1e-3)  # by the diagonal of its soft iron
    npt.assert_allclose(np.linalg.det(back.matrix), 1.0)


def published(**changed: Any) -> str:
    """The published model, with some of its members changed."""
    model = {
        "$schema": "https://betaflight.com/blackbox/mag-characterization-model/2.2",
        "version": "2.2",
        "captured_under": {
            "alignment": 8, "custom_angles": None, "mag_zero": {"x": 0, "y": 0, "z": 0}, "mag_zero_known": True,
        },
        "ellipsoid_correction": {
            "center": {"x": 718.1486945735744, "y": 87.34691977261636, "z": 120.19816137825016},
            "soft_iron": [
                [0.0006108386065376121, -0.00002224487991968406, 0.000003480305064893268],
                [0, 0.0006125276975466668, -0.00002002882263904025],
                [0, 0, 0.0006213978055923319],
            ],
            "radius": 0.9995838926468598,
            "residual_rms": 0.011802174267325643,
        },
        "geo_reference": {
            "latitude_deg": 48.4085613, "longitude_deg": -71.1642049, "declination_deg": -15.334148548880249,
            "inclination_deg": 70.85317969538431, "field_strength_nt": 53871,
        },
        "alignment": {
            "preset": 9, "label": "CUSTOM", "euler_zyx_deg": {"roll": -172, "pitch": 2, "yaw": -87.99999999999999},
        },
        "hard_iron": {"x": 691, "y": 104, "z": 222},
        "quality": {"score_percent": 96, "residual_z_rms": 0.016289086812020816},
        "downstream_fusion": {
            "frame": "FRD",
            "nt_per_corrected_unit": 53893.42545061592,
            "gauss_per_corrected_unit": 0.5389342545061592,
            "mag_noise_gauss": {"sigma": 0.00636059599031292, "sigma_xy": None, "sigma_z": None},
            "quality_bounds": {"field_strength_mg": 538.71, "field_strength_ok": True},
        },
    }  # fmt: skip
    return json.dumps(model | changed)


def correction(**changed: Any) -> dict[str, Any]:
    """Its ellipsoid, with some members changed."""
    members: dict[str, Any] = json.loads(published())["ellipsoid_correction"]
    return members | changed


@pytest.mark.parametrize(
    "changed",
    [
        {"version": "2.1"},
        {"version": "3.0"},
        {"version": None},
        {"ellipsoid_correction": None},
        {"ellipsoid_correction": correction(soft_iron=[[1, 0, 0], [0, 1, 0]])},
        {"ellipsoid_correction": correction(soft_iron=[[1, 0, 0], [0, 1, 0], [1, 1, 0]])},
        {"ellipsoid_correction": correction(soft_iron=np.diag([1e200] * 3).tolist())},
        {"ellipsoid_correction": correction(radius=0)},
        {"ellipsoid_correction": correction(center={"x": 1, "y": 2})},
        {"ellipsoid_correction": correction(radius=float("nan"))},
        {"ellipsoid_correction": correction(center={"x": 718.0, "y": 87.0, "z": 150.0})},
        {"hard_iron": {"x": 691, "y": 104, "z": 232}},
        {"hard_iron": None},
        {"alignment": {"preset": 12}},
        {"alignment": {"preset": 9}},
        {"captured_under": {"alignment": -1}},
        {"downstream_fusion": {"frame": "FLU"}},
        {"ellipsoid_correction": correction(center=by_axis(np.zeros(3))), "hard_iron": by_axis(np.zeros(3))},
    ],
)  # fmt: skip
def test_models_of_another_schema_and_damaged_ones_are_refused(changed: dict[str, Any]) -> None:
    with assert_raises(DocumentError):
        read_back(published(**changed).encode(), "model.json")


@pytest.mark.parametrize("change", [lambda text: text[:900], lambda text: f"[{text}]"])
def test_what_is_no_json_object_is_refused(change: Callable[[str], str]) -> None:
    with assert_raises(DocumentError):
        read_back(change(published()).encode(), "model.json")


def test_import_says_what_the_model_proposes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = configurator_model(euler(-172.0, 2.0, -88.0), 8, None, is_captured=False)
    (tmp_path / "model.json").write_text(text, encoding="utf-8")
    ended = run("import", "model.json", "-o", "back.json")
    assert ended.exit_code == 0
    zero = ",".join(f"{value:.0f}" for value in axes_of(json.loads(text)["hard_iron"]))
    scale = COUNT_UT * np.linalg.det(SOFT) ** (1 / 3) / 0.9998
    assert (f"mag_calibration = {zero}" in ended.stderr, f"{scale:.5f} µT" in ended.stderr) == (True, True)
    assert_sentences(ended.stderr)
    assert "was not known" not in ended.stderr
    assert Calibration.load(tmp_path / "back.json").frame == "vehicle"


def test_a_model_goes_to_the_settings_of_the_board(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.json").write_text(published(), encoding="utf-8")
    assert run("import", "model.json", "-o", "back.json").exit_code == 0
    ended = run("export", "--for", "betaflight", "--lossy", "back.json")
    assert "set mag_calibration = 691,104,222\n" in ended.stdout
