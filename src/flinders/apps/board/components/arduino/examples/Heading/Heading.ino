// Heading of readings from the serial port, mx my mz ax ay az: replace nextReading by a function for your sensor.
#include <FlindersCompass.h>

FlindersCompass compass;

void nextReading(float values[6]) {
  for (int place = 0; place < 6; place++) values[place] = Serial.parseFloat();
}

void setup() { Serial.begin(115200); }

void loop() {
  if (Serial.available() <= 0) return;
  float v[6];
  nextReading(v);
  const flinders_reading now = compass.read(v[0], v[1], v[2], v[3], v[4], v[5]);
  Serial.print(now.heading, 1);
  Serial.print(" +- ");
  Serial.print(now.sigma, 2);
  Serial.println(now.disturbed ? " disturbed" : "");
}
