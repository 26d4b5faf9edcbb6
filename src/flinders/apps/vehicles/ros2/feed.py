"""A topic of ``sensor_msgs/MagneticField`` as a feed of readings, with an `Imu` topic if one is named.

Readings are in **tesla**, as the message defines, in the axes of the frame that its header names. Times are those of
the headers, counted from the first one; for a header without a time, that of publication. Acceleration and rate are
those of the `Imu` message of the same frame that is nearest in time.
"""

from __future__ import annotations

import time
from bisect import bisect
from collections import deque
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flinders.apps.vehicles.readers.ros import motion_of, vector_of
from flinders.apps.vehicles.ros2.names import IMU, MAGNETIC_FIELD, domain_id, full_name
from flinders.apps.vehicles.ros2.participant import MAX_TAKEN, Participant
from flinders.core.samples import Samples
from flinders.core.units import WIDE_EARTH_FIELD_RANGE_UT, Unit
from flinders.errors import count_text, figures
from flinders.links.feeds import FeedEvent

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flinders.arrays import Floats
    from flinders.links.feeds import Kind, Received

UNIT: Final = "T"
SECOND_NS: Final = 1_000_000_000
BATCH_S: Final = 0.03
"""Time in s within which arriving readings form one batch."""
SILENT_S: Final = 3.0  # Time without a reading after which advice is given
MIN_REPEATS: Final = 100
"""Number of equal readings in a row after which advice is given."""
MIN_REPEAT_S: Final = 3.0  # Shortest duration of equal readings after which advice is given
MIN_ADVICE_READINGS: Final = 20
"""Smallest number of readings for advice on their unit or on missing axes."""
MAX_MOTIONS: Final = 2000
"""Largest number of `Imu` messages that are kept for matching."""
MAX_APART_NS: Final = SECOND_NS // 10
"""Largest time difference of a reading and its `Imu` message, ns."""


class Reading(NamedTuple):
    """A message with a reading of the field, and its time."""

    at_ns: int  # time in ns, since 1970 or by the clock of the headers
    message: Any


