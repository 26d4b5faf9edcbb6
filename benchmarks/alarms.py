"""Alarms of the live page while a recording grows, and whether its final state confirms them. Prints Markdown.

    python -m benchmarks.alarms                  # recordings of the shared data, and sensors that lie still
    python -m benchmarks.alarms "lies still"     # one of them

Each recording is played into a session of the page, under Node.js, in steps of half a second, with a fit after each
step. An alarm is a state with the phase *wrong*. It is confirmed if the phase at the end is *wrong* too. Recordings
without an alarm have no row.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
from tests.page_session import PageSession, warnings

import flinders
from benchmarks.fits import recordings
from benchmarks.recordings import FOLDER
from flinders import simulate
from flinders.apps.live.buffer import rows_of
from flinders.apps.live.messages import SourceState
from flinders.core.units import Unit

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from flinders.core.samples import Samples

STEP_S: Final = 0.5
MAX_RECORDING_S: Final = 180.0
"""Longest part of a recording, in s, that is played; later states repeat earlier ones."""
RATE_HZ: Final = 50.0
"""Rate that is assumed for recordings without times."""
FINAL_PHASES: Final = {"good", "limited"}


@dataclass(frozen=True, slots=True)
class State:
    """State of the page at a time in s: phase, codes of warnings, and sentence."""

    at: float
    phase: str
    codes: tuple[str, ...]
    words: str


def states(samples: Samples) -> Iterator[State]:
    """Yield the states of the page while a recording grows and after its end."""
    session = PageSession(SourceState("the recording", "replay", "connected", ""))
    time = np.arange(len(samples)) / RATE_HZ if samples.time is None else samples.time - samples.time[0]
    rows = rows_of(replace(samples, time=time))
    last = min(float(time[-1]), MAX_RECORDING_S)
    ends = np.searchsorted(time, np.arange(STEP_S, last + STEP_S, STEP_S))
    for begin, end in pairwise([0, *ends.tolist()]):
        if end > begin:
            session.arrived(float(time[end - 1]), rows[begin:end], samples.unit)
            session.fit()
            yield _state(session)
    session.linked(last, "ended")
    session.fit()
    session.ticked(last + 2.0)
    yield _state(session)


def _state(session: PageSession) -> State:
    """State of the page that shows a session."""
    shown = session.state
    return State(session.at, shown.phase, tuple(warnings(shown.reasons)), shown.words)


def row(name: str, said: list[State]) -> str | None:
    """A row of the table; None for a recording without an alarm."""
    alarms = [state for state in said if state.phase == "wrong"]
    last = said[-1]
    unconfirmed = alarms if last.phase != "wrong" else []
    back = sum(one.phase in FINAL_PHASES and two.phase == "wrong" for one, two in pairwise(said))
    if not alarms:
        return None
    codes = ", ".join(sorted({code for state in unconfirmed for code in state.codes}))
    first = f"{unconfirmed[0].at:.0f} s: {unconfirmed[0].words}" if unconfirmed else ""
    return f"| {name} | {len(said)} | {last.phase} | {len(alarms)} | {len(unconfirmed)} | {codes} | {back} | {first} |"


def still(seed: int, *, quantum: float = 0.0, then_turned: bool = False) -> Samples:
    """Recording of a sensor that lies still for 30 s, with noise of 0.5 µT, and is then turned if `then_turned`."""
    rng = np.random.default_rng(seed)
    field = np.array([22.0, -8.0, 41.0]) + rng.normal(scale=0.5, size=(1500, 3))
    if then_turned:
        turned = simulate.tumble(seed=seed, noise=0.5).samples.field
        field = np.concatenate([field - field.mean(axis=0) + turned[0], turned])
    if quantum:
        field = np.round(field / quantum) * quantum
    return flinders.Samples.of(field, unit=Unit.of("uT"))


STILL_SENSORS: Final[dict[str, Callable[[], Samples]]] = {
    "lies still": lambda: still(1),
    "lies still, steps of 0.3 µT": lambda: still(2, quantum=0.3),
    "lies still, then is turned": lambda: still(3, then_turned=True),
}


def of_recording(name: str) -> str | None:
    """Row of a recording, or of a sensor that lies still."""
    samples = STILL_SENSORS[name]() if name in STILL_SENSORS else flinders.read(FOLDER / name)
    return row(name, list(states(samples)))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", help="recordings below the folder, or all")
    names = parser.parse_args().names or [*STILL_SENSORS, *recordings()]
    print("| recording | states | at the end | alarms | not confirmed | of these | good, then wrong | first |")
    print("|---|---:|---|---:|---:|---|---:|---|")
    with ProcessPoolExecutor() as pool:
        for line in filter(None, pool.map(of_recording, names)):
            print(line, flush=True)


if __name__ == "__main__":
    main()
