/* A calibrated compass from the sensors of Zephyr. */
#ifndef FLINDERS_COMPASS_SENSOR_H
#define FLINDERS_COMPASS_SENSOR_H

#include <zephyr/device.h>

#include "flinders_compass.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Fetch a sample of each sensor, and compute the heading. The accelerometer has the axes of the magnetometer; it may be the
 * same device, or NULL for a level vehicle. Returns 0, or the negative error number of a sensor without a sample. */
int flinders_compass_fetch(const struct device *magnetometer, const struct device *accelerometer,
                           struct flinders_reading *compass);

#ifdef __cplusplus
}
#endif

#endif
