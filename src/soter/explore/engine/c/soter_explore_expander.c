/* soter_explore_expander.c: what expands configurations, opened and closed.
 *
 * Purpose: which reductions are sound, and what may be remembered.
 * Non-goals: expanding (soter_explore_expand.c, soter_explore_instant.c).
 */
#include "soter_explore_internal.h"

#define MOST_BYTES (UINT32_C(1) << 23) /* of successors, before they are taken away, */
#define FEWEST 64U                     /* but so many */
#define LITTLE 4096U /* bytes remembered for a successor of many configurations at once */

/* The reductions that are sound for a model, of those asked for. */
static uint32_t reductions(const soter_model* m, const soter_explore_options* o) {
  uint32_t sound = o->reduce;
  if (m->ordered) {
    return sound & ~(SOTER_REDUCE_SLEEP | SOTER_REDUCE_AMPLE); /* one move at a time anyway */
  }
  if (m->timely) {
    sound &= ~SOTER_REDUCE_SLEEP; /* moving first changes at which times others may move */
  }
  for (uint32_t i = 0; i < m->timeds; i++) {
    if (m->timely && m->timed[i].kind != SOTER_INVARIANT) {
      sound &= ~SOTER_REDUCE_AMPLE; /* it may add observations, and these keep promises */
    }
  }
  return sound;
}

/* What is remembered within an instant; false: there is no memory. */
static bool open_instants(soter_expander* e, const soter_model* m, const soter_explore_options* o) {
  if (!soter_by_instants(m, o)) {
    return true;
  }
  e->instant = soter_instant_open(m, e->memory);
  e->groups = soter_in_groups(m, o) ? soter_groups_open(m, e->memory) : NULL;
  return e->instant != NULL;
}

static void open_memo(soter_expander* e, const soter_model* m, const soter_explore_options* o) {
  e->memo = m->brief && !o->plainly ? soter_memo_open(e, e->memory) : NULL;
  if (e->memo != NULL && soter_memo_bytes(e->memo) > e->memory) {
    soter_memo_close(e->memo); /* it would be given up at once */
    e->memo = NULL;
  }
}

bool soter_expander_open(soter_expander* e, const soter_search* s, soter_explore_coverage* coverage,
                         uint64_t memory) {
  const soter_model* const m = s->m;
  const soter_explore_options* const o = s->o;
  (void)memset(e, 0, sizeof *e);
  e->reduce = reductions(m, o);
  e->words = m->words;
  e->memory = memory;
  e->max_ran = o->max_ran;
  e->go_on = o->go_on;
  e->most = MOST_BYTES / (m->words > 0U ? m->words * (uint32_t)sizeof(uint64_t) : 1U);
  e->most = e->most < FEWEST ? FEWEST : e->most;
  e->batch_successors =
      memory / LITTLE < SOTER_BATCH_SUCCESSORS ? memory / LITTLE : SOTER_BATCH_SUCCESSORS;
  SOTER_CHECK(m->words <= SOTER_WORDS);
  if (!soter_place_open(&e->place, m, o, s->progress, coverage) || !open_instants(e, m, o)) {
    return false;
  }
  e->place.any_order = true; /* of those that it is told to move, the first moves */
  open_memo(e, m, o);
  return true;
}

void soter_expander_close(soter_expander* e) {
  soter_memo_close(e->memo);
  soter_instant_close(e->instant);
  soter_groups_close(e->groups);
  soter_place_close(&e->place);
  soter_give(e->successors.packed,
             (uint64_t)e->successors.room * e->words * sizeof *e->successors.packed);
  free(e->successors.sleep);
}

uint64_t soter_expander_bytes(const soter_expander* e) {
  const uint64_t each = e->words * sizeof *e->successors.packed + sizeof *e->successors.sleep;
  return e->successors.room * each + (e->memo != NULL ? soter_memo_bytes(e->memo) : 0U) +
         soter_instant_bytes(e->instant) + soter_groups_bytes(e->groups);
}
