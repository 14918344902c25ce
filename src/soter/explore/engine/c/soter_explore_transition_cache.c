/* soter_explore_transition_cache.c: steps that are run once for every value of what they read.
 *
 * Purpose: where no step lasts, a move is time that passes, and a step then. Time makes some packed
 * fields older, whoever moves. The step depends on the packed bits of its actor's `reads`, with the
 * time and the ages that they have by then, and changes only those of its `writes`. Which moves
 * there are, and when, depends on the schedule's bits alone; what properties owe after a move on
 * what they read, and on the time. All of it is looked up: a move is then a few operations on
 * packed words. What is looked up was computed by the program's own steps on an unpacked
 * configuration (soter_explore_step.c), and everything that a step changed then, ages included, is
 * held against this: where it differs, nothing is remembered any more. Non-goals: steps that last
 * (overruns).
 */
#include "soter_explore_hash_map.h"
#include "soter_explore_pack.h"
#include "soter_explore_successors.h"

#define MANY 1024U      /* outcomes of a step that are compared with each other, */
#define TOO_MANY 65536U /* and that are remembered */
#define LONG 4096U      /* answers of a step: a violation need not wait for the rest */
#define OLDER 16U       /* times at once at which a configuration is made older */
#define KINDS 3U        /* of configurations: not looked at; looked at; nothing comes after it */
#define FEW 65536U      /* schedules, before it is asked whether they come back */

/* How a step may end: it breaks something, and these bits of `writes` are the new ones. */
typedef struct {
  uint32_t first, count; /* outcomes: in `value`, `count` times `words` */
  bool broke;
  soter_broken broken;
} effect;

/* An effect as one number that is not 0: a bit, where `broken` stands among the `brokens` (0:
 * nothing broke), the count, and the first. */
#define THERE (UINT64_C(1) << 63)
#define BROKEN_BITS 13U
#define COUNT_BITS 18U
#define MOST_OUTCOMES ((1U << COUNT_BITS) - 1U)

/* A move by the schedule: who, and the schedule's bits after it. */
typedef struct {
  uint32_t actor, number; /* of its moves */
  uint64_t later;         /* ticks from now */
  bool lost, first;       /* first release of a plant: reads more than its bits */
  bool ends;              /* the instant is over then */
  bool seen;              /* what comes of it is observable */
} plan;

typedef struct {
  uint32_t first, count; /* plans, with `words` of schedule bits each */
  uint64_t ample, enabled;
  bool observable;
  bool over;     /* nobody moves any more */
  uint32_t last; /* the last one of many configurations that has it, */
  uint64_t turn; /* and when that was */
} calendar;

/* Configurations as old as they are at some later time. */
typedef struct {
  uint64_t* packed; /* [OLDER * words] */
  uint64_t turn[OLDER];
  uint64_t later[OLDER];
} olders;

struct soter_memo {
  uint32_t words, actors;
  map* steps; /* [2 * actors]: 2a, and 2a + 1 for first releases */
  map when, owing;
  map seen[KINDS];
  list values, calendars, plans, bits, brokens, debts;
  uint64_t* clear;    /* [actors * words]: schedule and writes */
  uint64_t* judged;   /* [words]: what decides whether a configuration that is looked at violates */
  uint64_t* promised; /* [words]: and what is owed after it */
  uint64_t* own;      /* [words]: a configuration, when a step is made in it */
  bool* clocked;      /* [actors]: its steps read the schedule */
  bool* steady;       /* [actors]: or no time at all */
  bool promises;      /* some property has deadlines */
  olders older;
  uint64_t turn;   /* configurations expanded */
  uint64_t memory; /* most bytes of all this: beyond it, it is given up */
};

uint64_t soter_memo_bytes(const struct soter_memo* memo) {
  const list* const lists[] = {&memo->values, &memo->calendars, &memo->plans,
                               &memo->bits,   &memo->brokens,   &memo->debts};
  uint64_t bytes = map_bytes(&memo->when, memo->words) + map_bytes(&memo->owing, memo->words);
  for (uint32_t i = 0; i < KINDS; i++) {
    bytes += map_bytes(&memo->seen[i], memo->words);
  }
  for (uint32_t i = 0; i < sizeof lists / sizeof lists[0]; i++) {
    bytes += lists[i]->room * lists[i]->size;
  }
  for (uint32_t a = 0; a < 2U * memo->actors; a++) {
    bytes += map_bytes(&memo->steps[a], memo->words);
  }
  return bytes;
}

/* Whether a map may have one more entry; it may have to grow. */
static bool may_put(const struct soter_memo* memo, const map* m) {
  return m->used * 2U < m->slots ||
         soter_memo_bytes(memo) + 2U * map_bytes(m, memo->words) <= memo->memory;
}

