/* soter_mavlink_topics.c: messages into channels, and channels into messages.
 *
 * Purpose: what one topic does with a message of its source, and the loop of one that goes out.
 * Non-goals: who the source is (soter_mavlink_bridge.c).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_mavlink_topics.h"

#include <string.h>

#define WAIT_NS INT64_C(5000000)
#define HELD_UP_NS INT64_C(20000000) /* two turns of the loop that reads */

const char* soter_mavlink_topic_open(soter_mavlink_topic* topic, const char* folder) {
  SOTER_CHECK((topic->in != NULL) != (topic->out != NULL));
  const bool inward = topic->in != NULL;
  const size_t size = inward ? topic->in->size : topic->out->size;
  topic->last_stamp = -1;
  topic->last_measured = INT64_MIN;
  topic->begun = soter_mavlink_now();
  return soter_outside_open(&topic->channel, folder, inward ? topic->in->name : topic->out->name,
                            inward ? topic->in->hash : topic->out->hash, size, inward);
}

/* ------------------------------------------------------------------ in */

/* When a message that is read now came, at the earliest: after its link was found empty. A bridge
 * that was stopped reads what waited for it. */
static int64_t came_at(const soter_mavlink_topic* topic, int64_t now) {
  const uint32_t link = topic->bridge->source[topic->in->source].address.link;
  SOTER_CHECK(link < topic->bridge->links);
  const int64_t empty = topic->bridge->link[link].empty_ns;
  return now - empty > HELD_UP_NS ? empty : now;
}

/* Without a common clock: when it came, less what messages take at most. */
static bool by_arrival(soter_mavlink_topic* topic, int64_t now, int64_t* measured) {
  SOTER_CHECK(topic->in != NULL && measured != NULL);
  const int64_t delay = topic->bridge->delay_ns;
  if (delay < 0 && topic->in->stamped) {
    soter_mavlink_count(topic, SOTER_MAVLINK_UNSYNCED,
                        "no answer to TIMESYNC yet, and nobody says how long messages take");
    return false;
  }
  *measured = came_at(topic, now) - (delay > 0 ? delay : 0);
  topic->count[SOTER_MAVLINK_BY_ARRIVAL]++;
  return true;
}

static bool measured_at(soter_mavlink_topic* topic, const mavlink_message_t* m, int64_t* measured) {
  SOTER_CHECK(topic->in != NULL && measured != NULL);
  const soter_mavlink_clock* const clock = &topic->bridge->clock;
  const int64_t now = soter_mavlink_now();
  int64_t latest = 0;
  if (!topic->in->stamped) {
    return by_arrival(topic, now, measured);
  }
  const int64_t stamp = topic->in->stamp(m);
  if (stamp < 0) {
    soter_mavlink_count(topic, SOTER_MAVLINK_UNSTAMPED, "a message has no stamp");
    return false;
  }
  if (stamp <= topic->last_stamp) {
    soter_mavlink_count(topic, SOTER_MAVLINK_BACKWARDS,
                        "a message was stamped no later than the one before: repeated, or old");
    return false;
  }
  if (!soter_mavlink_clock_runs(clock, now)) {
    if (!by_arrival(topic, now, measured)) {
      return false;
    }
  } else {
    soter_mavlink_clock_turn(clock, now, stamp, measured, &latest);
    if (*measured > now) {
      soter_mavlink_count(topic, SOTER_MAVLINK_FUTURE,
                          "a message was stamped later than now: another clock, or a wrong one");
      return false;
    }
  }
  topic->last_stamp = stamp;
  return true;
}

void soter_mavlink_judge(soter_mavlink_topic* topic, const mavlink_message_t* m) {
  const soter_mavlink_inward* const in = topic->in;
  SOTER_CHECK(in != NULL && in->id == m->msgid);
  int64_t measured = 0;
  if (!in->fits(m)) {
    soter_mavlink_count(topic, SOTER_MAVLINK_OTHER_FRAME,
                        "a message has other constants than the mapping: another frame?");
    return;
  }
  (void)memset(in->value, 0, in->size);
  if (!in->convert(m, in->value)) {
    soter_mavlink_count(topic, SOTER_MAVLINK_ABSENT,
                        "a message says that a value is not known, is of MAVLink 1, which has no "
                        "extensions, or the topic cannot hold it");
    return;
  }
  if (!measured_at(topic, m, &measured)) {
    return;
  }
  /* both were measured no earlier than they say, and this one after the one before */
  measured = measured > topic->last_measured ? measured : topic->last_measured;
  topic->last_measured = measured;
  soter_outside_write(&topic->channel, measured, in->value);
  soter_mavlink_count(topic, SOTER_MAVLINK_TAKEN, NULL);
}

