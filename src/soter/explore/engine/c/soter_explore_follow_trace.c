/* soter_explore_follow_trace.c: the execution of the whole system that a trace of a part says.
 *
 * Purpose: complete a trace of a part by moves of the others. That it can be completed is argued in
 * docs/testing.md, "Parts".
 * Non-goals: traces that were changed (soter_explore_guided_execution.c).
 */
#include "soter_explore_internal.h"

static bool same_move(const soter_move* a, const soter_trace_step* b) {
  return a->kind == (soter_move_kind)b->kind && a->time == b->time_ns &&
         a->release == b->release_ns;
}

static bool find_step(soter_workspace* space, const soter_trace_step* step, soter_move* move) {
  if (step->actor >= space->m->actors) {
    return false;
  }
  for (uint32_t n = 0; soter_move_of(space, step->actor, n, move); n++) {
    if (same_move(move, step)) {
      return true;
    }
  }
  return false;
}

static void give_choices(soter_workspace* space, const soter_trace_step* step) {
  space->given = step->choices < SOTER_CHOICES ? step->choices : SOTER_CHOICES;
  SOTER_CHECK(space->given <= SOTER_CHOICES);
  (void)memcpy(space->choice, step->choice, space->given * sizeof step->choice[0]);
}

typedef struct {
  soter_workspace space;
  soter_trace_step* whole;
  uint32_t written, room;
  bool broke;
  soter_broken* broken;
} completion;

/* Makes a move of the whole system and writes it down. */
static bool add_move(completion* c, const soter_move* move) {
  soter_workspace* const space = &c->space;
  if (c->written >= c->room) {
    return false;
  }
  bool ok = true;
  if (move->kind == SOTER_BIRTH) {
    soter_make_start(space);
  } else {
    ok = soter_make_move(space, move, c->broken);
  }
  soter_write_step(space, move, &c->whole[c->written++]);
  SOTER_CHECK(c->written <= c->room);
  c->broke = !ok || soter_finds_violation(space, c->broken);
  (void)memcpy(space->here, space->there, space->size);
  soter_find_windows(space);
  return true;
}

/* Moves somebody who is not of the part, not later than `time`: whoever has to be done first. */
static bool add_other(completion* c, uint64_t part, int64_t time) {
  soter_workspace* const space = &c->space;
  uint32_t best = SOTER_ACTORS;
  for (uint32_t i = 0; i < space->m->actors; i++) {
    if ((part >> i & 1U) == 0U && soter_may_move(space, i) && space->window[i].low <= time &&
        (best == SOTER_ACTORS || space->window[i].high < space->window[best].high)) {
      best = i;
    }
  }
  soter_move move;
  if (best == SOTER_ACTORS || !soter_move_of(space, best, 0U, &move)) {
    return false;
  }
  space->given = 0U;
  return add_move(c, &move);
}

static bool add_own(completion* c, uint64_t part, const soter_trace_step* step) {
  static const soter_move birth = {SOTER_NOTHING, SOTER_BIRTH, -1, -1};
  soter_move move = birth;
  while (!c->broke && step->kind != (uint32_t)SOTER_BIRTH && !find_step(&c->space, step, &move)) {
    if (!add_other(c, part, step->time_ns)) {
      return false;
    }
  }
  if (c->broke) {
    return true;
  }
  give_choices(&c->space, step);
  return add_move(c, &move);
}

uint32_t soter_explore_complete(const soter_model* m, const soter_explore_options* o,
                                const soter_trace_step* part, uint32_t length,
                                soter_trace_step* whole, uint32_t room, soter_broken* broken) {
  completion c;
  soter_explore_options all = *o;
  (void)memset(&c, 0, sizeof c);
  all.actors = 0U;
  c.whole = whole;
  c.room = room;
  c.broken = broken;
  bool ok = soter_workspace_open(&c.space, m, &all, NULL, NULL);
  for (uint32_t i = 0; ok && !c.broke && i < length; i++) {
    ok = add_own(&c, o->actors, &part[i]);
  }
  while (ok && !c.broke) { /* what the others have to do before anything can be seen */
    ok = add_other(&c, o->actors, soter_schedule_of(c.space.p, c.space.here)->now);
  }
  soter_workspace_close(&c.space);
  return ok ? c.written : 0U;
}
