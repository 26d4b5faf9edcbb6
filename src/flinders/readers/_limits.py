r"""What packed bytes may unpack to: a few kilobytes can be packed so that they fill a disk, or the memory.

A stream of more than `LARGE` bytes is refused while it is being unpacked, once it has `MOST_RATIO` times the bytes that
it came of; a piece that has to be in memory as a whole, at `MOST_PIECE` bytes.

>>> import zlib
>>> unpacked_piece(zlib.decompressobj(), zlib.compress(b"whole"))
b'whole'
>>> sum(map(len, metered("zeros.csv.gz", [bytes(1 << 23)] * 3, lambda: 20_000)))
Traceback (most recent call last):
flinders.errors.UnreadableInput: zeros.csv.gz unpacks to more than 24 MB from 20,000 bytes, as no recording does: unpack
it yourself if you trust it
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from flinders.errors import UnreadableInput

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

MOST_MEMBER: Final = 4 << 30
"""Bytes of a member of an archive, or of a packed file of a recording of ROS 2, unpacked."""
MOST_PIECE: Final = 1 << 30
"""Bytes that one packed piece may have, unpacked: a chunk of a bag has a few million."""
LARGE, MOST_RATIO = 16 << 20, 250
"""Bytes from which on the ratio counts, and the ratio: a table of digits packs to a fifth, zeros to a thousandth."""


def is_bomb(unpacked: int, packed: int) -> bool:
    """Tell whether so many bytes have come of so few as no table of readings packs to."""
    return unpacked > LARGE and unpacked > MOST_RATIO * packed


def metered(
    name: str, chunks: Iterable[bytes], packed: Callable[[], int], *, most: int | None = None, ratio: bool = True
) -> Iterator[bytes]:
    """Pass on what is unpacked, and refuse what becomes too much.

    Parameters
    ----------
    name : str
        For messages.
    chunks : iterable of bytes
        Unpacked.
    packed : callable
        Gives the bytes of which what has come so far was made.
    most : int, optional
        Bytes that are let pass at most.
    ratio : bool
        Judge it by `MOST_RATIO` too, which arrays need not keep: one of zeros packs to a thousandth.

    Raises
    ------
    UnreadableInput
    """
    done = 0
    for chunk in chunks:
        done += len(chunk)
        if (most is not None and done > most) or (ratio and is_bomb(done, packed())):
            raise too_much(name, done, packed())
        yield chunk


def too_much(name: str, unpacked: int, packed: int) -> UnreadableInput:
    """Say that so few bytes unpack to more than any recording has."""
    return UnreadableInput(
        f"{name} unpacks to more than {unpacked >> 20:,} MB from {packed:,} bytes, as no recording does: unpack it "
        "yourself if you trust it"
    )


def unpacked_piece(unpacker: Any, packed: bytes) -> bytes:  # noqa: ANN401 - of zlib, bz2, lz4 or zstd
    """Unpack a piece, and refuse one that is not whole or unpacks to more than `MOST_PIECE` bytes.

    Raises
    ------
    ValueError
        For one that is not whole.
    UnreadableInput
    """
    content: bytes = unpacker.decompress(packed, MOST_PIECE)
    if unpacker.eof:
        return content
    if len(content) < MOST_PIECE:
        raise ValueError("a packed piece is not whole")
    raise UnreadableInput(f"a packed piece of the recording has more than {MOST_PIECE >> 20} MB: no logger wrote it")
