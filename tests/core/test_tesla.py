"""Readings in tesla without their unit: it is offered, and numbers keep the digits of their uncertainty."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from tests.program import flinders_
from tests.sentences import assert_raises, assert_sentences

import flinders
from flinders.errors import NoMagnetometer
from flinders.report.formatting import with_uncertainty

if TYPE_CHECKING:
    from pathlib import Path

UNITS: Final = {"T": 1e6, "mT": 1e3, "G": 1e2, "nT": 1e-3}
"""Microtesla in one."""
FORMS: Final = {
    "a header": ("time,mag_x,mag_y,mag_z", "{t},{}"),
    "time first": ("", "{t},{}"),
    "three columns": ("", "{}"),
    "labels": ("", "mx:{} my:{} mz:{}"),
}


def written(path: Path, unit: str, header: str, form: str) -> Path:
    noise = np.random.default_rng(8)
    directions = noise.normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    field = (45.3 * directions + [12.0, -30.0, 5.0] + 0.3 * noise.normal(size=(300, 3))) / UNITS[unit]
    rows = [[f"{value:.5g}" for value in row] for row in field]
    lines = [form.format(*row if form.count("{}") == 3 else [",".join(row)], t=n / 5) for n, row in enumerate(rows)]
    path.write_text("\n".join([*filter(None, [header]), *lines, ""]))
    return path


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("unit", UNITS)
def test_the_unit_of_the_earth_is_offered(unit: str, form: str, tmp_path: Path) -> None:
    log = written(tmp_path / "log.txt", unit, *FORMS[form])
    assert f"--unit {unit}" in flinders_("info", str(log)).out
    assert_sentences(flinders_("calibrate", str(log)).said, about=f"--unit {unit}")
    np.testing.assert_allclose(flinders.fit(log, unit=unit).calibration.offset, [12.0, -30.0, 5.0], atol=0.2)


@pytest.mark.parametrize("unit", ["T", "mT"])
def test_columns_are_offered_in_it(unit: str, tmp_path: Path) -> None:
    """Beside a column of ones, with which they have the length of a quaternion."""
    log = written(tmp_path / "log.txt", unit, "", "{t},7,{},1")
    with assert_raises(NoMagnetometer) as caught:
        flinders.read(log)
    assert (f"as {unit} the earth's" in str(caught.value), "columns='3,4,5'" in str(caught.value)) == (True, True)


def test_numbers_have_the_digits_of_their_uncertainty(tmp_path: Path) -> None:
    log, calibration = str(written(tmp_path / "log.csv", "T", *FORMS["a header"])), str(tmp_path / "calibration.json")
    made = flinders_("calibrate", log, "-o", calibration).out
    for page in (made, flinders_("show", calibration).out):
        (offset,) = (line for line in page.splitlines() if line.startswith("offset"))
        numbers = re.findall(r"(-?\d\.\d+e-0\d) ± (\d\.\de-0\d)", offset)
        np.testing.assert_allclose(np.array(numbers, float)[:, 0], [12e-6, -30e-6, 5e-6], atol=2e-7)


@pytest.mark.parametrize(
    ("value", "sigma", "written"),
    [
        (1.19934e-05, 3.52e-08, "1.1993e-05 ± 3.5e-08"),
        (-2.99661e-05, 3.4e-08, "-2.9966e-05 ± 3.4e-08"),
        (0.0, 4.2e-08, "0.0e+00 ± 4.2e-08"),
        (3e-09, 4.2e-08, "3.0e-09 ± 4.2e-08"),
        (12.0343, 0.055, "12.034 ± 0.055"),
        (0.0123456, 3.2e-05, "0.012346 ± 0.000032"),
        (12.0, 1e-9, "12.000000 ± 1e-09"),
    ],
)
def test_a_small_number_has_an_exponent(value: float, sigma: float, written: str) -> None:
    assert with_uncertainty(value, sigma) == written