/* False: there is no memory for more. */
static bool map_put(const struct soter_memo* memo, map* m, const uint64_t* packed,
                    const uint64_t* mask, uint64_t number) {
  const uint32_t words = memo->words;
  if (!may_put(memo, m) || (m->used * 2U >= m->slots && !map_grow(m, words))) {
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

/* ------------------------------------------------------------------ opening */

/* What of the model is asked for again and again. */
static void look_at_model(struct soter_memo* memo, const soter_model* m) {
  const uint32_t words = m->words;
  for (uint32_t a = 0; a < m->actors; a++) {
    const uint64_t* const reads = m->actor[a].reads;
    for (uint32_t k = 0; k < words; k++) {
      memo->clear[(size_t)a * words + k] = m->scheduled[k] | m->actor[a].writes[k];
      memo->clocked[a] = memo->clocked[a] || (reads[k] & m->scheduled[k]) != 0U;
    }
    memo->steady[a] = !memo->clocked[a];
    for (uint32_t i = 0; i < m->ageings; i++) {
      const soter_ageing* const g = &m->ageing[i];
      SOTER_CHECK(g->width > 0U && g->width < 64U);
      memo->steady[a] = memo->steady[a] && soter_get(reads, g->at, g->width) == 0U;
    }
  }
  for (uint32_t k = 0; k < words; k++) {
    memo->judged[k] = m->observed[k] | m->dues[k] | m->verdicts[k];
    memo->promised[k] = m->observed[k] | m->dues[k] | m->clock[k];
    memo->promises = memo->promises || m->dues[k] != 0U;
  }
}

static bool maps_open(struct soter_memo* memo, uint32_t words) {
  bool fine = map_open(&memo->when, words) && map_open(&memo->owing, words);
  for (uint32_t i = 0; fine && i < KINDS; i++) {
    fine = map_open(&memo->seen[i], words);
  }
  for (uint32_t a = 0; fine && a < 2U * memo->actors; a++) {
    fine = map_open(&memo->steps[a], words);
  }
  return fine;
}

struct soter_memo* soter_memo_open(soter_expander* e, uint64_t memory) {
  const soter_model* const m = e->place.m;
  const uint32_t words = m->words;
  struct soter_memo* const memo = calloc(1U, sizeof *memo);
  if (memo == NULL) {
    return NULL;
  }
  memo->words = words;
  memo->actors = m->actors;
  memo->memory = memory;
  memo->steps = calloc(2U * m->actors, sizeof *memo->steps);
  memo->clear = calloc((size_t)(m->actors + 3U + OLDER) * words, sizeof *memo->clear);
  memo->clocked = calloc(2U * m->actors, sizeof *memo->clocked);
  memo->values.size = words * sizeof(uint64_t);
  memo->calendars.size = sizeof(calendar);
  memo->plans.size = sizeof(plan);
  memo->bits.size = words * sizeof(uint64_t);
  memo->brokens.size = sizeof(soter_broken);
  memo->debts.size = words * sizeof(uint64_t);
  if (memo->steps == NULL || memo->clear == NULL || memo->clocked == NULL ||
      !maps_open(memo, words)) {
    soter_memo_close(memo);
    return NULL;
  }
  memo->steady = memo->clocked + m->actors;
  memo->judged = memo->clear + (size_t)m->actors * words;
  memo->promised = memo->judged + words;
  memo->own = memo->promised + words;
  memo->older.packed = memo->own + words;
  look_at_model(memo, m);
  return memo;
}

void soter_memo_close(struct soter_memo* memo) {
  if (memo == NULL) {
    return;
  }
  if (memo->steps != NULL) {
    for (uint32_t a = 0; a < 2U * memo->actors; a++) { /* those not opened have NULL pointers */
      map_close(&memo->steps[a], memo->words);
    }
  }
  map_close(&memo->when, memo->words);
  map_close(&memo->owing, memo->words);
  for (uint32_t i = 0; i < KINDS; i++) {
    map_close(&memo->seen[i], memo->words);
  }
  free(memo->steps);
  free(memo->clear);
  free(memo->clocked);
  list_close(&memo->values);
  list_close(&memo->calendars);
  list_close(&memo->plans);
  list_close(&memo->bits);
  list_close(&memo->brokens);
  list_close(&memo->debts);
  free(memo);
}

/* ------------------------------------------------------------------ time that passes */

/* What is packed of a field, so many ticks later. */
SPECIAL uint64_t aged(const soter_ageing* g, uint64_t x, uint64_t ticks) {
  if (g->kind == SOTER_SINCE) {
    return x + ticks < g->most ? x + ticks : g->most;
  }
  if (g->kind == SOTER_STAMP) {
    return x == 0U ? 0U : x + ticks;
  }
  return x <= 1U ? x : x - 2U < ticks ? 1U : x - ticks;
}

/* A configuration, so many ticks later, the schedule as it was. */
SPECIAL void make_older(const soter_model* m, const uint64_t* packed, uint64_t ticks, uint64_t* to,
                        const uint32_t words) {
  soter_copy_words(to, packed, words);
  for (uint32_t i = 0; i < m->ageings; i++) {
    const soter_ageing* const g = &m->ageing[i];
    const uint64_t before = soter_get(packed, g->at, g->width);
    const uint64_t change = before ^ aged(g, before, ticks);
    const uint64_t shift = g->at % 64U;
    SOTER_CHECK(change >> g->width == 0U && (g->at + g->width - 1U) / 64U < words);
    to[g->at / 64U] ^= change << shift;
    if (shift + g->width > 64U) {
      to[g->at / 64U + 1U] ^= change >> (64U - shift);
    }
  }
}

/* The configuration that is expanded, so many ticks later: several moves happen at one time. */
SPECIAL const uint64_t* aged_state(struct soter_memo* memo, const soter_model* m,
                                   const uint64_t* packed, uint64_t later, const uint32_t words) {
  if (later == 0U || m->ageings == 0U) {
    return packed;
  }
  olders* const o = &memo->older;
  const uint32_t i = (uint32_t)(later % OLDER);
  uint64_t* const to = o->packed + (size_t)i * words;
  if (o->turn[i] != memo->turn || o->later[i] != later) {
    make_older(m, packed, later, to, words);
    o->turn[i] = memo->turn;
    o->later[i] = later;
  }
  return to;
}

/* ------------------------------------------------------------------ computing */

static bool is_too_large(const struct soter_memo* memo) {
  return soter_memo_bytes(memo) > memo->memory;
}

static bool is_first(const soter_model* m, const soter_move* move) {
  const soter_actor* const a = &m->actor[move->actor];
  return (a->component & SOTER_INPUT) == 0U &&
         m->program->component[a->component].role == SOTER_ROLE_PLANT &&
         move->release == a->phase_ns;
}

/* The schedule after a move, whatever the step does, in `there`. */
static void schedule_after(soter_place* x, const soter_move* move) {
  const soter_model* const m = x->m;
  const uint32_t a = move->actor;
  (void)memcpy(x->there, x->here, x->size);
  soter_schedule_of(x->p, x->there)->now = move->time;
  soter_keep_others(x, x->there);
  soter_done_of(m, x->there)[a]++;
  SOTER_CHECK(a < m->actors);
  if (move->kind == SOTER_SKIPPED) {
    soter_lost_of(m, x->there)[a]++;
  } else if (m->actor[a].skips > 0U) {
    soter_lost_of(m, x->there)[a] = 0U;
  }
}

/* One more plan, number `n` of the actor's; false: there is no memory. */
static bool add_plan(soter_expander* e, struct soter_memo* memo, const soter_move* move,
                     uint32_t n) {
  soter_place* const x = &e->place;
  const soter_model* const m = x->m;
  const int64_t now = soter_schedule_of(x->p, x->here)->now;
  uint64_t after[SOTER_WORDS];
  schedule_after(x, move);
  m->pack(x->there, after);
  plan* const p = push(&memo->plans, 1U);
  uint64_t* const bits = push(&memo->bits, 1U);
  if (p == NULL || bits == NULL) {
    return false;
  }
  p->actor = move->actor;
  p->number = n;
  p->later = (uint64_t)((move->time - soter_later(now, 0)) / m->tick_ns);
  p->lost = move->kind == SOTER_SKIPPED;
  p->first = is_first(m, move);
  p->seen = soter_is_observable(x);
  p->ends = e->instant != NULL && p->seen;
  for (uint32_t k = 0; k < m->words; k++) {
    bits[k] = after[k] & m->scheduled[k];
  }
  return true;
}

/* Whether one more schedule is worth remembering, and there is room for it. */
static bool may_remember(struct soter_memo* memo) {
  return (memo->when.used < FEW || memo->when.used <= memo->turn / 2U) &&
         may_put(memo, &memo->when) && !is_too_large(memo);
}

/* Which moves there are in `here`, which is unpacked and looked at. False: there is no memory, or
 * schedules seldom come back, so that looking them up gains nothing; nothing is kept then, as it
 * would be asked for again and again. */
static bool compute_calendar(soter_expander* e, struct soter_memo* memo, const uint64_t* packed) {
  soter_place* const x = &e->place;
  const soter_model* const m = x->m;
  const int64_t now = soter_schedule_of(x->p, x->here)->now;
  const bool observable = now >= 0 && x->limit > now;
  const uint64_t enabled = soter_enabled(x);
  calendar c = {
      memo->plans.count, 0U, soter_ample(x, enabled), enabled, observable, enabled == 0U, 0U, 0U};
  bool fine = may_remember(memo);
  for (uint32_t a = 0; fine && a < m->actors; a++) {
    soter_move move;
    for (uint32_t n = 0; fine && soter_move_of(x, a, n, &move); n++) {
      fine = add_plan(e, memo, &move, n);
      c.count++;
    }
  }
  calendar* const to = fine ? push(&memo->calendars, 1U) : NULL;
  if (to == NULL) {
    return false;
  }
  *to = c;
  return map_put(memo, &memo->when, packed, m->scheduled, memo->calendars.count);
}

/* Where something that broke stands among the brokens, from 1 on; 0: there is no room for more. */
static uint64_t number_of(struct soter_memo* memo, const soter_broken* broken) {
  const soter_broken* const all = memo->brokens.item;
  for (uint32_t i = 0; i < memo->brokens.count; i++) {
    if (soter_same_broken(&all[i], broken)) {
      return i + 1U;
    }
  }
  const bool fits = memo->brokens.count + 1U < 1U << BROKEN_BITS;
  soter_broken* const to = fits ? push(&memo->brokens, 1U) : NULL;
  if (to == NULL) {
    return 0U;
  }
  *to = *broken;
  return memo->brokens.count;
}

/* As one number; 0: there is no room. */
static uint64_t effect_as_word(struct soter_memo* memo, const effect* found) {
  const uint64_t broken = found->broke ? number_of(memo, &found->broken) : 0U;
  SOTER_CHECK(found->count >> COUNT_BITS == 0U && COUNT_BITS + BROKEN_BITS < 32U);
  if (found->broke && broken == 0U) {
    return 0U;
  }
  return THERE | broken << (32U + COUNT_BITS) | (uint64_t)found->count << 32U | found->first;
}

SPECIAL effect effect_of_word(const struct soter_memo* memo, uint64_t number) {
  const uint64_t broken = number >> (32U + COUNT_BITS) & ((UINT64_C(1) << BROKEN_BITS) - 1U);
  effect found = {(uint32_t)number,
                  (uint32_t)(number >> 32U) & ((1U << COUNT_BITS) - 1U),
                  broken != 0U,
                  {0U, 0U}};
  if (found.broke) {
    found.broken = ((const soter_broken*)memo->brokens.item)[broken - 1U];
  }
  return found;
}

/* Whether there is an effect, and it breaks nothing. */
SPECIAL bool breaks_nothing(uint64_t number) {
  return number >> (32U + COUNT_BITS) == THERE >> (32U + COUNT_BITS);
}

/* Whether the same was written with other picks. */
static bool is_known(const struct soter_memo* memo, const effect* found, const uint64_t* value) {
  if (found->count > MANY) {
    return false; /* looking would take longer than taking it twice */
  }
  const uint64_t* const all =
      (const uint64_t*)memo->values.item + (size_t)found->first * memo->words;
  for (uint32_t o = 0; o < found->count; o++) {
    if (memcmp(all + (size_t)o * memo->words, value, memo->words * sizeof *value) == 0) {
      return true;
    }
  }
  return false;
}

/* Keeps what a step wrote into `there`; false: it did not leave everything else as it was when it
 * began (`before`), or there is no memory. Then the search does without this. */
static bool keep_outcome(soter_place* x, struct soter_memo* memo, const uint64_t* before,
                         uint32_t actor, effect* found) {
  const soter_model* const m = x->m;
  const uint64_t* const writes = m->actor[actor].writes;
  uint64_t after[SOTER_WORDS];
  m->pack(x->there, after);
  const bool fits = found->count < TOO_MANY && (found->count % 256U != 255U || !is_too_large(memo));
  uint64_t* const value = fits ? push(&memo->values, 1U) : NULL;
  if (value == NULL) {
    return false;
  }
  for (uint32_t k = 0; k < m->words; k++) {
    if (((after[k] ^ before[k]) & ~(writes[k] | m->dues[k])) != 0U) {
      return false;
    }
    value[k] = after[k] & writes[k];
  }
  if (is_known(memo, found, value)) {
    memo->values.count--;
  } else {
    found->count++;
  }
  SOTER_CHECK(found->first + found->count <= memo->values.count);
  return true;
}

/* An outcome that breaks something: the first that is not known is told. */
static void note_broken(const soter_place* x, effect* found, const soter_broken* broken) {
  if (!found->broke && !soter_is_known(x, broken)) {
    found->broken = *broken;
    found->broke = true;
  }
}

/* Whether the configuration after a move violates what is not known. */
static bool breaks_news(soter_place* x) {
  soter_broken broken;
  return soter_violates(x, &broken) && !soter_is_known(x, &broken);
}

/* Whether the next answer of a step is to be tried, too: of very many the rest need not be. */
static bool more_answers(const soter_expander* e, bool breaks) {
  return !breaks || e->go_on || e->place.tried < LONG;
}

/* Runs the step of a plan in `here` with all picks, and keeps what it writes; `before` is that
 * configuration when the step begins. Stopped, it keeps what it has: the search ends with that. */
static bool compute_effect(soter_expander* e, struct soter_memo* memo, const uint64_t* before,
                           const plan* p, map* steps) {
  soter_place* const x = &e->place;
  const soter_model* const m = x->m;
  effect found = {memo->values.count, 0U, false, {0U, 0U}};
  soter_move move;
  if (is_too_large(memo) || !soter_move_of(x, p->actor, p->number, &move)) {
    return false;
  }
  x->given = 0U;
  bool breaks = false; /* some outcome does */
  do {
    soter_broken broken;
    const uint32_t count = found.count;
    if (!soter_make(x, &move, &broken)) {
      note_broken(x, &found, &broken);
      breaks = breaks || found.broke;
      continue;
    }
    soter_cover(x, p->actor);
    if (!keep_outcome(x, memo, before, p->actor, &found)) {
      soter_tell_answers(x, true);
      return false;
    }
    breaks = breaks || (found.count > count && breaks_news(x));
  } while (more_answers(e, breaks) && soter_next_picks(x));
  soter_tell_answers(x, true);
  const uint64_t number = effect_as_word(memo, &found);
  return number != 0U && map_put(memo, steps, before, m->actor[p->actor].reads, number);
}

/* ------------------------------------------------------------------ expanding */

static bool give_up(soter_expander* e) {
  soter_memo_close(e->memo);
  e->memo = NULL;
  e->successors.count = e->begin;
  e->broke = false;
  return false;
}

/* Looked up, or computed; *unpacked says that `here` is this configuration then. */
SPECIAL calendar* calendar_of(soter_expander* e, const uint64_t* packed, const uint32_t words,
                              bool* unpacked) {
  struct soter_memo* const memo = e->memo;
  soter_place* const x = &e->place;
  const uint64_t* at = slot_of(&memo->when, packed, x->m->scheduled, words);
  if (at[words] == 0U) {
    x->m->unpack(packed, x->here);
    soter_look(x);
    *unpacked = true;
    if (!compute_calendar(e, memo, packed)) {
      return NULL;
    }
    at = slot_of(&memo->when, packed, x->m->scheduled, words);
  }
  return (calendar*)memo->calendars.item + (at[words] - 1U);
}

/* A configuration when the step of a plan begins. */
SPECIAL const uint64_t* state_at_step(const soter_model* m, const uint64_t* then,
                                      const uint64_t* bits, uint64_t* to, const uint32_t words) {
  for (uint32_t k = 0; k < words; k++) {
    to[k] = (then[k] & ~m->scheduled[k]) | bits[k];
  }
  return to;
}

/* What the step of a plan does to a configuration, `then` when it begins but for the schedule:
 * looked up or computed; folded; 0: it cannot be kept. */
SPECIAL uint64_t effect_of(soter_expander* e, const uint64_t* packed, const uint64_t* then,
                           const plan* p, const uint64_t* bits, const uint32_t words,
                           bool* unpacked) {
  struct soter_memo* const memo = e->memo;
  soter_place* const x = &e->place;
  const soter_model* const m = x->m;
  const uint64_t* const reads = m->actor[p->actor].reads;
  const uint64_t* const asked =
      memo->clocked[p->actor] ? state_at_step(m, then, bits, memo->own, words) : then;
  map* const steps = &memo->steps[2U * p->actor + (p->first ? 1U : 0U)];
  const uint64_t* slot = slot_of(steps, asked, reads, words);
  if (slot[words] == 0U) {
    if (!*unpacked) {
      m->unpack(packed, x->here);
      soter_look(x);
      *unpacked = true;
    }
    if (!compute_effect(e, memo, state_at_step(m, then, bits, memo->own, words), p, steps)) {
      return 0U;
    }
    slot = slot_of(steps, memo->own, reads, words);
  }
  SOTER_CHECK(slot[words] != 0U);
  return slot[words];
}

/* What properties owe in a configuration that is looked at, after a move led to it. */
static bool compute_debts(soter_expander* e, const uint64_t* successor) {
  struct soter_memo* const memo = e->memo;
  soter_place* const x = &e->place;
  const soter_model* const m = x->m;
  uint64_t after[SOTER_WORDS];
  m->unpack(successor, x->there);
  soter_keep_obligations(x);
  m->pack(x->there, after);
  uint64_t* const debts = push(&memo->debts, 1U);
  if (debts == NULL) {
    return false;
  }
  for (uint32_t k = 0; k < m->words; k++) {
    if (((after[k] ^ successor[k]) & ~m->dues[k]) != 0U) {
      return false;
    }
    debts[k] = after[k] & m->dues[k];
  }
  return map_put(memo, &memo->owing, successor, memo->promised, memo->debts.count);
}

SPECIAL bool keep_promises(soter_expander* e, uint64_t* successor, const uint32_t words) {
  struct soter_memo* const memo = e->memo;
  const uint64_t* const dues = e->place.m->dues;
  const uint64_t* slot = slot_of(&memo->owing, successor, memo->promised, words);
  if (slot[words] == 0U) {
    if (!compute_debts(e, successor)) {
      return false;
    }
    slot = slot_of(&memo->owing, successor, memo->promised, words);
  }
  const uint64_t* const debts =
      (const uint64_t*)memo->debts.item + (size_t)(slot[words] - 1U) * words;
  for (uint32_t k = 0; k < words; k++) {
    successor[k] = (successor[k] & ~dues[k]) | debts[k];
  }
  return true;
}

/* The successors by a step: schedule's bits, and what was written. False: there is no memory, or no
 * room for so many at once. */
SPECIAL bool add_outcomes(soter_expander* e, const uint64_t* then, const plan* p,
                          const uint64_t* bits, const effect* done, uint64_t asleep,
                          const uint32_t words) {
  const struct soter_memo* const memo = e->memo;
  const uint64_t* const clear = memo->clear + (size_t)p->actor * words;
  const uint64_t* value = (const uint64_t*)memo->values.item + (size_t)done->first * words;
  const bool owes = p->seen && memo->promises;
  if (done->broke) {
    e->broken = e->broke ? e->broken : done->broken;
    e->broke = true;
    e->transitions++;
  }
  if ((uint64_t)(e->successors.count + done->count) * words * sizeof *value > e->memory) {
    return false;
  }
  for (uint32_t o = 0; o < done->count; o++) {
    uint64_t* const successor = soter_next_successor(e, asleep);
    if (successor == NULL) {
      return false;
    }
    for (uint32_t k = 0; k < words; k++) {
      successor[k] = (then[k] & ~clear[k]) | bits[k] | value[k];
    }
    if (owes && !keep_promises(e, successor, words)) {
      return false;
    }
    value += words;
    e->transitions++;
  }
  return true;
}

/* The successor by a release that is lost: only the schedule's bits change, and what time changes.
 */
SPECIAL bool add_lost(soter_expander* e, const uint64_t* then, const plan* p, const uint64_t* bits,
                      uint64_t asleep, const uint32_t words) {
  uint64_t* const successor = soter_next_successor(e, asleep);
  e->transitions++;
  if (successor == NULL) {
    return false;
  }
  (void)state_at_step(e->place.m, then, bits, successor, words);
  return !p->seen || !e->memo->promises || keep_promises(e, successor, words);
}

/* The successors by one plan. `last` is what the step of `of`, the plan before, did: where no time
 * is read, it does the same whenever it happens. */
SPECIAL bool follow(soter_expander* e, const uint64_t* packed, const plan* p, const uint64_t* bits,
                    uint64_t asleep, const plan* of, uint64_t* last, const uint32_t words,
                    bool* unpacked) {
  struct soter_memo* const memo = e->memo;
  const uint64_t* const then = aged_state(memo, e->place.m, packed, p->later, words);
  if (p->lost) {
    return add_lost(e, then, p, bits, asleep, words);
  }
  const bool again = *last != 0U && of->actor == p->actor && memo->steady[p->actor];
  SOTER_CHECK(!again || of->first == p->first);
  if (!again) {
    *last = effect_of(e, packed, then, p, bits, words, unpacked);
  }
  const effect done = effect_of_word(memo, *last);
  return *last != 0U && add_outcomes(e, then, p, bits, &done, asleep, words);
}

/* Whose moves are enough, of some actors. */
static uint64_t wanted_of(const soter_expander* e, const calendar* c, uint64_t only) {
  const bool fewer = (e->reduce & SOTER_REDUCE_AMPLE) != 0U;
  return soter_in_order(e->place.m, only & (fewer ? c->ample : c->enabled));
}

SPECIAL bool expand(soter_expander* e, const uint64_t* packed, uint64_t sleep, uint64_t only,
                    const uint32_t words) {
  struct soter_memo* const memo = e->memo;
  bool unpacked = false;
  memo->turn++;
  const calendar* const known = calendar_of(e, packed, words, &unpacked);
  if (known == NULL) {
    return give_up(e);
  }
  const calendar c = *known;
  const uint64_t wanted = wanted_of(e, &c, only) & ~sleep;
  uint64_t before = 0U;
  plan of = {0};
  uint64_t last = 0U;
  for (uint32_t i = 0; i < c.count; i++) {
    const plan p = ((const plan*)memo->plans.item)[c.first + i];
    const uint64_t self = UINT64_C(1) << p.actor;
    SOTER_CHECK(p.actor < memo->actors);
    if ((wanted & self) == 0U) {
      continue;
    }
    const uint64_t asleep = p.ends ? SOTER_AT_END
                            : (e->reduce & SOTER_REDUCE_SLEEP) != 0U
                                ? soter_still_asleep(e->place.m, p.actor, sleep, before & ~self)
                                : 0U;
    before |= self;
    const uint64_t* const bits = (const uint64_t*)memo->bits.item + (size_t)(c.first + i) * words;
    if (!follow(e, packed, &p, bits, asleep, &of, &last, words, &unpacked)) {
      return e->no_memory || give_up(e);
    }
    of = p.lost ? of : p;
  }
  return true;
}

bool soter_memo_expand(soter_expander* e, const uint64_t* packed, uint64_t sleep, uint64_t only) {
  switch (e->memo->words) {
    case 1:
      return expand(e, packed, sleep, only, 1U);
    case 2:
      return expand(e, packed, sleep, only, 2U);
    default:
      return expand(e, packed, sleep, only, e->memo->words);
  }
}

/* ------------------------------------------------------------------ many configurations at once */

/* Configurations of a word that have one calendar make the same moves: one move after the other is
 * followed from all of them. The machine foresees that; which calendar comes next it does not. */
typedef struct {
  uint64_t configuration[SOTER_BATCH];
  uint64_t then[SOTER_BATCH]; /* when the move begins, but for the schedule */
  uint64_t did[SOTER_BATCH];  /* what the step does, folded, */
  uint64_t successors;        /* and how many come of it */
  uint32_t count;
} batch;

/* All of them, so many ticks later. */
static void make_batch_older(const soter_model* m, batch* q, uint64_t ticks) {
  (void)memcpy(q->then, q->configuration, q->count * sizeof q->then[0]);
  for (uint32_t k = 0; ticks > 0U && k < m->ageings; k++) {
    const soter_ageing g = m->ageing[k];
    const uint64_t bits = (UINT64_C(1) << g.width) - 1U;
    SOTER_CHECK(g.width < 64U && g.at + g.width <= 64U);
    for (uint32_t i = 0; i < q->count; i++) {
      const uint64_t before = q->then[i] >> g.at & bits;
      const uint64_t change = before ^ aged(&g, before, ticks);
      SOTER_CHECK(change <= bits);
      q->then[i] ^= change << g.at;
    }
  }
}

/* What the step of a plan does to each; false: it cannot be kept. */
static bool find_effects(soter_expander* e, batch* q, const plan* p, const uint64_t* bits) {
  struct soter_memo* const memo = e->memo;
  const soter_model* const m = e->place.m;
  const bool clocked = memo->clocked[p->actor];
  const uint64_t kept = clocked ? ~m->scheduled[0] : UINT64_MAX;
  const uint64_t added = clocked ? *bits : 0U;
  const uint64_t* const reads = m->actor[p->actor].reads;
  const map* const steps = &memo->steps[2U * p->actor + (p->first ? 1U : 0U)];
  q->successors = 0U;
  for (uint32_t i = 0; i < q->count; i++) {
    const uint64_t asked = (q->then[i] & kept) | added;
    uint64_t did = slot_of(steps, &asked, reads, 1U)[1];
    if (did == 0U) {
      bool unpacked = false;
      did = effect_of(e, q->configuration + i, q->then + i, p, bits, 1U, &unpacked);
    }
    if (did == 0U) {
      return false;
    }
    q->did[i] = did;
    q->successors += did >> 32U & MOST_OUTCOMES;
    if (!breaks_nothing(did)) {
      e->broken = e->broke ? e->broken : effect_of_word(memo, did).broken;
      e->broke = true;
      e->transitions++;
    }
  }
  return true;
}

/* The successors by a step, of all; false: there is no memory, or they are too many. */
static bool add_batch(soter_expander* e, const batch* q, const plan* p, uint64_t bits) {
  const struct soter_memo* const memo = e->memo;
  const uint64_t clear = memo->clear[p->actor];
  const uint64_t* const values = memo->values.item;
  uint64_t* successor = soter_next_successors(e, q->successors);
  for (uint32_t i = 0; successor != NULL && i < q->count; i++) {
    const uint64_t rest = (q->then[i] & ~clear) | bits;
    const uint64_t* const value = values + (uint32_t)q->did[i];
    const uint32_t outcomes = (uint32_t)(q->did[i] >> 32U) & MOST_OUTCOMES;
    for (uint32_t o = 0; o < outcomes; o++) {
      *successor++ = rest | value[o];
    }
  }
  return successor != NULL;
}

/* The successors by a release that is lost. */
static bool add_batch_lost(soter_expander* e, const batch* q, uint64_t bits) {
  const uint64_t clear = e->place.m->scheduled[0];
  uint64_t* const successor = soter_next_successors(e, q->count);
  for (uint32_t i = 0; successor != NULL && i < q->count; i++) {
    successor[i] = (q->then[i] & ~clear) | bits;
  }
  return successor != NULL;
}

/* All successors of a batch; false: there is no memory, or they are too many. */
static bool follow_batch(soter_expander* e, batch* q, const calendar* c) {
  const struct soter_memo* const memo = e->memo;
  const plan* const plans = (const plan*)memo->plans.item + c->first;
  const uint64_t* const bits = (const uint64_t*)memo->bits.item + c->first;
  const uint64_t wanted = wanted_of(e, c, UINT64_MAX);
  uint32_t of = SOTER_NOTHING; /* whose step `did` is */
  bool fine = true;
  for (uint32_t k = 0; fine && k < c->count; k++) {
    const plan* const p = &plans[k];
    if ((wanted >> p->actor & 1U) == 0U) {
      continue;
    }
    make_batch_older(e->place.m, q, p->later);
    if (p->lost) {
      fine = add_batch_lost(e, q, bits[k]);
      continue;
    }
    if (of != p->actor || !memo->steady[of]) {
      of = p->actor;
      fine = find_effects(e, q, p, bits + k);
    }
    fine = fine && add_batch(e, q, p, bits[k]);
  }
  return fine;
}

/* The calendars of configurations: each is linked with the next that has the same. False: there is
 * none for some. */
static bool find_batchs(soter_expander* e, const uint64_t* packed, uint32_t count, uint32_t* when,
                        uint32_t* next) {
  struct soter_memo* const memo = e->memo;
  for (uint32_t i = 0; i < count; i++) {
    bool unpacked = false;
    calendar* const c = calendar_of(e, packed + i, 1U, &unpacked);
    if (c == NULL) {
      return false;
    }
    when[i] = SOTER_NOTHING;
    next[i] = SOTER_NOTHING;
    if (c->turn == memo->turn) {
      next[c->last] = i;
    } else {
      when[i] = (uint32_t)(c - (const calendar*)memo->calendars.item);
    }
    c->turn = memo->turn;
    c->last = i;
  }
  return true;
}

bool soter_memo_expand_batch(soter_expander* e, const uint64_t* packed, uint32_t count) {
  struct soter_memo* const memo = e->memo;
  const uint64_t transitions = e->transitions;
  uint32_t when[SOTER_BATCH]; /* of the first one of a batch */
  uint32_t next[SOTER_BATCH];
  batch q;
  SOTER_CHECK(e->instant == NULL && (e->reduce & SOTER_REDUCE_SLEEP) == 0U);
  if (memo == NULL || memo->words != 1U || memo->promises) {
    return false;
  }
  e->begin = e->successors.count;
  e->broke = false;
  memo->turn += count;
  bool fine = find_batchs(e, packed, count, when, next);
  for (uint32_t i = 0; fine && i < count; i++) {
    q.count = 0U;
    for (uint32_t k = when[i] != SOTER_NOTHING ? i : count; k < count; k = next[k]) {
      q.configuration[q.count++] = packed[k];
    }
    fine = q.count == 0U || follow_batch(e, &q, (const calendar*)memo->calendars.item + when[i]);
  }
  if (!fine) {
    e->successors.count = e->begin;
    e->transitions = transitions;
    e->broke = false;
  }
  return fine;
}

/* Whether a configuration violates something, which follows from the bits of `decides`: looked up
 * in `seen`, or judged. */
SPECIAL effect judged(soter_expander* e, const uint64_t* packed, map* seen, const uint64_t* decides,
                      const uint32_t words) {
  struct soter_memo* const memo = e->memo;
  soter_place* const x = &e->place;
  const uint64_t* const at = slot_of(seen, packed, decides, words);
  if (at[words] != 0U) {
    return effect_of_word(memo, at[words]);
  }
  effect found = {0U, 0U, false, {0U, 0U}};
  x->m->unpack(packed, x->there);
  found.broke = soter_violates(x, &found.broken);
  const uint64_t number = effect_as_word(memo, &found);
  (void)(number != 0U && map_put(memo, seen, packed, decides, number));
  return found;
}

/* Whether anything is observed, and whether something is due at the end, depends on the schedule;
 * what is violated then on what properties read and on what they know of the past. */
SPECIAL bool is_broken(soter_expander* e, const uint64_t* packed, soter_broken* broken,
                       const uint32_t words) {
  struct soter_memo* const memo = e->memo;
  soter_place* const x = &e->place;
  bool unpacked = false;
  const calendar* const c = calendar_of(e, packed, words, &unpacked);
  if (c == NULL) {
    x->m->unpack(packed, x->there);
    return soter_violates(x, broken);
  }
  if (!c->observable && !memo->promises) {
    return false;
  }
  const uint32_t sight = !c->observable ? 0U : c->over ? 2U : 1U;
  const uint64_t* const decides = c->observable ? memo->judged : x->m->dues;
  const effect found = judged(e, packed, &memo->seen[sight], decides, words);
  *broken = found.broken;
  return found.broke;
}

bool soter_memo_broken(soter_expander* e, const uint64_t* packed, soter_broken* broken) {
  return e->memo->words == 1U ? is_broken(e, packed, broken, 1U)
                              : is_broken(e, packed, broken, e->memo->words);
}

/* Whether a configuration is known to violate nothing, by its calendar. */
SPECIAL bool is_fine(const struct soter_memo* memo, const calendar* c, const uint64_t* packed) {
  if (!c->observable) {
    return true;
  }
  return breaks_nothing(slot_of(&memo->seen[c->over ? 2U : 1U], packed, memo->judged, 1U)[1]);
}

uint32_t soter_memo_fine(const soter_expander* e, const uint64_t* packed, uint32_t count) {
  const struct soter_memo* const memo = e->memo;
  const uint64_t* const scheduled = e->place.m->scheduled;
  const calendar* c = NULL;
  uint64_t last = 0U; /* the schedule of the one before: most have the same */
  bool fine = memo != NULL && memo->words == 1U && !memo->promises;
  uint32_t i = 0U;
  while (fine && i < count) {
    if (c == NULL || (packed[i] & *scheduled) != last) {
      const uint64_t number = slot_of(&memo->when, packed + i, scheduled, 1U)[1];
      c = number != 0U ? (const calendar*)memo->calendars.item + (number - 1U) : NULL;
      last = packed[i] & *scheduled;
    }
    fine = c != NULL && is_fine(memo, c, packed + i);
    i += fine;
  }
  return i;
}
