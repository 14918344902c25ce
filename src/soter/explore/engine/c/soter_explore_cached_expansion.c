/* soter_explore_cached_expansion.c: successors that are looked up.
 *
 * Purpose: expand packed configurations by a few operations on words a move: time makes some packed
 * fields older, whoever moves, and what the step writes is in the transition cache. Non-goals: what
 * is in it, and why that is sound (soter_explore_transition_cache.c).
 */
#include "soter_explore_transition_cache.h"

/* What is packed of a field, so many ticks later. */
SPECIAL uint64_t aged_field(const soter_ageing* g, uint64_t x, uint64_t ticks) {
  if (g->kind == SOTER_SINCE) {
    return x + ticks < g->most ? x + ticks : g->most;
  }
  if (g->kind == SOTER_STAMP) {
    return x == 0U ? 0U : x + ticks;
  }
  return x <= 1U ? x : x - 2U < ticks ? 1U : x - ticks;
}

/* A configuration, so many ticks later, the schedule as it was. */
SPECIAL void make_aged_state(const soter_model* m, const uint64_t* packed, uint64_t ticks,
                             uint64_t* to, const uint32_t words) {
  soter_copy_words(to, packed, words);
  for (uint32_t i = 0; i < m->ageings; i++) {
    const soter_ageing* const g = &m->ageing[i];
    const uint64_t before = soter_get(packed, g->at, g->width);
    const uint64_t change = before ^ aged_field(g, before, ticks);
    const uint64_t shift = g->at % 64U;
    SOTER_CHECK(change >> g->width == 0U && (g->at + g->width - 1U) / 64U < words);
    to[g->at / 64U] ^= change << shift;
    if (shift + g->width > 64U) {
      to[g->at / 64U + 1U] ^= change >> (64U - shift);
    }
  }
}

/* The configuration that is expanded, so many ticks later: several moves happen at one time. */
SPECIAL const uint64_t* aged_state(struct soter_cache* cache, const soter_model* m,
                                   const uint64_t* packed, uint64_t later, const uint32_t words) {
  if (later == 0U || m->ageings == 0U) {
    return packed;
  }
  aged_states* const older_ones = &cache->aged_ones;
  const uint32_t i = (uint32_t)(later % AGED_STATES);
  uint64_t* const to = older_ones->packed + (size_t)i * words;
  if (older_ones->turn[i] != cache->turn || older_ones->later[i] != later) {
    make_aged_state(m, packed, later, to, words);
    older_ones->turn[i] = cache->turn;
    older_ones->later[i] = later;
  }
  return to;
}

/* Closes the cache: expanding goes on without it. */
static bool give_cache_up(soter_expander* expander) {
  soter_cache_close(expander->cache);
  expander->cache = NULL;
  expander->successors.count = expander->begin;
  expander->broke = false;
  return false;
}

/* Looks the moves up, or computes them; *unpacked says that `here` is this configuration then. */
SPECIAL move_list* move_list_of(soter_expander* expander, const uint64_t* packed,
                                const uint32_t words, bool* unpacked) {
  struct soter_cache* const cache = expander->cache;
  soter_workspace* const space = &expander->space;
  const uint64_t* at = slot_of(&cache->by_schedule, packed, space->m->scheduled, words);
  if (at[words] == 0U) {
    space->m->unpack(packed, space->here);
    soter_find_windows(space);
    *unpacked = true;
    if (!soter_compute_move_list(expander, cache, packed)) {
      return NULL;
    }
    at = slot_of(&cache->by_schedule, packed, space->m->scheduled, words);
  }
  return (move_list*)cache->move_lists.item + (at[words] - 1U);
}

/* Makes the configuration in which the step of a planned move begins. */
SPECIAL const uint64_t* state_at_step(const soter_model* m, const uint64_t* then,
                                      const uint64_t* bits, uint64_t* to, const uint32_t words) {
  for (uint32_t k = 0; k < words; k++) {
    to[k] = (then[k] & ~m->scheduled[k]) | bits[k];
  }
  return to;
}

/* Looks up, or computes, what a step does to a configuration, `then` when it begins but for the
 * schedule: an effect as a word; 0: it cannot be kept. */
