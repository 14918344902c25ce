/* soter_dds_bridge.c: the program around the topics of a bridge.
 *
 * Purpose: arguments, the participant, a thread a topic, and what is said (soter_dds_bridge.h).
 * Non-goals: samples (soter_dds_samples.c), the others (soter_dds_peers.c).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_dds_bridge.h"

#include "soter_bridge_common.h"
#include "soter_dds_topics.h"
#include "soter_process.h"

#include "dds/ddsrt/log.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LOOK_NS 100000000
#define DOMAIN_MOST 232
#define ERROR_MOST_S 1.0

static const char help[] =
    "  --channels FOLDER        where the trusted part's channels are (needed)\n"
    "  --clock-error SECONDS    how far the clocks of who stamps samples and of this machine may "
    "be\n"
    "                           apart, 0 to 1; 0 where it is not said\n"
    "  --types checked|named    checked: a writer whose type has the same name and another\n"
    "                           structure is refused where it tells its structure; named: types\n"
    "                           are compared by name alone, as ROS 2 does\n"
    "  --status text|json       at the end, too, what was counted; on SIGUSR1 as text without it\n"
    "The domain is $ROS_DOMAIN_ID (0 where it is not set). $CYCLONEDDS_URI configures Cyclone "
    "DDS.\n"
    "SIGINT, SIGTERM and SIGHUP end it, with the law.\n";

typedef struct {
  const char* channels;
  bool status;
  bool json;
} options;

static volatile sig_atomic_t asked = 0;

static void on_signal(int number) {
  if (number == SIGUSR1) {
    asked = 1;
  } else {
    soter_dds_end();
  }
}

/* ------------------------------------------------------------------ what is said */

/* What Cyclone DDS says: a payload that it cannot read is counted with its topic. */
static void on_log(void* given, const dds_log_data_t* log) {
  soter_dds_bridge* const bridge = given;
  SOTER_CHECK(bridge != NULL && log != NULL);
  char text[256];
  (void)snprintf(text, sizeof text, "%.*s",
                 (int)(log->size < sizeof text ? log->size : sizeof text), log->message);
  text[strcspn(text, "\n")] = '\0';
  for (size_t k = 0; k < bridge->topics && strstr(text, "deserialization ") != NULL; k++) {
    char named[SOTER_DDS_NAME + 2];
    (void)snprintf(named, sizeof named, " %s/", bridge->topic[k].topic);
    if (bridge->topic[k].in != NULL && strstr(text, named) != NULL) {
      soter_dds_count(&bridge->topic[k], SOTER_DDS_UNREAD, "a sample is no value of its type");
      return;
    }
  }
  soter_dds_say(bridge, "Cyclone DDS", text);
}

/* ------------------------------------------------------------------ arguments */

/* False where there is no such word. */
static bool option(soter_dds_bridge* bridge, options* o, const char* name, const char* value) {
  SOTER_CHECK(name != NULL && value != NULL);
  double seconds = 0.0;
  if (strcmp(name, "--channels") == 0 && value[0] != '\0') {
    o->channels = value;
  } else if (strcmp(name, "--clock-error") == 0 &&
             soter_bridge_number(value, 0.0, ERROR_MOST_S, &seconds)) {
    bridge->clock_error_ns = (int64_t)(seconds * 1e9 + 0.5);
  } else if (strcmp(name, "--types") == 0 &&
             (strcmp(value, "checked") == 0 || strcmp(value, "named") == 0)) {
    bridge->types_checked = value[0] == 'c';
  } else if (strcmp(name, "--status") == 0 &&
             (strcmp(value, "text") == 0 || strcmp(value, "json") == 0)) {
    o->status = true;
    o->json = value[0] == 'j';
  } else {
    return false;
  }
  return true;
}

/* -1: it can begin; else the exit code. */
static int read_arguments(soter_dds_bridge* bridge, options* o, int count, char** words) {
  const char* const domain = getenv("ROS_DOMAIN_ID");
  double id = 0.0;
  for (int i = 1; i < count; i += 2) {
    if (strcmp(words[i], "--help") == 0 || strcmp(words[i], "-h") == 0) {
      (void)printf(
          "%s --channels FOLDER [OPTIONS]: topics of DDS, named as ROS 2 does, to and from\n"
          "the channels of the trusted part\n%s",
          bridge->system->program, help);
      return 0;
    }
    if (i + 1 >= count || !option(bridge, o, words[i], words[i + 1])) {
      soter_dds_say(bridge, words[i],
                    "no such option, or no value of it; --help says which there are");
      return 2;
    }
  }
  if (o->channels == NULL) {
    soter_dds_say(bridge, "", "--channels is needed: the folder of the trusted part's channels");
    return 2;
  }
  if (domain != NULL && domain[0] != '\0' &&
      (!soter_bridge_number(domain, 0.0, DOMAIN_MOST, &id) || id != (double)(uint32_t)id)) {
    soter_dds_say(bridge, "$ROS_DOMAIN_ID", "no number from 0 to 232");
    return 2;
  }
  bridge->domain = (uint32_t)id;
  return -1;
}

