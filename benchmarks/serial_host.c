/* An independent host for the simulated serial board: one exchange a period for a while, every round trip measured.
 * usage: serial_host PORT RATE_HZ SECONDS; written from docs/protocols/serial-dac.md. Prints one JSON line. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

static int64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static uint16_t crc(const uint8_t *data, int length) {
    uint16_t value = 0xFFFF;
    for (int n = 0; n < length; n++) {
        value ^= data[n] << 8;
        for (int bit = 0; bit < 8; bit++) value = value & 0x8000 ? value << 1 ^ 0x1021 : value << 1;
    }
    return value;
}

static void put(int fd, const uint8_t *payload, int length) {
    uint8_t data[64], frame[64];
    memcpy(data, payload, length);
    uint16_t check = crc(payload, length);
    data[length] = check, data[length + 1] = check >> 8;
    int code = 0, end = 1;
    for (int n = 0; n < length + 2; n++, end++) {
        frame[end] = data[n];
        if (data[n] == 0) frame[code] = end - code, code = end;
    }
    frame[code] = end - code, frame[end++] = 0;
    if (write(fd, frame, end) != end) perror("write"), exit(1);
}

/* Payload of the next good frame into `payload`; its length, or 0 when none came until `until`. */
static int get(int fd, uint8_t *payload, int64_t until) {
    static uint8_t frame[256];
    static int size;
    for (;;) {
        uint8_t byte;
        while (read(fd, &byte, 1) == 1) {
            if (byte) { if (size < 255) frame[size++] = byte; continue; }
            int length = 0, at = 0;
            while (at < size) {
                int step = frame[at];
                for (int n = 1; n < step && at + n < size; n++) payload[length++] = frame[at + n];
                at += step;
                if (at < size) payload[length++] = 0;
            }
            int good = size > 3 && at == size && crc(payload, length - 2) == (payload[length - 2] | payload[length - 1] << 8);
            size = 0;
            if (good) return length - 2;
        }
        int64_t left = until - now_ns();
        if (left <= 0) return 0;
        struct pollfd p = {fd, POLLIN, 0};
        struct timespec t = {left / 1000000000, left % 1000000000};
        ppoll(&p, 1, &t, NULL);
    }
}

static int compare(const void *a, const void *b) {
    int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}

int main(int argc, char **argv) {
    if (argc != 4) return 2;
    int64_t period = 1e9 / atof(argv[2]);
    int ticks = atof(argv[2]) * atof(argv[3]);
    struct sched_param fifo = {80};
    int realtime = sched_setscheduler(0, SCHED_FIFO, &fifo) == 0;
    int fd = open(argv[1], O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (fd < 0) return perror(argv[1]), 1;
    struct termios raw;
    tcgetattr(fd, &raw), cfmakeraw(&raw), tcsetattr(fd, TCSANOW, &raw);
    uint8_t answer[256];
    put(fd, (uint8_t[]){1, 1, 0x34, 0x12}, 4);
    if (get(fd, answer, now_ns() + 3000000000LL) != 20) return fprintf(stderr, "no HELLO reply\n"), 1;
    put(fd, (uint8_t[]){2, 20, 0}, 3);
    if (get(fd, answer, now_ns() + 1000000000LL) != 3 || answer[1] != 20) return fprintf(stderr, "not configured\n"), 1;
    put(fd, (uint8_t[]){4, 0, 0, 32, 0}, 5);
    int64_t *trips = calloc(ticks, sizeof *trips), due = now_ns() + period;
    int missed = 0, unproven = 0, late = 0, count = 0, faults = 0;
    for (int tick = 0; tick < ticks; tick++, due += period) {
        struct timespec t = {due / 1000000000, due % 1000000000};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
        int64_t begin = now_ns();
        if (begin - due > period) late++, due = begin;
        uint8_t seq = tick + 1;
        put(fd, (uint8_t[]){3, seq}, 2);
        int length;
        while ((length = get(fd, answer, begin + period / 2)) && answer[1] != seq) {}
        if (length != 12) missed++;
        else {
            trips[count++] = now_ns() - begin;
            unproven += tick && answer[11] != (uint8_t)(seq - 1);
            faults += (answer[10] & ~1) != 0;
        }
        put(fd, (uint8_t[]){4, seq, 0, 32, 1}, 5);
    }
    put(fd, (uint8_t[]){4, 0, 0, 32, 0}, 5);
    qsort(trips, count, sizeof *trips, compare);
    printf("{\"ticks\": %d, \"missed\": %d, \"unproven\": %d, \"late_ticks\": %d, \"with_status\": %d, \"realtime\": %s, "
           "\"round_trip_us\": {\"p50\": %.1f, \"p99\": %.1f, \"max\": %.1f}}\n",
           ticks, missed, unproven, late, faults, realtime ? "true" : "false",
           count ? trips[count / 2] / 1e3 : 0, count ? trips[count * 99 / 100] / 1e3 : 0, count ? trips[count - 1] / 1e3 : 0);
    return 0;
}
