"""What the aids make of real recordings: numbers measured once, and held within what was claimed for them then.

`benchmarks.terms_recordings` prints more of them. No truth is known of these sensors: what is held is that the aid
agrees better with an instrument that it was given, that its rotation is found again, and that a part agrees with the
whole within its claim.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import pytest
from benchmarks import terms_recordings as real

from flinders.estimators.aided import solve

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


class Measured(NamedTuple):
    """Spread of the dip before and after in degrees, and the rotation, as a vector in degrees, with its 1 σ."""

    before_deg: float
    after_deg: float
    rotation_deg: tuple[float, float, float]
    sigma_deg: float


DIPS: Final = {
    "ckexplorer_acc_mag/acc_mag_log.csv": Measured(2.08, 1.98, (-0.17, 0.23, 0.90), 0.20),
    "timspi_imu_gnss/imu_gnss_data.csv": Measured(2.08, 1.75, (0.0, -0.9, 1.5), 0.7),
}


@pytest.mark.parametrize("name", DIPS)
def test_the_dip_spreads_less_once_the_accelerometers_axes_are_found(
    name: str, recordings: Callable[[str], Path]
) -> None:
    assert recordings(name).exists()
    samples = real.read(name)
    measured, found = DIPS[name], real.dip_of(samples[:: 1 + len(samples) // 4000])
    assert found.before_deg == pytest.approx(measured.before_deg, abs=0.1)
    assert found.after_deg < found.before_deg - 0.05
    assert found.after_deg == pytest.approx(measured.after_deg, abs=0.12)
    assert np.abs(found.rotation_deg - measured.rotation_deg).max() < 2.0 * measured.sigma_deg
    assert 0.5 * measured.sigma_deg < found.sigma_deg.max() < 2.0 * measured.sigma_deg


def test_a_third_of_a_tumble_agrees_with_the_whole_within_its_claim(recordings: Callable[[str], Path]) -> None:
    """Ten seconds of thirty, with the gyro: 0.95 σ in the offset, and 0.49° of level heading where 0.48° is claimed."""
    name = "pichim_betaflight/20231014_apex5_mag_on_tpu_02.csv"
    assert recordings(name).exists()
    surprise, _, with_it, claimed = real.third_of(real.read(name))
    assert 0.2 < surprise < 2.0
    assert with_it < 2.0 * claimed < 2.0


def test_scripted_turns_are_a_quarter_apart(recordings: Callable[[str], Path]) -> None:
    """Rolled and tilted by hand at 0°, 45° and 90°: the outer two are 90.0° apart with the dip, 98.1° without it."""
    assert recordings(real.SCRIPTED).exists()
    sphere = real.read(real.SPHERE)
    quarters = []
    for terms in ((), ("dip",)):
        found = solve(sphere, terms)
        headings = real.scripted_deg(found.parameters.offset, found.matrix)
        quarters.append(headings[2][0] - headings[0][0])
    assert abs(quarters[0] - 98.1) < 3.0
    assert abs(quarters[1] - 90.0) < 3.0
