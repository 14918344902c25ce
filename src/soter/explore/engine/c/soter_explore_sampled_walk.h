/* soter_explore_sampled_walk.h: walks, one execution after the other (not for drivers).
 *
 * Purpose: declare a walk, and which decisions a strategy (random, falsify) takes in it.
 * Non-goals: making the moves (soter_explore_sampled_walk.c).
 */
#ifndef SOTER_EXPLORE_SAMPLED_WALK_H
#define SOTER_EXPLORE_SAMPLED_WALK_H

#include "soter_explore_internal.h"

/* A walk: decisions are numbers below a limit, asked of `decide`. */
typedef struct soter_walk {
  soter_search* s;
  soter_workspace space;
  soter_store seen; /* fingerprints of the configurations met: how many there were */
  bool counting;    /* there was room for all of them */
  uint32_t steps;   /* of the walk so far */
  uint32_t longest;
  uint64_t transitions, states;
  uint64_t random; /* state of the generator */
  const struct soter_sampling* by;
  void* own; /* of the strategy */
} soter_walk;

/* What a strategy decides; every function but `begin` may be NULL. */
typedef struct soter_sampling {
  /* Which of `count` alternatives. `kind`: who moves (0), when (1), a choice of the step (2); NULL:
   * by chance. */
  uint32_t (*decide)(soter_walk* w, uint32_t kind, uint32_t count);
  /* Which actor of a set moves next; NULL: decide. */
  uint32_t (*who)(soter_walk* w, uint64_t enabled);
  void (*begin)(soter_walk* w, uint64_t run); /* before each execution */
} soter_sampling;

SOTER_INLINE uint32_t soter_walk_random(soter_walk* w, uint32_t count) {
  w->random += UINT64_C(0x9e3779b97f4a7c15);
  return count <= 1U ? 0U : (uint32_t)(soter_mix(w->random) % count);
}

/* Executions until a violation, a bound or a person stops them; not `fine`: the strategy had no
 * memory for its own. */
void soter_walk_all(soter_search* s, const soter_sampling* by, void* own, bool ok);

#endif
