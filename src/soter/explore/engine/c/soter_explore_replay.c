/* soter_explore_replay.c: the execution that a trace says, of the whole system or of a part of it.
 */
#include "soter_explore_internal.h"

/* ------------------------------------------------------------------ one step */

static bool same_move(const soter_move* a, const soter_trace_step* b) {
  return a->kind == (soter_move_kind)b->kind && a->time == b->time_ns &&
         a->release == b->release_ns;
}

static bool find(soter_place* x, const soter_trace_step* step, soter_move* move) {
  if (step->actor >= x->m->actors) {
    return false;
  }
  for (uint32_t n = 0; soter_move_of(x, step->actor, n, move); n++) {
    if (same_move(move, step)) {
      return true;
    }
  }
  return false;
}

static void give(soter_place* x, const soter_trace_step* step) {
  x->given = step->choices < SOTER_CHOICES ? step->choices : SOTER_CHOICES;
  SOTER_CHECK(x->given <= SOTER_CHOICES);
  (void)memcpy(x->choice, step->choice, x->given * sizeof step->choice[0]);
}

static bool in_range(const soter_place* x, const soter_trace_step* step) {
  for (uint32_t i = 0; i < step->choices && i < x->taken; i++) {
    if (step->choice[i].pick >= x->choice[i].count) {
      return false;
    }
  }
  return step->choices == x->taken;
}

/* ------------------------------------------------------------------ replaying */

uint32_t soter_explore_replay(const soter_model* m, uint64_t seed, const soter_trace_step* trace,
                              uint32_t length, void* configurations, bool* violates,
                              soter_broken* broken) {
  soter_place x;
  soter_explore_options o;
  uint32_t done = 0U;
  (void)memset(&o, 0, sizeof o);
  o.seed = seed;
  *violates = false;
  if (!soter_place_open(&x, m, &o, NULL, NULL)) {
    return 0U;
  }
  while (done < length && !*violates) {
    const soter_trace_step* const step = &trace[done];
    give(&x, step);
    bool fine = true;
    if (step->kind == (uint32_t)SOTER_BIRTH) {
      if (done > 0U) {
        break;
      }
      soter_be_born(&x);
    } else {
      soter_move move;
      soter_look(&x);
      if (!find(&x, step, &move)) {
        break;
      }
      fine = soter_make(&x, &move, broken);
    }
    if (!in_range(&x, step)) {
      break;
    }
    *violates = !fine || soter_violates(&x, broken);
    if (configurations != NULL) {
      (void)memcpy((uint8_t*)configurations + (size_t)done * x.size, x.there, x.size);
    }
    (void)memcpy(x.here, x.there, x.size);
    done++;
  }
  soter_place_close(&x);
  return done;
}

/* ------------------------------------------------------------------ completing */

typedef struct {
  soter_place x;
  soter_trace_step* whole;
  uint32_t written, room;
  bool broke;
  soter_broken* broken;
} completion;

/* Makes a move of the whole system and writes it down. */
static bool add(completion* c, const soter_move* move) {
  soter_place* const x = &c->x;
  if (c->written >= c->room) {
    return false;
  }
  bool fine = true;
  if (move->kind == SOTER_BIRTH) {
    soter_be_born(x);
  } else {
    fine = soter_make(x, move, c->broken);
  }
  soter_write_step(x, move, &c->whole[c->written++]);
  SOTER_CHECK(c->written <= c->room);
  c->broke = !fine || soter_violates(x, c->broken);
  (void)memcpy(x->here, x->there, x->size);
  soter_look(x);
  return true;
}

/* Moves somebody who is not of the part, not later than `time`: whoever has to be done first. */
static bool add_other(completion* c, uint64_t part, int64_t time) {
  soter_place* const x = &c->x;
  uint32_t best = SOTER_ACTORS;
  for (uint32_t i = 0; i < x->m->actors; i++) {
    if ((part >> i & 1U) == 0U && soter_may_move(x, i) && x->window[i].low <= time &&
        (best == SOTER_ACTORS || x->window[i].high < x->window[best].high)) {
      best = i;
    }
  }
  soter_move move;
  if (best == SOTER_ACTORS || !soter_move_of(x, best, 0U, &move)) {
    return false;
  }
  x->given = 0U;
  return add(c, &move);
}

static bool add_own(completion* c, uint64_t part, const soter_trace_step* step) {
  static const soter_move birth = {SOTER_NOTHING, SOTER_BIRTH, -1, -1};
  soter_move move = birth;
  while (!c->broke && step->kind != (uint32_t)SOTER_BIRTH && !find(&c->x, step, &move)) {
    if (!add_other(c, part, step->time_ns)) {
      return false;
    }
  }
  if (c->broke) {
    return true;
  }
  give(&c->x, step);
  return add(c, &move);
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
  bool fine = soter_place_open(&c.x, m, &all, NULL, NULL);
  for (uint32_t i = 0; fine && !c.broke && i < length; i++) {
    fine = add_own(&c, o->actors, &part[i]);
  }
  while (fine && !c.broke) { /* what the others have to do before anything can be seen */
    fine = add_other(&c, o->actors, soter_schedule_of(c.x.p, c.x.here)->now);
  }
  soter_place_close(&c.x);
  return fine ? c.written : 0U;
}
