/* soter_explore_sampled_walk.c: executions one by one.
 *
 * Purpose: what random search and falsification have in common: from the start to the horizon,
 * every decision asked of the strategy; configurations met are counted by fingerprint. Non-goals:
 * completeness; a walk never proves anything.
 */
#include "soter_explore_sampled_walk.h"

#define SHARE 2U /* of the memory: for counting configurations */

static bool walk_open(soter_walk* w, soter_search* s) {
  w->s = s;
  w->random = soter_mix(s->o->seed + UINT64_C(0x5851f42d4c957f2d));
  w->counting = true;
  const bool ok =
      soter_workspace_open(&w->space, s->m, s->o, s->progress, s->coverage) &&
      soter_store_open(&w->seen, s->m, SOTER_FINGERPRINT, false, 0U, s->o->memory / SHARE);
  s->result->needed_bytes = soter_store_bytes(&w->seen) * SHARE;
  return ok;
}

static uint32_t decide(soter_walk* w, uint32_t kind, uint32_t count) {
  const uint32_t chosen =
      w->by->decide != NULL ? w->by->decide(w, kind, count) : soter_walk_random(w, count);
  SOTER_CHECK(count == 0U || chosen < count);
  return chosen;
}

/* Runs `make` until every choice that it asks for has been decided. */
static bool decided(soter_walk* w, const soter_move* move, soter_broken* broken, bool* ok) {
  soter_workspace* const space = &w->space;
  space->given = 0U;
  for (;;) {
    *ok = true;
    if (move->kind == SOTER_BIRTH) {
      soter_make_start(space);
    } else {
      *ok = soter_make_move(space, move, broken);
    }
    if (space->taken <= space->given) {
      return true;
    }
    soter_choice* const next = &space->choice[space->given];
    next->pick = decide(w, 2U, next->count);
    SOTER_CHECK(next->pick < next->count);
    space->given++;
  }
}

static void write_step(soter_walk* w, const soter_move* move) {
  if (w->s->trace != NULL && w->steps < w->s->room) {
    soter_write_step(&w->space, move, &w->s->trace[w->steps]);
  }
  w->steps++;
}

static void meet(soter_walk* w) {
  uint64_t packed[SOTER_WORDS];
  uint64_t sleep = 0U;
  uint64_t again = 0U;
  if (!w->counting) {
    return;
  }
  w->space.m->pack(w->space.there, packed);
  const int fresh = soter_store_put(&w->seen, packed, &sleep, &again);
  w->counting = fresh >= 0;
  w->states += fresh > 0 ? 1U : 0U;
}

static uint32_t one_of(soter_walk* w, uint64_t enabled) {
  uint32_t k = decide(w, 0U, (uint32_t)__builtin_popcountll(enabled));
  for (uint32_t i = 0; i < SOTER_ACTORS; i++) {
    if ((enabled >> i & 1U) != 0U && k-- == 0U) {
      return i;
    }
  }
  SOTER_CHECK(enabled == 0U); /* decisions are below what they are of */
  return 0U;
}

static bool next_move(soter_walk* w, soter_move* move) {
  soter_workspace* const space = &w->space;
  const uint64_t enabled = soter_enabled_actors(space);
  if (enabled == 0U) {
    return false;
  }

  const uint32_t actor = w->by->who != NULL ? w->by->who(w, enabled) : one_of(w, enabled);
  uint32_t times = 0U;
  soter_move unused;
  while (times < 64U && soter_move_of(space, actor, times, &unused)) {
    times++;
  }
  return soter_move_of(space, actor, decide(w, 1U, times), move);
}

/* One execution to the horizon, or to a violation: `true`, and the trace is written. */
static bool walk_once(soter_walk* w) {
  static const soter_move birth = {SOTER_NOTHING, SOTER_BIRTH, -1, -1};
  soter_workspace* const space = &w->space;
  soter_broken* const broken = &w->s->result->broken;
  soter_move move = birth;
  w->steps = 0U;
  do {
    bool ok;
    (void)decided(w, &move, broken, &ok);
    write_step(w, &move);
    w->transitions += move.kind != SOTER_BIRTH ? 1U : 0U;
    if (!ok) {
      return !soter_is_known(space, broken);
    }
    if (move.kind != SOTER_BIRTH) {
      soter_note_coverage(space, move.actor);
    }
    meet(w);
    if (soter_finds_violation(space, broken)) {
      return !soter_is_known(space, broken);
    }
    (void)memcpy(space->here, space->there, space->size);
    soter_find_windows(space);
    if (w->steps > w->longest) {
      w->longest = w->steps;
    }
  } while (w->s->progress->stop == 0 && next_move(w, &move));
  return false;
}

static void walk_all(soter_walk* w) {
  soter_search* const s = w->s;
  soter_explore_result* const r = s->result;
  r->status = SOTER_RUNS;
  for (uint64_t run = 0; run < s->o->runs; run++) {
    w->by->begin(w, run);
    const bool broke = walk_once(w);
    r->runs = run + 1U;
    s->progress->states = w->states;
    s->progress->transitions = w->transitions;
    s->progress->depth = w->longest;
    s->progress->bytes = soter_store_bytes(&w->seen);
    if (broke) {
      r->status = SOTER_VIOLATED;
      r->length = w->steps <= s->room ? w->steps : 0U;
      break;
    }
    if (s->progress->stop != 0) {
      r->status = SOTER_STOPPED;
      break;
    }
    if (s->o->max_states > 0U && w->states >= s->o->max_states) {
      r->status = SOTER_STATES;
      break;
    }
  }
  r->states = w->states;
  r->transitions = w->transitions;
  r->depth = w->longest;
  r->table_bytes = soter_store_bytes(&w->seen);
}

void soter_walk_all(soter_search* s, const soter_sampling* by, void* own, bool ok) {
  soter_walk w;
  (void)memset(&w, 0, sizeof w);
  w.by = by;
  w.own = own;
  if (ok && walk_open(&w, s)) {
    walk_all(&w);
  } else {
    s->result->status = SOTER_NO_MEMORY;
  }
  soter_store_close(&w.seen);
  soter_workspace_close(&w.space);
}
