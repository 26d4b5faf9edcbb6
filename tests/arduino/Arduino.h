// What the example of the firmware asks of Arduino, on this machine: a serial port at stdin and stdout, an LIS3MDL that
// replays the counts of readings.txt, and an EEPROM in the file eeprom.bin.
#pragma once
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static unsigned long now = 0;
inline unsigned long millis() { return now; }
inline void delay(unsigned long) { exit(1); }

struct SerialPort {
  void begin(long) {}
  int available() {
    struct pollfd input = {0, POLLIN, 0};
    return poll(&input, 1, 0) > 0 && (input.revents & (POLLIN | POLLHUP));
  }
  int read() {
    unsigned char byte;
    if (::read(0, &byte, 1) != 1) exit(0);
    return byte;
  }
  float parseFloat() {
    char word[32] = {0};
    int at = 0;
    for (int byte = read(); at < 31 && (at == 0 || !strchr(" \n", byte)); byte = read())
      if (!strchr(" \n", byte)) word[at++] = (char)byte;
    return strtof(word, nullptr);
  }
  void print(const char *words) { fputs(words, stdout); }
  void print(double number, int places) { printf("%.*f", places, number); }
  void println(const char *words = "") { printf("%s\r\n", words); fflush(stdout); }
  void println(double number, int places) { print(number, places); println(); }
};
static SerialPort Serial;

struct TwoWire {
  uint8_t name = 0, at = 0, answer[8] = {0};
  FILE *readings = nullptr;
  void begin() { readings = fopen("readings.txt", "r"); }
  void beginTransmission(uint8_t) { at = 0; }
  void write(uint8_t value) { if (at++ == 0) name = value & 0x7F; }
  uint8_t endTransmission() { return 0; }
  uint8_t requestFrom(uint8_t, uint8_t count) {
    at = 0;
    if (name == 0x0F) answer[0] = 0x3D;
    else if (name == 0x27) answer[0] = 8, now += 12;
    else measure();
    return count;
  }
  void measure() {
    int counts[3];
    if (fscanf(readings, "%d %d %d", counts, counts + 1, counts + 2) != 3) {
      rewind(readings);
      usleep(1000); // the recording is over: do not fill the pipe
      return;
    }
    for (int axis = 0; axis < 3; axis++)
      answer[2 * axis] = counts[axis] & 0xFF, answer[2 * axis + 1] = counts[axis] >> 8 & 0xFF;
  }
  int read() { return answer[at++]; }
};
static TwoWire Wire;

struct Memory {
  FILE *file() {
    static FILE *opened = fopen("eeprom.bin", "r+b");
    return opened ? opened : opened = fopen("eeprom.bin", "w+b");
  }
  uint8_t read(int at) {
    fseek(file(), at, SEEK_SET);
    const int byte = fgetc(file());
    return byte == EOF ? 0xFF : (uint8_t)byte;
  }
  void write(int at, uint8_t byte) {
    fseek(file(), 0, SEEK_END);
    while (ftell(file()) < at) fputc(0xFF, file()); // erased
    fseek(file(), at, SEEK_SET);
    fputc(byte, file());
    fflush(file());
  }
};
static Memory EEPROM;

void setup();
void loop();
int main() {
  setup();
  for (;;) loop();
}
