/* soter_mavlink_bridge.c: the program around the links and topics of a bridge.
 *
 * Purpose: arguments, whose messages are heard, HEARTBEAT and TIMESYNC (soter_mavlink_bridge.h).
 * Non-goals: bytes (soter_mavlink_link.c), values (soter_mavlink_topics.c).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_bridge_common.h"
#include "soter_mavlink_topics.h"
#include "soter_process.h"

#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define TURN_MS 10
#define HEARTBEAT_NS INT64_C(1000000000)
#define TIMESYNC_NS INT64_C(100000000)
#define BOUND_NS                                                                   \
  INT64_C(3000000000) /* a source that was silent for so long may be elsewhere now \
                       */

static const char help[] =
    "  --channels FOLDER     where the trusted part's channels are (needed)\n"
    "  --url URL             a link; once for each. Without it, those of the mapping:\n"
    "                        udpin://ADDRESS:PORT, udpout://ADDRESS:PORT, serial:///dev/NAME:BAUD\n"
    "  --delay SECONDS       from a measurement to its arrival, at most, 0 to 1: for messages\n"
    "                        without a stamp, and while TIMESYNC has no answer\n"
    "  --status text|json    at the end, too, what was counted; on SIGUSR1 as text without it\n"
    "SIGINT, SIGTERM and SIGHUP end it, with the law.\n";

typedef struct {
  const char* channels;
  const char* urls[SOTER_MAVLINK_LINKS];
  size_t links;
  bool status, json;
} options;

static volatile sig_atomic_t asked = 0;

static void on_signal(int number) {
  if (number == SIGUSR1) {
    asked = 1;
  } else {
    soter_mavlink_end(1);
  }
}

/* ------------------------------------------------------------------ whose messages */

static void forget_stamps(soter_mavlink_bridge* bridge, uint32_t source) {
  SOTER_CHECK(bridge->topics <= SOTER_MAVLINK_TOPICS);
  SOTER_CHECK(source < bridge->system->source_count);
  for (size_t k = 0; k < bridge->topics; k++) {
    if (bridge->topic[k].in != NULL && bridge->topic[k].in->source == source) {
      bridge->topic[k].last_stamp = -1;
      bridge->topic[k].last_measured = INT64_MIN; /* nobody knows any more what came after it */
    }
  }
}

/* Who speaks; NULL: nobody who may. One speaks from one place, until it was silent for long. */
static soter_mavlink_source* speaker(soter_mavlink_bridge* bridge, const mavlink_message_t* m,
                                     const soter_mavlink_address* from) {
  SOTER_CHECK(bridge->system->source_count <= SOTER_MAVLINK_SOURCES);
  SOTER_CHECK(from->link < bridge->links);
  const int64_t now = soter_mavlink_now();
  for (uint32_t k = 0; k < bridge->system->source_count; k++) {
    soter_mavlink_source* const s = &bridge->source[k];
    if (s->id.system != m->sysid || s->id.component != m->compid) {
      continue;
    }
    if (!s->bound || now - s->heard > BOUND_NS) {
      forget_stamps(bridge, k);
      s->bindings++;
      s->bound = true;
      s->address = *from;
      s->sequence = (uint8_t)(m->seq - 1);
    } else if (!soter_mavlink_same_address(&s->address, from)) {
      s->elsewhere++;
      soter_mavlink_say_of(bridge, s->elsewhere, "a source",
                           "somebody speaks in its name from elsewhere");
      return NULL;
    }
    const uint8_t ahead = (uint8_t)(m->seq - s->sequence);
    if (ahead == 0) {
      s->repeated++;
      return NULL;
    }
    s->sequence = m->seq;
    s->lost += ahead - 1U;
    s->messages++;
    s->heard = now;
    return s;
  }
  bridge->strangers++;
  bridge->stranger_system = m->sysid;
  bridge->stranger_component = m->compid;
  if (m->sysid != bridge->system->own.system || m->compid != bridge->system->own.component) {
    soter_mavlink_say_of(bridge, bridge->strangers, "a stranger",
                         "a message of nobody whom the mapping names");
  }
  return NULL;
}