class TopicFeed:
    """A `Feed` of the readings of a topic.

    Parameters
    ----------
    participant : Participant
    topic : str
        Topic of the readings, which has a publisher.
    imu_topic : str, optional
        Topic of ``sensor_msgs/Imu`` in the same frame.
    unit : str, optional
        Unit that the driver writes in place of tesla.

    Attributes
    ----------
    newest : list of Reading
        Readings of the newest `Samples`.
    """

    def __init__(
        self, participant: Participant, topic: str, imu_topic: str | None = None, unit: str | None = None
    ) -> None:
        from flinders.apps.vehicles.ros2.messages import Imu_, MagneticField_

        self.participant, self.topic = participant, full_name(topic)
        self.name = f"{self.topic} of ROS 2"
        self.target = "ros-pipeline"
        self.newest: list[Reading] = []
        self.unit = Unit.of(unit or UNIT)
        self._reader: Any = participant.reader(self.topic, MagneticField_)
        self._imu: Any = None if imu_topic is None else participant.reader(imu_topic, Imu_)
        self._waiting_for: Any = participant.waitset(self._reader)
        self._motions = _Motions()
        self._start = self._heard = time.monotonic()
        self._since_ns: int | None = None
        self._same, self._same_since, self._last = 0, 0.0, (np.nan,) * 3
        self._readings, self._unreported, self._lost = 0, 0, 0
        self._advised: set[str] = set()
        self._is_gone = self._is_over = self._was_matched = False
        beside = "" if imu_topic is None else f", with acceleration and rate of {full_name(imu_topic)}"
        words = f"{self.name} in domain {participant.domain}, in {self.unit.name}{beside}"
        self._waiting: deque[FeedEvent] = deque([FeedEvent("connected", 0.0, words)])

    def next(self, timeout: float) -> Received:
        """As `Feed.next`."""
        if self._waiting:
            return self._waiting.popleft()
        if self._is_over:
            time.sleep(timeout)
            return None
        self._waiting_for.wait(int(min(timeout, BATCH_S) * SECOND_NS))
        readings = [self._reading(message) for message in self._reader.take(MAX_TAKEN) if hasattr(message, "header")]
        if self._imu is not None and readings:
            self._motions.frame = str(readings[-1].message.header.frame_id)
            self._motions.add(self._imu.take(MAX_TAKEN))
        self._waiting.extend(self._events(readings))
        self.newest = [reading for reading in readings if np.isfinite(vector_of(reading.message.magnetic_field)).all()]
        return self._samples() if self.newest else None

    def close(self) -> None:
        """As `Feed.close`."""
        self._is_over = True
        self._waiting_for = self._reader = self._imu = None

    def _now(self) -> float:
        return time.monotonic() - self._start

    def _reading(self, message: Any) -> Reading:  # noqa: ANN401 - a message of Cyclone DDS
        return Reading(_stamp(message), message)

    def _samples(self) -> Samples:
        """Make `Samples` of the newest readings."""
        times = [reading.at_ns for reading in self.newest]
        self._since_ns = times[0] if self._since_ns is None else self._since_ns
        field = np.array([vector_of(reading.message.magnetic_field) for reading in self.newest])
        motions = None
        if self._imu is not None:
            motions = np.array([self._motions.near(at) for at in times])
        return Samples.of(
            field,
            unit=self.unit.name,
            time=(np.array(times, np.int64) - self._since_ns) * 1e-9,
            acceleration=None if motions is None else motions[:, :3],
            rate=None if motions is None else motions[:, 3:],
            source=self.name,
        )

    def _events(self, readings: list[Reading]) -> Iterator[FeedEvent]:
        """Yield events of the connection and of the readings."""
        if readings:
            self._heard = time.monotonic()
            self._readings += len(readings)
            self._advised.discard("nothing")
        yield from self._connection(is_heard=bool(readings))
        values = np.array([vector_of(reading.message.magnetic_field) for reading in readings]).reshape(-1, 3)
        yield from self._of_values(values)
        if self._imu is not None and readings:
            yield from self._of_frames()

    def _connection(self, *, is_heard: bool) -> Iterator[FeedEvent]:
        """Yield events of the connection: no publisher, no readings, lost readings, or readings again."""
        is_matched = is_heard or self._reader.get_subscription_matched_status().current_count > 0
        self._was_matched = self._was_matched or is_matched
        if self._was_matched and is_matched == self._is_gone:
            self._is_gone = not is_matched
            if self._is_gone:
                words = f"nobody publishes {self.topic} any more: see that its driver still runs"
                yield FeedEvent("gone", self._now(), words)
            else:
                yield FeedEvent("back", self._now(), f"{self.topic} is published again")
        if not self._is_gone and time.monotonic() - self._heard > SILENT_S:
            yield from self._advise(
                "nothing",
                f"a publisher of {self.topic} is there, and no reading comes: see that the driver hears its sensor"
                if self._was_matched
                else f"a publisher of {self.topic} is there, and does not match: it writes another representation than "
                "ROS 2 does (XCDR2), or into a partition of DDS",
            )
        lost = self._reader.get_sample_lost_status().total_count
        if lost > self._lost:
            new, self._lost = lost - self._lost, lost
            words = (
                f"{count_text(new, 'reading')} of {self.topic} did not arrive: the network or this machine is too busy"
            )
            yield FeedEvent("lost", self._now(), words)

    def _of_values(self, values: Floats) -> Iterator[FeedEvent]:
        """Yield events on faults of the values: missing axes, a repeated reading, another unit."""
        self._unreported += int((~np.isfinite(values)).any(axis=1).sum())
        if self._unreported >= MIN_ADVICE_READINGS:
            yield from self._advise(
                "no-answer",
                f"{count_text(self._unreported, 'reading')} of {self.topic} have an axis without a value (NaN), and "
                "are left out: a magnetometer with three axes is needed",
            )
        for row in map(tuple, values.tolist()):
            self._same = self._same + 1 if row == self._last else 1
            self._same_since = self._now() if self._same == 1 else self._same_since
            self._last = row
        if self._same >= MIN_REPEATS and self._now() - self._same_since >= MIN_REPEAT_S:
            yield from self._advise(
                "no-answer",
                f"the last {self._same} readings of {self.topic} are the same: turn the sensor; if they stay so, its "
                "driver repeats an old reading: restart it",
                about="still",
            )
        elif self._same < MIN_REPEATS:
            self._advised.discard("still")
        if len(values) and self._readings >= MIN_ADVICE_READINGS:
            yield from self._of_strength(float(np.linalg.norm(values, axis=1).mean()) * self.unit.scale)

    def _of_strength(self, strength: float) -> Iterator[FeedEvent]:
        """Yield one event if the readings are in another unit."""
        low, high = WIDE_EARTH_FIELD_RANGE_UT
        if not np.isfinite(strength) or low / 4 < strength < 4 * high or self.unit.name != UNIT:
            return
        yield from self._advise(
            "unclear",
            f"readings of {self.topic} are about {figures(1e-6 * strength, 2)} T long, and the earth's field is 2e-05 "
            "to 7e-05 T: the driver writes another unit, which --unit names, or normalises them",
        )

    def _of_frames(self) -> Iterator[FeedEvent]:
        """Yield one event if the `Imu` is in another frame and left out."""
        if self._motions.others:
            other, frame = min(self._motions.others), self._motions.frame
            yield from self._advise(
                "garbage",
                f"the Imu is in the frame {other!r}, and {self.topic} in {frame!r}: acceleration and rate are left out",
            )

    def _advise(self, kind: Kind, words: str, *, about: str = "") -> Iterator[FeedEvent]:
        """Yield an event about a fault, unless it was yielded before and the fault has not ended since.

        `about` identifies the fault.
        """
        if (about or kind) not in self._advised:
            self._advised.add(about or kind)
            yield FeedEvent(kind, self._now(), words)


