/* soter_bridge_common.h: what the bridges in C have in common.
 *
 * Purpose: the clock of the channels, numbers among arguments, lines on standard error.
 * Non-goals: a middleware; what is judged. C99 and POSIX.
 */
#ifndef SOTER_BRIDGE_COMMON_H
#define SOTER_BRIDGE_COMMON_H

#include <errno.h>
#include <poll.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define SOTER_BRIDGE_LINE 512 /* a pipe that can be written takes as much at once */

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

/* A line on standard error; none where whoever reads that end does not: a topic waits for nobody.
 */
static inline void soter_bridge_say(const char* program, const char* about, const char* what) {
  char line[SOTER_BRIDGE_LINE];
  struct pollfd out = {.fd = STDERR_FILENO, .events = POLLOUT, .revents = 0};
  (void)snprintf(line, sizeof line - 1, "%s: %s%s%s", program, about, about[0] != '\0' ? ": " : "",
                 what);
  (void)strcat(line, "\n");
  if (poll(&out, 1, 0) == 1 && (out.revents & POLLOUT) != 0) {
    const ssize_t written = write(STDERR_FILENO, line, strlen(line));
    (void)written;
  }
}

#endif
