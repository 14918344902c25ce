/* soter_dds_topics.h: the topics of a bridge while it runs.
 *
 * Purpose: what the files of the bridge have in common: its topics, their counters, and what is
 * said of them. Non-goals: use from outside (soter_dds_bridge.h).
 */
#ifndef SOTER_DDS_TOPICS_H
#define SOTER_DDS_TOPICS_H

#include "soter_check.h"
#include "soter_dds_bridge.h"

#include <pthread.h>

/* What is counted of a topic; soter_dds_report.c has the words. */
enum {
  SOTER_DDS_TAKEN,     /* in: written into the channel */
  SOTER_DDS_STRANGER,  /* in: of another writer */
  SOTER_DDS_SIZE,      /* in: as long as no sample of its type is */
  SOTER_DDS_FRAME,     /* in: in another frame */
  SOTER_DDS_UNSTAMPED, /* in: without a stamp */
  SOTER_DDS_FUTURE,    /* in: stamped later than now */
  SOTER_DDS_BACKWARDS, /* in: stamped earlier than the one before */
  SOTER_DDS_ABSENT,    /* in: without a value, or one that the topic cannot hold */
  SOTER_DDS_UNREAD,    /* in: DDS could not read it */
  SOTER_DDS_BOUND,     /* in: writers that were bound, one after the other */
  SOTER_DDS_PUBLISHED, /* out */
  SOTER_DDS_UNSENT,    /* out: DDS did not take it */
  SOTER_DDS_OTHERS,    /* out: other writers that came */
  SOTER_DDS_TYPE,      /* peers with another type */
  SOTER_DDS_QOS,       /* peers whose QoS does not match */
  SOTER_DDS_COUNTS
};

#define SOTER_DDS_NAME 128
#define SOTER_DDS_WHY 256
#define SOTER_DDS_DIAGNOSTICS "rt/diagnostics"

typedef struct soter_dds_bridge soter_dds_bridge;
typedef struct soter_dds_diagnostics soter_dds_diagnostics;

/* One of `in` and `out` is NULL. */
typedef struct {
  const soter_dds_inward* in;
  const soter_dds_outward* out;
  const char* topic;
  const char* type;
  soter_dds_bridge* bridge;
  dds_topic_descriptor_t* described; /* a copy, without type information */
  dds_entity_t end;                  /* the reader, or the writer */
  dds_entity_t waitset;
  soter_outside channel;
  void* message;
  void* value;
  pthread_t thread;
  pthread_mutex_t held; /* over what follows */
  uint64_t count[SOTER_DDS_COUNTS];
  char why[SOTER_DDS_WHY];        /* the last thing that went wrong; "": nothing */
  char publisher[SOTER_DDS_NAME]; /* in: who is bound, in words; "": nobody yet */
  bool silent;                    /* out: nobody writes the channel */
  /* of the topic's own thread */
  dds_instance_handle_t bound, refused;
  int64_t last_stamp;
  void* last_value;
  int64_t begun, told, heard;
  bool before; /* out: a value was there, of now or not */
} soter_dds_topic;

struct soter_dds_bridge {
  const soter_dds_system* system;
  soter_dds_topic* topic; /* those that come in first */
  size_t topics;
  int64_t clock_error_ns;
  bool types_checked;
  uint32_t domain;
  dds_entity_t participant;
  dds_entity_t writers, readers, participants; /* what DDS says of everybody's */
  soter_dds_diagnostics* diagnostics;
};

int64_t soter_dds_monotonic_ns(void);
int64_t soter_dds_wall_ns(void);

/* Whether somebody asked it to end. */
bool soter_dds_ending(void);
void soter_dds_end(void); /* may be called in a signal handler */

/* Counts it, says it on standard error the first time, and keeps why. */
void soter_dds_count(soter_dds_topic* topic, int what, const char* why);

/* A line on standard error; none where whoever reads that end does not. */
void soter_dds_say(const soter_dds_bridge* bridge, const char* about, const char* what);

/* ---- soter_dds_samples.c: NULL, or what is wrong; what `pthread_create` runs */
const char* soter_dds_open_topic(soter_dds_topic* topic, const char* folder);
void* soter_dds_serve_inward(void* topic);
void* soter_dds_serve_outward(void* topic);
void soter_dds_close_topic(soter_dds_topic* topic);
/* A copy of a descriptor that tells no structure, to be freed; NULL: there is no memory. */
dds_topic_descriptor_t* soter_dds_plain(const dds_topic_descriptor_t* type);
dds_qos_t* soter_dds_qos_of(const soter_dds_qos* asked);

/* ---- soter_dds_peers.c */
const char* soter_dds_open_peers(soter_dds_bridge* bridge);
/* What became known of others: types and QoS that do not match, other writers. */
void soter_dds_look(soter_dds_bridge* bridge);
/* Whether a writer may be heard: binds to the first, and judges by name where there is one. */
bool soter_dds_may_write(soter_dds_topic* topic, dds_instance_handle_t writer);

/* ---- soter_dds_report.c */
void soter_dds_report(soter_dds_bridge* bridge, bool json);
/* What is counted, in words; NULL where topics of this way do not count it. */
const char* soter_dds_word(int what, bool inward);

/* ---- soter_dds_diagnostics.c: NULL, or what is wrong */
const char* soter_dds_open_diagnostics(soter_dds_bridge* bridge, const char* folder);
/* Waits for the trusted part to say something; then tells, where it is time or there is news. */
void soter_dds_diagnose(soter_dds_bridge* bridge, int64_t wait_ns);
void soter_dds_close_diagnostics(soter_dds_bridge* bridge);

#endif
