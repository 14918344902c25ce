/* soter_outside.c: see soter_outside.h.
 *
 * Purpose: files that are mapped, and two places in each.
 * Non-goals: more than one writer.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_outside.h"

#include "soter_check.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/futex.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define LINE ((size_t)64)
#define WRITTEN 0 /* words of the bell */
#define WAITING 1
#define SECOND INT64_C(1000000000)
#define PATH_MOST 4096

/* A place begins at a line of the cache. */
static size_t place_bytes(size_t size) {
  return (soter_channel_bytes(size) + LINE - 1U) / LINE * LINE;
}

static size_t file_bytes(size_t size) {
  return 2U * place_bytes(size) + LINE;
}

static size_t room_bytes(size_t size) {
  return 8U * SOTER_CHANNEL_WORDS(size) + 8U;
}

static void* mapped(int file, size_t bytes) {
  const int shared = file < 0 ? MAP_PRIVATE | MAP_ANONYMOUS : MAP_SHARED;
  void* const at = mmap(NULL, bytes, PROT_READ | PROT_WRITE, shared | MAP_POPULATE, file, 0);
  return at == MAP_FAILED ? NULL : at;
}

/* Room that is there: a page of a hole, in a tmpfs that is full, would end whoever touches it. */
static const char* make_room(int file, size_t bytes, bool empty) {
  SOTER_CHECK(file >= 0 && bytes > 0U);
  if (fallocate(file, 0, 0, (off_t)bytes) == 0) {
    return NULL;
  }
  if (errno == EOPNOTSUPP && (!empty || ftruncate(file, (off_t)bytes) == 0)) {
    return NULL; /* this file system promises no room */
  }
  return errno == ENOSPC ? "there is no room for it: the file system of the folder is full"
                         : strerror(errno);
}

static const char* map_file(soter_outside* c, int file) {
  const size_t bytes = file_bytes(c->size);
  struct stat found;
  SOTER_CHECK(file >= 0 && c->place[0] == NULL);
  if (fstat(file, &found) != 0 || !S_ISREG(found.st_mode)) {
    return "it is no file";
  }
  if (found.st_size != 0 && (size_t)found.st_size != bytes) {
    return "it is of another layout: built for another program, or of an older one; remove it";
  }
  const char* const wrong = make_room(file, bytes, found.st_size == 0);
  if (wrong != NULL) {
    return wrong;
  }
  c->room = mapped(-1, room_bytes(c->size));
  uint8_t* const at = c->room == NULL ? NULL : mapped(file, bytes);
  if (at == NULL) {
    return strerror(errno);
  }
  c->place[0] = at;
  c->place[1] = at + place_bytes(c->size);
  c->bell = (uint32_t*)(void*)(at + 2U * place_bytes(c->size));
  return NULL;
}

/* Reads the value of a place into `c->room`; gives its number, 0 if there is none. */
static uint64_t read_place(soter_outside* c, int place, soter_channel_head* head, uint64_t* bad) {
  SOTER_CHECK((place == 0 || place == 1) && c->place[place] != NULL && c->room != NULL);
  const soter_channel_state found =
      soter_channel_read(c->place[place], c->hash, c->size, 0U, head, c->room);
  if (found == SOTER_CHANNEL_OTHER) {
    return head->number;
  }
  if (bad != NULL && found != SOTER_CHANNEL_EMPTY) {
    (*bad)++;
  }
  return 0U;
}

/* The lock is of the file as it was opened here, and the system takes it back when nobody has that
 * open, or mapped, any more: a second writer is refused in this process, too, and files of that
 * name that are closed here, as who reads closes his, free nothing. Where there are no such locks
 * (Linux before 3.15; an imitation of it says EINVAL) it is the process's: other processes are
 * refused, a second writer here is not, and whoever closes a file of that name here frees it. */
static int lock_whole(int file) {
  struct flock whole = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
  SOTER_CHECK(file >= 0);
#ifdef F_OFD_SETLK
  const int locked = fcntl(file, F_OFD_SETLK, &whole);
  if (locked == 0 || errno != EINVAL) {
    return locked;
  }
#endif
  return fcntl(file, F_SETLK, &whole);
}

/* One writer, until it ends, however. */
static const char* become_writer(int file) {
  SOTER_CHECK(file >= 0);
  if (lock_whole(file) == 0) {
    return NULL;
  }
  return errno == EAGAIN || errno == EACCES ? "it has a writer already; end that one first"
                                            : strerror(errno);
}