/* ------------------------------------------------------------------ HEARTBEAT, TIMESYNC */

static void beat(soter_mavlink_bridge* bridge) {
  SOTER_CHECK(bridge->topics <= SOTER_MAVLINK_TOPICS);
  mavlink_message_t m;
  mavlink_heartbeat_t heartbeat = {.custom_mode = 0,
                                   .type = 18,     /* MAV_TYPE_ONBOARD_CONTROLLER */
                                   .autopilot = 8, /* MAV_AUTOPILOT_INVALID: it is none */
                                   .base_mode = 0,
                                   .system_status = 4, /* MAV_STATE_ACTIVE */
                                   .mavlink_version = 3};
  for (size_t k = 0; k < bridge->topics; k++) {
    heartbeat.system_status = bridge->topic[k].silent ? 5 : heartbeat.system_status;
  } /* MAV_STATE_CRITICAL: the law is held from here, or nothing is */
  (void)mavlink_msg_heartbeat_encode_status(
      bridge->system->own.system, bridge->system->own.component, &bridge->sending, &m, &heartbeat);
  (void)soter_mavlink_send(bridge, &m);
}

/* To whomever it concerns: an answer is known by its ts1, which is a time of this computer. */
static void synchronise(soter_mavlink_bridge* bridge, int64_t tc1, int64_t ts1) {
  SOTER_CHECK(tc1 >= 0);
  mavlink_message_t m;
  mavlink_timesync_t timesync;
  (void)memset(&timesync, 0, sizeof timesync);
  timesync.tc1 = tc1;
  timesync.ts1 = ts1;
  (void)mavlink_msg_timesync_encode_status(
      bridge->system->own.system, bridge->system->own.component, &bridge->sending, &m, &timesync);
  (void)soter_mavlink_send(bridge, &m);
}

static void on_timesync(soter_mavlink_bridge* bridge, const mavlink_message_t* m) {
  SOTER_CHECK(m->msgid == MAVLINK_MSG_ID_TIMESYNC);
  mavlink_timesync_t t;
  mavlink_msg_timesync_decode(m, &t);
  const int64_t now = soter_mavlink_now();
  if (t.tc1 == 0) {
    synchronise(bridge, now, t.ts1);
    return;
  }
  const uint64_t jumps = bridge->clock.jumps;
  (void)soter_mavlink_clock_hear(&bridge->clock, now, t.ts1, t.tc1);
  if (bridge->clock.jumps != jumps) {
    forget_stamps(bridge, 0);
    soter_mavlink_say_of(bridge, bridge->clock.jumps, "TIMESYNC",
                         "the autopilot's clock jumped: it began anew?");
  }
}

static void on_message(void* to, const mavlink_message_t* m, const soter_mavlink_address* from) {
  soter_mavlink_bridge* const bridge = to;
  const soter_mavlink_source* const source = speaker(bridge, m, from);
  if (source == NULL) {
    return;
  }
  const uint32_t index = (uint32_t)(source - bridge->source);
  SOTER_CHECK(index < bridge->system->source_count);
  if (index == 0 && m->msgid == MAVLINK_MSG_ID_TIMESYNC) {
    on_timesync(bridge, m);
  }
  if (index == 0 && m->msgid == MAVLINK_MSG_ID_HEARTBEAT) {
    mavlink_heartbeat_t heartbeat;
    mavlink_msg_heartbeat_decode(m, &heartbeat);
    bridge->autopilot_told = true;
    bridge->base_mode = heartbeat.base_mode;
    bridge->custom_mode = heartbeat.custom_mode;
  }
  for (size_t k = 0; k < bridge->topics; k++) {
    const soter_mavlink_inward* const in = bridge->topic[k].in;
    if (in != NULL && in->id == m->msgid && in->source == index) {
      soter_mavlink_judge(&bridge->topic[k], m);
    }
  }
}

/* ------------------------------------------------------------------ arguments */

