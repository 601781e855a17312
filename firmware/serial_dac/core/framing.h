/* Frames of docs/protocols/serial-dac.md: COBS around a payload and its CRC-16/CCITT-FALSE, byte by byte. */
#ifndef FRAMING_H
#define FRAMING_H

#include <stdbool.h>
#include <stdint.h>

#define FRAMING_CRC_BYTES 2U
#define FRAMING_LONGEST_PAYLOAD 32U
/* Bytes before the delimiter: payload, CRC and the one byte that COBS adds. */
#define FRAMING_LONGEST_FRAME (FRAMING_LONGEST_PAYLOAD + FRAMING_CRC_BYTES + 1U)

/* A frame that is being received. All zero is the beginning of one. */
struct framing_decoder {
    uint8_t data[FRAMING_LONGEST_PAYLOAD + FRAMING_CRC_BYTES]; /* payload and CRC, decoded */
    uint8_t received; /* bytes since the last delimiter; stays at FRAMING_LONGEST_FRAME + 1 in a longer frame */
    uint8_t left;     /* bytes of the piece still to come before the next length byte */
    uint16_t crc;     /* of all of data but its last two bytes */
};

/* Take one byte other than the delimiter. Costs the same few operations whatever it is. */
void framing_push(struct framing_decoder *decoder, uint8_t byte);

/* The delimiter has come: the length of the payload in data, or 0 for a bad frame. Ask framing_is_empty first. */
uint8_t framing_end(struct framing_decoder *decoder);

/* Whether nothing has come since the last delimiter. */
bool framing_is_empty(const struct framing_decoder *decoder);

/* Write the frame of a payload, with its delimiter, into wire (length + 4 bytes). Puts the CRC behind the payload, which
   needs room for it. Returns the bytes written. */
uint8_t framing_encode(uint8_t *payload, uint8_t length, uint8_t *wire);

#endif
