/* soter_explore_sampled_walk.h: one execution after the other, by somebody's choices (random, PCT,
 * coverage, falsify). */
#ifndef SOTER_EXPLORE_WALK_H
#define SOTER_EXPLORE_WALK_H

#include "soter_explore_internal.h"

/* A walk: decisions are numbers below a limit, asked of `decide`. */
typedef struct soter_walk {
  soter_search* s;
  soter_place x;
  soter_store seen; /* fingerprints of the configurations met: how many there were */
  bool counting;    /* there was room for all of them */
  uint32_t steps;   /* of the walk so far */
  uint32_t longest;
  uint64_t transitions, states;
  uint64_t random; /* state of the generator */
  void* own;       /* of the strategy */
  /* Which of `count` alternatives. `kind`: who moves (0), when (1), a choice of the step (2). */
  uint32_t (*decide)(struct soter_walk* w, uint32_t kind, uint32_t count);
  /* Which actor of a set moves next; NULL: decide. */
  uint32_t (*who)(struct soter_walk* w, uint64_t enabled);
  /* Told of every configuration, in x.there, with the one before in x.here; NULL: nobody asks. */
  void (*observe)(struct soter_walk* w);
} soter_walk;

SOTER_INLINE uint32_t soter_walk_random(soter_walk* w, uint32_t count) {
  w->random += UINT64_C(0x9e3779b97f4a7c15);
  return count <= 1U ? 0U : (uint32_t)(soter_mix(w->random) % count);
}

bool soter_walk_open(soter_walk* w, soter_search* s);
void soter_walk_close(soter_walk* w);

/* One execution to the horizon, or to a violation: `true`, and the trace is written. */
bool soter_walk_once(soter_walk* w);

/* Executions until a violation, a bound or a person stops them; `begin` is told before each. */
void soter_walk_all(soter_walk* w, void (*begin)(soter_walk* w, uint64_t run),
                    void (*end)(soter_walk* w, uint64_t run));

#endif
