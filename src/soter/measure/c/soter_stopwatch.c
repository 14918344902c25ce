/* soter_stopwatch.c: how long steps take on this machine.
 *
 * Purpose: see soter_stopwatch.h. A step is what the kernel does of a component: its rule, its
 * contracts, the step function. The clock is read before and after, which is counted in; around
 * that, the time that this thread was given a processor. Neither is less than what the step needs:
 * the lesser counts, so that a step is not longer because another program ran meanwhile.
 * Non-goals: instants, properties, queues of releases.
 */
#define _POSIX_C_SOURCE 199309L
#include "soter_stopwatch.h"

#include <string.h>
#include <time.h>

static int64_t read_ns(clockid_t clock) {
  struct timespec t;
  (void)clock_gettime(clock, &t);
  return (int64_t)t.tv_sec * INT64_C(1000000000) + (int64_t)t.tv_nsec;
}

/* Writes every line of a buffer that is larger than the caches near the processor. */
static void sweep(const soter_timing* t, size_t round) {
  for (size_t i = 0; i < t->size; i += 64U) {
    t->swept[i] = (unsigned char)(t->swept[i] + round);
  }
}

uint32_t soter_stopwatch(const soter_timing* t) {
  SOTER_CHECK(t != NULL);
  SOTER_CHECK(t->stride == t->program->state_size);
  const soter_component* const c = soter_components_of(t->state) + t->component;
  uint32_t faulted = 0;
  for (size_t k = 0; k < t->count; k++) {
    (void)memcpy(t->state, (const unsigned char*)t->from + k * t->stride, t->stride);
    const uint32_t before = c->faults;
    sweep(t, k);
    const int64_t given = read_ns(CLOCK_THREAD_CPUTIME_ID);
    const int64_t begun = read_ns(CLOCK_MONOTONIC);
    (void)soter_fire(t->program, t->state, t->component, NULL);
    const int64_t passed = read_ns(CLOCK_MONOTONIC) - begun;
    const int64_t used = read_ns(CLOCK_THREAD_CPUTIME_ID) - given;
    t->took[k] = used < passed ? used : passed;
    faulted += c->faults - before;
  }
  return faulted;
}
