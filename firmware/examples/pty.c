#define _DEFAULT_SOURCE /* cfmakeraw */
#define _XOPEN_SOURCE 700

#include "pty.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

bool pty_open(pty *p) {
    struct termios raw;
    const char *name;
    p->queued = 0;
    p->slave = -1;
    p->master = posix_openpt(O_RDWR | O_NOCTTY);
    if (p->master < 0 || grantpt(p->master) || unlockpt(p->master) || (name = ptsname(p->master)) == NULL)
        return false;
    if (strlen(name) >= sizeof p->path) {
        errno = ENAMETOOLONG;
        return false;
    }
    strcpy(p->path, name);
    p->slave = open(p->path, O_RDWR | O_NOCTTY);
    if (p->slave < 0 || tcgetattr(p->slave, &raw))
        return false;
    cfmakeraw(&raw); /* or it echoes, and turns line ends */
    return !tcsetattr(p->slave, TCSANOW, &raw) && !fcntl(p->master, F_SETFL, O_NONBLOCK);
}

size_t pty_free(void *context) {
    const pty *p = context;
    return sizeof p->queue - p->queued;
}

void pty_write(void *context, const uint8_t *data, size_t size) {
    pty *p = context;
    memcpy(p->queue + p->queued, data, size);
    p->queued += size;
}

void pty_flush(pty *p) {
    ssize_t taken = p->queued > 0 ? write(p->master, p->queue, p->queued) : 0;
    if (taken > 0) {
        p->queued -= (size_t)taken;
        memmove(p->queue, p->queue + taken, p->queued);
    }
}

long pty_read(pty *p, uint8_t *data, size_t size) {
    ssize_t got = read(p->master, data, size);
    if (got < 0 && (errno == EAGAIN || errno == EINTR))
        return 0;
    if (got <= 0)
        return -1;
    if (p->slave >= 0) { /* from now on we want to know when the host hangs up */
        close(p->slave);
        p->slave = -1;
    }
    return (long)got;
}

void pty_await(pty *p) {
    p->queued = 0;
    if (p->slave < 0)
        p->slave = open(p->path, O_RDWR | O_NOCTTY);
    if (p->slave >= 0)
        (void)tcflush(p->slave, TCIFLUSH); /* what the last host left unread */
}
