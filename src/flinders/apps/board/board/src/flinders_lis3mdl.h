// flinders_lis3mdl.h - reads an LIS3MDL on I2C, for the examples: no other library is needed.
#ifndef FLINDERS_LIS3MDL_H
#define FLINDERS_LIS3MDL_H

#include <Arduino.h>
#include <Wire.h>

#ifndef FLINDERS_LIS3MDL_ADDRESS
#define FLINDERS_LIS3MDL_ADDRESS 0x1C        // 0x1E where SDO/SA1 is high, as on Pololu's board
#endif

const float UT_PER_COUNT = 100.0 / 6842.0;   // at 4 gauss

static inline void writeRegister(uint8_t name, uint8_t value) {
  Wire.beginTransmission(FLINDERS_LIS3MDL_ADDRESS);
  Wire.write(name);
  Wire.write(value);
  Wire.endTransmission();
}

// Request `count` registers, beginning with register `name`; false without an answer.
static inline bool request(uint8_t name, uint8_t count) {
  Wire.beginTransmission(FLINDERS_LIS3MDL_ADDRESS);
  Wire.write((uint8_t)(name | 0x80));        // bit 7: the following registers, too
  if (Wire.endTransmission() != 0) return false;
  return Wire.requestFrom(FLINDERS_LIS3MDL_ADDRESS, count) == count;
}

static inline bool beginSensor() {
  if (!request(0x0F, 1) || Wire.read() != 0x3D) return false;
  writeRegister(0x20, 0x7C);                 // x and y: best performance, 80 Hz
  writeRegister(0x21, 0x00);                 // 4 gauss
  writeRegister(0x23, 0x0C);                 // z: best performance
  writeRegister(0x24, 0x40);                 // keep low and high byte of one measurement together
  writeRegister(0x22, 0x00);                 // measure continuously
  return true;
}

static inline int16_t readCount() {
  const uint8_t low = Wire.read();
  return (int16_t)(low | (uint16_t)Wire.read() << 8);
}

static inline bool readField(float field[3]) {
  if (!request(0x27, 1) || !(Wire.read() & 8)) return false; // no new reading
  if (!request(0x28, 6)) return false;
  for (int axis = 0; axis < 3; axis++) field[axis] = readCount() * UT_PER_COUNT;
  return true;
}

#endif
