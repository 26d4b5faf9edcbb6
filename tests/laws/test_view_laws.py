"""The pure parts of the 3-D view, run by Node.js: the scale of colours, and the shapes that are drawn."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.testing as npt
import pytest
from tests import javascript

from flinders import simulate
from flinders.geometry.sphere import tiles

if TYPE_CHECKING:
    from flinders.arrays import Floats

VIEWS = Path(__file__).resolve().parents[2] / "src" / "flinders" / "static" / "views"
RATIOS = np.geomspace(0.5, 12.0, 60)
TARGETS = np.array([0.2, 1.0, 3.0])

# Viénot, Brettel and Mollon 1999: how people without the green cones see linear sRGB.
DEUTERANOPIA = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]])


@pytest.fixture(scope="module")
def node(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the modules that draw nothing."""
    folder = tmp_path_factory.mktemp("views")
    (folder / "package.json").write_text('{"type": "module"}', encoding="utf-8")
    for name in ("colours", "detail", "geometry", "marks", "turn", "vectors"):
        shutil.copyfile(VIEWS / f"{name}.js", folder / f"{name}.js")
    return folder


def run(folder: Path, script: str, **given: object) -> Any:  # noqa: ANN401
    """What the script prints as JSON; `given` are its constants."""
    lines = [f"const {name} = {json.dumps(value)};" for name, value in given.items()]
    source = [
        'import * as colours from "./colours.js";',
        'import * as details from "./detail.js";',
        'import * as geometry from "./geometry.js";',
        'import * as marking from "./marks.js";',
        'import * as turn from "./turn.js";',
        *lines,
        f"console.log(JSON.stringify({script}));",
    ]
    (folder / "script.mjs").write_text("\n".join(source), encoding="utf-8")
    done = subprocess.run([javascript.node(), "script.mjs"], cwd=folder, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def polygons() -> dict[str, Any]:
    return {
        "centres": tiles().centres.ravel().round(5).tolist(),
        "corners": [ring.ravel().round(5).tolist() for ring in tiles().polygons()],
    }


def linear(colours: Floats) -> Floats:
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def lab(colours: Floats) -> Floats:
    """OKLab of linear sRGB (Ottosson 2020)."""
    to_cones = [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
    to_lab = [
        [0.2104542553, 0.793617785, -0.0040720468],
        [1.9779984951, -2.428592205, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.808675766],
    ]
    turned: Floats = np.cbrt(np.clip(colours, 0.0, None) @ np.transpose(to_cones)) @ np.transpose(to_lab)
    return turned


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_a_larger_error_is_always_drawn_darker(node: Path, theme: str) -> None:
    drawn = run(node, "at.map((deg) => colours.errorColour(deg, 1, theme))", at=RATIOS.tolist(), theme=theme)
    lightness = lab(linear(np.array(drawn)))[:, 0]
    assert (np.diff(lightness) < 0.0).all()
    assert lightness[0] - lightness[-1] > 0.3


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_without_green_cones_the_marks_of_the_legend_still_differ(node: Path, theme: str) -> None:
    script = "colours.LEGEND_STOPS.map((ratio) => colours.errorColour(ratio, 1, theme))"
    seen = lab(linear(np.array(run(node, script, theme=theme))) @ DEUTERANOPIA.T)
    steps = np.linalg.norm(np.diff(seen, axis=0), axis=1)
    assert steps.min() > 0.05  # a just noticeable difference is about 0.02


def test_the_colour_hangs_on_error_over_target_alone(node: Path) -> None:
    script = "targets.map((target) => at.map((ratio) => colours.errorColour(ratio * target, target, 'dark')))"
    drawn = np.array(run(node, script, at=RATIOS.tolist(), targets=TARGETS.tolist()))
    npt.assert_allclose(drawn, np.broadcast_to(drawn[:1], drawn.shape), atol=1e-9)


def test_what_is_not_known_has_no_colour_of_the_scale(node: Path) -> None:
    unknown = np.array(run(node, "[null, NaN].map((deg) => colours.errorColour(deg, 1, 'dark'))"))
    npt.assert_array_equal(unknown[0], unknown[1])
    assert np.ptp(unknown[0]) < 0.1, "grey"


def test_the_fans_of_the_tiles_are_the_sphere(node: Path) -> None:
    script = "Object.fromEntries(Object.entries(geometry.tileMesh(given)).map(([name, all]) => [name, [...all]]))"
    mesh = run(node, script, given=polygons())
    position = np.reshape(mesh["position"], (-1, 3))
    npt.assert_allclose(np.linalg.norm(position, axis=1), 1.0, atol=2e-5)
    a, b, c = (position[corner] for corner in np.reshape(mesh["index"], (-1, 3)).T)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))  # of a triangle with the centre, six times
    assert volume.min() > 0.0, "each is seen from outside"
    angle = 2.0 * np.arctan2(
        volume,
        1.0 + np.einsum("ij,ij->i", a, b) + np.einsum("ij,ij->i", b, c) + np.einsum("ij,ij->i", c, a),
    )  # Van Oosterom and Strackee 1983
    npt.assert_allclose(angle.sum(), 4.0 * np.pi, rtol=1e-5)
    npt.assert_allclose(
        np.bincount(np.take(mesh["tile"], np.reshape(mesh["index"], (-1, 3))[:, 0]).astype(int), angle),
        tiles().areas,
        rtol=1e-2,
    )