/* False where there is no such word. */
static bool option(soter_mavlink_bridge* bridge, options* o, const char* name, const char* value) {
  SOTER_CHECK(o->links <= SOTER_MAVLINK_LINKS);
  double seconds = 0.0;
  if (strcmp(name, "--channels") == 0 && value[0] != '\0') {
    o->channels = value;
  } else if (strcmp(name, "--url") == 0 && o->links < SOTER_MAVLINK_LINKS) {
    o->urls[o->links++] = value;
  } else if (strcmp(name, "--delay") == 0 && soter_bridge_number(value, 0.0, 1.0, &seconds)) {
    bridge->delay_ns = (int64_t)(seconds * 1e9 + 0.5);
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
static int read_arguments(soter_mavlink_bridge* bridge, options* o, int count, char** words) {
  SOTER_CHECK(bridge->system->links <= SOTER_MAVLINK_LINKS);
  for (int i = 1; i < count; i += 2) {
    if (strcmp(words[i], "--help") == 0 || strcmp(words[i], "-h") == 0) {
      (void)printf(
          "%s --channels FOLDER [OPTIONS]: messages of MAVLink to and from the channels of\n"
          "the trusted part. The mapping takes the autopilot's COM_OF_LOSS_T to be %g s.\n%s",
          bridge->system->program, (double)bridge->system->offboard_loss_ns / 1e9, help);
      return 0;
    }
    if (i + 1 >= count || !option(bridge, o, words[i], words[i + 1])) {
      soter_mavlink_say(bridge, words[i], "no such option, or no value of it; --help says which");
      return 2;
    }
  }
  if (o->channels == NULL) {
    soter_mavlink_say(bridge, "",
                      "--channels is needed: the folder of the trusted part's channels");
    return 2;
  }
  for (; o->links == 0 && bridge->links < bridge->system->links; bridge->links++) {
    o->urls[bridge->links] = bridge->system->urls[bridge->links];
  }
  bridge->links = o->links > 0 ? o->links : bridge->links;
  return -1;
}

/* ------------------------------------------------------------------ running */

static bool make_topics(soter_mavlink_bridge* bridge) {
  SOTER_CHECK(bridge->topics == 0U);
  const soter_mavlink_system* const s = bridge->system;
  if (s->ins + s->outs > SOTER_MAVLINK_TOPICS || s->source_count > SOTER_MAVLINK_SOURCES) {
    return false;
  }
  for (; bridge->topics < s->ins + s->outs; bridge->topics++) {
    soter_mavlink_topic* const t = &bridge->topic[bridge->topics];
    t->in = bridge->topics < s->ins ? &s->in[bridge->topics] : NULL;
    t->out = t->in != NULL ? NULL : &s->out[bridge->topics - s->ins];
    t->bridge = bridge;
  }
  for (size_t k = 0; k < s->source_count; k++) {
    bridge->source[k].id = s->sources[k];
  }
  return true;
}

static bool open_all(soter_mavlink_bridge* bridge, const options* o) {
  SOTER_CHECK(bridge->links > 0U && bridge->links <= SOTER_MAVLINK_LINKS);
  bool opened = true;
  for (size_t k = 0; k < bridge->links; k++) {
    bridge->link[k].file = -1;
  }
  for (size_t k = 0; opened && k < bridge->links; k++) {
    const char* const wrong = soter_mavlink_link_open(&bridge->link[k], o->urls[k]);
    bridge->link[k].empty_ns = soter_mavlink_now();
    if (wrong != NULL) {
      soter_mavlink_say(bridge, o->urls[k], wrong);
      opened = false;
    }
  }
  for (size_t k = 0; opened && k < bridge->topics; k++) {
    soter_mavlink_topic* const t = &bridge->topic[k];
    const char* const wrong = soter_mavlink_topic_open(t, o->channels);
    if (wrong != NULL) {
      soter_mavlink_say(bridge, t->in != NULL ? t->in->name : t->out->name, wrong);
      opened = false;
    }
  }
  return opened;
}

static void hear(soter_mavlink_bridge* bridge) {
  SOTER_CHECK(bridge->links <= SOTER_MAVLINK_LINKS);
  struct pollfd files[SOTER_MAVLINK_LINKS];
  for (size_t k = 0; k < bridge->links; k++) {
    files[k] = (struct pollfd){.fd = bridge->link[k].file, .events = POLLIN, .revents = 0};
  }
  const int64_t before = soter_mavlink_now();
  if (poll(files, (nfds_t)bridge->links, TURN_MS) < 0) {
    return;
  }
  (void)pthread_mutex_lock(&bridge->held);
  for (uint32_t k = 0; k < bridge->links; k++) {
    soter_mavlink_link* const link = &bridge->link[k];
    if (files[k].revents == 0) {
      link->empty_ns = before;
      continue;
    }
    const int64_t begun = soter_mavlink_now();
    if (!soter_mavlink_link_read(link, k, on_message, bridge)) {
      soter_mavlink_say(bridge, link->url, "the link has ended, and so does the bridge");
      soter_mavlink_end(2); /* whoever starts it again opens it anew */
    }
    link->empty_ns = link->drained ? begun : link->empty_ns;
  }
  (void)pthread_mutex_unlock(&bridge->held);
}

static void turns(soter_mavlink_bridge* bridge, const options* o) {
  SOTER_CHECK(bridge->topics == bridge->system->ins + bridge->system->outs);
  int64_t beaten = 0;
  int64_t synchronised = 0;
  while (soter_mavlink_ending() == 0) {
    hear(bridge);
    const int64_t now = soter_mavlink_now();
    (void)pthread_mutex_lock(&bridge->held);
    if (now - beaten >= HEARTBEAT_NS) {
      beat(bridge);
      beaten = now;
    }
    if (now - synchronised >= TIMESYNC_NS && bridge->source[0].bound) {
      soter_mavlink_clock_ask(&bridge->clock, now);
      synchronise(bridge, 0, now);
      synchronised = now;
    }
    if (asked != 0) {
      asked = 0;
      soter_mavlink_report(bridge, o->json);
    }
    (void)pthread_mutex_unlock(&bridge->held);
  }
}

static void run(soter_mavlink_bridge* bridge, const options* o) {
  const size_t ins = bridge->system->ins;
  SOTER_CHECK(ins <= bridge->topics);
  size_t begun = ins;
  for (; begun < bridge->topics; begun++) {
    if (pthread_create(&bridge->topic[begun].thread, NULL, soter_mavlink_serve,
                       &bridge->topic[begun]) != 0) {
      soter_mavlink_say(bridge, "", "there is no thread for a topic");
      soter_mavlink_end(2);
      break;
    }
  }
  soter_mavlink_say(bridge, "", "it runs");
  turns(bridge, o);
  for (size_t k = ins; k < begun; k++) {
    (void)pthread_join(bridge->topic[k].thread, NULL);
  }
  soter_process_ending();
  if (o->status) {
    soter_mavlink_report(bridge, o->json);
  }
}

int soter_mavlink_main(const soter_mavlink_system* system, int count, char** words) {
  SOTER_CHECK(system != NULL && system->source_count > 0U);
  static soter_mavlink_bridge bridge; /* too large for a stack; nothing of it outlives this call */
  options o = {.channels = NULL, .links = 0, .status = false, .json = false};
  (void)memset(&bridge, 0, sizeof bridge);
  bridge.system = system;
  bridge.delay_ns = system->delay_ns;
  const int wrong = read_arguments(&bridge, &o, count, words);
  if (wrong >= 0) {
    return wrong;
  }
  if (!soter_process_begin(on_signal)) {
    return 1;
  }
  (void)pthread_mutex_init(&bridge.held, NULL);
  if (!make_topics(&bridge)) {
    soter_mavlink_say(&bridge, "", "it has more topics or sources than a bridge can carry");
    return soter_process_end(1);
  }
  const bool opened = open_all(&bridge, &o);
  if (opened) {
    run(&bridge, &o);
  }
  for (size_t k = 0; k < bridge.links; k++) {
    soter_mavlink_link_close(&bridge.link[k]);
  }
  return soter_process_end(opened && soter_mavlink_ending() != 2 ? 0 : 1);
}
