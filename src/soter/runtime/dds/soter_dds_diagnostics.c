/* soter_dds_diagnostics.c: how things are, as ROS 2 shows it: rt/diagnostics.
 *
 * Purpose: once a second, and whenever something is new of a module, a DiagnosticArray: a line a
 * module (who has control, takeovers and why, leases, whether the actuators obey), a line a topic
 * that meets the world as the trusted part counts it, and a line a topic of the bridge: what was
 * taken, and what was refused, by reason.
 * Non-goals: the wording of a module (soter_status_text.h), counting; being listened to.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_check.h"
#include "soter_dds_messages.h"
#include "soter_dds_topics.h"
#include "soter_status_text.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EVERY_NS INT64_C(1000000000)
#define VALUES_MAX 16
#define KEY_MAX 64
#define NUMBER_MAX 24

typedef diagnostic_msgs_msg_dds__DiagnosticArray_ array_message;
typedef diagnostic_msgs_msg_dds__DiagnosticStatus_ status_message;
typedef diagnostic_msgs_msg_dds__KeyValue_ value_message;

/* Room for the texts of a line. */
typedef struct {
  char name[SOTER_DDS_NAME + 32], message[SOTER_MESSAGE_MAX], of[SOTER_DDS_NAME];
  char key[VALUES_MAX][KEY_MAX], number[VALUES_MAX][NUMBER_MAX];
  value_message value[VALUES_MAX];
  char old[SOTER_MESSAGE_MAX];            /* of a module: soter_old_read_text */
  char news[SOTER_MESSAGE_MAX + KEY_MAX]; /* of a module: what is not only a number that goes on */
  /* of a topic of the bridge: what was counted, and when a look found it changed */
  uint64_t good, bad;
  int64_t good_at, bad_at;
} line;

struct soter_dds_diagnostics {
  soter_outside status, actuators; /* what the trusted part and the actuators say */
  uint64_t *status_words, *actuators_words;
  int64_t status_ns, actuators_ns;
  char arm[SOTER_DDS_WHY]; /* the command of a person */
  dds_topic_descriptor_t* described;
  dds_entity_t writer;
  line* lines;
  status_message* shown; /* a line each */
  size_t count;
  int64_t told;
};

/* ------------------------------------------------------------------ opening */

static const char* open_channels(soter_dds_diagnostics* d, const soter_dds_trusted* t,
                                 const char* folder) {
  const size_t words = SOTER_STATUS_WORDS(t->module_count, t->lease_count, t->topic_count);
  const size_t of_actuators = SOTER_ACTUATORS_WORDS(t->lease_count);
  d->status_words = calloc(words, sizeof *d->status_words);
  d->actuators_words = calloc(of_actuators, sizeof *d->actuators_words);
  if (d->status_words == NULL || d->actuators_words == NULL) {
    return "there is no memory";
  }
  const char* const wrong = soter_outside_open(&d->status, folder, SOTER_STATUS_CHANNEL, t->hash,
                                               words * sizeof *d->status_words, false);
  if (wrong != NULL || t->lease_count == 0) {
    return wrong;
  }
  return soter_outside_open(&d->actuators, folder, SOTER_ACTUATORS_CHANNEL, t->actuators_hash,
                            of_actuators * sizeof *d->actuators_words, false);
}

/* With ROS 2's name and QoS. */
static const char* open_writer(soter_dds_bridge* bridge, soter_dds_diagnostics* d) {
  static const soter_dds_qos asked = {.reliable = true, .transient_local = false, .depth = 1};
  d->described = soter_dds_plain(&diagnostic_msgs_msg_dds__DiagnosticArray__desc);
  if (d->described == NULL) {
    return "there is no memory";
  }
  dds_qos_t* const qos = soter_dds_qos_of(&asked);
  const dds_entity_t topic =
      dds_create_topic(bridge->participant, d->described, SOTER_DDS_DIAGNOSTICS, qos, NULL);
  d->writer = topic < 0 ? topic : dds_create_writer(bridge->participant, topic, qos, NULL);
  dds_delete_qos(qos);
  return d->writer < 0 ? "DDS makes no writer of diagnostics" : NULL;
}

const char* soter_dds_open_diagnostics(soter_dds_bridge* bridge, const char* folder) {
  SOTER_CHECK(bridge->diagnostics == NULL);
  const soter_dds_trusted* const t = bridge->system->trusted;
  soter_dds_diagnostics* const d = calloc(1, sizeof *d);
  bridge->diagnostics = d;
  if (d == NULL) {
    return "there is no memory";
  }
  d->count = t->module_count + t->topic_count + bridge->topics;
  d->lines = calloc(d->count + 1, sizeof *d->lines);
  d->shown = calloc(d->count + 1, sizeof *d->shown);
  if (d->lines == NULL || d->shown == NULL) {
    return "there is no memory";
  }
  (void)snprintf(d->arm, sizeof d->arm, "%s --channels %s --arm", t->actuator, folder);
  const char* const wrong = open_channels(d, t, folder);
  return wrong != NULL ? wrong : open_writer(bridge, d);
}

