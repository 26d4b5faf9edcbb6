"""Harmonics of a heading up to the second, in which the deviation of a level compass is expanded."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flinders.arrays import to_floats

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from flinders.arrays import Floats


def design(compass_deg: ArrayLike) -> Floats:
    """(..., 5) rows 1, sin ζ, cos ζ, sin 2ζ, cos 2ζ of headings ζ in degrees."""
    angle = np.deg2rad(to_floats(compass_deg, "compass_deg"))
    return np.stack(
        [np.ones_like(angle), np.sin(angle), np.cos(angle), np.sin(2.0 * angle), np.cos(2.0 * angle)], axis=-1
    )
