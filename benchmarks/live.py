"""The live page under load in a real browser: processor time, memory, latency, and lost readings.

    python -m benchmarks.live [--seconds 60] [--minutes 10] [--tables start,page,turn,wire]

A simulated board on a pseudo-terminal prints lines like MotionCal's sketches, `flinders live` reads them, and Chromium
shows the page at 1280 × 800 with software rendering.

*start*: time from the start of the program to its address, and from the request of the page to its first drawn state;
size of the page without the 3-D view, as sent. *page*: 20,000 points are shown, and readings arrive at 100 a second for
some seconds. Processor time is the program's, in shares of a core, and the browser's for comparison. An update is a
received frame of readings; it counts as drawn when WebGL has drawn after it; a slow page draws several at once. The
latency of a reading is the time from its sending to the frame after the one in which WebGL drew it, when the picture
has left the page. *turn*: frames a second of the sphere, and of both clouds, while keys turn the view. *wire*: 1 kHz
for some minutes, sent at ten times that rate, with numbered readings that are counted in the recording while the page
is open.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import threading
import time
import urllib.request
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

import flinders
from benchmarks.stage import Board, Program, chromium, motioncal
from flinders import simulate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from playwright.sync_api import Browser, Page

    from flinders.arrays import Floats

CPU_LIMIT: Final = 10.0
LATENCY_LIMIT_MS: Final = 150.0
START_LIMIT_S: Final = 1.5
PICTURES_HZ: Final = 20.0
SHOWN_POINTS: Final = 20_000
RATE_HZ: Final = 100.0
FAST_HZ: Final = 10_000.0
WIRE_HZ: Final = 1000.0
PARTS: Final = (
    "", "static/theme.js", "static/page.css", "static/compass.svg", "static/page.js", "page.json", "static/worker.js",
    "flinders.wasm",
)  # fmt: skip
"""Files that a browser requests before it draws the sphere."""
KB_LIMIT: Final = 250.0
TICKS_A_SECOND: Final = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100
WATCH: Final = """() => {
    const seen = window.seen = {received: 0, drawn: 0, pictures: 0, frames: []};
    let [newest, fresh] = [null, 0];
    flinders.connection.connection.socket.addEventListener("message", (event) => {
        if (typeof event.data === "string") return;
        seen.received += 1;
        requestAnimationFrame(() => {
            newest = [...flinders.store.now.raw];
            fresh += 1;
        });
    });
    const kind = WebGL2RenderingContext.prototype;
    for (const name of ["drawArrays", "drawElements", "drawArraysInstanced", "drawElementsInstanced"]) {
        const plain = kind[name];
        kind[name] = function (...given) {
            if (fresh > 0) {
                seen.drawn += fresh;
                seen.pictures += 1;
                fresh = 0;
                const shown = newest;
                requestAnimationFrame(() => seen.frames.push([performance.timeOrigin + performance.now(), ...shown]));
            }
            return plain.apply(this, given);
        };
    }
}"""
"""Observes a page: when WebGL draws newer readings, and when the next frame begins. The page passes its newest reading
to the view in one frame, just before this code reads it, and the view draws in the next."""


@dataclass(slots=True)
class Load:
    """Processor time and memory of a process and its children, read from /proc."""

    pids: list[int]
    begun: float = field(default_factory=time.monotonic)
    used: float = 0.0
    memory: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Start the measurement."""
        self.used = seconds_used(self.pids)

    def look(self) -> None:
        """Note the memory, in MB."""
        self.memory.append(sum(map(resident_mb, self.pids)))

    @property
    def share(self) -> float:
        """Percent of a core since the start."""
        return 100.0 * (seconds_used(self.pids) - self.used) / (time.monotonic() - self.begun)


def seconds_used(pids: Iterable[int]) -> float:
    """Processor time of processes, s; 0 for ended ones."""
    return sum(map(_seconds, pids))


def _seconds(pid: int) -> float:
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / TICKS_A_SECOND


