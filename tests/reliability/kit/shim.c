/* Faults that are injected into a program by LD_PRELOAD. kit/shim.py compiles it and writes its control file.
 *
 *   SHIM_CONTROL  a file of 8 x int64, mapped by the program and by the test:
 *                 0  ns that are added to the wall clock
 *                 1  ns that are added to the monotonic clock
 *                 2  errno with which changes of files below SHIM_UNDER fail, 0 for none
 *                 3  number of changes that pass before the first one fails
 *                 4  number of changes that fail, -1 for all
 *                 5  id of the thread that panics at its next reading of the monotonic clock, 0 for none
 *                 6  number of changes that have failed
 *                 7  CLOCK_MONOTONIC of the first failure, ns
 *   SHIM_UNDER    the folder whose files are concerned: write, pwrite, fsync, fdatasync, rename, open for writing
 *   SHIM_HELD     a folder. While it has a file of this name, a sync of a file or folder of the same name waits. It first
 *                 creates the file NAME.waits there.
 *   SHIM_TTY      a log, to which "ns byte" (CLOCK_MONOTONIC) is appended for each write to a terminal that is a stop or a
 *                 move of Grbl: up to 4 bytes that begin with feed hold '!', jog cancel 0x85 or reset 0x18, or a line of
 *                 G-code, which begins with 'G'
 */
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
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

enum { WALL, MONOTONIC, ERRNO, PASS, FAILS, PANIC, FAILED, FIRST, WORDS };

static int64_t none[WORDS];
static volatile int64_t *control = none;
static const char *under;
static size_t under_length;
static int tty_log = -1;
static ssize_t (*real_write)(int, const void *, size_t);
static int (*real_clock_gettime)(clockid_t, struct timespec *);

#define REAL(name) ((typeof(&name))dlsym(RTLD_NEXT, #name))

