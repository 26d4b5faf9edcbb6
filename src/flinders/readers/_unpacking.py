"""Archives: their members, without believing what they say of their size.

A member that unpacks to more than `MOST_UNPACKED` bytes, or to `MOST_RATIO` times its size once it is large, is refused
while it is being unpacked: a few kilobytes can be packed so that they fill a disk.
"""

from __future__ import annotations

from typing import Final

from flinders.errors import UnreadableInput

MOST_UNPACKED: Final = 4 << 30
"""Bytes of a member, unpacked."""
LARGE, MOST_RATIO = 16 << 20, 250
"""Bytes from which on the ratio counts, and the ratio: a table of digits packs to a fifth, zeros to a thousandth."""


def is_bomb(unpacked: int, packed: int) -> bool:
    """Tell whether so many bytes have come of so few as no table of readings packs to."""
    return unpacked > LARGE and unpacked > MOST_RATIO * packed


def too_large(name: str, unpacked: int, packed: int) -> UnreadableInput:
    """Say so."""
    return UnreadableInput(
        f"{name} unpacks to more than {unpacked >> 20:,} MB from {packed:,} bytes, as no recording does: unpack it "
        "yourself if you trust it"
    )