SPECIAL uint64_t effect_of(soter_expander* expander, const uint64_t* packed, const uint64_t* then,
                           const planned_move* move, const uint64_t* bits, const uint32_t words,
                           bool* unpacked) {
  struct soter_cache* const cache = expander->cache;
  soter_workspace* const space = &expander->space;
  const soter_model* const m = space->m;
  const uint64_t* const reads = m->actor[move->actor].reads;
  const uint64_t* const asked = cache->reads_schedule[move->actor]
                                    ? state_at_step(m, then, bits, cache->scratch, words)
                                    : then;
  map* const effects = &cache->effects[2U * move->actor + (move->first ? 1U : 0U)];
  const uint64_t* slot = slot_of(effects, asked, reads, words);
  if (slot[words] == 0U) {
    if (!*unpacked) {
      m->unpack(packed, space->here);
      soter_find_windows(space);
      *unpacked = true;
    }
    if (!soter_compute_effect(expander, cache, state_at_step(m, then, bits, cache->scratch, words),
                              move, effects)) {
      return 0U;
    }
    slot = slot_of(effects, cache->scratch, reads, words);
  }
  SOTER_CHECK(slot[words] != 0U);
  return slot[words];
}

/* Writes what properties owe into a successor that is observed. False: there is no memory. */
SPECIAL bool update_obligations(soter_expander* expander, uint64_t* successor,
                                const uint32_t words) {
  struct soter_cache* const cache = expander->cache;
  const uint64_t* const dues = expander->space.m->dues;
  const uint64_t* slot = slot_of(&cache->owed, successor, cache->obligation_bits, words);
  if (slot[words] == 0U) {
    if (!soter_compute_obligations(expander, successor)) {
      return false;
    }
    slot = slot_of(&cache->owed, successor, cache->obligation_bits, words);
  }
  const uint64_t* const obligations =
      (const uint64_t*)cache->obligations.item + (size_t)(slot[words] - 1U) * words;
  for (uint32_t k = 0; k < words; k++) {
    successor[k] = (successor[k] & ~dues[k]) | obligations[k];
  }
  return true;
}

/* Adds the successors by a step: schedule's bits, and what was written. False: there is no memory,
 * or no room for so many at once. */
SPECIAL bool add_outcomes(soter_expander* expander, const uint64_t* then, const planned_move* move,
                          const uint64_t* bits, const effect* done, uint64_t asleep,
                          const uint32_t words) {
  const struct soter_cache* const cache = expander->cache;
  const uint64_t* const changed = cache->changed + (size_t)move->actor * words;
  const uint64_t* value = (const uint64_t*)cache->values.item + (size_t)done->first * words;
  const bool owes = move->observable && cache->has_deadlines;
  if (done->broke) {
    expander->broken = expander->broke ? expander->broken : done->broken;
    expander->broke = true;
    expander->transitions++;
  }
  if ((uint64_t)(expander->successors.count + done->count) * words * sizeof *value >
      expander->memory) {
    return false;
  }
  for (uint32_t o = 0; o < done->count; o++) {
    uint64_t* const successor = soter_next_successor(expander, asleep);
    if (successor == NULL) {
      return false;
    }
    for (uint32_t k = 0; k < words; k++) {
      successor[k] = (then[k] & ~changed[k]) | bits[k] | value[k];
    }
    if (owes && !update_obligations(expander, successor, words)) {
      return false;
    }
    value += words;
    expander->transitions++;
  }
  return true;
}

/* Adds the successor by a lost release: only the schedule and what time changes are others. */
SPECIAL bool add_lost(soter_expander* expander, const uint64_t* then, const planned_move* move,
                      const uint64_t* bits, uint64_t asleep, const uint32_t words) {
  uint64_t* const successor = soter_next_successor(expander, asleep);
  expander->transitions++;
  if (successor == NULL) {
    return false;
  }
  (void)state_at_step(expander->space.m, then, bits, successor, words);
  return !move->observable || !expander->cache->has_deadlines ||
         update_obligations(expander, successor, words);
}

/* Adds the successors by one move. `last` is what the step of `of`, the move before, did: where no
 * time is read, it does the same whenever it happens. */
SPECIAL bool add_successors(soter_expander* expander, const uint64_t* packed,
                            const planned_move* move, const uint64_t* bits, uint64_t asleep,
                            const planned_move* of, uint64_t* last, const uint32_t words,
                            bool* unpacked) {
  struct soter_cache* const cache = expander->cache;
  const uint64_t* const then = aged_state(cache, expander->space.m, packed, move->later, words);
  if (move->lost) {
    return add_lost(expander, then, move, bits, asleep, words);
  }
  const bool again = *last != 0U && of->actor == move->actor && cache->reads_no_time[move->actor];
  SOTER_CHECK(!again || of->first == move->first);
  if (!again) {
    *last = effect_of(expander, packed, then, move, bits, words, unpacked);
  }
  const effect done = effect_of_word(cache, *last);
  return *last != 0U && add_outcomes(expander, then, move, bits, &done, asleep, words);
}

