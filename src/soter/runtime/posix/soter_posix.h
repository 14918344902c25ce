/* soter_posix.h: the real-time driver: one thread that the calendar wakes.
 *
 * Purpose: what the files of the driver share. docs/real-time.md says what it does and what it
 * cannot.
 * Non-goals: other systems than Linux and its like; sensors and actuators (soter_outside.h).
 *
 * Times are whole nanoseconds. `ct` is time of the program, 0 at the start; `origin_ns + ct` is
 * when that is on CLOCK_MONOTONIC, which nobody can set.
 */
#ifndef SOTER_POSIX_H
#define SOTER_POSIX_H

#include "soter_app.h"
#include "soter_channel.h"
#include "soter_check.h"
#include "soter_grant.h"
#include "soter_lease.h"
#include "soter_outside.h"
#include "soter_status.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

/* ------------------------------------------------------------------ what the program says */

/* An extern node, answered by a process of its own. */
typedef struct {
  uint32_t component;
  const char* file; /* the worker's program, beside this one; NULL: --worker says it */
  size_t in_size, out_size;
  uint64_t hash;     /* of both layouts */
  int64_t budget_ns; /* from the release until it must have answered */
  void (*gather)(const void* state, void* in);
} soter_posix_extern;

/* A topic that meets the world: a channel of its name in the folder of --channels. */
typedef struct {
  uint32_t topic;
  const char* name;
  uint64_t hash;      /* of its layout */
  int64_t max_age_ns; /* -1: it has none */
  bool inward;        /* somebody else publishes it */
  bool awaited;       /* at the start: not what only ACs read, of whom nothing is asked */
} soter_posix_topic;

/* How old a topic may be where a component reads it: older no proof speaks of. */
typedef struct {
  uint32_t component;
  uint32_t topic;
  int64_t most_ns;
  bool outside; /* it has to be there from the start: before, SC acts on its default */
} soter_posix_age;

/* What travels with a command of a module that has a fail-safe law; the command follows. */
typedef struct {
  int64_t stamp, expiry; /* CLOCK_MONOTONIC: of the release that gave the lease, and its end */
  int64_t begin;         /* until when actuators that hold the law may begin to obey; SOTER_NEVER */
} soter_posix_lease_head;

/* A module with a fail-safe law: who gives its leases, and what is sent with them. */
typedef struct {
  uint32_t module;
  const char* name;
  const char* channel; /* no topic is called so */
  uint64_t hash;
  const soter_grant_info* grant;
  const soter_lease_info* lease;
  const uint32_t* component; /* of each node of `grant` */
  const soter_posix_age* age;
  uint32_t ages;
  size_t size; /* of a message: a head, then the command */
  void (*gather)(const void* state, void* command);
  void (*apply)(void* state, const void* command); /* where plants are here: NULL elsewhere */
} soter_posix_lease;

/* soter_app.h declares, soter_app.c defines:
 *   APP_STATE, APP_PROGRAM, APP_UNTIL_NS, APP_COMPONENTS, APP_MODULES, APP_EXTERNS, APP_WORDS,
 *   APP_SLOTS, APP_LONGEST_NS, APP_OUTSIDE, APP_LEASES, APP_BUDGETS, APP_STATUS_HASH,
 *   soter_app_answer, and: */
extern const soter_posix_extern soter_app_externs[];
extern const uint32_t soter_app_extern_count; /* APP_EXTERNS */
extern const soter_posix_topic soter_app_outside[];
extern const uint32_t soter_app_outside_count; /* APP_OUTSIDE */
extern const soter_posix_lease soter_app_leases[];
extern const uint32_t soter_app_lease_count;  /* APP_LEASES */
extern const int64_t soter_app_late_ns[];     /* of each component */
extern const int64_t soter_app_response_ns[]; /* of each component */
extern const uint32_t soter_app_looks[];      /* of each module: Module.looks (docs/proof.md) */
extern const char soter_app_flown[];          /* the head of a recording, but its seed */

/* ------------------------------------------------------------------ figures */

/* Logarithmic: 16 parts an octave, so a figure read off is within 6.25 %. */
#define SOTER_BINS 1024U
typedef struct {
  uint64_t count;
  int64_t most_ns;
  uint32_t bin[SOTER_BINS];
} soter_histogram;

