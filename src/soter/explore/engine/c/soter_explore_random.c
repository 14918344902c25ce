/* soter_explore_random.c: every decision by chance.
 *
 * Purpose: begin each walk with a state of the generator of its own, so that a seed says them all.
 * Non-goals: the walks themselves (soter_explore_sampled_walk.c).
 */
#include "soter_explore_sampled_walk.h"

static void begin(soter_walk* w, uint64_t run) {
  w->random = soter_mix(w->s->o->seed ^ soter_mix(run + 1U));
}

void soter_search_random(soter_search* s) {
  const soter_sampling by_chance = {.begin = begin};
  soter_walk_all(s, &by_chance, NULL, true);
}
