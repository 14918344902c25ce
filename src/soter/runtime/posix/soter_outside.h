/* soter_outside.h: values between programs of one machine that start and end on their own.
 *
 * Purpose: a channel is a file in a folder (of /dev/shm, say): one writer, any readers, nobody
 * waits. It has two places for a value; the writer takes them in turns, so one that is killed in
 * the middle of a value, or is not on time with it, leaves the one before. Whoever comes first
 * makes the file; a program that starts anew goes on where the one before it was.
 * Non-goals: protection from those who may write into the folder: they can cut a file, and end
 * everybody who has it mapped (docs/real-time.md); what the bytes mean.
 */
#ifndef SOTER_OUTSIDE_H
#define SOTER_OUTSIDE_H

#include "soter_channel.h"

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  void* place[2]; /* two segments of soter_channel.h; NULL: not open */
  uint32_t* bell; /* how many values were written, and how many readers wait: soter_outside_wait */
  uint64_t* room; /* for a value, whole words */
  size_t size;
  uint64_t hash;
  uint64_t number; /* of the last value that was written, or read */
  int file;        /* of who writes: open, as its lock is gone when it is closed; else -1 */
} soter_outside;

/* Opens `folder`/`name`, and makes it where it is not there, to read or, `writes`, to write. NULL,
 * or what is wrong, in words: to write, that somebody does already. Not for a loop: it asks the
 * system for memory, and the file of who writes stays open. */
const char* soter_outside_open(soter_outside* channel, const char* folder, const char* name,
                               uint64_t hash, size_t size, bool writes);

/* Gives back what `open` took; nothing where nothing is open. Who wrote is no writer any more. A
 * process that a writer forked, and that goes on without exec, has to: it has the writer's lock, as
 * long as the file is open or mapped there, and would keep it when the writer has ended. */
void soter_outside_close(soter_outside* channel);

/* `time_ns` on CLOCK_MONOTONIC: of a sensor's value, when it was measured. */
void soter_outside_write(soter_outside* channel, int64_t time_ns, const void* value);

/* The newest whole value; false where there is none that was not read before. `bad`, where it is
 * not NULL, counts a place that is no whole value of this layout: of two one may be in the making.
 */
bool soter_outside_read(soter_outside* channel, int64_t* time_ns, void* value, uint64_t* bad);

/* Waits until something was written after the last value that was read, `most_ns` at most. For
 * whoever need not be on time: the writer wakes those who wait, and waits for nobody. */
void soter_outside_wait(soter_outside* channel, int64_t most_ns);

#ifdef __cplusplus
}
#endif

#endif
