"""Checkpoint of a run: a folder with a file for each finished partition.

Next to the table, ``calibrations.parquet``, a folder ``calibrations.parquet.parts`` holds a file for each finished
partition, and the plan of the run. A run with `append` calibrates the missing partitions; the table is the same to the
last byte, for any number of workers. The folder is removed when the table is written. If the table goes to a store, the
folder lies in the working directory.

The table is synced to the disk before it gets its name, partitions are not: after a power cut some may be missing, cut
short or empty. The name of a partition's file holds length and check sum; a partition that does not match is calibrated
again.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import secrets
import shutil
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Final

from flinders.apps.fleet.storage import is_remote
from flinders.core.files import reason_and_remedy, try_lock, write_text
from flinders.errors import OutputError, UsageError

if TYPE_CHECKING:
    from flinders.apps.fleet.plan import Plan

PLAN: Final = "plan.json"
TABLE: Final = "table.parquet"
"""Table that is copied to a store when it is complete."""
PARTITION_FILES: Final = "part-*.arrow"
OWNER_FILE: Final = "owner"
"""File that names the process which uses the folder."""
OWN_FILES: Final = (PARTITION_FILES, PLAN, TABLE, OWNER_FILE, ".flinders-*.tmp")
"""Files that a run may leave in its folder."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """The folder of finished partitions, which one run at a time may use."""

    folder: Path
    lock: int | None = None  # descriptor of the folder, while it is locked

    @classmethod
    def of(cls, out: str | os.PathLike[str], plan: Plan, *, append: bool, force: bool) -> Checkpoint:
        """Create the folder, or open that of an earlier run.

        Raises UsageError if it holds partitions and neither `append` nor `force` is given, or if it holds other files;
        OutputError if it cannot be created, or another run uses it. Partitions of files that have changed are removed;
        partitions of other options are refused.
        """
        folder = folder_of(out)
        with contextlib.ExitStack() as undo:
            try:
                folder.mkdir(exist_ok=True)
                checkpoint = cls(folder, _lock(folder))
                undo.callback(checkpoint.close)
                checkpoint._prepare(append=append, force=force)
                checkpoint._match(plan)
                (folder / OWNER_FILE).write_text(f"process {os.getpid()} on {platform.node()}", encoding="utf-8")
            except OSError as error:
                raise OutputError(f"{folder}: cannot be written: {reason_and_remedy(error)}") from None
            undo.pop_all()
        return checkpoint

    def close(self) -> None:
        """Unlock the folder for other runs."""
        if self.lock is not None:
            os.close(self.lock)

    def _prepare(self, *, append: bool, force: bool) -> None:
        """Refuse foreign files; keep, remove or refuse the partitions of an earlier run."""
        self._refuse_foreign()
        if self.finished_count and not append and not force:
            raise UsageError(
                f"{self.folder} holds partitions of an earlier run: continue that run, or begin again",
                hint={"append": True, "force": True},
            )
        if force or not append:
            self._clear()

    def _clear(self) -> None:
        """Remove all files from the folder."""
        for path in self.folder.iterdir():
            path.unlink()

    @property
    def finished_count(self) -> int:
        """Number of finished partitions."""
        return sum(1 for _ in self.folder.glob(PARTITION_FILES))

    def _refuse_foreign(self) -> None:
        """Refuse a folder with other files, which would be removed with it."""
        if self.folder.is_dir():
            foreign = [each.name for each in self.folder.iterdir() if not any(each.match(name) for name in OWN_FILES)]
            if foreign:
                raise UsageError(
                    f"{self.folder} is the folder for parts of the table, and holds a foreign file, "
                    f"{min(foreign)}: move that file, or name another table"
                )

    def _match(self, plan: Plan) -> None:
        """Write the plan, unless the folder has the same one; remove the partitions of another plan."""
        path = self.folder / PLAN
        known = _read_plan(path)
        if known.get("fingerprint") == plan.fingerprint:
            return
        if self.finished_count and known.get("asked") != plan.asked:
            raise UsageError(
                f"{self.folder} belongs to a run with other options or another release: repeat those to continue it, "
                "or begin again",
                hint={"force": True},
            )
        self._clear()
        about = {"fingerprint": plan.fingerprint, "asked": plan.asked, "files": plan.names}
        write_text(json.dumps(about) + "\n", path, force=True)

    def finished_files(self) -> dict[int, Path]:
        """Files of finished partitions by number; files that have changed since are removed."""
        files = {}
        for path in sorted(self.folder.glob(PARTITION_FILES)):
            with contextlib.suppress(OSError, ValueError):  # a file of another name is not of a run
                place = int(path.name.split("-")[1])
                if path == self._path(place, path.read_bytes()):
                    files[place] = path
                else:
                    path.unlink()
        return files

    def _path(self, place: int, content: bytes) -> Path:
        """Path of a partition with this content."""
        return self.folder / f"part-{place:07d}-{len(content)}-{zlib.crc32(content):08x}.arrow"

    def commit(self, place: int, content: bytes) -> Path:
        """Write the rows of a partition, all or none, and return the file; raises OutputError."""
        path = self._path(place, content)
        temporary = self.folder / f".flinders-{secrets.token_hex(8)}.tmp"
        try:
            temporary.write_bytes(content)
            return temporary.replace(path)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {reason_and_remedy(error)}") from None
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink()

    def remove(self) -> None:
        """Remove the folder; errors are ignored."""
        shutil.rmtree(self.folder, ignore_errors=True)


def folder_of(out: str | os.PathLike[str]) -> Path:
    """Path of the checkpoint folder of the run that writes a table."""
    table = os.fspath(out)
    return Path(f"{PurePosixPath(table).name if is_remote(table) else table}.parts")


def files_begun(out: str | os.PathLike[str]) -> list[str]:
    """Names of the files whose rows a stopped run was to add to this table; empty if no run was stopped."""
    return list(_read_plan(folder_of(out) / PLAN).get("files", ()))


def _read_plan(path: Path) -> dict[str, Any]:
    """The plan of the run that wrote a checkpoint folder; empty without one."""
    with contextlib.suppress(OSError, ValueError):
        content = json.loads(path.read_text(encoding="utf-8"))
        return content if isinstance(content, dict) else {}
    return {}


def _lock(folder: Path) -> int | None:
    """Lock a folder for this run; raises OutputError if another run has it. Folders of Windows have no locks."""
    if os.name == "nt":
        return None
    descriptor = os.open(folder, os.O_RDONLY)
    if try_lock(descriptor):
        return descriptor
    os.close(descriptor)
    owner = "process not recorded"
    with contextlib.suppress(OSError):
        owner = (folder / OWNER_FILE).read_text(encoding="utf-8", errors="replace")
    raise OutputError(
        f"{folder}: another run is writing into it ({owner}): wait until that one has ended, or name another table"
    )