/* Whose moves are enough, of some actors. */
static uint64_t wanted_actors(const soter_expander* expander, const move_list* moves,
                              uint64_t only) {
  const bool fewer = (expander->reduce & SOTER_REDUCE_AMPLE) != 0U;
  return soter_in_order(expander->space.m, only & (fewer ? moves->ample : moves->enabled));
}

/* Adds all successors of a configuration; false: it has to be expanded without the cache. */
SPECIAL bool expand(soter_expander* expander, const uint64_t* packed, uint64_t sleep, uint64_t only,
                    const uint32_t words) {
  struct soter_cache* const cache = expander->cache;
  bool unpacked = false;
  cache->turn++;
  const move_list* const known = move_list_of(expander, packed, words, &unpacked);
  if (known == NULL) {
    return give_cache_up(expander);
  }
  const move_list moves = *known;
  const uint64_t wanted = wanted_actors(expander, &moves, only) & ~sleep;
  uint64_t before = 0U;
  planned_move of = {0};
  uint64_t last = 0U;
  for (uint32_t i = 0; i < moves.count; i++) {
    const planned_move move = ((const planned_move*)cache->planned_moves.item)[moves.first + i];
    const uint64_t self = UINT64_C(1) << move.actor;
    SOTER_CHECK(move.actor < cache->actors);
    if ((wanted & self) == 0U) {
      continue;
    }
    const uint64_t asleep =
        move.ends ? SOTER_AT_END
        : (expander->reduce & SOTER_REDUCE_SLEEP) != 0U
            ? soter_still_asleep(expander->space.m, move.actor, sleep, before & ~self)
            : 0U;
    before |= self;
    const uint64_t* const bits =
        (const uint64_t*)cache->bits.item + (size_t)(moves.first + i) * words;
    if (!add_successors(expander, packed, &move, bits, asleep, &of, &last, words, &unpacked)) {
      return expander->no_memory || give_cache_up(expander);
    }
    of = move.lost ? of : move;
  }
  return true;
}

bool soter_cache_expand(soter_expander* expander, const uint64_t* packed, uint64_t sleep,
                        uint64_t only) {
  const uint32_t words = expander->cache->words;
  return words == 1U   ? expand(expander, packed, sleep, only, 1U)
         : words == 2U ? expand(expander, packed, sleep, only, 2U)
                       : expand(expander, packed, sleep, only, words);
}

/* Configurations of a word that have one move list: one move after the other is made from all of
 * them. The processor foresees that; which move list comes next it does not. */
typedef struct {
  uint64_t configuration[SOTER_BATCH];
  uint64_t then[SOTER_BATCH];        /* when the move begins, but for the schedule */
  uint64_t effect_word[SOTER_BATCH]; /* what the step does, */
  uint64_t successors;               /* and how many come of it */
  uint32_t count;
} state_batch;

/* Makes all of them so many ticks older. */
static void age_batch(const soter_model* m, state_batch* batch, uint64_t ticks) {
  (void)memcpy(batch->then, batch->configuration, batch->count * sizeof batch->then[0]);
  for (uint32_t k = 0; ticks > 0U && k < m->ageings; k++) {
    const soter_ageing g = m->ageing[k];
    const uint64_t bits = (UINT64_C(1) << g.width) - 1U;
    SOTER_CHECK(g.width < 64U && g.at + g.width <= 64U);
    for (uint32_t i = 0; i < batch->count; i++) {
      const uint64_t before = batch->then[i] >> g.at & bits;
      const uint64_t change = before ^ aged_field(&g, before, ticks);
      SOTER_CHECK(change <= bits);
      batch->then[i] ^= change << g.at;
    }
  }
}

