/* MotionCal's packet: 117 84, sixteen floats (nine offsets, the last three in µT; field; matrix 11 22 33 12 13 23), CRC-16.
 *
 * PaulStoffregen/MotionCal, rawdata.c (send_calibration); all numbers little endian.
 */
#include <math.h>
#include <string.h>

#include "flinders_board.h"

enum { OFFSET = 2 + 4 * 6, FIELD = OFFSET + 4 * 3, MATRIX = FIELD + 4, CHECKED = FLINDERS_PACKET - 2 };

static const unsigned char ENTRY[9] = {0, 3, 4, 3, 1, 5, 4, 5, 2};

/* CRC-16/MODBUS. */
static uint16_t checksum(const unsigned char *bytes, int n)
{
    uint16_t crc = 0xFFFF;
    for (int i = 0; i < n; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) crc = (uint16_t)(crc & 1 ? crc >> 1 ^ 0xA001 : crc >> 1);
    }
    return crc;
}

/* Store a number in four bytes. */
static void put(unsigned char *bytes, flinders_real number)
{
    const float single = (float)number;
    uint32_t bits;
    memcpy(&bits, &single, sizeof bits);
    for (int i = 0; i < 4; i++) bytes[i] = (unsigned char)(bits >> 8 * i);
}

/* Read a number from four bytes. */
static flinders_real number_at(const unsigned char *bytes)
{
    float single;
    const uint32_t bits = bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
    memcpy(&single, &bits, sizeof single);
    return (flinders_real)single;
}

/* Whether bytes are a packet, by signature, checksum and numbers. */
static int is_packet(const unsigned char *packet)
{
    const uint16_t crc = checksum(packet, CHECKED);
    if (packet[0] != 117 || packet[1] != 84) return 0;
    if (packet[CHECKED] != (crc & 0xFF) || packet[CHECKED + 1] != crc >> 8) return 0;
    for (int at = 2; at < CHECKED; at += 4)
        if (!isfinite(number_at(packet + at))) return 0;
    return 1;
}

/* Add a byte; the last 68 bytes of the stream may be the packet. */
int flinders_packet_add(unsigned char packet[FLINDERS_PACKET], unsigned char byte)
{
    memmove(packet, packet + 1, FLINDERS_PACKET - 1);
    packet[FLINDERS_PACKET - 1] = byte;
    return packet[0] == 117 && is_packet(packet);
}

/* Write a packet. */
void flinders_packet_write(const flinders_answer *answer, unsigned char packet[FLINDERS_PACKET])
{
    memset(packet, 0, FLINDERS_PACKET);
    packet[0] = 117, packet[1] = 84;
    for (int axis = 0; axis < 3; axis++) put(packet + OFFSET + 4 * axis, answer->offset[axis]);
    put(packet + FIELD, answer->field);
    for (int i = 0; i < 9; i++) put(packet + MATRIX + 4 * ENTRY[i], answer->matrix[i]);
    const uint16_t crc = checksum(packet, CHECKED);
    packet[CHECKED] = (unsigned char)(crc & 0xFF), packet[CHECKED + 1] = (unsigned char)(crc >> 8);
}

/* Read a packet. */
int flinders_packet_read(const unsigned char packet[FLINDERS_PACKET], flinders_answer *answer)
{
    if (!is_packet(packet)) return 1;
    for (int axis = 0; axis < 3; axis++) answer->offset[axis] = number_at(packet + OFFSET + 4 * axis);
    answer->field = number_at(packet + FIELD);
    for (int i = 0; i < 9; i++) answer->matrix[i] = number_at(packet + MATRIX + 4 * ENTRY[i]);
    return 0;
}
