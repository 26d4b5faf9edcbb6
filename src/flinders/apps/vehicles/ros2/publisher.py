"""Publishes the output of an online calibration on ROS 2: corrected readings, a diagnosis, and the calibration.

- corrected readings: ``sensor_msgs/MagneticField`` with the header of each reading, and its covariance in T²
- ``/diagnostics``: ``diagnostic_msgs/DiagnosticArray``, once a second
- ``…/calibration``: ``std_msgs/String`` with the calibration file, latched: later subscribers receive the last one
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from flinders.apps.vehicles.readers.ros import vector_of
from flinders.apps.vehicles.ros2.corrected import (
    CALIBRATION,
    CORRECTED,
    DIAGNOSTICS,
    STATUS,
    CalibrationNews,
    Diagnosis,
    corrected_field,
)
from flinders.apps.vehicles.ros2.feed import SECOND_NS, TopicFeed
from flinders.apps.vehicles.ros2.names import full_name
from flinders.errors import UsageError

if TYPE_CHECKING:
    from flinders.fitting.result import Fit
    from flinders.links.feeds import Feed
    from flinders.workflows.online import OnlineCalibration


class TopicPublisher:
    """Publisher for the readings of a feed, on the feed's DDS participant.

    Parameters
    ----------
    feed : TopicFeed
    topic : str
        Topic of the corrected readings.

    Raises
    ------
    UsageError
        For an invalid name, or the topic of the readings.
    """

    def __init__(self, feed: TopicFeed, topic: str = CORRECTED) -> None:
        from flinders.apps.vehicles.ros2.messages import DiagnosticArray_, MagneticField_, String_

        self.name = full_name(topic)
        if self.name == feed.topic:
            raise UsageError(f"{self.name} is the topic that is read: publish corrected readings under another name")
        self._feed = feed
        self._corrected = feed.participant.writer(self.name, MagneticField_)
        self._diagnostics = feed.participant.writer(DIAGNOSTICS, DiagnosticArray_)
        self._calibration = feed.participant.writer(f"{self.name}{CALIBRATION}", String_, is_latched=True)
        self._news: CalibrationNews | None = None

    def publish(self, online: OnlineCalibration | None, now: float) -> None:
        """Publish new readings, and a diagnosis and calibration when due.

        Parameters
        ----------
        online : OnlineCalibration, optional
            The calibration; None before the first reading.
        now : float, s
            Current time by the clock of the readings.
        """
        if online is None or math.isnan(now):
            return
        self._news = self._news or CalibrationNews(online)
        if (diagnosis := self._news.diagnosis(now)) is not None:
            self._diagnostics.write(self._array(diagnosis))
        if (text := self._news.new_file()) is not None:
            self._calibration.write(self._string(text))
        if (fit := self._news.fit()) is not None:
            self._correct(fit)

    def _correct(self, fit: Fit) -> None:
        """Publish the newest readings, corrected."""
        from flinders.apps.vehicles.ros2.messages import MagneticField_, Vector3_

        readings, self._feed.newest = self._feed.newest, []
        if not readings:
            return
        raw = np.array([vector_of(reading.message.magnetic_field) for reading in readings])
        corrected = corrected_field(fit, self._feed.unit.scale * raw)
        for reading, field, covariance in zip(readings, corrected.field, corrected.covariance, strict=True):
            message = MagneticField_(reading.message.header, Vector3_(*field.tolist()), covariance.ravel().tolist())
            self._corrected.write(message)

    def _array(self, diagnosis: Diagnosis) -> Any:  # noqa: ANN401 - a message of Cyclone DDS
        from flinders.apps.vehicles.ros2.messages import (
            DiagnosticArray_,
            DiagnosticStatus_,
            Header_,
            KeyValue_,
            Time_,
        )

        now_ns = time.time_ns()
        values = [KeyValue_(name, value) for name, value in diagnosis.values.items()]
        status = DiagnosticStatus_(diagnosis.level, STATUS, diagnosis.message, self._feed.topic, values)
        return DiagnosticArray_(Header_(Time_(now_ns // SECOND_NS, now_ns % SECOND_NS)), [status])

    @staticmethod
    def _string(text: str) -> Any:  # noqa: ANN401 - a message of Cyclone DDS
        from flinders.apps.vehicles.ros2.messages import String_

        return String_(text)


def opened(feed: Feed, topic: str = CORRECTED) -> TopicPublisher:
    """Return the publisher for the feed of a topic; `UsageError` for another feed, and as for `TopicPublisher`."""
    if not isinstance(feed, TopicFeed):
        raise UsageError(f"{feed.name} is not a topic of ROS 2: --publish needs a feed with --ros2")
    return TopicPublisher(feed, topic)
