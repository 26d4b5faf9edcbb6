"""Errors in place of a fit: words for the user of the compass, and remedies.

The message of an error names the rows, columns and options of one recording, and its remedy. The page in plain words
and the report of a fleet, which shows one example of each error, use this table.

>>> REFUSALS["unmoved"].remedy
'Turn the sensor slowly through all directions while recording.'
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
        "Turn the sensor slowly through all directions while recording.",
    ),
    "not-turned": Refusal(
        "turn the sensor while recording, or give the calibration that the disturbances belong to",
        "The sensor was at rest while the disturbances changed.",
        "Give the calibration to which the disturbances belong, or turn the sensor while recording.",
    ),
    "follows-attitude": Refusal(
        "change the quantity of the column in each attitude, or leave the column out",
        "One of the columns that the compass was to follow changes only with its attitude.",
        "Change that quantity in each position, not in step with the turning, or leave that column out.",
    ),
    "out-of-scale": Refusal(
        "check the unit and the columns",
        "The readings are larger or smaller than those of any magnetometer.",
        "Check which columns are read, and the unit.",
    ),
    "not-an-ellipsoid": Refusal(
        "turn the sensor upside down and onto each of its sides",
        "The readings cover too few directions to determine an ellipsoid.",
        "Turn the sensor upside down and onto each of its sides.",
    ),
    "undetermined": Refusal(
        "turn the sensor about more of its axes",
        "The sensor was turned about too few axes. The recording does not determine {unseen} of the 9 numbers of the "
        "correction.",
        "Turn the sensor about all three of its axes.",
    ),
    "missing-pose": Refusal(
        "put the device down also on the side that the message names",
        "The poses do not determine all offsets and gains of the accelerometer.",
        "Put the device down on each of its six sides.",
    ),
    "constant-strength": Refusal(
        "",
        "The field has nearly the same strength at all readings. The chosen method needs a field whose strength "
        "varies.",
        "Use another method.",
    ),
    "wrong-strength": Refusal(
        "check the column of the field's strength, or remove the column",
        "The strength of the field in the recording is impossible for its readings.",
        "Check the source of that column, or remove the column.",
    ),
    "collapsed": Refusal(
        "",
        "The chosen method finds no correction near these readings.",
        "Use another method, or turn the sensor onto all of its sides.",
    ),
    "refused": Refusal("record again, and turn the sensor as the message says"),
    "unreadable": Refusal("check whether the file is whole, and of a kind that is read"),
    "document": Refusal("check whether the file is whole"),
    "no-magnetometer": Refusal("name the columns of the magnetometer"),
    "no-unit": Refusal("name the unit of each reading in the table"),
    "unit": Refusal("give all files of a unit in one unit of field"),
    "axes": Refusal("check how the axes are mapped"),
    "usage": Refusal("check the options for reading files"),
    "foreign-axes": Refusal("check which sensor the columns belong to"),
    "missing-extra": Refusal("install what the message names"),
    "changed-file": Refusal("give the new recording a name of its own: the row is of what the file was"),
    "vanished-file": Refusal("look where the file went: its calibration stays"),
    "lost-worker": Refusal("fit it by itself with flinders calibrate, and look at the memory of the machine"),
    "internal": Refusal("report it: this is a fault in Flinders"),
}
"""Refusals by the code of the error."""
