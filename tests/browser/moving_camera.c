/* A camera that only the program sees that loads this before its C library (LD_PRELOAD): the file that TEST_CAMERA
 * names becomes a device of Video4Linux, with 640 x 480 points in YUYV, 25 times a second, and stripes that move.
 * Once that file is removed, the camera is unplugged. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/timerfd.h>
#include <unistd.h>

enum { WIDTH = 640, HEIGHT = 480, SIZE = WIDTH * HEIGHT * 2, BUFFERS = 8 };

static int device = -1;
static uint8_t *memory[BUFFERS];
static unsigned queue[BUFFERS], queued, number;

static int is_camera(const char *path) {
    const char *name = getenv("TEST_CAMERA");
    return name && strcmp(path, name) == 0;
}

static int open_camera(void) {
    struct itimerspec every = {{0, 40000000}, {0, 40000000}};
    device = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK);
    timerfd_settime(device, 0, &every, NULL);
    queued = 0;
    return device;
}

static int real_open(const char *path, int flags, unsigned mode) {
    int (*next)(const char *, int, ...) = dlsym(RTLD_NEXT, "open64");
    return is_camera(path) ? open_camera() : next(path, flags, mode);
}

#define OPEN(name)                                \
    int name(const char *path, int flags, ...) {  \
        va_list rest;                             \
        va_start(rest, flags);                    \
        unsigned mode = va_arg(rest, unsigned);   \
        va_end(rest);                             \
        return real_open(path, flags, mode);      \
    }
OPEN(open)
OPEN(open64)
OPEN(__open_2)
OPEN(__open64_2)

int close(int fd) {
    int (*next)(int) = dlsym(RTLD_NEXT, "close");
    if (fd == device) device = -1;
    return next(fd);
}

static void *map(void *at, size_t size, int protection, int flags, int fd, off_t offset) {
    void *(*next)(void *, size_t, int, int, int, off_t) = dlsym(RTLD_NEXT, "mmap64");
    if (fd < 0 || fd != device) return next(at, size, protection, flags, fd, offset);
    return memory[offset / SIZE] = next(NULL, size, protection, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
}
void *mmap(void *a, size_t s, int p, int f, int fd, off_t o) { return map(a, s, p, f, fd, o); }
void *mmap64(void *a, size_t s, int p, int f, int fd, off_t o) { return map(a, s, p, f, fd, o); }

static void paint(uint8_t *at) {
    number++;
    for (unsigned y = 0; y < HEIGHT; y++)
        for (unsigned x = 0; x < WIDTH; x++) {
            *at++ = ((x + 8 * number + y / 2) / 40) % 2 ? 200 : 60;
            *at++ = x % 2 ? 90 + y / 8 : 150 - y / 8;
        }
}

static int control(unsigned long request, void *argument) {
    uint64_t ticks;
    if (access(getenv("TEST_CAMERA"), F_OK) != 0) return errno = ENODEV, -1;
    switch (request) {
    case VIDIOC_QUERYCAP: {
        struct v4l2_capability *able = argument;
        memset(able, 0, sizeof *able);
        strcpy((char *)able->driver, "test");
        able->capabilities = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
        return 0;
    }
    case VIDIOC_S_INPUT:
    case VIDIOC_STREAMON:
    case VIDIOC_STREAMOFF:
        return 0;
    case VIDIOC_S_FMT: {
        struct v4l2_pix_format *shape = &((struct v4l2_format *)argument)->fmt.pix;
        shape->width = WIDTH, shape->height = HEIGHT, shape->pixelformat = V4L2_PIX_FMT_YUYV;
        shape->bytesperline = 2 * WIDTH, shape->sizeimage = SIZE;
        return 0;
    }
    case VIDIOC_REQBUFS: {
        struct v4l2_requestbuffers *wanted = argument;
        if (wanted->count > BUFFERS) wanted->count = BUFFERS;
        return 0;
    }
    case VIDIOC_QUERYBUF: {
        struct v4l2_buffer *buffer = argument;
        buffer->length = SIZE, buffer->m.offset = buffer->index * SIZE;
        return 0;
    }
    case VIDIOC_QBUF:
        queue[queued++ % BUFFERS] = ((struct v4l2_buffer *)argument)->index;
        return 0;
    case VIDIOC_DQBUF: {
        struct v4l2_buffer *buffer = argument;
        if (!queued || read(device, &ticks, sizeof ticks) < 0) return errno = EAGAIN, -1;
        buffer->index = queue[0], buffer->bytesused = buffer->length = SIZE;
        memmove(queue, queue + 1, --queued * sizeof *queue);
        paint(memory[buffer->index]);
        return 0;
    }
    }
    return errno = ENOTTY, -1;
}

int ioctl(int fd, unsigned long request, ...) {
    int (*next)(int, unsigned long, ...) = dlsym(RTLD_NEXT, "ioctl");
    va_list rest;
    va_start(rest, request);
    void *argument = va_arg(rest, void *);
    va_end(rest);
    return fd >= 0 && fd == device ? control(request & 0xffffffff, argument) : next(fd, request, argument);
}