typedef struct {
  soter_histogram late;     /* from the release to the begin of the step */
  soter_histogram complete; /* from the release to its end */
  uint64_t released_late;   /* misses, by kind */
  uint64_t completed_late;
} soter_node_times;

typedef struct {
  uint64_t asked, answered;
  uint64_t later;   /* of those answered: in budget, but not before the next instant */
  uint64_t missing; /* nothing whole by the end of the budget */
  uint64_t seen[SOTER_CHANNEL_STATES]; /* what stood there then */
  uint64_t failed;                     /* it answered that its step failed */
  soter_histogram took;
  uint64_t in_a_row; /* unanswered until now */
} soter_worker_times;

/* Of a topic that meets the world. */
typedef struct {
  soter_outside channel;
  uint64_t told;    /* values that went out */
  uint64_t taken;   /* values that came in */
  uint64_t refused; /* not finite, not in the topic's set, no value of its type */
  uint64_t older;   /* measured before the value that the topic has */
  uint64_t future;  /* measured later than now */
  uint64_t bad;     /* what was no whole value of this layout */
  int64_t stamp;    /* of the value that went out last */
} soter_outside_times;

/* A read that the proof of a module is not about. */
typedef struct {
  const soter_posix_age* of; /* NULL: there was none */
  int64_t age_ns;            /* SOTER_NEVER: nobody had published it */
} soter_old_read;

/* Of the leases of a module. */
typedef struct {
  soter_outside channel;
  soter_grant grant;
  int64_t done[APP_BUDGETS];
  soter_lease lease;               /* what plants that are here obey */
  uint64_t given;                  /* messages with a lease */
  uint64_t stale;                  /* releases that read what was too old: not done */
  int64_t ended_ns;                /* ct from which on no lease is given; -1: they are */
  soter_old_read old[APP_BUDGETS]; /* of each node, the first one since it was done last */
  uint64_t law;                    /* instants in which plants obeyed the law */
  int64_t silence_law_ns;          /* how long of the longest silence the law was applied */
  uint64_t message[APP_WORDS];
  uint64_t command[APP_WORDS];
} soter_lease_times;

typedef enum {
  SOTER_CAUSE_TTF = 0,
  SOTER_CAUSE_STALE = 1,
  SOTER_CAUSE_GATE = 2,   /* AC published what its topic's set has not, or failed */
  SOTER_CAUSE_SILENT = 3, /* AC did not answer in its budget */
  SOTER_CAUSE_MISSED = 4  /* the trusted part was late: soter_posix_missed */
} soter_cause;
#define SOTER_CAUSES 5

typedef enum {
  SOTER_MISS_RELEASE = 0,  /* a trusted step began later than it may */
  SOTER_MISS_COMPLETE = 1, /* it ended later than it may */
  SOTER_MISS_CALENDAR = 2  /* so far behind that the calendar was given up and began anew */
} soter_miss;

/* ------------------------------------------------------------------ the log */

/* What the trusted thread leaves for the logger at the end of an instant. */
typedef struct {
  int64_t ct;
  int64_t wake_ns;        /* CLOCK_MONOTONIC behind the release, as the instant began */
  int64_t done_ns;        /* the same at its end */
  int64_t independent_ns; /* CLOCK_MONOTONIC_RAW as it began */
  uint32_t misses;        /* of this instant */
  uint32_t modes;         /* a bit a module, 1: AC; of the first 32 */
  /* of each DM that stepped, behind its release: as it began and as it ended; SOTER_NEVER */
  int64_t look_late_ns[APP_MODULES > 0 ? APP_MODULES : 1];
  int64_t look_done_ns[APP_MODULES > 0 ? APP_MODULES : 1];
} soter_instant_times;

/* Without holes: a recording is made of its bytes. */
typedef struct {
  uint64_t number; /* of the instant, from 0 on; dropped ones count */
  soter_instant_times times;
  APP_STATE state;
} soter_record;

/* One writer, one reader. Full: the record is dropped and counted, nobody waits. */
typedef struct {
  uint64_t head; /* written by the trusted thread */
  uint64_t tail; /* written by the logger */
  uint64_t dropped;
  soter_record slot[APP_SLOTS];
} soter_ring;

bool soter_ring_put(soter_ring* ring, const soter_instant_times* times, const APP_STATE* state);
bool soter_ring_take(soter_ring* ring, soter_record* record);

