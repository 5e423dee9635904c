/* What becomes of a plug-in that does not come back: it crashes, ends the process, or goes on for ever.

   Then nobody can go on here.  Its name is written for the process that watches this one, which brings the board to
   SAFE, and this one ends. */

#ifndef PLUGIN_WATCH_H
#define PLUGIN_WATCH_H

#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include "structs.h"

#define MARK 0xA5
#define MARKED 16 /* bytes before what is lent */
#define WORDS 512
#define LOOK_NS 50000000L

/* Why: its words stand in `watch_t`, made ready by Python as lines of JSON. */
enum { DEATH_BLOCKED, DEATH_EXIT, DEATH_OVERRUN, DEATH_SEGV, DEATH_BUS, DEATH_FPE, DEATH_ILL, DEATH_ABRT, DEATHS };

typedef struct {
    int64_t fd;
    int64_t patience_ns; /* from which on a call never comes back */
    char words[PARTS][DEATHS][WORDS];
} watch_t;

static watch_t watched;
static plugin_t *volatile inside; /* the plug-in that is being called, NULL while none is */
static volatile int64_t part_inside, entered_ns;

static int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static int64_t coarse_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC_COARSE, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

/* Safe in a signal handler. */
static void last_words(int death)
{
    const char *words = watched.words[part_inside][death];
    size_t size = strlen(words);
    inside = NULL;
    for (int again = 0; size > 0 && again < 100; again++) {
        ssize_t done = write((int)watched.fd, words, size);
        if (done == (ssize_t)size)
            return;
        struct timespec wait = {0, 1000000};
        nanosleep(&wait, NULL);
    }
}

static bool is_guard(const void *place)
{
    const uint8_t *at = place;
    const plugin_t *plugin = inside;
    for (int i = 0; plugin != NULL && i < LENT; i++) {
        const lent_t *lent = &plugin->lent[i];
        if (lent->pages != NULL && at >= lent->pages && at < lent->pages + lent->length)
            return true;
    }
    return false;
}

static void crashed(int number, siginfo_t *info, void *context)
{
    static const int numbers[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
    (void)context;
    if (inside != NULL) {
        int death = DEATH_SEGV;
        for (int i = 0; i < 5; i++)
            if (numbers[i] == number)
                death = DEATH_SEGV + i;
        if ((number == SIGSEGV || number == SIGBUS) && is_guard(info->si_addr))
            death = DEATH_OVERRUN;
        last_words(death);
    }
    signal(number, SIG_DFL);
    raise(number);
}

static void ended(void)
{
    if (inside != NULL)
        last_words(DEATH_EXIT);
}

static void *look(void *unused)
{
    (void)unused;
    struct timespec wait = {0, LOOK_NS};
    for (;;) {
        nanosleep(&wait, NULL);
        if (inside != NULL && now_ns() - entered_ns > watched.patience_ns) {
            last_words(DEATH_BLOCKED);
            kill(getpid(), SIGKILL);
        }
    }
    return NULL;
}

/* Watch from now on, once in a process; 0 where that cannot be done. */
static int64_t watch(const watch_t *asked)
{
    static bool begun = false;
    static uint8_t stack[1 << 16];
    watched = *asked;
    if (begun)
        return 1;
    begun = true;
    stack_t other = {.ss_sp = stack, .ss_size = sizeof stack};
    struct sigaction action = {.sa_sigaction = crashed, .sa_flags = SA_SIGINFO | SA_ONSTACK};
    sigset_t all, before;
    pthread_t thread;
    sigaltstack(&other, NULL);
    for (const int *number = (const int[]){SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, 0}; *number; number++)
        sigaction(*number, &action, NULL);
    atexit(ended);
    sigfillset(&all); /* signals are for the loop's own thread */
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int failed = pthread_create(&thread, NULL, look, NULL);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return failed == 0;
}

/* Memory for a plug-in, which ends where a page begins that nobody may touch; `at` is NULL where there is none. */
static lent_t lend(int64_t size, int64_t aligned)
{
    int64_t page = sysconf(_SC_PAGESIZE);
    int64_t room = (size + aligned - 1) / aligned * aligned, inner = (room + MARKED + page - 1) / page * page;
    lent_t lent = {.length = inner + 2 * page, .size = size, .room = room};
    lent.pages = mmap(NULL, (size_t)lent.length, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (lent.pages == MAP_FAILED) {
        lent.pages = NULL;
        return lent;
    }
    if (mprotect(lent.pages + page, (size_t)inner, PROT_READ | PROT_WRITE) != 0) {
        munmap(lent.pages, (size_t)lent.length);
        lent.pages = NULL;
        return lent;
    }
    lent.at = lent.pages + page + inner - room;
    memset(lent.at - MARKED, MARK, MARKED);
    memset(lent.at + size, MARK, (size_t)(room - size));
    return lent;
}

static void give_back(lent_t *lent)
{
    if (lent->pages != NULL)
        munmap(lent->pages, (size_t)lent->length);
    memset(lent, 0, sizeof *lent);
}

/* Whether the marks around what was lent are as they were. */
static bool is_whole(const lent_t *lent)
{
    static const uint64_t marks = UINT64_C(0xA5A5A5A5A5A5A5A5);
    uint64_t before[MARKED / 8];
    if (lent->pages == NULL)
        return true;
    memcpy(before, lent->at - MARKED, sizeof before);
    for (int64_t at = lent->size; at < lent->room; at++)
        if (lent->at[at] != MARK)
            return false;
    return before[0] == marks && before[1] == marks;
}

/* Pages of memory that this process has asked for. */
static int64_t pages_taken(void)
{
    char text[64];
    int fd = open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return 0;
    ssize_t size = read(fd, text, sizeof text - 1);
    close(fd);
    text[size > 0 ? size : 0] = '\0';
    return strtoll(text, NULL, 10);
}

#endif