/* ------------------------------------------------------------------ out */

static void send_value(soter_mavlink_topic* topic, int64_t now, int64_t written, bool law) {
  SOTER_CHECK(topic->out != NULL);
  soter_mavlink_bridge* const bridge = topic->bridge;
  const soter_mavlink_envelope envelope = {bridge->system->own, bridge->system->sources[0],
                                           &bridge->sending, written};
  mavlink_message_t m;
  (void)memset(&m, 0, sizeof m);
  (void)pthread_mutex_lock(&bridge->held);
  topic->silent = law;
  topic->out->convert(topic->out->last, &envelope, &m);
  if (soter_mavlink_send(bridge, &m)) {
    soter_mavlink_count(topic, SOTER_MAVLINK_SENT, NULL);
    topic->count[SOTER_MAVLINK_LAW] += law ? 1U : 0U;
  }
  (void)pthread_mutex_unlock(&bridge->held);
  topic->told = now;
}

/* A channel may hold what somebody wrote long ago, or before this machine was started; and whoever
 * writes it may have been stopped between the time and the value. */
static bool is_of_now(const soter_mavlink_topic* topic, int64_t written) {
  SOTER_CHECK(topic->out != NULL && topic->begun > 0);
  const int64_t age = soter_mavlink_now() - written;
  return written >= topic->begun && age >= 0 && age <= topic->out->silent_ns;
}

/* A value of now; `topic->before`: whether there was one at all. */
static bool read_channel(soter_mavlink_topic* topic, int64_t* written) {
  SOTER_CHECK(topic->out != NULL && written != NULL);
  const bool found = soter_outside_read(&topic->channel, written, topic->out->value, NULL);
  topic->before = topic->before || found;
  return found && is_of_now(topic, *written);
}

/* Who wrote it was gone when the bridge began. */
static bool was_gone(const soter_mavlink_topic* topic, int64_t now) {
  return topic->heard == 0 && topic->before && now - topic->begun > topic->out->silent_ns;
}

static void fall_silent(soter_mavlink_topic* topic) {
  (void)pthread_mutex_lock(&topic->bridge->held);
  topic->silent = true;
  (void)pthread_mutex_unlock(&topic->bridge->held);
}

static void relay_channel(soter_mavlink_topic* topic, int64_t now) {
  const soter_mavlink_outward* const out = topic->out;
  SOTER_CHECK(out->value != out->last);
  const int64_t resend = topic->bridge->system->resend_ns;
  int64_t written = 0;
  if (read_channel(topic, &written)) {
    const bool changed = memcmp(out->value, out->last, out->size) != 0;
    (void)memcpy(out->last, out->value, out->size);
    topic->heard = now;
    if (changed || now - topic->told >= resend) {
      send_value(topic, now, written, false);
    }
  } else if (topic->heard > 0 && now - topic->heard > out->silent_ns &&
             now - topic->told >= resend) {
    /* nobody holds a lease, nobody holds the law: it is held from here */
    if (out->law(out->last)) {
      send_value(topic, now, now, true);
    } else {
      fall_silent(topic); /* set-points end, and the autopilot does what it does then */
    }
  } else if (was_gone(topic, now)) {
    fall_silent(topic); /* no set-point begins */
  }
}

void* soter_mavlink_serve(void* given) {
  soter_mavlink_topic* const topic = given;
  SOTER_CHECK(topic != NULL && topic->out != NULL);
  while (soter_mavlink_ending() == 0) {
    soter_outside_wait(&topic->channel, WAIT_NS);
    relay_channel(topic, soter_mavlink_now());
  }
  if (topic->heard > 0 && topic->out->law(topic->out->last)) {
    send_value(topic, soter_mavlink_now(), soter_mavlink_now(), true); /* the law is last */
  }
  return NULL;
}
