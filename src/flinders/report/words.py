"""What is found about a recording in plain words, without a word that only those know who fit ellipsoids.

>>> REFUSALS["unmoved"].remedy
'Turn it slowly through all directions while recording.'
"""

from __future__ import annotations

from typing import Final, NamedTuple


class Words(NamedTuple):
    """What was found, and what to do about it, if there is anything."""

    said: str
    remedy: str = ""


REFUSALS: Final = {
    "too-few-samples": Words(
        "The number of usable readings is {found:,}, and at least {needed:,} are needed.",
        "Record for longer, while turning the sensor through all directions.",
    ),
    "stuck-axis": Words(
        "Some of the sensor's axes never change.",
        "Check the wiring and the columns that are read, and turn the sensor about all three of its axes.",
    ),
    "unmoved": Words(
        "The sensor was hardly turned: all readings lie within {angle_deg:.2g}° of one direction.",
        "Turn it slowly through all directions while recording.",
    ),
    "not-turned": Words(
        "The sensor was held still while what disturbs it changed.",
        "Give the calibration that this belongs to, or turn the sensor while recording.",
    ),
    "out-of-scale": Words(
        "The readings are larger or smaller than those of any magnetometer.",
        "Check which columns are read, and the unit.",
    ),
    "not-an-ellipsoid": Words(
        "The readings cover too few directions to tell what they would be in the others.",
        "Turn the sensor upside down and onto each of its sides.",
    ),
    "undetermined": Words(
        "The sensor was turned in too few ways. For {unseen} of the 9 numbers of the correction the recording tells "
        "nothing.",
        "Turn the sensor about all three of its axes.",
    ),
    "constant-strength": Words(
        "The field has nearly one and the same strength at all readings. The method that was asked for needs one that "
        "varies.",
        "Use another method.",
    ),
    "wrong-strength": Words(
        "The strength of the field that the recording tells beside its readings cannot be right.",
        "Check where that column comes from, or take it out.",
    ),
    "collapsed": Words(
        "The method that was asked for finds no correction near these readings.",
        "Use another method, or turn the sensor onto all of its sides.",
    ),
}
"""Each refusal that has no fit in plain words, and what to do about it."""
