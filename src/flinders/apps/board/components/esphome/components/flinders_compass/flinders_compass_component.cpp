#include "flinders_compass_component.h"

#include "esphome/core/log.h"
#include "flinders_compass.h"

namespace esphome {
namespace flinders_compass {

static const char *const TAG = "flinders_compass";

/// Read the states of three sensors; false until each sensor has a state.
static bool read_states(sensor::Sensor *const sensors[3], float states[3]) {
  for (int axis = 0; axis < 3; axis++) {
    if (sensors[axis] == nullptr || !sensors[axis]->has_state())
      return false;
    states[axis] = sensors[axis]->state;
  }
  return true;
}

void FlindersCompass::update() {
  float field[3], acceleration[3];
  const bool is_tilted = this->acceleration_[0] != nullptr;
  if (!read_states(this->field_, field) || (is_tilted && !read_states(this->acceleration_, acceleration)))
    return;
  const auto compass = flinders_compass_read(field, is_tilted ? acceleration : nullptr);
  if (this->heading_ != nullptr)
    this->heading_->publish_state(compass.heading);
  if (this->sigma_ != nullptr)
    this->sigma_->publish_state(compass.sigma);
#ifdef USE_BINARY_SENSOR
  if (this->disturbed_ != nullptr)
    this->disturbed_->publish_state(compass.disturbed);
#endif
}

void FlindersCompass::dump_config() {
  ESP_LOGCONFIG(TAG, "Flinders compass:");
#ifdef FLINDERS_STRENGTH_LIMIT
  ESP_LOGCONFIG(TAG, "  Field strength: %.2f, limit %.2f", FLINDERS_FIELD_STRENGTH, FLINDERS_STRENGTH_LIMIT);
#endif
  ESP_LOGCONFIG(TAG, "  Heading sigma: %.2f deg of a reading, %.2f deg of the calibration", FLINDERS_HEADING_SIGMA_READING,
                FLINDERS_HEADING_SIGMA_CALIBRATION);
  LOG_UPDATE_INTERVAL(this);
  LOG_SENSOR("  ", "Heading", this->heading_);
  LOG_SENSOR("  ", "Heading sigma", this->sigma_);
}

}  // namespace flinders_compass
}  // namespace esphome
