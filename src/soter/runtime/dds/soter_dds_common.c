/* soter_dds_common.c: what every file of a bridge uses.
 *
 * Purpose: clocks, whether the end was asked for, counters, and lines on standard error.
 * Non-goals: samples (soter_dds_samples.c), the others (soter_dds_peers.c).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_bridge_common.h"
#include "soter_dds_topics.h"
#include "soter_process.h"

#include <signal.h>
#include <stdio.h>

static volatile sig_atomic_t ending = 0;

bool soter_dds_ending(void) {
  return ending != 0;
}

void soter_dds_end(void) {
  ending = 1;
}

int64_t soter_dds_monotonic_ns(void) {
  return soter_bridge_clock(CLOCK_MONOTONIC);
}

int64_t soter_dds_wall_ns(void) {
  return soter_bridge_clock(CLOCK_REALTIME);
}

void soter_dds_say(const soter_dds_bridge* bridge, const char* about, const char* what) {
  SOTER_CHECK(bridge->system != NULL);
  soter_process_say("%s: %s%s%s", bridge->system->program, about, about[0] != '\0' ? ": " : "",
                    what);
}

void soter_dds_count(soter_dds_topic* topic, int what, const char* why) {
  SOTER_CHECK(what >= 0 && what < SOTER_DDS_COUNTS);
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
