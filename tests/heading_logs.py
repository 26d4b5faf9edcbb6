"""Logs of one sensor with an accelerometer, with known headings."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flinders import simulate
from flinders.core.units import Unit
from flinders.fitting.aiding import Aiding
from flinders.fitting.calibrate import fit
from flinders.fitting.fit_file import load
from flinders.fitting.result import with_calibration
from flinders.geometry.rotation import rotations

if TYPE_CHECKING:
    from flinders.arrays import Floats

FIELD = 50.0 * np.array([0.5, 0.0, 0.75**0.5])
MATRIX = np.array([[1.04, 0.02, -0.01], [0.02, 0.95, 0.03], [-0.01, 0.03, 1.01]])
OFFSET = np.array([20.0, -15.0, 8.0])
ZURICH = ("--at", "47.37,8.54,400", "--date", "2026-06-01")
HEADER = "t_s,mx_uT,my_uT,mz_uT,ax,ay,az"


def turned(heading: Floats, roll: Floats | float = 0.0, pitch: Floats | float = 0.0) -> Floats:
    """(N, 3, 3) rotations from north, east, down to the axes of the body."""
    h, r, p = np.deg2rad(np.broadcast_arrays(heading, roll, pitch))
    zero, one = np.zeros_like(h), np.ones_like(h)
    about_x = np.array([[one, zero, zero], [zero, np.cos(r), np.sin(r)], [zero, -np.sin(r), np.cos(r)]])
    about_y = np.array([[np.cos(p), zero, -np.sin(p)], [zero, one, zero], [np.sin(p), zero, np.cos(p)]])
    about_z = np.array([[np.cos(h), np.sin(h), zero], [-np.sin(h), np.cos(h), zero], [zero, zero, one]])
    body: Floats = np.einsum("ijn,jkn,kln->nil", about_x, about_y, about_z)
    return body


def log_of(body: Floats, *, start: float = 0.0, noise: float = 0.0) -> Floats:
    """Time, raw field in µT and specific force for some attitudes, at 10 Hz."""
    rng = np.random.default_rng(3)
    raw = np.linalg.solve(MATRIX, (body @ FIELD).T).T + OFFSET + noise * rng.standard_normal((len(body), 3))
    force = body @ np.array([0.0, 0.0, -9.81]) + 0.05 * noise * rng.standard_normal((len(body), 3))
    return np.column_stack([start + 0.1 * np.arange(len(body)), raw, force])


def write(name: str, log: Floats, header: str = HEADER) -> str:
    rows = [",".join(f"{value:.6f}" for value in row) for row in log]
    with open(name, "w", encoding="utf-8") as file:  # noqa: PTH123
        file.write("\n".join([header, *rows, ""]))
    return name


def swinging(stops: Floats, *, noise: float = 0.2) -> Floats:
    """A log that rests on each heading for ten seconds."""
    headings: list[float] = []
    for before, after in zip(stops, [*stops[1:], stops[-1]], strict=True):
        headings += [before] * 100 + np.linspace(before, after, max(int(abs(after - before) / 3.0), 1)).tolist()
    sway = np.arange(len(headings)) * 0.1
    return log_of(turned(np.array(headings), 5.0 * np.sin(sway), 4.0 * np.cos(0.7 * sway)), noise=noise)


def calibrated(n: int) -> None:
    """Calibration of the same sensor from `n` noisy readings, with its uncertainty."""
    rng = np.random.default_rng(5)
    raw = (
        np.linalg.solve(MATRIX, 50.0 * simulate.uniform_directions(rng, n).T).T
        + OFFSET
        + 0.5 * rng.standard_normal((n, 3))
    )
    fit(raw, unit=Unit.of("uT")).save("calibration.json", force=True)


def with_rotation_error(off_deg: float, claimed_deg: float) -> None:
    """Rotate the calibration by an angle about the body's x axis, with a claim about each axis."""
    known = load("calibration.json")
    turn = rotations(np.array([[np.radians(off_deg), 0.0, 0.0]]))[0]
    turned = replace(known.calibration, matrix=turn @ known.calibration.matrix, rotation="estimated")
    aiding = Aiding(rotation_covariance=np.radians(claimed_deg) ** 2 * np.eye(3))
    known = with_calibration(replace(known, evidence=replace(known.evidence, aiding=aiding)), turned)
    known.save("calibration.json", force=True)


def tumbling(count: int = 600) -> tuple[Floats, Floats]:
    """Headings and attitudes in all directions."""
    rng = np.random.default_rng(8)
    heading = rng.uniform(0.0, 360.0, count)
    return heading, turned(heading, rng.uniform(-180.0, 180.0, count), rng.uniform(-80.0, 80.0, count))
