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
from tests.trials import daily

from flinders.estimators.aiding import fit_aided
from flinders.fitting.aid_selection import fit_with_aids

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
    "ckexplorer_acc_mag/acc_mag_log.csv": Measured(2.08, 1.96, (-0.34, 0.22, 0.82), 0.18),
    "timspi_imu_gnss/imu_gnss_data.csv": Measured(2.08, 1.68, (-1.5, -0.6, 0.4), 0.75),
}


@pytest.mark.parametrize("name", daily(DIPS))
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


@pytest.mark.parametrize(
    "name", daily(["20231014_apex5_mag_on_tpu_02.csv", "calTest1_215_253_0.csv", "calTest1_222_240_-8.csv"])
)
def test_thirds_of_a_tumble_agree_with_the_whole_within_their_claim(
    name: str, recordings: Callable[[str], Path]
) -> None:
    """Seven sessions, three thirds of each: 1.13 σ in the offset, rms, 1.8 at most."""
    assert recordings(f"pichim_betaflight/{name}").exists()
    surprises = [third.surprise for third in real.thirds_of(real.read(f"pichim_betaflight/{name}"))]
    assert 0.3 < np.sqrt(np.mean(np.square(surprises))) < 1.8
    assert max(surprises) < 2.5


def test_two_sessions_of_one_gyro_find_the_same_scales(recordings: Callable[[str], Path]) -> None:
    """The JHEF411's gyro reads 3 % too much about x and 1 % too little about y, in all of its sessions."""
    assert recordings("pichim_betaflight/CalCareful_2282320.csv").exists()
    scales = []
    for name in ("CalCareful_2282320.csv", "calTest1_222_240_-8.csv"):
        samples = real.read(f"pichim_betaflight/{name}")[:2200]
        scales.append(fit_aided(samples, ("rate",)).parameters.gyro_scale[:2])
    for each in scales:
        assert np.abs(each - [-0.032, 0.012]).max() < 0.008


@pytest.mark.nightly
def test_a_gyro_whose_scales_are_held_leaves_three_times_as_much(recordings: Callable[[str], Path]) -> None:
    """CalCareful: 3.1 % of the field instead of 0.8 %; its first half here."""
    assert recordings("pichim_betaflight/CalCareful_2282320.csv").exists()
    samples = real.read("pichim_betaflight/CalCareful_2282320.csv")[:2200]
    found, held = (fit_aided(samples, ("rate",), gyro_scale=scale) for scale in (0.02, 0.0))
    assert found.noise < 0.6 * held.noise


@pytest.mark.parametrize(
    ("name", "angle_deg"), daily([("ckexplorer_acc_mag/acc_mag_log.csv", 0.9), (real.SPHERE, 3.8)])
)
def test_auto_keeps_the_rotation_of_a_tumble_with_an_accelerometer(
    name: str, angle_deg: float, recordings: Callable[[str], Path]
) -> None:
    """0.9° of the first are no bias of its accelerometer, which is found with the rest."""
    assert recordings(name).exists()
    samples = real.read(name)
    found, aiding = fit_with_aids(samples[:: 1 + len(samples) // 4000], "auto")
    assert found.aiding == ()
    assert [aid.is_used for aid in aiding.sensors] == [True]
    assert aiding.rotation is not None
    turned = np.degrees(np.arccos(np.clip((np.trace(aiding.rotation) - 1.0) / 2.0, -1.0, 1.0)))
    assert turned == pytest.approx(angle_deg, abs=0.8)


@pytest.mark.nightly
def test_scripted_turns_are_a_quarter_apart(recordings: Callable[[str], Path]) -> None:
    """Rolled and tilted by hand at 0°, 45° and 90°: the outer two are 90.0° apart with the dip, 98.1° without it."""
    assert recordings(real.SCRIPTED).exists()
    sphere = real.read(real.SPHERE)
    quarters = []
    for terms in ((), ("dip",)):
        found = fit_aided(sphere, terms)
        headings = real.scripted_deg(found.parameters.offset, found.matrix)
        quarters.append(headings[2][0] - headings[0][0])
    assert abs(quarters[0] - 98.1) < 3.0
    assert abs(quarters[1] - 90.0) < 3.0
