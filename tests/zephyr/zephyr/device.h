/* Stands in for Zephyr's: a device is three values of each of two channels, and the error that fetching returns. */
#pragma once
#include <stdint.h>
struct device {
    double axes[2][3];
    int error;
};
