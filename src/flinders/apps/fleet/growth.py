"""Files of a table that is extended: those that it was made from, and those that are new, changed or gone.

The footer of the table lists the files, so that table and list are replaced in one step. A file is identified by its
name below the input, its size and its time of change (in a store its tag); its content is not read again.

>>> from flinders.apps.fleet.options import Options
>>> from flinders.apps.fleet.storage import StoredFile
>>> one, two = StoredFile("A17.csv", "", 10, "monday"), StoredFile("B02.csv", "", 20, "monday")
>>> before = ReadFiles.of([one], Options())
>>> again = ReadFiles.loads(before.dumps())
>>> new, faults = again.find_changes([two])
>>> [each.name for each in new], {name: error.code for name, error in faults.items()}
(['B02.csv'], {'A17.csv': 'vanished-file'})
"""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias

import numpy as np

from flinders.apps.fleet.results import (
    SIGN,
    VERSION,
    UnitResult,
    UnitResults,
    integers,
    needs_arrow,
    reading_table,
    strings,
)
from flinders.errors import DocumentError, FlindersError, InputError, UsageError

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Mapping, Sequence

    from flinders.apps.fleet.options import Options
    from flinders.apps.fleet.storage import StoredFile

    State: TypeAlias = tuple[int, str, str]  # size in bytes, time of change or tag, kind if it is no recording

FILES: Final = b"flinders.apps.fleet.files"
"""Key of the list of files in the metadata of a table."""
OPTIONS: Final = b"options"
"""Key of the options of a run in the metadata of its list of files."""


class ChangedFile(InputError):
    """A file that has changed since it was fitted (`size` then and `now`, in bytes)."""

    code = "changed-file"

    def __init__(self, name: str, size: int, now: int) -> None:
        how = "it was written again" if size == now else f"it had {size:,} bytes, and has {now:,}"
        super().__init__(
            f"{name} has changed since it was fitted ({how}): its rows are from the old content; give the new "
            "recording a name of its own, or begin the table again",
            hint={"force": True},
            size=size,
            now=now,
        )


class VanishedFile(InputError):
    """A file that was fitted and is no longer in the input."""

    code = "vanished-file"

    def __init__(self, name: str) -> None:
        super().__init__(f"{name} was fitted and is no longer there: its rows stay as they are; look for the file")


FILE_CODES: Final = (ChangedFile.code, VanishedFile.code)
"""Codes of rows about files that were fitted before; each run writes these rows anew."""


@dataclass(frozen=True, slots=True)
class ReadFiles:
    """The files that a table was made from, and the options of reading them."""

    options: Mapping[str, Any]  # of `Options`
    files: Mapping[str, State] = field(default_factory=dict)
    digest: int = 0  # check sum of the text that this list was read from

    @classmethod
    def of(cls, files: Iterable[StoredFile], options: Options, others: Mapping[StoredFile, str] | None = None) -> Self:
        """List of `files`, which are recordings, and of `others`, which are not, with their kinds."""
        kinds = others or {}
        read = {each.name: (each.size, each.stamp, kinds.get(each, "")) for each in (*files, *kinds)}
        return cls(asdict(options), dict(sorted(read.items())))

    @classmethod
    def of_table(cls, path: str | os.PathLike[str]) -> Self:
        """Read the list from a table; raises DocumentError if the file is no table of a fleet, or has no list."""
        needs_arrow()
        from pyarrow import parquet

        with reading_table(path):
            metadata = parquet.read_metadata(path).metadata or {}
        if metadata.get(SIGN) != VERSION.encode() or FILES not in metadata:
            raise DocumentError(
                f"{path} has no list of the files that it was made from: only a table of `flinders fleet` can be "
                "extended; begin it again",
                hint={"force": True},
            )
        return cls.loads(metadata[FILES])

    @classmethod
    def loads(cls, text: bytes) -> Self:
        """Read a list from the text that `dumps` has made."""
        table = needs_arrow().ipc.open_stream(base64.b64decode(text)).read_all()
        name, *state = (column.to_pylist() for column in table.columns)
        files = dict(zip(name, zip(*state, strict=True), strict=True))
        return cls(json.loads(table.schema.metadata[OPTIONS]), files, zlib.crc32(text))

    def dumps(self) -> bytes:
        """Text for the footer of a table: a compressed Arrow stream in base 64."""
        arrow = needs_arrow()
        size, stamp, kind = zip(*self.files.values(), strict=True) if self.files else ((), (), ())
        texts = (strings(arrow, cells) for cells in (list(self.files), stamp, kind))
        name_column, stamp_column, kind_column = texts
        columns = [name_column, integers(arrow, np.array(size)), stamp_column, kind_column]
        names = ("name", "size", "stamp", "kind")
        schema = arrow.schema([(name, column.type) for name, column in zip(names, columns, strict=True)])
        schema = schema.with_metadata({OPTIONS: json.dumps(dict(self.options), sort_keys=True)})
        sink = arrow.BufferOutputStream()
        compressed = arrow.ipc.IpcWriteOptions(compression="zstd")
        with arrow.ipc.new_stream(sink, schema, options=compressed) as writer:
            writer.write_table(arrow.Table.from_arrays(columns, schema=schema))
        return base64.b64encode(sink.getvalue())

    def refuse_other_options(self, options: Options, out: str) -> None:
        """Refuse to extend a table with other options of reading or judging: raises UsageError."""
        other = {name: value for name, value in asdict(options).items() if self.options.get(name) != value}
        if other:
            name, value = next(iter(other.items()))
            raise UsageError(
                f"{out} was made with other options ({name} was {self.options.get(name)}, and is {value} now): use "
                "the same options, or begin the table again",
                hint={"force": True},
            )

    def find_changes(self, files: Sequence[StoredFile]) -> tuple[list[StoredFile], dict[str, FlindersError]]:
        """New files, and an error for each file that has changed or is gone, by name."""
        new, faults = [], dict[str, FlindersError]()
        for each in files:
            known = self.files.get(each.name)
            if known is None:
                new.append(each)
            elif known[0] != each.size or known[1] != each.stamp:
                if known[2]:
                    new.append(each)
                else:
                    faults[each.name] = ChangedFile(each.name, known[0], each.size)
        if len(files) - len(new) < len(self.files):  # otherwise all earlier files are present
            present = {each.name for each in files}
            gone = (name for name, state in self.files.items() if name not in present and not state[2])
            faults |= {name: VanishedFile(name) for name in gone}
        return new, dict(sorted(faults.items()))

    @property
    def recordings(self) -> list[str]:
        """Names of the files that were fitted."""
        return [name for name, (_, _, kind) in self.files.items() if not kind]

    def other_files(self, files: Sequence[StoredFile]) -> list[str]:
        """Kinds of those `files` that an earlier run found to be no recordings."""
        kinds = {name: kind for name, (_, _, kind) in self.files.items() if kind}
        return [kinds[each.name] for each in files if each.name in kinds] if kinds else []

    def __add__(self, later: ReadFiles) -> ReadFiles:
        """Add the files of a later run."""
        files = {**self.files, **later.files}
        return replace(self, files={name: files[name] for name in sorted(files)})


def fault_rows(faults: Mapping[str, FlindersError]) -> UnitResults:
    """A row for each file that has changed or is gone; its unit is the name of the file in parentheses."""
    return UnitResults.of([UnitResult(unit=f"({name})").with_error(error) for name, error in faults.items()]).sorted()
