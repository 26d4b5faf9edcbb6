// Calibrates an LIS3MDL on I2C on the board, and prints readings for `flinders live` and `flinders calibrate`.
//
// Turn the sensor through all directions, upside down too. Once a second the sketch prints the covered share of the sphere,
// the expected heading error and the attitude for the next readings. The first good calibration is stored in EEPROM; a
// calibration sent by a computer (`flinders send --serial`, MotionCal) replaces it for good.
//
// Needs 20 kB of RAM. For boards without EEPROM, remove the lines with EEPROM; then nothing is stored.

#include <EEPROM.h>
#include <flinders_board.h>
#include <flinders_lis3mdl.h>

const unsigned long SOLVE_MS = 1000;

static flinders_board board;
static flinders_answer inUse;                // calibration in EEPROM
static unsigned char packet[FLINDERS_PACKET];
static bool isStored = false;                // since the sketch began

void store(const flinders_answer &answer) {
  inUse = answer;
  isStored = true;
  flinders_packet_write(&inUse, packet);
  for (int i = 0; i < FLINDERS_PACKET; i++) EEPROM.write(i, packet[i]);
#if defined(ESP32) || defined(ESP8266) || defined(ARDUINO_ARCH_RP2040)
  EEPROM.commit();
#endif
  memset(packet, 0, sizeof packet);
}

void load() {
#if defined(ESP32) || defined(ESP8266) || defined(ARDUINO_ARCH_RP2040)
  EEPROM.begin(FLINDERS_PACKET);
#endif
  for (int i = 0; i < FLINDERS_PACKET; i++) packet[i] = EEPROM.read(i);
  if (flinders_packet_read(packet, &inUse) != 0) inUse.matrix[0] = inUse.matrix[4] = inUse.matrix[8] = 1;
  memset(packet, 0, sizeof packet);
}

// Receive a calibration from a computer.
void receive() {
  while (Serial.available() > 0)
    if (flinders_packet_add(packet, (unsigned char)Serial.read())) {
      flinders_answer sent = inUse;
      flinders_packet_read(packet, &sent);
      store(sent);
    }
}

void printNumbers(const float *numbers, int count) {
  for (int i = 0; i < count; i++) {
    Serial.print(",");
    Serial.print(numbers[i], 3);
  }
}

// Print the calibration in use, in the format of MotionCal and `flinders send`.
void printCalibration() {
  Serial.print("Cal1:0.000,0.000,0.000,0.000,0.000,0.000"); // accelerometer and gyroscope
  printNumbers(inUse.offset, 3);
  printNumbers(&inUse.field, 1);
  Serial.println();
  Serial.print("Cal2:");
  Serial.print(inUse.matrix[0], 3);
  printNumbers(inUse.matrix + 1, 8);
  Serial.println();
}

void printAnswer() {
  static const char *const VERDICTS[] = {"", "good", "good with limits", "refused"};
  const flinders_answer &answer = board.answer;
  Serial.print("Covered directions (percent): ");
  Serial.println(100 * flinders_board_seen(&board), 0);
  if (answer.status != FLINDERS_OK) {
    Serial.println(flinders_message(answer.status));
    return;
  }
  Serial.print("Expected heading error (degrees): ");
  Serial.print(answer.heading_worst_deg, 2);
  Serial.print(", ");
  Serial.println(VERDICTS[answer.verdict]);
  for (int i = 0; i < FLINDERS_RULES_OF_A_FIT; i++)
    if (answer.findings[i] > FLINDERS_NOTE) Serial.println(flinders_rule_of(i)->action);
  Serial.print("Next, hold the sensor ");
  Serial.print(flinders_board_turn(&board));
  Serial.println(" and turn it slowly once around");
}

void setup() {
  Serial.begin(115200);
  Wire.begin();
  load();
  flinders_board_begin(&board);
  while (!beginSensor()) {
    Serial.println("No LIS3MDL answers: check the wires and its address");
    delay(1000);
  }
}

void loop() {
  static unsigned long solved = 0;
  float field[3];
  receive();
  if (readField(field)) {
    flinders_board_add(&board, field);
    Serial.print("X: ");
    Serial.print(field[0], 2);
    Serial.print("\tY: ");
    Serial.print(field[1], 2);
    Serial.print("\tZ: ");
    Serial.print(field[2], 2);
    Serial.println(" uTesla");
  }
  if (millis() - solved < SOLVE_MS) return;
  solved = millis();
  flinders_board_solve(&board);
  if (!isStored && board.answer.verdict == FLINDERS_NOTE) store(board.answer);
  printAnswer();
  printCalibration();
}