/* Finds what the step of a move does to each; false: it cannot be kept. */
static bool find_batch_effects(soter_expander* expander, state_batch* batch,
                               const planned_move* move, const uint64_t* bits) {
  struct soter_cache* const cache = expander->cache;
  const soter_model* const m = expander->space.m;
  const bool reads_schedule = cache->reads_schedule[move->actor];
  const uint64_t kept = reads_schedule ? ~m->scheduled[0] : UINT64_MAX;
  const uint64_t added = reads_schedule ? *bits : 0U;
  const uint64_t* const reads = m->actor[move->actor].reads;
  const map* const effects = &cache->effects[2U * move->actor + (move->first ? 1U : 0U)];
  batch->successors = 0U;
  for (uint32_t i = 0; i < batch->count; i++) {
    const uint64_t asked = (batch->then[i] & kept) | added;
    uint64_t effect_word = slot_of(effects, &asked, reads, 1U)[1];
    if (effect_word == 0U) {
      bool unpacked = false;
      effect_word =
          effect_of(expander, batch->configuration + i, batch->then + i, move, bits, 1U, &unpacked);
    }
    if (effect_word == 0U) {
      return false;
    }
    batch->effect_word[i] = effect_word;
    batch->successors += effect_word >> 32U & MOST_OUTCOMES;
    if (!breaks_nothing(effect_word)) {
      expander->broken =
          expander->broke ? expander->broken : effect_of_word(cache, effect_word).broken;
      expander->broke = true;
      expander->transitions++;
    }
  }
  return true;
}

/* Adds the successors by a step, of all; false: there is no memory, or they are too many. */
static bool add_batch(soter_expander* expander, const state_batch* batch, const planned_move* move,
                      uint64_t bits) {
  const struct soter_cache* const cache = expander->cache;
  const uint64_t changed = cache->changed[move->actor];
  const uint64_t* const values = cache->values.item;
  uint64_t* successor = soter_next_successors(expander, batch->successors);
  for (uint32_t i = 0; successor != NULL && i < batch->count; i++) {
    const uint64_t rest = (batch->then[i] & ~changed) | bits;
    const uint64_t* const value = values + (uint32_t)batch->effect_word[i];
    const uint32_t outcomes = (uint32_t)(batch->effect_word[i] >> 32U) & MOST_OUTCOMES;
    for (uint32_t o = 0; o < outcomes; o++) {
      *successor++ = rest | value[o];
    }
  }
  return successor != NULL;
}

/* Adds the successors by a release that is lost. */
static bool add_batch_lost(soter_expander* expander, const state_batch* batch, uint64_t bits) {
  const uint64_t changed = expander->space.m->scheduled[0];
  uint64_t* const successor = soter_next_successors(expander, batch->count);
  for (uint32_t i = 0; successor != NULL && i < batch->count; i++) {
    successor[i] = (batch->then[i] & ~changed) | bits;
  }
  return successor != NULL;
}

/* Adds all successors of a batch; false: there is no memory, or they are too many. */
static bool add_batch_successors(soter_expander* expander, state_batch* batch,
                                 const move_list* moves) {
  const struct soter_cache* const cache = expander->cache;
  const planned_move* const planned_moves =
      (const planned_move*)cache->planned_moves.item + moves->first;
  const uint64_t* const bits = (const uint64_t*)cache->bits.item + moves->first;
  const uint64_t wanted = wanted_actors(expander, moves, UINT64_MAX);
  uint32_t of = SOTER_NOTHING; /* whose step `did` is */
  bool ok = true;
  for (uint32_t k = 0; ok && k < moves->count; k++) {
    const planned_move* const move = &planned_moves[k];
    if ((wanted >> move->actor & 1U) == 0U) {
      continue;
    }
    age_batch(expander->space.m, batch, move->later);
    if (move->lost) {
      ok = add_batch_lost(expander, batch, bits[k]);
      continue;
    }
    if (of != move->actor || !cache->reads_no_time[of]) {
      of = move->actor;
      ok = find_batch_effects(expander, batch, move, bits + k);
    }
    ok = ok && add_batch(expander, batch, move, bits[k]);
  }
  return ok;
}

/* Finds the move lists of configurations: each is linked with the next that has the same. False:
 * there is none for some. */
static bool group_by_move_list(soter_expander* expander, const uint64_t* packed, uint32_t count,
                               uint32_t* list_of, uint32_t* next) {
  struct soter_cache* const cache = expander->cache;
  for (uint32_t i = 0; i < count; i++) {
    bool unpacked = false;
    move_list* const moves = move_list_of(expander, packed + i, 1U, &unpacked);
    if (moves == NULL) {
      return false;
    }
    list_of[i] = SOTER_NOTHING;
    next[i] = SOTER_NOTHING;
    if (moves->turn == cache->turn) {
      next[moves->last] = i;
    } else {
      list_of[i] = (uint32_t)(moves - (const move_list*)cache->move_lists.item);
    }
    moves->turn = cache->turn;
    moves->last = i;
  }
  return true;
}

