/* soter_mavlink_report.c: what was counted, as text or JSON.
 *
 * Purpose: one report on standard output: at the end, and on SIGUSR1. Non-goals: counting.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_mavlink_topics.h"

#include <stdio.h>

#define PX4_OFFBOARD 6U
#define ARMED 128U

static const char* const keys[SOTER_MAVLINK_COUNTS] = {
    [SOTER_MAVLINK_TAKEN] = "taken",
    [SOTER_MAVLINK_OTHER_FRAME] = "of_other_constants",
    [SOTER_MAVLINK_UNSTAMPED] = "without_a_stamp",
    [SOTER_MAVLINK_UNSYNCED] = "without_a_common_clock",
    [SOTER_MAVLINK_FUTURE] = "later_than_now",
    [SOTER_MAVLINK_BACKWARDS] = "backwards",
    [SOTER_MAVLINK_ABSENT] = "without_a_value",
    [SOTER_MAVLINK_BY_ARRIVAL] = "by_arrival",
    [SOTER_MAVLINK_SENT] = "sent",
    [SOTER_MAVLINK_LAW] = "the_law_in_a_silence",
};

/* How far apart the earliest and the latest time of a stamp are, ns. */
static int64_t clock_error(const soter_mavlink_bridge* bridge, int64_t now) {
  SOTER_CHECK(bridge->clock.exchanges > 0U);
  int64_t earliest = 0;
  int64_t latest = 0;
  const size_t last = (size_t)((bridge->clock.exchanges - 1) % SOTER_MAVLINK_EXCHANGES);
  soter_mavlink_clock_turn(&bridge->clock, now, bridge->clock.exchange[last].remote, &earliest,
                           &latest);
  return latest - earliest;
}

static void number(const char* key, uint64_t value, bool json) {
  (void)printf(json ? ",\"%s\":%llu" : " %s %llu", key, (unsigned long long)value);
}

static void truth(const char* key, bool value, bool json) {
  (void)printf(json ? ",\"%s\":%s" : " %s %s", key, value ? "true" : "false");
}

static void end(bool json) {
  (void)printf(json ? "}" : "\n");
}

static void between(size_t k, bool json) {
  (void)printf("%s", json && k > 0 ? "," : "");
}

static void topic(const soter_mavlink_topic* t, bool json) {
  SOTER_CHECK((t->in != NULL) != (t->out != NULL));
  const bool in = t->in != NULL;
  (void)printf(json ? "{\"topic\":\"%s\",\"message\":\"%s\",\"way\":\"%s\"" : "%s %s %s:",
               in ? t->in->name : t->out->name, in ? t->in->message : t->out->message,
               in ? "in" : "out");
  for (int k = 0; k < SOTER_MAVLINK_COUNTS; k++) {
    const bool here = (k < SOTER_MAVLINK_SENT) == in;
    if (here && (json || t->count[k] > 0)) {
      number(keys[k], t->count[k], json);
    }
  }
  if (!in) {
    truth("channel_silent", t->silent, json);
  }
  end(json);
}

static void source(const soter_mavlink_source* s, bool json) {
  (void)printf(json ? "{\"source\":\"%u/%u\"" : "source %u/%u:", s->id.system, s->id.component);
  number("messages", s->messages, json);
  number("lost", s->lost, json);
  number("repeated", s->repeated, json);
  number("from_elsewhere", s->elsewhere, json);
  number("bindings", s->bindings, json);
  end(json);
}

static void link_of(const soter_mavlink_link* l, bool json) {
  (void)printf(json ? "{\"url\":\"%s\"" : "link %s:", l->url);
  number("bytes", l->bytes, json);
  number("frames", l->frames, json);
  number("torn", l->torn, json);
  number("signed", l->is_signed, json);
  number("short", l->short_, json);
  number("unsent", l->unsent, json);
  end(json);
}

static void autopilot(const soter_mavlink_bridge* bridge, bool json) {
  const int64_t now = soter_mavlink_now();
  const bool runs = soter_mavlink_clock_runs(&bridge->clock, now);
  const bool offboard = ((bridge->custom_mode >> 16U) & 255U) == PX4_OFFBOARD;
  (void)printf(json ? "\"autopilot\":{\"custom_mode\":%u" : "autopilot: custom_mode %u",
               (unsigned)bridge->custom_mode);
  truth("heard", bridge->autopilot_told, json);
  truth("armed", (bridge->base_mode & ARMED) != 0U, json);
  truth("offboard", offboard, json);
  (void)printf(json ? "},\"clock\":{\"runs\":%s" : "\nclock: runs %s", runs ? "true" : "false");
  number("error_ns", runs ? (uint64_t)clock_error(bridge, now) : 0U, json);
  number("requests", bridge->clock.requests, json);
  number("exchanges", bridge->clock.exchanges, json);
  number("slow", bridge->clock.slow, json);
  number("unasked", bridge->clock.unasked, json);
  number("jumps", bridge->clock.jumps, json);
  end(json);
}

static void topics(const soter_mavlink_bridge* bridge, bool json) {
  SOTER_CHECK(bridge->topics <= SOTER_MAVLINK_TOPICS);
  for (size_t k = 0; k < bridge->topics; k++) {
    between(k, json);
    topic(&bridge->topic[k], json);
  }
}

static void sources(const soter_mavlink_bridge* bridge, bool json) {
  SOTER_CHECK(bridge->system->source_count <= SOTER_MAVLINK_SOURCES);
  for (size_t k = 0; k < bridge->system->source_count; k++) {
    between(k, json);
    source(&bridge->source[k], json);
  }
}

void soter_mavlink_report(soter_mavlink_bridge* bridge, bool json) {
  SOTER_CHECK(bridge->links <= SOTER_MAVLINK_LINKS);
  (void)printf(json ? "{" : "");
  autopilot(bridge, json);
  (void)printf(json ? ",\"strangers\":%llu,\"topics\":[" : "strangers %llu\n",
               (unsigned long long)bridge->strangers);
  topics(bridge, json);
  (void)printf(json ? "],\"sources\":[" : "");
  sources(bridge, json);
  (void)printf(json ? "],\"links\":[" : "");
  for (size_t k = 0; k < bridge->links; k++) {
    between(k, json);
    link_of(&bridge->link[k], json);
  }
  (void)printf(json ? "]}\n" : "last: %s\n", bridge->why);
  (void)fflush(stdout);
}
