/* soter_explore_pct.c: probabilistic concurrency testing (Burckhardt et al., ASPLOS 2010).
 *
 * Purpose: every actor has a random priority and the highest one that may move does; at d - 1
 * random places of the execution the priority of who would move falls below all others. A violation
 * that needs d orderings is met with probability at least 1 / (n k^(d-1)) by one execution. Choices
 * and times are made by chance.
 */
#include "soter_explore_sampled_walk.h"

#define MOST_CHANGES 64U

typedef struct {
  int64_t priority[SOTER_ACTORS];
  uint32_t change[MOST_CHANGES];
  uint32_t changes;
  int64_t lowest;
} pct;

static uint32_t highest(const pct* p, uint64_t enabled) {
  uint32_t best = SOTER_ACTORS;
  for (uint32_t i = 0; i < SOTER_ACTORS; i++) {
    if ((enabled >> i & 1U) != 0U && (best == SOTER_ACTORS || p->priority[i] > p->priority[best])) {
      best = i;
    }
  }
  SOTER_CHECK(best < SOTER_ACTORS); /* somebody may move */
  return best;
}

static uint32_t who(soter_walk* w, uint64_t enabled) {
  pct* const p = w->own;
  for (uint32_t i = 0; i < p->changes; i++) {
    if (p->change[i] == w->steps) {
      p->priority[highest(p, enabled)] = --p->lowest;
    }
  }
  return highest(p, enabled);
}

static void begin(soter_walk* w, uint64_t run) {
  pct* const p = w->own;
  const uint32_t length = w->longest > 1U ? w->longest : 64U;
  w->random = soter_mix(w->s->o->seed ^ soter_mix(run + 1U));
  p->lowest = 0;
  for (uint32_t i = 0; i < SOTER_ACTORS; i++) {
    p->priority[i] = (int64_t)(soter_walk_random(w, UINT32_MAX)) + 1;
  }
  p->changes = w->s->o->bug_depth > 1U ? w->s->o->bug_depth - 1U : 0U;
  p->changes = p->changes > MOST_CHANGES ? MOST_CHANGES : p->changes;
  SOTER_CHECK(length >= 1U);
  for (uint32_t i = 0; i < p->changes; i++) {
    p->change[i] = 1U + soter_walk_random(w, length);
  }
}

void soter_search_pct(soter_search* s) {
  const soter_sampling by_priority = {.who = who, .begin = begin};
  pct own;
  (void)memset(&own, 0, sizeof own);
  soter_walk_all(s, &by_priority, &own, true);
}
