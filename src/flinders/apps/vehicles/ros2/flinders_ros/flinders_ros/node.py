"""A node that calibrates from ``MagneticField``, and publishes corrected readings, a diagnosis and the calibration.

`flinders.OnlineCalibration` does the calibration; this module has topics, parameters and messages.
"""

import os

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import MagneticField
from std_msgs.msg import String

from flinders import OnlineCalibration
from flinders.apps.vehicles.ros2.corrected import (
    CALIBRATION,
    CORRECTED,
    DIAGNOSTICS,
    STATUS,
    CalibrationNews,
    corrected_field,
)

SAVE_S = 60.0
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)
MICROTESLA = 1e6


class Calibrator(Node):
    """Calibrates a magnetometer while its robot works."""

    def __init__(self):
        super().__init__("flinders")
        self.topic = self.declare_parameter("topic", "/imu/mag").value
        corrected = self.declare_parameter("corrected_topic", CORRECTED).value
        self.state = self.declare_parameter("state", "").value
        target_deg = self.declare_parameter("target_deg", 1.0).value
        if self.state and os.path.exists(self.state):
            self.online = OnlineCalibration.load(self.state)
        else:
            self.online = OnlineCalibration(unit="T", target_deg=target_deg)
        self.news = CalibrationNews(self.online)
        self.corrected = self.create_publisher(MagneticField, corrected, 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, DIAGNOSTICS, 10)
        self.calibration = self.create_publisher(String, f"{corrected}{CALIBRATION}", LATCHED)
        self.create_subscription(MagneticField, self.topic, self.take, qos_profile_sensor_data)
        self.create_timer(SAVE_S, self.save)

    def take(self, message):
        """Add a reading to the calibration, and publish it corrected."""
        stamp, vector = message.header.stamp, message.magnetic_field
        reading = np.array([[vector.x, vector.y, vector.z]])
        if not np.isfinite(reading).all():
            return
        time_s = stamp.sec + 1e-9 * stamp.nanosec or 1e-9 * self.get_clock().now().nanoseconds
        for event in self.online.add(reading, time=[time_s]):
            self.get_logger().info(str(event))
        self.publish_state()
        if (fit := self.news.fit()) is not None:
            found = corrected_field(fit, MICROTESLA * reading)
            corrected = MagneticField(header=message.header)
            vector = corrected.magnetic_field
            vector.x, vector.y, vector.z = found.field[0].tolist()
            corrected.magnetic_field_covariance = found.covariance.ravel().tolist()
            self.corrected.publish(corrected)

    def publish_state(self):
        """Publish the diagnosis, and a calibration that has come into force."""
        if (diagnosis := self.news.diagnosis(self.online.time_s)) is not None:
            values = [KeyValue(key=name, value=value) for name, value in diagnosis.values.items()]
            status = DiagnosticStatus(name=STATUS, message=diagnosis.message, hardware_id=self.topic, values=values)
            status.level = bytes([diagnosis.level])
            array = DiagnosticArray(status=[status])
            array.header.stamp = self.get_clock().now().to_msg()
            self.diagnostics.publish(array)
        if (text := self.news.new_file()) is not None:
            self.calibration.publish(String(data=text))

    def save(self):
        """Save the state to its file."""
        if self.state:
            self.online.save(self.state)


def main():
    """Run the node until it is stopped."""
    rclpy.init()
    node = Calibrator()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.save()
        node.destroy_node()
        rclpy.try_shutdown()
