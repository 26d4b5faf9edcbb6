#include "flinders_compass_sensor.h"

#include <zephyr/drivers/sensor.h>

static int sample(const struct device *device, enum sensor_channel channel, float axes[3])
{
    struct sensor_value values[3];
    int axis, error = sensor_sample_fetch(device);
    if (error == 0) {
        error = sensor_channel_get(device, channel, values);
    }
    for (axis = 0; axis < 3 && error == 0; axis++) {
        axes[axis] = (float)values[axis].val1 + (float)values[axis].val2 / 1000000.0f;
    }
    return error;
}

int flinders_compass_fetch(const struct device *magnetometer, const struct device *accelerometer,
                           struct flinders_reading *compass)
{
    float field[3], acceleration[3];
    int error = sample(magnetometer, SENSOR_CHAN_MAGN_XYZ, field);
    if (error == 0 && accelerometer != NULL) {
        error = sample(accelerometer, SENSOR_CHAN_ACCEL_XYZ, acceleration);
    }
    if (error == 0) {
        *compass = flinders_compass_read(field, accelerometer == NULL ? NULL : acceleration);
    }
    return error;
}
