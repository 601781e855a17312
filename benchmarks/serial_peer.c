/* The peers of the benchmark serial_roundtrip, docs/protocols/serial-dac.md in C.
 *
 *   serial_peer board                       opens a pseudo-terminal, prints its path, answers for ever
 *   serial_peer client PATH PERIODS PRIORITY one exchange a millisecond; prints the time of each in ns, as int64
 */
#define _GNU_SOURCE
#include <errno.h>
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

enum { HELLO = 1, CONFIGURE = 2, SAMPLE = 3, COMMAND = 4, REPLY = 0x80, LONGEST = 36, SECOND = 1000000000 };

static uint16_t crc16(const uint8_t *data, int size) {
    uint16_t crc = 0xFFFF;
    while (size--) {
        crc ^= (uint16_t)(*data++ << 8);
        for (int bit = 0; bit < 8; bit++) crc = (uint16_t)(crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1);
    }
    return crc;
}

/* payload needs two bytes of room behind it; returns the frame's length */
static int encode(uint8_t *payload, int size, uint8_t *out) {
    uint16_t crc = crc16(payload, size);
    payload[size] = (uint8_t)crc;
    payload[size + 1] = (uint8_t)(crc >> 8);
    int at = 0, put = 1;
    for (int i = 0; i < size + 2; i++, put++) {
        if (payload[i]) { out[put] = payload[i]; continue; }
        out[at] = (uint8_t)(put - at);
        at = put;
    }
    out[at] = (uint8_t)(put - at);
    out[put] = 0;
    return put + 1;
}

/* in place, without the delimiter; returns the payload's length, or -1 */
static int decode(uint8_t *coded, int size) {
    int put = 0;
    for (int at = 0; at < size;) {
        int end = at + coded[at];
        if (end > size) return -1;
        for (int i = at + 1; i < end; i++) coded[put++] = coded[i];
        if (end < size) coded[put++] = 0;
        at = end;
    }
    put -= 2;
    return put >= 1 && crc16(coded, put) == (coded[put] | coded[put + 1] << 8) ? put : -1;
}

static void must(int ok, const char *what) {
    if (ok) return;
    perror(what);
    exit(1);
}

static void put_all(int fd, const uint8_t *data, int size) { must(write(fd, data, (size_t)size) == size, "write"); }

/* Bytes until a delimiter; returns the decoded length of the frame, or -1 for a bad one. */
typedef struct { uint8_t line[LONGEST], chunk[512]; int length, have, at; } receiver;

static int receive(int fd, receiver *r, int timeout_ms) {
    for (;;) {
        while (r->at < r->have) {
            uint8_t byte = r->chunk[r->at++];
            if (byte) {
                if (r->length < LONGEST) r->line[r->length++] = byte;
            } else if (r->length) {
                int size = r->length < LONGEST ? decode(r->line, r->length) : -1;
                r->length = 0;
                return size;
            }
        }
        struct pollfd p = {fd, POLLIN, 0};
        int ready = poll(&p, 1, timeout_ms);
        if (ready == 0) return -1;
        r->have = (int)read(fd, r->chunk, sizeof r->chunk);
        r->at = 0;
        must(r->have > 0, "read");
    }
}

static void raw(int fd) {
    struct termios settings;
    must(tcgetattr(fd, &settings) == 0, "tcgetattr");
    cfmakeraw(&settings);
    must(tcsetattr(fd, TCSANOW, &settings) == 0, "tcsetattr");
}

static int board(void) {
    int master = posix_openpt(O_RDWR | O_NOCTTY);
    must(master >= 0 && grantpt(master) == 0 && unlockpt(master) == 0, "posix_openpt");
    int slave = open(ptsname(master), O_RDWR | O_NOCTTY); /* kept, so that the line lives between two clients */
    must(slave >= 0, "open");
    raw(slave);
    printf("%s\n", ptsname(master));
    fflush(stdout);
    receiver r = {.length = 0};
    uint8_t command_seq = 0, out[LONGEST + 1];
    for (;;) {
        int size = receive(master, &r, -1);
        if (size < 1) continue;
        uint8_t payload[LONGEST] = {(uint8_t)(r.line[0] | REPLY), r.line[1], r.line[2], r.line[3]};
        switch (r.line[0]) {
        case HELLO: { /* 14 bits, 6 A, 32-bit counter, 5 ... 1000 ms */
            static const uint8_t able[] = {14, 0x80, 0x8D, 0x5B, 0, 32, 5, 0, 0xE8, 3, 1, 0, 0, 0, 0, 1};
            memcpy(payload + 4, able, sizeof able);
            put_all(master, out, encode(payload, 20, out));
            break;
        }
        case CONFIGURE: put_all(master, out, encode(payload, 3, out)); break;
        case SAMPLE:
            memset(payload + 2, 0, 9);
            payload[11] = command_seq;
            put_all(master, out, encode(payload, 12, out));
            break;
        case COMMAND: command_seq = r.line[1]; break;
        default: break;
        }
    }
}

static int64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * SECOND + t.tv_nsec;
}

static int client(const char *path, int periods, int priority) {
    int fd = open(path, O_RDWR | O_NOCTTY);
    must(fd >= 0, path);
    raw(fd);
    struct sched_param wanted = {.sched_priority = priority};
    if (priority) must(sched_setscheduler(0, SCHED_FIFO, &wanted) == 0, "SCHED_FIFO");
    int64_t *spent = malloc((size_t)periods * sizeof *spent), next = now_ns();
    receiver r = {.length = 0};
    uint8_t out[LONGEST + 1];
    for (int i = 0; i < periods; i++) {
        next += SECOND / 1000;
        struct timespec until = {next / SECOND, next % SECOND};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL) == EINTR) {}
        int64_t began = now_ns();
        uint8_t sample[4] = {SAMPLE, (uint8_t)i}, command[7] = {COMMAND, (uint8_t)i, 0, 0x20, 0};
        put_all(fd, out, encode(sample, 2, out));
        int size;
        do size = receive(fd, &r, 100);
        while (size >= 0 && !(size == 12 && r.line[1] == (uint8_t)i));
        put_all(fd, out, encode(command, 5, out));
        spent[i] = size < 0 ? -1 : now_ns() - began;
    }
    must(fwrite(spent, sizeof *spent, (size_t)periods, stdout) == (size_t)periods, "fwrite");
    return 0;
}

int main(int count, char **words) {
    if (count == 2 && !strcmp(words[1], "board")) return board();
    if (count == 5 && !strcmp(words[1], "client")) return client(words[2], atoi(words[3]), atoi(words[4]));
    fprintf(stderr, "usage: serial_peer board | client PATH PERIODS PRIORITY\n");
    return 2;
}
