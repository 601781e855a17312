#include "core.h"

#include "board.h"
#include "framing.h"

enum { HELLO = 0x01, CONFIGURE = 0x02, SAMPLE = 0x03, COMMAND = 0x04, SAMPLE_INPUTS = 0x05 };
enum { HELLO_REPLY = 0x81, CONFIGURE_REPLY = 0x82, SAMPLE_REPLY = 0x83, INPUTS_REPLY = 0x84 };
enum { HELLO_LENGTH = 4, CONFIGURE_LENGTH = 3, SAMPLE_LENGTH = 2, COMMAND_LENGTH = 5 };
enum { HELLO_REPLY_LENGTH = 20, CONFIGURE_REPLY_LENGTH = 3, SAMPLE_REPLY_LENGTH = 12, INPUTS_REPLY_LENGTH = 13 };

#define FLAG_ENABLE 0x01U
#define FLAG_WHILE_HELD 0x02U
#define INPUT_HELD 0x01U
#define INPUT_FAULTS (CORE_ENCODER_FAULT | CORE_AMPLIFIER_FAULT | CORE_EXTERNAL_STOP)
#define LATCHED (CORE_WATCHDOG | INPUT_FAULTS)
#define LONGEST_REPLY ((uint8_t)HELLO_REPLY_LENGTH)
#define QUEUE_BYTES 128U /* a power of two: five HELLO replies, eight SAMPLE replies */

/* What the receiver's interrupt alone touches. */
static struct framing_decoder decoder;
static uint8_t payload_out[LONGEST_REPLY + FRAMING_CRC_BYTES];
static uint8_t wire[LONGEST_REPLY + FRAMING_CRC_BYTES + 2U];

/* What several interrupts touch: with interrupts off only. */
static volatile uint8_t status;
static volatile uint8_t command_seq;
static volatile uint16_t watchdog_ms;
static volatile bool released;   /* latched: the enable input has been open since the last COMMAND with enable 0 */
static volatile bool while_held; /* the output is on for as long as that is not so */

/* Bytes to send. The receiver's interrupt moves the head, the transmitter's the tail. */
static volatile uint8_t queue[QUEUE_BYTES];
static volatile uint8_t queue_head;
static volatile uint8_t queue_tail;

static uint16_t middle(void)
{
    return (uint16_t)((uint32_t)1U << (board_facts.dac_bits - 1U));
}

/* With interrupts off. */
static void disable_output(void)
{
    board_enable(false);
    board_dac_write(middle());
    board_watchdog_stop();
    status &= (uint8_t)~CORE_ENABLED;
}

/* With interrupts off. */
static void set_status(uint8_t bits)
{
    status |= bits;
}

static uint16_t get_u16(const uint8_t *from)
{
    return (uint16_t)(from[0] | (uint16_t)((uint16_t)from[1] << 8));
}

static void put_u16(uint8_t *to, uint16_t value)
{
    to[0] = (uint8_t)(value & 0xFFU);
    to[1] = (uint8_t)(value >> 8);
}

static void put_u32(uint8_t *to, uint32_t value)
{
    put_u16(to, (uint16_t)(value & 0xFFFFU));
    put_u16(&to[2], (uint16_t)(value >> 16));
}

/* Send the first bytes of payload_out as a frame. A frame that finds no room is dropped whole; false then. */
static bool send(uint8_t length)
{
    const uint8_t size = framing_encode(payload_out, length, wire);
    uint8_t head = queue_head;
    const uint8_t used = (uint8_t)((head + QUEUE_BYTES - queue_tail) % QUEUE_BYTES);

    if ((uint8_t)(QUEUE_BYTES - 1U - used) < size) {
        return false;
    }
    for (uint8_t n = 0U; n < size; n++) {
        queue[head] = wire[n];
        head = (uint8_t)((head + 1U) % QUEUE_BYTES);
    }
    queue_head = head;
    board_start_sending();
    return true;
}

bool core_next_byte(uint8_t *byte)
{
    const uint8_t tail = queue_tail;

    if (tail == queue_head) {
        return false;
    }
    *byte = queue[tail];
    queue_tail = (uint8_t)((tail + 1U) % QUEUE_BYTES);
    return true;
}

static void hello(const uint8_t *payload)
{
    const uint32_t before = board_interrupts_off();
    disable_output();
    board_interrupts_restore(before);

    payload_out[0] = (uint8_t)HELLO_REPLY;
    payload_out[1] = CORE_PROTOCOL_VERSION;
    payload_out[2] = payload[2];
    payload_out[3] = payload[3];
    payload_out[4] = board_facts.dac_bits;
    put_u32(&payload_out[5], board_facts.full_scale_ua);
    payload_out[9] = board_facts.counter_bits;
    put_u16(&payload_out[10], board_facts.watchdog_min_ms);
    put_u16(&payload_out[12], board_facts.watchdog_max_ms);
    put_u32(&payload_out[14], board_facts.serial_number);
    put_u16(&payload_out[18], CORE_FIRMWARE);
    (void)send((uint8_t)HELLO_REPLY_LENGTH);
}

static void configure(const uint8_t *payload)
{
    uint16_t wanted = get_u16(&payload[1]);
    const bool in_range = (wanted >= board_facts.watchdog_min_ms) && (wanted <= board_facts.watchdog_max_ms);

    const uint32_t before = board_interrupts_off();
    if (in_range && ((status & CORE_ENABLED) == 0U)) {
        watchdog_ms = wanted;
        status &= (uint8_t)~CORE_UNCONFIGURED;
    } else {
        wanted = 0U;
    }
    board_interrupts_restore(before);

    payload_out[0] = (uint8_t)CONFIGURE_REPLY;
    put_u16(&payload_out[1], wanted);
    (void)send((uint8_t)CONFIGURE_REPLY_LENGTH);
}

