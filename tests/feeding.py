"""Feeds in tests: a board that sends, the recording of its lines, and readings requested until there are enough."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from tests.waiting import PATIENCE_S

from flinders import simulate
from flinders.core.samples import COLUMNS, Samples
from flinders.links.feeds import FeedEvent

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flinders.links.feeds import Feed


def joined(blocks: list[Samples]) -> Samples:
    """Blocks of readings with the same columns, joined to one."""
    if not blocks:
        return Samples.of(np.empty((0, 3)))
    parts = {name: [getattr(block, name) for block in blocks] for name in COLUMNS}
    columns = {name: np.concatenate(part) for name, part in parts.items() if part[0] is not None}
    return replace(blocks[0], **columns)  # type: ignore[arg-type]


def asked(feed: Feed, until: Callable[[Samples, list[FeedEvent]], bool]) -> tuple[Samples, list[FeedEvent]]:
    """Call a feed until `until` is true; returns readings and events."""
    blocks: list[Samples] = []
    events: list[FeedEvent] = []
    give_up = time.monotonic() + PATIENCE_S
    while not until(joined(blocks), events) and time.monotonic() < give_up:
        found = feed.next(0.1)
        if isinstance(found, FeedEvent):
            events.append(found)
        elif found is not None:
            blocks.append(found)
    return joined(blocks), events


def free_port() -> int:
    """A port that no program gets unless it asks for it: it stays free as long as nobody listens on it."""
    numbers = np.random.default_rng()
    for port in numbers.integers(20_000, 30_000, 100).tolist():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return int(port)
    raise OSError("no free port from 20,000 to 30,000")


class UdpBoard(threading.Thread):
    """A board that sends a line every 2 ms over UDP, whether or not anybody listens."""

    def __init__(self, port: int, count: int = 5000) -> None:
        super().__init__(daemon=True)
        field = simulate.tumble(seed=1, n=max(count, 5000)).samples.field[:count]
        self.lines = [",".join(f"{value:.3f}" for value in row) for row in field]
        self.sent: list[tuple[float, str]] = []
        self._port, self._is_over = port, threading.Event()

    def run(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
            for line in self.lines:
                if self._is_over.wait(0.002):
                    return
                with contextlib.suppress(ConnectionError):
                    wire.sendto(f"{line}\n".encode(), ("127.0.0.1", self._port))
                self.sent.append((time.monotonic(), line))

    def stop(self) -> None:
        self._is_over.set()
        self.join()


def recorded(path: Path) -> list[str]:
    """The field in each row of a recording, as it was sent; none if the file does not exist yet."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    rows = [line for line in text.splitlines() if line[:1].isdigit()]
    return [row.partition(",")[2] for row in rows]
