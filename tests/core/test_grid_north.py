"""North of the map's grid: published convergences, the laws of the projection, and zones with their exceptions."""

from __future__ import annotations

import math

import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flinders.core.geomag import site_field
from flinders.core.grid_north import grid_north, utm_convergence_deg, utm_zone


def degrees(whole: int, minutes: int, seconds: float) -> float:
    return math.copysign(abs(whole) + minutes / 60.0 + seconds / 3600.0, whole)


def test_published_convergences_are_met_to_their_digits() -> None:
    """Flinders Peak of the *Geocentric Datum of Australia Technical Manual*, to 0.01″; its sign is the other one.

    Bergen of C. Veness's *geodesy*, which was compared with GeographicLib.
    """
    peak = grid_north(degrees(-37, 57, 3.7203), degrees(144, 25, 29.5244))
    assert peak.name == "UTM 55S"
    assert 3600.0 * (-peak.convergence_deg - degrees(-1, 35, 3.65)) == pytest.approx(0.0, abs=0.0051)
    bergen = grid_north(60.39135, 5.3249)
    assert (bergen.name, round(bergen.convergence_deg, 9)) == ("UTM 32N", -3.196281440)


PROJ = """
47.6205 -122.3493 0.48067932284791615
78.2 15.6 0.587321331797422
-33.857 151.215 0.9946878558509329
52.657570301933 1.717921580646 -1.0193468218732267
"""
"""Latitude, longitude, convergence by PROJ 9.5.1; of 20,000 random places none differed by more than 2.4e-10°."""


@pytest.mark.parametrize("row", PROJ.strip().splitlines())
def test_another_program_finds_the_same(row: str) -> None:
    latitude, longitude, convergence = map(float, row.split())
    assert grid_north(latitude, longitude).convergence_deg == pytest.approx(convergence, abs=1e-9)


latitudes, offsets = st.floats(-80.0, 84.0), st.floats(-6.0, 6.0)


@given(latitudes, offsets)
def test_convergence_is_antisymmetric_about_the_middle_meridian_and_the_equator(latitude: float, offset: float) -> None:
    here = utm_convergence_deg(latitude, offset)
    npt.assert_allclose(utm_convergence_deg(latitude, -offset), -here, atol=1e-12)
    npt.assert_allclose(utm_convergence_deg(-latitude, offset), -here, atol=1e-12)
    assert utm_convergence_deg(latitude, 0.0) == pytest.approx(0.0, abs=1e-12)
    assert utm_convergence_deg(0.0, offset) == pytest.approx(0.0, abs=1e-12)


@given(latitudes, offsets)
def test_on_a_sphere_it_would_be_nearly_the_same(latitude: float, offset: float) -> None:
    sphere = math.degrees(math.atan(math.tan(math.radians(offset)) * math.sin(math.radians(latitude))))
    assert utm_convergence_deg(latitude, offset) == pytest.approx(sphere, abs=2e-3)


@pytest.mark.parametrize(
    ("latitude", "longitude", "zone"),
    [
        (0.0, -180.0, 1), (0.0, 180.0, 1), (0.0, 179.999, 60), (0.0, 360.0, 31), (47.6, -122.3, 10),
        (60.0, 2.999, 31), (60.0, 3.0, 32), (60.0, 11.999, 32), (55.999, 3.0, 31), (64.0, 3.0, 31),
        (75.0, 8.999, 31), (75.0, 9.0, 33), (75.0, 20.999, 33), (75.0, 21.0, 35), (75.0, 33.0, 37), (75.0, 42.0, 38),
        (71.999, 8.0, 32), (75.0, -0.001, 30),
    ],
)  # fmt: skip
def test_zones_have_the_exceptions_of_norway_and_svalbard(latitude: float, longitude: float, zone: int) -> None:
    assert utm_zone(latitude, longitude) == zone


@pytest.mark.parametrize(
    ("latitude", "longitude", "name", "convergence"),
    [
        (85.0, 90.0, "UPS north", 90.0), (-85.0, 90.0, "UPS south", -90.0), (88.0, -30.0, "UPS north", -30.0),
        (-88.0, -30.0, "UPS south", 30.0), (84.0, 180.0, "UPS north", 180.0), (-90.0, 0.0, "UPS south", 0.0),
    ],
)  # fmt: skip
def test_around_the_poles_the_grid_is_ups(latitude: float, longitude: float, name: str, convergence: float) -> None:
    north = grid_north(latitude, longitude)
    assert (north.name, north.convergence_deg) == (name, convergence)


@given(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
def test_magnetic_north_is_as_far_from_grid_north_as_declination_less_convergence(lat: float, lon: float) -> None:
    site = site_field(lat, lon, year=2026.0, model="igrf")
    turn = site.declination_deg - site.grid.convergence_deg - site.grid_declination_deg
    assert math.remainder(turn, 360.0) == pytest.approx(0.0, abs=1e-9)
    assert -180.0 < site.grid_declination_deg <= 180.0
