/* The page of memory that an emulated board shares with `python -m sim_hw firmware`: the shaft's side of the board.
 *
 * The other reading of this layout is sim_hw/firmware/_page.py. Little-endian 32-bit words.
 */
#ifndef BENCH_H
#define BENCH_H

#include <stdint.h>

#define BENCH_OUTPUTS 128U /* a power of two */

/* What was put out at one instant. */
struct bench_output {
    uint32_t time_us; /* the board's clock */
    uint32_t code;    /* of the DAC */
    uint32_t enabled; /* the enable line */
    uint32_t unused;
};

struct bench_page {
    uint32_t count;   /* from the bench: the encoder's counter */
    uint32_t causes;  /* from the bench: bits as of board_causes */
    uint32_t written; /* from the board: outputs so far, across resets; the last is output[(written - 1) % BENCH_OUTPUTS] */
    uint32_t unused;
    struct bench_output output[BENCH_OUTPUTS];
};

/* Write down an output. With interrupts off. */
static inline void bench_put(volatile struct bench_page *page, uint32_t time_us, uint16_t code, uint32_t enabled)
{
    volatile struct bench_output *output = &page->output[page->written % BENCH_OUTPUTS];

    output->time_us = time_us;
    output->code = code;
    output->enabled = enabled;
    __atomic_thread_fence(__ATOMIC_RELEASE);
    page->written = page->written + 1U;
}

#endif
