/* soter_explore_transition_cache.c: steps that are run once for every value of what they read.
 *
 * Purpose: compute what a cache holds. Where no step lasts, a move is time that passes, and a step
 * then. The step depends on the packed bits of its actor's `reads`, with the time and the ages that
 * they have by then, and changes only those of its `writes`. Which moves there are, and when,
 * depends on the schedule's bits alone; what properties owe after a move on what they read, and on
 * the time. All of it is computed by the program's own steps on an unpacked configuration
 * (soter_explore_step.c), and everything that a step changed then, ages included, is held against
 * this: where it differs, nothing is remembered any more (docs/testing.md, "How it is stored and
 * made fast", "Remembered steps"). Non-goals: steps that last (overruns); expanding with it
 * (soter_explore_cached_expansion.c).
 */
#include "soter_explore_transition_cache.h"

#define MOST_COMPARED 1024U    /* outcomes of a step that are compared with each other, */
#define MOST_KEPT 65536U       /* and that are remembered */
#define ENOUGH_ANSWERS 4096U   /* answers of a step: a violation need not wait for the rest */
#define FIRST_SCHEDULES 65536U /* schedules, before it is asked whether they come back */

uint64_t soter_cache_bytes(const struct soter_cache* cache) {
  const list* const lists[] = {&cache->values, &cache->move_lists, &cache->planned_moves,
                               &cache->bits,   &cache->violations, &cache->obligations};
  uint64_t bytes =
      map_bytes(&cache->by_schedule, cache->words) + map_bytes(&cache->owed, cache->words);
  for (uint32_t i = 0; i < VERDICT_KINDS; i++) {
    bytes += map_bytes(&cache->verdicts[i], cache->words);
  }
  for (uint32_t i = 0; i < sizeof lists / sizeof lists[0]; i++) {
    bytes += lists[i]->room * lists[i]->size;
  }
  for (uint32_t a = 0; a < 2U * cache->actors; a++) {
    bytes += map_bytes(&cache->effects[a], cache->words);
  }
  return bytes;
}

/* Whether a map may have one more entry; it may have to grow. */
static bool may_put(const struct soter_cache* cache, const map* m) {
  return m->used * 2U < m->slots ||
         soter_cache_bytes(cache) + 2U * map_bytes(m, cache->words) <= cache->memory;
}

/* False: there is no memory for more. */
static bool map_put(const struct soter_cache* cache, map* m, const uint64_t* packed,
                    const uint64_t* mask, uint64_t number) {
  const uint32_t words = cache->words;
  if (!may_put(cache, m) || (m->used * 2U >= m->slots && !map_grow(m, words))) {
    return false;
  }
  uint64_t* const at = slot_of(m, packed, mask, words);
  SOTER_CHECK(at[words] == 0U && number != 0U);
  for (uint32_t k = 0; k < words; k++) {
    at[k] = packed[k] & mask[k];
  }
  at[words] = number;
  m->used++;
  return true;
}

/* Notes what of the model is asked for again and again. */
static void note_masks(struct soter_cache* cache, const soter_model* m) {
  const uint32_t words = m->words;
  for (uint32_t a = 0; a < m->actors; a++) {
    const uint64_t* const reads = m->actor[a].reads;
    for (uint32_t k = 0; k < words; k++) {
      cache->changed[(size_t)a * words + k] = m->scheduled[k] | m->actor[a].writes[k];
      cache->reads_schedule[a] = cache->reads_schedule[a] || (reads[k] & m->scheduled[k]) != 0U;
    }
    cache->reads_no_time[a] = !cache->reads_schedule[a];
    for (uint32_t i = 0; i < m->ageings; i++) {
      const soter_ageing* const g = &m->ageing[i];
      SOTER_CHECK(g->width > 0U && g->width < 64U);
      cache->reads_no_time[a] = cache->reads_no_time[a] && soter_get(reads, g->at, g->width) == 0U;
    }
  }
  for (uint32_t k = 0; k < words; k++) {
    cache->verdict_bits[k] = m->observed[k] | m->dues[k] | m->verdicts[k];
    cache->obligation_bits[k] = m->observed[k] | m->dues[k] | m->clock[k];
    cache->has_deadlines = cache->has_deadlines || m->dues[k] != 0U;
  }
}

