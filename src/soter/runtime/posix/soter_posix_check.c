/* soter_posix_check.c: a check that fails in the driver, in a worker, in a program beside them.
 *
 * Purpose: this process ends at once. Of the driver: no lease is given any more, so the actuators
 * come to their law by their own clock, as after a SIGKILL. Of a worker: its node answers no more,
 * and its module goes to SC; of the process that starts workers: all of them. Of a sensor: its
 * topic grows old. It says so now or never: whoever reads that may have stopped. Non-goals: the
 * process of the actuators, which holds the law (soter_actuator.c).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_check.h"

#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define EXIT_DEFECT 70
#define LINE_MOST 512 /* a pipe that can be written takes as much at once */

/* soter_process.h, where the process has it: in its pipe a last word would stay */
extern int soter_process_stderr __attribute__((weak));

void soter_check_failed(const char* file, int line, const char* what) {
  char text[LINE_MOST];
  const int to = &soter_process_stderr == NULL ? STDERR_FILENO : soter_process_stderr;
  struct pollfd out = {.fd = to, .events = POLLOUT};
  (void)snprintf(text, sizeof text, "soter has a defect: %s:%d: not %s\n", file, line, what);
  if (poll(&out, 1, 0) == 1 && (out.revents & POLLOUT) != 0) {
    const ssize_t written = write(to, text, strlen(text));
    (void)written;
  }
  _exit(EXIT_DEFECT);
}
