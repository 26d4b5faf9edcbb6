"""Sends the calibration in force to its vehicle when that is safe, and saves the previous values.

>>> Handover.backup_time("compass-before-20260601T081540Z.param"), Handover.backup_time("notes.txt")
(1780301740.0, None)
"""

from __future__ import annotations

import math
import re
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from flinders.apps.service.clocks import duration
from flinders.core.files import write_text
from flinders.core.units import unit_label
from flinders.errors import FlindersError, figures

if TYPE_CHECKING:
    from collections.abc import Callable

    from flinders.core.calibration import Calibration
    from flinders.fitting.result import Fit
    from flinders.links.recipients import Recipient
    from flinders.workflows.online import OnlineCalibration

INTERVAL_S: Final = 3600.0
CHECK_PERIOD_S: Final = 5.0  # Period of checks
MAX_ERROR_RATIO: Final = 0.8
"""Largest heading error of a calibration to be sent, as a share of the error of the one on board."""
MAX_OFFSET_SIGMA: Final = 0.05
"""Largest σ of an offset along any axis, as a share of the field; beyond it, the calibration is not sent."""
NAME: Final = re.compile(r"compass-before-(\d{8}T\d{6})Z\.\w+")


class Handover:
    """Sends calibrations to a recipient.

    Parameters
    ----------
    recipient : Recipient
    folder : str
        Folder for previous values.
    interval_s : float
        Least time between two sendings, also after a failed one and across restarts.
    stopped, say : callable
        As for `Transfer.carry_out`.
    clock : callable
        Seconds from 1970.

    Attributes
    ----------
    failure : str
        Reason of the last failure; empty after a success.
    """

    def __init__(
        self,
        recipient: Recipient,
        folder: str,
        *,
        interval_s: float = INTERVAL_S,
        stopped: Callable[[], bool] = lambda: False,
        say: Callable[[str], None] = lambda _: None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._recipient, self._folder, self._interval_s = recipient, Path(folder), interval_s
        self._stopped, self._say, self._clock = stopped, say, clock
        times = [sent for path in self._folder.iterdir() if (sent := self.backup_time(path.name)) is not None]
        self._sent = max((sent for sent in times if sent <= clock()), default=-math.inf)
        self._looked, self._told = -math.inf, ""
        self.failure = ""

    @staticmethod
    def backup_time(name: str) -> float | None:
        """Time in the name of a file with previous values; None for other files."""
        found = NAME.fullmatch(name)
        return datetime.strptime(found[1] + "+0000", "%Y%m%dT%H%M%S%z").timestamp() if found else None

    def send_if_due(self, online: OnlineCalibration, time_s: float) -> tuple[str, str] | None:
        """Send a calibration if that is due; return an event and words on it, or None if nothing happened.

        The event is ``sent``, ``not-sent`` with the reason, or ``waits`` if the user has to act first.
        """
        now = self._clock()
        if abs(now - self._looked) < CHECK_PERIOD_S or (fit := online.fit) is None:
            return None
        self._looked = now
        calibration = fit.calibration
        if not self._is_better(online, calibration, time_s) or online.at(time_s).doing == "disturbed":
            return None
        if 0.0 <= now - self._sent < self._interval_s:
            return None
        if waits := self._waiting_reason(fit, is_level=online.is_level):
            is_new, self._told = waits != self._told, waits
            return ("waits", f"the calibration in force is not sent: {waits}") if is_new else None
        self._sent, self._told = now, ""
        return self._send(calibration, now)

    def _is_better(self, online: OnlineCalibration, calibration: Calibration, time_s: float) -> bool:
        """Whether a calibration is clearly better than the one on board or, if that is unknown, within the target."""
        state, on_board = online.at(time_s), self._recipient.on_board(calibration.field_strength)
        if on_board is None:
            return state.verdict == "good"
        return state.heading_error_deg < MAX_ERROR_RATIO * online.error_with_deg(on_board, time_s)

    def _waiting_reason(self, fit: Fit, *, is_level: bool) -> str:
        """Reason to wait before sending; empty without one."""
        if is_level:
            return "it is of a level vehicle, and its vertical axis is unknown; calibrate in all attitudes first"
        sigma = float(fit.claim.offset_sigma.max())
        if not sigma < MAX_OFFSET_SIGMA * fit.calibration.field_strength:
            unit = unit_label(fit.calibration.unit)
            return (
                f"its offset is off by up to {figures(sigma)} {unit} (1 σ) along one axis; turn about other axes, too"
            )
        refusal = self._recipient.refusal
        return f"{self._recipient.name}: {refusal}" if refusal else ""

    def _send(self, calibration: Calibration, now: float) -> tuple[str, str] | None:
        """Save the previous values, and send."""
        kept = ""
        try:
            transfer = self._recipient.transfer(calibration)
            if transfer.is_done:
                return None
            when = datetime.fromtimestamp(now, UTC)
            path = self._folder / f"compass-before-{when:%Y%m%dT%H%M%SZ}{transfer.suffix}"
            write_text(transfer.backup(), path)
            kept = f"; the previous values are in {path}"
            confirmed = transfer.carry_out(stopped=self._stopped, say=self._say)
        except FlindersError as error:
            self.failure = f"{error.message}{kept}"
            next_try = f"next try in {duration(self._interval_s)}"
            return "not-sent", f"the calibration was not sent: {self.failure}; {next_try}"
        self.failure = ""
        return "sent", f"the calibration was sent: {confirmed}{kept}"
