/* soter_explore_guided_execution.c: an execution that follows wishes as far as they can be
 * followed.
 *
 * Purpose: what shrinking tries: a trace that was changed (steps left out, choices and times put
 * back, another order) is made an execution again. Whatever has to come before a wished step comes
 * before it; a wish that came too late, or that nothing asks for any more, is dropped; what is not
 * wished is as the test has it by default, in the deployed order.
 * Non-goals: deciding what is smaller (shrink.py).
 */
#include "soter_explore_internal.h"

typedef struct {
  soter_workspace space;
  const soter_guide* g;
  uint32_t* after;             /* [length]: the next wish of the same actor */
  bool* used;                  /* [length] */
  uint32_t next[SOTER_ACTORS]; /* the first wish of each actor that may be left */
} guided;

static bool open(guided* d, const soter_model* m) {
  soter_explore_options o;
  (void)memset(&o, 0, sizeof o);
  o.seed = d->g->seed;
  const uint32_t length = d->g->length;
  d->after = calloc(length + 1U, sizeof *d->after);
  d->used = calloc(length + 1U, sizeof *d->used);
  if (!soter_workspace_open(&d->space, m, &o, NULL, NULL) || d->after == NULL || d->used == NULL) {
    return false;
  }
  for (uint32_t a = 0; a < SOTER_ACTORS; a++) {
    d->next[a] = SOTER_NOTHING;
  }
  for (uint32_t i = length; i > d->g->begin; i--) {
    const uint32_t a = d->g->wish[i - 1U].actor;
    if (a < m->actors) {
      d->after[i - 1U] = d->next[a];
      d->next[a] = i - 1U;
    }
  }
  return true;
}

/* Where an actor is: the release of its next step, or of the one that still runs. */
static bool runs(guided* d, uint32_t actor, int64_t* release) {
  const soter_model* const m = d->space.m;
  const soter_actor* const a = &m->actor[actor];
  const bool running =
      a->overrun_ns > 0 && ((const soter_held*)(d->space.here + a->held))->since >= 0;
  *release = a->phase_ns + (int64_t)soter_done_of(m, d->space.here)[actor] * a->period_ns;
  *release -= running ? a->period_ns : 0;
  return running;
}

typedef enum { PAST, NOW, LATER } place_of_wish;

static place_of_wish place_of(guided* d, const soter_trace_step* wish) {
  int64_t release;
  const bool running = runs(d, wish->actor, &release);
  const bool effect = wish->kind == (uint32_t)SOTER_EFFECT;
  if (wish->release_ns != release) {
    return wish->release_ns < release ? PAST : LATER;
  }
  return running == effect ? NOW : running ? PAST : LATER;
}

/* What is wished of the next step of an actor; NULL: nothing. */
static const soter_trace_step* wish_of(guided* d, uint32_t actor) {
  uint32_t i = d->next[actor];
  while (i != SOTER_NOTHING && (d->used[i] || place_of(d, &d->g->wish[i]) == PAST)) {
    d->used[i] = true;
    i = d->after[i];
  }
  d->next[actor] = i;
  if (i == SOTER_NOTHING || place_of(d, &d->g->wish[i]) != NOW) {
    return NULL;
  }
  d->used[i] = true;
  return &d->g->wish[i];
}

/* Who moves by default; `first`: whoever has to be done first, whatever was released first. */
static uint32_t by_default(const soter_workspace* space, bool first) {
  uint32_t best = SOTER_NOTHING;
  for (uint32_t i = 0; i < space->m->actors; i++) {
    if (!soter_may_move(space, i)) {
      continue;
    }
    const soter_window* const w = &space->window[i];
    const soter_window* const b = best == SOTER_NOTHING ? w : &space->window[best];
    const bool sooner = first ? w->high < b->high : w->low < b->low;
    best = best == SOTER_NOTHING || sooner ? i : best;
  }
  return best;
}

/* Who moves next: as wished from number `*at` on, which moves past what is over. */
static uint32_t who(guided* d, uint32_t* at) {
  soter_workspace* const space = &d->space;
  for (; *at < d->g->length; (*at)++) {
    const soter_trace_step* const wish = &d->g->wish[*at];
    if (d->used[*at] || wish->actor >= space->m->actors ||
        space->window[wish->actor].low == SOTER_NO_DEADLINE || place_of(d, wish) == PAST) {
      continue;
    }
    return soter_may_move(space, wish->actor) ? wish->actor : by_default(space, true);
  }
  return by_default(space, false);
}

/* The move of an actor that is nearest to what is wished. Returns its number, 0: the default. */
static uint32_t move_of(const soter_workspace* space, uint32_t actor, const soter_trace_step* wish,
                        soter_move* move) {
  uint32_t number = 0U;
  const bool possible = soter_move_of(space, actor, 0U, move);
  SOTER_CHECK(possible);
  soter_move other;
  for (uint32_t n = 1; wish != NULL && soter_move_of(space, actor, n, &other); n++) {
    if (other.kind == SOTER_SKIPPED) {
      if (wish->kind == (uint32_t)SOTER_SKIPPED) {
        *move = other;
        return n;
      }
      continue;
    }
    if (wish->kind == (uint32_t)SOTER_SKIPPED || other.time > wish->time_ns) {
      break;
    }
    *move = other;
    number = n;
  }
  return number;
}

