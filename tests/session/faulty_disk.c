/* A disk that fails where it is told to, for programs on Linux that load this library first
 * (LD_PRELOAD). What it shall do, and what it has seen, lies in a file that `faulty_disk.py` maps
 * too (FAULTY_DISK): only files and folders whose path contains `where` are concerned.
 *
 * Each write, sync, change of name, change of size and so on has a number, from 1 on, among those
 * of the kinds in `kinds`. With operation `at` happens what `action` says. For each byte of a file
 * is known whether it has reached the disk, for each change of a folder too, so that a power cut
 * can take away the rest.
 */
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#define FILES 24
#define LARGEST (2 << 20) /* bytes of a file that are followed */
#define CHANGES 64
#define TEXT 256

enum { WRITE = 1, SYNC = 2, RENAME = 4, SIZE = 8, UNLINK = 16, CREATE = 32, FOLDER = 64 };
enum { PASS, FAIL, SHORT, KILL_BEFORE, KILL_AFTER, KILL_HALFWAY, LOSE };
enum { SAFE, UNSYNCED, LOST }; /* what became of a byte; LOST: a sync of it has failed */

struct file {
    int64_t inode, end; /* of the bytes that were touched */
    uint8_t bytes[LARGEST];
};

struct change {
    int64_t kind, safe;
    char from[TEXT], to[TEXT], saved[TEXT];
};

struct control {
    int64_t count, at, kinds, action, error, lasting, delay_us, follow, hit, changes, files;
    char where[TEXT], last[TEXT];
    struct change change[CHANGES];
    struct file file[FILES];
};

static struct control *control;

#define REAL(name) ((__typeof__(&name))real(#name))

static void *real(const char *name)
{
    void *found = dlsym(RTLD_NEXT, name);
    if (!found) _exit(97);
    return found;
}

__attribute__((constructor)) static void map_control(void)
{
    const char *path = getenv("FAULTY_DISK");
    int fd = path ? REAL(open)(path, O_RDWR | O_CLOEXEC) : -1;
    if (fd < 0) return;
    void *at = mmap(NULL, sizeof *control, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    REAL(close)(fd);
    control = at == MAP_FAILED ? NULL : at;
}

static void die(void)
{
    kill(getpid(), SIGKILL);
    for (;;) pause();
}

/* The absolute path of an open file, or of a name in a folder; whether it is of concern. */
static int path_of(int fd, char *path)
{
    char link[64] = "/proc/self/cwd";
    if (!control || !control->where[0]) return 0;
    if (fd != AT_FDCWD) snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, TEXT - 1);
    path[n > 0 ? n : 0] = 0;
    return strstr(path, control->where) != NULL;
}

static int is_ours(int folder, const char *name, char *path)
{
    if (!control || !control->where[0] || !name) return 0;
    size_t length = 0;
    if (name[0] != '/') path_of(folder, path), length = strlen(path), path[length++] = '/';
    snprintf(path + length, TEXT - length, "%s", name);
    return strstr(path, control->where) != NULL;
}

/* Count an operation; what shall happen with it. */
static int decide(int kind, const char *name, const char *path)
{
    if (!(control->kinds & kind)) return PASS;
    int64_t n = __atomic_add_fetch(&control->count, 1, __ATOMIC_SEQ_CST);
    if (!control->at || !(n == control->at || (control->lasting && n > control->at))) return PASS;
    __atomic_add_fetch(&control->hit, 1, __ATOMIC_SEQ_CST);
    if (n == control->at) snprintf(control->last, TEXT, "%s %.200s", name, path);
    if (control->action == KILL_BEFORE) die();
    return (int)control->action;
}

static int failed(void)
{
    errno = (int)control->error;
    return -1;
}

static struct file *file_of(int fd)
{
    struct stat is;
    if (!control->follow || fstat(fd, &is) || !S_ISREG(is.st_mode)) return NULL;
    for (int n = 0; n < control->files; n++)
        if (control->file[n].inode == (int64_t)is.st_ino) return &control->file[n];
    int64_t n = __atomic_fetch_add(&control->files, 1, __ATOMIC_SEQ_CST);
    if (n >= FILES) _exit(98);
    control->file[n].inode = (int64_t)is.st_ino;
    return &control->file[n];
}

