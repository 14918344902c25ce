/* soter_firmware.h: a program in somebody's own loop.
 *
 * Your `main`, your loop, your clock: you tell the time, publish what sensors say, step, and read
 * what is to be done (docs/deploy.md). The generated NAME_firmware.h has a typed function for every
 * topic and module; this is what they have in common. All that changes lies in one struct of yours:
 * no heap, no global variable, no clock, nothing that is called back.
 */
#ifndef SOTER_FIRMWARE_H
#define SOTER_FIRMWARE_H

#include "soter.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What became of a value. A refused one leaves the topic as it was: it grows older, no more. */
typedef enum {
  SOTER_TAKEN = 0,
  SOTER_NOT_FINITE = 1,  /* it has a NaN or an infinity */
  SOTER_NOT_IN_SET = 2,  /* a number of it lies outside the topic's set */
  SOTER_NO_VALUE = 3,    /* an int, enum or length that the topic's type does not have */
  SOTER_OLDER = 4,       /* measured before the value that the topic has */
  SOTER_FROM_FUTURE = 5, /* measured after `now` */
  SOTER_BACKWARDS = 6,   /* `now` is before the time that was told last */
  SOTER_NOT_STARTED = 7  /* no start, or one that was refused */
} soter_taken;

/* What a step says: bits. */
#define SOTER_RAN 1U            /* at least one instant was due */
#define SOTER_BEHIND 2U         /* more than one was: the loop missed the time of an instant */
#define SOTER_LATE 4U           /* a DM or SC ran later than its module declares (`late`) */
#define SOTER_TIME_BACKWARDS 8U /* `now` is before the time that was told last: nothing was run */
#define SOTER_UNHEARD 16U       /* a topic from outside was never published */
#define SOTER_LATCHED 32U       /* a component faulted and holds its fail-safe values */
#define SOTER_REFUSED 64U       /* not started: nothing was run */
#define SOTER_NO_ANSWER 128U    /* an extern that is not linked was due: its step is a fault */
#define SOTER_STALE 256U /* SC, or a node before it, read what was older than a proof allows */

/* How old a topic may be where a component reads it: its `max_age`, and the module's `dropout`. */
typedef struct {
  uint32_t component, topic;
  int64_t most; /* ns */
} soter_read_age;

/* Times are those of your clock, in ns; it may start anywhere. */
typedef struct {
  const soter_program* program; /* NULL before the start */
  const int64_t* late;          /* per component: how late it may run, -1 where nobody says */
  const uint32_t* outside;      /* the topics that somebody outside publishes */
  const soter_read_age* ages;   /* how old what SCs read may be */
  uint32_t outside_count;
  uint32_t age_count;
  uint32_t late_steps;   /* steps that were SOTER_LATE */
  uint32_t behind_steps; /* steps that were SOTER_BEHIND */
  uint32_t stale_steps;  /* steps that were SOTER_STALE */
  int64_t origin;        /* your clock at the program's time 0 */
  int64_t now;           /* the time that was told last */
  int64_t lateness;      /* of the instant of the last step that was latest, ns */
  int64_t latest;        /* of all instants */
} soter_firmware;

/* Everything as before the first instant, which is at `now`. NULL, or what is wrong, in words. */
const char* soter_firmware_start(soter_firmware* f, const soter_program* p, void* state,
                                 uint64_t seed, int64_t now);

/* Environment-Input: a value that was measured at `measured` counts from the next instant on. Its
 * stamp is that time, or the instant that is due next where that is earlier: older than it is,
 * never newer than the step that reads it. */
soter_taken soter_firmware_publish(soter_firmware* f, void* state, uint32_t topic,
                                   const void* value, int64_t measured, int64_t now);

/* Runs every instant whose time has come, in order; what there is to say, as bits. */
uint32_t soter_firmware_step(soter_firmware* f, void* state, int64_t now);

/* The time of the next instant, of your clock: until then there is nothing to do. */
int64_t soter_firmware_next(const soter_firmware* f, const void* state);

/* A stamp as a time of your clock; false where nothing was ever published. */
bool soter_firmware_stamp(const soter_firmware* f, int64_t stamp, int64_t* time);

#ifdef __cplusplus
}
#endif

#endif
