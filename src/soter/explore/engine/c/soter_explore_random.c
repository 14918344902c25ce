/* soter_explore_random.c: every decision by chance. */
#include "soter_explore_sampled_walk.h"

static uint32_t decide(soter_walk* w, uint32_t kind, uint32_t count) {
  const uint32_t chosen = soter_walk_random(w, count);
  (void)kind;
  SOTER_CHECK(count >= 1U && chosen < count);
  return chosen;
}

static void begin(soter_walk* w, uint64_t run) {
  w->random = soter_mix(w->s->o->seed ^ soter_mix(run + 1U));
}

void soter_search_random(soter_search* s) {
  soter_walk w;
  if (soter_walk_open(&w, s)) {
    w.decide = decide;
    soter_walk_all(&w, begin, NULL);
  } else {
    s->result->status = SOTER_NO_MEMORY;
  }
  soter_walk_close(&w);
}
