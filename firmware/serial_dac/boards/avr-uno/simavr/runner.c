/* The avr-uno board in simavr: runner IMAGE LINE PAGE
 *
 * SPDX-License-Identifier: GPL-3.0-or-later
 * This program is linked with libsimavr and is therefore under the GNU General Public License, version 3 or later. It is
 * no part of the firmware, of hapticd or of its packages: it is built for tests and talks to them by a socket and a file.
 *
 * LINE is a Unix socket that it connects to, PAGE a file of memory (boards/bench.h). Edges of the encoder go into D2 and
 * D3, words on SPI and the enable line come out.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_ioport.h>
#include <simavr/avr_spi.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

#include "../../bench.h"

#define HZ 16000000U
#define CYCLES_PER_US 16U
#define LOOK_CYCLES (10U * CYCLES_PER_US)     /* at line and clock */
#define ILLEGAL_CYCLES (2000U * CYCLES_PER_US) /* between illegal transitions while the encoder is broken */
#define INPUT_HELD 0x01U
#define CAUSE_ENCODER 0x04U
#define CAUSE_AMPLIFIER 0x08U
#define CAUSE_STOP 0x40U
#define AHEAD_NS 200000LL   /* the board's clock may be so far before ours */
#define BEHIND_NS 5000000LL /* further behind, it is left behind */

static avr_t *avr;
static volatile struct bench_page *page;
static uint16_t spi_word;
static uint32_t enabled;
static bool takes_bytes = true;
static int line;
static uint8_t sent[64];
static size_t sent_size;

static uint32_t time_us(void)
{
    return (uint32_t)(avr->cycle / CYCLES_PER_US);
}

static void on_spi(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq;
    (void)unused;
    spi_word = (uint16_t)((uint16_t)(spi_word << 8) | (value & 0xFFU));
}

static void on_chip_select(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)unused;
    if ((value != 0U) && (irq->value == 0U)) { /* its rising edge sets the DAC */
        bench_put(page, time_us(), spi_word & 0x0FFFU, enabled);
    }
}

static void on_enable(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq;
    (void)unused;
    if (value != enabled) {
        enabled = value;
        bench_put(page, time_us(), spi_word & 0x0FFFU, enabled);
    }
}

static void on_byte(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq;
    (void)unused;
    sent[sent_size++] = (uint8_t)value;
    if ((value == 0U) || (sent_size == sizeof sent)) {
        if (send(line, sent, sent_size, MSG_NOSIGNAL) < 0) {
            exit(EXIT_SUCCESS); /* the line is gone */
        }
        sent_size = 0;
    }
}

static void on_xon(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq;
    (void)value;
    (void)unused;
    takes_bytes = true;
}

static void on_xoff(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq;
    (void)value;
    (void)unused;
    takes_bytes = false;
}

/* simavr would sleep here by the wall clock; keep_pace does that. */
static void on_sleep(avr_t *unused, avr_cycle_count_t cycles)
{
    (void)unused;
    (void)cycles;
}

static void fail(const char *what)
{
    (void)fprintf(stderr, "runner: %s: %s\n", what, strerror(errno));
    exit(EXIT_FAILURE);
}

static void open_page(const char *path)
{
    const int file = open(path, O_RDWR | O_CLOEXEC);
    page = (file < 0) ? MAP_FAILED : mmap(NULL, sizeof *page, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (page == MAP_FAILED) {
        fail(path);
    }
}

static void open_line(const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};

    (void)snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    line = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if ((line < 0) || (connect(line, (const struct sockaddr *)&address, sizeof address) != 0)) {
        fail(path);
    }
}

static avr_irq_t *pin(char port, unsigned int number)
{
    return avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(port), number);
}

static void wire(void)
{
    uint32_t flags = 0;

    (void)avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(uint32_t)(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POOL_SLEEP);
    (void)avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_byte, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), on_xon, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), on_xoff, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_SPI_GETIRQ(0), SPI_IRQ_OUTPUT), on_spi, NULL);
    avr_irq_register_notify(pin('B', 2), on_chip_select, NULL);
    avr_irq_register_notify(pin('B', 0), on_enable, NULL);
}

/* What drives an input of port D from outside is stronger than its pull-up. */
static void put_input(unsigned int number, bool level)
{
    static avr_ioport_external_t outside = {.name = 'D'};

    outside.mask |= 1U << number;
    outside.value = (outside.value & ~(1U << number)) | ((level ? 1U : 0U) << number);
    (void)avr_ioctl(avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('D'), &outside);
    avr_raise_irq(pin('D', number), level ? 1U : 0U);
}

static void put_encoder(unsigned int state)
{
    put_input(2, (state & 1U) != 0U);
    put_input(3, (state & 2U) != 0U);
}

