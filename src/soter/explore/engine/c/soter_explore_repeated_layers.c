/* soter_explore_repeated_layers.c: whether what is still to come was there before (docs/testing.md,
 * "For ever").
 *
 * Purpose: where only ends of instants are stored, every so often the calendar begins anew: after
 * the least common multiple of all periods. If the layer then has the same configurations as at an
 * earlier beginning, times aside, so have all that follow, whatever the horizon. Every layer of a
 * beginning has a number; where one comes again its table is kept, and compared with the one that
 * comes as much later, entry by entry. Where what lies between is stored as well, the layers at
 * ends of instants are those of as many steps. Non-goals: programs that read the time, and what no
 * number of instants repeats.
 */
#include "soter_explore_bfs.h"

#define LOOK_BACK 4096U /* beginnings */

static int64_t gcd(int64_t a, int64_t b) {
  while (b != 0) {
    const int64_t rest = a % b;
    a = b;
    b = rest;
  }
  return a;
}

/* Whether it is a search whose layers may be compared, and that nobody wants to see all of. */
static bool may_compare_layers(const layered* all) {
  const soter_explore_options* const o = all->s->o;
  const bool plain = o->noted == NULL && o->goal == NULL && !o->go_on && o->knowns == 0U;
  const bool ends = all->w[0].expander.instant != NULL || all->repetition.calendar != 0U;
  return o->closes && all->tables && !o->keep && plain && ends;
}

/* The bits of a place in the calendar, where entries have them (a fingerprint has none) and layers
 * end with instants. */
static uint64_t calendar_bits(const layered* all) {
  const soter_model* const m = all->s->m;
  const soter_expander* const expander = &all->w[0].expander;
  const bool ok = all->tables && expander->instant == NULL && !soter_keeps_sleep(expander) &&
                  soter_has_instants(m);
  return ok && m->calendar > 0U && m->calendar < 63U ? ((UINT64_C(1) << m->calendar) - 1U) << 1U
                                                     : 0U;
}

/* Whether the next layer is one of ends of instants. */
static bool is_of_ends(layered* all) {
  soter_repetition* const c = &all->repetition;
  const uint32_t steps = all->depth + 1U;
  while (c->calendar != 0U && c->counted.steps < steps && c->counted.now < SOTER_NO_DEADLINE) {
    (void)soter_steps_until(all->s->m, all->s->o, &c->counted, c->counted.instants + 1U);
  }
  return c->calendar == 0U || c->counted.steps == steps;
}

/* One more actor has a beginning; false: there are no two before the end. */
static bool add_period(soter_repetition* c, const soter_actor* a, int64_t horizon_ns) {
  const int64_t part = a->period_ns / gcd(c->every_ns, a->period_ns);
  SOTER_CHECK(c->every_ns > 0);
  if (part > horizon_ns / c->every_ns) {
    return false;
  }
  c->from_ns = soter_later(c->from_ns, a->phase_ns);
  c->every_ns *= part;
  return true;
}

void soter_repetition_open(layered* all) {
  const soter_model* const m = all->s->m;
  const uint64_t actors = all->s->o->actors;
  soter_repetition* const c = &all->repetition;
  c->calendar = calendar_bits(all);
  c->on = c->may = may_compare_layers(all);
  c->every_ns = 1;
  c->last_ns = m->horizon_ns;
  for (uint32_t i = 0; c->on && i < m->actors; i++) {
    if (actors == 0U || i >= 64U || (actors >> i & 1U) != 0U) {
      c->on = add_period(c, &m->actor[i], m->horizon_ns);
    }
  }
  for (uint32_t i = 0; i < m->timeds; i++) { /* what begins later is not owed */
    c->last_ns = soter_earlier(c->last_ns, m->horizon_ns - m->timed[i].within_ns);
  }
}

void soter_repetition_close(layered* all) {
  free(all->repetition.turn);
  all->repetition.turn = NULL;
  for (uint32_t k = 0; k < all->opened; k++) {
    soter_store_close(&all->w[k].anchor);
  }
}

/* The number of the layer that was expanded is known: has it been there? */
static void find_same_digest(layered* all) {
  soter_repetition* const c = &all->repetition;
  soter_layer_digest now = {c->at_ns, 0U, 0U};
  for (uint32_t k = 0; k < all->threads; k++) {
    now.digest += all->w[k].digest;
    now.count += all->w[k].layer;
  }
  const uint32_t first = c->turns > LOOK_BACK ? c->turns - LOOK_BACK : 0U;
  for (uint32_t i = c->turns; i-- > first && c->anchored == 0;) {
    if (c->turn[i].digest == now.digest && c->turn[i].count == now.count) {
      c->take = true;
      c->anchored = now.at_ns;
      c->again_ns = now.at_ns + (now.at_ns - c->turn[i].at_ns);
    }
  }
  if (c->turns == c->room) {
    const uint32_t room = c->room * 2U + 16U;
    soter_layer_digest* const more = realloc(c->turn, room * sizeof *more);
    if (more == NULL) {
      c->on = false; /* it ends at the horizon then */
      return;
    }
    c->turn = more;
    c->room = room;
  }
  c->turn[c->turns++] = now;
}

/* All workers have compared theirs. */
static void agree_on_comparison(layered* all) {
  soter_repetition* const c = &all->repetition;
  bool same = true;
  for (uint32_t k = 0; k < all->threads; k++) {
    same = same && all->w[k].same;
  }
  c->anchored = 0;
  c->closed_ns = same ? c->at_ns : 0;
}

/* It looks after a layer that was expanded to its end, before the next. */
bool soter_repetition_found(layered* all) {
  soter_repetition* const c = &all->repetition;
  const int64_t next_ns = all->s->progress->covered_ns;
  if (!c->on || !all->whole) {
    return false;
  }
  c->take = false;
  if (c->compare) {
    agree_on_comparison(all);
  } else if (c->at) {
    find_same_digest(all);
  }
  c->at = next_ns >= c->from_ns && next_ns <= c->last_ns &&
          (next_ns - c->from_ns) % c->every_ns == 0 && is_of_ends(all);
  c->at_ns = next_ns;
  c->compare = c->at && c->anchored != 0 && next_ns == c->again_ns;
  return c->closed_ns != 0;
}

/* A worker's part of a layer that is to be expanded from its beginning. */
static void compare_or_sum(worker* w) {
  const soter_repetition* const c = &w->all->repetition;
  if (c->compare) {
    w->same = soter_store_same(&w->before, &w->anchor, c->calendar);
  } else if (c->at) {
    w->digest = soter_store_digest(&w->before, c->calendar);
  }
}

static void close_anchor(worker* w) {
  soter_store_close(&w->anchor);
  (void)memset(&w->anchor, 0, sizeof w->anchor);
}

/* A worker, when `w->before` is what is expanded next and `w->store` what was expanded last.
 * Whether the latter was taken: there is none then. */
bool soter_repetition_take(worker* w) {
  const soter_repetition* const c = &w->all->repetition;
  if (!c->on) {
    return false;
  }
  if (c->take) { /* and compared at once, where a beginning follows the other */
    w->anchor = w->store;
    w->anchor.stop = NULL;
    w->store.segment = NULL;
    w->store.own = NULL;
  }
  compare_or_sum(w);
  if (c->compare) {
    close_anchor(w);
  }
  return c->take;
}
