/* soter_posix_clock.c: what time it is.
 *
 * Purpose: the two clocks that the driver reads, in whole nanoseconds. Every file of it may ask, so
 * this one asks nobody. Non-goals: sleeping; time of the program.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_posix.h"

#include <time.h>

#define SECOND INT64_C(1000000000)

static int64_t read_clock(clockid_t clock) {
  struct timespec t = {0, 0};
  const bool told = clock_gettime(clock, &t) == 0;
  SOTER_CHECK(told && t.tv_sec >= 0 && t.tv_nsec >= 0 && t.tv_nsec < SECOND);
  (void)told;
  return (int64_t)t.tv_sec * SECOND + t.tv_nsec;
}

int64_t soter_posix_clock(void) {
  return read_clock(CLOCK_MONOTONIC);
}

int64_t soter_posix_independent(void) {
  return read_clock(CLOCK_MONOTONIC_RAW);
}
