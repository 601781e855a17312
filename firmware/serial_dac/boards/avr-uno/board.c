/* Arduino Uno (ATmega328P, 16 MHz) with an MCP4922 as DAC. Registers: Microchip DS40002061, "ATmega48A/PA/88A/PA/168A/PA/
 * 328/P"; DAC: Microchip DS22250, "MCP4902/4912/4922". Pins: README.md.
 */
#include "board.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "core.h"

/* Port B */
#define PIN_ENABLE _BV(0) /* D8 */
#define PIN_CS _BV(2)     /* D10 */
#define PIN_MOSI _BV(3)   /* D11 */
#define PIN_SCK _BV(5)    /* D13 */
/* Port D */
#define ENCODER_SHIFT 2U       /* A on D2, B on D3 */
#define PIN_RELEASED _BV(4)    /* D4: low while the enable switch is held */
#define PIN_STOP _BV(6)        /* D6: high when the stop circuit is open */
#define PIN_NO_AMP_FAULT _BV(7) /* D7: low when the amplifier reports a fault */

#define DAC_CHANNEL_A 0x3000U /* write A, unbuffered, gain 1, active */
#define UBRR_500K 3U          /* 16 MHz / 8 / (3 + 1), with U2X: exact */
#define ENCODER_ERROR_MS 10U
#define RING_BYTES 64U /* a power of two */

const struct board_facts board_facts = {
    .dac_bits = 12,
    .full_scale_ua = 6000000,
    .counter_bits = 32,
    .watchdog_min_ms = 2,
    .watchdog_max_ms = 10000,
    .serial_number = 328,
};

static volatile uint32_t count;
static volatile uint8_t encoder_last;
static volatile uint8_t encoder_error_ms; /* ENCODER_FAULT's cause counts as present so long after a wrong transition */
static volatile uint32_t overflows;       /* of timer 1 */
static volatile uint16_t watchdog_left_ms;

static volatile uint8_t ring[RING_BYTES];
static volatile uint8_t ring_head;
static volatile uint8_t ring_tail;
static volatile bool ring_overrun;
static volatile bool receiving;

uint32_t board_interrupts_off(void)
{
    const uint8_t before = SREG;

    cli();
    return before;
}

void board_interrupts_restore(uint32_t before)
{
    SREG = (uint8_t)before;
}

static void spi_send(uint8_t byte)
{
    SPDR = byte;
    while ((SPSR & _BV(SPIF)) == 0U) {
    }
}

void board_dac_write(uint16_t code)
{
    const uint32_t before = board_interrupts_off();
    const uint16_t word = DAC_CHANNEL_A | code;

    PORTB &= (uint8_t)~PIN_CS;
    spi_send((uint8_t)(word >> 8));
    spi_send((uint8_t)(word & 0xFFU));
    PORTB |= PIN_CS; /* LDAC is tied low: the output follows here */
    board_interrupts_restore(before);
}

void board_enable(bool on)
{
    if (on) {
        PORTB |= PIN_ENABLE;
    } else {
        PORTB &= (uint8_t)~PIN_ENABLE;
    }
}

uint32_t board_count(void)
{
    const uint32_t before = board_interrupts_off();
    const uint32_t now = count;

    board_interrupts_restore(before);
    return now;
}

/* Timer 1 counts half microseconds. */
uint32_t board_time_us(void)
{
    const uint32_t before = board_interrupts_off();
    const uint16_t value = TCNT1;
    uint32_t wraps = overflows;

    if (((TIFR1 & _BV(TOV1)) != 0U) && (value < 0x8000U)) {
        wraps++; /* it wrapped after interrupts went off */
    }
    board_interrupts_restore(before);
    return (wraps << 15) + (value >> 1);
}

uint8_t board_causes(void)
{
    const uint8_t pins = PIND;
    uint8_t causes = 0U;

    if (encoder_error_ms != 0U) {
        causes |= CORE_ENCODER_FAULT;
    }
    if ((pins & PIN_NO_AMP_FAULT) == 0U) {
        causes |= CORE_AMPLIFIER_FAULT;
    }
    if ((pins & PIN_STOP) != 0U) {
        causes |= CORE_EXTERNAL_STOP;
    }
    if ((pins & PIN_RELEASED) == 0U) {
        causes |= CORE_HELD;
    }
    return causes;
}

