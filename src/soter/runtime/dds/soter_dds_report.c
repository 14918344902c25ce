/* soter_dds_report.c: what was counted, as text or JSON.
 *
 * Purpose: one report on standard output: at the end, and on SIGUSR1. Non-goals: counting.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_dds_topics.h"

#include <stdio.h>

static const char* const words[SOTER_DDS_COUNTS] = {
    [SOTER_DDS_TAKEN] = "taken",
    [SOTER_DDS_STRANGER] = "of another writer",
    [SOTER_DDS_SIZE] = "of another size",
    [SOTER_DDS_FRAME] = "in another frame",
    [SOTER_DDS_UNSTAMPED] = "without a stamp",
    [SOTER_DDS_FUTURE] = "stamped later than now",
    [SOTER_DDS_BACKWARDS] = "stamped earlier than the one before",
    [SOTER_DDS_ABSENT] = "without a value",
    [SOTER_DDS_UNREAD] = "not readable",
    [SOTER_DDS_BOUND] = "writers bound",
    [SOTER_DDS_PUBLISHED] = "published",
    [SOTER_DDS_UNSENT] = "not sent",
    [SOTER_DDS_OTHERS] = "other writers",
    [SOTER_DDS_TYPE] = "peers of another type",
    [SOTER_DDS_QOS] = "peers of another QoS",
};

static const char* const keys[SOTER_DDS_COUNTS] = {
    [SOTER_DDS_TAKEN] = "taken",
    [SOTER_DDS_STRANGER] = "of_another_writer",
    [SOTER_DDS_SIZE] = "of_another_size",
    [SOTER_DDS_FRAME] = "in_another_frame",
    [SOTER_DDS_UNSTAMPED] = "without_a_stamp",
    [SOTER_DDS_FUTURE] = "later_than_now",
    [SOTER_DDS_BACKWARDS] = "backwards",
    [SOTER_DDS_ABSENT] = "without_a_value",
    [SOTER_DDS_UNREAD] = "not_readable",
    [SOTER_DDS_BOUND] = "writers_bound",
    [SOTER_DDS_PUBLISHED] = "published",
    [SOTER_DDS_UNSENT] = "not_sent",
    [SOTER_DDS_OTHERS] = "other_writers",
    [SOTER_DDS_TYPE] = "peers_of_another_type",
    [SOTER_DDS_QOS] = "peers_of_another_qos",
};

static bool of_way(int what, bool inward) {
  if (what == SOTER_DDS_TYPE || what == SOTER_DDS_QOS) {
    return true;
  }
  return (what < SOTER_DDS_PUBLISHED) == inward;
}

const char* soter_dds_word(int what, bool inward) {
  SOTER_CHECK(what >= 0 && what < SOTER_DDS_COUNTS);
  return of_way(what, inward) ? words[what] : NULL;
}

/* A text from elsewhere: what is no plain letter is a question mark. */
static void quoted(const char* text) {
  SOTER_CHECK(text != NULL);
  (void)putchar('"');
  for (; *text != '\0'; text++) {
    const bool plain = *text >= ' ' && *text <= '~' && *text != '"' && *text != '\\';
    (void)putchar(plain ? *text : '?');
  }
  (void)putchar('"');
}

static void as_text(const soter_dds_topic* t) {
  SOTER_CHECK((t->in != NULL) != (t->out != NULL));
  (void)printf("%s %s", t->in != NULL ? "in " : "out", t->topic);
  for (int k = 0; k < SOTER_DDS_COUNTS; k++) {
    if (of_way(k, t->in != NULL) &&
        (t->count[k] > 0 || k == SOTER_DDS_TAKEN || k == SOTER_DDS_PUBLISHED)) {
      (void)printf("%s%llu %s", k == SOTER_DDS_TAKEN || k == SOTER_DDS_PUBLISHED ? ": " : ", ",
                   (unsigned long long)t->count[k], words[k]);
    }
  }
  if (t->in != NULL) {
    (void)printf("; bound to ");
    quoted(t->publisher);
  }
  if (t->silent) {
    (void)printf("; nobody writes its channel");
  }
  if (t->why[0] != '\0') {
    (void)printf("; last: ");
    quoted(t->why);
  }
  (void)printf("\n");
}

static void as_json(const soter_dds_topic* t) {
  SOTER_CHECK((t->in != NULL) != (t->out != NULL));
  (void)printf("{\"topic\":");
  quoted(t->topic);
  (void)printf(",\"way\":\"%s\",\"type\":", t->in != NULL ? "in" : "out");
  quoted(t->type);
  for (int k = 0; k < SOTER_DDS_COUNTS; k++) {
    if (of_way(k, t->in != NULL)) {
      (void)printf(",\"%s\":%llu", keys[k], (unsigned long long)t->count[k]);
    }
  }
  if (t->in != NULL) {
    (void)printf(",\"bound_to\":");
    quoted(t->publisher);
  } else {
    (void)printf(",\"channel_silent\":%s", t->silent ? "true" : "false");
  }
  (void)printf(",\"last\":");
  quoted(t->why);
  (void)printf("}");
}

void soter_dds_report(soter_dds_bridge* bridge, bool json) {
  if (json) {
    (void)printf("{\"domain\":%u,\"topics\":[", (unsigned)bridge->domain);
  }
  for (size_t k = 0; k < bridge->topics; k++) {
    soter_dds_topic* const t = &bridge->topic[k];
    (void)pthread_mutex_lock(&t->held);
    if (json) {
      (void)printf("%s", k > 0 ? "," : "");
      as_json(t);
    } else {
      as_text(t);
    }
    (void)pthread_mutex_unlock(&t->held);
  }
  if (json) {
    (void)printf("]}\n");
  }
  (void)fflush(stdout);
}
