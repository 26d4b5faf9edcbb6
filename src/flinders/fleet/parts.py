"""What is done of a run: a file for each partition, in a folder beside the table.

>>> import tempfile
>>> parts = Parts(Path(tempfile.mkdtemp()))
>>> paths = [parts.commit(place, b"rows") for place in range(3)]
>>> _ = paths[2].write_bytes(b"row")
>>> sorted(parts.kept()), paths[2].exists()
([0, 1], False)

Each appears under its name when it is complete, and its name tells its length and check sum: what a machine that lost
its power has left cut short or empty is known by that, and done again.
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
from flinders.fleet.store import is_remote

if TYPE_CHECKING:
    from flinders.fleet.plan import Plan

PLAN: Final = "plan.json"
TABLE: Final = "table.parquet"
"""What goes to a store when it is complete."""
DONE: Final = "part-*.arrow"
OURS: Final = (DONE, PLAN, TABLE, ".flinders-*.tmp")
"""What a run leaves in its folder."""


@dataclass(frozen=True, slots=True)
class Parts:
    """The folder of what is done.

    Attributes
    ----------
    folder : Path
    """

    folder: Path

    @classmethod
    def of(cls, out: str | os.PathLike[str], plan: Plan, *, resume: bool, force: bool) -> Parts:
        """Make it, or find it again.

        Raises
        ------
        UsageError
            Where partitions are done and nobody said what to do about them, or they belong to another plan; where it
            holds something else.
        OutputError
            Where it cannot be made.
        """
        beside = os.fspath(out)
        parts = cls(Path(f"{PurePosixPath(beside).name if is_remote(beside) else beside}.parts"))
        try:
            parts._refuse_foreign()
            if parts.done and not resume and not force:
                raise UsageError(
                    f"{parts.folder} holds what an earlier run has done: go on with --resume, or begin again with "
                    "--force"
                )
            if parts.folder.exists() and not resume:
                shutil.rmtree(parts.folder)
            parts.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{parts.folder}: cannot be written: {reason(error)}") from None
        parts._agree(plan)
        return parts

    @property
    def done(self) -> int:
        """Files of partitions that there are."""
        return sum(1 for _ in self.folder.glob(DONE))

    def _refuse_foreign(self) -> None:
        """Let a folder be that holds anything else: it would go with the parts.

        Raises
        ------
        UsageError
        """
        if self.folder.is_dir():
            foreign = [each.name for each in self.folder.iterdir() if not any(each.match(name) for name in OURS)]
            if foreign:
                raise UsageError(
                    f"{self.folder} is where parts of the table are kept, and holds something else, "
                    f"{min(foreign)}: move that, or name another table"
                )

    def _agree(self, plan: Plan) -> None:
        """Keep the plan, or see that it is the one that is kept.

        Raises
        ------
        UsageError
            Where it is another.
        """
        path = self.folder / PLAN
        with contextlib.suppress(OSError, ValueError):
            if json.loads(path.read_text(encoding="utf-8"))["fingerprint"] == plan.fingerprint:
                return
        if self.done:
            raise UsageError(
                f"{self.folder} is of a run with other files, options or another release: name those again, or begin "
                "again with --force and without --resume"
            )
        held = {"fingerprint": plan.fingerprint, "partitions": len(plan.partitions)}
        write_text(json.dumps(held) + "\n", path, force=True)

    def kept(self) -> dict[int, Path]:
        """Files of the partitions that are done; those that a power cut has spoilt are taken away."""
        found = {}
        for path in sorted(self.folder.glob(DONE)):
            with contextlib.suppress(OSError, ValueError):  # of another name it is none of ours
                place = int(path.name.split("-")[1])
                if path == self._path(place, path.read_bytes()):
                    found[place] = path
                else:
                    path.unlink()
        return found

    def _path(self, place: int, content: bytes) -> Path:
        """Where the rows of a partition are, once they are there."""
        return self.folder / f"part-{place:07d}-{len(content)}-{zlib.crc32(content):08x}.arrow"

    def commit(self, place: int, content: bytes) -> Path:
        """Write the rows of a partition, all of them or none, and return the file.

        Raises
        ------
        OutputError
            Where they cannot be written.
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
        """Take it away; what cannot be taken away does no harm."""
        shutil.rmtree(self.folder, ignore_errors=True)