void soter_dds_close_diagnostics(soter_dds_bridge* bridge) {
  soter_dds_diagnostics* const d = bridge->diagnostics;
  if (d != NULL) {
    free(d->status_words);
    free(d->actuators_words);
    free(d->described);
    free(d->lines);
    free(d->shown);
    free(d);
  }
}

/* ------------------------------------------------------------------ a line */

/* A line without values. A text may be from elsewhere: what is no plain letter is a question mark,
 * since readers take it for UTF-8. */
static void begin(soter_dds_diagnostics* d, size_t k, int level, const char* of) {
  SOTER_CHECK(k < d->count);
  line* const l = &d->lines[k];
  status_message* const to = &d->shown[k];
  (void)snprintf(l->of, sizeof l->of, "%s", of);
  char* const texts[] = {l->message, l->of};
  for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
    for (char* c = texts[i]; *c != '\0'; c++) {
      *c = (char)(*c >= ' ' && *c <= '~' ? *c : '?');
    }
  }
  to->level_ = (uint8_t)level;
  to->name_ = l->name;
  to->message_ = l->message;
  to->hardware_id_ = l->of;
  to->values_._buffer = l->value;
  to->values_._maximum = VALUES_MAX;
  to->values_._length = 0;
}

/* The value of a new key, with room for a number. */
static value_message* next(soter_dds_diagnostics* d, size_t k, const char* before,
                           const char* key) {
  SOTER_CHECK(k < d->count);
  line* const l = &d->lines[k];
  const uint32_t n = d->shown[k].values_._length++;
  SOTER_CHECK(n < VALUES_MAX);
  (void)snprintf(l->key[n], KEY_MAX, "%s%s", before, key);
  l->value[n].key_ = l->key[n];
  l->value[n].value_ = l->number[n];
  return &l->value[n];
}

static void text(soter_dds_diagnostics* d, size_t k, const char* key, const char* value) {
  next(d, k, "", key)->value_ = (char*)value; /* a constant, which DDS only reads */
}

static void number(soter_dds_diagnostics* d, size_t k, const char* before, const char* key,
                   uint64_t value) {
  (void)snprintf(next(d, k, before, key)->value_, NUMBER_MAX, "%llu", (unsigned long long)value);
}

/* ------------------------------------------------------------------ what is said */

static void hear(soter_dds_diagnostics* d, const soter_dds_trusted* t) {
  (void)soter_outside_read(&d->status, &d->status_ns, d->status_words, NULL);
  if (t->lease_count > 0) {
    (void)soter_outside_read(&d->actuators, &d->actuators_ns, d->actuators_words, NULL);
  }
}

/* Whether there is something new of it. */
static bool of_module(soter_dds_diagnostics* d, const soter_dds_trusted* t, uint32_t k,
                      int64_t now) {
  SOTER_CHECK(k < t->module_count);
  const soter_module_place place = {t->module_count, k, t->lease_of[k]};
  const soter_module_facts f = soter_module_facts_of(place, now, d->status_words, d->status_ns,
                                                     d->actuators_words, d->actuators_ns);
  line* const l = &d->lines[k];
  const char* const mode = !f.alive ? "unknown" : f.ac ? "AC" : "SC";
  char news[sizeof l->news];
  (void)snprintf(l->name, sizeof l->name, "soter: module %s", t->modules[k]);
  soter_module_message(&f, d->arm, l->message, sizeof l->message);
  begin(d, k, soter_module_level(&f), "");
  text(d, k, "mode", mode);
  (void)snprintf(next(d, k, "", "margin, s")->value_, NUMBER_MAX, "%f", soter_margin_s(&f, now));
  text(d, k, "armed", soter_armed_text(&f));
  if (f.leased && f.actuators_alive && f.state == SOTER_LEASE_ENDED) {
    text(d, k, "arming", soter_arming_text(&f));
  }
  text(d, k, "SC took over last", soter_takeover_text(f.why));
  for (uint32_t c = 0; c < SOTER_STATUS_CAUSES; c++) {
    number(d, k, "takeovers: ", soter_takeover_text(1 + c), f.takeovers[c]);
  }
  if (f.leased) {
    number(d, k, "", "leases given", f.given);
    if (f.old_topic > 0) {
      const char* const of =
          f.old_topic <= t->topic_count ? t->topics[f.old_topic - 1] : "a topic inside";
      soter_old_read_text(&f, of, l->old, sizeof l->old);
      text(d, k, SOTER_OLD_READ, l->old);
    }
  }
  number(d, k, "", "late releases and completions", f.missed);
  (void)snprintf(news, sizeof news, "%s %.16s %.40s", l->message, mode, soter_armed_text(&f));
  const bool changed = strcmp(news, l->news) != 0;
  (void)strcpy(l->news, news);
  return changed;
}