/* ------------------------------------------------------------------ workers */

#define SOTER_COMMAND_MAX 4096

typedef struct {
  char command[SOTER_COMMAND_MAX]; /* run by /bin/sh; empty: `file`, beside this program */
  void* request;                   /* we write, it reads */
  void* answer;                    /* it writes, we read */
  int request_fd, answer_fd;
} soter_worker;

/* Shared with the process that starts workers; every field has one writer. */
typedef struct {
  uint32_t starts, ends;
  int32_t pid;    /* 0: none */
  int32_t status; /* the last wait status */
  int32_t error;  /* errno where it could not be started */
  uint32_t kill_asked, kill_done;
} soter_worker_status;

typedef struct {
  soter_worker_status worker[APP_EXTERNS > 0 ? APP_EXTERNS : 1];
  bool over; /* written by us: all are ended */
} soter_workers_status;

/* ------------------------------------------------------------------ the driver */

typedef enum {
  SOTER_POLICY_AUTO = 0,
  SOTER_POLICY_FIFO,
  SOTER_POLICY_DEADLINE,
  SOTER_POLICY_OTHER
} soter_policy;

typedef struct {
  int64_t until_ns;
  uint64_t seed;
  soter_policy policy;
  int core;        /* -1: choose, -2: do not pin */
  int64_t late_ns; /* -1: as the program says */
  uint64_t misses_allowed;
  int64_t early_ns; /* to wake before an instant, and spin until it */
  bool json, quiet, live;
  bool end_with_leases; /* once none is given any more: whoever starts it anew gets it in SC */
  const char* log;
  const char* channels; /* the folder of what meets the world; NULL: nothing does */
  const char* record;   /* every soter_record, between a head and an end */
  uint64_t restarts;    /* of each worker */
  int64_t patience_ns;  /* without an answer, until a worker is ended */
  int64_t again_ns;     /* before a worker that ended is started again */
  int64_t bare_ns;      /* for wake-ups with nothing to do, before the start */
  int64_t wait_ns;      /* for workers to be ready, at the start */
  uint64_t memory_mib;  /* that a worker may map; 0: any */
  int64_t user;         /* uid of workers; -1: as this process */
} soter_options;

typedef struct {
  uint64_t number;               /* of the last request */
  int64_t asked_at_ns, until_ns; /* ct of the release, ct by which an answer counts */
  bool outstanding;
} soter_request;

/* What could not be had, and what that costs. */
#define SOTER_NOTES 16
#define SOTER_NOTE_MAX 400

typedef struct {
  APP_STATE state;
  soter_options options;
  int64_t origin_ns;
  int stop; /* a signal number */
  bool deadline, locked, pinned;
  int core;
  char policy[32];
  /* the trusted thread */
  soter_node_times node[APP_COMPONENTS];
  soter_worker_times worker[APP_EXTERNS > 0 ? APP_EXTERNS : 1];
  soter_request request[APP_EXTERNS > 0 ? APP_EXTERNS : 1];
  uint32_t cause[APP_MODULES > 0 ? APP_MODULES : 1]; /* why the gate latch was set */
  uint64_t takeovers[APP_MODULES > 0 ? APP_MODULES : 1][SOTER_CAUSES];
  uint32_t
      why[APP_MODULES > 0 ? APP_MODULES : 1]; /* SC took over last; 0: never, 1 + soter_cause */
  int64_t next_look_ns[APP_MODULES > 0 ? APP_MODULES : 1]; /* release; SOTER_NEVER: none was yet */
  bool looked;                                             /* since the status was told */
  uint64_t instants, late_instants, missed, calendars;
  uint64_t late_untrusted; /* instants in which plants or ACs were late, and no trusted step */
  uint32_t missed_now;
  soter_instant_times times; /* of this instant */
  int64_t moved_ns;          /* how far the calendar was moved as it began */
  bool failsafe_now, untrusted_late_now;
  int64_t silence_ns; /* longest time from the end of an instant to the begin of the next */
  int64_t silence_ct; /* of the instant before it */
  soter_histogram wake, output, bare;
  uint64_t minor_faults, major_faults;
  int64_t heartbeat_ns; /* CLOCK_MONOTONIC as the last instant ended */
  uint64_t value[APP_WORDS];
  soter_outside_times outside[APP_OUTSIDE > 0 ? APP_OUTSIDE : 1];
  soter_lease_times lease[APP_LEASES > 0 ? APP_LEASES : 1];
  soter_outside status_channel;
  uint64_t said[SOTER_STATUS_WORDS(APP_MODULES, APP_LEASES, APP_OUTSIDE)]; /* soter_status.h */
  int64_t said_ns;                                                         /* CLOCK_MONOTONIC */
  uint32_t said_modes;
  /* others */
  soter_worker workers[APP_EXTERNS > 0 ? APP_EXTERNS : 1];
  soter_workers_status* status;
  int32_t keeper; /* the process that starts workers; 0: none */
  bool shared;    /* there is shared memory */
  soter_ring ring;
  char notes[SOTER_NOTES][SOTER_NOTE_MAX];
  uint32_t note_count;
  char digest[65];
  bool silent_seen, began, done;
  bool leases_over; /* it ended as no lease is given any more */
  uint64_t lines_lost;
} soter_posix;

