/* soter_explore_open_expander.c: what expands configurations, opened and closed.
 *
 * Purpose: give an expander its workspace and the caches that the model and the options allow.
 * Non-goals: expanding (soter_explore_expand.c, soter_explore_instant.c).
 */
#include "soter_explore_internal.h"

#define MOST_BYTES (UINT32_C(1) << 23) /* of successors, before they are taken away, */
#define FEWEST 64U                     /* but so many */
#define LITTLE 4096U /* bytes remembered for a successor of many configurations at once */

/* What is remembered within an instant; false: there is no memory. */
static bool open_instants(soter_expander* expander, const soter_model* m,
                          const soter_explore_options* o) {
  if (!soter_by_instants(m, o)) {
    return true;
  }
  expander->instant = soter_instant_open(m, expander->memory);
  expander->groups = soter_in_groups(m, o) ? soter_groups_open(m, expander->memory) : NULL;
  return expander->instant != NULL;
}

static void open_cache(soter_expander* expander, const soter_model* m,
                       const soter_explore_options* o) {
  expander->cache = m->brief && !o->plainly ? soter_cache_open(expander, expander->memory) : NULL;
  if (expander->cache != NULL && soter_cache_bytes(expander->cache) > expander->memory) {
    soter_cache_close(expander->cache); /* it would be given up at once */
    expander->cache = NULL;
  }
}

bool soter_expander_open(soter_expander* expander, const soter_search* s,
                         soter_explore_coverage* coverage, uint64_t memory) {
  const soter_model* const m = s->m;
  const soter_explore_options* const o = s->o;
  (void)memset(expander, 0, sizeof *expander);
  expander->reduce = soter_sound_reductions(m, o);
  expander->words = m->words;
  expander->memory = memory;
  expander->max_ran = o->max_ran;
  expander->go_on = o->go_on;
  expander->most = MOST_BYTES / (m->words > 0U ? m->words * (uint32_t)sizeof(uint64_t) : 1U);
  expander->most = expander->most < FEWEST ? FEWEST : expander->most;
  expander->batch_successors =
      memory / LITTLE < SOTER_BATCH_SUCCESSORS ? memory / LITTLE : SOTER_BATCH_SUCCESSORS;
  SOTER_CHECK(m->words <= SOTER_WORDS);
  if (!soter_workspace_open(&expander->space, m, o, s->progress, coverage) ||
      !open_instants(expander, m, o)) {
    return false;
  }
  expander->space.any_order = true; /* of those that it is told to move, the first moves */
  open_cache(expander, m, o);
  return true;
}

void soter_expander_close(soter_expander* expander) {
  soter_cache_close(expander->cache);
  soter_instant_close(expander->instant);
  soter_groups_close(expander->groups);
  soter_workspace_close(&expander->space);
  soter_free(expander->successors.packed, (uint64_t)expander->successors.room * expander->words *
                                              sizeof *expander->successors.packed);
  free(expander->successors.sleep);
}

uint64_t soter_expander_bytes(const soter_expander* expander) {
  const uint64_t each =
      expander->words * sizeof *expander->successors.packed + sizeof *expander->successors.sleep;
  return expander->successors.room * each +
         (expander->cache != NULL ? soter_cache_bytes(expander->cache) : 0U) +
         soter_instant_bytes(expander->instant) + soter_groups_bytes(expander->groups);
}
