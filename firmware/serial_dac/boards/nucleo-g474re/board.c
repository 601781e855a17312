/* ST NUCLEO-G474RE (STM32G474RE) with an AD5662 as DAC. Compiles; has not been run on silicon. Pins: README.md.
 *
 * TIM2 counts the encoder, TIM5 microseconds, TIM6 is the watchdog, SysTick the millisecond; USART2 goes to the ST-LINK.
 */
#include "board.h"

#include "../cortex-m/cortex_m.h"
#include "core.h"
#include "stm32g474.h"

#define CLOCK_HZ 64000000U
#define BAUD 2000000U
#define BIT(n) ((uint32_t)1U << (n))

/* Pins */
#define A_STOP 8U         /* PA8, D7: high when the stop circuit is open */
#define A_RELEASED 10U    /* PA10, D2: low while the enable switch is held */
#define A_NO_AMP_FAULT 9U /* PA9, D8: low when the amplifier reports a fault */
#define B_ENABLE 10U      /* PB10, D6 */
#define C_CS 7U           /* PC7, D9 */

#define MODE_INPUT 0U
#define MODE_OUTPUT 1U
#define MODE_FUNCTION 2U
#define PULL_UP 1U

#define TIM_ENABLE BIT(0)
#define TIM_OVERFLOW_ONLY BIT(2)
#define TIM_ONE_PULSE BIT(3)
#define TIM_UPDATE BIT(0)           /* of dier, sr and egr */
#define TIM_ENCODER_X4 3U           /* of smcr */
#define TIM_TRANSITION_ERROR BIT(23) /* of sr */
#define TIM_INPUTS_FILTERED 0x3131U /* of ccmr1: both channels inputs, 8 samples of the clock */

#define USART_ENABLE BIT(0)
#define USART_BOTH_WAYS (BIT(2) | BIT(3) | BIT(5) | BIT(29)) /* with the receiver's interrupt and the FIFO */
#define USART_TX_INTERRUPT BIT(7)
#define USART_ERRORS 0x0FU /* of isr and icr: parity, framing, noise, overrun */
#define USART_RX_READY BIT(5)
#define USART_TX_READY BIT(7)

#define SPI_MASTER_MODE_1 (BIT(0) | BIT(2) | BIT(3) | BIT(8) | BIT(9)) /* data on the falling edge, clock / 4 */
#define SPI_ENABLE BIT(6)
#define SPI_8_BITS 0x1700U
#define SPI_TX_READY BIT(1)
#define SPI_BUSY BIT(7)

#define ENCODER_ERROR_MS 10U
enum { PRIORITY_WATCHDOG = 0x10, PRIORITY_TICK = 0x20, PRIORITY_USART = 0x30 };

const struct board_facts board_facts = {
    .dac_bits = 16,
    .full_scale_ua = 6000000,
    .counter_bits = 32,
    .watchdog_min_ms = 1,
    .watchdog_max_ms = 10000,
    .serial_number = 474,
};

static volatile uint8_t encoder_error_ms;

uint32_t board_interrupts_off(void)
{
    return cortex_interrupts_off();
}

void board_interrupts_restore(uint32_t before)
{
    cortex_interrupts_restore(before);
}

static void spi_send(uint8_t byte)
{
    while ((SPI1_SR & SPI_TX_READY) == 0U) {
    }
    SPI1_DR = byte;
}

/* 24 bits: eight of them normal operation, then the code; the output follows the last one. */
void board_dac_write(uint16_t code)
{
    const uint32_t before = board_interrupts_off();

    GPIOC->set_reset = BIT(C_CS + 16U);
    spi_send(0U);
    spi_send((uint8_t)(code >> 8));
    spi_send((uint8_t)(code & 0xFFU));
    while ((SPI1_SR & SPI_BUSY) != 0U) {
    }
    GPIOC->set_reset = BIT(C_CS);
    board_interrupts_restore(before);
}

