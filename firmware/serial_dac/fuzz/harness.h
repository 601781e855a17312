/* The core on a board of plain memory, driven by a string of bytes, with everything checked that must always hold. */
#ifndef HARNESS_H
#define HARNESS_H

#include <stddef.h>
#include <stdint.h>

/* The string is a list of steps, each an opcode and its operands; what is left at the end is not looked at. */
enum step {
    STEP_BYTES,      /* n, n bytes: as they are into the receiver */
    STEP_FRAME,      /* n, n bytes: a payload, sent as a good frame */
    STEP_WATCHDOG,   /* its interrupt comes, whether it runs or not */
    STEP_PENDING,    /* its interrupt comes when the core next switches interrupts on */
    STEP_CAUSES,     /* b: causes of faults from now on */
    STEP_POLL,
    STEP_DRAIN,      /* n: the transmitter takes so many bytes */
    STEP_LINE_ERROR, /* a byte was lost */
    STEPS
};

/* From power-up through the whole string. Aborts where something does not hold. */
void harness_run(const uint8_t *data, size_t size);

/* Replies seen since the start of the program. */
extern unsigned long harness_replies;

#endif
