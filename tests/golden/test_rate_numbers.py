"""Numbers of Troni and Whitcomb and of MAGYC, reproduced: §8.3 of the project's literature notes.

The settings are theirs. Of SIM1 and SIM2 the motions were not read: here one is tumbled slowly and the other rocked by
5°, 5° and 90°. MAGYC's motion is that of its code, `simulate.rocked`. Errors are medians over the seeds stated, in mG.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from benchmarks.emulations.magyc_ls import magyc_ls
from benchmarks.emulations.sar_kf import sar_kf
from benchmarks.emulations.sar_ls import sar_ls
from tests.worlds import HARD_IRON, SOFT_IRON

from flinders import simulate
from flinders.core.samples import Samples

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.geometry.ellipsoid import Ellipsoid

pytestmark = pytest.mark.nightly  # algorithms of others, which `benchmarks` compares with

FIELD_MG: Final = np.array([227.207, 51.796, 411.731])


def sim(seed: int, *, limited: bool) -> Samples:
    """60 s at 100 Hz, 1 mG and 5 mrad/s: SIM1, or SIM2 where the motion is limited."""
    rng = np.random.default_rng(seed)
    if limited:
        turning = simulate.rocked(rng, seconds=60.0, rate_hz=100.0, amplitudes_deg=(5.0, 5.0, 90.0))
    else:
        turning = simulate.hand_tumble(rng, seconds=60.0, rate_hz=100.0, speed=0.5, smoothness=1.5)
    field = simulate.in_body_axes(turning.attitudes, np.array([200.0, -40.0, 480.0])) + HARD_IRON
    raw = field + rng.normal(0.0, 1.0, field.shape)
    return Samples.of(raw, unit="mG", time=turning.time, rate=turning.rate + rng.normal(0.0, 0.005, field.shape))


def magyc(seed: int, amplitudes_deg: tuple[float, float, float]) -> Samples:
    """6,000 readings at 10 Hz, 10 mG and 10 mrad/s."""
    rng = np.random.default_rng(seed)
    turning = simulate.rocked(rng, seconds=600.0, rate_hz=10.0, amplitudes_deg=amplitudes_deg)
    field = simulate.in_body_axes(turning.attitudes, FIELD_MG) @ SOFT_IRON + HARD_IRON
    raw = field + rng.normal(0.0, 10.0, field.shape)
    rate = turning.rate + np.array([0.004, -0.005, 0.002]) + rng.normal(0.0, 0.01, field.shape)
    return Samples.of(raw, unit="mG", time=turning.time, rate=rate)


def off_mg(emulation: Callable[[Samples], Ellipsoid], samples: Samples) -> float:
    offset = emulation(samples).centre  # µT
    return float(np.linalg.norm(10.0 * offset - HARD_IRON))


@pytest.mark.parametrize("emulation", [sar_ls, sar_kf])
def test_sim1_is_below_1_mg(emulation: Callable[[Samples], Ellipsoid]) -> None:
    """Published: below 1 mG. Measured here: 0.1 and 0.08."""
    assert float(np.median([off_mg(emulation, sim(seed, limited=False)) for seed in range(4)])) < 0.2


@pytest.mark.parametrize(("emulation", "limit"), [(sar_ls, 3.0), (sar_kf, 1.0)])
def test_sim2_with_limited_motion_is_below_3_mg(emulation: Callable[[Samples], Ellipsoid], limit: float) -> None:
    """Published: below 2 to 3 mG, where fits of an ellipsoid are off by more than 10."""
    assert max(off_mg(emulation, sim(seed, limited=True)) for seed in range(4)) < limit


@pytest.mark.parametrize(
    ("amplitudes_deg", "published_mg"),
    [((5.0, 45.0, 360.0), 43.7), ((5.0, 5.0, 360.0), 252.0), ((5.0, 45.0, 90.0), 71.6), ((5.0, 5.0, 90.0), 254.0)],
    ids=["WAM", "MAM", "LAM", "5/5/90"],
)
def test_the_differentiated_form_of_magyc_is_as_far_off_as_in_the_notes(
    amplitudes_deg: tuple[float, float, float], published_mg: float
) -> None:
    """Median of five runs, within a fifth of the notes' median: theirs and ours are few runs of a wide scatter."""
    found = float(np.median([off_mg(magyc_ls, magyc(seed, amplitudes_deg)) for seed in range(5)]))
    assert abs(found / published_mg - 1.0) < 0.2


def test_magycs_soft_iron_on_its_wide_motion() -> None:
    """Frobenius norm of the difference of matrix logarithms, determinants taken out: 0.099 in the notes."""
    logs = []
    for seed in range(5):
        shape = magyc_ls(magyc(seed, (5.0, 45.0, 360.0))).shape
        apart = [np.linalg.eigh(matrix / np.cbrt(np.linalg.det(matrix))) for matrix in (shape, SOFT_IRON)]
        one, other = ((vectors * np.log(values)) @ vectors.T for values, vectors in apart)
        logs.append(float(np.linalg.norm(one - other)))
    assert abs(float(np.median(logs)) / 0.099 - 1.0) < 0.2