class _Motions:
    """Messages of an `Imu` with their times."""

    def __init__(self) -> None:
        self.frame: str | None = None
        self.others: set[str] = set()
        self._times: deque[int] = deque(maxlen=MAX_MOTIONS)
        self._rows: deque[tuple[float, ...]] = deque(maxlen=MAX_MOTIONS)

    def add(self, messages: list[Any]) -> None:
        """Add messages of the `Imu`; those of another frame are left out."""
        for message in messages:
            if not hasattr(message, "header"):
                continue
            if self.frame is not None and message.header.frame_id != self.frame:
                self.others.add(str(message.header.frame_id))
            elif not self._times or _stamp(message) > self._times[-1]:
                self._times.append(_stamp(message))
                self._rows.append(motion_of(message))

    def near(self, at_ns: int) -> tuple[float, ...]:
        """(6,) acceleration and rate nearest to a time; NaN beyond `MAX_APART_NS`."""
        place = bisect(self._times, at_ns)
        around = [index for index in (place - 1, place) if 0 <= index < len(self._times)]
        nearest = min(around, key=lambda index: abs(self._times[index] - at_ns), default=None)
        if nearest is None or abs(self._times[nearest] - at_ns) > MAX_APART_NS:
            return (np.nan,) * 6
        return self._rows[nearest]


def _stamp(message: Any) -> int:  # noqa: ANN401 - a message of Cyclone DDS
    """Time of a message in ns: from its header, else its time of publication."""
    stamp = message.header.stamp
    return int(stamp.sec * SECOND_NS + stamp.nanosec or message.sample_info.source_timestamp)


def opened(topic: str, imu_topic: str | None = None, unit: str | None = None) -> TopicFeed:
    """Find a topic in the domain of ``ROS_DOMAIN_ID``, and return its feed.

    Raises as `domain_id`, `full_name`, `Participant` and `Participant.find`.
    """
    names = {full_name(topic): MAGNETIC_FIELD} | ({} if imu_topic is None else {full_name(imu_topic): IMU})
    participant = Participant(domain_id())
    for name, kind in names.items():
        participant.find(name, kind)
    return TopicFeed(participant, topic, imu_topic, unit)
