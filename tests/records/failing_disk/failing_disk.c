/* Put before the C library (LD_PRELOAD): counts the calls of all processes that change something below one folder, and
 * makes one of them, or all from one on, fail. The plan is a file that all of them map: see failing_disk.py. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum { OPEN = 1, WRITE = 2, SYNC = 4, TRUNCATE = 8, RENAME = 16, MAKE = 32, ALLOCATE = 64, REMOVE = 128, MODE = 256, CLOSE = 512 };

struct plan {
    int64_t at;      /* number of the first call that fails, from 1; 0: none */
    int64_t calls;   /* counted so far */
    int64_t failed;  /* made to fail so far */
    int64_t rings;   /* opened so far */
    int32_t error;   /* errno; 0: a write is only short */
    int32_t which;   /* bits of the calls above that can fail */
    int32_t lasting; /* all from that one on */
    int32_t halved;  /* a first write that is hit takes half of its bytes */
    char below[1024];
    char log[512][256]; /* the first calls that failed; all that there were, where none is to */
    char ring[64][256];  /* the first rings that were opened */
};

static struct plan *plan;

__attribute__((constructor)) static void map_plan(void) {
    const char *path = getenv("FAILING_DISK");
    int fd = path ? (int)syscall(SYS_openat, AT_FDCWD, path, O_RDWR) : -1;
    if (fd < 0) return;
    void *memory = mmap(NULL, sizeof *plan, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    syscall(SYS_close, fd);
    if (memory != MAP_FAILED) plan = memory;
}

static int path_of(int fd, char *path) {
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, PATH_MAX - 1);
    path[length < 0 ? 0 : length] = 0;
    return length > 0;
}

static int is_ring(const char *path) {
    static const char ring[] = "/dev/shm/gyrohil-";
    return strncmp(path, ring, sizeof ring - 1) == 0;
}

static int lies_below(const char *path) {
    size_t length = strlen(plan->below);
    if (is_ring(path)) return 1;
    return strncmp(path, plan->below, length) == 0 && (path[length] == 0 || path[length] == '/');
}

/* 0: go on; 1: fail with errno set; 2: take half */
static int fails(int kind, const char *name, const char *path) {
    if (!plan || !lies_below(path)) return 0;
    if (is_ring(path) && !(kind & (OPEN | ALLOCATE))) return 0; /* memory does not fail otherwise */
    if (is_ring(path) && kind == OPEN) {
        int64_t number = __atomic_fetch_add(&plan->rings, 1, __ATOMIC_SEQ_CST);
        if (number < 64) snprintf(plan->ring[number], sizeof plan->ring[0], "%s", path);
    }
    if (kind & (MAKE | REMOVE)) { /* what is there, or is not, is told before anything can fail */
        struct stat there;
        if ((lstat(path, &there) == 0) != (kind == REMOVE)) return 0;
    }
    int64_t number = __atomic_add_fetch(&plan->calls, 1, __ATOMIC_SEQ_CST);
    int64_t at = plan->at;
    if (!at || number < at || !(plan->which & kind) || (!plan->lasting && number > at)) {
        if (!at && number <= 512) snprintf(plan->log[number - 1], sizeof plan->log[0], "%s %s", name, path);
        return 0;
    }
    int64_t before = __atomic_fetch_add(&plan->failed, 1, __ATOMIC_SEQ_CST);
    if (before < 512) snprintf(plan->log[before], sizeof plan->log[0], "%s %s", name, path);
    if (kind == WRITE && (!plan->error || (plan->halved && before == 0))) return 2;
    errno = plan->error;
    return 1;
}

static int fails_fd(int kind, const char *name, int fd) {
    char path[PATH_MAX];
    int saved = errno, result = 0;
    if (plan && path_of(fd, path)) result = fails(kind, name, path);
    if (result != 1) errno = saved;
    return result;
}

static int fails_at(int kind, const char *name, int dir, const char *given) {
    char path[2 * PATH_MAX] = "";
    int saved = errno;
    if (!plan) return 0;
    if (given[0] != '/') {
        if (dir == AT_FDCWD) { if (!getcwd(path, PATH_MAX)) return 0; }
        else if (!path_of(dir, path)) return 0;
        strcat(path, "/");
    }
    strncat(path, given, PATH_MAX - 1);
    int result = fails(kind, name, path);
    if (result != 1) errno = saved;
    return result;
}

#define REAL(type, name, ...) \
    static type (*real)(__VA_ARGS__); \
    if (!real) real = (type (*)(__VA_ARGS__))dlsym(RTLD_NEXT, name)

#define MODE_OF(flags) \
    mode_t mode = 0; \
    if ((flags) & (O_CREAT | O_TMPFILE)) { va_list rest; va_start(rest, flags); mode = va_arg(rest, mode_t); va_end(rest); }
