"""Notice of the chips that may have sent the counts of a sensor on a wire, given when the coverage is large enough.

The rule is that of `flinders info`. Nothing is applied: the notice states the options for a new start of the command.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flinders.core.samples import Samples
from flinders.core.units import COUNTS
from flinders.workflows.recording_contents import propose_chip_of

if TYPE_CHECKING:
    from flinders.apps.live.session_file import Log
    from flinders.errors import Hint

MIN_READINGS: Final = 300
"""Number of readings before the first attempt to find chips; it doubles before each further attempt."""


class ChipNotice:
    """Proposal of the chips that fit a session's counts, given once."""

    def __init__(self) -> None:
        """Begin without a proposal."""
        self._next_attempt = MIN_READINGS
        self._is_given = False

    def words(self, log: Log) -> str:
        """Return the proposal in words, the first time that there is one; empty before that and afterwards."""
        if self._is_given or log.unit.inside != COUNTS or log.buffer.total < self._next_attempt:
            return ""
        self._next_attempt = 2 * log.buffer.total
        proposal = propose_chip_of(Samples(field=log.buffer.field, unit=log.unit), spell_for_restart)
        if proposal is None:
            return ""
        self._is_given = True
        return f"{proposal.reason}; nothing is applied: give {proposal.advice}"


def spell_for_restart(hint: Hint) -> str:
    """Spell a hint as options of the command that is started anew.

    >>> spell_for_restart({"unit": "counts", "scale": 0.15}), spell_for_restart({"chip": None})
    ('--unit=counts --scale=0.15', '--chip')
    """
    return " ".join(f"--{keyword}{'' if value is None else f'={value}'}" for keyword, value in hint.items())
