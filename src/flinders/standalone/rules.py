"""The numbers that a live session decides by, for the page that has its session itself.

>>> session_rules()["enough_fits"]
3
"""

from __future__ import annotations

from flinders.core.geomag import ASSUMED_DIP_DEG
from flinders.live import buffer, messages, page_state, session


def session_rules() -> dict[str, float]:
    """The constants of `flinders.live` under the names that `static/standalone/session.js` has for them."""
    return {
        "capacity": buffer.CAPACITY,
        "shown": buffer.SHOWN,
        "frame_points": page_state.FRAME_POINTS,
        "fitted": session.FITTED,
        "share": session.SHARE,
        "fastest_s": session.FASTEST_S,
        "rate_s": session.RATE_S,
        "enough_fits": session.ENOUGH_FITS,
        "sure_s": session.SURE_S,
        "whole": session.WHOLE,
        "settled_s": session.SETTLED_S,
        "lasting_s": session.LASTING_S,
        "silent_s": page_state.SILENT_S,
        "silent_steps": page_state.SILENT_STEPS,
        "level_deg": page_state.LEVEL_DEG,
        "assumed_dip_deg": ASSUMED_DIP_DEG,
        "largest_dip_deg": messages.LARGEST_DIP_DEG,
    }
