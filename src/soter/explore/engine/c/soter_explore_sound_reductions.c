/* soter_explore_sound_reductions.c: which reductions are sound, and which moves are then enough.
 *
 * Purpose: say for which models reductions are sound, and find ample sets that are sound under skew
 * (docs/testing.md, "Reduction"). A set S of actors is enough in a configuration if
 * - an actor outside S whose pending move may come before the first move of S (low <= the least
 *   high of S) is independent of all of S, now and later: dependence is between actors; and
 * - nothing that can be observed is lost by moving S first: either S is due (until one of S has
 *   moved, time cannot pass and nothing can be observed), or no time is chosen, moving S
 *   first does not move the clock, and S is invisible.
 * Every move counts a release, so there are no circles and nobody is postponed for ever.
 * Non-goals: ends of instants (soter_explore_known_instants.c), groups within an instant.
 */
#include "soter_explore_internal.h"

uint32_t soter_sound_reductions(const soter_model* m, const soter_explore_options* o) {
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

uint64_t soter_enabled_actors(const soter_workspace* space) {
  uint64_t enabled = 0U;
  for (uint32_t i = 0; i < space->m->actors; i++) {
    if (soter_may_move(space, i)) {
      enabled |= UINT64_C(1) << i;
    }
  }
  return enabled;
}

/* The clock after the first move, whichever it is. */
static int64_t next_time(const soter_workspace* space, uint64_t enabled) {
  const int64_t now = soter_schedule_of(space->p, space->here)->now;
  int64_t first = SOTER_NO_DEADLINE;
  for (uint32_t i = 0; i < space->m->actors; i++) {
    if ((enabled >> i & 1U) != 0U && soter_later(now, space->window[i].low) < first) {
      first = soter_later(now, space->window[i].low);
    }
  }
  SOTER_CHECK(first >= now);
  return first;
}

/* The least set with `seed` that has the first property; 0 where it needs somebody who may not
 * move. */
static uint64_t closure(const soter_workspace* space, uint64_t enabled, uint32_t seed) {
  uint64_t set = UINT64_C(1) << seed;
  uint64_t depends = space->m->actor[seed].dependent;
  int64_t high = space->window[seed].high;
  SOTER_CHECK((enabled >> seed & 1U) != 0U);
  bool grew = true;
  while (grew) {
    grew = false;
    for (uint32_t i = 0; i < space->m->actors; i++) {
      const uint64_t bit = UINT64_C(1) << i;
      if ((set & bit) != 0U || (depends & bit) == 0U || space->window[i].low > high) {
        continue;
      }
      if ((enabled & bit) == 0U) {
        return 0U;
      }
      set |= bit;
      depends |= space->m->actor[i].dependent;
      high = space->window[i].high < high ? space->window[i].high : high;
      grew = true;
    }
  }
  SOTER_CHECK((set & ~enabled) == 0U);
  return set;
}

static bool nothing_is_lost(const soter_workspace* space, uint64_t enabled, uint64_t set) {
  const int64_t now = soter_schedule_of(space->p, space->here)->now;
  const int64_t next = next_time(space, enabled);
  bool quiet = !space->m->timely;
  SOTER_CHECK(set != 0U && (set & ~enabled) == 0U);
  for (uint32_t i = 0; i < space->m->actors; i++) {
    if ((set >> i & 1U) == 0U) {
      continue;
    }
    if (space->window[i].high <= next) {
      return true; /* due */
    }
    quiet = quiet && space->window[i].low <= now && !space->m->actor[i].visible;
  }
  return quiet;
}

uint64_t soter_ample_set(const soter_workspace* space, uint64_t enabled) {
  uint64_t best = enabled;
  for (uint32_t i = 0; i < space->m->actors; i++) {
    if ((enabled >> i & 1U) == 0U) {
      continue;
    }
    const uint64_t set = closure(space, enabled, i);
    if (set != 0U && __builtin_popcountll(set) < __builtin_popcountll(best) &&
        nothing_is_lost(space, enabled, set)) {
      best = set;
    }
  }
  SOTER_CHECK((best & ~enabled) == 0U && (best != 0U || enabled == 0U));
  return best;
}
