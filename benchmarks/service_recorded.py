"""Online calibration on real recordings of one sensor, one after the other. Prints Markdown.

    python -m benchmarks.service_recorded

The recordings are those of the folder of `benchmarks.recordings`, an hour apart; one without times has 50 readings a
second.
*In force* is the claim at the end of each recording, *its own* the claim of a fit of that recording alone, and *apart*
the largest difference of headings between the two over the larger claim (1.2 in the median for true claims).
"""

from __future__ import annotations

from typing import Final

import numpy as np

import flinders
from benchmarks.recordings import FOLDER
from flinders.core.samples import frame_of
from flinders.errors import FitError
from flinders.fitting.result import Refused
from flinders.workflows.online import OnlineCalibration

LIVES: Final = {
    "pichim_betaflight": (
        "calTest1_198_253_-9.csv",
        "calTest1_208_249_-2.csv",
        "calTest1_215_253_0.csv",
        "calTest1_222_240_-8.csv",
        "CalCareful_2282320.csv",
    ),
    "sunsided_hmc5883l": ("full-sphere.csv", "roll-and-tilt-at-45-90.csv", "unmoved-10min_dec8.csv"),
}
PAUSE_S: Final = 3600.0
RATE_HZ: Final = 50.0

HEAD: Final = "| life | recording | what happened | in force | its own | apart |\n|---|---|---|---:|---:|---:|"


def replayed(folder: str, names: tuple[str, ...]) -> list[str]:
    """Rows of a life, one for each recording."""
    online, begin, rows = None, 0.0, []
    for name in names:
        samples = flinders.read(FOLDER / folder / name)
        online = (
            OnlineCalibration(unit=samples.unit, axes=samples.axes, frame=frame_of(samples))
            if online is None
            else online
        )
        time = np.arange(len(samples)) / RATE_HZ if samples.time is None else samples.time - samples.time[0]
        events = online.add(samples.field / samples.unit.scale, time=begin + time)
        begin += float(time[-1]) + PAUSE_S
        codes = [event.code for event in events]
        said = ", ".join(f"{code} {codes.count(code)}" for code in dict.fromkeys(codes)) or "nothing"
        try:
            own = flinders.fit(samples)
        except Refused as refused:
            own = refused.fit
        except FitError as error:
            rows.append(f"| {folder} | {name} | {said} | {online.state.heading_error_deg:.2f}° | {error.code} | |")
            continue
        apart = ""
        if online.fit is not None:
            claimed = max(online.state.heading_error_deg, own.heading_error_deg.worst)
            apart = f"{flinders.compare(online.fit, own).heading_difference_deg.worst / claimed:.1f}"
        rows.append(
            f"| {folder} | {name} | {said} | {online.state.heading_error_deg:.2f}° | "
            f"{own.heading_error_deg.worst:.2f}°, {own.verdict} | {apart} |"
        )
    return rows


def main() -> None:
    """Print the table."""
    print(HEAD)
    for folder, names in LIVES.items():
        for row in replayed(folder, names):
            print(row, flush=True)


if __name__ == "__main__":
    main()