/* The file of who writes stays open, as its lock is gone when it is closed. */
static const char* take_file(soter_outside* c, int file, bool writes) {
  const char* wrong = writes ? become_writer(file) : NULL;
  SOTER_CHECK(c->file < 0);
  wrong = wrong != NULL ? wrong : map_file(c, file);
  if (writes && wrong == NULL) {
    c->file = file;
  } else {
    (void)close(file);
  }
  return wrong;
}

const char* soter_outside_open(soter_outside* channel, const char* folder, const char* name,
                               uint64_t hash, size_t size, bool writes) {
  char path[PATH_MOST];
  SOTER_CHECK(channel != NULL && folder != NULL && name != NULL);
  *channel = (soter_outside){.size = size, .hash = hash, .file = -1};
  const int length = snprintf(path, sizeof path, "%s/%s", folder, name);
  if (length < 0 || length >= PATH_MOST) {
    return "its path is too long";
  }
  const int file = open(path, O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0660);
  if (file < 0) {
    return strerror(errno);
  }
  const char* const wrong = take_file(channel, file, writes);
  if (wrong != NULL) {
    channel->place[0] = NULL;
  } else if (writes) { /* it goes on with the next number */
    soter_channel_head head;
    const uint64_t first = read_place(channel, 0, &head, NULL);
    const uint64_t second = read_place(channel, 1, &head, NULL);
    channel->number = first > second ? first : second;
  }
  return wrong;
}

void soter_outside_close(soter_outside* channel) {
  SOTER_CHECK(channel != NULL);
  if (channel->place[0] == NULL) {
    return;
  }
  (void)munmap(channel->place[0], file_bytes(channel->size));
  (void)munmap(channel->room, room_bytes(channel->size));
  if (channel->file >= 0) {
    (void)close(channel->file);
  }
  *channel = (soter_outside){.size = channel->size, .hash = channel->hash, .file = -1};
}

void soter_outside_write(soter_outside* channel, int64_t time_ns, const void* value) {
  SOTER_CHECK(channel->place[0] != NULL && channel->room != NULL); /* it is open */
  SOTER_CHECK(value != NULL);
  channel->number++;
  const soter_channel_head head = {
      .hash = channel->hash, .number = channel->number, .time_ns = (uint64_t)time_ns};
  const size_t words = SOTER_CHANNEL_WORDS(channel->size);
  channel->room[words > 0U ? words - 1U : 0U] = 0U; /* zeros behind the value */
  (void)memcpy(channel->room, value, channel->size);
  soter_channel_write(channel->place[channel->number % 2U], &head, channel->size, channel->room);
  (void)__atomic_add_fetch(&channel->bell[WRITTEN], 1U, __ATOMIC_SEQ_CST);
  if (__atomic_load_n(&channel->bell[WAITING], __ATOMIC_SEQ_CST) != 0U) {
    (void)syscall(SYS_futex, &channel->bell[WRITTEN], FUTEX_WAKE, INT32_MAX, NULL, NULL, 0);
  }
}

void soter_outside_wait(soter_outside* channel, int64_t most_ns) {
  SOTER_CHECK(channel->bell != NULL && most_ns >= 0);
  const uint32_t written = __atomic_load_n(&channel->bell[WRITTEN], __ATOMIC_SEQ_CST);
  const struct timespec most = {.tv_sec = (time_t)(most_ns / SECOND),
                                .tv_nsec = (long)(most_ns % SECOND)};
  (void)__atomic_add_fetch(&channel->bell[WAITING], 1U, __ATOMIC_SEQ_CST);
  soter_channel_head head;
  const uint64_t first = read_place(channel, 0, &head, NULL);
  const uint64_t second = read_place(channel, 1, &head, NULL);
  if (first <= channel->number && second <= channel->number) {
    (void)syscall(SYS_futex, &channel->bell[WRITTEN], FUTEX_WAIT, written, &most, NULL, 0);
  }
  (void)__atomic_sub_fetch(&channel->bell[WAITING], 1U, __ATOMIC_SEQ_CST);
}

bool soter_outside_read(soter_outside* channel, int64_t* time_ns, void* value, uint64_t* bad) {
  SOTER_CHECK(time_ns != NULL && value != NULL);
  uint64_t newest = channel->number;
  for (int place = 0; place < 2; place++) {
    soter_channel_head head;
    const uint64_t number = read_place(channel, place, &head, bad);
    if (number > newest) {
      newest = number;
      *time_ns = (int64_t)head.time_ns;
      (void)memcpy(value, channel->room, channel->size);
    }
  }
  const bool fresh = newest > channel->number;
  channel->number = newest;
  return fresh;
}