bool soter_cache_expand_batch(soter_expander* expander, const uint64_t* packed, uint32_t count) {
  struct soter_cache* const cache = expander->cache;
  const uint64_t transitions = expander->transitions;
  uint32_t list_of[SOTER_BATCH]; /* of the first one of a batch */
  uint32_t next[SOTER_BATCH];
  state_batch batch;
  SOTER_CHECK(expander->instant == NULL && (expander->reduce & SOTER_REDUCE_SLEEP) == 0U);
  if (cache == NULL || cache->words != 1U || cache->has_deadlines) {
    return false;
  }
  expander->begin = expander->successors.count;
  expander->broke = false;
  cache->turn += count;
  bool ok = group_by_move_list(expander, packed, count, list_of, next);
  for (uint32_t i = 0; ok && i < count; i++) {
    batch.count = 0U;
    for (uint32_t k = list_of[i] != SOTER_NOTHING ? i : count; k < count; k = next[k]) {
      batch.configuration[batch.count++] = packed[k];
    }
    ok = batch.count == 0U ||
         add_batch_successors(expander, &batch,
                              (const move_list*)cache->move_lists.item + list_of[i]);
  }
  if (!ok) {
    expander->successors.count = expander->begin;
    expander->transitions = transitions;
    expander->broke = false;
  }
  return ok;
}

/* Looks up, or computes, whether a configuration violates anything: the bits of `decides` say. */
SPECIAL effect verdict_of(soter_expander* expander, const uint64_t* packed, map* seen,
                          const uint64_t* decides, const uint32_t words) {
  const uint64_t* const at = slot_of(seen, packed, decides, words);
  return at[words] != 0U ? effect_of_word(expander->cache, at[words])
                         : soter_compute_verdict(expander, packed, seen, decides);
}

/* Whether anything is observed, and whether something is due at the end, depends on the schedule;
 * what is violated then on what properties read and on what they know of the past. */
SPECIAL bool is_broken(soter_expander* expander, const uint64_t* packed, soter_broken* broken,
                       const uint32_t words) {
  struct soter_cache* const cache = expander->cache;
  soter_workspace* const space = &expander->space;
  bool unpacked = false;
  const move_list* const moves = move_list_of(expander, packed, words, &unpacked);
  if (moves == NULL) {
    space->m->unpack(packed, space->there);
    return soter_finds_violation(space, broken);
  }
  if (!moves->observable && !cache->has_deadlines) {
    return false;
  }
  const uint32_t sight = !moves->observable ? 0U : moves->over ? 2U : 1U;
  const uint64_t* const decides = moves->observable ? cache->verdict_bits : space->m->dues;
  const effect found = verdict_of(expander, packed, &cache->verdicts[sight], decides, words);
  *broken = found.broken;
  return found.broke;
}

bool soter_cache_finds_violation(soter_expander* expander, const uint64_t* packed,
                                 soter_broken* broken) {
  return expander->cache->words == 1U ? is_broken(expander, packed, broken, 1U)
                                      : is_broken(expander, packed, broken, expander->cache->words);
}

/* Whether a configuration that has these moves is known to violate nothing. */
SPECIAL bool is_known_unviolated(const struct soter_cache* cache, const move_list* moves,
                                 const uint64_t* packed) {
  const map* const seen = &cache->verdicts[moves->over ? 2U : 1U];
  return !moves->observable || breaks_nothing(slot_of(seen, packed, cache->verdict_bits, 1U)[1]);
}

uint32_t soter_cache_count_unviolated(const soter_expander* expander, const uint64_t* packed,
                                      uint32_t count) {
  const struct soter_cache* const cache = expander->cache;
  const uint64_t* const scheduled = expander->space.m->scheduled;
  const move_list* moves = NULL;
  uint64_t last = 0U; /* the schedule of the one before: most have the same */
  bool ok = cache != NULL && cache->words == 1U && !cache->has_deadlines;
  uint32_t i = 0U;
  while (ok && i < count) {
    if (moves == NULL || (packed[i] & *scheduled) != last) {
      const uint64_t number = slot_of(&cache->by_schedule, packed + i, scheduled, 1U)[1];
      moves = number != 0U ? (const move_list*)cache->move_lists.item + (number - 1U) : NULL;
      last = packed[i] & *scheduled;
    }
    ok = moves != NULL && is_known_unviolated(cache, moves, packed + i);
    i += ok;
  }
  return i;
}