def test_the_arrow_ends_at_its_target_and_stays_in_one_plane(node: Path) -> None:
    rng = np.random.default_rng(7)
    ends = rng.normal(size=(12, 2, 3))
    ends[0, 1] = -ends[0, 0]  # opposite: any great circle will do
    ends[1] = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]
    ends /= np.linalg.norm(ends, axis=2, keepdims=True)
    script = """ends.map(([from, to]) => {
        const out = geometry.strokes(geometry.SHAFT + 1);
        geometry.arrow(from, to, out);
        return [[...out.start], [...out.end]];
    })"""
    for (begin, end), (starts, stops) in zip(ends, run(node, script, ends=ends.tolist()), strict=True):
        first, last = np.reshape(starts, (-1, 3)), np.reshape(stops, (-1, 3))
        npt.assert_allclose(first[0] / np.linalg.norm(first[0]), begin, atol=1e-5)
        npt.assert_allclose(last[-1] / np.linalg.norm(last[-1]), end, atol=1e-5)
        npt.assert_allclose(first[1:], last[:-1], atol=1e-6)
        assert np.linalg.norm(last, axis=1).min() > 1.0, "off the sphere"
        assert np.linalg.matrix_rank(np.vstack([first, last]), tol=1e-4) == 2


def test_readings_are_drawn_under_the_correction(node: Path) -> None:
    recording = simulate.tumble(seed=3, n=200)
    matrix, offset = recording.sensor.correction
    given = {"matrix": matrix.tolist(), "offset": offset.tolist(), "strength": recording.field_strength}
    drawn = np.reshape(run(node, "geometry.drawMatrix(given)", given=given), (4, 4)).T  # written by columns
    field = recording.samples.field
    homogeneous = np.column_stack([field, np.ones(len(field))])
    expected = (field - offset) @ matrix.T / recording.field_strength
    npt.assert_allclose(homogeneous @ drawn.T, np.column_stack([expected, np.ones(len(field))]), atol=1e-12)


@pytest.mark.parametrize("stride", [1, 3])
def test_marks_are_those_of_each_reading(node: Path, stride: int) -> None:
    rng = np.random.default_rng(stride)
    time = np.sort(rng.uniform(0.0, 60.0, 300)).round(3)
    firsts = np.sort(rng.choice(300 * stride, 12, replace=False))
    runs = [[int(a), int(min(a + 4, b - 1))] for a, b in zip(firsts, [*firsts[1:], 10**6], strict=True)]
    spans = [[5.0, 9.0], [40.0, 41.5]]
    script = """((marks) => {
        marking.mark(marks, {count: 200, time, stride}, runs, spans);
        marking.mark(marks, {count: 300, time, stride}, runs, spans, 200);
        return [...marks];
    })(new Uint8Array(300))"""
    drawn = run(node, script, time=time.tolist(), runs=runs, spans=spans, stride=stride)
    reading = np.arange(300) * stride
    rejected = np.any([(a <= reading) & (reading <= b) for a, b in runs], axis=0)
    excluded = np.any([(a <= time) & (time <= b) for a, b in spans], axis=0)
    npt.assert_array_equal(drawn, np.where(excluded, 2, rejected.astype(int)))
    assert {0, 1, 2} == set(drawn)