static void touched(int fd, int64_t from, int64_t to)
{
    struct file *file = file_of(fd);
    if (!file) return;
    if (to > LARGEST) _exit(99);
    if (from < to) memset(file->bytes + from, UNSYNCED, (size_t)(to - from));
    if (to > file->end) file->end = to;
}

static void change(int kind, const char *from, const char *to)
{
    if (!control->follow) return;
    if (control->changes >= CHANGES) _exit(96);
    struct change *one = &control->change[control->changes];
    memset(one, 0, sizeof *one);
    one->kind = kind;
    snprintf(one->from, TEXT, "%s", from);
    snprintf(one->to, TEXT, "%s", to);
    struct stat is;
    const char *lost = kind == RENAME ? to : from; /* the file that will be gone */
    if (kind != CREATE && !lstat(lost, &is) && !S_ISDIR(is.st_mode)) {
        snprintf(one->saved, TEXT, "%s.saved%d", getenv("FAULTY_DISK"), (int)control->changes);
        REAL(link)(lost, one->saved);
    }
    control->changes++;
}

/* A sync: of a folder, of what was changed in it; of a file, of its bytes and its being there. */
static void synced(int fd, const char *path)
{
    struct stat is;
    if (!control->follow || fstat(fd, &is)) return;
    for (int n = 0; n < control->changes; n++) {
        struct change *one = &control->change[n];
        const char *end = strrchr(one->to, '/');
        size_t length = end ? (size_t)(end - one->to) : 0;
        int in_folder = S_ISDIR(is.st_mode) && strlen(path) == length
                        && !strncmp(path, one->to, length);
        if (in_folder || (one->kind == CREATE && !strcmp(path, one->to))) one->safe = 1;
    }
    struct file *file = file_of(fd);
    for (int64_t n = 0; file && n < file->end; n++)
        if (file->bytes[n] == UNSYNCED) file->bytes[n] = SAFE;
}

static int sync_file(int fd, const char *name, int (*really)(int))
{
    char path[TEXT];
    if (!path_of(fd, path)) return really(fd);
    int action = decide(SYNC, name, path);
    if (control->delay_us) usleep((useconds_t)control->delay_us);
    if (action == FAIL || action == SHORT) return failed();
    if (action == LOSE) {
        struct file *file = file_of(fd);
        for (int64_t n = 0; file && n < file->end; n++)
            if (file->bytes[n] == UNSYNCED) file->bytes[n] = LOST;
        return failed();
    }
    if (action == KILL_HALFWAY) die();
    synced(fd, path); /* the disk of these tests is memory */
    if (action == KILL_AFTER) die();
    return 0;
}

int fsync(int fd) { return sync_file(fd, "fsync", REAL(fsync)); }
int fdatasync(int fd) { return sync_file(fd, "fdatasync", REAL(fdatasync)); }

/* What a failed sync has lost is seen by those who read past the cache. */
int posix_fadvise(int fd, off_t offset, off_t length, int advice)
{
    char path[TEXT];
    struct file *file;
    if (path_of(fd, path) && advice == POSIX_FADV_DONTNEED && (file = file_of(fd))) {
        int writable = REAL(open)(path, O_WRONLY | O_CLOEXEC);
        for (int64_t n = 0; writable >= 0 && n < file->end; n++)
            if (file->bytes[n] == LOST) REAL(pwrite)(writable, "", 1, n);
        if (writable >= 0) REAL(close)(writable);
    }
    return REAL(posix_fadvise)(fd, offset, length, advice);
}
int posix_fadvise64(int fd, off_t offset, off_t length, int advice)
{
    return posix_fadvise(fd, offset, length, advice);
}

