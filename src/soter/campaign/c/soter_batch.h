/* soter_batch.h: many runs in one call, and what happened in each.
 *
 * Purpose: campaigns: runs of one program under many seeds, in the meaning of soter_run, with the
 * events that statistics are made of, a digest of each run, what it measured, and whether AC would
 * have done harm where it was taken off (counterfactual saves).
 * Non-goals: programs with extern steps; what the statistics are.
 */
#ifndef SOTER_BATCH_H
#define SOTER_BATCH_H

#include "soter.h"

#define SOTER_OF_THREAD __thread /* what is remembered between calls (compiled_unit.py) */

#ifdef __cplusplus
extern "C" {
#endif

typedef enum {
  SOTER_TO_SC = 0,    /* `index`: a module whose DM gave control to SC */
  SOTER_TO_AC = 1,    /* the same, to AC */
  SOTER_VIOLATED = 2, /* `index`: a property that began to be violated */
  SOTER_LATCHED = 3   /* `index`: a component that latched after a fault */
} soter_event_kind;

/* Events stand in the order of their times; those of one instant in the order of kinds above,
 * modules, properties and components in their own. */
typedef struct {
  int64_t time; /* ns */
  uint32_t kind;
  uint32_t index;
} soter_event;

/* A number that is looked at after the first instant at or after every multiple of `every_ns`;
 * NaN: it has none there. The histogram has `bins` parts of [low, high], and two more: below it
 * the first, above it the last. */
typedef struct {
  int64_t every_ns;
  double low, high;
  uint32_t bins;
  double (*value)(const void* state);
} soter_measure;

typedef struct {
  uint32_t count;
  const soter_measure* measure;
} soter_measured;

typedef struct {
  uint32_t count; /* of looks that gave a number */
  double sum, least, most;
} soter_look;

#define SOTER_SAMPLES 16 /* states of a flight, evenly over it, that its trajectory is known by */

typedef struct {
  uint64_t seed;       /* in */
  uint32_t events;     /* out: how many of the events are its own */
  char digest[65];     /* out: SHA-256 of its events and its last state */
  char trajectory[65]; /* out: SHA-256 of samples and the last state without the seed, and events */
} soter_flight;

#define SOTER_BATCH_MODULES 64U /* of a program whose saves are counted, at most */

/* What a batch is about, and where it writes. Of flight number k: `states` + k * state_size is its
 * last state (3 more states are places to work in); `looks` + k * count of
 * measures; `histogram` + k * all bins, two more than its own of each measure; `saves` and
 * `precautions` + k * modules, all of them zero at first. */
typedef struct {
  int64_t until_ns;
  int64_t horizon_ns; /* how far AC is flown on where it was taken off; 0: saves are not counted */
  int64_t episode_ns; /* disengagements no further apart are one episode: its first is judged */
  const soter_measured* measured;
  void* states;
  soter_event* events;
  size_t room;
  soter_look* looks;
  uint32_t* histogram;
  uint32_t* saves;
  uint32_t* precautions;
} soter_order;

/* Runs each flight from its start up to and including `until_ns`. Gives how many flights were
 * flown: fewer than `count` where the next one has more events than there is `room` left, or needs
 * an extern. `used`: how many events were written. */
uint32_t soter_batch(const soter_program* p, soter_flight* flights, uint32_t count,
                     const soter_order* order, size_t* used);

#ifdef __cplusplus
}
#endif

#endif