void board_enable(bool on)
{
    GPIOB->set_reset = on ? BIT(B_ENABLE) : BIT(B_ENABLE + 16U);
}

uint32_t board_count(void)
{
    return TIM2->cnt;
}

uint32_t board_time_us(void)
{
    return TIM5->cnt;
}

uint8_t board_causes(void)
{
    const uint32_t pins = GPIOA->in;
    uint8_t causes = 0U;

    if ((TIM2->sr & TIM_TRANSITION_ERROR) != 0U) {
        TIM2->sr = ~TIM_TRANSITION_ERROR;
        encoder_error_ms = ENCODER_ERROR_MS;
    }
    if (encoder_error_ms != 0U) {
        causes |= CORE_ENCODER_FAULT;
    }
    if ((pins & BIT(A_NO_AMP_FAULT)) == 0U) {
        causes |= CORE_AMPLIFIER_FAULT;
    }
    if ((pins & BIT(A_STOP)) != 0U) {
        causes |= CORE_EXTERNAL_STOP;
    }
    if ((pins & BIT(A_RELEASED)) == 0U) {
        causes |= CORE_HELD;
    }
    return causes;
}

void board_watchdog_stop(void)
{
    TIM6->cr1 = TIM_OVERFLOW_ONLY | TIM_ONE_PULSE;
    TIM6->sr = 0U;
    nvic_clear_pending(IRQ_TIM6);
}

void board_watchdog_start(uint16_t milliseconds)
{
    board_watchdog_stop();
    TIM6->arr = milliseconds;
    TIM6->egr = TIM_UPDATE; /* begins at 0, the prescaler too */
    TIM6->cr1 = TIM_OVERFLOW_ONLY | TIM_ONE_PULSE | TIM_ENABLE;
}

void board_start_sending(void)
{
    const uint32_t before = board_interrupts_off();

    USART2->cr1 |= USART_TX_INTERRUPT;
    board_interrupts_restore(before);
}

static void usart_interrupt(void)
{
    uint8_t byte;

    if ((USART2->isr & USART_ERRORS) != 0U) {
        USART2->icr = USART_ERRORS;
        core_receive_error();
    }
    while ((USART2->isr & USART_RX_READY) != 0U) {
        core_receive((uint8_t)USART2->rdr);
    }
    while (((USART2->isr & USART_TX_READY) != 0U) && ((USART2->cr1 & USART_TX_INTERRUPT) != 0U)) {
        if (core_next_byte(&byte)) {
            USART2->tdr = byte;
        } else {
            USART2->cr1 &= ~USART_TX_INTERRUPT;
        }
    }
}

static void watchdog_interrupt(void)
{
    board_watchdog_stop();
    core_watchdog_expired();
}

static void tick_interrupt(void)
{
    IWDG_KR = 0xAAAAU;
    if (encoder_error_ms != 0U) {
        encoder_error_ms--;
    }
    core_poll();
}

static void pin(struct gpio *port, uint32_t number, uint32_t mode, uint32_t pull, uint32_t function)
{
    const uint32_t at = 4U * (number % 8U);

    port->function[number / 8U] = (port->function[number / 8U] & ~(0xFU << at)) | (function << at);
    port->pull = (port->pull & ~(3U << (2U * number))) | (pull << (2U * number));
    port->speed |= 2U << (2U * number);
    port->mode = (port->mode & ~(3U << (2U * number))) | (mode << (2U * number));
}

/* 16 MHz / 4 * 32 / 2 = 64 MHz, with two wait states of the flash. */
static void start_clock(void)
{
    FLASH_ACR = 2U | BIT(8) | BIT(9) | BIT(10);
    RCC_PLLCFGR = 2U | (3U << 4) | (32U << 8) | BIT(24);
    RCC_CR |= BIT(24);
    while ((RCC_CR & BIT(25)) == 0U) {
    }
    RCC_CFGR = 3U;
    while ((RCC_CFGR & (3U << 2)) != (3U << 2)) {
    }
}