/* A write at a place, or at the file's own (place < 0). */
static ssize_t write_at(int fd, const void *data, size_t length, int64_t place, const char *name)
{
    char path[TEXT];
    int ours = path_of(fd, path), action = ours ? decide(WRITE, name, path) : PASS;
    if (action == FAIL || action == LOSE) return failed();
    size_t now = (action == SHORT || action == KILL_HALFWAY) ? length / 2 : length;
    if (action == SHORT && !now) return failed();
    ssize_t done = place < 0 ? REAL(write)(fd, data, now) : REAL(pwrite)(fd, data, now, place);
    if (ours && done > 0) {
        int64_t end = place < 0 ? lseek(fd, 0, SEEK_CUR) : place + done;
        touched(fd, end - done, end);
    }
    if (action == KILL_AFTER || action == KILL_HALFWAY) die();
    return done;
}

ssize_t write(int fd, const void *data, size_t length)
{
    return write_at(fd, data, length, -1, "write");
}
ssize_t pwrite(int fd, const void *data, size_t length, off_t place)
{
    return write_at(fd, data, length, place, "pwrite");
}
ssize_t pwrite64(int fd, const void *data, size_t length, off_t place)
{
    return write_at(fd, data, length, place, "pwrite");
}

static ssize_t write_parts(int fd, const struct iovec *parts, int count, int64_t place)
{
    size_t length = 0, at = 0;
    for (int n = 0; n < count; n++) length += parts[n].iov_len;
    char *all = malloc(length + 1);
    for (int n = 0; n < count; at += parts[n++].iov_len)
        memcpy(all + at, parts[n].iov_base, parts[n].iov_len);
    ssize_t done = write_at(fd, all, length, place, "writev");
    int error = errno;
    free(all);
    errno = error;
    return done;
}

ssize_t writev(int fd, const struct iovec *parts, int count)
{
    return write_parts(fd, parts, count, -1);
}
ssize_t pwritev(int fd, const struct iovec *parts, int count, off_t place)
{
    return write_parts(fd, parts, count, place);
}
ssize_t pwritev64(int fd, const struct iovec *parts, int count, off_t place)
{
    return write_parts(fd, parts, count, place);
}
ssize_t pwritev2(int fd, const struct iovec *parts, int count, off_t place, int flags)
{
    (void)flags;
    return write_parts(fd, parts, count, place);
}
ssize_t pwritev64v2(int fd, const struct iovec *parts, int count, off_t place, int flags)
{
    return pwritev2(fd, parts, count, place, flags);
}

/* Whoever copies inside the system is told to copy by writes instead. */
ssize_t sendfile(int out, int in, off_t *place, size_t count)
{
    char path[TEXT];
    if (path_of(out, path)) return errno = EINVAL, -1;
    return ((ssize_t(*)(int, int, off_t *, size_t))real("sendfile"))(out, in, place, count);
}
ssize_t sendfile64(int out, int in, off_t *place, size_t count)
{
    return sendfile(out, in, place, count);
}
ssize_t copy_file_range(int in, off_t *from, int out, off_t *to, size_t count, unsigned flags)
{
    char path[TEXT];
    if (path_of(out, path)) return errno = EINVAL, -1;
    return REAL(copy_file_range)(in, from, out, to, count, flags);
}

static int set_size(int fd, off_t size, const char *name)
{
    char path[TEXT];
    struct stat before;
    int ours = path_of(fd, path), action = ours ? decide(SIZE, name, path) : PASS;
    if (action == FAIL || action == SHORT || action == LOSE) return failed();
    if (action == KILL_HALFWAY) die();
    fstat(fd, &before);
    int done = REAL(ftruncate)(fd, size);
    if (ours && !done && size > before.st_size) touched(fd, before.st_size, size);
    if (action == KILL_AFTER) die();
    return done;
}

int ftruncate(int fd, off_t size) { return set_size(fd, size, "ftruncate"); }
int ftruncate64(int fd, off_t size) { return set_size(fd, size, "ftruncate"); }

