"""The field at a site: the numbers that NOAA printed for its model, the dates it holds for, what is refused."""

from __future__ import annotations

import datetime
import subprocess
import sys
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy.testing as npt
import pytest
from tests.sentences import assert_raises

from flinders.core.geomag import SiteField, decimal_year, parse_place, recorded_field, site_field
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.core.geomag import FieldModel

WMM2025 = """
2025.0   0  80   0   6521.6   145.9  54791.5  1.28
2025.0   0   0 120  39677.8  -109.6 -10580.2 -0.16
2025.0   0 -80 240   6117.5 15751.9 -52022.5 68.78
2025.0 100  80   0   6216.0    92.4  52598.8  0.85
2025.0 100   0 120  37688.6   -96.2 -10152.1 -0.15
2025.0 100 -80 240   5907.6 14780.3 -49540.7 68.21
2027.5   0  80   0   6500.8   294.5  54869.4  2.59
2027.5   0   0 120  39701.6  -167.4 -10381.8 -0.24
2027.5   0 -80 240   6200.7 15730.3 -51783.7 68.49
2027.5 100  80   0   6196.7   233.8  52670.5  2.16
2027.5 100   0 120  37711.5  -148.7  -9969.8 -0.23
2027.5 100 -80 240   5984.0 14760.1 -49317.7 67.93
"""
"""Year, km, latitude, longitude; north, east, down in nT, declination: the table of NOAA's report on WMM2025."""


def field(row: str) -> tuple[SiteField, list[str]]:
    year, height, latitude, longitude, *printed = row.split()
    return site_field(float(latitude), float(longitude), 1e3 * float(height), year=float(year)), printed


@pytest.mark.parametrize("row", WMM2025.strip().splitlines())
def test_the_printed_values_of_wmm2025_are_met_to_their_digits(row: str) -> None:
    site, printed = field(row)
    found = [f"{1e3 * part:.1f}" for part in (site.north, site.east, site.down)]
    assert [*found, f"{site.declination_deg:.2f}"] == printed


def test_a_row_of_noaas_test_file_is_met_to_a_thousandth_of_a_nanotesla() -> None:
    site = site_field(43.0, 93.0, 65_000.0, year=2025.0)
    found = [1e3 * part for part in (site.north, site.east, site.down, site.strength)]
    npt.assert_allclose(found, [24299.852822, 210.517066, 50037.923998, 55626.621348], atol=5e-4)
    assert (f"{site.declination_deg:.2f}", f"{site.inclination_deg:.2f}") == ("0.50", "64.10")


def test_the_coefficients_are_those_that_were_published() -> None:
    from pygeomag.wmm.wmm_2025 import WMM_2025

    first = {(n, m): (g, dg) for n, m, g, _, dg, _ in WMM_2025[1]}
    assert first[1, 0] == (-29351.8, 12.0)
    assert first[1, 1][0] == -1410.8
    assert first[2, 0][0] == -2556.6


@pytest.mark.parametrize(
    ("year", "model"),
    [
        (1900.0, "IGRF-14"), (2009.99, "IGRF-14"),
        (2010.0, "WMM-2010"), (2014.99, "WMM-2010"), (2015.0, "WMM-2015v2"), (2020.0, "WMM-2020"),
        (2024.999, "WMM-2020"), (2025.0, "WMM-2025"), (2030.0, "WMM-2025"),
    ],
)  # fmt: skip
def test_each_year_has_its_model(year: float, model: str) -> None:
    assert site_field(47.0, 8.0, year=year).model == model


def test_models_meet_where_one_follows_the_other() -> None:
    """The forecast of five years is off by as much as is published, not more."""
    for year in (2010.0, 2015.0, 2020.0, 2025.0):
        before, after = (site_field(47.0, 8.0, year=at) for at in (year - 1e-6, year))
        assert abs(before.declination_deg - after.declination_deg) < 0.3
        assert abs(before.strength - after.strength) < 0.2


def test_the_published_uncertainty_goes_with_the_horizontal_field() -> None:
    site = site_field(0.0, 120.0, year=2026.0)
    assert site.declination_sigma_deg == pytest.approx((0.26**2 + (5.417 / site.horizontal) ** 2) ** 0.5)
    assert site.inclination_sigma_deg == 0.2
    assert site.strength_sigma == pytest.approx(0.138)
    assert site_field(0.0, 120.0, year=2012.0).declination_sigma_deg is None


