r"""The row of a reader: what it is called, which files it takes, how it opens them.

>>> row = Reader("ulog", "PX4 ULog", (".ulg",), starts=(b"ULog\x01\x12\x35",))
>>> row.accepts(b"ULog\x01\x12\x35\x01"), row.accepts(b"x,y,z\n")
(True, False)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.core.axes import Axes
    from flinders.core.samples import Recording
    from flinders.readers._log import Choice, Log
    from flinders.readers._source import File, Progress


class Open(Protocol):
    """How a reader opens a file: it recognises at once, and reads when asked."""

    def __call__(
        self,
        file: File,
        /,
        *,
        columns: str | None,
        unit: str | None,
        scale: float | None,
        axes: Axes,
        flat: str | None,
        choice: Choice,
        progress: Progress | None,
    ) -> Recording:
        """As `open_recording`."""


@dataclass(frozen=True, slots=True)
class Reader:
    """One row of the table of formats.

    Attributes
    ----------
    name : str
        In one word.
    title : str
        For people.
    suffixes : tuple of str
        Endings that such files usually have; the content decides.
    starts : tuple of bytes
        First bytes of such files, unpacked.
    sniff : callable, optional
        Tells from the first bytes whether this reader should try, where their start is not enough.
    open : callable, optional
        Opens a table that `sniff` accepted: a magnetometer in columns, or one of several.
    log : callable, optional
        Or opens a log: several instruments, which know their units.
    extra : str
        The optional dependency it needs, or nothing.
    takes_topic : bool
        Of a table: it has several, and takes the name of one.
    takes_unit : bool
        Of a log: it may hold readings whose unit it does not know, and takes one.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    starts: tuple[bytes, ...] = ()
    sniff: Callable[[bytes], bool] | None = None
    open: Open | None = None
    log: Callable[..., Log] | None = None
    extra: str = ""
    takes_topic: bool = False
    takes_unit: bool = False

    def accepts(self, head: bytes) -> bool:
        """Tell whether this reader should try a file with these first bytes."""
        return head.startswith(self.starts) if self.sniff is None else self.sniff(head)