def resident_mb(pid: int) -> float:
    """Resident memory of a process, MB; 0 if it has ended."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="utf-8").split()[1])
    except OSError:
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def descendants(pid: int) -> list[int]:
    """A process and its descendants."""
    parents: dict[int, list[int]] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()[1])
        except OSError:
            continue
        parents.setdefault(parent, []).append(int(folder.name))
    found = [pid]
    for one in found:
        found += parents.get(one, [])
    return found


class Stamped:
    """Sends distinct readings to a program, and notes the time of each."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self.sent: list[tuple[float, tuple[int, int, int]]] = []
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._send, daemon=True)

    def start(self) -> None:
        """Start sending."""
        self._thread.start()

    def stop(self) -> None:
        """Stop sending."""
        self._stopped.set()
        self._thread.join()

    def _send(self) -> None:
        field = tumbling(SHOWN_POINTS)
        begun = time.monotonic()
        for number, line in enumerate(motioncal(field)):
            if self._stopped.wait(max(begun + number / RATE_HZ - time.monotonic(), 0.0)):
                return
            counts = tuple(int(part) for part in line.split(b",")[6:])
            self.sent.append((1e3 * time.time(), (counts[0], counts[1], counts[2])))
            self._board.send(line)


def tumbling(count: int) -> Floats:
    """(count, 3) µT of a sensor in a hand."""
    return simulate.tumble(seed=5, n=count, rate_hz=RATE_HZ, noise=0.5).samples.field


def latencies_ms(sent: Sequence[tuple[float, tuple[int, int, int]]], frames: Sequence[Sequence[float]]) -> Floats:
    """Latencies, ms: from sending each reading to the frame after the one that drew it.

    Parameters
    ----------
    sent : list of (ms, counts)
    frames : list of (ms, x, y, z)
        Time of a frame, and its newest reading, in µT.

    Examples
    --------
    >>> latencies_ms([(0.0, (10, 20, 30)), (5.0, (11, 20, 30))], [(100.0, 1.1, 2.0, 3.0)]).tolist()
    [100.0, 95.0]
    """
    places: dict[tuple[int, int, int], list[int]] = {}
    for number, (_, counts) in enumerate(sent):
        places.setdefault(counts, []).append(number)
    found, first = [], 0
    for at, *shown in frames:
        key = (round(10 * shown[0]), round(10 * shown[1]), round(10 * shown[2]))
        newest = next((number for number in places.get(key, []) if number >= first), None)
        if newest is None:
            continue
        found += [at - sent[number][0] for number in range(first, newest + 1)]
        first = newest + 1
    return np.array(found)


def median_and_p95(values: Floats) -> str:
    """Median and 95th percentile in words."""
    return f"{np.median(values):.0f} ms, p95 {np.percentile(values, 95):.0f} ms"


def until(page: Page, expression: str, seconds: float = 120.0) -> None:
    """Wait until an expression of the page is true."""
    end = time.monotonic() + seconds
    while not page.evaluate(expression):
        if time.monotonic() > end:
            raise TimeoutError(f"{expression}: {page.evaluate('JSON.stringify(window.flinders?.store.state)')}")
        page.wait_for_timeout(50)


def opened(browser: Browser, program: Program, size: tuple[int, int] = (1280, 800)) -> Page:
    """Open the page."""
    page = browser.new_context(viewport={"width": size[0], "height": size[1]}, color_scheme="dark").new_page()
    page.goto(program.address)
    until(page, "Boolean(window.flinders?.store.hello)")
    return page


def start(browser: Browser, folder: Path, times: int = 5) -> list[str]:
    """Rows on the time until the page is shown."""
    programs, pages, size = [], [], 0
    for turn in range(times):
        place = folder / str(turn)
        place.mkdir()
        begun = time.monotonic()
        with Program(place, "--simulate") as program:
            programs.append(time.monotonic() - begun)
            page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
            page.goto(program.address)
            pages.append(page.evaluate(READY) / 1e3)
            page.context.close()
            size = sum(sent_bytes(program.address + part) for part in PARTS)
    worst = [f"{np.median(found):.2f} s (worst {max(found):.2f})" for found in (programs, pages)]
    together = float(np.median(np.add(programs, pages)))
    return [
        f"| program started → address | {worst[0]} | |",
        f"| page asked for → first drawn state | {worst[1]} | {_judged(float(np.median(pages)), START_LIMIT_S, 's')} |",
        f"| both | {together:.2f} s | |",
        f"| over the wire, without the 3-D view | {size / 1e3:.0f} kB | {_judged(size / 1e3, KB_LIMIT, 'kB')} |",
    ]


def sent_bytes(address: str) -> int:
    """Bytes that a browser receives for an address."""
    asked = urllib.request.Request(address, headers={"Accept-Encoding": "gzip"})
    with urllib.request.urlopen(asked) as answer:
        return len(answer.read())