__attribute__((constructor)) static void begin(void) {
    real_write = REAL(write);
    real_clock_gettime = REAL(clock_gettime);
    under = getenv("SHIM_UNDER");
    under_length = under ? strlen(under) : 0;
    const char *log = getenv("SHIM_TTY");
    if (log) tty_log = open(log, O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0600);
    const char *path = getenv("SHIM_CONTROL");
    int fd = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
    if (fd >= 0) {
        void *mapped = mmap(NULL, sizeof none, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
        if (mapped != MAP_FAILED) control = mapped;
        close(fd);
    }
}

/* Whether this change of a file is one of those that fail. */
static int fails(void) {
    if (__atomic_fetch_sub(&control[PASS], 1, __ATOMIC_SEQ_CST) > 0) return 0;
    if (control[FAILS] >= 0 && __atomic_fetch_sub(&control[FAILS], 1, __ATOMIC_SEQ_CST) <= 0) {
        control[FAILS] = 0;
        return 0;
    }
    if (__atomic_fetch_add(&control[FAILED], 1, __ATOMIC_SEQ_CST) == 0) {
        struct timespec t;
        real_clock_gettime(CLOCK_MONOTONIC, &t);
        control[FIRST] = (int64_t)t.tv_sec * 1000000000LL + t.tv_nsec;
    }
    errno = (int)control[ERRNO];
    return 1;
}

static int concerns_file(int fd) {
    if (!control[ERRNO] || !under) return 0;
    char link[64], path[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path);
    return length >= (ssize_t)under_length && !memcmp(path, under, under_length);
}

static int concerns_path(const char *path) {
    if (!control[ERRNO] || !under || !path) return 0;
    if (path[0] == '/') return !strncmp(path, under, under_length);
    char folder[PATH_MAX], whole[2 * PATH_MAX];
    if (!getcwd(folder, sizeof folder)) return 0;
    snprintf(whole, sizeof whole, "%s/%s", folder, path);
    return !strncmp(whole, under, under_length);
}

ssize_t write(int fd, const void *bytes, size_t count) {
    if (count >= 1 && tty_log >= 0) {
        unsigned char byte = *(const unsigned char *)bytes;
        int stops = count <= 4 && (byte == '!' || byte == 0x18 || byte == 0x85);
        if ((stops || byte == 'G') && isatty(fd)) {
            struct timespec t;
            char line[64];
            real_clock_gettime(CLOCK_MONOTONIC, &t);
            int length = snprintf(line, sizeof line, "%lld %02x\n", (long long)t.tv_sec * 1000000000LL + t.tv_nsec, byte);
            ssize_t logged = real_write(tty_log, line, (size_t)length);
            (void)logged;
        }
    }
    if (concerns_file(fd) && fails()) return -1;
    return real_write(fd, bytes, count);
}

ssize_t pwrite64(int fd, const void *bytes, size_t count, off64_t at) {
    if (concerns_file(fd) && fails()) return -1;
    return REAL(pwrite64)(fd, bytes, count, at);
}

ssize_t pwrite(int fd, const void *bytes, size_t count, off_t at) {
    if (concerns_file(fd) && fails()) return -1;
    return REAL(pwrite)(fd, bytes, count, at);
}

/* Waits while the test holds syncs of files of this name. */
static void wait_if_held(int fd) {
    const char *folder = getenv("SHIM_HELD");
    if (!folder) return;
    char link[64], path[PATH_MAX] = "", held[2 * PATH_MAX], waits[2 * PATH_MAX + 8];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    if (readlink(link, path, sizeof path - 1) < 0) return;
    const char *name = strrchr(path, '/');
    snprintf(held, sizeof held, "%s%s", folder, name ? name : "/");
    snprintf(waits, sizeof waits, "%s.waits", held);
    while (!access(held, F_OK)) {
        close(open(waits, O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
        usleep(5000);
    }
}

int fsync(int fd) {
    wait_if_held(fd);
    if (concerns_file(fd) && fails()) return -1;
    return REAL(fsync)(fd);
}

int fdatasync(int fd) {
    wait_if_held(fd);
    if (concerns_file(fd) && fails()) return -1;
    return REAL(fdatasync)(fd);
}

int rename(const char *from, const char *to) {
    if (concerns_path(to) && fails()) return -1;
    return REAL(rename)(from, to);
}

int open64(const char *path, int flags, ...) {
    mode_t mode = 0;
    if (flags & O_CREAT) {
        va_list list;
        va_start(list, flags);
        mode = va_arg(list, mode_t);
        va_end(list);
    }
    if ((flags & (O_WRONLY | O_RDWR)) && concerns_path(path) && fails()) return -1;
    return REAL(open64)(path, flags, mode);
}

static void add(struct timespec *t, int64_t ns) {
    int64_t sum = (int64_t)t->tv_sec * 1000000000LL + t->tv_nsec + ns;
    t->tv_sec = sum / 1000000000LL;
    t->tv_nsec = sum % 1000000000LL;
}

/* Rust's Instant::now panics when the clock cannot be read. */
static int panics(clockid_t id) {
    int64_t thread = control[PANIC];
    if (!thread || id != CLOCK_MONOTONIC || thread != gettid()) return 0;
    return __atomic_compare_exchange_n(&control[PANIC], &thread, 0, 0, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST);
}

int clock_gettime(clockid_t id, struct timespec *t) {
    if (!real_clock_gettime) real_clock_gettime = REAL(clock_gettime);
    if (panics(id)) {
        errno = EINVAL;
        return -1;
    }
    int result = real_clock_gettime(id, t);
    if (result == 0 && (id == CLOCK_REALTIME || id == CLOCK_REALTIME_COARSE)) add(t, control[WALL]);
    if (result == 0 && (id == CLOCK_MONOTONIC || id == CLOCK_MONOTONIC_COARSE)) add(t, control[MONOTONIC]);
    return result;
}

int gettimeofday(struct timeval *restrict v, void *restrict zone) {
    (void)zone;
    struct timespec t;
    clock_gettime(CLOCK_REALTIME, &t);
    v->tv_sec = t.tv_sec;
    v->tv_usec = t.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *out) {
    struct timespec t;
    clock_gettime(CLOCK_REALTIME, &t);
    if (out) *out = t.tv_sec;
    return t.tv_sec;
}
