/* soter_batch.h: many runs in one call, and what happened in each.
 *
 * Purpose: campaigns: runs of one program under many seeds, in the meaning of soter_run, with the
 * events that statistics are made of and a digest of each run.
 * Non-goals: programs with extern steps; what the statistics are.
 */
#ifndef SOTER_BATCH_H
#define SOTER_BATCH_H

#include "soter.h"

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

typedef struct {
  uint64_t seed;   /* in */
  uint32_t events; /* out: how many of the events are its own */
  char digest[65]; /* out: SHA-256 of its events and its last state */
} soter_flight;

/* Runs each flight from its start up to and including `until_ns`. `states` has room for one state
 * more than there are flights; their last states are left there. Gives how many flights were
 * flown: fewer than `count` where the next one has more events than there is `room` left, or needs
 * an extern. `used`: how many events were written. */
uint32_t soter_batch(const soter_program* p, soter_flight* flights, uint32_t count,
                     int64_t until_ns, void* states, soter_event* events, size_t room,
                     size_t* used);

#ifdef __cplusplus
}
#endif

#endif