static void sample(const uint8_t *payload, uint32_t count, uint32_t time_us)
{
    const bool inputs = payload[0] == (uint8_t)SAMPLE_INPUTS;

    if (inputs) {
        core_poll();
    }
    payload_out[0] = inputs ? (uint8_t)INPUTS_REPLY : (uint8_t)SAMPLE_REPLY;
    payload_out[1] = payload[1];
    put_u32(&payload_out[2], count);
    put_u32(&payload_out[6], time_us);

    const uint32_t before = board_interrupts_off();
    payload_out[10] = status;
    payload_out[11] = command_seq;
    payload_out[12] = (uint8_t)(released ? 0U : INPUT_HELD);
    board_interrupts_restore(before);

    /* Only this interrupt sets BAD_FRAME: what was told is what is cleared. */
    if (send(inputs ? (uint8_t)INPUTS_REPLY_LENGTH : (uint8_t)SAMPLE_REPLY_LENGTH)) {
        const uint32_t again = board_interrupts_off();
        status &= (uint8_t)~CORE_BAD_FRAME;
        board_interrupts_restore(again);
    }
}

/* With interrupts off, so that neither watchdog nor fault comes between the look at the status and the output. */
static void apply_command(uint8_t seq, uint16_t code, uint8_t flags)
{
    const uint32_t last = ((uint32_t)1U << board_facts.dac_bits) - 1U;

    if ((code > last) || ((flags & (uint8_t)~(FLAG_ENABLE | FLAG_WHILE_HELD)) != 0U)) {
        set_status(CORE_REJECTED);
        return;
    }
    if ((flags & FLAG_ENABLE) == 0U) {
        const uint8_t causes = board_causes();
        disable_output();
        status = (uint8_t)((status & (uint8_t)~LATCHED) | (causes & INPUT_FAULTS));
        released = (causes & CORE_HELD) == 0U;
    } else if (((status & (LATCHED | CORE_UNCONFIGURED)) != 0U) || (((flags & FLAG_WHILE_HELD) != 0U) && released)) {
        set_status(CORE_REJECTED);
        return;
    } else {
        board_dac_write(code);
        board_enable(true);
        board_watchdog_start(watchdog_ms);
        set_status(CORE_ENABLED);
        while_held = (flags & FLAG_WHILE_HELD) != 0U;
    }
    status &= (uint8_t)~CORE_REJECTED;
    command_seq = seq;
}

static void command(const uint8_t *payload)
{
    core_poll(); /* a cause that came since the last look refuses this command already */
    const uint32_t before = board_interrupts_off();
    apply_command(payload[1], get_u16(&payload[2]), payload[4]);
    board_interrupts_restore(before);
}

/* Act on a payload; false when there is no such message. */
static bool handle(const uint8_t *payload, uint8_t length, uint32_t count, uint32_t time_us)
{
    bool known = true;

    if (((payload[0] == (uint8_t)SAMPLE) || (payload[0] == (uint8_t)SAMPLE_INPUTS)) && (length == (uint8_t)SAMPLE_LENGTH)) {
        sample(payload, count, time_us);
    } else if ((payload[0] == (uint8_t)COMMAND) && (length == (uint8_t)COMMAND_LENGTH)) {
        command(payload);
    } else if ((payload[0] == (uint8_t)HELLO) && (length == (uint8_t)HELLO_LENGTH)) {
        hello(payload);
    } else if ((payload[0] == (uint8_t)CONFIGURE) && (length == (uint8_t)CONFIGURE_LENGTH)) {
        configure(payload);
    } else {
        known = false;
    }
    return known;
}

void core_receive(uint8_t byte)
{
    if (byte != 0U) {
        framing_push(&decoder, byte);
        return;
    }
    if (framing_is_empty(&decoder)) {
        return;
    }
    /* Latched before anything is computed, whatever the frame turns out to be. */
    const uint32_t count = board_count();
    const uint32_t time_us = board_time_us();
    const uint8_t length = framing_end(&decoder);

    if ((length == 0U) || !handle(decoder.data, length, count, time_us)) {
        const uint32_t before = board_interrupts_off();
        set_status(CORE_BAD_FRAME);
        board_interrupts_restore(before);
    }
}

void core_receive_error(void)
{
    decoder.received = (uint8_t)(FRAMING_LONGEST_FRAME + 1U);
}

void core_watchdog_expired(void)
{
    const uint32_t before = board_interrupts_off();
    if ((status & CORE_ENABLED) != 0U) {
        disable_output();
        set_status(CORE_WATCHDOG);
    }
    board_interrupts_restore(before);
}

void core_poll(void)
{
    const uint32_t before = board_interrupts_off();
    const uint8_t inputs = board_causes();
    const uint8_t causes = (uint8_t)(inputs & INPUT_FAULTS);
    if (causes != 0U) {
        disable_output();
        set_status(causes);
    }
    if ((inputs & CORE_HELD) == 0U) {
        released = true;
        if (while_held && ((status & CORE_ENABLED) != 0U)) {
            disable_output();
        }
    }
    board_interrupts_restore(before);
}

void core_begin(void)
{
    status = CORE_UNCONFIGURED;
    command_seq = 0U;
    released = true;
    while_held = false;
    decoder.received = 0U;
    queue_head = 0U;
    queue_tail = 0U;
    watchdog_ms = CORE_WATCHDOG_POWER_UP_MS;
    disable_output();
}