# the drawn board

FOLLOWED = """readings.map(({field, acceleration}) => {
    attitude.follow({raw: field, acceleration}, {offset: [0, 0, 0], matrix: turn.LEVEL, strength: 1});
    return attitude.rotation;
})"""


def followed(node: Path, fields: Floats, forces: Floats | None) -> Floats:
    """(N, 3, 3) attitudes that are drawn for directions of the field and specific forces."""
    accelerations = [None] * len(fields) if forces is None else forces.tolist()
    pairs = zip(fields.tolist(), accelerations, strict=True)
    readings = [{"field": field, "acceleration": acceleration} for field, acceleration in pairs]
    script = f"((attitude) => {FOLLOWED})(new turn.Attitude())"
    return np.array(run(node, script, readings=readings))


def test_the_board_turns_and_the_field_stays_where_it_is(node: Path) -> None:
    fields = simulate.tumble(seed=2, n=300, noise=0.0).samples.field
    fields = fields - fields.mean(axis=0)
    attitudes = followed(node, fields, None)
    npt.assert_allclose(np.linalg.det(attitudes), 1.0)
    directions = fields / np.linalg.norm(fields, axis=1, keepdims=True)
    there = np.einsum("nij,nj->ni", attitudes, directions)
    npt.assert_allclose(there, np.broadcast_to(there[0], there.shape), atol=1e-9)


def test_with_an_accelerometer_up_is_up_and_north_is_away(node: Path) -> None:
    rng = np.random.default_rng(4)
    forces, fields = (simulate.uniform_directions(rng, 100) for _ in range(2))
    is_level = np.abs(np.sum(forces * fields, axis=1)) < 0.99  # near the magnetic poles there is no north
    forces, fields = forces[is_level], fields[is_level]
    attitudes = followed(node, fields, forces)
    npt.assert_allclose(np.linalg.det(attitudes), 1.0)
    up = np.einsum("nij,nj->ni", attitudes, forces)
    npt.assert_allclose(up[:, :2], 0.0, atol=1e-9)
    field = np.einsum("nij,nj->ni", attitudes, fields)
    npt.assert_allclose(field[:, 0], 0.0, atol=1e-9)
    assert (field[:, 1] > 0.0).all()


def test_the_turn_that_is_drawn_leads_the_field_to_where_the_arrow_points(node: Path) -> None:
    rng = np.random.default_rng(5)
    starts, ends = (simulate.uniform_directions(rng, 40) for _ in range(2))
    ends[0], ends[1] = starts[0], -starts[1]
    script = "pairs.map(([from, to]) => turn.rotation(turn.between(to, from)))"
    turns = np.array(run(node, script, pairs=list(zip(starts.tolist(), ends.tolist(), strict=True))))
    body = np.swapaxes(turns, 1, 2)  # from axes that stay to those of the board that has turned
    npt.assert_allclose(np.einsum("nij,nj->ni", body, starts), ends, atol=1e-6)


# low detail

CHANGES = """((detail) => pictures.flatMap((ms, k) => detail.took(ms) ? [[k, detail.isLow]] : []))(
    new details.Detail()
)"""


def test_slow_pictures_lower_the_detail_and_one_hitch_does_not(node: Path) -> None:
    assert run(node, CHANGES, pictures=[16.0] * 50 + [900.0] + [16.0] * 50) == []
    ((when, is_low),) = run(node, CHANGES, pictures=[16.0] * 50 + [70.0] * 50)
    assert is_low
    assert when < 50 + 10


def test_full_detail_is_tried_again_more_and_more_seldom(node: Path) -> None:
    slow, fast = [70.0] * 20, [16.0] * 500
    changes = run(node, CHANGES, pictures=(slow + fast) * 3)
    assert [is_low for _, is_low in changes] == [True, False] * 3
    waits = [up - down for (down, _), (up, _) in zip(changes[::2], changes[1::2], strict=True)]
    assert np.diff(waits).tolist() == pytest.approx([90, 180], abs=2)
