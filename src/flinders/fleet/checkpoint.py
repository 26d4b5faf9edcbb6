"""Checkpoint of a run: a file for each finished partition, in a folder beside the table.

>>> import tempfile
>>> checkpoint = Checkpoint(Path(tempfile.mkdtemp()))
>>> paths = [checkpoint.commit(place, b"rows") for place in range(3)]
>>> _ = paths[2].write_bytes(b"row")
>>> sorted(checkpoint.finished()), paths[2].exists()
([0, 1], False)

A file appears under its name when it is complete, and the name holds its length and check sum: what a power cut has
truncated or emptied is recognised by that, and done again.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import shutil
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Final

from flinders.core.files import reason, write_text
from flinders.errors import OutputError, UsageError
from flinders.fleet.storage import is_remote

if TYPE_CHECKING:
    from flinders.fleet.plan import Plan

PLAN: Final = "plan.json"
TABLE: Final = "table.parquet"
"""Table that goes to a store when it is complete."""
DONE: Final = "part-*.arrow"
OURS: Final = (DONE, PLAN, TABLE, ".flinders-*.tmp")
"""Files that a run may leave in its folder."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """The folder of finished partitions."""

    folder: Path

    @classmethod
    def of(cls, out: str | os.PathLike[str], plan: Plan, *, resume: bool, force: bool) -> Checkpoint:
        """Create the folder, or open that of an earlier run.

        Raises
        ------
        UsageError
            If it holds partitions and neither `resume` nor `force` is given; if they belong to another plan; if it
            holds other files.
        OutputError
            If it cannot be created.
        """
        table = os.fspath(out)
        checkpoint = cls(Path(f"{PurePosixPath(table).name if is_remote(table) else table}.parts"))
        try:
            checkpoint._refuse_foreign()
            if checkpoint.done and not resume and not force:
                raise UsageError(
                    f"{checkpoint.folder} holds what an earlier run has done: go on with --resume, or begin again with "
                    "--force"
                )
            if checkpoint.folder.exists() and not resume:
                shutil.rmtree(checkpoint.folder)
            checkpoint.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{checkpoint.folder}: cannot be written: {reason(error)}") from None
        checkpoint._match(plan)
        return checkpoint

    @property
    def done(self) -> int:
        """Number of files of partitions."""
        return sum(1 for _ in self.folder.glob(DONE))

    def _refuse_foreign(self) -> None:
        """Refuse a folder with other files, which would be removed with it."""
        if self.folder.is_dir():
            foreign = [each.name for each in self.folder.iterdir() if not any(each.match(name) for name in OURS)]
            if foreign:
                raise UsageError(
                    f"{self.folder} is where parts of the table are kept, and holds something else, "
                    f"{min(foreign)}: move that, or name another table"
                )

    def _match(self, plan: Plan) -> None:
        """Write the fingerprint of the plan, or refuse partitions of another plan."""
        path = self.folder / PLAN
        with contextlib.suppress(OSError, ValueError):
            if json.loads(path.read_text(encoding="utf-8"))["fingerprint"] == plan.fingerprint:
                return
        if self.done:
            raise UsageError(
                f"{self.folder} is of a run with other files, options or another release: name those again, or begin "
                "again with --force and without --resume"
            )
        about = {"fingerprint": plan.fingerprint, "partitions": len(plan.partitions)}
        write_text(json.dumps(about) + "\n", path, force=True)

    def finished(self) -> dict[int, Path]:
        """Files of finished partitions; those that are not as they were written are removed."""
        files = {}
        for path in sorted(self.folder.glob(DONE)):
            with contextlib.suppress(OSError, ValueError):  # a file of another name is not of a run
                place = int(path.name.split("-")[1])
                if path == self._path(place, path.read_bytes()):
                    files[place] = path
                else:
                    path.unlink()
        return files

    def _path(self, place: int, content: bytes) -> Path:
        """File of a partition with this content."""
        return self.folder / f"part-{place:07d}-{len(content)}-{zlib.crc32(content):08x}.arrow"

    def commit(self, place: int, content: bytes) -> Path:
        """Write the rows of a partition, all or none, and return the file.

        Raises
        ------
        OutputError
            If they cannot be written.
        """
        path = self._path(place, content)
        temporary = self.folder / f".flinders-{secrets.token_hex(8)}.tmp"
        try:
            temporary.write_bytes(content)
            return temporary.replace(path)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {reason(error)}") from None
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink()

    def remove(self) -> None:
        """Remove the folder; if that fails, nothing is lost."""
        shutil.rmtree(self.folder, ignore_errors=True)
