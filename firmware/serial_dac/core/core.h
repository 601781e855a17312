/* The serial DAC board of docs/protocols/serial-dac.md: its messages, output, latched faults and watchdog.
 *
 * A board calls core_begin before it does anything else, then these functions from its interrupts. None of them waits.
 */
#ifndef CORE_H
#define CORE_H

#include <stdbool.h>
#include <stdint.h>

#define CORE_PROTOCOL_VERSION 1U
#define CORE_FIRMWARE 0x0101U /* high byte major, low byte minor */
#define CORE_WATCHDOG_POWER_UP_MS 20U

/* Status bits. */
#define CORE_ENABLED 0x01U
#define CORE_WATCHDOG 0x02U
#define CORE_ENCODER_FAULT 0x04U
#define CORE_AMPLIFIER_FAULT 0x08U
#define CORE_BAD_FRAME 0x10U
#define CORE_REJECTED 0x20U
#define CORE_EXTERNAL_STOP 0x40U
#define CORE_UNCONFIGURED 0x80U

/* Of board_causes alone, in the place of ENABLED: the enable input is closed. */
#define CORE_HELD 0x01U

/* Power-up: output off and at mid-scale, then all else. */
void core_begin(void);

/* The receiver's interrupt: one byte has come. */
void core_receive(uint8_t byte);

/* The receiver's interrupt: a byte was lost or came damaged. The frame that it was part of is bad. */
void core_receive_error(void);

/* The transmitter's interrupt: the next byte to send; false when there is none. */
bool core_next_byte(uint8_t *byte);

/* The watchdog's interrupt: its time has passed. */
void core_watchdog_expired(void);

/* At least once a millisecond: look at the causes of faults. */
void core_poll(void);

#endif
