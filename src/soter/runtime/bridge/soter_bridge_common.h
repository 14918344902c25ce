/* soter_bridge_common.h: what the bridges in C have in common.
 *
 * Purpose: the clock of the channels, numbers among arguments.
 * Non-goals: a middleware; what is judged. C99 and POSIX.
 */
#ifndef SOTER_BRIDGE_COMMON_H
#define SOTER_BRIDGE_COMMON_H

#include <errno.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <time.h>

static inline int64_t soter_bridge_clock(clockid_t clock) {
  struct timespec t = {0, 0};
  (void)clock_gettime(clock, &t);
  return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* False where the text is no number from `least` to `most`. */
static inline bool soter_bridge_number(const char* text, double least, double most, double* value) {
  char* end = NULL;
  errno = 0;
  *value = strtod(text, &end);
  return errno == 0 && end != text && *end == '\0' && *value >= least && *value <= most;
}

#endif