#define CHANGES(flags) ((flags) & (O_CREAT | O_TRUNC) || ((flags) & O_ACCMODE) != O_RDONLY)

#define OPENER(name) \
    int name(const char *path, int flags, ...) { \
        MODE_OF(flags) REAL(int, #name, const char *, int, ...); \
        if (CHANGES(flags) && fails_at(OPEN, "open", AT_FDCWD, path)) return -1; \
        return real(path, flags, mode); }
OPENER(open)
OPENER(open64)
#define OPENER_AT(name) \
    int name(int dir, const char *path, int flags, ...) { \
        MODE_OF(flags) REAL(int, #name, int, const char *, int, ...); \
        if (CHANGES(flags) && fails_at(OPEN, "open", dir, path)) return -1; \
        return real(dir, path, flags, mode); }
OPENER_AT(openat)
OPENER_AT(openat64)

ssize_t write(int fd, const void *data, size_t size) {
    REAL(ssize_t, "write", int, const void *, size_t);
    int how = fails_fd(WRITE, "write", fd);
    return how == 1 ? -1 : real(fd, data, how == 2 ? (size + 1) / 2 : size);
}
#define WRITER_AT(name, offset_type) \
    ssize_t name(int fd, const void *data, size_t size, offset_type place) { \
        REAL(ssize_t, #name, int, const void *, size_t, offset_type); \
        int how = fails_fd(WRITE, "pwrite", fd); \
        return how == 1 ? -1 : real(fd, data, how == 2 ? (size + 1) / 2 : size, place); }
WRITER_AT(pwrite, off_t)
WRITER_AT(pwrite64, off64_t)
ssize_t writev(int fd, const struct iovec *parts, int count) {
    REAL(ssize_t, "writev", int, const struct iovec *, int);
    return fails_fd(WRITE, "writev", fd) == 1 ? -1 : real(fd, parts, count);
}
#define OF_FD(kind, name, said) \
    int name(int fd) { REAL(int, #name, int); return fails_fd(kind, said, fd) ? -1 : real(fd); }
OF_FD(SYNC, fsync, "fsync")
OF_FD(SYNC, fdatasync, "fdatasync")
#define TRUNCATER(name, offset_type) \
    int name(int fd, offset_type size) { \
        REAL(int, #name, int, offset_type); return fails_fd(TRUNCATE, "ftruncate", fd) ? -1 : real(fd, size); }
TRUNCATER(ftruncate, off_t)
TRUNCATER(ftruncate64, off64_t)
#define ALLOCATER(name, offset_type) /* returns the error instead of setting it */ \
    int name(int fd, offset_type place, offset_type size) { \
        REAL(int, #name, int, offset_type, offset_type); \
        return fails_fd(ALLOCATE, "fallocate", fd) ? plan->error : real(fd, place, size); }
ALLOCATER(posix_fallocate, off_t)
ALLOCATER(posix_fallocate64, off64_t)
int rename(const char *from, const char *to) {
    REAL(int, "rename", const char *, const char *);
    return fails_at(RENAME, "rename", AT_FDCWD, to) ? -1 : real(from, to);
}
int mkdir(const char *path, mode_t mode) {
    REAL(int, "mkdir", const char *, mode_t);
    return fails_at(MAKE, "mkdir", AT_FDCWD, path) ? -1 : real(path, mode);
}
int chmod(const char *path, mode_t mode) {
    REAL(int, "chmod", const char *, mode_t);
    return fails_at(MODE, "chmod", AT_FDCWD, path) ? -1 : real(path, mode);
}
int unlink(const char *path) {
    REAL(int, "unlink", const char *);
    return fails_at(REMOVE, "unlink", AT_FDCWD, path) ? -1 : real(path);
}
int unlinkat(int dir, const char *path, int flags) {
    REAL(int, "unlinkat", int, const char *, int);
    return fails_at(REMOVE, "unlink", dir, path) ? -1 : real(dir, path, flags);
}
int rmdir(const char *path) {
    REAL(int, "rmdir", const char *);
    return fails_at(REMOVE, "rmdir", AT_FDCWD, path) ? -1 : real(path);
}
/* The descriptor is gone, as Linux has it, though the close failed. Only what was open to be written counts. */
int close(int fd) {
    REAL(int, "close", int);
    int saved = errno, flags = plan ? fcntl(fd, F_GETFL) : 0;
    errno = saved;
    int how = plan && flags >= 0 && (flags & O_ACCMODE) != O_RDONLY ? fails_fd(CLOSE, "close", fd) : 0;
    int error = errno, result = real(fd);
    if (!how) return result;
    errno = error;
    return -1;
}
