/* soter_channel.h: one value at a time between two processes, without locks.
 *
 * Purpose: a segment of shared memory with one writer. The reader never waits: it copies once, and
 * then looks at what it copied. It knows size and layout beforehand and takes neither from the
 * segment, so whatever stands there, it reads so many bytes and no more.
 * Non-goals: making segments, processes; what the bytes mean (the kernel's gate).
 *
 * C99 with the `__atomic` builtins of gcc and clang; every access to a segment is one of them.
 */
#ifndef SOTER_CHANNEL_H
#define SOTER_CHANNEL_H

#include <stddef.h>
#include <stdint.h>

/* A segment: these words, then the value, rounded up to whole words. */
typedef struct {
  uint64_t sequence; /* odd while the writer writes */
  uint64_t hash;     /* of the layouts of both values, by soter: an older program has another */
  uint64_t size;     /* of the value, bytes */
  uint64_t number;   /* of the request, 1, 2, ...; that it answers; 0: "I am ready" */
  uint64_t time_ns;  /* ct of the request */
  uint64_t fault;    /* of an answer: 0, or the step failed */
  uint64_t sum;      /* over all of the above but `sequence`, and the value */
  uint64_t more;     /* of a request: the seed; of an answer: 0 */
} soter_channel_head;

typedef enum {
  SOTER_CHANNEL_FRESH = 0,  /* it is the answer, whole */
  SOTER_CHANNEL_OTHER = 1,  /* whole, but of another request: nothing new, or a stale write */
  SOTER_CHANNEL_TORN = 2,   /* it was being written, or its sum is not that of what stands there */
  SOTER_CHANNEL_SIZE = 3,   /* it says another size */
  SOTER_CHANNEL_LAYOUT = 4, /* it says another layout */
  SOTER_CHANNEL_EMPTY = 5   /* nobody ever wrote */
} soter_channel_state;

#define SOTER_CHANNEL_STATES 6

/* Bytes of a segment for values of `size` bytes. */
size_t soter_channel_bytes(size_t size);

/* The one writer writes; `head` is everything but `sequence`, `size` and `sum`. `value` is as long
 * SOTER_CHANNEL_WORDS says: whole words, zeros behind its `size` bytes. */
void soter_channel_write(void* segment, const soter_channel_head* head, size_t size,
                         const uint64_t* value);

/* One copy, once: SOTER_CHANNEL_FRESH where a whole value of this layout and size stands there with
 * `number`; then `head` and `value` (whole words) are it. Otherwise `value` holds anything. */
soter_channel_state soter_channel_read(const void* segment, uint64_t hash, size_t size,
                                       uint64_t number, soter_channel_head* head, uint64_t* value);

/* Words of a value of `size` bytes. */
#define SOTER_CHANNEL_WORDS(size) (((size) + 7U) / 8U)

#endif