static bool open_maps(struct soter_cache* cache, uint32_t words) {
  bool ok = map_open(&cache->by_schedule, words) && map_open(&cache->owed, words);
  for (uint32_t i = 0; ok && i < VERDICT_KINDS; i++) {
    ok = map_open(&cache->verdicts[i], words);
  }
  for (uint32_t a = 0; ok && a < 2U * cache->actors; a++) {
    ok = map_open(&cache->effects[a], words);
  }
  return ok;
}

struct soter_cache* soter_cache_open(soter_expander* expander, uint64_t memory) {
  const soter_model* const m = expander->space.m;
  const uint32_t words = m->words;
  struct soter_cache* const cache = calloc(1U, sizeof *cache);
  if (cache == NULL) {
    return NULL;
  }
  cache->words = words;
  cache->actors = m->actors;
  cache->memory = memory;
  cache->effects = calloc(2U * m->actors, sizeof *cache->effects);
  cache->changed = calloc((size_t)(m->actors + 3U + AGED_STATES) * words, sizeof *cache->changed);
  cache->reads_schedule = calloc(2U * m->actors, sizeof *cache->reads_schedule);
  cache->values.size = words * sizeof(uint64_t);
  cache->move_lists.size = sizeof(move_list);
  cache->planned_moves.size = sizeof(planned_move);
  cache->bits.size = words * sizeof(uint64_t);
  cache->violations.size = sizeof(soter_broken);
  cache->obligations.size = words * sizeof(uint64_t);
  if (cache->effects == NULL || cache->changed == NULL || cache->reads_schedule == NULL ||
      !open_maps(cache, words)) {
    soter_cache_close(cache);
    return NULL;
  }
  cache->reads_no_time = cache->reads_schedule + m->actors;
  cache->verdict_bits = cache->changed + (size_t)m->actors * words;
  cache->obligation_bits = cache->verdict_bits + words;
  cache->scratch = cache->obligation_bits + words;
  cache->aged_ones.packed = cache->scratch + words;
  note_masks(cache, m);
  return cache;
}

void soter_cache_close(struct soter_cache* cache) {
  if (cache == NULL) {
    return;
  }
  if (cache->effects != NULL) {
    for (uint32_t a = 0; a < 2U * cache->actors; a++) { /* those not opened have NULL pointers */
      map_close(&cache->effects[a], cache->words);
    }
  }
  map_close(&cache->by_schedule, cache->words);
  map_close(&cache->owed, cache->words);
  for (uint32_t i = 0; i < VERDICT_KINDS; i++) {
    map_close(&cache->verdicts[i], cache->words);
  }
  free(cache->effects);
  free(cache->changed);
  free(cache->reads_schedule);
  list_close(&cache->values);
  list_close(&cache->move_lists);
  list_close(&cache->planned_moves);
  list_close(&cache->bits);
  list_close(&cache->violations);
  list_close(&cache->obligations);
  free(cache);
}

static bool is_too_large(const struct soter_cache* cache) {
  return soter_cache_bytes(cache) > cache->memory;
}

static bool is_first_release(const soter_model* m, const soter_move* move) {
  const soter_actor* const a = &m->actor[move->actor];
  return (a->component & SOTER_INPUT) == 0U &&
         m->program->component[a->component].role == SOTER_ROLE_PLANT &&
         move->release == a->phase_ns;
}

/* The schedule after a move, whatever the step does, in `there`. */
static void schedule_after(soter_workspace* space, const soter_move* move) {
  const soter_model* const m = space->m;
  const uint32_t a = move->actor;
  (void)memcpy(space->there, space->here, space->size);
  soter_schedule_of(space->p, space->there)->now = move->time;
  soter_keep_others(space, space->there);
  soter_done_of(m, space->there)[a]++;
  SOTER_CHECK(a < m->actors);
  if (move->kind == SOTER_SKIPPED) {
    soter_lost_of(m, space->there)[a]++;
  } else if (m->actor[a].skips > 0U) {
    soter_lost_of(m, space->there)[a] = 0U;
  }
}

