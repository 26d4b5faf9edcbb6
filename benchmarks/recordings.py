"""Real recordings beside what another tool made of them: how far apart the offsets are.

``python -m benchmarks.recordings`` prints a table. The recordings are not part of the project; they are looked for in
the folder that ``FLINDERS_DATA`` names, else in ``shared/data`` beside the project. The reference comes from the same
readings by a similar method, so agreement checks code, not truth.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

import flinders

FOLDER: Final = Path(os.environ.get("FLINDERS_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")


class Reference(NamedTuple):
    """An offset that another tool found, in the unit of the recording."""

    recording: str
    tool: str
    offset: tuple[float, float, float]


REFERENCES: Final = (
    Reference("michaelwro_fxos8700/mag-readings.txt", "Magneto 1.2", (28.557458, -39.981060, -27.428035)),
    Reference("jremington_icm20948/icm_20948_cal_mag.csv", "Magneto 1.4", (-156.70, -52.79, -141.07)),
    Reference("jremington_icm20948/mag3_raw.csv", "calibrate3.py", (9955.151669, -7948.264630, 8511.804479)),
    Reference("hightower70_magcal/mag.txt", "Magneto 1.2", (-0.021659, 0.013250, -0.026167)),
)


def row(reference: Reference) -> str:
    """Fit one recording and write its row."""
    fit = flinders.fit(flinders.read(FOLDER / reference.recording))
    apart = float(np.linalg.norm(fit.calibration.offset - reference.offset)) / fit.calibration.field_strength
    error = fit.heading_error_deg
    return (
        f"| {reference.recording} | {fit.samples:,} | {reference.tool} | {apart:.2%} | "
        f"{fit.uncorrected_strength[1]:.1%} → {fit.noise / fit.calibration.field_strength:.1%} | "
        f"{fit.verdict}, {error.worst:.2f}° |"
    )


def main() -> None:
    """Print the table."""
    if not FOLDER.is_dir():
        sys.exit(f"no recordings in {FOLDER}: set FLINDERS_DATA to the folder that holds them")
    print("| recording | readings | reference | offset differs, of field | spread | verdict, worst heading error |")
    print("|---|---:|---|---:|---|---|")
    for reference in REFERENCES:
        print(row(reference))


if __name__ == "__main__":
    main()
