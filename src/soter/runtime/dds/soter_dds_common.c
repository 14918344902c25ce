/* soter_dds_common.c: what every file of a bridge uses.
 *
 * Purpose: clocks, whether the end was asked for, counters, and lines on standard error.
 * Non-goals: samples (soter_dds_samples.c), the others (soter_dds_peers.c).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_dds_bridge.h"

#include "soter_dds_topics.h"

#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

static volatile sig_atomic_t ending = 0;

bool soter_dds_ending(void) {
  return ending != 0;
}

void soter_dds_end(void) {
  ending = 1;
}

static int64_t on_clock(clockid_t clock) {
  struct timespec t = {0, 0};
  (void)clock_gettime(clock, &t);
  return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

int64_t soter_dds_monotonic_ns(void) {
  return on_clock(CLOCK_MONOTONIC);
}
int64_t soter_dds_wall_ns(void) {
  return on_clock(CLOCK_REALTIME);
}

/* A line on standard error; none where whoever reads that end does not: a topic waits for nobody.
 */
void soter_dds_say(const soter_dds_bridge* bridge, const char* about, const char* what) {
  char line[SOTER_DDS_LINE];
  struct pollfd out = {.fd = STDERR_FILENO, .events = POLLOUT};
  (void)snprintf(line, sizeof line - 1, "%s: %s%s%s", bridge->system->program, about,
                 about[0] != '\0' ? ": " : "", what);
  (void)strcat(line, "\n");
  if (poll(&out, 1, 0) == 1 && (out.revents & POLLOUT) != 0) {
    const ssize_t written = write(STDERR_FILENO, line, strlen(line));
    (void)written;
  }
}

void soter_dds_count(soter_dds_topic* topic, int what, const char* why) {
  (void)pthread_mutex_lock(&topic->held);
  const uint64_t many = ++topic->count[what];
  if (why != NULL) {
    (void)snprintf(topic->why, sizeof topic->why, "%s", why);
  }
  (void)pthread_mutex_unlock(&topic->held);
  if (why != NULL && (many & (many - 1)) == 0) { /* the first, the second, the fourth ... */
    soter_dds_say(topic->bridge, topic->topic, why);
  }
}