/* Adds a planned move, number `n` of the actor's; false: there is no memory. */
static bool add_planned_move(soter_expander* expander, struct soter_cache* cache,
                             const soter_move* move, uint32_t n) {
  soter_workspace* const space = &expander->space;
  const soter_model* const m = space->m;
  const int64_t now = soter_schedule_of(space->p, space->here)->now;
  uint64_t after[SOTER_WORDS];
  schedule_after(space, move);
  m->pack(space->there, after);
  planned_move* const planned = push(&cache->planned_moves, 1U);
  uint64_t* const bits = push(&cache->bits, 1U);
  if (planned == NULL || bits == NULL) {
    return false;
  }
  planned->actor = move->actor;
  planned->number = n;
  planned->later = (uint64_t)((move->time - soter_later(now, 0)) / m->tick_ns);
  planned->lost = move->kind == SOTER_SKIPPED;
  planned->first = is_first_release(m, move);
  planned->observable = soter_is_observable(space);
  planned->ends = expander->instant != NULL && planned->observable;
  for (uint32_t k = 0; k < m->words; k++) {
    bits[k] = after[k] & m->scheduled[k];
  }
  return true;
}

/* Whether one more schedule is worth remembering, and there is room for it. */
static bool may_remember(struct soter_cache* cache) {
  return (cache->by_schedule.used < FIRST_SCHEDULES ||
          cache->by_schedule.used <= cache->turn / 2U) &&
         may_put(cache, &cache->by_schedule) && !is_too_large(cache);
}

bool soter_compute_move_list(soter_expander* expander, struct soter_cache* cache,
                             const uint64_t* packed) {
  soter_workspace* const space = &expander->space;
  const soter_model* const m = space->m;
  const int64_t now = soter_schedule_of(space->p, space->here)->now;
  const bool observable = now >= 0 && space->limit > now;
  const uint64_t enabled = soter_enabled_actors(space);
  move_list moves = {cache->planned_moves.count,
                     0U,
                     soter_ample_set(space, enabled),
                     enabled,
                     observable,
                     enabled == 0U,
                     0U,
                     0U};
  bool ok = may_remember(cache);
  for (uint32_t a = 0; ok && a < m->actors; a++) {
    soter_move move;
    for (uint32_t n = 0; ok && soter_move_of(space, a, n, &move); n++) {
      ok = add_planned_move(expander, cache, &move, n);
      moves.count++;
    }
  }
  move_list* const to = ok ? push(&cache->move_lists, 1U) : NULL;
  if (to == NULL) {
    return false;
  }
  *to = moves;
  return map_put(cache, &cache->by_schedule, packed, m->scheduled, cache->move_lists.count);
}

/* Where something that broke stands among the brokens, from 1 on; 0: there is no room for more. */
static uint64_t violation_number(struct soter_cache* cache, const soter_broken* broken) {
  const soter_broken* const all = cache->violations.item;
  for (uint32_t i = 0; i < cache->violations.count; i++) {
    if (soter_same_broken(&all[i], broken)) {
      return i + 1U;
    }
  }
  const bool fits = cache->violations.count + 1U < 1U << BROKEN_BITS;
  soter_broken* const to = fits ? push(&cache->violations, 1U) : NULL;
  if (to == NULL) {
    return 0U;
  }
  *to = *broken;
  return cache->violations.count;
}

/* As one number; 0: there is no room. */
static uint64_t effect_as_word(struct soter_cache* cache, const effect* found) {
  const uint64_t broken = found->broke ? violation_number(cache, &found->broken) : 0U;
  SOTER_CHECK(found->count >> COUNT_BITS == 0U && COUNT_BITS + BROKEN_BITS < 32U);
  if (found->broke && broken == 0U) {
    return 0U;
  }
  return PRESENT | broken << (32U + COUNT_BITS) | (uint64_t)found->count << 32U | found->first;
}

/* Whether the same was written with other picks. */
static bool is_kept(const struct soter_cache* cache, const effect* found, const uint64_t* value) {
  if (found->count > MOST_COMPARED) {
    return false; /* looking would take longer than taking it twice */
  }
  const uint64_t* const all =
      (const uint64_t*)cache->values.item + (size_t)found->first * cache->words;
  for (uint32_t o = 0; o < found->count; o++) {
    if (memcmp(all + (size_t)o * cache->words, value, cache->words * sizeof *value) == 0) {
      return true;
    }
  }
  return false;
}

/* Keeps what a step wrote into `there`; false: it did not leave everything else as it was when it
 * began (`before`), or there is no memory. Then the search does without this. */