/* soter_posix_clock.c: CLOCK_MONOTONIC, and CLOCK_MONOTONIC_RAW */
int64_t soter_posix_clock(void);
int64_t soter_posix_independent(void);

/* soter_posix_setup.c */
void soter_posix_note(soter_posix* d, const char* format, ...)
    __attribute__((format(printf, 2, 3)));
void soter_posix_lock(soter_posix* d);
bool soter_posix_thread(soter_posix* d, pthread_t* thread, void* (*run)(void*));
void soter_posix_become(soter_posix* d);
int64_t soter_posix_shortest(void); /* period, at most 1 s */

/* soter_posix_workers.c: segments, and the process that starts workers. Before any thread. */
void soter_posix_workers(soter_posix* d, const char* self);
bool soter_posix_ready(soter_posix* d, uint32_t worker);
void soter_posix_await(soter_posix* d);
void soter_posix_release(soter_posix* d); /* at the end: no process is left */

/* soter_posix_world.c: what meets the world: topics from outside, commands with their leases. */
bool soter_posix_open(soter_posix* d); /* before the start: channels; false: one cannot be had */
bool soter_posix_hear(soter_posix* d); /* waits until sensors speak; false: it is to end */
bool soter_posix_leases_over(const soter_posix* d);
void soter_posix_note_old_reads(soter_posix* d); /* after the run: by which leases ended */
void soter_posix_begin(soter_posix* d);          /* the calendar's origin is known */
void soter_posix_listen(soter_posix* d);         /* an instant has begun: what came is published */
/* a component that was released has run, from `start` to `end`, CLOCK_MONOTONIC */
void soter_posix_done(soter_posix* d, uint32_t component, int64_t start_ns, int64_t end_ns);
void soter_posix_tell(soter_posix* d); /* what goes out, as it is now */

/* soter_posix_looks.c: what a DM's last look found, and until when that counts. */
int64_t soter_posix_late_limit(const soter_posix* d, uint32_t component);
void soter_posix_looked(soter_posix* d, uint32_t component); /* the DM has stepped */
bool soter_posix_safer(soter_posix* d, uint32_t module);     /* on fresh reads */
uint64_t soter_posix_surely_ac(soter_posix* d, uint32_t module);
int64_t soter_posix_begin_by(soter_posix* d);

/* soter_posix_status.c: what the trusted part says of itself; a bit a module, 1: AC. */
uint32_t soter_posix_modes(soter_posix* d);
void soter_posix_status(soter_posix* d, uint32_t modes);

/* soter_posix.c: the trusted thread. */
void* soter_posix_run(void* driver);

/* The one place where a trusted part that was late is made safe: its modules go to SC at the next
 * decision, as after a gate fault, and every node that has declared fail-safe values publishes
 * them at the end of this instant. `by_ns`: how late. */
void soter_posix_missed(soter_posix* d, soter_miss kind, uint32_t component, int64_t by_ns);

/* soter_posix_log.c: the logger's thread; what another watches. */
void* soter_posix_logger(void* driver);
void soter_posix_watch(soter_posix* d);

/* soter_posix_report.c */
void soter_histogram_add(soter_histogram* h, int64_t ns);
int64_t soter_histogram_quantile(const soter_histogram* h, double share);
void soter_posix_report(const soter_posix* d, FILE* out);
void soter_posix_json(const soter_posix* d, FILE* out);

#endif
