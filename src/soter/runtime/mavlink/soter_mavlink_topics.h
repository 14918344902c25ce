/* soter_mavlink_topics.h: a bridge while it runs.
 *
 * Purpose: what the files of the bridge have in common: links, sources, topics, and their counters.
 * Non-goals: use from outside (soter_mavlink_bridge.h).
 */
#ifndef SOTER_MAVLINK_TOPICS_H
#define SOTER_MAVLINK_TOPICS_H

#include "soter_check.h"
#include "soter_mavlink_bridge.h"
#include "soter_mavlink_clock.h"
#include "soter_mavlink_link.h"
#include "soter_outside.h"

#include <pthread.h>

#define SOTER_MAVLINK_LINKS 4
#define SOTER_MAVLINK_SOURCES 16
#define SOTER_MAVLINK_TOPICS 64

/* What is counted of a topic; soter_mavlink_report.c has the words. */
enum {
  SOTER_MAVLINK_TAKEN,       /* in: written into the channel */
  SOTER_MAVLINK_OTHER_FRAME, /* in: a constant is not that of the mapping */
  SOTER_MAVLINK_UNSTAMPED,   /* in: without a stamp */
  SOTER_MAVLINK_UNSYNCED,    /* in: no TIMESYNC yet, and nobody says how long messages take */
  SOTER_MAVLINK_FUTURE,      /* in: stamped later than now */
  SOTER_MAVLINK_BACKWARDS,   /* in: stamped earlier than the one before, or as it: a repetition */
  SOTER_MAVLINK_ABSENT,      /* in: without a value, or one that the topic cannot hold */
  SOTER_MAVLINK_BY_ARRIVAL,  /* in: of those taken, how many by arrival and delay */
  SOTER_MAVLINK_SENT,        /* out */
  SOTER_MAVLINK_LAW,         /* out: of those, how many were the law in a silence */
  SOTER_MAVLINK_COUNTS
};

#define SOTER_MAVLINK_WHY 160

typedef struct soter_mavlink_bridge soter_mavlink_bridge;

/* One of `in` and `out` is NULL. */
typedef struct {
  const soter_mavlink_inward* in;
  const soter_mavlink_outward* out;
  soter_mavlink_bridge* bridge;
  soter_outside channel;
  pthread_t thread;
  int64_t last_stamp;    /* in: of the autopilot; below 0: none yet */
  int64_t last_measured; /* in */
  int64_t begun, told, heard;
  bool before; /* out: a value was there, of now or not */
  /* below the bridge's lock */
  uint64_t count[SOTER_MAVLINK_COUNTS];
  bool silent; /* out: nobody writes the channel */
} soter_mavlink_topic;

/* Somebody who may speak. */
typedef struct {
  soter_mavlink_id id;
  bool bound;
  soter_mavlink_address address; /* where it is heard */
  uint8_t sequence;
  int64_t heard;
  uint64_t messages, lost, repeated, elsewhere, bindings;
} soter_mavlink_source;

struct soter_mavlink_bridge {
  const soter_mavlink_system* system;
  soter_mavlink_topic topic[SOTER_MAVLINK_TOPICS]; /* those that come in first */
  size_t topics;
  int64_t delay_ns;
  pthread_mutex_t held; /* over all that follows */
  soter_mavlink_link link[SOTER_MAVLINK_LINKS];
  size_t links;
  soter_mavlink_source source[SOTER_MAVLINK_SOURCES];
  mavlink_status_t sending; /* counts frames */
  soter_mavlink_clock clock;
  uint64_t strangers;
  uint8_t stranger_system, stranger_component; /* the last one */
  bool autopilot_told;                         /* its HEARTBEAT was heard */
  uint8_t base_mode;
  uint32_t custom_mode;
  char why[SOTER_MAVLINK_WHY]; /* the last thing that went wrong; "": nothing */
};

int64_t soter_mavlink_now(void);

/* ---- soter_mavlink_shared.c */
/* 0: it goes on; 1: somebody asked it to end; 2: it cannot go on. */
int soter_mavlink_ending(void);
void soter_mavlink_end(int how);

/* Counts it, says it on standard error the 1st, 2nd, 4th ... time, and keeps why; lock held. */
void soter_mavlink_count(soter_mavlink_topic* topic, int what, const char* why);
void soter_mavlink_say(soter_mavlink_bridge* bridge, const char* about, const char* what);
void soter_mavlink_say_of(soter_mavlink_bridge* bridge, uint64_t many, const char* about,
                          const char* why);

/* Sends to the autopilot, as soon as somebody knows where it is; lock held. False: nobody does. */
bool soter_mavlink_send(soter_mavlink_bridge* bridge, const mavlink_message_t* m);

/* ---- soter_mavlink_topics.c: NULL, or what is wrong; what `pthread_create` runs */
const char* soter_mavlink_topic_open(soter_mavlink_topic* topic, const char* folder);
/* A message of its source; lock held. */
void soter_mavlink_judge(soter_mavlink_topic* topic, const mavlink_message_t* m);
void* soter_mavlink_serve(void* topic);

/* ---- soter_mavlink_report.c; lock held */
void soter_mavlink_report(soter_mavlink_bridge* bridge, bool json);

#endif
