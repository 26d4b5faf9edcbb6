"""Errors in place of a fit: words for the user of the compass, and remedies.

The message of an error names the rows, columns and options of one recording, and its remedy. This table has the general
words instead: for the page in plain words, and for fleets, whose report shows one example of each error.

>>> REFUSALS["unmoved"].remedy
'Turn the sensor slowly through all directions while recording.'
"""

from __future__ import annotations

from typing import Final, NamedTuple


class Refusal(NamedTuple):
    """An error in place of a fit."""

    action: str  # action if many units have this error
    plain: str = ""  # meaning without mathematics; empty for errors of files and options
    remedy: str = ""  # remedy for the user of the compass; empty for errors of files and options
    meaning: str = ""  # meaning of an error of files, options or outputs, which has no plain words


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
        "One of the columns that were named changes only with the attitude of the compass.",
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
    "refused": Refusal(
        "record again, and turn the sensor as the message says",
        meaning="The recording was fitted, but the verdict is refused: the calibration must not be used.",
    ),
    "unreadable": Refusal(
        "check whether the file is whole, and of a kind that is read",
        meaning="A file cannot be opened, or its content cannot be read.",
    ),
    "document": Refusal(
        "check whether the file is whole", meaning="A file is not a valid calibration file of the expected kind."
    ),
    "no-magnetometer": Refusal(
        "name the columns of the magnetometer",
        meaning="The recording can be read, but no magnetometer was recognised in it.",
    ),
    "no-accelerometer": Refusal(
        "name the columns of the accelerometer",
        meaning=(
            "The recording can be read, but no accelerometer was recognised in it. The correction of tilt needs one."
        ),
    ),
    "no-onboard": Refusal(
        "give a log that contains the calibration on board, or give the calibration as a file",
        meaning="The log does not contain the calibration that was in force on board.",
    ),
    "no-unit": Refusal(
        "name the unit of each reading in the table",
        meaning="Some readings of a fleet's table name no unit, so that they belong to no sensor.",
    ),
    "unit": Refusal(
        "give all files of a unit in one unit of field",
        meaning="A unit of the field is not known, or two units contradict each other.",
    ),
    "axes": Refusal(
        "check how the axes are mapped",
        meaning="An axes mapping does not name x, y and z once each, or it contradicts the axes of another file.",
    ),
    "usage": Refusal("check the options that the message names", meaning="An option or an argument cannot be used."),
    "unknown-parameter": Refusal(
        "check the spelling of the keyword", meaning="A function of Python was given a keyword that it does not have."
    ),
    "input": Refusal("check what the message names", meaning="An input cannot be used."),
    "array": Refusal(
        "check the shape of the array, and leave out rows that are not finite",
        meaning="An array has the wrong shape or kind, or values that are not finite.",
    ),
    "foreign-axes": Refusal(
        "check which sensor the columns belong to", meaning="Accelerometer and magnetometer have different axes."
    ),
    "missing-extra": Refusal(
        "install what the message names", meaning="A format or a port needs an optional package that is not installed."
    ),
    "link": Refusal(
        "check the cable, the name of the port or the address, and that the device is on",
        meaning="A port, a sensor or a vehicle does not exist, does not answer, or was disconnected.",
    ),
    "fit": Refusal("record again as the message says", meaning="The recording gives no calibration."),
    "not-validated": Refusal(
        "choose a method that does not need all readings, or record for longer",
        meaning="The method cannot be cross-validated on this recording.",
    ),
    "no-calibration": Refusal(
        "choose another unit or date", meaning="The table of the fleet has no calibration of this unit at that date."
    ),
    "needs-samples": Refusal(
        "give the readings, or choose a method that needs only their sums",
        meaning="The method needs each reading, and only sums of the readings were given.",
    ),
    "needs-recording": Refusal(
        "give the recording too", meaning="A calibration file contains no readings, and the operation needs readings."
    ),
    "not-merged": Refusal(
        "merge only calibrations that were made in the same state of the vehicle",
        meaning="The calibrations contradict each other, and were not merged.",
    ),
    "not-exportable": Refusal(
        "choose another target, or calibrate as the message says",
        meaning="The target cannot store this calibration without a loss.",
    ),
    "not-sent": Refusal(
        "do what the message says, and send again",
        meaning="The vehicle must not receive these values now. Nothing was changed on it.",
    ),
    "not-confirmed": Refusal(
        "check the values that the message states, and send again",
        meaning="Values were sent, and the receiver did not confirm them.",
    ),
    "output": Refusal("check the place that the message names", meaning="A result cannot be written."),
    "output-exists": Refusal(
        "give another name, or overwrite the file",
        meaning="A file with this name exists and would be overwritten.",
    ),
    "changed-file": Refusal(
        "give the new recording a name of its own: the row is that of the earlier content",
        meaning="A file of the fleet changed after its calibration. The row is that of the earlier content.",
    ),
    "vanished-file": Refusal(
        "look where the file went: its calibration stays", meaning="A file of the fleet is missing now."
    ),
    "lost-worker": Refusal(
        "fit it by itself with flinders calibrate, and look at the memory of the machine",
        meaning="Each process that read this file of the fleet ended unexpectedly.",
    ),
    "plugin": Refusal(
        "update the package that the message names, or uninstall it",
        meaning="An installed package that adds readers or targets to Flinders is broken.",
    ),
    "no-engine": Refusal(
        "install what the message names",
        meaning="The engine of Flinders is not compiled for this machine, and cannot be compiled here.",
    ),
    "internal": Refusal(
        "report it: this is a fault in Flinders", meaning="Flinders itself failed, whatever the recording."
    ),
}
"""Refusals by the code of the error."""
