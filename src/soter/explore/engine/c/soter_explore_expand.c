/* soter_explore_expand.c: the configurations that come after a configuration.
 *
 * Purpose: all moves that the reduction asks for, made one by one on unpacked configurations.
 * Non-goals: remembering steps (soter_explore_transition_cache.c), order of the search
 * (strategies).
 */
#include "soter_explore_successors.h"

#define LONG 4096U /* answers of a step: a violation need not wait for the rest */

/* One configuration may have very many successors: the answers of a step, the values of an input.
 */
static void spill_successors(soter_expander* expander) {
  if (expander->successors.count >= expander->most && expander->spill != NULL) {
    expander->enough = expander->enough || !expander->spill(expander->to);
    expander->begin = expander->successors.count;
  }
}

static bool wants_more(const soter_expander* expander) {
  const bool broke = expander->broke && !expander->go_on && expander->space.tried >= LONG;
  return !expander->no_memory && !expander->enough && !broke;
}

static void make_move_once(soter_expander* expander, const soter_move* move, uint64_t sleep) {
  soter_workspace* const space = &expander->space;
  soter_broken broken;
  expander->transitions++;
  if (!soter_make_move(space, move, &broken)) {
    if (!expander->broke && !soter_is_known(space, &broken)) {
      expander->broken = broken;
      expander->broke = true;
    }
    return;
  }
  soter_note_coverage(space, move->actor);
  const bool ends = expander->instant != NULL && soter_is_observable(space);
  uint64_t* const successor = soter_next_successor(expander, ends ? SOTER_AT_END : sleep);
  if (successor != NULL) {
    space->m->pack(space->there, successor);
  }
  spill_successors(expander);
}

/* All answers of a move, or as many as are wanted. */
static void make_all_answers(soter_expander* expander, const soter_move* move, uint64_t sleep) {
  expander->space.given = 0U;
  do {
    make_move_once(expander, move, sleep);
  } while (wants_more(expander) && soter_next_picks(&expander->space));
  soter_tell_answers(&expander->space, true);
}

void soter_expand(soter_expander* expander, const uint64_t* packed, uint64_t sleep, uint64_t only) {
  soter_workspace* const space = &expander->space;
  expander->begin = expander->successors.count;
  SOTER_CHECK(expander->words == space->m->words);
  expander->broke = false;
  expander->enough = false;
  if (expander->cache != NULL && soter_cache_expand(expander, packed, sleep, only)) {
    return;
  }
  space->m->unpack(packed, space->here);
  soter_find_windows(space);
  uint64_t set = soter_enabled_actors(space);
  if ((expander->reduce & SOTER_REDUCE_AMPLE) != 0U) {
    set = soter_ample_set(space, set);
  }
  set = soter_in_order(space->m, set & only);
  uint64_t before = 0U;
  for (uint32_t a = 0; a < space->m->actors; a++) {
    const uint64_t bit = UINT64_C(1) << a;
    if ((set & ~sleep & bit) == 0U) {
      continue;
    }
    const uint64_t asleep = (expander->reduce & SOTER_REDUCE_SLEEP) != 0U
                                ? soter_still_asleep(space->m, a, sleep, before)
                                : 0U;
    soter_move move;
    for (uint32_t n = 0; !space->cut && wants_more(expander) && soter_move_of(space, a, n, &move);
         n++) {
      make_all_answers(expander, &move, asleep);
      space->cut = space->cut || soter_is_stopped(space);
    }
    before |= bit;
  }
}

bool soter_is_broken(soter_expander* expander, const uint64_t* packed, soter_broken* broken) {
  soter_workspace* const space = &expander->space;
  if (space->p->properties == 0U && space->m->timeds == 0U) {
    return false;
  }
  if (expander->cache != NULL) {
    return soter_cache_finds_violation(expander, packed, broken);
  }
  space->m->unpack(packed, space->there);
  return soter_finds_violation(space, broken);
}

void soter_expand_start(soter_expander* expander) {
  soter_workspace* const space = &expander->space;
  expander->successors.count = 0U;
  expander->broke = false;
  expander->enough = false;
  space->given = 0U;
  do {
    soter_make_start(space);
    uint64_t* const successor = soter_next_successor(expander, 0U);
    if (successor != NULL) {
      space->m->pack(space->there, successor);
    }
    spill_successors(expander);
  } while (wants_more(expander) && soter_next_picks(space));
  soter_tell_answers(space, true);
}
