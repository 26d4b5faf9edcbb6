"""Truth of the heading error that a fit of few readings claims."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

import flinders
from flinders import simulate
from flinders.core.samples import Samples
from flinders.fitting.result import Refused
from flinders.heading.error_propagation import level_turn

if TYPE_CHECKING:
    from flinders.arrays import Floats


FIELD: Final = 48.0


def poses(rng: np.random.Generator, count: int) -> Floats:
    """(count, 3) directions on the whole sphere, about as even as those of a surveyor."""
    turned = simulate.fibonacci(count) @ simulate.turns(rng.standard_normal((1, 3)))[0]
    apart = turned + 0.2 * rng.standard_normal(turned.shape)
    even: Floats = apart / np.linalg.norm(apart, axis=1, keepdims=True)
    return even


def iron(rng: np.random.Generator, method: str) -> Floats:
    """(3, 3) soft iron of a sensor: mild, or none for a method that does not model it."""
    mixed = rng.uniform(-0.1, 0.1, (3, 3))
    return np.eye(3) if method == "sphere" else np.eye(3) + mixed + mixed.T


def ratio(seed: int, method: str, count: int) -> float:
    """Ratio of the true to the claimed worst level heading error."""
    rng = np.random.default_rng([seed, count])
    shape, offset = iron(rng, method), rng.uniform(-50.0, 50.0, 3)
    field = FIELD * poses(rng, count) @ shape + offset + 0.2 * rng.standard_normal((count, 3))
    try:
        fit = flinders.fit(Samples.of(field, unit="uT"), method=method)
    except Refused as refusal:
        fit = refusal.fit
    heading, directions = level_turn(fit.heading_error_deg.dip_deg)
    x, y, _ = fit.calibration.matrix @ (FIELD * shape @ directions + (offset - fit.calibration.offset)[:, np.newaxis])
    off = np.angle(np.exp(1j * (np.arctan2(-y, x) - heading)))
    return float(np.degrees(np.abs(off - off.mean()).max())) / fit.heading_error_deg.worst
