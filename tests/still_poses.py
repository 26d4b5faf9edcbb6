"""A device that is put down on its sides and edges, with an accelerometer whose errors are known."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from flinders.core.inertial import STANDARD_GRAVITY
from flinders.geometry.ellipsoid import symmetric_matrix

if TYPE_CHECKING:
    from flinders.arrays import Floats

SIDES: Final = np.concatenate([np.eye(3), -np.eye(3)])
EDGES: Final = np.array([[1, 1, 0], [1, -1, 0], [1, 0, 1], [-1, 0, 1], [0, 1, 1], [0, 1, -1]]) / np.sqrt(2.0)


@dataclass(frozen=True, slots=True, eq=False)
class FlawedAccelerometer:
    """Accelerometer that reads f in m/s² with (1 + Γ)(f/g − β) = u at rest, with noise."""

    errors: Floats  # (9,): β and the upper triangle of Γ
    noise: float = 0.05  # m/s²

    @classmethod
    def drawn(cls, seed: int, *, misalignment: float = 0.01, noise: float = 0.05) -> Self:
        """Accelerometer with random errors: offsets of 0.03 g and gain errors of 2 %, 1 σ."""
        rng = np.random.default_rng([seed, 1])
        sigmas = np.repeat([0.03, 0.02, misalignment], 3)
        return cls(sigmas * rng.standard_normal(9), noise)

    def put_down(self, seed: int, attitudes: Floats, readings: int = 60) -> Floats:
        """(N, 3) readings in m/s² of (P, 3) upward directions in turn, with a hand's movement in between."""
        rng = np.random.default_rng([seed, 2])
        force = np.linalg.solve(np.eye(3) + symmetric_matrix(self.errors[3:]), attitudes.T).T + self.errors[:3]
        spans = [np.repeat(force[:1], readings, axis=0)]
        for before, after in pairwise(force):
            way = np.linspace(before, after, 25) + 0.1 * rng.standard_normal((25, 3))
            spans += [way, np.repeat(after[np.newaxis], readings, axis=0)]
        read = STANDARD_GRAVITY * np.concatenate(spans)
        return read + self.noise * rng.standard_normal(read.shape)

    def in_scale(self, scale: float) -> Floats:
        """(9,) errors for a unit in which gravity is `scale` m/s²."""
        share = scale / STANDARD_GRAVITY
        whole = share * (np.eye(3) + symmetric_matrix(self.errors[3:])) - np.eye(3)
        rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
        return np.concatenate([self.errors[:3] / share, whole[rows, columns]])


def table(seed: int = 1, attitudes: Floats | None = None) -> str:
    """Recording as a board prints it, with time, accelerometer and gyro, and without a magnetometer."""
    chosen = np.concatenate([SIDES, EDGES]) if attitudes is None else attitudes
    force = FlawedAccelerometer.drawn(seed).put_down(seed, chosen, 100)
    rates = np.array([0.01, -0.02, 0.005]) + 0.002 * np.random.default_rng(seed).standard_normal(force.shape)
    rows = np.column_stack([0.02 * np.arange(len(force)), force, rates])
    names = "time_s,ax_mps2,ay_mps2,az_mps2,gx_radps,gy_radps,gz_radps"
    return "\n".join([names, *(",".join(f"{value:.5f}" for value in row) for row in rows), ""])
