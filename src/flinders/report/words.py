"""What is found about a recording in plain words, without a word that only those know who fit ellipsoids.

>>> FINDINGS["heading-error"].said.format(angle="2.1°", limit=1.0)
'At the worst heading the compass may be off by 2.1°, and 1° is the target.'
"""

from __future__ import annotations

from typing import Final, NamedTuple


class Words(NamedTuple):
    """What was found, and what to do about it, if there is anything."""

    said: str
    remedy: str = ""


MOVE: Final = "{remedy}"
"""Stands for what would make the heading error smaller, which depends on the fit."""

FINDINGS: Final = {
    "one-plane": Words(
        "All readings lie in one plane, as when a sensor is turned on a table. They tell nothing about any other "
        "attitude.",
        "Turn the sensor onto its sides and upside down too.",
    ),
    "level-plane": Words(
        "The sensor was turned level only. The correction is for a vehicle that stays level.",
        "For all attitudes, turn the sensor onto its sides and upside down too while recording.",
    ),
    "heading-error": Words(
        "At the worst heading the compass may be off by {angle}, and {limit:g}° is the target.", MOVE
    ),
    "coverage": Words(
        "In a large part of all attitudes nothing was recorded, so nobody knows how good it is there.", MOVE
    ),
    "noise": Words(
        "After the best correction the strength of the field still varies by {number:.1%} as the sensor turns. That is "
        "more than a sensor does by itself: something moved, or a current flowed, or other columns were read.",
        "Record again away from iron and currents, with nothing magnetic moving near the sensor, and check that the "
        "right columns are read.",
    ),
    "rings": Words(
        "The sensor was turned in too few ways. For {number:.0f} of the 9 numbers of the correction the recording "
        "tells nothing, and the most likely value was taken.",
        "Turn the sensor about all three of its axes.",
    ),
    "prior": Words(
        "One of the 9 numbers of the correction rests to {number:.0%} on what is likely, and not on the recording.",
        MOVE,
    ),
    "bias": Words(
        "The method that was chosen costs {angle} of heading on average: it is too simple for this sensor, or not made "
        "for a recording like this.",
        "Calibrate again with the method auto, or of a level turn with the method ellipse.",
    ),
    "inflation": Words(
        "The readings lie on a small patch of what they should go round ({number:.1f} times as wide).", MOVE
    ),
    "recordings-differ": Words(
        "The recordings do not agree with each other: one is {angle} of heading off the others.",
        "Find out what changed from one recording to the next, and use those made in the state in which the compass "
        "will be used.",
    ),
    "field-changed": Words(
        "Something changed while the recording was made: from its beginning to its end, by {angle} of heading.",
        "Record again with currents and everything magnetic as they will be, and the sensor warm.",
    ),
    "slipped-axes": Words(
        "While this was recorded, an axis changed its sign, or two axes changed places.",
        "Find out what the driver of the sensor did then, and record again.",
    ),
    "structure": Words(
        "A part of the field, {number:.1%}, depends on the direction in a way that no correction of this kind takes "
        "off. The errors given here allow for it.",
    ),
    "few-samples": Words(
        "There is little to go by: the number of independent readings is only {number:.0f}.",
        "Record for longer, turning all the time.",
    ),
    "correlated": Words(
        "The readings err alike for moments at a time, so that they tell as much as {number:.0%} of them would. The "
        "errors given here allow for it.",
    ),
    "alternating": Words(
        "Every second reading is off to the other side, as where the readings of two sensors are mixed.",
        "Record one sensor alone.",
    ),
    "strays": Words(
        "Some readings do not belong to the rest ({number:.1%}) and were left out; they are listed below. Something "
        "magnetic passed by, a cable moved, or bits were lost on the way.",
        "Find out what happened at the times or rows listed below.",
    ),
    "saturated": Words(
        "The sensor was at the end of its range in {number:.1%} of the readings.",
        "Choose a larger range of the sensor, or move it away from magnets, and record again.",
    ),
    "stale-repeats": Words(
        "Of the readings, {number:.0%} only repeat the one before, because the log is faster than the sensor. They "
        "count once.",
    ),
    "time-back": Words(
        "The clock of the recording goes back (times it does: {number:.0f}).",
        "Check the order of the recordings, and the clock.",
    ),
    "time-gap": Words("Nothing was recorded for {seconds} s in one stretch."),
    "skipped-rows": Words(
        "Some lines could not be used (number of lines: {number:,.0f}); they are named below.",
        "Look at the lines that could not be used.",
    ),
    "typed-extremes": Words(
        "There was no recording, only the smallest and the largest reading of each axis. Nobody knows how good the "
        "correction is; if the sensor was not turned all the way, the compass may be off by {angle} or more.",
        "Check the compass on known bearings, and record the readings where that can be done.",
    ),
    "driver": Words(
        "The compass was made to follow what disturbs it. Without that, headings would be off by up to {angle}.",
        "Use the correction only where what it follows is measured as in the recording.",
    ),
    "driver-unfollowed": Words(
        "What was recorded beside the compass, such as the current of a motor, moves it by up to {angle} of heading. "
        "The calibration does not follow it.",
        "Let the calibration follow it, or record without it.",
    ),
    "driver-constant": Words(
        "Something that the compass was to follow hardly changed while the recording was made, so that nothing is "
        "known of what it does.",
        "Record again, and change it over its whole range while turning.",
    ),
    "driver-entangled": Words(
        "What the compass follows changed together with the way it was turned ({number:.0%} of it), so that one cannot "
        "be told from the other.",
        "Record again, and change it in each position, not in step with the turning.",
    ),
    "driver-alike": Words(
        "Several things that the compass follows rose and fell together, so that nobody knows which of them does what.",
        "Use the correction where they go along as in the recording, or record again and vary each by itself.",
    ),
    "driver-one-way": Words(
        "What the compass follows only went one way while the recording was made. A compass that changes by itself, or "
        "that was moved, would look the same.",
        "Record again, and let it go up and down again meanwhile.",
    ),
    "driver-noisy": Words(
        "What the compass follows is measured with so much noise that its effect was found up to {number:.0%} "
        "too small.",
        "Record a steadier value of it, or hold each setting for longer.",
    ),
    "driver-lag": Words(
        "The compass seems to follow what disturbs it with a delay of more than {limit:g} s. The clocks of the two "
        "columns differ, or something else disturbs the compass.",
        "Check the times of the column that is followed.",
    ),
    "driver-range": Words(
        "What the compass follows was recorded with values that cannot be, as far as {number:g}: in another unit, or "
        "with the other sign.",
        "Convert the column that is followed, or turn its sign round, before anything is exported.",
    ),
    "driver-reference": Words(
        "What the compass follows was never as low while recording as the correction takes for its starting point. "
        "There it is a guess along a straight line.",
        "Record with it switched off as well, or use the correction only where it was recorded.",
    ),
    "driver-curved": Words(
        "What disturbs the compass does not grow in proportion to what is followed: {number:.0%} of it is off a "
        "straight line.",
        "Record the current of the motors rather than their throttle, or use the correction where most was recorded.",
    ),
    "driver-beyond": Words(
        "What the compass follows went {number:.0%} of its range beyond what is known of it.",
        "Calibrate again over the whole range.",
    ),
    "bench-moved": Words(
        "The sensor that should be held still was moved.",
        "Fix the sensor, keep everything magnetic away, and record again.",
    ),
    "bench-tilted": Words(
        "The sensor that should be held still tilted by {angle} together with what disturbs it.",
        "Fix the sensor, and record again.",
    ),
    "driver-uncertain": Words(
        "At the far end of what the compass follows, headings may be off by {angle}.",
        "Record again, with more of it at that end, while turning through all directions.",
    ),
    "composed": Words(
        "The correction was put together from turns in one plane after the other. What they leave out costs a level "
        "heading {angle}, and nobody knows how good it is at other attitudes.",
        "Record the same turns without a correction, and calibrate from all of them together.",
    ),
    "filtered": Words(
        "The readings went through a filter, which moved the heading by {angle} at the worst.",
        "If the filter moved the heading by more than the error given here, calibrate again without it, or turn the "
        "sensor more slowly.",
    ),
    "axis-ratio": Words(
        "One axis of the sensor reads {number:.1f} times as much as another, which is unusual.",
        "Check the gains of the axes, and that the right columns are read.",
    ),
    "field-strength": Words(
        "The field that was found, {length}, is not one of the earth's. Headings do not depend on that.",
        "Check the unit of the recording.",
    ),
    "circular-attitude": Words(
        "The heading in the recorded attitude errs by {angle}, in step with the heading itself. It most likely came "
        "from this compass before it was corrected, and was not used.",
        "Take the attitude without its heading, or one that no compass has a part in.",
    ),
    "gyro-unit": Words(
        "The recorded turning rate does not go with the compass, unless it is in another unit. It was not used.",
        "Record the turning rate in radians a second.",
    ),
    "gyro-differs": Words(
        "The recorded turning rate does not go with the compass. It was not used.",
        "Check that the instrument is on the same body, is not at its limit, and is recorded as often as the compass.",
    ),
    "gyro-clipped": Words(
        "The gyro was at its limit in {number:.0%} of the recording, so it does not tell how the compass was turned. "
        "It was not used.",
        "Set the gyro to a wider range, or turn more slowly.",
    ),
    "gyro-scales": Words(
        "The gyro turns {number:.0%} too much or too little, which no sound gyro does. It was not used.",
        "Check the range that the gyro is set to, and that it is recorded often enough.",
    ),
    "gyro-gaps": Words(
        "In {number:.0%} of the recording the turning rate is missing, for a moment at a time. It was filled in.",
        "Record the turning rate as often as the compass.",
    ),
    "aids-disagree": Words(
        "Gyro and vertical do not go together. The vertical was not used.",
        "Leave the vertical out, as it leans in turns; or record while turning on the spot.",
    ),
    "aid-astray": Words(
        "What was recorded of how the body was held does not go with the compass. It was not used.",
        "Check in which direction the recorded attitude turns, its times, and that it is of the same body.",
    ),
    "aid-empty": Words(
        "Something that should have helped was recorded as empty. It was not used.",
        "Check what is recorded beside the compass.",
    ),
    "swapped-axes": Words(
        "The compass and the instrument beside it do not agree on which way is forward, right and down.",
        "Check how both are mounted, and the axes mapping.",
    ),
    "one-axis": Words(
        "Nearly all turning was about one axis. The turning rate says nothing of what disturbs the compass along it.",
        "Also turn the vehicle about another axis, a little to either side.",
    ),
    "site-differs": Words(
        "The field points down {number:.0f}° more or less steeply than it should at the place that was given.",
        "Check the place and the day, and whether there was iron near.",
    ),
    "departs": Words(
        "For a while the compass was up to {angle} of heading off the others of its vehicle: something magnetic was "
        "near it, or a current flowed. The correction does not rest on that.",
        "Find out what happened then, or steer by another compass.",
    ),
    "departs-throughout": Words(
        "The compass is {angle} of heading off the others of its vehicle all the time: something near it keeps "
        "changing, such as a current.",
        "Steer by another compass, or see whether a correction that follows the current helps.",
    ),
    "disagree": Words(
        "Compasses of the vehicle were {angle} of heading apart, and nobody can tell which of them was off.",
        "Compare them with a known bearing, or fit a third.",
    ),
    "copied-sensor": Words(
        "The readings are those of another sensor, turned and scaled. It is no second compass.",
        "Look at how the columns of the recording were written.",
    ),
    "mirrored-sensor": Words(
        "The axes of this sensor and those of another are mirror images of each other: one of the two has an axis "
        "turned over.",
        "Find out which of the two it is, and check its axes mapping.",
    ),
    "turned-to": Words(
        "Corrected readings are in the axes of another sensor of the vehicle, but for an uncertainty of {angle}.",
    ),
    "unlike-units": Words(
        "The readings are {number:.3g} times as long as those of another sensor of the vehicle: most likely they are "
        "in another unit.",
        "Name the unit of each sensor.",
    ),
    "clock-differs": Words(
        "The clock of this sensor is off that of another one by {seconds} s. That was allowed for.",
    ),
    "not-together": Words(
        "The sensor was corrected by itself: together with the others of the vehicle it would be known no better.",
        "Turn the vehicle about all of its axes, with all sensors running, and see whether their clocks agree.",
    ),
    "mirrored-axes": Words(
        "The axes were mapped to a mirror image, which is right only for a left-handed sensor.",
        "Check the axes mapping.",
    ),
    "unit-unknown": Words("The unit of the readings is not known: they are in counts. Headings do not depend on it."),
    "scale-unknown": Words(
        "The strength of the field at the place of recording was not given. The length of corrected readings, "
        "{length}, is therefore a convention. Headings do not depend on it.",
    ),
    "rotation-uncertain": Words(
        "How the compass sits in the vehicle was found only roughly: it adds {number:.1f}° to headings.",
        "Tilt the vehicle far about two axes while recording, or measure how the compass sits.",
    ),
    "rotation-unknown": Words(
        "How the sensor is turned against the vehicle cannot be seen by a magnetometer. A sensor that is mounted askew "
        "adds to the errors given here.",
        "Check by other means, such as a known bearing, how the sensor is mounted.",
    ),
}
"""Each finding in plain words, and what to do about it."""

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
    "needs-rate": Words(
        "The method that was asked for goes by how the body turned, and the recording has no {missing}.",
        "Record the gyro and the time beside the magnetometer, or use another method.",
    ),
    "one-axis-turned": Words(
        "The body turned about one axis alone.",
        "Roll or pitch as well while recording.",
    ),
    "collapsed": Words(
        "The method that was asked for finds no correction near these readings.",
        "Use another method, or turn the sensor onto all of its sides.",
    ),
}
"""Each refusal that has no fit in plain words, and what to do about it."""