static void start_output(void)
{
    RCC_AHB2ENR = BIT(0) | BIT(1) | BIT(2);
    RCC_APB1ENR1 = BIT(0) | BIT(3) | BIT(4) | BIT(17); /* TIM2, TIM5, TIM6, USART2 */
    RCC_APB2ENR = BIT(12);                             /* SPI1 */
    (void)RCC_APB2ENR;                                 /* a peripheral is there two clocks later */
    board_enable(false);
    GPIOC->set_reset = BIT(C_CS);
    pin(GPIOB, B_ENABLE, MODE_OUTPUT, 0U, 0U);
    pin(GPIOC, C_CS, MODE_OUTPUT, 0U, 0U);
    pin(GPIOA, 5U, MODE_FUNCTION, 0U, 5U); /* SCK, D13 */
    pin(GPIOA, 7U, MODE_FUNCTION, 0U, 5U); /* MOSI, D11 */
    SPI1_CR2 = SPI_8_BITS;
    SPI1_CR1 = SPI_MASTER_MODE_1;
    SPI1_CR1 = SPI_MASTER_MODE_1 | SPI_ENABLE;
    TIM6->dier = TIM_UPDATE;
    TIM6->psc = (CLOCK_HZ / 1000U) - 1U;
    core_begin();
}

static void start_inputs(void)
{
    pin(GPIOA, 0U, MODE_FUNCTION, PULL_UP, 1U); /* encoder A */
    pin(GPIOA, 1U, MODE_FUNCTION, PULL_UP, 1U); /* encoder B */
    pin(GPIOA, 2U, MODE_FUNCTION, 0U, 7U);      /* to the ST-LINK */
    pin(GPIOA, 3U, MODE_FUNCTION, PULL_UP, 7U); /* from the ST-LINK */
    pin(GPIOA, A_STOP, MODE_INPUT, PULL_UP, 0U);
    pin(GPIOA, A_RELEASED, MODE_INPUT, PULL_UP, 0U);
    pin(GPIOA, A_NO_AMP_FAULT, MODE_INPUT, PULL_UP, 0U);
    TIM2->smcr = TIM_ENCODER_X4;
    TIM2->ccmr1 = TIM_INPUTS_FILTERED;
    TIM2->arr = 0xFFFFFFFFU;
    TIM2->cr1 = TIM_ENABLE;
    TIM5->psc = (CLOCK_HZ / 1000000U) - 1U;
    TIM5->arr = 0xFFFFFFFFU;
    TIM5->egr = TIM_UPDATE;
    TIM5->cr1 = TIM_ENABLE;
    USART2->brr = CLOCK_HZ / BAUD;
    USART2->cr1 = USART_BOTH_WAYS; /* the FIFO is chosen while it is off */
    USART2->cr1 = USART_BOTH_WAYS | USART_ENABLE;
}

/* Without the tick for 50 ms: reset, and so off. */
static void start_reset_watchdog(void)
{
    IWDG_KR = 0xCCCCU;
    IWDG_KR = 0x5555U;
    IWDG_PR = 0U; /* 32 kHz / 4 */
    IWDG_RLR = 400U;
    IWDG_KR = 0xAAAAU;
}

void reset(void)
{
    cortex_begin_memory();
    start_output();
    start_clock();
    start_inputs();
    nvic_enable(IRQ_TIM6, PRIORITY_WATCHDOG);
    nvic_enable(IRQ_USART2, PRIORITY_USART);
    systick_start(CLOCK_HZ / 1000U, PRIORITY_TICK);
    start_reset_watchdog();
    for (;;) {
        cortex_wait();
    }
}

CORTEX_VECTORS(INTERRUPTS, reset, tick_interrupt, [IRQ_USART2] = usart_interrupt, [IRQ_TIM6] = watchdog_interrupt)