/* What the trusted part counts of a topic that meets the world. */
static void of_world(soter_dds_diagnostics* d, const soter_dds_trusted* t, uint32_t topic) {
  SOTER_CHECK(topic < t->topic_count);
  const size_t k = t->module_count + topic;
  const uint64_t* const words = d->status_words + SOTER_STATUS_HEAD +
                                SOTER_STATUS_MODULE * t->module_count +
                                SOTER_STATUS_LEASE * t->lease_count + SOTER_STATUS_TOPIC * topic;
  (void)snprintf(d->lines[k].name, sizeof d->lines[k].name, "soter: the trusted part's %s",
                 t->topics[topic]);
  begin(d, k, SOTER_LEVEL_OK, "");
  number(d, k, "", "taken", words[SOTER_STATUS_TAKEN]);
  number(d, k, "", "not finite, or outside its set", words[SOTER_STATUS_REFUSED]);
  number(d, k, "", "older than the one before", words[SOTER_STATUS_OLDER]);
  number(d, k, "", "later than now", words[SOTER_STATUS_FUTURE]);
}

/* Whether a count has grown within a second, as far as looks tell. */
static bool grew(uint64_t now_is, int64_t now, uint64_t* was, int64_t* at) {
  *at = now_is != *was ? now : *at;
  *was = now_is;
  return *at > 0 && now - *at < EVERY_NS;
}

/* All that is counted of a topic and went wrong. */
static uint64_t wrongs(const soter_dds_topic* t) {
  uint64_t all = 0;
  for (int what = 0; what < SOTER_DDS_COUNTS; what++) {
    all += t->count[what];
  }
  SOTER_CHECK(all >= t->count[SOTER_DDS_TAKEN]);
  return all - t->count[SOTER_DDS_TAKEN] - t->count[SOTER_DDS_BOUND] -
         t->count[SOTER_DDS_PUBLISHED];
}

/* Its level; `why` in words. */
static int level_of(const soter_dds_topic* t, line* l, int64_t now, const char** why) {
  SOTER_CHECK((t->in != NULL) != (t->out != NULL));
  const uint64_t taken = t->count[SOTER_DDS_TAKEN];
  const bool moves = grew(taken, now, &l->good, &l->good_at);
  if (grew(wrongs(t), now, &l->bad, &l->bad_at)) {
    *why = t->why;
    return SOTER_LEVEL_ERROR;
  }
  if (t->out == NULL) {
    *why = moves ? "taken" : taken > 0 ? "silent" : "nothing was taken yet";
    return moves ? SOTER_LEVEL_OK : SOTER_LEVEL_WARN;
  }
  *why = soter_outward_text(t->silent, t->count[SOTER_DDS_PUBLISHED]);
  return t->silent ? SOTER_LEVEL_ERROR : SOTER_LEVEL_OK;
}

static void of_topic(soter_dds_diagnostics* d, size_t k, soter_dds_topic* t, int64_t now) {
  SOTER_CHECK(k < d->count && strncmp(t->topic, "rt", 2) == 0);
  line* const l = &d->lines[k];
  (void)snprintf(l->name, sizeof l->name, "soter: %s", t->topic + strlen("rt"));
  (void)pthread_mutex_lock(&t->held);
  const char* why = NULL;
  const int level = level_of(t, l, now, &why);
  (void)snprintf(l->message, sizeof l->message, "%s", why);
  begin(d, k, level, t->publisher);
  for (int what = 0; what < SOTER_DDS_COUNTS; what++) {
    const char* const word = soter_dds_word(what, t->in != NULL);
    if (word != NULL) {
      number(d, k, "", word, t->count[what]);
    }
  }
  (void)pthread_mutex_unlock(&t->held);
}

static void publish(soter_dds_diagnostics* d) {
  SOTER_CHECK(d->writer > 0);
  const int64_t wall = soter_dds_wall_ns();
  array_message m;
  (void)memset(&m, 0, sizeof m);
  m.header_.stamp_.sec_ = (int32_t)(wall / 1000000000);
  m.header_.stamp_.nanosec_ = (uint32_t)(wall % 1000000000);
  m.header_.frame_id_ = (char*)"";
  m.status_._buffer = d->shown;
  m.status_._length = m.status_._maximum = (uint32_t)d->count;
  (void)dds_write(d->writer, &m); /* a reader that does not read misses it */
}

void soter_dds_diagnose(soter_dds_bridge* bridge, int64_t wait_ns) {
  soter_dds_diagnostics* const d = bridge->diagnostics;
  SOTER_CHECK(d != NULL);
  const soter_dds_trusted* const t = bridge->system->trusted;
  soter_outside_wait(&d->status, wait_ns);
  hear(d, t);
  const int64_t now = soter_dds_monotonic_ns();
  bool news = false;
  for (uint32_t k = 0; k < t->module_count; k++) {
    news = of_module(d, t, k, now) || news;
  }
  if (!news && now - d->told < EVERY_NS) {
    return;
  }
  for (uint32_t k = 0; k < t->topic_count; k++) {
    of_world(d, t, k);
  }
  for (size_t k = 0; k < bridge->topics; k++) {
    of_topic(d, t->module_count + t->topic_count + k, &bridge->topic[k], now);
  }
  publish(d);
  d->told = now;
}
