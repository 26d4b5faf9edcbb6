"""A file that is written again and again: a full disk is said once, and tried again.

>>> def full():
...     raise OutputError("state.json: cannot be written: No space left on device")
>>> file = Kept("state.json", print)
>>> _ = file.write(full)
! state.json: cannot be written: No space left on device. It is tried again
>>> file.write(full), file.write(lambda: None)
state.json: is written again
(False, True)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Callable


class Kept:
    """A file that is replaced whole.

    Attributes
    ----------
    failure : OutputError or None
        Why it cannot be written now.
    """

    def __init__(self, name: str, say: Callable[[str], object]) -> None:
        self.name = name
        self._say = say
        self.failure: OutputError | None = None

    def write(self, write: Callable[[], object]) -> bool:
        """Write it; False where that is impossible now."""
        try:
            write()
        except OutputError as error:
            if self.failure is None:
                self._say(f"! {error.message}. It is tried again")
            self.failure = error
            return False
        if self.failure is not None:
            self.failure = None
            self._say(f"{self.name}: is written again")
        return True
