/* Stands in for Zephyr's API of sensors, with the names and types of include/zephyr/drivers/sensor.h. */
#pragma once
#include <zephyr/device.h>

struct sensor_value {
    int32_t val1, val2;
};
enum sensor_channel { SENSOR_CHAN_ACCEL_XYZ, SENSOR_CHAN_MAGN_XYZ };

static inline int sensor_sample_fetch(const struct device *dev) { return dev->error; }

static inline int sensor_channel_get(const struct device *dev, enum sensor_channel chan, struct sensor_value *val)
{
    int axis;
    for (axis = 0; axis < 3; axis++) {
        const double value = dev->axes[chan == SENSOR_CHAN_MAGN_XYZ][axis];
        val[axis].val1 = (int32_t)value;
        val[axis].val2 = (int32_t)((value - (int32_t)value) * 1000000.0);
    }
    return 0;
}
