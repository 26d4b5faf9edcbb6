"""IGRF-14: published values of each century's epochs, agreement with the World Magnetic Model, and its uncertainty."""

from __future__ import annotations

import math

import numpy as np
import numpy.testing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flinders.core.geomag import site_field
from flinders.core.igrf import coefficients, geocentric_field, igrf_field

GEOCENTRIC = """
1900 6300 175 -150 -5072.93 10620.34 -67233.55
1915 6350 155 -120 14692.62 12387.97 -59640.81
1930 6400 135  -90 23925.47 10358.94 -30640.98
1945 6450 115  -60 23642.86  -200.29  -7607.92
1960 6500  95  -30 23647.00 -9302.27  -3610.73
1975 6550  75    0 30050.59 -3367.82   6332.69
1990 6600  55   30 25224.81  1058.25  30965.61
2005 6650  35   60 14718.37  2842.99  46050.88
2020 6700  15   90  3734.07  1294.17  50833.13
"""
"""Year, radius in km, colatitude, longitude; north, east, down in nT: test values for IGRF-14 by C. D. Beggan, British
Geological Survey (``tests_igrf14.py`` of pyIGRF)."""

GEODETIC = """
1900.5  59.9   -109.9     1.1    33.01  82.33   7074   4596  62650
1950.5  59.9   -109.9     1.1    27.82  82.05   7445   3929  60298
2009.5  59.9   -109.9     1.1    15.51  80.39   9532   2646  58409
1900.5 -59.9      0.0   100.1   -22.50 -61.38  18154  -7520 -36011
1985.5 -59.9      0.0   100.1   -20.02 -60.50  14668  -5345 -27596
2004.5 -59.9      0.0   100.1   -19.71 -59.63  14295  -5122 -25909
1900.5  86.494  162.867   0.0    85.34  87.30    221   2712  57739
2009.5  86.494  162.867   0.0    75.18  89.40    152    575  57181
2029.5  86.494  162.867   0.0   -94.11  89.39    -44   -616  57575
"""
"""Year, latitude, longitude, km; declination, dip, north, east, down in nT: printed by the working group's own program
(``igrf14.f``), as go-igrf keeps them."""


@pytest.mark.parametrize("row", GEOCENTRIC.strip().splitlines())
def test_values_of_the_survey_are_met_to_a_hundredth_of_a_nanotesla(row: str) -> None:
    year, radius, colatitude, longitude, *printed = map(float, row.split())
    npt.assert_allclose(geocentric_field(radius, colatitude, longitude, year=year), printed, atol=0.0101)


@pytest.mark.parametrize("row", GEODETIC.strip().splitlines())
def test_values_of_the_working_groups_program_are_met_to_their_digits(row: str) -> None:
    year, latitude, longitude, height, *printed = map(float, row.split())
    site = site_field(latitude, longitude, 1e3 * height, year=year, model="igrf")
    npt.assert_allclose([site.declination_deg, site.inclination_deg], printed[:2], atol=0.00501)
    npt.assert_allclose([1e3 * part for part in (site.north, site.east, site.down)], printed[2:], atol=0.501)


def test_the_table_is_that_of_igrf_14() -> None:
    table = coefficients()
    assert table.years.tolist() == [*range(1900, 2035, 5)]
    assert table.g[-2, 1, 0] == -29350.0
    assert not table.g[:19, 11:].any()  # degree 10 until 1990
    assert table.g[20:26, 13, 13].all()


def test_it_agrees_with_the_world_magnetic_model_within_the_uncertainty_of_either() -> None:
    """Strengths within 1 σ everywhere, also where one model follows the other."""
    for year in (2010.0, 2015.0, 2020.0, 2025.0):
        for latitude in (-75.0, -30.0, 0.0, 50.0, 80.0):
            for longitude in range(-180, 180, 60):
                world, reference = (site_field(latitude, longitude, year=year, model=each) for each in ("wmm", "igrf"))
                assert abs(world.strength - reference.strength) < 0.138
                turn = math.remainder(world.declination_deg - reference.declination_deg, 360.0)
                assert abs(turn) < math.hypot(0.26, 5.417 / world.horizontal)


@given(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0), st.floats(1900.0, 2030.0))
def test_the_field_is_one_around_the_earth_and_at_the_poles(latitude: float, longitude: float, year: float) -> None:
    """Going once round in longitude returns to the same field, and the poles have one field from all sides."""
    npt.assert_allclose(
        igrf_field(latitude, longitude, year=year), igrf_field(latitude, longitude + 360.0, year=year), atol=1e-6
    )
    north, east, down = igrf_field(90.0, longitude, year=year)
    other_north, other_east, other_down = igrf_field(90.0, 0.0, year=year)
    assert down == pytest.approx(other_down, abs=1e-3)
    turn = np.radians(longitude)
    npt.assert_allclose(
        [np.cos(turn) * north + np.sin(turn) * east, np.sin(turn) * north - np.cos(turn) * east],
        [other_north, -other_east], atol=1e-3,
    )  # fmt: skip


def test_the_uncertainty_is_that_of_the_components() -> None:
    """Against the scatter of the elements under scattered components."""
    site = site_field(47.6, -122.3, year=1985.0)
    rng = np.random.default_rng(1)
    north, east, down = (
        1e3 * part + sigma * rng.normal(size=100_000)
        for part, sigma in ((site.north, 144.0), (site.east, 136.0), (site.down, 293.0))
    )
    horizontal = np.hypot(north, east)
    assert np.degrees(np.arctan2(east, north)).std() == pytest.approx(site.declination_sigma_deg, rel=0.02)
    assert np.degrees(np.arctan2(down, horizontal)).std() == pytest.approx(site.inclination_sigma_deg, rel=0.02)
    assert 1e-3 * np.hypot(horizontal, down).std() == pytest.approx(site.strength_sigma, rel=0.02)
    for year in (1979.0, 2026.0):
        assert site_field(47.6, -122.3, year=year, model="igrf").strength_sigma is None