static bool make(soter_workspace* space, const soter_move* move, soter_broken* broken) {
  if (move->kind == SOTER_BIRTH) {
    soter_make_start(space);
    return true;
  }
  return soter_make_move(space, move, broken);
}

static bool is_asked(const soter_choice* a, const soter_choice* b) {
  return a->stream == b->stream && a->count == b->count;
}

/* Makes it with the picks that are wished, where the questions are those that they answered. */
static bool make_all(soter_workspace* space, const soter_move* move, const soter_trace_step* wish,
                     soter_broken* broken, bool* fits) {
  const uint32_t wished = wish == NULL ? 0U : wish->choices;
  space->given = wished < SOTER_CHOICES ? wished : SOTER_CHOICES;
  for (uint32_t i = 0; i < space->given; i++) {
    space->choice[i] = wish->choice[i];
  }
  const bool ok = make(space, move, broken);
  *fits = true;
  for (uint32_t i = 0; i < space->given && i < space->taken; i++) {
    *fits = *fits && is_asked(&space->choice[i], &wish->choice[i]);
  }
  return ok;
}

/* The same, question by question: each gets the next wished answer to it, or the default. */
static bool make_as_wished(soter_workspace* space, const soter_move* move,
                           const soter_trace_step* wish, soter_broken* broken) {
  bool fits;
  bool ok = make_all(space, move, wish, broken, &fits);
  uint32_t from = 0U;
  if (fits) {
    return ok;
  }
  space->given = 0U;
  ok = make(space, move, broken);
  while (space->given < space->taken) {
    soter_choice* const next = &space->choice[space->given];
    uint32_t to = from;
    while (to < wish->choices && !is_asked(next, &wish->choice[to])) {
      to++;
    }
    next->pick = to < wish->choices ? wish->choice[to].pick : 0U;
    from = to < wish->choices ? to + 1U : from;
    space->given++;
    ok = make(space, move, broken);
  }
  return ok;
}

static void write(guided* d, uint32_t made, const soter_move* move, uint32_t number) {
  soter_workspace* const space = &d->space;
  const soter_guide* const g = d->g;
  uint32_t unusual = number > 0U ? 1U : 0U;
  for (uint32_t i = 0; i < space->taken; i++) {
    unusual += space->choice[i].pick != 0U ? 1U : 0U;
  }
  soter_write_step(space, move, &g->made[made]);
  g->unusual[made] = unusual;
  if (g->configurations != NULL) {
    (void)memcpy((uint8_t*)g->configurations + (size_t)made * space->size, space->there,
                 space->size);
  }
}

/* Follows the wishes; how many steps were made, those before `begin` among them. */
static uint32_t follow(guided* d, bool* violates) {
  static const soter_move birth = {SOTER_NOTHING, SOTER_BIRTH, -1, -1};
  soter_workspace* const space = &d->space;
  const soter_guide* const g = d->g;
  uint32_t made = g->begin;
  uint32_t at = g->begin;
  space->wanted = &g->wanted; /* what is violated with it does not hide it */
  if (g->begin > 0U) {
    (void)memcpy(space->here, (const uint8_t*)g->from, space->size);
  }
  while (made < g->limit && !space->too_many) {
    soter_move move = birth;
    soter_broken broken = {0U, SOTER_NOTHING};
    const soter_trace_step* wish = &g->wish[at];
    uint32_t number = 0U;
    if (made == 0U && g->length > 0U && wish->kind == (uint32_t)SOTER_BIRTH) {
      d->used[at] = true;
    } else {
      soter_find_windows(space);
      const uint32_t actor = who(d, &at);
      if (actor == SOTER_NOTHING) {
        break;
      }
      wish = wish_of(d, actor);
      number = move_of(space, actor, wish, &move);
    }
    const bool ok = make_as_wished(space, &move, wish, &broken);
    write(d, made++, &move, number);
    if (!ok || soter_finds_violation(space, &broken)) {
      *violates = soter_same_broken(&broken, &g->wanted);
      break;
    }
    (void)memcpy(space->here, space->there, space->size);
  }
  return made;
}

uint32_t soter_explore_guided(const soter_model* m, const soter_guide* g, bool* violates) {
  guided d;
  (void)memset(&d, 0, sizeof d);
  d.g = g;
  *violates = false;
  const uint32_t made = open(&d, m) ? follow(&d, violates) : 0U;
  *violates = *violates && !d.space.too_many;
  soter_workspace_close(&d.space);
  free(d.after);
  free(d.used);
  return made;
}
