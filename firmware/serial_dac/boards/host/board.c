/* The board as a program on Linux, for sanitizers, coverage and tests: board LINE PAGE
 *
 * LINE is a Unix socket that it connects to, PAGE a file of memory (boards/bench.h). One thread: what interrupts do on a
 * processor is done here one after the other, the watchdog first.
 */
#define _GNU_SOURCE
#include "board.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "../bench.h"
#include "core.h"

#define NS_PER_S 1000000000LL
#define NS_PER_MS 1000000LL
#define NEVER INT64_MAX

const struct board_facts board_facts = {
    .dac_bits = 14,
    .full_scale_ua = 6000000,
    .counter_bits = 32,
    .watchdog_min_ms = 2,
    .watchdog_max_ms = 10000,
    .serial_number = 1,
};

static volatile struct bench_page *page;
static uint16_t dac_code;
static uint32_t enabled;
static int64_t power_up_ns;
static int64_t watchdog_due_ns = NEVER;
static bool sending;

static int64_t now_ns(void)
{
    struct timespec now;

    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return ((int64_t)now.tv_sec * NS_PER_S) + now.tv_nsec;
}

void board_dac_write(uint16_t code)
{
    dac_code = code;
    bench_put(page, board_time_us(), dac_code, enabled);
}

void board_enable(bool on)
{
    const uint32_t wanted = on ? 1U : 0U;

    if (wanted != enabled) {
        enabled = wanted;
        bench_put(page, board_time_us(), dac_code, enabled);
    }
}

uint32_t board_count(void)
{
    return page->count;
}

uint32_t board_time_us(void)
{
    return (uint32_t)((now_ns() - power_up_ns) / 1000);
}

uint8_t board_causes(void)
{
    return (uint8_t)page->causes;
}

void board_watchdog_start(uint16_t milliseconds)
{
    watchdog_due_ns = now_ns() + (milliseconds * NS_PER_MS);
}

void board_watchdog_stop(void)
{
    watchdog_due_ns = NEVER;
}

void board_start_sending(void)
{
    sending = true;
}

uint32_t board_interrupts_off(void)
{
    return 0;
}

void board_interrupts_restore(uint32_t before)
{
    (void)before;
}

static void fail(const char *what)
{
    (void)fprintf(stderr, "board: %s: %s\n", what, strerror(errno));
    exit(EXIT_FAILURE);
}

static volatile struct bench_page *map_page(const char *path)
{
    const int file = open(path, O_RDWR | O_CLOEXEC);
    if (file < 0) {
        fail(path);
    }
    void *memory = mmap(NULL, sizeof(struct bench_page), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (memory == MAP_FAILED) {
        fail(path);
    }
    (void)close(file);
    return memory;
}

static int connect_line(const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const int line = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);

    (void)snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    if ((line < 0) || (connect(line, (const struct sockaddr *)&address, sizeof address) != 0)) {
        fail(path);
    }
    return line;
}

static void send_all(int line)
{
    uint8_t bytes[256];
    size_t size = 0;

    while ((size < sizeof bytes) && core_next_byte(&bytes[size])) {
        size++;
    }
    sending = false;
    if ((size > 0) && (send(line, bytes, size, MSG_NOSIGNAL) != (ssize_t)size)) {
        exit(EXIT_SUCCESS); /* the line is gone */
    }
}

int main(int count, char **arguments)
{
    if (count != 3) {
        (void)fprintf(stderr, "usage: board LINE PAGE\n");
        return 2;
    }
    page = map_page(arguments[2]);
    power_up_ns = now_ns();
    core_begin();
    struct pollfd line = {.fd = connect_line(arguments[1]), .events = POLLIN};

    for (;;) {
        struct timespec wait = {.tv_nsec = (long)NS_PER_MS}; /* core_poll's millisecond */
        const int64_t left = watchdog_due_ns - now_ns();
        if (left < NS_PER_MS) {
            wait.tv_nsec = (left > 0) ? (long)left : 0;
        }
        const int ready = ppoll(&line, 1, &wait, NULL);
        if (now_ns() >= watchdog_due_ns) {
            watchdog_due_ns = NEVER;
            core_watchdog_expired();
        }
        core_poll();
        if (ready > 0) {
            uint8_t bytes[512];
            const ssize_t size = read(line.fd, bytes, sizeof bytes);
            if (size <= 0) {
                return EXIT_SUCCESS;
            }
            for (ssize_t n = 0; n < size; n++) {
                core_receive(bytes[n]);
                if (sending) {
                    send_all(line.fd);
                }
            }
        }
    }
}
