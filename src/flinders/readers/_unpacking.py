"""Archives: their members, without believing what they say of their size.

A member that unpacks to more than `MOST_UNPACKED` bytes, or to `MOST_RATIO` times its size once it is large, is refused
while it is being unpacked: a few kilobytes can be packed so that they fill a disk.
"""

from __future__ import annotations

import zipfile
from typing import TYPE_CHECKING, Final

from flinders.errors import UnreadableInput
from flinders.readers._extras import reading

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.readers._source import File

ZIP: Final = b"PK\x03\x04"
MOST_MEMBERS: Final = 10_000
MOST_UNPACKED: Final = 4 << 30
"""Bytes of a member, unpacked."""
LARGE, MOST_RATIO = 16 << 20, 250
"""Bytes from which on the ratio counts, and the ratio: a table of digits packs to a fifth, zeros to a thousandth."""
CHUNK: Final = 1 << 18


def members(file: File) -> list[zipfile.ZipInfo]:
    """List the files in an archive.

    Raises
    ------
    UnreadableInput
        For an archive that is broken, or has more than `MOST_MEMBERS`.
    """
    with reading(file.name, "a ZIP archive"), zipfile.ZipFile(file.path) as archive:
        found = [member for member in archive.infolist() if not member.is_dir()]
    if len(found) > MOST_MEMBERS:
        raise UnreadableInput(f"{file.name} has {len(found):,} members: unpack it and give the recording inside")
    return found


def is_bomb(unpacked: int, packed: int) -> bool:
    """Tell whether so many bytes have come of so few as no table of readings packs to."""
    return unpacked > LARGE and unpacked > MOST_RATIO * packed


def too_large(name: str, unpacked: int, packed: int) -> UnreadableInput:
    """Say so."""
    return UnreadableInput(
        f"{name} unpacks to more than {unpacked >> 20:,} MB from {packed:,} bytes, as no recording does: unpack it "
        "yourself if you trust it"
    )


def member_chunks(file: File, member: zipfile.ZipInfo, *, ratio: bool = True) -> Iterator[bytes]:
    """Unpack a member, a piece at a time.

    Parameters
    ----------
    file : File
    member : ZipInfo
    ratio : bool
        Judge it by `MOST_RATIO` too, which arrays need not keep: one of zeros packs to a thousandth.

    Raises
    ------
    UnreadableInput
        For one that is locked, broken, or unpacks to too much.
    """
    if member.flag_bits & 1:
        raise UnreadableInput(f"{member.filename} in {file.name} is locked with a password: unpack it first")
    done = 0
    with reading(file.name, "a ZIP archive"), zipfile.ZipFile(file.path) as archive, archive.open(member) as stream:
        while chunk := stream.read(CHUNK):
            done += len(chunk)
            if done > MOST_UNPACKED or (ratio and is_bomb(done, member.compress_size)):
                raise too_large(f"{member.filename} in {file.name}", done, member.compress_size)
            yield chunk
