#include "harness.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "board.h"
#include "core.h"
#include "framing.h"

#define MUST(condition)                                                                  \
    do {                                                                                 \
        if (!(condition)) {                                                              \
            (void)fprintf(stderr, "%s:%d: not so: %s\n", __FILE__, __LINE__, #condition); \
            abort();                                                                     \
        }                                                                                \
    } while (0)

const struct board_facts board_facts = {
    .dac_bits = 12,
    .full_scale_ua = 4000000,
    .counter_bits = 24,
    .watchdog_min_ms = 2,
    .watchdog_max_ms = 5000,
    .serial_number = 0x00AB00CD,
};

#define MIDDLE 2048U
#define CAUSES (CORE_ENCODER_FAULT | CORE_AMPLIFIER_FAULT | CORE_EXTERNAL_STOP)

unsigned long harness_replies;

static struct {
    uint16_t code;
    bool on;
    uint16_t watchdog_ms; /* 0: stopped */
    uint8_t causes;
    uint8_t seen; /* causes when the core last looked */
    bool opened;  /* the enable input, as far as the core has looked since the last COMMAND with enable 0 */
    bool may_not; /* be switched on by the COMMAND at hand */
    bool pending;
    bool off; /* interrupts */
    uint32_t time_us;
    unsigned int started; /* the watchdog, so often */
    unsigned int sent;    /* replies */
    uint8_t line[64];     /* being sent */
    size_t length;
    uint8_t frame[64]; /* being received */
    size_t received;
    bool lost; /* a byte of it */
} board;

void board_dac_write(uint16_t code)
{
    MUST(code < 2U * MIDDLE);
    board.code = code;
}

void board_enable(bool on)
{
    MUST(board.off);
    board.on = on;
}

uint32_t board_count(void)
{
    return 0xFFFFFF00U;
}

uint32_t board_time_us(void)
{
    board.time_us += 1000U;
    return board.time_us;
}

uint8_t board_causes(void)
{
    board.seen = board.causes;
    board.opened = board.opened || ((board.causes & CORE_HELD) == 0U);
    return board.causes;
}

void board_watchdog_start(uint16_t milliseconds)
{
    MUST((milliseconds >= board_facts.watchdog_min_ms) && (milliseconds <= board_facts.watchdog_max_ms));
    board.watchdog_ms = milliseconds;
    board.started++;
}

void board_watchdog_stop(void)
{
    board.watchdog_ms = 0;
}

void board_start_sending(void)
{
    board.sent++;
}

uint32_t board_interrupts_off(void)
{
    const bool before = board.off;

    board.off = true;
    return before ? 1U : 0U;
}

static void settled(void)
{
    MUST(board.on ? (board.watchdog_ms != 0) : (board.code == MIDDLE));
    MUST(!board.on || ((board.seen & CAUSES) == 0U));
}

static void expire(void)
{
    board.pending = false;
    core_watchdog_expired();
    MUST(!board.on);
}

void board_interrupts_restore(uint32_t before)
{
    MUST(board.off);
    board.off = before != 0U;
    if (!board.off) {
        settled();
        if (board.pending) {
            expire();
        }
    }
}

/* A second reading of the page: the payload of what stood before a delimiter, with its CRC behind it. Its length; 0: bad. */
static size_t decode(const uint8_t *wire, size_t length, uint8_t *data)
{
    size_t size = 0;
    size_t at = 0;
    uint16_t crc = 0xFFFFU;

    while (at < length) {
        const size_t next = at + wire[at];
        if (next > length) {
            return 0;
        }
        if (at > 0) {
            data[size++] = 0U;
        }
        memcpy(&data[size], &wire[at + 1], next - at - 1);
        size += next - at - 1;
        at = next;
    }
    if ((size < 3) || (size > 34)) {
        return 0;
    }
    for (size_t n = 0; n < size - 2; n++) {
        for (int bit = 7; bit >= 0; bit--) {
            const bool top = (((crc >> 15) ^ (data[n] >> bit)) & 1) != 0;
            crc = (uint16_t)((crc << 1) ^ (top ? 0x1021 : 0));
        }
    }
    return ((data[size - 2] == (crc & 0xFFU)) && (data[size - 1] == crc >> 8)) ? size - 2 : 0;
}

static void check_reply(void)
{
    static const uint8_t lengths[] = {20, 3, 12, 13};
    uint8_t data[sizeof board.line];
    const size_t size = decode(board.line, board.length, data);

    MUST((size > 0) && (data[0] >= 0x81U) && (data[0] <= 0x84U) && (size == lengths[data[0] - 0x81U]));
    if (data[0] >= 0x83U) {
        const uint8_t status = data[10];
        MUST((size == 12) || (data[12] <= 1U));
        MUST(((status & CORE_ENABLED) == 0U) || ((status & (CAUSES | CORE_WATCHDOG | CORE_UNCONFIGURED)) == 0U));
    }
    harness_replies++;
}

static void drain(size_t most)
{
    uint8_t byte;

    while ((most-- > 0) && core_next_byte(&byte)) {
        if (byte != 0U) {
            MUST(board.length < sizeof board.line);
            board.line[board.length++] = byte;
        } else {
            check_reply();
            board.length = 0;
        }
    }
}

/* Whether the frame that ends here may do anything: it is whole, and such a message is sent to boards. */
static bool is_message(void)
{
    static const uint8_t lengths[] = {4, 3, 2, 5, 2};
    uint8_t data[sizeof board.frame];
    const size_t size = ((board.received > 35) || board.lost) ? 0 : decode(board.frame, board.received, data);
    const bool known = (size > 0) && (data[0] >= 1U) && (data[0] <= 5U) && (size == lengths[data[0] - 1U]);

    if (known && (data[0] == 4U) && (data[3] < 0x10U) && (data[4] <= 3U)) {
        /* A COMMAND that is not refused for its form: enable 0 forgets that the enable was released, enable 1 may wait for it. */
        if ((data[4] & 1U) == 0U) {
            board.opened = (board.causes & CORE_HELD) == 0U;
        } else if ((data[4] & 2U) != 0U) {
            board.may_not = board.opened || ((board.causes & CORE_HELD) == 0U);
        }
    }
    return known;
}

static void receive_byte(uint8_t byte)
{
    const uint16_t code = board.code;
    const bool on = board.on;
    const unsigned int started = board.started;
    const unsigned int sent = board.sent;
    board.may_not = false;
    const bool may_act = (byte == 0U) && is_message();

    core_receive(byte);
    MUST(!board.may_not || (board.code == code) || !board.on);
    MUST(!board.may_not || (board.started == started));
    MUST(!board.off);
    settled();
    if (!may_act) {
        MUST((board.started == started) && (board.sent == sent));
        MUST(!board.on || (on && (board.code == code)));
    }
    if (byte == 0U) {
        board.received = 0;
        board.lost = false;
    } else if (board.received < sizeof board.frame) {
        board.frame[board.received++] = byte;
    }
}

static void receive(const uint8_t *bytes, size_t size)
{
    for (size_t n = 0; n < size; n++) {
        receive_byte(bytes[n]);
    }
}

static void step(enum step what, const uint8_t *bytes, size_t size)
{
    uint8_t payload[FRAMING_LONGEST_PAYLOAD + FRAMING_CRC_BYTES] = {0};
    uint8_t wire[FRAMING_LONGEST_FRAME + 1U];

    switch (what) {
    case STEP_BYTES:
        receive(bytes, size);
        break;
    case STEP_FRAME:
        size = (size > FRAMING_LONGEST_PAYLOAD) ? FRAMING_LONGEST_PAYLOAD : size;
        memcpy(payload, bytes, size);
        receive(wire, framing_encode(payload, (uint8_t)size, wire));
        break;
    case STEP_WATCHDOG:
        expire();
        break;
    case STEP_PENDING:
        board.pending = true;
        break;
    case STEP_CAUSES:
        board.causes = (size > 0) ? (bytes[0] & (CAUSES | CORE_HELD)) : 0U;
        break;
    case STEP_POLL:
        core_poll();
        MUST(!board.on || ((board.causes & CAUSES) == 0U));
        break;
    case STEP_DRAIN:
        drain((size > 0) ? bytes[0] : 255U);
        break;
    default:
        core_receive_error();
        board.lost = true;
        break;
    }
    settled();
}

void harness_run(const uint8_t *data, size_t size)
{
    memset(&board, 0, sizeof board);
    board.off = true; /* as in reset */
    board.opened = true;
    core_begin();
    MUST(!board.on && (board.code == MIDDLE) && (board.watchdog_ms == 0));
    board.off = false;
    for (size_t at = 0; at < size;) {
        const enum step what = (enum step)(data[at] % STEPS);
        const bool listed = (what == STEP_BYTES) || (what == STEP_FRAME);
        const bool one = (what == STEP_CAUSES) || (what == STEP_DRAIN);
        size_t count = one ? 1U : 0U;
        at++;
        if (listed && (at < size)) {
            count = data[at++];
        }
        if (count > size - at) {
            count = size - at;
        }
        step(what, &data[at], count);
        at += count;
    }
    drain(1000);
}
