/* What a board gives the core: a dozen functions and its facts. Everything else is the same on all boards.
 *
 * Interrupts that call into the core (core.h) may interrupt each other. The core guards its state with
 * board_interrupts_off; so a board may give its watchdog and its encoder a higher priority than its receiver.
 */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stdint.h>

/* What the HELLO reply says of the board. */
struct board_facts {
    uint8_t dac_bits;         /* 8 ... 16 */
    uint32_t full_scale_ua;   /* uA; the current at code 0 is minus this */
    uint8_t counter_bits;     /* 16 ... 32 */
    uint16_t watchdog_min_ms; /* 1 ... CORE_WATCHDOG_POWER_UP_MS */
    uint16_t watchdog_max_ms; /* not below CORE_WATCHDOG_POWER_UP_MS */
    uint32_t serial_number;
};

extern const struct board_facts board_facts;

/* Set the DAC: offset binary, dac_bits wide. Any context. */
void board_dac_write(uint16_t code);

/* The line that switches the output stage. By hardware it is off while the processor is in reset. Any context. */
void board_enable(bool on);

/* The encoder's counter, two's complement in its low counter_bits. Read at once, as a whole. */
uint32_t board_count(void);

/* Microseconds since power-up, modulo 2^32. Read as a whole. */
uint32_t board_time_us(void);

/* Causes of faults that are present now: bits CORE_ENCODER_FAULT, CORE_AMPLIFIER_FAULT, CORE_EXTERNAL_STOP; and CORE_HELD
   while the enable input is closed. A board without one never says so. */
uint8_t board_causes(void);

/* (Re)start the watchdog: core_watchdog_expired is to be called after so many ms, by an interrupt that does not depend on
   the receiver's. */
void board_watchdog_start(uint16_t milliseconds);
void board_watchdog_stop(void);

/* There are bytes to send: from now on call core_next_byte whenever the transmitter takes one, until it has none. */
void board_start_sending(void);

/* Switch interrupts off; what they were before goes to board_interrupts_restore. These pairs nest. */
uint32_t board_interrupts_off(void);
void board_interrupts_restore(uint32_t before);

#endif