/* One edge towards the page's count, if it is time; illegal ones while the encoder is broken. No edge comes sooner after an
   illegal one than after another: together they would look like a legal one to firmware that served neither between. */
static void turn(avr_cycle_count_t edge_cycles)
{
    static const unsigned int gray[4] = {0, 1, 3, 2};
    static uint32_t shown;
    static avr_cycle_count_t next_edge;
    static avr_cycle_count_t next_illegal;
    static unsigned int lines;
    static unsigned int flipped;
    const bool broken = (page->causes & CAUSE_ENCODER) != 0U;

    if (avr->cycle < next_edge) {
        return;
    }
    if ((broken || (flipped != 0U)) && (avr->cycle >= next_illegal)) {
        next_illegal = avr->cycle + ILLEGAL_CYCLES;
        next_edge = avr->cycle + edge_cycles;
        flipped ^= 3U; /* both lines change at once */
        put_encoder(lines ^ flipped);
    } else if (page->count != shown) {
        next_edge = avr->cycle + edge_cycles;
        shown += ((int32_t)(page->count - shown) > 0) ? 1U : UINT32_MAX;
        lines = gray[shown & 3U];
        put_encoder(lines ^ flipped);
    }
}

static void put_causes(void)
{
    static uint32_t shown = UINT32_MAX;
    const uint32_t causes = page->causes;

    if (causes != shown) {
        shown = causes;
        put_input(7, (causes & CAUSE_AMPLIFIER) == 0U);
        put_input(6, (causes & CAUSE_STOP) != 0U);
        put_input(4, (causes & INPUT_HELD) == 0U);
    }
}

static void take_bytes(void)
{
    static uint8_t bytes[64];
    static ssize_t size;
    static ssize_t at;

    if (at == size) {
        at = 0;
        size = read(line, bytes, sizeof bytes);
        if (size == 0) {
            exit(EXIT_SUCCESS);
        }
        if (size < 0) {
            size = 0;
        }
    }
    while ((at < size) && takes_bytes) {
        avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT), bytes[at++]);
    }
}

static int64_t now_ns(void)
{
    struct timespec now;

    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return ((int64_t)now.tv_sec * 1000000000LL) + now.tv_nsec;
}

/* The board's clock follows ours, never before it; what this machine is too slow for is lost to the board. */
static void keep_pace(void)
{
    static int64_t start_ns;
    const int64_t board_ns = (int64_t)(avr->cycle * 125U / 2U);
    const int64_t now = now_ns();

    if ((start_ns == 0) || (now - start_ns - board_ns > BEHIND_NS)) {
        start_ns = now - board_ns;
    }
    const int64_t ahead = board_ns - (now - start_ns);
    if (ahead > AHEAD_NS) {
        struct pollfd wake = {.fd = line, .events = POLLIN};
        const struct timespec wait = {.tv_nsec = (long)ahead};
        (void)ppoll(&wake, 1, &wait, NULL);
    }
}

int main(int count, char **arguments)
{
    elf_firmware_t firmware;
    /* Shortest time between two edges, us: how fast the encoder may be turned. simavr takes 100 us for a byte on SPI, which
       the processor does in 1 us, and no edge is served meanwhile. */
    const char *fastest = getenv("RUNNER_EDGE_US");
    const avr_cycle_count_t edge_cycles = (avr_cycle_count_t)((fastest ? atof(fastest) : 400.0) * CYCLES_PER_US);

    if (count != 4) {
        (void)fprintf(stderr, "usage: runner IMAGE LINE PAGE\n");
        return 2;
    }
    memset(&firmware, 0, sizeof firmware);
    if (elf_read_firmware(arguments[1], &firmware) != 0) {
        fail(arguments[1]);
    }
    avr = avr_make_mcu_by_name("atmega328p");
    if (avr == NULL) {
        fail("atmega328p");
    }
    open_page(arguments[3]);
    open_line(arguments[2]);
    avr_init(avr);
    avr->log = LOG_ERROR;
    avr->frequency = HZ;
    avr_load_firmware(avr, &firmware);
    avr->frequency = HZ;
    avr->sleep = on_sleep;
    wire();
    put_encoder(0);
    put_causes();
    for (avr_cycle_count_t next = 0;;) {
        const int state = avr_run(avr);
        if ((state == cpu_Done) || (state == cpu_Crashed)) {
            (void)fprintf(stderr, "runner: the processor stopped\n");
            return EXIT_FAILURE;
        }
        turn(edge_cycles);
        if (avr->cycle >= next) {
            next = avr->cycle + LOOK_CYCLES;
            put_causes();
            take_bytes();
            keep_pace();
        }
    }
}
