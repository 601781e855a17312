/* Random and mutated frames without end of novelty: frames COUNT SEED; or the strings of files: frames FILE... */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core.h"
#include "framing.h"
#include "harness.h"

#define FRAMES_IN_A_RUN 64U /* then the board is switched off and on */
#define LARGEST_FILE 65536U

static uint64_t state;

/* xorshift64* (Vigna, 2016) */
static uint32_t draw(uint32_t below)
{
    state ^= state >> 12;
    state ^= state << 25;
    state ^= state >> 27;
    return (uint32_t)(((state * 0x2545F4914F6CDD1DULL) >> 33) % below);
}

static size_t message(uint8_t *payload)
{
    static const uint8_t lengths[] = {4, 3, 2, 5, 2};
    const uint8_t type = (uint8_t)draw(5);

    payload[0] = (uint8_t)(type + 1U);
    for (uint8_t n = 1; n < lengths[type]; n++) {
        payload[n] = (uint8_t)draw(256);
    }
    if ((type == 1) && (draw(2) == 0)) {
        payload[2] = (uint8_t)draw(20); /* mostly a time in the range */
    }
    if ((type == 3) && (draw(4) != 0)) {
        payload[3] &= 0x0FU; /* mostly a code of 12 bits */
        payload[4] = (uint8_t)(draw(8) == 0 ? 4U : draw(4));
    }
    return lengths[type];
}

static size_t mutate(uint8_t *wire, size_t size)
{
    const size_t at = draw((uint32_t)size);

    switch (draw(6)) {
    case 0:
        wire[at] ^= (uint8_t)(1U << draw(8));
        break;
    case 1:
        wire[at] = (uint8_t)draw(256);
        break;
    case 2: /* a byte is lost */
        memmove(&wire[at], &wire[at + 1], size - at - 1);
        size--;
        break;
    case 3: /* a byte comes twice */
        memmove(&wire[at + 1], &wire[at], size - at);
        size++;
        break;
    case 4: /* the rest is lost */
        size = at;
        break;
    default: /* noise */
        size = draw(80);
        for (size_t n = 0; n < size; n++) {
            wire[n] = (uint8_t)draw(256);
        }
        break;
    }
    return size;
}

static size_t frame(uint8_t *wire)
{
    uint8_t payload[FRAMING_LONGEST_PAYLOAD + FRAMING_CRC_BYTES];
    size_t length = message(payload);

    if (draw(16) == 0) { /* a good frame of any other content */
        length = 1U + draw(FRAMING_LONGEST_PAYLOAD);
        for (size_t n = 0; n < length; n++) {
            payload[n] = (uint8_t)draw(256);
        }
    }
    const size_t size = framing_encode(payload, (uint8_t)length, wire);
    return (draw(2) == 0) ? size : mutate(wire, size);
}

static size_t event(uint8_t *steps)
{
    switch (draw(12)) {
    case 0:
        steps[0] = STEP_WATCHDOG;
        return 1;
    case 1:
        steps[0] = STEP_PENDING;
        return 1;
    case 2:
        steps[0] = STEP_CAUSES;
        steps[1] = (uint8_t)(draw(2) == 0 ? draw(2) : draw(256)); /* mostly no cause: the enable held, or not */
        return 2;
    case 3:
        steps[0] = STEP_POLL;
        return 1;
    case 4:
        steps[0] = (draw(8) == 0) ? STEP_LINE_ERROR : STEP_POLL;
        return 1;
    default:
        steps[0] = STEP_DRAIN;
        steps[1] = (uint8_t)draw(64);
        return 2;
    }
}

static void random_frames(unsigned long count)
{
    for (unsigned long done = 0; done < count; done += FRAMES_IN_A_RUN) {
        uint8_t steps[FRAMES_IN_A_RUN * 128U];
        size_t size = 0;
        for (unsigned int n = 0; n < FRAMES_IN_A_RUN; n++) {
            uint8_t wire[128];
            const size_t length = frame(wire);
            steps[size++] = STEP_BYTES;
            steps[size++] = (uint8_t)length;
            memcpy(&steps[size], wire, length);
            size += length;
            size += event(&steps[size]);
        }
        harness_run(steps, size);
    }
}

static void file(const char *path)
{
    static uint8_t data[LARGEST_FILE];
    FILE *stream = fopen(path, "rb");

    if (stream == NULL) {
        perror(path);
        exit(EXIT_FAILURE);
    }
    const size_t size = fread(data, 1, sizeof data, stream);
    (void)fclose(stream);
    harness_run(data, size);
}

int main(int count, char **arguments)
{
    if ((count == 3) && isdigit((unsigned char)arguments[1][0])) {
        const unsigned long frames = strtoul(arguments[1], NULL, 10);
        state = strtoull(arguments[2], NULL, 10) * 2U + 1U;
        random_frames(frames);
        (void)printf("%lu frames, %lu replies, nothing found\n", frames, harness_replies);
    } else {
        for (int n = 1; n < count; n++) {
            file(arguments[n]);
        }
        (void)printf("%d files, %lu replies, nothing found\n", count - 1, harness_replies);
    }
    return EXIT_SUCCESS;
}
