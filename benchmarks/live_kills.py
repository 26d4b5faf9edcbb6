"""Losses of a recording whose program is killed at random moments, and its continuation.

    python -m benchmarks.live_kills [--times 20]

A board sends 500 lines a second over UDP; `flinders record` and `flinders live` are killed by SIGKILL within two
seconds of their first reading and started again with ``--resume``. The loss is the time from the last line in the file
to the kill. Prints Markdown.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tests.feeding import UdpBoard, free_port, recorded
from tests.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Sequence

COMMANDS: Final = {
    "record": ("record", "--udp"),
    "live": ("live", "--port", "0", "--no-open", "--unit", "uT", "--udp"),
}
LINES: Final = 600_000
"""Lines of the board, for twenty minutes."""
MAX_DELAY_S: Final = 2.0
"""Longest time from the first recorded reading to the kill."""


@dataclass(frozen=True)
class Kill:
    """Result: readings so far, seconds lost, and whether the earlier bytes are unchanged."""

    readings: int
    lost_s: float
    has_same_bytes: bool


def killed(words: Sequence[str], path: Path, board: UdpBoard, seconds: float) -> Kill:
    """Start a program that records to a file, and kill it some seconds after its first reading."""
    before = path.read_bytes() if path.exists() else b""
    rows = len(recorded(path))
    output = ["--resume", str(path)] if words[0] == "live" else ["--resume", "-o", str(path)]
    output = output if before else ["-o", str(path)]
    program = subprocess.Popen(
        [sys.executable, "-m", "flinders", *words, *output], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    wait_until(lambda: len(recorded(path)) > rows or program.poll() is not None)
    time.sleep(seconds)
    program.kill()
    moment = time.monotonic()
    program.wait()
    after = recorded(path)
    lines = set(after)
    lost = moment - max(at for at, line in board.sent if line in lines)
    whole = before[: before.rfind(b"\n") + 1]  # without a partial last line
    return Kill(len(after), lost, path.read_bytes().startswith(whole) and len(after) > rows)


def kills(command: str, times: int) -> list[Kill]:
    """Kill a command several times."""
    rng, port = random.Random(1), free_port()
    board = UdpBoard(port, LINES)
    board.start()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session.csv"
        words = (*COMMANDS[command], str(port))
        made = [killed(words, path, board, rng.uniform(0.0, MAX_DELAY_S)) for _ in range(times)]
    board.stop()
    return made


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=20)
    given = parser.parse_args()
    print("| command | kills | gone on with, same bytes before | readings | lost, worst |\n|---|---:|---:|---:|---:|")
    for command in COMMANDS:
        made = kills(command, given.times)
        same = sum(each.has_same_bytes for each in made)
        worst = max(each.lost_s for each in made)
        print(f"| {command} | {len(made)} | {same} | {made[-1].readings:,} | {worst:.2f} s |", flush=True)


if __name__ == "__main__":
    main()
