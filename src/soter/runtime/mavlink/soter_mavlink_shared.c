/* soter_mavlink_shared.c: what every file of the bridge needs.
 *
 * Purpose: the time, whether it is to end, what is said, sending. Non-goals: what is sent.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_bridge_common.h"
#include "soter_mavlink_topics.h"
#include "soter_process.h"

#include <signal.h>
#include <stdio.h>

static volatile sig_atomic_t ending = 0;

int soter_mavlink_ending(void) {
  return ending;
}

void soter_mavlink_end(int how) {
  ending = how;
}

int64_t soter_mavlink_now(void) {
  return soter_bridge_clock(CLOCK_MONOTONIC);
}

void soter_mavlink_say(soter_mavlink_bridge* bridge, const char* about, const char* what) {
  SOTER_CHECK(bridge->system != NULL);
  soter_process_say("%s: %s%s%s", bridge->system->program, about, about[0] != '\0' ? ": " : "",
                    what);
}

void soter_mavlink_say_of(soter_mavlink_bridge* bridge, uint64_t many, const char* about,
                          const char* why) {
  SOTER_CHECK(many > 0U);
  (void)snprintf(bridge->why, sizeof bridge->why, "%s: %s", about, why);
  if ((many & (many - 1)) == 0) {
    soter_mavlink_say(bridge, about, why);
  }
}

void soter_mavlink_count(soter_mavlink_topic* topic, int what, const char* why) {
  SOTER_CHECK(what >= 0 && what < SOTER_MAVLINK_COUNTS);
  const uint64_t many = ++topic->count[what];
  if (why != NULL) {
    soter_mavlink_say_of(topic->bridge, many,
                         topic->in != NULL ? topic->in->name : topic->out->name, why);
  }
}

bool soter_mavlink_send(soter_mavlink_bridge* bridge, const mavlink_message_t* m) {
  const soter_mavlink_source* const autopilot = &bridge->source[0];
  SOTER_CHECK(!autopilot->bound || autopilot->address.link < bridge->links);
  if (autopilot->bound) {
    soter_mavlink_link_send(&bridge->link[autopilot->address.link], &autopilot->address, m);
    return true;
  }
  bool sent = false;
  for (size_t k = 0; k < bridge->links; k++) {
    if (bridge->link[k].speaks_first) {
      soter_mavlink_link_send(&bridge->link[k], NULL, m);
      sent = true;
    }
  }
  return sent;
}