def test_where_the_field_is_vertical_the_compass_is_doubted() -> None:
    near = site_field(86.0, 140.0, year=2025.0)
    assert near.is_blackout
    assert "below 2,000 nT" in near.warning
    assert "unreliable" in site_field(80.0, -100.0, year=2025.0).warning
    assert site_field(47.0, 8.0, year=2025.0).warning == ""


def test_parts_of_the_field_agree_with_each_other() -> None:
    site = site_field(-33.9, 151.2, 40.0, year=2026.5)
    assert site.horizontal == pytest.approx((site.north**2 + site.east**2) ** 0.5)
    assert site.strength == pytest.approx((site.horizontal**2 + site.down**2) ** 0.5)
    assert site.inclination_deg < 0.0
    assert site.as_dict()["latitude_deg"] == -33.9
    assert "declination 12." in str(site)


def test_days_become_years() -> None:
    assert decimal_year("2026-01-01") == decimal_year(2026.0) == decimal_year(datetime.date(2026, 1, 1)) == 2026.0
    assert decimal_year("2028-12-31") == pytest.approx(2028 + 365 / 366)
    noon = datetime.datetime(2026, 1, 1, 12, tzinfo=datetime.UTC)
    assert decimal_year(noon) == pytest.approx(2026 + 0.5 / 365)


@pytest.mark.parametrize("day", ["1899-12-31", "2030-01-02", "1066", 2031.0, datetime.date(1899, 1, 1)])
def test_a_day_without_a_model_is_refused(day: datetime.date | str | float) -> None:
    with pytest.raises(UsageError, match="1900 to 2030"):
        decimal_year(day)


@pytest.mark.parametrize(("year", "model"), [(2009.9, "wmm"), (2024.9, "wmmhr"), (2026.0, "best")])
def test_a_model_that_does_not_hold_is_refused(year: float, model: FieldModel) -> None:
    with pytest.raises(UsageError):
        site_field(47.0, 8.0, year=year, model=model)


WMMHR2025 = """
2025.0  28  89 -121 -101.96  88.44   -316.211505  -1493.255880  56107.758937
2025.0  65  43   93    0.51  64.11  24298.772442    216.069098  50070.428631
2025.5  22 -37  140    9.16 -68.63  21403.492117   3450.936430 -55419.694995
2027.5   0 -13  -59  -17.36 -15.19  21387.766379  -6684.222433  -6084.836918
2028.0  75  79  125  -18.75  87.42   2440.662196   -828.428933  57281.211002
"""
"""Year, km, latitude, longitude; declination, dip, north, east, down in nT: NOAA's file WMMHR2025_TEST_VALUES."""


@pytest.mark.parametrize("row", WMMHR2025.strip().splitlines())
def test_the_model_of_high_resolution_meets_the_values_of_noaas_test_file(row: str) -> None:
    year, height, latitude, longitude, *printed = map(float, row.split())
    site = site_field(latitude, longitude, 1e3 * height, year=year, model="wmmhr")
    found = [1e3 * part for part in (site.north, site.east, site.down)]
    npt.assert_allclose(found, printed[2:], atol=1e-3)
    npt.assert_allclose([site.declination_deg, site.inclination_deg], printed[:2], atol=0.0051)
    assert site.model == "WMMHR-2025"
    assert site.declination_sigma_deg == pytest.approx((0.25**2 + (5.205 / site.horizontal) ** 2) ** 0.5)


def test_the_clock_of_a_log_is_believed_from_2010_on() -> None:
    """One that was never set, or has rolled over, shows an earlier year."""
    place = SimpleNamespace(latitude_deg=47.0, longitude_deg=8.0, altitude_m=0.0)
    for year, is_known in ((1980, False), (2005, False), (2010, True), (2029, True)):
        log = SimpleNamespace(position=place, start_time=datetime.datetime(year, 1, 6, tzinfo=datetime.UTC))
        assert (recorded_field(log) is not None) is is_known


@pytest.mark.parametrize("day", ["yesterday", "21.11.2026", "2026-13-01", ""])
def test_what_is_no_day_is_refused(day: str) -> None:
    with assert_raises(UsageError):
        decimal_year(day)


@pytest.mark.parametrize(
    "text",
    [
        "home", "1,2,3,4", "47", "120,47",
        "47,361", "47,8,1e9", "nan,8",
    ],
)  # fmt: skip
def test_what_is_no_place_is_refused(text: str) -> None:
    with assert_raises(UsageError):
        parse_place(text)


def test_the_model_is_loaded_when_it_is_asked_for_and_not_before() -> None:
    code = "import sys, flinders.core.geomag, flinders.cli; assert 'pygeomag' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
