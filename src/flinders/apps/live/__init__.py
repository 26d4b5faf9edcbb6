"""Live calibration of a sensor: records its readings, and shows the calibration on a page in the browser.

For users with a board or a phone, and for programs with their own display.

- `hub`: stores readings of a feed, such as that of `flinders.links.recorder`, in a `buffer` and passes them to pages
- `messages`: format of the messages between hub and page; `simulated`: feed of a simulated sensor
- `server`: routes; `access`: address and access control; `transfers`: uploads and downloads
- `session_file`: a recording with the user's edits; `finished`: the calibration of all its readings
- `guided`: a session for programs with their own display
- ``station``: tests of units of a production line
- ``standalone``: writes the page that needs no program; ``cli``: commands

The page has the session, in JavaScript (``static/standalone/session.js``).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.core.lazy import lazy_getattr

if TYPE_CHECKING:
    from flinders.apps.live.guided import Session as Session
    from flinders.apps.live.station.gauge import gauge_study as gauge_study

PUBLIC = {"Session": "guided", "gauge_study": "station.gauge"}

if not TYPE_CHECKING:
    __getattr__ = lazy_getattr(__name__, PUBLIC)
