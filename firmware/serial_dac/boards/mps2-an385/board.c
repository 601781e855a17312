/* QEMU's mps2-an385: a Cortex-M3 at 25 MHz with CMSDK timers and UARTs. Encoder, DAC and fault inputs are words of memory
 * that QEMU shares with the bench (boards/bench.h). Arm DAI 0385, "ARM MPS2 FPGA prototyping board", has the memory map and
 * interrupt numbers; Arm DDI 0479, "Cortex-M System Design Kit", the registers of timer and UART.
 */
#include "board.h"

#include "../bench.h"
#include "../cortex-m/cortex_m.h"
#include "core.h"

struct timer {
    volatile uint32_t control;
    volatile uint32_t value;
    volatile uint32_t reload;
    volatile uint32_t interrupt; /* read: pending; write 1: clear */
};

struct uart {
    volatile uint32_t data;
    volatile uint32_t state;
    volatile uint32_t control;
    volatile uint32_t interrupt; /* read: pending; write 1: clear */
    volatile uint32_t divider;
};

#define WATCHDOG_TIMER ((struct timer *)0x40000000U)
#define CLOCK_TIMER ((struct timer *)0x40001000U)
#define UART0 ((struct uart *)0x40004000U)
#define PAGE ((volatile struct bench_page *)0x21000000U)

#define CYCLES_PER_US 25U
#define CYCLES_PER_MS 25000U

#define TIMER_RUN 0x1U
#define TIMER_INTERRUPT 0x8U
#define UART_TRANSMIT 0x1U
#define UART_RECEIVE 0x2U
#define UART_TRANSMIT_INTERRUPT 0x4U
#define UART_RECEIVE_INTERRUPT 0x8U
#define UART_TX_FULL 0x1U /* of state */
#define UART_RX_FULL 0x2U
#define UART_RX_OVERRUN 0x8U

enum { IRQ_UART0_RX = 0, IRQ_UART0_TX = 1, IRQ_WATCHDOG = 8, INTERRUPTS = 32 };
enum { PRIORITY_WATCHDOG = 0x20, PRIORITY_TICK = 0x40, PRIORITY_UART = 0x60 };

const struct board_facts board_facts = {
    .dac_bits = 14,
    .full_scale_ua = 6000000,
    .counter_bits = 32,
    .watchdog_min_ms = 2,
    .watchdog_max_ms = 10000,
    .serial_number = 385,
};

static uint16_t dac_code;
static uint32_t enabled;
static uint32_t clock_us;
static uint32_t clock_last;
static uint32_t clock_rest;

void board_dac_write(uint16_t code)
{
    dac_code = code;
    bench_put(PAGE, board_time_us(), dac_code, enabled);
}

void board_enable(bool on)
{
    const uint32_t wanted = on ? 1U : 0U;

    if (wanted != enabled) {
        enabled = wanted;
        bench_put(PAGE, board_time_us(), dac_code, enabled);
    }
}

uint32_t board_count(void)
{
    return PAGE->count;
}

/* The timer wraps after 171 s; the tick looks at it every millisecond. */
uint32_t board_time_us(void)
{
    const uint32_t before = board_interrupts_off();
    const uint32_t value = CLOCK_TIMER->value;
    const uint32_t cycles = (clock_last - value) + clock_rest; /* it counts down */

    clock_last = value;
    clock_us += cycles / CYCLES_PER_US;
    clock_rest = cycles % CYCLES_PER_US;
    const uint32_t now = clock_us;
    board_interrupts_restore(before);
    return now;
}

uint8_t board_causes(void)
{
    return (uint8_t)PAGE->causes;
}

void board_watchdog_stop(void)
{
    WATCHDOG_TIMER->control = 0U;
    WATCHDOG_TIMER->interrupt = 1U;
    nvic_clear_pending(IRQ_WATCHDOG);
}

void board_watchdog_start(uint16_t milliseconds)
{
    board_watchdog_stop();
    WATCHDOG_TIMER->reload = milliseconds * CYCLES_PER_MS;
    WATCHDOG_TIMER->value = milliseconds * CYCLES_PER_MS;
    WATCHDOG_TIMER->control = TIMER_RUN | TIMER_INTERRUPT;
}

/* The transmitter interrupts when its buffer becomes empty, not while it is: the first byte is put there here. */
static void feed_transmitter(void)
{
    uint8_t byte;

    while (((UART0->state & UART_TX_FULL) == 0U) && core_next_byte(&byte)) {
        UART0->data = byte;
    }
}

void board_start_sending(void)
{
    feed_transmitter();
}

uint32_t board_interrupts_off(void)
{
    return cortex_interrupts_off();
}

void board_interrupts_restore(uint32_t before)
{
    cortex_interrupts_restore(before);
}

/* A byte that comes between the last look and the return raises the interrupt again only if it was cleared before that
   look: clear first, then empty the receiver. */
static void uart_rx_interrupt(void)
{
    UART0->interrupt = UART_RECEIVE;
    while ((UART0->state & UART_RX_FULL) != 0U) {
        core_receive((uint8_t)UART0->data);
    }
    if ((UART0->state & UART_RX_OVERRUN) != 0U) {
        UART0->state = UART_RX_OVERRUN;
        core_receive_error();
    }
}

static void uart_tx_interrupt(void)
{
    UART0->interrupt = UART_TRANSMIT;
    feed_transmitter();
}

static void watchdog_interrupt(void)
{
    board_watchdog_stop();
    core_watchdog_expired();
}

static void tick_interrupt(void)
{
    (void)board_time_us();
    core_poll();
}

static void start(void)
{
    core_begin(); /* the output first */
    CLOCK_TIMER->reload = 0xFFFFFFFFU;
    CLOCK_TIMER->value = 0xFFFFFFFFU;
    clock_last = 0xFFFFFFFFU;
    CLOCK_TIMER->control = TIMER_RUN;
    UART0->divider = 16U; /* the fastest; QEMU takes any */
    UART0->control = UART_TRANSMIT | UART_RECEIVE | UART_TRANSMIT_INTERRUPT | UART_RECEIVE_INTERRUPT;
    nvic_enable(IRQ_WATCHDOG, PRIORITY_WATCHDOG);
    nvic_enable(IRQ_UART0_RX, PRIORITY_UART);
    nvic_enable(IRQ_UART0_TX, PRIORITY_UART);
    systick_start(CYCLES_PER_MS, PRIORITY_TICK);
    for (;;) {
        cortex_wait();
    }
}

void reset(void)
{
    cortex_begin_memory();
    start();
}

CORTEX_VECTORS(INTERRUPTS, reset, tick_interrupt, [IRQ_UART0_RX] = uart_rx_interrupt, [IRQ_UART0_TX] = uart_tx_interrupt,
               [IRQ_WATCHDOG] = watchdog_interrupt)
