"""The recordings of a run as files: what was read of them and left out, and by which hash they are known again."""

from __future__ import annotations

import contextlib
import hashlib
from typing import TYPE_CHECKING

from flinders.errors import TooFewSamples

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from flinders.samples import Recording


def sha256(recording: Recording) -> str:
    """Hash a file as it lies on the disk; what was spooled, for standard input."""
    digest = hashlib.sha256()
    with recording.file.opened() as (raw, _):  # type: ignore[attr-defined]
        while chunk := raw.read(1 << 20):
            digest.update(chunk)
    return digest.hexdigest()


@contextlib.contextmanager
def saying_what_was_skipped(recordings: Iterable[Recording]) -> Iterator[None]:
    """Where readings are too few, say what was left out of these recordings: it may be the reason.

    Raises
    ------
    TooFewSamples
        Again, with that.
    """
    try:
        yield
    except TooFewSamples as error:
        skipped = [entry for recording in recordings for entry in getattr(recording, "skipped", ())]
        raise TooFewSamples(found=error.found, needed=error.needed, method=error.method, skipped=skipped) from None
