"""How much stray field, how far the cable: figures of the sources, other ways to the same numbers, and bad input."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from tests.sentences import assert_raises, assert_sentences

from flinders.apps.classic.budget import (
    EXAMPLES,
    QUANTITIES,
    UNITS,
    Heading,
    Magnet,
    Pair,
    UnitValue,
    Wire,
    magnet_moment,
    parse,
)
from flinders.apps.classic.budget_relations import Relation, stray_budget
from flinders.cli import main
from flinders.errors import UnitError, UsageError

MU0 = 4e-7 * math.pi


def run(*words: str) -> tuple[int, str, str]:
    ended = CliRunner().invoke(main, ["budget", *words])
    return ended.exit_code, ended.stdout, ended.stderr


def found(*words: str) -> Any:  # noqa: ANN401 - whatever was printed
    code, out, err = run(*words, "--json")
    assert code == 0, err
    return json.loads(out)


# figures of the sources (literature §9, §10, §11)


def test_one_degree_at_150_milligauss_is_2_62_milligauss() -> None:
    stray = Heading.solve(field=parse("field", "150mG"), error_deg=1.0).stray / parse("field", "1mG")
    assert round(stray, 2) == 2.62
    assert round(150 * math.radians(1), 2) == round(150 * math.tan(math.radians(1)), 2) == 2.62


@pytest.mark.parametrize(("stray", "error"), [(1, 2.29), (5, 11.54), (10, 23.58)])
def test_worst_heading_errors_in_25_microtesla(stray: float, error: float) -> None:
    assert round(Heading.solve(field=25.0, stray=stray).error_deg, 2) == error


@pytest.mark.parametrize(
    ("current", "distance", "field"), [(1, 1, 20), (10, 10, 20), (10, 2, 100), (30, 5, 120), (0.2, 1, 4)]
)
def test_fields_of_wires_with_distances_in_centimetres(current: float, distance: float, field: float) -> None:
    assert Wire.solve(current=current, distance=distance / 100).stray == pytest.approx(field, rel=1e-12)


# the same by other ways


def test_the_worst_heading_error_is_the_largest_of_a_full_turn() -> None:
    turn = np.linspace(0, 2 * np.pi, 100_001)
    for share in (0.01, 0.3, 0.9):
        errors = np.rad2deg(np.arctan2(share * np.sin(turn), 1 + share * np.cos(turn)))
        assert Heading.solve(field=1.0, stray=share).error_deg == pytest.approx(errors.max(), rel=1e-6)


def biot_savart(start: float, end: float, at: tuple[float, float], wire: float, current: float) -> float:
    """µT across the plane at (x, y) of a straight wire along y at x = wire, summed over short pieces."""
    y = np.linspace(start, end, 2_000_001)
    across = at[0] - wire
    pieces = across / (across**2 + (at[1] - y) ** 2) ** 1.5
    return float(1e6 * MU0 * current / (4 * math.pi) * np.trapezoid(pieces, y))


def test_wire_and_pair_agree_with_biot_and_savart() -> None:
    one = biot_savart(-50, 50, (0.1, 0), 0.0, 10)
    assert Wire.solve(current=10, distance=0.1).stray == pytest.approx(one, rel=1e-5)
    both = biot_savart(-50, 50, (0.1, 0), 0.01, 10) - biot_savart(-50, 50, (0.1, 0), -0.01, 10)
    assert Pair.solve(current=10, separation=0.02, distance=0.1).stray == pytest.approx(both, rel=1e-4)


def test_the_plane_of_a_pair_is_the_worst_place() -> None:
    pair = Pair.solve(current=10, separation=0.02, distance=0.05)
    angle = np.linspace(0, np.pi, 181)
    at = 0.05 * np.array([np.cos(angle), np.sin(angle)])

    def field(wire: float, current: float) -> Any:  # noqa: ANN401 - an array
        x, y = at[0] - wire, at[1]
        return 0.2 * current * np.array([-y, x]) / (x**2 + y**2)

    assert np.linalg.norm(field(0.01, 10) + field(-0.01, -10), axis=0).max() == pytest.approx(pair.stray, rel=1e-12)


def test_a_magnet_is_a_small_loop_of_current() -> None:
    """On the axis of a loop B = µ₀ I a²/(2 (a² + r²)^1.5), which is that of a dipole of π a² I far away."""
    loop = 1e6 * MU0 * 5 * 0.001**2 / (2 * (0.001**2 + 0.3**2) ** 1.5)
    assert Magnet.solve(moment=math.pi * 0.001**2 * 5, distance=0.3).stray == pytest.approx(loop, rel=1e-4)


def test_beside_a_magnet_there_is_half_the_field_of_its_axis() -> None:
    moment, r = np.array([0.0, 0.0, 0.24]), 0.3
    for position, direction in (("axial", [0, 0, 1]), ("equatorial", [1, 0, 0])):
        unit = np.array(direction, float)
        dipole = 0.1 / r**3 * (3 * (moment @ unit) * unit - moment)  # literature §10
        solved = Magnet.solve(moment=0.24, distance=r, position=position)  # type: ignore[arg-type]
        assert solved.stray == pytest.approx(np.linalg.norm(dipole), rel=1e-12)


def test_a_magnet_of_a_cubic_centimetre_and_1_3_tesla() -> None:
    assert magnet_moment(remanence=1.3e6, volume=1e-6) == pytest.approx(1.3 * 1e-6 / MU0, rel=1e-12)


def test_far_away_a_pair_is_its_rule_of_thumb_and_near_by_more() -> None:
    far = Pair.solve(current=10, separation=0.01, distance=1)
    near = Pair.solve(current=10, separation=0.01, distance=0.02)
    assert far.stray == pytest.approx(0.2 * 10 * 0.01 / 1**2, rel=1e-4)
    assert near.stray == pytest.approx(16 / 15 * 0.2 * 10 * 0.01 / 0.02**2)


# quantities


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        ("field", "2.62mG", 0.262), ("field", "2.62 milligauss", 0.262), ("field", "40 µT", 40), ("field", "40 μT", 40),
        ("field", "0.15 Gauss", 15), ("field", "500nT", 0.5), ("field", "1.3T", 1.3e6), ("field", "MG", None),
        ("length", "1 cm", 0.01), ("length", "15MM", 0.015), ("length", "1e-1m", 0.1), ("length", ".5 in", 0.0127),
        ("length", "2 ft", 0.6096), ("length", "500 µm", 5e-4), ("current", "200mA", 0.2), ("current", "0.2 A", 0.2),
        ("current", "30 amps", 30), ("current", "1kA", 1000), ("angle", "1°", 1), ("angle", "1", 1),
        ("angle", "1 degree", 1), ("angle", "17.4532925199 mrad", 1), ("moment", "0.1 A·m²", 0.1),
        ("moment", "0.1Am2", 0.1), ("moment", "0.1 A m^2", 0.1), ("moment", "20 mA·m²", 0.02),
        ("moment", "100emu", 0.1), ("moment", "0.1 J/T", 0.1), ("volume", "0.236 cm³", 2.36e-7),
        ("volume", "1cc", 1e-6),
        ("current", "1MA", None), ("field", "3 counts", None), ("length", "3 mG", None), ("length", "3", None),
        ("current", "A", None), ("current", "-1A", None), ("current", "0A", None), ("current", "nanA", None),
        ("current", "infA", None), ("length", "1,5cm", None), ("length", "1.5.3cm", None), ("field", "1e999mG", None),
        ("field", "1e-999mG", None), ("field", "", None), ("angle", "°", None), ("length", "1 2 cm", None),
    ],
)  # fmt: skip
def test_quantities_as_they_are_typed(kind: Any, text: str, value: float | None) -> None:  # noqa: ANN401 - a Kind
    if value is None:
        with pytest.raises(UsageError, match=kind):
            parse(kind, text)
    else:
        assert parse(kind, text) == pytest.approx(value, rel=1e-9)


def test_each_kind_has_an_example_that_can_be_read() -> None:
    for kind in UNITS:
        assert UnitValue.of(kind, EXAMPLES[kind]).unit in UNITS[kind]


def test_an_unknown_unit_names_those_there_are() -> None:
    with assert_raises(UnitError):
        parse("length", "3 furlong")


def test_a_decimal_comma_is_told_how_to_be_written() -> None:
    with assert_raises(UsageError):
        parse("length", "1,5cm")


# what cannot be solved


@pytest.mark.parametrize(
    ("solve", "known"),
    [
        (Wire.solve, {"current": 1}),
        (Wire.solve, {"current": 1, "distance": 1, "stray": 1}),
        (Wire.solve, {"current": -1, "distance": 1}),
        (Wire.solve, {"current": 1, "distance": math.nan}),
        (Wire.solve, {"current": 1, "distance": math.inf}),
        (Wire.solve, {"current": 1e300, "distance": 1e-300}),
        (Heading.solve, {"field": 20, "error_deg": 91}),
        (Heading.solve, {"field": 20, "stray": 21}),
        (Pair.solve, {"current": 1, "separation": 0.1, "distance": 0.05}),
        (Magnet.solve, {"moment": 1, "distance": 1, "position": "above"}),
    ],
)
def test_what_cannot_be_solved_says_why(solve: Any, known: dict[str, Any]) -> None:  # noqa: ANN401
    with assert_raises(UsageError):
        solve(**known)


# the use case


def test_each_relation_is_solved_for_any_quantity_that_is_left_out() -> None:
    """What a source makes at a distance is found at that distance again."""
    made: dict[Relation, dict[str, str]] = {
        "wire": {"current": "0.2A", "distance": "1cm"},
        "pair": {"current": "10A", "separation": "5mm", "distance": "10cm"},
        "magnet": {"moment": "0.24Am2", "distance": "30cm"},
    }
    for relation, given in made.items():
        stray = f"{stray_budget(relation, given).known['stray']!r}uT"
        for name, text in given.items():
            others = {key: value for key, value in given.items() if key != name}
            found = stray_budget(relation, {**others, "stray": stray}).known[name]
            assert found == pytest.approx(UnitValue.of(QUANTITIES[name][0], text).value, rel=1e-6), (relation, name)


def test_a_magnet_may_be_given_by_its_remanence_and_the_sensor_be_off_its_side() -> None:
    given = {"remanence": "1.3T", "volume": "0.236cm3", "distance": "30cm"}
    axial, side = (stray_budget("magnet", given, side=side).known["stray"] for side in (False, True))
    assert axial == pytest.approx(2.0 * side)


@pytest.mark.parametrize(
    ("relation", "given"),
    [
        ("heading", {"field": "20uT"}),
        ("heading", {"field": "20uT", "current": "1A"}),
        ("wire", {"current": "1A"}),
        ("wire", {"current": "3uT", "distance": "1cm"}),
        ("cable", {}),
    ],
)
def test_quantities_that_make_no_relation_are_named(relation: Relation, given: dict[str, str]) -> None:
    with assert_raises(UsageError):
        stray_budget(relation, given)


# the command


def test_how_far_the_cable_must_be() -> None:
    told = found("wire", "--current", "0.2A", "--field", "150mG", "--error", "1deg")
    assert told["stray_uT"] == pytest.approx(0.262, abs=5e-4)
    assert told["distance_m"] == pytest.approx(0.2 * 0.2 / told["stray_uT"])
    assert told["derived"] == ["stray_uT", "distance_m"]


def test_each_unknown_of_a_pair_comes_back() -> None:
    whole = {"current": "10A", "separation": "5mm", "distance": "10cm"}
    keys = {"current": "current_A", "separation": "separation_m", "distance": "distance_m"}
    stray = found("pair", *(word for name in whole for word in (f"--{name}", whole[name])))["stray_uT"]
    for name, text in whole.items():
        others = [word for other in whole if other != name for word in (f"--{other}", whole[other])]
        told = found("pair", *others, "--stray", f"{stray!r}uT")
        kind: Any = "current" if name == "current" else "length"
        assert told[keys[name]] == pytest.approx(parse(kind, text), rel=1e-12)
        assert told["derived"] == [keys[name]]


def test_a_source_and_the_field_give_the_heading_error_and_with_the_error_the_field() -> None:
    source = ("magnet", "--moment", "0.24Am2", "--distance", "30cm")
    stray = found(*source)["stray_uT"]
    error = found(*source, "--field", "20uT")["error_deg"]
    assert error == pytest.approx(math.degrees(math.asin(stray / 20)))
    assert found(*source, "--error", f"{error!r}deg")["field_uT"] == pytest.approx(20)
    assert found(*source, "--side")["stray_uT"] == pytest.approx(stray / 2)


def test_results_are_in_the_units_that_were_typed() -> None:
    assert "2.62 mG" in run("heading", "--field", "150 mG", "--error", "1")[1]
    assert "262 nT" in run("heading", "--field", "15000nT", "--error", "1deg")[1]
    assert "4.00 µT = 40.0 mG" in run("wire", "--current", "0.2A", "--distance", "1cm")[1]
    assert "6.01 in" in run("pair", "--current", "10A", "--separation", "0.2in", "--stray", "0.4358uT")[1]


def test_a_stray_field_above_the_earths_gives_any_heading() -> None:
    code, out, _ = run("wire", "--current", "30A", "--distance", "2cm", "--field", "20uT")
    assert code == 0
    assert "any" in out
    assert "15 times the horizontal field" in out
    assert found("wire", "--current", "30A", "--distance", "2cm", "--field", "20uT")["error_deg"] is None


@pytest.mark.parametrize(
    "words",
    [
        "wire",
        "wire --current 1A",
        "pair --current 1A --distance 3cm --field 20uT",
        "wire --current 1A --distance 1cm --stray 3uT",
        "wire --current 1A --distance 1cm --field 20uT --error 3",
        "wire --current 1A --field 20uT --error 3 --stray 3uT",
        "heading --field 20uT",
        "heading --field 20uT --stray 1uT --error 3",
        "wire --current 3uT --distance 1cm",
        "wire --current 3 --distance 1cm",
        "heading --field 20counts --error 1",
        "magnet --remanence 1T --distance 3cm",
        "magnet --remanence 1T --volume 1cm3 --moment 1Am2 --distance 3cm",
        "heading --field 20uT --error 120deg",
        "wire --current 1A --stray",
        "tube --current 1A",
    ],
)
def test_wrong_use_is_one_line_and_exit_code_2(words: str) -> None:
    code, out, err = run(*words.split())
    assert (code, out) == (2, "")
    assert_sentences(err)
    assert len(err.splitlines()) == 1
