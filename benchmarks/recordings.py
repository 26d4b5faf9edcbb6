"""Real recordings: comparison with other tools, and results of `auto`.

``python -m benchmarks.recordings`` prints two tables. The recordings are not part of the project; their folder is
``FLINDERS_DATA``, else ``shared/data`` next to the project. A reference comes from the same readings by a similar
method, so agreement checks code, not truth. The second table has the claimed worst level heading error, and that by the
textbook covariance for independent residuals; notes are in brackets.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

import flinders
from flinders.errors import FitError, InputError
from flinders.fitting.result import Refused

FOLDER: Final = Path(os.environ.get("FLINDERS_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")

TEXT: Final = {".csv", ".txt"}
NO_RECORDINGS: Final = {
    "acc.txt", "acc_data.txt", "icm_20948_cal_acc.csv",  # accelerometers
    "icm_20948_get_cal_data_OUTPUT.txt", "reference_mag3_out.txt", "reference_paramters_mag.csv",
    "reference_20231014_online_bias_est.txt", "repeat_calibrations_20231225.txt",  # results
}  # fmt: skip
USUAL_FINDINGS: Final = {"scale-unknown", "rotation-unknown", "unit-unknown"}
"""Findings of every recording here."""


class Reference(NamedTuple):
    """Offset by another tool, in the unit of the recording."""

    recording: str
    tool: str
    offset: tuple[float, float, float]


REFERENCES: Final = (
    Reference("michaelwro_fxos8700/mag-readings.txt", "Magneto 1.2", (28.557458, -39.981060, -27.428035)),
    Reference("jremington_icm20948/icm_20948_cal_mag.csv", "Magneto 1.4", (-156.70, -52.79, -141.07)),
    Reference("jremington_icm20948/mag3_raw.csv", "calibrate3.py", (9955.151669, -7948.264630, 8511.804479)),
    Reference("hightower70_magcal/mag.txt", "Magneto 1.2", (-0.021659, 0.013250, -0.026167)),
)


def text_recordings() -> list[Path]:
    """Files of the folder that may be text recordings of a magnetometer, judged by their names."""
    return [path for path in sorted(FOLDER.glob("*/*")) if path.suffix in TEXT and path.name not in NO_RECORDINGS]


def row(reference: Reference) -> str:
    """Row of the first table: fit one recording and compare its offset with the reference."""
    fit = flinders.fit(flinders.read(FOLDER / reference.recording))
    apart = float(np.linalg.norm(fit.calibration.offset - reference.offset)) / fit.calibration.field_strength
    error, (_, spread) = fit.heading_error_deg, fit.evidence.coverage.raw_strength(fit.calibration.ellipsoid)
    return (
        f"| {reference.recording} | {fit.evidence.samples:,} | {reference.tool} | {apart:.2%} | "
        f"{spread:.1%} → {fit.evidence.noise / fit.calibration.field_strength:.1%} | "
        f"{fit.verdict}, {error.worst:.2f}° |"
    )


def judged(path: Path) -> str | None:
    """Row of the second table: fit one recording; None for a file that is no recording."""
    name = str(path.relative_to(FOLDER))
    try:
        samples = flinders.read(path)
    except InputError:
        return None
    try:
        fit = flinders.fit(samples)
    except Refused as refusal:
        fit = refusal.fit
    except FitError as refusal:
        return f"| {name} | {len(samples):,} | refused |  |  | {refusal.code} |"
    error, textbook = fit.heading_error_deg, fit.claim.textbook_heading_error_deg
    codes = [finding.code if finding.severity != "note" else f"({finding.code})" for finding in fit.findings]
    told = ", ".join(code for code in codes if code.strip("()") not in USUAL_FINDINGS)
    claimed = "" if fit.verdict == "refused" else f"{error.worst:.2g}°"
    white = "" if fit.verdict == "refused" or textbook is None else f"{textbook.worst:.2g}°"
    return (
        f"| {name} | {fit.evidence.samples:,} | {fit.verdict}, {fit.evidence.method} | {claimed} | {white} | {told} |"
    )


def main() -> None:
    """Print the tables."""
    if not FOLDER.is_dir():
        sys.exit(f"no recordings in {FOLDER}: set FLINDERS_DATA to the folder that holds them")
    references()
    print("\n| recording | readings used | verdict, method | worst heading error | textbook | findings |")
    print("|---|---:|---|---:|---:|---|")
    for path in text_recordings():
        if told := judged(path):
            print(told, flush=True)


def references() -> None:
    """Print the first table."""
    print("| recording | readings | reference | offset differs, of field | spread | verdict, worst heading error |")
    print("|---|---:|---|---:|---|---|")
    for reference in REFERENCES:
        print(row(reference))


if __name__ == "__main__":
    main()
