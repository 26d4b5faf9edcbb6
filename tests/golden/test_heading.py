"""What `flinders heading` prints, to the letter; docs/cli/ shows these files."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
from click.testing import CliRunner
from tests.golden.sessions import session
from tests.worlds import write_field

from flinders import simulate
from flinders.cli import main

if TYPE_CHECKING:
    from pathlib import Path

    from tests.golden.sessions import Golden


def record(tmp_path: Path, *, gravity: bool = False) -> None:
    """A calibration, and a log of the same sensor with an accelerometer, x forward, y right, z down."""
    tumble = simulate.tumble(seed=2)
    write_field(tmp_path / "tumble.csv", tumble.samples.field)
    CliRunner().invoke(main, ["calibrate", "tumble.csv", "-o", "calibration.json"])
    rng = np.random.default_rng(7)
    steps = np.arange(900)
    heading, roll, pitch = 0.4 * steps, 20.0 * np.sin(0.05 * steps), 15.0 * np.cos(0.031 * steps)
    log = ["t_s,mag_x_uT,mag_y_uT,mag_z_uT,acc_x,acc_y,acc_z"]
    for step, angles in enumerate(zip(np.deg2rad(heading), np.deg2rad(roll), np.deg2rad(pitch), strict=True)):
        (ch, cr, cp), (sh, sr, sp) = np.cos(angles), np.sin(angles)
        body = (
            np.array([[1, 0, 0], [0, cr, sr], [0, -sr, cr]])
            @ np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
            @ np.array([[ch, sh, 0], [-sh, ch, 0], [0, 0, 1]])
        )
        raw = tumble.sensor.read(50.0 * (body @ [0.5, 0.0, 0.75**0.5])[np.newaxis], rng)
        force = (body @ [0.0, 0.0, -9.81] + rng.normal(0.0, 0.02, 3)) * (-1.0 if gravity else 1.0)
        log.append(",".join(f"{value:.3f}" for value in (0.1 * step, *np.ravel(raw), *force)))
    (tmp_path / "log.csv").write_text("\n".join([*log, ""]), encoding="utf-8")


def test_headings_of_a_log(tmp_path: Path, golden: Golden) -> None:
    record(tmp_path)
    line = "flinders heading calibration.json log.csv --at 43.77,11.26,50 --date 2026-06-01 -o headings.csv"
    shown = session(line)
    first = (tmp_path / "headings.csv").read_text(encoding="utf-8").splitlines()[:4]
    rounded = [
        first[0],
        *(",".join(re.sub(r"(\.\d\d)\d+", r"\1", cell) for cell in row.split(",")) for row in first[1:]),
    ]
    golden("cli/heading.txt", shown)
    golden("cli/headings.csv", "\n".join([*rounded, ""]))


def test_an_accelerometer_with_the_wrong_sign(tmp_path: Path, golden: Golden) -> None:
    record(tmp_path, gravity=True)
    golden(
        "cli/heading-sign.txt", session("flinders heading calibration.json log.csv --dip 63 -o headings.csv", code=5)
    )
