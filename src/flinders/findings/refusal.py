"""Errors in place of a fit: words for the user of the compass, and remedies.

The message of an error names the rows, columns and options of one recording, and its remedy. The page in plain words
and the report of a fleet, which shows one example of each error, use this table.

>>> REFUSALS["unmoved"].remedy
'Turn it slowly through all directions while recording.'
"""

from __future__ import annotations

from typing import Final, NamedTuple


class Refusal(NamedTuple):
    """An error in place of a fit."""

    action: str  # action if many units have it
    plain: str = ""  # meaning without mathematics; empty for errors of files and options
    remedy: str = ""  # remedy


REFUSALS: Final[dict[str, Refusal]] = {
    "too-few-samples": Refusal(
        "record for longer, turning all the time",
        "The number of usable readings is {found:,}, and at least {needed:,} are needed.",
        "Record for longer, while turning the sensor through all directions.",
    ),
    "stuck-axis": Refusal(
        "check the sensor and its wiring: an axis never changes",
        "Some of the sensor's axes never change.",
        "Check the wiring and the columns that are read, and turn the sensor about all three of its axes.",
    ),
    "unmoved": Refusal(
        "turn the sensor while recording",
        "The sensor was hardly turned: all readings lie about one direction.",
        "Turn it slowly through all directions while recording.",
    ),
    "not-turned": Refusal(
        "turn the sensor while recording, or give the calibration that the disturbances belong to",
        "The sensor was held still while what disturbs it changed.",
        "Give the calibration that this belongs to, or turn the sensor while recording.",
    ),
    "follows-attitude": Refusal(
        "change what the column measures in each attitude, or leave the column out",
        "One of the columns that the compass was to follow only changes with the way it is turned.",
        "Change it in each position, not in step with the turning, or leave that column out.",
    ),
    "out-of-scale": Refusal(
        "check the unit and the columns",
        "The readings are larger or smaller than those of any magnetometer.",
        "Check which columns are read, and the unit.",
    ),
    "not-an-ellipsoid": Refusal(
        "turn the sensor upside down and onto each of its sides",
        "The readings cover too few directions to tell what they would be in the others.",
        "Turn the sensor upside down and onto each of its sides.",
    ),
    "undetermined": Refusal(
        "turn the sensor about more of its axes",
        "The sensor was turned in too few ways. For {unseen} of the 9 numbers of the correction the recording tells "
        "nothing.",
        "Turn the sensor about all three of its axes.",
    ),
    "missing-pose": Refusal(
        "put the device down on the side that is named, too",
        "The poses leave offsets or gains of the accelerometer open.",
        "Put the device down on each of its six sides.",
    ),
    "constant-strength": Refusal(
        "",
        "The field has nearly one and the same strength at all readings. The method that was asked for needs one that "
        "varies.",
        "Use another method.",
    ),
    "wrong-strength": Refusal(
        "check the column of the field's strength, or take it out",
        "The strength of the field that the recording tells beside its readings cannot be right.",
        "Check where that column comes from, or take it out.",
    ),
    "collapsed": Refusal(
        "",
        "The method that was asked for finds no correction near these readings.",
        "Use another method, or turn the sensor onto all of its sides.",
    ),
    "refused": Refusal("record again, and turn the sensor as the message says"),
    "unreadable": Refusal("check whether the file is whole, and of a kind that is read"),
    "document": Refusal("check whether the file is whole"),
    "no-magnetometer": Refusal("name the columns of the magnetometer"),
    "no-unit": Refusal("say in the table whose readings they are"),
    "unit": Refusal("give all files of a unit in one unit of field"),
    "axes": Refusal("check how the axes are mapped"),
    "usage": Refusal("check the options that say how files are read"),
    "foreign-axes": Refusal("check which sensor the columns belong to"),
    "missing-extra": Refusal("install what the message names"),
    "changed-file": Refusal("give the new recording a name of its own: the row is of what the file was"),
    "vanished-file": Refusal("look where the file went: its calibration stays"),
    "lost-worker": Refusal("fit it by itself with flinders calibrate, and look at the memory of the machine"),
    "internal": Refusal("report it: this is a fault in Flinders"),
}
"""Refusals by the code of the error."""