int posix_fallocate(int fd, off_t from, off_t length)
{
    char path[TEXT];
    int action = path_of(fd, path) ? decide(SIZE, "posix_fallocate", path) : PASS;
    if (action == FAIL || action == SHORT || action == LOSE) return (int)control->error;
    if (action == KILL_HALFWAY) die();
    int done = REAL(posix_fallocate)(fd, from, length);
    if (action == KILL_AFTER) die();
    return done;
}
int posix_fallocate64(int fd, off_t from, off_t length)
{
    return posix_fallocate(fd, from, length);
}

/* What has no parts: it happens or it does not. `path` is what it makes or takes away. */
#define WHOLE(kind, name, folder, given, before, call)                                             \
    char path[TEXT];                                                                               \
    if (!is_ours(folder, given, path)) return call;                                                \
    int action = decide(kind, name, path);                                                         \
    if (action == FAIL || action == SHORT || action == LOSE) return failed();                      \
    if (action == KILL_HALFWAY) die();                                                             \
    before;                                                                                        \
    int done = call;                                                                               \
    if (action == KILL_AFTER) die();                                                               \
    return done;

static void renamed(int folder, const char *name, const char *to)
{
    char from[TEXT];
    is_ours(folder, name, from);
    change(RENAME, from, to);
}

int rename(const char *from, const char *to)
{
    WHOLE(RENAME, "rename", AT_FDCWD, to, renamed(AT_FDCWD, from, path), REAL(rename)(from, to))
}
int renameat(int a, const char *from, int b, const char *to)
{
    WHOLE(RENAME, "rename", b, to, renamed(a, from, path), REAL(renameat)(a, from, b, to))
}
int renameat2(int a, const char *from, int b, const char *to, unsigned flags)
{
    WHOLE(RENAME, "rename", b, to, renamed(a, from, path), REAL(renameat2)(a, from, b, to, flags))
}
int link(const char *from, const char *to)
{
    WHOLE(RENAME, "link", AT_FDCWD, to, change(CREATE, path, path), REAL(link)(from, to))
}
int unlink(const char *name)
{
    WHOLE(UNLINK, "unlink", AT_FDCWD, name, change(UNLINK, path, path), REAL(unlink)(name))
}
int unlinkat(int a, const char *name, int flags)
{
    WHOLE(UNLINK, "unlink", a, name, change(UNLINK, path, path), REAL(unlinkat)(a, name, flags))
}
int mkdir(const char *name, mode_t mode)
{
    WHOLE(FOLDER, "mkdir", AT_FDCWD, name, , REAL(mkdir)(name, mode))
}
int rmdir(const char *name)
{
    WHOLE(FOLDER, "rmdir", AT_FDCWD, name, , REAL(rmdir)(name))
}

static int open_file(int folder, const char *name, int flags, mode_t mode)
{
    int is_new = faccessat(folder, name, F_OK, 0) != 0;
    if (!(is_new && (flags & O_CREAT)) && !(flags & O_TRUNC))
        return REAL(openat)(folder, name, flags, mode);
    WHOLE(CREATE, is_new ? "create" : "empty", folder, name,
          if (is_new) change(CREATE, path, path), REAL(openat)(folder, name, flags, mode))
}

#define MODE(flags)                                                                                \
    mode_t mode = 0;                                                                               \
    if ((flags) & (O_CREAT | O_TMPFILE)) {                                                         \
        va_list rest;                                                                              \
        va_start(rest, flags);                                                                     \
        mode = va_arg(rest, mode_t);                                                               \
        va_end(rest);                                                                              \
    }

int open(const char *path, int flags, ...)
{
    MODE(flags) return open_file(AT_FDCWD, path, flags, mode);
}
int open64(const char *path, int flags, ...)
{
    MODE(flags) return open_file(AT_FDCWD, path, flags, mode);
}
int openat(int folder, const char *path, int flags, ...)
{
    MODE(flags) return open_file(folder, path, flags, mode);
}
int openat64(int folder, const char *path, int flags, ...)
{
    MODE(flags) return open_file(folder, path, flags, mode);
}
