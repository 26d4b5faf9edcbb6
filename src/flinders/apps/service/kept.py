"""File that is rewritten periodically: a failure is reported once, and writing is retried.

>>> def full():
...     raise OutputError("state.json: cannot be written: No space left on device")
>>> file = RetriedFile("state.json", print)
>>> _ = file.write(full)
! state.json: cannot be written: No space left on device. Will retry
>>> file.write(full), file.write(lambda: None)
state.json: is written again
(False, True)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Callable


class RetriedFile:
    """A file that is replaced as a whole at each write.

    Attributes
    ----------
    failure : OutputError or None
        Error of the last write; None after a success.
    """

    def __init__(self, name: str, say: Callable[[str], object]) -> None:
        self.name = name
        self._say = say
        self.failure: OutputError | None = None

    def write(self, write: Callable[[], object]) -> bool:
        """Write the file; returns False if that fails."""
        try:
            write()
        except OutputError as error:
            if self.failure is None:
                self._say(f"! {error.message}. Will retry")
            self.failure = error
            return False
        if self.failure is not None:
            self.failure = None
            self._say(f"{self.name}: is written again")
        return True
