"""Compass swings of boats and aircraft: logs of their instruments, the deviation of a compass, rules, certificates.

A swing, as a table or a log under way, gives coefficients A to E and a deviation card.

- `compass_swing`: the use cases, from a table, a boat's log or a recording to a `swing_result` with its verdict
- `deviation`, `legs`, `compensation`, `standards`: coefficients, straight legs, correctors, rules
- `swing_table`, `swing_recording`: tables of headings, and recordings with rests
- `compass_log`, with `nmea0183`, `nmea2000` and `signalk`: logs of a boat
- `swing_notes`, `swing_words`, `swing_pages`, `certificate`: results of a swing on the terminal and on paper
- ``cli``: the command
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.core.lazy import lazy_getattr

if TYPE_CHECKING:
    from flinders.apps.marine.compass_log import CompassLog as CompassLog
    from flinders.apps.marine.compass_log import read_compass_log as read_compass_log
    from flinders.apps.marine.compass_swing import compensate as compensate
    from flinders.apps.marine.compass_swing import swing as swing
    from flinders.apps.marine.compensation import Compensation as Compensation
    from flinders.apps.marine.deviation import Deviation as Deviation
    from flinders.apps.marine.standards import STANDARDS as STANDARDS
    from flinders.apps.marine.swing_recording import SwingRecording as SwingRecording
    from flinders.apps.marine.swing_recording import read_rests as read_rests
    from flinders.apps.marine.swing_result import Swing as Swing
    from flinders.apps.marine.swing_table import SwingTable as SwingTable
    from flinders.apps.marine.swing_table import read_swing as read_swing

PUBLIC = {
    "STANDARDS": "standards",
    "Compensation": "compensation",
    "CompassLog": "compass_log",
    "Deviation": "deviation",
    "Swing": "swing_result",
    "SwingRecording": "swing_recording",
    "SwingTable": "swing_table",
    "compensate": "compass_swing",
    "read_compass_log": "compass_log",
    "read_rests": "swing_recording",
    "read_swing": "swing_table",
    "swing": "compass_swing",
}

if not TYPE_CHECKING:
    __getattr__ = lazy_getattr(__name__, PUBLIC)