READY: Final = """() => new Promise(resolve => {
    const isThere = () => document.getElementById("source-name").textContent !== "connecting";
    const look = () => window.flinders?.store.state && isThere()
        ? requestAnimationFrame(() => requestAnimationFrame(() => resolve(performance.now())))
        : requestAnimationFrame(look);
    look();
})"""


def page_load(browser: Browser, folder: Path, seconds: float) -> list[str]:
    """Rows on a page with many points while readings arrive."""
    with Board(folder / "ttyBoard") as board, Program(folder, "--serial", str(board.port)) as program:
        page = opened(browser, program)
        board.play(motioncal(tumbling(SHOWN_POINTS)), 4000.0)
        until(page, f"flinders.store.points.count >= {SHOWN_POINTS}")
        board.stop()
        page.wait_for_timeout(2000)
        page.evaluate(WATCH)
        ours, theirs = Load([program.pid]), Load(browser_pids(program))
        stamped = Stamped(board)
        stamped.start()
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            page.wait_for_timeout(1000)
            ours.look()
            theirs.look()
        share, browsers = ours.share, theirs.share
        stamped.stop()
        page.wait_for_timeout(1000)
        seen: dict[str, Any] = page.evaluate("window.seen")
        shown = page.evaluate("flinders.store.points.count")
        latency = latencies_ms(stamped.sent, seen["frames"])
    rate = seen["received"] / seconds
    latency_limit = _judged(float(np.median(latency)), LATENCY_LIMIT_MS, "ms")
    memory = np.array(ours.memory)
    quarter = max(len(memory) // 4, 1)
    growth = float(memory[-quarter:].mean() - memory[:quarter].mean())
    return [
        f"| shown points, readings a second | {shown:,}, {RATE_HZ:g} | |",
        f"| processor time of the server | {share:.1f} % of a core | {_judged(share, CPU_LIMIT, '%')} |",
        f"| processor time of the browser | {browsers:.0f} % of a core | |",
        f"| memory of the server | {memory.max():.0f} MB, last quarter {growth:+.1f} MB against the first | |",
        f"| updates received | {seen['received']} ({rate:.1f} a second) | |",
        f"| … drawn, in so many pictures | {seen['drawn']}, {seen['pictures']} | |",
        f"| reading sent → drawn | {median_and_p95(latency)} | {latency_limit} |",
    ]


TURN: Final = """seconds => new Promise(resolve => {
    const canvas = document.querySelector("#scene canvas");
    const begun = performance.now();
    let pictures = 0;
    const look = () => {
        pictures += 1;
        canvas.dispatchEvent(new KeyboardEvent("keydown", {key: "ArrowLeft", bubbles: true}));
        const passed = (performance.now() - begun) / 1000;
        if (passed > seconds) resolve(pictures / passed);
        else requestAnimationFrame(look);
    };
    requestAnimationFrame(look);
})"""
TURN_S: Final = 4.0


def turned(browser: Browser, folder: Path) -> list[str]:
    """Rows on the frame rate of the 3-D view while it turns."""
    log = folder / "turned.csv"
    rows = np.column_stack([np.arange(SHOWN_POINTS) / RATE_HZ, tumbling(SHOWN_POINTS)])
    np.savetxt(log, rows, fmt="%.4f", delimiter=",", header="t_s,mx_uT,my_uT,mz_uT", comments="")
    with Program(folder, "--replay", str(log), "--speed", "1000") as program:
        return [line for size in ((1280, 800), (1920, 1080)) for line in _turned(browser, program, size)]


def _turned(browser: Browser, program: Program, size: tuple[int, int]) -> list[str]:
    page = opened(browser, program, size)
    until(page, f"flinders.store.points.count >= {SHOWN_POINTS} && Boolean(flinders.store.view?.shown)")
    lines = []
    for mode in ("sphere", "clouds"):
        page.locator(f"input[value={mode}]").check(force=True)
        page.evaluate(TURN, TURN_S)  # until the page knows how fast it is
        before, pids = seconds_used(browser_pids(program)), browser_pids(program)
        rate = page.evaluate(TURN, TURN_S)
        cost_ms = 1e3 * (seconds_used(pids) - before) / (rate * TURN_S)
        detail = page.evaluate("document.querySelector('#scene canvas').dataset.detail")
        judged = f"≥ {PICTURES_HZ:g} a second" if rate >= PICTURES_HZ else f"**≥ {PICTURES_HZ:g} a second: missed**"
        lines.append(
            f"| {mode} turned at {size[0]} × {size[1]}, {detail} detail | {rate:.0f} pictures a second, "
            f"{cost_ms:.0f} ms of processor time each | {judged} |"
        )
    page.context.close()
    return lines


def browser_pids(program: Program) -> list[int]:
    """Processes of the browser: descendants of this process except the program."""
    theirs = set(descendants(os.getpid())) - set(descendants(program.pid)) - {os.getpid()}
    return sorted(theirs)


def wire(browser: Browser, folder: Path, minutes: float) -> list[str]:
    """Rows on lost readings in the recording."""
    count = round(minutes * 60 * WIRE_HZ)
    field = motioncal(tumbling(SHOWN_POINTS))
    with Board(folder / "ttyBoard") as board, Program(folder, "--serial", str(board.port)) as program:
        page = opened(browser, program)
        load = Load([program.pid])
        begun = time.monotonic()
        sender = threading.Thread(target=_numbered, args=(board, field, count), daemon=True)
        sender.start()
        while sender.is_alive():
            page.wait_for_timeout(500)
            load.look()
        took = time.monotonic() - begun
        until(page, f"flinders.store.state.readings >= {count}")
        shown, stride = page.evaluate("[flinders.store.points.count, flinders.store.state.stride]")
        load.look()
        cost = load.share * (time.monotonic() - begun) / (count / WIRE_HZ)
        recording = program.recording
    missing, found = _missing(recording, count)
    memory = np.array(load.memory)
    later = memory[len(memory) // 2 :]
    return [
        f"| readings sent, in | {count:,}, {took:.0f} s ({count / took / WIRE_HZ:.1f} × 1 kHz) | |",
        f"| readings in the recording | {found:,}, {missing} missing | {_judged(missing, 0, '')} |",
        f"| shown points, of each | {shown:,}, {stride} readings | |",
        f"| memory of the server | {memory.max():.0f} MB; second half {later.min():.0f} to {later.max():.0f} MB | |",
        f"| processor time of the server | {cost:.1f} % of a core, were it 1 kHz | |",
    ]


def _numbered(board: Board, lines: Sequence[bytes], count: int) -> None:
    """Send readings numbered with 15 bits in each of two axes of the gyro."""
    begun = time.monotonic()
    block = round(FAST_HZ / 200)
    for first in range(0, count, block):
        numbers = range(first, min(first + block, count))
        board.send(b"".join(_with_number(lines[number % len(lines)], number) for number in numbers))
        time.sleep(max(begun + (first + block) / FAST_HZ - time.monotonic(), 0.0))


def _with_number(line: bytes, number: int) -> bytes:
    return line.replace(b",8192,0,0,0,", b",8192,%d,%d,0," % (number >> 15, number & 0x7FFF), 1)


def _missing(recording: Path, count: int) -> tuple[int, int]:
    """Count of missing numbers, and of readings in the recording."""
    rate = flinders.read(recording).rate
    if rate is None:
        return count, 0
    high, low = np.rint(np.degrees(rate[:, :2]).T * COUNTS_PER_DPS).astype(int)
    return count - len(np.unique(high << 15 | low)), len(rate)


COUNTS_PER_DPS: Final = 16.0


def _judged(value: float, limit: float, unit: str) -> str:
    """A limit in words, in bold if missed."""
    told = f"≤ {limit:g} {unit}".strip()
    return told if value <= limit else f"**{told}: missed**"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--tables", default="start,page,turn,wire")
    given = parser.parse_args()
    tables: dict[str, Callable[[Browser, Path], list[str]]] = {
        "start": start,
        "page": lambda browser, folder: page_load(browser, folder, given.seconds),
        "turn": turned,
        "wire": lambda browser, folder: wire(browser, folder, given.minutes),
    }
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        for name in given.tables.split(","):
            place = Path(folder) / name
            place.mkdir()
            print(f"load of the machine before: {os.getloadavg()[0]:.1f}\n\n| {name} | | limit |\n|---|---|---|")
            print("\n".join(tables[name](browser, place)), end="\n\n", flush=True)


if __name__ == "__main__":
    main()
