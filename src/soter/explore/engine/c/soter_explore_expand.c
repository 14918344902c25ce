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
static void spill(soter_expander* e) {
  if (e->successors.count >= e->most && e->spill != NULL) {
    e->enough = e->enough || !e->spill(e->to);
    e->begin = e->successors.count;
  }
}

static bool wants_more(const soter_expander* e) {
  const bool broke = e->broke && !e->go_on && e->place.tried >= LONG;
  return !e->no_memory && !e->enough && !broke;
}

static void make_one(soter_expander* e, const soter_move* move, uint64_t sleep) {
  soter_place* const x = &e->place;
  soter_broken broken;
  e->transitions++;
  if (!soter_make(x, move, &broken)) {
    if (!e->broke && !soter_is_known(x, &broken)) {
      e->broken = broken;
      e->broke = true;
    }
    return;
  }
  soter_cover(x, move->actor);
  const bool ends = e->instant != NULL && soter_is_observable(x);
  uint64_t* const successor = soter_next_successor(e, ends ? SOTER_AT_END : sleep);
  if (successor != NULL) {
    x->m->pack(x->there, successor);
  }
  spill(e);
}

/* All answers of a move, or as many as are wanted. */
static void make_all(soter_expander* e, const soter_move* move, uint64_t sleep) {
  e->place.given = 0U;
  do {
    make_one(e, move, sleep);
  } while (wants_more(e) && soter_next_picks(&e->place));
  soter_tell_answers(&e->place, true);
}

void soter_expand(soter_expander* e, const uint64_t* packed, uint64_t sleep, uint64_t only) {
  soter_place* const x = &e->place;
  e->begin = e->successors.count;
  SOTER_CHECK(e->words == x->m->words);
  e->broke = false;
  e->enough = false;
  if (e->memo != NULL && soter_memo_expand(e, packed, sleep, only)) {
    return;
  }
  x->m->unpack(packed, x->here);
  soter_look(x);
  uint64_t set = soter_enabled(x);
  if ((e->reduce & SOTER_REDUCE_AMPLE) != 0U) {
    set = soter_ample(x, set);
  }
  set = soter_in_order(x->m, set & only);
  uint64_t before = 0U;
  for (uint32_t a = 0; a < x->m->actors; a++) {
    const uint64_t bit = UINT64_C(1) << a;
    if ((set & ~sleep & bit) == 0U) {
      continue;
    }
    const uint64_t asleep =
        (e->reduce & SOTER_REDUCE_SLEEP) != 0U ? soter_still_asleep(x->m, a, sleep, before) : 0U;
    soter_move move;
    for (uint32_t n = 0; !x->cut && wants_more(e) && soter_move_of(x, a, n, &move); n++) {
      make_all(e, &move, asleep);
      x->cut = x->cut || soter_is_stopped(x);
    }
    before |= bit;
  }
}

bool soter_is_broken(soter_expander* e, const uint64_t* packed, soter_broken* broken) {
  soter_place* const x = &e->place;
  if (x->p->properties == 0U && x->m->timeds == 0U) {
    return false;
  }
  if (e->memo != NULL) {
    return soter_memo_broken(e, packed, broken);
  }
  x->m->unpack(packed, x->there);
  return soter_violates(x, broken);
}

void soter_expand_birth(soter_expander* e) {
  soter_place* const x = &e->place;
  e->successors.count = 0U;
  e->broke = false;
  e->enough = false;
  x->given = 0U;
  do {
    soter_be_born(x);
    uint64_t* const successor = soter_next_successor(e, 0U);
    if (successor != NULL) {
      x->m->pack(x->there, successor);
    }
    spill(e);
  } while (wants_more(e) && soter_next_picks(x));
  soter_tell_answers(x, true);
}
