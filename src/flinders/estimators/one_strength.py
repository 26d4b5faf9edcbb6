"""Scaling of a recording in a field of varying strength to the mean strength."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from flinders.core.joining import join_recordings
from flinders.core.samples import RecordingWrapper, Samples
from flinders.summary.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.core.samples import Recording
    from flinders.estimators.base import Estimate
    from flinders.estimators.data import Readings


@dataclass(frozen=True, slots=True, eq=False)
class AtOneStrength(RecordingWrapper):
    """A recording scaled to the mean strength H of the field: readings become x₀ + (x − x₀) H/H_k.

    H_k is the strength of the field at a reading and x₀ the centre. The scaled readings lie on one ellipsoid; their
    noise is larger where the field is weak.
    """

    recording: Recording
    centre: Floats  # (3,): x₀
    mean: float  # H, in the unit of the strengths

    def blocks(self) -> Iterator[Samples]:
        """Yield scaled blocks, without readings of unknown strength."""
        for block in self.recording.blocks():
            if block.strength is not None:
                known = block[np.isfinite(block.strength)]
                ratio = (self.mean / np.asarray(known.strength))[:, np.newaxis]
                yield replace(known, field=self.centre + (known.field - self.centre) * ratio, strength=None)


def scale_to_one_strength(readings: Readings, estimate: Estimate) -> Readings:
    """Scale readings to the mean strength if an estimate follows a varying strength; else return them unchanged.

    Statistics of quality, such as repeats and rails, stay those of the unscaled recording.
    """
    if estimate.follows != "varying" or readings.recording is None or estimate.strength is None:
        return readings
    centre, mean = estimate.ellipsoid.centre, estimate.strength
    parts = [
        AtOneStrength(part.recording, centre, mean) for part in readings.single_recordings if part.recording is not None
    ]
    alike = type(readings).of(join_recordings(parts))
    return replace(alike, summary=Summary(alike.summary.moments, alike.summary.cloud, readings.summary.health))
