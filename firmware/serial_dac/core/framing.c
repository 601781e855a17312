#include "framing.h"

#define CRC_START 0xFFFFU
#define CRC_POLYNOMIAL 0x1021U
#define CRC_TOP 0x8000U

static uint16_t crc_step(uint16_t crc, uint8_t byte)
{
    crc ^= (uint16_t)((uint16_t)byte << 8);
    for (uint8_t bit = 0U; bit < 8U; bit++) {
        const bool top = (crc & CRC_TOP) != 0U;
        crc = (uint16_t)((uint16_t)crc << 1);
        if (top) {
            crc ^= CRC_POLYNOMIAL;
        }
    }
    return crc;
}

/* Every received byte but the first adds one decoded byte: a length byte stands for the zero before its piece. */
static void append(struct framing_decoder *decoder, uint8_t byte)
{
    const uint8_t at = (uint8_t)(decoder->received - 1U);

    decoder->data[at] = byte;
    if (at >= FRAMING_CRC_BYTES) {
        decoder->crc = crc_step(decoder->crc, decoder->data[at - FRAMING_CRC_BYTES]);
    }
}

void framing_push(struct framing_decoder *decoder, uint8_t byte)
{
    if (decoder->received >= FRAMING_LONGEST_FRAME) {
        decoder->received = (uint8_t)(FRAMING_LONGEST_FRAME + 1U);
        return;
    }
    if (decoder->received == 0U) {
        decoder->crc = CRC_START;
        decoder->left = (uint8_t)(byte - 1U);
    } else if (decoder->left == 0U) {
        decoder->left = (uint8_t)(byte - 1U);
        append(decoder, 0U);
    } else {
        decoder->left--;
        append(decoder, byte);
    }
    decoder->received++;
}

bool framing_is_empty(const struct framing_decoder *decoder)
{
    return decoder->received == 0U;
}

uint8_t framing_end(struct framing_decoder *decoder)
{
    const uint8_t received = decoder->received;

    decoder->received = 0U;
    /* One length byte, one byte of payload and the CRC at least. */
    if ((received < FRAMING_CRC_BYTES + 2U) || (received > FRAMING_LONGEST_FRAME) || (decoder->left != 0U)) {
        return 0U;
    }
    const uint8_t length = (uint8_t)(received - 1U - FRAMING_CRC_BYTES);
    const uint16_t high = (uint16_t)((uint16_t)decoder->data[length + 1U] << 8);
    if (decoder->crc != (uint16_t)(decoder->data[length] | high)) {
        return 0U;
    }
    return length;
}

uint8_t framing_encode(uint8_t *payload, uint8_t length, uint8_t *wire)
{
    uint16_t crc = CRC_START;
    uint8_t start = 0U; /* where the length of the piece that is being written goes */
    uint8_t end = 1U;

    for (uint8_t n = 0U; n < length; n++) {
        crc = crc_step(crc, payload[n]);
    }
    payload[length] = (uint8_t)(crc & 0xFFU);
    payload[length + 1U] = (uint8_t)(crc >> 8);
    for (uint8_t n = 0U; n < length + FRAMING_CRC_BYTES; n++) {
        if (payload[n] == 0U) {
            wire[start] = (uint8_t)(end - start);
            start = end;
        } else {
            wire[end] = payload[n];
        }
        end++;
    }
    wire[start] = (uint8_t)(end - start);
    wire[end] = 0U;
    return (uint8_t)(end + 1U);
}