static bool keep_outcome(soter_workspace* space, struct soter_cache* cache, const uint64_t* before,
                         uint32_t actor, effect* found) {
  const soter_model* const m = space->m;
  const uint64_t* const writes = m->actor[actor].writes;
  uint64_t after[SOTER_WORDS];
  m->pack(space->there, after);
  const bool fits =
      found->count < MOST_KEPT && (found->count % 256U != 255U || !is_too_large(cache));
  uint64_t* const value = fits ? push(&cache->values, 1U) : NULL;
  if (value == NULL) {
    return false;
  }
  for (uint32_t k = 0; k < m->words; k++) {
    if (((after[k] ^ before[k]) & ~(writes[k] | m->dues[k])) != 0U) {
      return false;
    }
    value[k] = after[k] & writes[k];
  }
  if (is_kept(cache, found, value)) {
    cache->values.count--;
  } else {
    found->count++;
  }
  SOTER_CHECK(found->first + found->count <= cache->values.count);
  return true;
}

/* An outcome that breaks something: the first that is not known is told. */
static void note_broken(const soter_workspace* space, effect* found, const soter_broken* broken) {
  if (!found->broke && !soter_is_known(space, broken)) {
    found->broken = *broken;
    found->broke = true;
  }
}

/* Whether the configuration after a move violates what is not known. */
static bool breaks_what_is_unknown(soter_workspace* space) {
  soter_broken broken;
  return soter_finds_violation(space, &broken) && !soter_is_known(space, &broken);
}

/* Whether the next answer of a step is to be tried, too: of very many the rest need not be. */
static bool wants_more_answers(const soter_expander* expander, bool breaks) {
  return !breaks || expander->go_on || expander->space.tried < ENOUGH_ANSWERS;
}

bool soter_compute_effect(soter_expander* expander, struct soter_cache* cache,
                          const uint64_t* before, const planned_move* planned, map* effects) {
  soter_workspace* const space = &expander->space;
  const soter_model* const m = space->m;
  effect found = {cache->values.count, 0U, false, {0U, 0U}};
  soter_move move;
  if (is_too_large(cache) || !soter_move_of(space, planned->actor, planned->number, &move)) {
    return false;
  }
  space->given = 0U;
  bool breaks = false; /* some outcome does */
  do {
    soter_broken broken;
    const uint32_t count = found.count;
    if (!soter_make_move(space, &move, &broken)) {
      note_broken(space, &found, &broken);
      breaks = breaks || found.broke;
      continue;
    }
    soter_note_coverage(space, planned->actor);
    if (!keep_outcome(space, cache, before, planned->actor, &found)) {
      soter_tell_answers(space, true);
      return false;
    }
    breaks = breaks || (found.count > count && breaks_what_is_unknown(space));
  } while (wants_more_answers(expander, breaks) && soter_next_picks(space));
  soter_tell_answers(space, true);
  const uint64_t number = effect_as_word(cache, &found);
  return number != 0U && map_put(cache, effects, before, m->actor[planned->actor].reads, number);
}

bool soter_compute_obligations(soter_expander* expander, const uint64_t* successor) {
  struct soter_cache* const cache = expander->cache;
  soter_workspace* const space = &expander->space;
  const soter_model* const m = space->m;
  uint64_t after[SOTER_WORDS];
  m->unpack(successor, space->there);
  soter_keep_obligations(space);
  m->pack(space->there, after);
  uint64_t* const obligations = push(&cache->obligations, 1U);
  if (obligations == NULL) {
    return false;
  }
  for (uint32_t k = 0; k < m->words; k++) {
    if (((after[k] ^ successor[k]) & ~m->dues[k]) != 0U) {
      return false;
    }
    obligations[k] = after[k] & m->dues[k];
  }
  return map_put(cache, &cache->owed, successor, cache->obligation_bits, cache->obligations.count);
}

effect soter_compute_verdict(soter_expander* expander, const uint64_t* packed, map* seen,
                             const uint64_t* decides) {
  effect found = {0U, 0U, false, {0U, 0U}};
  expander->space.m->unpack(packed, expander->space.there);
  found.broke = soter_finds_violation(&expander->space, &found.broken);
  const uint64_t number = effect_as_word(expander->cache, &found);
  (void)(number != 0U && map_put(expander->cache, seen, packed, decides, number));
  return found;
}
