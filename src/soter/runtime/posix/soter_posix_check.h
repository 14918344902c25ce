/* soter_posix_check.h: what a check that fails says (soter_check.h).
 *
 * Purpose: one line on standard error, from whichever thread or process, for those that define
 * soter_check_failed. It never waits: whoever reads that end may have stopped, and what comes after
 * the line is what makes actuators safe. Non-goals: what comes after it (soter_posix_check.c,
 * soter_actuator.c).
 */
#ifndef SOTER_POSIX_CHECK_H
#define SOTER_POSIX_CHECK_H

#include "soter_check.h"

#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define SOTER_DEFECT 70     /* the exit code */
#define SOTER_LINE_MOST 512 /* a pipe that can be written takes as much at once */

/* soter_process.h, where the process has it: what it is about to leave is not passed on any more */
extern int soter_process_stderr __attribute__((weak));

static inline void soter_posix_say(const char* file, int line, const char* what) {
  char text[SOTER_LINE_MOST];
  const int to = &soter_process_stderr == NULL ? STDERR_FILENO : soter_process_stderr;
  struct pollfd out = {.fd = to, .events = POLLOUT};
  (void)snprintf(text, sizeof text, "soter has a defect: %s:%d: not %s\n", file, line, what);
  if (poll(&out, 1, 0) == 1 && (out.revents & POLLOUT) != 0) {
    const ssize_t written = write(to, text, strlen(text));
    (void)written;
  }
}

#endif
