// Calibrates an LIS3MDL on I2C, then keeps calibrating online: the uncertainty grows with time, readings reduce it, and an
// offset that has moved is detected and estimated again. Once a second the sketch prints the expected heading error, and how
// long the calibration stays good.
//
// The calibration in force is stored in EEPROM: once it exists, ten minutes after the last write if the offset has moved,
// else at most once an hour. EEPROM has two records, and the older one is overwritten, so power may fail at any byte. Only
// changed bytes are written. On ESP8266, ESP32 and RP2040 an EEPROM is a copy of one sector of flash, which is erased as a
// whole: a power failure during a write may lose both records, and the sensor has to be turned again.
//
// Needs 20 kB of RAM until the calibration is good, and 10 kB afterwards.

#include <EEPROM.h>
#include <flinders_lis3mdl.h>
#include <flinders_service.h>

const unsigned long ANSWER_MS = 1000;

static union { flinders_board board; flinders_service service; } memory; // one after the other
static bool isInService = false;

// Seconds of a clock that runs while the board is off, such as a DS3231; 0 without one, which counts as a day off.
uint32_t clockSeconds() { return 0; }

void loadFrom(int place, flinders_stored &record) {
  uint8_t *bytes = (uint8_t *)&record;
  for (unsigned i = 0; i < sizeof record; i++) bytes[i] = EEPROM.read(place * sizeof record + i);
}

void storeAt(int place, const flinders_stored &record) {
  const uint8_t *bytes = (const uint8_t *)&record;
  for (unsigned i = 0; i < sizeof record; i++) {
    const int at = place * sizeof record + i;
    if (EEPROM.read(at) != bytes[i]) EEPROM.write(at, bytes[i]);
  }
#if defined(ESP32) || defined(ESP8266) || defined(ARDUINO_ARCH_RP2040)
  EEPROM.commit();
#endif
}

void restore() {
  flinders_stored record;
#if defined(ESP32) || defined(ESP8266) || defined(ARDUINO_ARCH_RP2040)
  EEPROM.begin(2 * sizeof record);
#endif
  flinders_service_clear(&memory.service);
  for (int place = 0; place < 2; place++) {
    loadFrom(place, record);
    if (flinders_service_restore(&memory.service, &record, clockSeconds(), millis())) isInService = true;
  }
  if (!isInService) flinders_board_begin(&memory.board);
}

void store() {
  flinders_stored record;
  const int place = flinders_service_store(&memory.service, clockSeconds(), &record);
  storeAt(place, record);
  Serial.println("Stored");
}

// Until the calibration is good.
void calibrate() {
  if (flinders_board_solve(&memory.board) != FLINDERS_OK) {
    Serial.println(flinders_message(memory.board.answer.status));
    return;
  }
  Serial.print("Expected heading error (degrees): ");
  Serial.println(memory.board.answer.heading_worst_deg, 2);
  if (memory.board.answer.verdict == FLINDERS_NOTE)
    isInService = flinders_service_begin(&memory.service, &memory.board, millis()) == FLINDERS_OK;
  else {
    Serial.print("Next, hold the sensor ");
    Serial.print(flinders_board_turn(&memory.board));
    Serial.println(" and turn it slowly once around");
  }
}

void printAnswer() {
  flinders_service_answer answer;
  flinders_service_answer_at(&memory.service, millis(), &answer);
  Serial.print("Heading error now (degrees): ");
  Serial.print(answer.in_force.heading_worst_deg, 2);
  Serial.print(", good for another (s): ");
  Serial.println(answer.good_s, 0);
  if (answer.is_disturbed) Serial.println("Iron passes by, or the offset has moved");
}

void learn(const float field[3]) {
  const int32_t events = flinders_service_add(&memory.service, field, millis());
  if (events & FLINDERS_CONTRADICTED) Serial.println("Readings contradict the calibration");
  if (events & FLINDERS_PASSED) Serial.println("The disturbance has passed");
  if (events & FLINDERS_MOVED) Serial.println("The offset has moved, and is estimated again");
  if (flinders_service_wants_storing(&memory.service)) store();
}

void setup() {
  Serial.begin(115200);
  Wire.begin();
  restore();
  while (!beginSensor()) {
    Serial.println("No LIS3MDL answers: check the wires and its address");
    delay(1000);
  }
}

void loop() {
  static unsigned long answered = 0;
  float field[3];
  if (readField(field)) {
    if (isInService) learn(field);
    else flinders_board_add(&memory.board, field);
  }
  if (millis() - answered < ANSWER_MS) return;
  answered = millis();
  if (isInService) printAnswer();
  else calibrate();
}
