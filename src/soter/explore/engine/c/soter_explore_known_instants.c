/* soter_explore_known_instants.c: instants that are known before a search.
 *
 * Purpose: whether nothing but ends of instants has to be stored, and how many steps so many
 * instants have (docs/testing.md, "Ends of instants"). Non-goals: running them
 * (soter_explore_instant.c).
 */
#include "soter_explore_internal.h"

bool soter_has_instants(const soter_model* m) {
  if (m->timely) {
    return false;
  }
  for (uint32_t i = 0; i < m->actors; i++) {
    if (m->actor[i].window_ns > 0 || m->actor[i].overrun_ns > 0) {
      return false;
    }
  }
  return true;
}

bool soter_by_instants(const soter_model* m, const soter_explore_options* o) {
  return (o->reduce & SOTER_REDUCE_INSTANTS) != 0U && o->strategy == SOTER_BFS &&
         soter_has_instants(m);
}

/* The steps of the instant after `*now`, which is moved on to it. */
static uint32_t steps_after(const soter_model* m, const soter_explore_options* o, int64_t* now) {
  int64_t next = SOTER_NO_DEADLINE;
  uint32_t then = 0U;
  for (uint32_t i = 0; i < m->actors; i++) {
    const soter_actor* const a = &m->actor[i];
    const bool moves = o->actors == 0U || (o->actors >> i & 1U) != 0U;
    const int64_t gone = *now < a->phase_ns ? 0 : (*now - a->phase_ns) / a->period_ns + 1;
    const int64_t release = a->phase_ns + gone * a->period_ns;
    SOTER_CHECK(release > *now && a->window_ns == 0);
    if (!moves || release > m->horizon_ns || release > next) {
      continue;
    }
    then = release == next ? then + 1U : 1U;
    next = release;
  }
  *now = next;
  return then;
}

uint32_t soter_steps_until(const soter_model* m, const soter_explore_options* o,
                           soter_instant_count* c, uint32_t instants) {
  c->now = c->instants == 0U ? -1 : c->now;
  for (; c->instants < instants && c->now < SOTER_NO_DEADLINE; c->instants++) {
    c->steps += steps_after(m, o, &c->now);
  }
  SOTER_CHECK(c->now >= -1);
  return c->steps;
}
