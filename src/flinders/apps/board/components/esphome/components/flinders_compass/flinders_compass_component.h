#pragma once

#include "esphome/core/component.h"
#include "esphome/core/defines.h"
#include "esphome/components/sensor/sensor.h"
#ifdef USE_BINARY_SENSOR
#include "esphome/components/binary_sensor/binary_sensor.h"
#endif

namespace esphome {
namespace flinders_compass {

/// Heading of a magnetometer with a calibration by Flinders, with its standard deviation at the attitude.
class FlindersCompass : public PollingComponent {
 public:
  void set_field_sensor(int axis, sensor::Sensor *field) { this->field_[axis] = field; }
  void set_acceleration_sensor(int axis, sensor::Sensor *acceleration) { this->acceleration_[axis] = acceleration; }
  void set_heading_sensor(sensor::Sensor *heading) { this->heading_ = heading; }
  void set_sigma_sensor(sensor::Sensor *sigma) { this->sigma_ = sigma; }
#ifdef USE_BINARY_SENSOR
  void set_disturbed_binary_sensor(binary_sensor::BinarySensor *disturbed) { this->disturbed_ = disturbed; }
#endif

  void update() override;
  void dump_config() override;
  float get_setup_priority() const override { return setup_priority::DATA; }

 protected:
  sensor::Sensor *field_[3]{nullptr, nullptr, nullptr};
  sensor::Sensor *acceleration_[3]{nullptr, nullptr, nullptr};
  sensor::Sensor *heading_{nullptr};
  sensor::Sensor *sigma_{nullptr};
#ifdef USE_BINARY_SENSOR
  binary_sensor::BinarySensor *disturbed_{nullptr};
#endif
};

}  // namespace flinders_compass
}  // namespace esphome
