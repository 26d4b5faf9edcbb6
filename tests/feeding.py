"""Feeds in tests: ask until there is enough, and put together what came."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from tests.waiting import PATIENCE_S

from flinders.core.samples import COLUMNS, Samples
from flinders.live.feeds import FeedEvent

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.live.feeds import Feed


def joined(blocks: list[Samples]) -> Samples:
    """Readings that came in several blocks, as one; each of them has the same columns."""
    if not blocks:
        return Samples.of(np.empty((0, 3)))
    parts = {name: [getattr(block, name) for block in blocks] for name in COLUMNS}
    columns = {name: np.concatenate(part) for name, part in parts.items() if part[0] is not None}
    return replace(blocks[0], **columns)  # type: ignore[arg-type]


def asked(feed: Feed, until: Callable[[Samples, list[FeedEvent]], bool]) -> tuple[Samples, list[FeedEvent]]:
    """Ask until there is enough."""
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
