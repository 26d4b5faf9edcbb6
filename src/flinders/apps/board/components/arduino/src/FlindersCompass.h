// A calibrated compass: heading, its standard deviation at the attitude, and whether the field is disturbed.
#pragma once

#include "flinders_compass.h"

class FlindersCompass {
 public:
  // Heading from a raw reading (x, y, z) and the reading of an accelerometer at rest (ax, ay, az), in the same axes. The
  // acceleration may be in any unit.
  flinders_reading read(float x, float y, float z, float ax, float ay, float az) const {
    const float reading[3] = {x, y, z}, acceleration[3] = {ax, ay, az};
    return flinders_compass_read(reading, acceleration);
  }

  // Heading of a level vehicle from a raw reading, without an accelerometer.
  flinders_reading readLevel(float x, float y, float z) const {
    const float reading[3] = {x, y, z};
    return flinders_compass_read(reading, NULL);
  }
};
