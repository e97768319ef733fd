/* The far ends of many lines: pseudo terminals that are read at exactly the rate of a line.
 *
 *     peer LINES BAUD PROGRAM TALKS
 *
 * prints the name of each terminal and waits for a line on stdin, by when the host has opened them all. With TALKS 1
 * each far end then says DC1, compares what comes with PROGRAM, and says DC3 when it has all of it: a control of
 * protocol B whose buffer never fills. With 0 it says nothing. At the end it prints for each line: bytes, wrong bytes,
 * the longest gap between two characters in ns, the time the wire was busy, and the time from its first character to
 * its last.
 *
 * A wire is a moment: until then it is busy with what it has taken. Every TICK it takes what it has had time for; what
 * is not there then leaves it idle, and that is the gap.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <pty.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#define BITS 11
#define SECOND 1000000000LL
#define TICK 1000000LL
#define SILENCE (5 * SECOND) /* a host that sends nothing for so long has ended */
#define READ_SIZE 4096

struct wire {
    int fd, started, ended;
    long bytes, wrong;
    int64_t asks_at, first, free_at, longest_gap, last_seen;
};

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * SECOND + t.tv_nsec;
}

static void fail(const char *what)
{
    perror(what);
    exit(1);
}

static char *load(const char *path, long *size)
{
    FILE *file = fopen(path, "rb");
    if (!file) fail(path);
    fseek(file, 0, SEEK_END);
    *size = ftell(file);
    rewind(file);
    char *data = malloc(*size);
    if (fread(data, 1, *size, file) != (size_t)*size) fail(path);
    fclose(file);
    return data;
}

static void say(struct wire *wire, char code)
{
    if (write(wire->fd, &code, 1) != 1) fail("write");
}

static long take(struct wire *wire, long want, const char *program, long size)
{
    char buffer[READ_SIZE];
    long got = read(wire->fd, buffer, want < READ_SIZE ? want : READ_SIZE);
    if (got <= 0) return 0;
    for (long i = 0; i < got; i++, wire->bytes++)
        wire->wrong += wire->bytes >= size || buffer[i] != program[wire->bytes];
    return got;
}

static void run(struct wire *wire, int64_t now, int64_t character, const char *program, long size)
{
    while (!wire->started || wire->free_at <= now) {
        int busy = wire->started && wire->last_seen == -1;
        long want = busy ? (now - wire->free_at) / character + 1 : 1;
        long got = take(wire, want, program, size);
        if (!got) {
            if (busy) wire->last_seen = now;
            return;
        }
        if (!wire->started) {
            wire->started = 1;
            wire->first = wire->free_at = now;
        } else if (!busy) {
            int64_t gap = now - wire->free_at;
            if (gap > wire->longest_gap) wire->longest_gap = gap;
            wire->free_at = now;
        }
        wire->free_at += got * character;
        wire->last_seen = got < want ? now : -1;
        if (got < want) return;
    }
}

int main(int argc, char **argv)
{
    if (argc != 5) return 2;
    int lines = atoi(argv[1]), talks = atoi(argv[4]);
    int64_t character = (BITS * SECOND + atol(argv[2]) - 1) / atol(argv[2]);
    long size;
    char *program = load(argv[3], &size);
    struct wire *wires = calloc(lines, sizeof *wires);
    for (int i = 0; i < lines; i++) {
        int slave;
        char name[64];
        struct termios raw;
        if (openpty(&wires[i].fd, &slave, name, NULL, NULL) < 0) fail("openpty");
        tcgetattr(slave, &raw);
        cfmakeraw(&raw);
        tcsetattr(slave, TCSANOW, &raw);
        fcntl(wires[i].fd, F_SETFL, O_NONBLOCK);
        wires[i].last_seen = -1;
        puts(name); /* the slave stays open here, so that nothing hangs up between two hosts */
    }
    puts("ready");
    fflush(stdout);
    if (getchar() < 0) return 1;
    int64_t begin = now_ns(), tick = begin;
    for (int i = 0; i < lines; i++)
        wires[i].asks_at = begin + i * (27500000LL / lines);
    for (int open = lines; open;) {
        int64_t now = now_ns();
        open = 0;
        for (int i = 0; i < lines; i++) {
            struct wire *wire = &wires[i];
            if (wire->ended) continue;
            open++;
            if (wire->asks_at && now >= wire->asks_at) {
                wire->asks_at = 0;
                if (talks) say(wire, 0x11);
            }
            run(wire, now, character, program, size);
            int silent = now - (wire->started ? wire->free_at : begin) > SILENCE;
            if (wire->bytes >= size && now >= wire->free_at) {
                if (talks) say(wire, 0x13);
                wire->ended = 1;
            } else if (silent)
                wire->ended = 1;
        }
        tick += TICK;
        if (tick < now) tick = now;
        struct timespec until = {tick / SECOND, tick % SECOND};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
    }
    for (int i = 0; i < lines; i++)
        printf("%ld %ld %lld %lld %lld\n", wires[i].bytes, wires[i].wrong, (long long)wires[i].longest_gap,
               (long long)(wires[i].bytes * character), (long long)(wires[i].free_at - wires[i].first));
    fclose(stdout);
    pause(); /* whoever reads his last DC3 late must find the line still there; the benchmark ends this */
    return 0;
}
