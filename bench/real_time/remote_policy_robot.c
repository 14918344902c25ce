/* remote_policy_robot.c: the robot's side of bench/real_time/remote_policy.py.
 *
 * Purpose: writes an observation and waits for the action that is stamped like it, again and again;
 * prints how long each took, in ns. Non-goals: being on time.
 */
#define _GNU_SOURCE

#include "robot_channels.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define SECOND INT64_C(1000000000)
#define ROOM 2000000

static int64_t took[ROOM];

static int64_t now_ns(void) {
  struct timespec t;
  (void)clock_gettime(CLOCK_MONOTONIC, &t);
  return (int64_t)t.tv_sec * SECOND + t.tv_nsec;
}

/* Until the answer to the observation of `measured` is there; false: nobody answers. */
static bool answered(soter_outside* wish, int64_t measured, int64_t end) {
  while (now_ns() < end) {
    int64_t stamp = 0;
    double action = 0.0;
    if (soter_outside_read(wish, &stamp, &action, NULL) && stamp == measured) {
      return true;
    }
    soter_outside_wait(wish, SECOND / 10);
  }
  return false;
}

int main(int count, char** arguments) {
  soter_outside position;
  soter_outside wish;
  if (count != 4 || robot_open_position(&position, arguments[1]) != NULL ||
      robot_open_wish(&wish, arguments[1]) != NULL) {
    return 2;
  }
  const int64_t period = (int64_t)(strtod(arguments[3], NULL) * 1e9);
  const double x = 1.0;
  bool there = false;
  while (!there) { /* until the policy has come */
    const int64_t measured = now_ns();
    soter_outside_write(&position, measured, &x);
    there = answered(&wish, measured, measured + SECOND / 5);
  }
  const int64_t end = now_ns() + (int64_t)(strtod(arguments[2], NULL) * 1e9);
  int64_t due = now_ns();
  size_t trips = 0;
  while (due < end && trips < ROOM) {
    const int64_t measured = now_ns();
    soter_outside_write(&position, measured, &x);
    if (answered(&wish, measured, measured + SECOND)) {
      took[trips++] = now_ns() - measured;
    }
    const int64_t next = due + period;
    due = next > now_ns() ? next : now_ns();
    const struct timespec at = {.tv_sec = (time_t)(due / SECOND), .tv_nsec = (long)(due % SECOND)};
    if (period > 0) {
      (void)clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL);
    }
  }
  for (size_t i = 0; i < trips; i++) {
    (void)printf("%" PRId64 "\n", took[i]);
  }
  return 0;
}
