/* soter_worker.c: the other side: the process of an extern node in C.
 *
 * Purpose: wait for a request, call the function, write the answer. Started by the driver with the
 * segments as files 3 and 4.
 * Non-goals: being on time or right: the driver believes nothing that comes from here.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_channel.h"
#include "soter_worker_app.h"

#include <linux/futex.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#define REQUEST_FD 3
#define ANSWER_FD 4
#define EXIT_LAYOUT 3

/* Sleeps while the low half of the sequence is `seen`. */
static void wait_for_more(const uint64_t* sequence, uint64_t seen) {
  (void)syscall(SYS_futex, sequence, FUTEX_WAIT, (uint32_t)seen, NULL, NULL, 0);
}

static void answer(void* segment, const soter_channel_head* request, uint64_t* in, uint64_t* out) {
  (void)memset(out, 0, SOTER_CHANNEL_WORDS(WORKER_OUT_SIZE) * 8U);
  const int failed = soter_worker_step(in, out);
  const soter_channel_head head = {.hash = WORKER_HASH,
                                   .number = request->number,
                                   .time_ns = request->time_ns,
                                   .fault = failed != 0 ? 1U : 0U};
  soter_channel_write(segment, &head, WORKER_OUT_SIZE, out);
}

int main(void) {
  static uint64_t in[SOTER_CHANNEL_WORDS(WORKER_IN_SIZE) + 1U];
  static uint64_t out[SOTER_CHANNEL_WORDS(WORKER_OUT_SIZE) + 1U];
  const size_t in_bytes = soter_channel_bytes(WORKER_IN_SIZE);
  const size_t out_bytes = soter_channel_bytes(WORKER_OUT_SIZE);
  (void)setvbuf(stdout, NULL, _IOLBF, BUFSIZ); /* it is no terminal */
  const void* const asked = mmap(NULL, in_bytes, PROT_READ, MAP_SHARED, REQUEST_FD, 0);
  void* const given = mmap(NULL, out_bytes, PROT_READ | PROT_WRITE, MAP_SHARED, ANSWER_FD, 0);
  if (asked == MAP_FAILED || given == MAP_FAILED) {
    (void)fprintf(stderr, "soter worker: started by hand? files 3 and 4 are no segments\n");
    return 2;
  }
  const soter_channel_head ready = {.hash = WORKER_HASH};
  soter_channel_write(given, &ready, WORKER_OUT_SIZE, out);
  soter_channel_head head;
  uint64_t last = 0;
  for (;;) {
    const uint64_t seen = __atomic_load_n((const uint64_t*)asked, __ATOMIC_ACQUIRE);
    const soter_channel_state found =
        soter_channel_read(asked, WORKER_HASH, WORKER_IN_SIZE, last, &head, in);
    if (found == SOTER_CHANNEL_LAYOUT || found == SOTER_CHANNEL_SIZE) {
      (void)fprintf(stderr, "soter worker: built for another program: build both anew\n");
      return EXIT_LAYOUT;
    }
    if (found == SOTER_CHANNEL_OTHER) {
      last = head.number;
      answer(given, &head, in, out);
    } else {
      wait_for_more((const uint64_t*)asked, seen);
    }
  }
}
