"""Duration of a calibration by simulated users who follow the page: ``python -m benchmarks.turning``.

    python -m benchmarks.turning [--sensors 200] [--body board] [--dip 60] [--processes 2]

The session of the page, its engine as WebAssembly, its choreography and its lead run under Node.js in simulated time
(`turning.mjs`), and a simulated user follows them. Each user has a speed of 30 to 90° a second, a latency of 0.3 to
1.5 s, errors of attitude and axis of 10 to 20°, and sway about the axis of half of that. One watches the page all the
time; one looks at it every two to five seconds; one turns without looking (0.8 to 1.25 of a turn) and looks after each
turn; the last tumbles the sensor at random and never looks. In a second run each pauses for one to three seconds, after
ten seconds of turning on average.

Sensors: soft iron of 25 % (10 % across), an offset of up to two fields on each axis, white noise of 0.1 to 0.5 % of the
field, slow noise of a fifth of that over five seconds; 50 readings a second. A run ends with the phase *good*: within
1°, and no uncovered region of more than 60°.

Columns: seconds until good, median and for 98 %; shares good within 20 and 30 s; the same within 20 s for users at 45°
a second or faster; degrees of turning, median; most changes of words per minute in a run.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from tests.javascript import node

from flinders.apps.live.standalone.package import page_data
from flinders.native import build

if TYPE_CHECKING:
    from collections.abc import Sequence

PROGRAM: Final = Path(__file__).with_suffix(".mjs")
PEOPLE: Final = {
    "always": "sees the page",
    "glances": "glances at it",
    "turns": "looks after each turn",
    "tumbles": "tumbles it freely",
}
STOPS_S: Final = (0.0, 10.0)
MAX_DURATION_S: Final = 90.0
FAST_RATE_DEGPS: Final = 45.0
MINUTE_S: Final = 60.0
HEADER: Final = (
    "| person | stops | median | 98 % | ≤ 20 s | ≤ 30 s | ≤ 20 s, ≥ 45°/s | turned | words a minute |",
    "|---|---|---|---|---|---|---|---|---|",
)


@dataclass(frozen=True, slots=True)
class Run:
    """Run of one user with one sensor."""

    seconds: float  #: until good; infinite if never
    speed_deg: float
    turned_deg: float
    words: int  #: changes of the words on the page


def play(asked: Sequence[dict[str, Any]]) -> list[Run]:
    """Simulate users who turn sensors, one for each row of `asked`, under Node.js."""
    given = {
        "modules": str(files("flinders.apps.live").joinpath("static")),
        "wasm": str(build.library(target=build.WEB_PLATFORM)),
        "data": page_data(),
        "asked": asked,
    }
    done = subprocess.run(
        [node(), str(PROGRAM)], input=json.dumps(given), capture_output=True, text=True, encoding="utf-8", check=True
    )
    rows = map(json.loads, done.stdout.splitlines())
    return [
        Run(row["good"] if row["good"] is not None else np.inf, row["speed"], row["turned_deg"], row["words"])
        for row in rows
    ]


def row_of(who: str, stops_s: float, runs: Sequence[Run]) -> str:
    """A line of the table."""
    seconds = np.array([run.seconds for run in runs])
    brisk = np.array([run.speed_deg >= FAST_RATE_DEGPS for run in runs])
    words = max(run.words * MINUTE_S / max(min(run.seconds, MAX_DURATION_S), MINUTE_S) for run in runs)
    last = float(np.quantile(seconds, 0.98, method="higher"))
    most = f"{last:.1f} s" if last < MAX_DURATION_S else f"> {MAX_DURATION_S:.0f} s"
    return (
        f"| {PEOPLE[who]} | {'yes' if stops_s else ''} | {np.median(seconds):.1f} s | {most} "
        f"| {np.mean(seconds <= 20.0):.1%} | {np.mean(seconds <= 30.0):.1%} | {np.mean(seconds[brisk] <= 20.0):.1%} "
        f"| {np.median([run.turned_deg for run in runs]):.0f}° | {words:.0f} |"
    )


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sensors", type=int, default=200)
    parser.add_argument("--body", default="board")
    parser.add_argument("--dip", type=float, default=60.0)
    parser.add_argument("--people", default=",".join(PEOPLE))
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    try:
        build.library(target=build.WEB_PLATFORM)
    except build.NoCompiler as error:
        print(error, file=sys.stderr)
        return 1
    print("\n".join(HEADER))
    common = {"body": given.body, "dip": given.dip, "most_s": MAX_DURATION_S}
    for who in given.people.split(","):
        for stops_s in STOPS_S:
            asked = [{"seed": seed, "who": who, "halts": stops_s, **common} for seed in range(given.sensors)]
            parts = [asked[first :: given.processes] for first in range(given.processes)]
            with ThreadPoolExecutor(given.processes) as pool:
                runs = [run for part in pool.map(play, parts) for run in part]
            print(row_of(who, stops_s, runs), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
