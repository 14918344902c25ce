/* soter_posix_check.c: a check that fails in the driver, in a worker, in a program beside them.
 *
 * Purpose: this process ends at once. Of the driver: no lease is given any more, so the actuators
 * come to their law by their own clock, as after a SIGKILL. Of a worker: its node answers no more,
 * and its module goes to SC; of the process that starts workers: all of them. Of a sensor: its
 * topic grows old. Non-goals: the process of the actuators, which holds the law (soter_actuator.c).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_posix_check.h"

#include <unistd.h>

void soter_check_failed(const char* file, int line, const char* what) {
  soter_posix_say(file, line, what);
  _exit(SOTER_DEFECT);
}