/* ------------------------------------------------------------------ running */

static bool make_topics(soter_dds_bridge* bridge) {
  SOTER_CHECK(bridge->topic == NULL);
  const soter_dds_system* const s = bridge->system;
  bridge->topic = calloc(s->ins + s->outs + 1, sizeof *bridge->topic);
  if (bridge->topic == NULL) {
    return false;
  }
  for (size_t k = 0; k < s->ins + s->outs; k++) {
    soter_dds_topic* const t = &bridge->topic[k];
    t->in = k < s->ins ? &s->in[k] : NULL;
    t->out = k < s->ins ? NULL : &s->out[k - s->ins];
    t->topic = t->in != NULL ? t->in->topic : t->out->topic;
    t->type = t->in != NULL ? t->in->type->m_typename : t->out->type->m_typename;
    t->bridge = bridge;
    (void)pthread_mutex_init(&t->held, NULL);
  }
  bridge->topics = s->ins + s->outs;
  return true;
}

static bool open_all(soter_dds_bridge* bridge, const char* folder) {
  SOTER_CHECK(folder != NULL && bridge->topic != NULL);
  bridge->participant = dds_create_participant(bridge->domain, NULL, NULL);
  if (bridge->participant < 0) {
    soter_dds_say(bridge, "", "DDS makes no participant: no network, or a wrong $CYCLONEDDS_URI");
    return false;
  }
  const char* wrong = soter_dds_open_peers(bridge);
  if (wrong != NULL) {
    soter_dds_say(bridge, "", wrong);
    return false;
  }
  for (size_t k = 0; k < bridge->topics; k++) {
    wrong = soter_dds_open_topic(&bridge->topic[k], folder);
    if (wrong != NULL) {
      soter_dds_say(bridge, bridge->topic[k].topic, wrong);
      return false;
    }
  }
  wrong = soter_dds_open_diagnostics(bridge, folder);
  if (wrong != NULL) {
    soter_dds_say(bridge, SOTER_DDS_DIAGNOSTICS, wrong);
  }
  return wrong == NULL;
}

static void run(soter_dds_bridge* bridge, const options* o) {
  SOTER_CHECK(bridge->topics == bridge->system->ins + bridge->system->outs);
  int64_t looked = 0;
  size_t begun = 0;
  for (; begun < bridge->topics; begun++) {
    soter_dds_topic* const t = &bridge->topic[begun];
    if (pthread_create(&t->thread, NULL,
                       t->in != NULL ? soter_dds_serve_inward : soter_dds_serve_outward, t) != 0) {
      soter_dds_say(bridge, t->topic, "there is no thread for it");
      soter_dds_end();
      break;
    }
  }
  soter_dds_say(bridge, "", "it runs");
  while (!soter_dds_ending()) {
    if (soter_dds_monotonic_ns() - looked >= LOOK_NS) {
      soter_dds_look(bridge);
      looked = soter_dds_monotonic_ns();
    }
    if (asked != 0) {
      asked = 0;
      soter_dds_report(bridge, o->json);
    }
    soter_dds_diagnose(bridge, LOOK_NS); /* a signal ends it early */
  }
  for (size_t k = 0; k < begun; k++) {
    (void)pthread_join(bridge->topic[k].thread, NULL);
  }
  soter_dds_look(bridge);
  soter_process_ending();
  if (o->status) {
    soter_dds_report(bridge, o->json);
  }
}

int soter_dds_main(const soter_dds_system* system, int count, char** words) {
  SOTER_CHECK(system != NULL && system->trusted != NULL);
  soter_dds_bridge bridge = {.system = system, .types_checked = true};
  options o = {.channels = NULL, .status = false, .json = false};
  const int wrong = read_arguments(&bridge, &o, count, words);
  if (wrong >= 0) {
    return wrong;
  }
  if (!soter_process_begin(on_signal)) {
    return 1;
  }
  if (!make_topics(&bridge)) {
    soter_dds_say(&bridge, "", "there is no memory");
    return soter_process_end(1);
  }
  dds_set_log_sink(on_log, &bridge);
  const bool opened = open_all(&bridge, o.channels);
  if (opened) {
    run(&bridge, &o);
  }
  if (bridge.participant > 0) {
    (void)dds_delete(bridge.participant);
  }
  dds_set_log_sink(NULL, NULL);
  for (size_t k = 0; k < bridge.topics; k++) {
    soter_dds_close_topic(&bridge.topic[k]);
  }
  soter_dds_close_diagnostics(&bridge);
  free(bridge.topic);
  return soter_process_end(opened ? 0 : 1);
}
