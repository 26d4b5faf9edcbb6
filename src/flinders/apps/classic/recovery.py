"""A simulated swing of a two-axis compass: parameters that the recipe finds, compared with the truth.

>>> from flinders.apps.classic.simulate_two_axis import TwoAxis
>>> recovery = recover(TwoAxis((1.2, 0.9), (12.0, -8.0), skew_deg=5.0, noise=0.25), seed=1)
>>> recovery.verdict, round(recovery.estimate.skew_deg, 1)
('limited', 4.8)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.apps.classic.simulate_two_axis import Polar, TwoAxis, swing
from flinders.fitting.calibrate import fit
from flinders.fitting.result import Refused
from flinders.geometry.plane import PlaneEllipse, Turn
from flinders.likelihood.site_field import Site

if TYPE_CHECKING:
    from flinders.fitting.result import Fit
    from flinders.simulate import Simulated


@dataclass(frozen=True, slots=True, eq=False)
class Recovery:
    """A swing of a simulated compass, and the calibration from that swing."""

    true: TwoAxis
    estimate: TwoAxis
    swung: Simulated  #: the recording
    polar: Polar  #: the recording around the compass rose, before and after correction
    fit: Fit  #: fit of the method ``level``, also a refused one
    turn: Turn  #: the points of the recording, and the ellipses through them: of mean and scatter, and of the fit
    refusal: Refused | None = None  #: reason why the calibration must not be used

    @property
    def verdict(self) -> str:
        """``limited``, the best verdict for a swing of two axes, or ``refused``."""
        return "limited" if self.refusal is None else "refused"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields: true and estimated parameters of the compass, the turn, and the verdict."""
        numbers = {
            "scale_x": (self.true.scale[0], self.estimate.scale[0]),  # gain of the axis
            "scale_y": (self.true.scale[1], self.estimate.scale[1]),  # gain of the axis
            "offset_x": (self.true.offset[0], self.estimate.offset[0]),  # hard iron along the axis
            "offset_y": (self.true.offset[1], self.estimate.offset[1]),  # hard iron along the axis
            "skew_deg": (self.true.skew_deg, self.estimate.skew_deg),  # angle by which the axes are not square
            "noise": (self.true.noise, self.estimate.noise),  # standard deviation of one axis of a reading
        }
        pairs = {name: {"true": true, "estimate": estimate} for name, (true, estimate) in numbers.items()}
        return {
            "verdict": self.verdict,
            "recovery": pairs,  # `true` value and `estimate` of each quantity of the compass
            "turn": self.turn.as_dict(),
            "polar": self.polar.as_dict(),
            "unit": "uT",  # of scales, offsets and noise
        }


def recover(
    compass: TwoAxis, *, seed: int = 0, points: int = 36, field_strength: float = 50.0, dip_deg: float = 60.0
) -> Recovery:
    """Swing a compass, calibrate it by the method ``level``, and convert the result to its parameters.

    Raises `FitError` if there is no calibration at all.
    """
    swung = swing(compass, seed=seed, points=points, field_strength=field_strength, dip_deg=dip_deg)
    refusal = None
    try:
        result = fit(swung.samples, method="level", site=Site(field_strength, dip_deg))
    except Refused as refused:
        result, refusal = refused.fit, refused
    calibration, dip = result.calibration, math.radians(dip_deg)
    shape = field_strength * np.linalg.inv(calibration.matrix)
    centre = calibration.offset[:2] + math.sin(dip) * shape[:2, 2]
    horizontal = field_strength * math.cos(dip)
    ellipse = PlaneEllipse(centre, math.cos(dip) * shape[:2, :2])
    estimate = TwoAxis.from_ellipse(centre, ellipse.shape, horizontal, noise=result.evidence.noise or 0.0)
    polar = Polar.of(swung, calibration.matrix, calibration.offset)
    turn = Turn.of("xy", swung.samples.field[:, :2], ellipse)
    return Recovery(compass, estimate, swung, polar, result, turn, refusal)
