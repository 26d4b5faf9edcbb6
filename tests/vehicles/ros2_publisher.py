"""A publisher of ROS 2 topics in a process of its own, like a driver; lines of JSON are its commands.

The commands are ``publish`` (a topic of a type), ``send`` (rows on a topic at a rate) and ``end`` (of a topic). When a
command is done, a line is printed; for ``send`` that is when the last row was passed to DDS.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

from flinders.apps.vehicles.ros2 import messages
from flinders.apps.vehicles.ros2.messages import Header_, Imu_, MagneticField_, Time_, Vector3_
from flinders.apps.vehicles.ros2.participant import Participant

SECOND_NS = 1_000_000_000


class Driver:
    """Topics that this process publishes."""

    def __init__(self) -> None:
        self.participant = Participant(int(sys.argv[1]))
        self.writers: dict[str, Any] = {}

    def publish(self, topic: str, kind: str = "MagneticField_") -> None:
        message = getattr(messages, kind)
        messages.TYPE_HASHES.setdefault(message, "RIHS01_0")
        self.writers[topic] = self.participant.writer(topic, message)

    def send(
        self, topic: str, rows: list[list[float]], rate_hz: float, start_ns: int, frame: str = "mag", matched: int = 1
    ) -> None:
        """Wait until `matched` subscribers exist, and send rows, in tesla or as `Imu`, at the rate of their times."""
        writer, begun = self.writers[topic], time.monotonic()
        while writer.get_publication_matched_status().current_count < matched:
            time.sleep(0.005)
        begun = time.monotonic()
        for index, row in enumerate(rows):
            time.sleep(max(begun + index / rate_hz - time.monotonic(), 0.0))
            at = start_ns + round(index / rate_hz * SECOND_NS)
            header = Header_(Time_(at // SECOND_NS, at % SECOND_NS), frame)
            field = Vector3_(*row[:3])
            if len(row) == 3:
                writer.write(MagneticField_(header, field))
            else:
                writer.write(Imu_(header, angular_velocity=Vector3_(*row[3:]), linear_acceleration=field))

    def end(self, topic: str) -> None:
        del self.writers[topic]


def main() -> None:
    driver = Driver()
    for line in sys.stdin:
        told = json.loads(line)
        getattr(driver, told.pop("do"))(**told)
        sys.stdout.write("done\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
