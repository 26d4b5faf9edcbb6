"""A sensor on a wire: recorded, calibrated on a page while it is turned, or on a page that needs no program.

For whoever holds a board or a phone, and for programs with a display of their own.

- `hub`: holds readings of a feed, such as that of `flinders.links.recorder`, in a `buffer` and passes them to pages
- `messages`: their format; `simulated`: a feed of its own
- `server`: routes; `access`: who may look; `transfers`: uploads and downloads
- `session_file`: a recording with what a person did; `finished`: the calibration of all that it holds
- `guided`: a session for programs with a display of their own
- ``station``: units of a production line, one after the other
- ``standalone``: writes the page that needs no program; ``cli``: commands

The page has the session, in JavaScript (``static/standalone/session.js``).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flinders.core.lazy import attributes

if TYPE_CHECKING:
    from flinders.apps.live.guided import Session as Session
    from flinders.apps.live.station.gauge import gauge_study as gauge_study

PUBLIC = {"Session": "guided", "gauge_study": "station.gauge"}

if not TYPE_CHECKING:
    __getattr__ = attributes(__name__, PUBLIC)