void board_watchdog_start(uint16_t milliseconds)
{
    /* The millisecond that is under way does not count, nor one that has ended and waits for its interrupt. */
    const uint16_t begun = ((TIFR0 & _BV(OCF0A)) != 0U) ? 2U : 1U;

    watchdog_left_ms = (uint16_t)(milliseconds + begun);
}

void board_watchdog_stop(void)
{
    watchdog_left_ms = 0U;
}

void board_start_sending(void)
{
    const uint32_t before = board_interrupts_off();

    UCSR0B |= _BV(UDRIE0);
    board_interrupts_restore(before);
}

/* Gray code: which way from the last state to this one; a change of both lines is one that was missed. */
static inline void encoder_edge(void)
{
    static const int8_t steps[16] = {0, 1, -1, 2, -1, 0, 2, 1, 1, 2, 0, -1, 2, -1, 1, 0};
    const uint8_t now = (uint8_t)((PIND >> ENCODER_SHIFT) & 3U);
    const int8_t step = steps[(uint8_t)(encoder_last << 2) | now];

    encoder_last = now;
    if (step == 2) {
        encoder_error_ms = ENCODER_ERROR_MS;
    } else {
        count += (uint32_t)(int32_t)step;
    }
}

ISR(INT0_vect)
{
    encoder_edge();
}

ISR(INT1_vect)
{
    encoder_edge();
}

ISR(TIMER1_OVF_vect)
{
    overflows++;
}

/* Every millisecond. Whatever the receiver does, it lets this in. */
ISR(TIMER0_COMPA_vect)
{
    wdt_reset();
    if (watchdog_left_ms != 0U) {
        watchdog_left_ms--;
        if (watchdog_left_ms == 0U) {
            core_watchdog_expired();
        }
    }
    if (encoder_error_ms != 0U) {
        encoder_error_ms--;
    }
    core_poll();
}

ISR(USART_UDRE_vect)
{
    uint8_t byte;

    if (core_next_byte(&byte)) {
        UDR0 = byte;
    } else {
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
    }
}

/* The byte is kept at once. The frame is worked on with interrupts on, so that no edge of the encoder waits for a CRC;
   bytes that come meanwhile are kept by an interrupt within this one, which goes no further. */
ISR(USART_RX_vect)
{
    const uint8_t errors = UCSR0A & (_BV(FE0) | _BV(DOR0));
    const uint8_t next = (uint8_t)((ring_head + 1U) % RING_BYTES);

    ring[ring_head] = UDR0;
    if ((errors != 0U) || (next == ring_tail)) {
        ring_overrun = true;
    } else {
        ring_head = next;
    }
    if (receiving) {
        return;
    }
    receiving = true;
    while (ring_tail != ring_head) {
        const uint8_t byte = ring[ring_tail];
        const bool lost = ring_overrun;
        ring_tail = (uint8_t)((ring_tail + 1U) % RING_BYTES);
        ring_overrun = false;
        sei();
        if (lost) {
            core_receive_error();
        }
        core_receive(byte);
        cli();
    }
    receiving = false;
}

int main(void)
{
    /* The output first: the pull resistor has held it off until here. */
    PORTB = PIN_CS;
    DDRB = PIN_ENABLE | PIN_CS | PIN_MOSI | PIN_SCK;
    SPCR = _BV(SPE) | _BV(MSTR); /* mode 0, most significant bit first, 8 MHz with the next */
    SPSR = _BV(SPI2X);
    core_begin();
    MCUSR = 0U;
    wdt_enable(WDTO_60MS); /* without the tick: reset, and so off */

    EICRA = _BV(ISC00) | _BV(ISC10); /* any change; until it says so, a low line would count */
    PORTD = PIN_RELEASED | PIN_STOP | PIN_NO_AMP_FAULT | (3U << ENCODER_SHIFT); /* pull-ups */
    encoder_last = (uint8_t)((PIND >> ENCODER_SHIFT) & 3U);
    EIFR = _BV(INTF0) | _BV(INTF1);
    EIMSK = _BV(INT0) | _BV(INT1);
    TCCR1B = _BV(CS11); /* 2 MHz */
    TIMSK1 = _BV(TOIE1);
    OCR0A = 249U; /* 250 kHz / 250: 1 ms */
    TCCR0A = _BV(WGM01);
    TCCR0B = _BV(CS01) | _BV(CS00);
    TIMSK0 = _BV(OCIE0A);
    UBRR0 = UBRR_500K;
    UCSR0A = _BV(U2X0);
    UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
    SMCR = 0U; /* sleep is idle */
    sei();
    for (;;) {
        sleep_mode();
    }
}
