/* soter_explore_memo.c: steps that are run once for every value of what they read.
 *
 * Purpose: in a `plain` model a step depends on the packed bits of its actor's `reads` and changes
 * only those of its `writes`; which moves there are depends on the schedule's bits alone. Both are
 * looked up: a move is then a few operations on packed words. What is looked up was computed by
 * the program's own steps on an unpacked world (soter_explore_step.c).
 * Non-goals: models where times matter.
 */
#include "soter_explore_in.h"

#define FIRST_SLOTS 1024U
#define WIDE 32U /* words: fewer slots then */
#define MOST_SLOTS (UINT32_C(1) << 22)
#define EMPTY UINT32_MAX
#define MANY 1024U      /* outcomes of a step that are compared with each other, */
#define TOO_MANY 65536U /* and that are remembered */
#define LONG 4096U      /* answers of a step: a violation need not wait for the rest */

/* One way that a step may end: it breaks something, or these bits of `writes` are the new ones. */
typedef struct {
  uint32_t first, count; /* outcomes: in `value`, `count` times `words` */
  bool broke;
  soter_broken broken;
} effect;

/* A move by the schedule: who, and the schedule's bits after it. */
typedef struct {
  uint32_t actor;
  bool lost, first; /* first release of a plant: reads more than its bits */
} plan;

typedef struct {
  uint32_t first, count; /* plans, with `words` of schedule bits each */
  uint64_t ample;
  bool observable;
} calendar;

/* A map from masked packed words to a number. */
typedef struct {
  uint64_t* key;
  uint32_t* number;
  uint32_t slots, used;
} map;

typedef struct {
  void* item;
  uint32_t count, room;
  size_t size;
} list;

struct soter_memo {
  uint32_t words, actors;
  map* steps; /* [2 * actors]: 2a, and 2a + 1 for first releases */
  map when, seen;
  list effects, values, calendars, plans, bits, verdicts;
  uint64_t* clear; /* [actors * words]: schedule and writes */
  uint64_t memory; /* most bytes of all this: beyond it, it is given up */
};

/* ------------------------------------------------------------------ lists and maps */

static void* push(list* l, uint32_t many) {
  if (l->count + many > l->room) {
    uint32_t room = l->room == 0U ? 256U : l->room * 2U;
    while (room < l->count + many) {
      room *= 2U;
    }
    void* const item = soter_regrow(l->item, l->room * l->size, room * l->size);
    if (item == NULL) {
      return NULL;
    }
    l->item = item;
    l->room = room;
  }
  void* const found = (char*)l->item + l->count * l->size;
  l->count += many;
  SOTER_CHECK(l->count <= l->room && l->size > 0U);
  return found;
}

static bool map_open(map* m, uint32_t words) {
  m->slots = words > WIDE ? FIRST_SLOTS / 64U : FIRST_SLOTS;
  m->used = 0U;
  m->key = soter_take((uint64_t)m->slots * words * sizeof *m->key);
  m->number = soter_take(m->slots * sizeof *m->number);
  if (m->key == NULL || m->number == NULL) {
    return false;
  }
  (void)memset(m->number, 0xff, m->slots * sizeof *m->number);
  return true;
}

static void map_close(map* m, uint32_t words) {
  soter_give(m->key, (uint64_t)m->slots * words * sizeof *m->key);
  soter_give(m->number, m->slots * sizeof *m->number);
}

static void list_close(list* l) {
  soter_give(l->item, l->room * l->size);
}

/* The slot of a key: where it stands, or where it would. */
SOTER_INLINE uint32_t slot_of(const map* m, const uint64_t* packed, const uint64_t* mask,
                              uint32_t words) {
  SOTER_CHECK(m->used < m->slots);
  uint64_t h = (packed[0] & mask[0]) * UINT64_C(0x9e3779b97f4a7c15);
  for (uint32_t k = 1; k < words; k++) {
    h = (h ^ (h >> 29) ^ (packed[k] & mask[k])) * UINT64_C(0x9e3779b97f4a7c15);
  }
  uint32_t i = (uint32_t)(h >> 32) & (m->slots - 1U);
  while (m->number[i] != EMPTY) {
    bool same = true;
    for (uint32_t k = 0; k < words; k++) {
      same = same && m->key[(size_t)i * words + k] == (packed[k] & mask[k]);
    }
    if (same) {
      return i;
    }
    i = (i + 1U) & (m->slots - 1U);
  }
  return i;
}

static bool map_grow(map* m, uint32_t words) {
  uint64_t ones[SOTER_WORDS];
  (void)memset(ones, 0xff, words * sizeof ones[0]);
  map larger = *m;
  larger.slots = m->slots * 2U;
  if (larger.slots > MOST_SLOTS) {
    return false;
  }
  larger.key = soter_take((uint64_t)larger.slots * words * sizeof *larger.key);
  larger.number = soter_take(larger.slots * sizeof *larger.number);
  if (larger.key == NULL || larger.number == NULL) {
    map_close(&larger, words);
    return false;
  }
  (void)memset(larger.number, 0xff, larger.slots * sizeof *larger.number);
  for (uint32_t i = 0; i < m->slots; i++) {
    if (m->number[i] != EMPTY) {
      const uint64_t* const key = m->key + (size_t)i * words;
      const uint32_t to = slot_of(&larger, key, ones, words);
      (void)memcpy(larger.key + (size_t)to * words, key, words * sizeof *key);
      larger.number[to] = m->number[i];
    }
  }
  map_close(m, words);
  *m = larger;
  return true;
}

static uint64_t map_bytes(const struct soter_memo* memo, const map* m) {
  return (uint64_t)m->slots * (memo->words * sizeof *m->key + sizeof *m->number);
}

uint64_t soter_memo_bytes(const struct soter_memo* memo) {
  const list* const lists[] = {&memo->effects, &memo->values, &memo->calendars,
                               &memo->plans,   &memo->bits,   &memo->verdicts};
  uint64_t bytes = map_bytes(memo, &memo->when) + map_bytes(memo, &memo->seen);
  for (uint32_t i = 0; i < sizeof lists / sizeof lists[0]; i++) {
    bytes += lists[i]->room * lists[i]->size;
  }
  for (uint32_t a = 0; a < 2U * memo->actors; a++) {
    bytes += map_bytes(memo, &memo->steps[a]);
  }
  return bytes;
}

/* False: there is no memory for more. */
static bool map_put(const struct soter_memo* memo, map* m, const uint64_t* packed,
                    const uint64_t* mask, uint32_t number) {
  const uint32_t words = memo->words;
  if (m->used * 2U >= m->slots &&
      (soter_memo_bytes(memo) + 2U * map_bytes(memo, m) > memo->memory || !map_grow(m, words))) {
    return false;
  }
  const uint32_t i = slot_of(m, packed, mask, words);
  for (uint32_t k = 0; k < words; k++) {
    m->key[(size_t)i * words + k] = packed[k] & mask[k];
  }
  SOTER_CHECK(m->number[i] == EMPTY && number != EMPTY);
  m->number[i] = number;
  m->used++;
  return true;
}

/* ------------------------------------------------------------------ opening */

/* All maps, and what each step clears. */
static bool maps_open(struct soter_memo* memo, const soter_model* m) {
  bool fine = memo->steps != NULL && memo->clear != NULL;
  for (uint32_t a = 0; fine && a < 2U * m->actors; a++) {
    fine = map_open(&memo->steps[a], m->words);
  }
  for (uint32_t a = 0; fine && a < m->actors; a++) {
    for (uint32_t k = 0; k < m->words; k++) {
      memo->clear[(size_t)a * m->words + k] = m->scheduled[k] | m->actor[a].writes[k];
    }
  }
  return fine && map_open(&memo->when, m->words) && map_open(&memo->seen, m->words);
}

struct soter_memo* soter_memo_open(soter_expander* e, uint64_t memory) {
  const soter_model* const m = e->place.m;
  struct soter_memo* const memo = calloc(1U, sizeof *memo);
  if (memo == NULL) {
    return NULL;
  }
  memo->words = m->words;
  memo->actors = m->actors;
  memo->memory = memory;
  memo->steps = calloc(2U * m->actors, sizeof *memo->steps);
  memo->clear = calloc((size_t)m->actors * m->words, sizeof *memo->clear);
  const bool fine = maps_open(memo, m);
  memo->effects.size = sizeof(effect);
  memo->values.size = m->words * sizeof(uint64_t);
  memo->calendars.size = sizeof(calendar);
  memo->plans.size = sizeof(plan);
  memo->bits.size = m->words * sizeof(uint64_t);
  memo->verdicts.size = sizeof(effect);
  if (!fine) {
    soter_memo_close(memo);
    return NULL;
  }
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
  map_close(&memo->seen, memo->words);
  free(memo->steps);
  free(memo->clear);
  list_close(&memo->effects);
  list_close(&memo->values);
  list_close(&memo->calendars);
  list_close(&memo->plans);
  list_close(&memo->bits);
  list_close(&memo->verdicts);
  free(memo);
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

/* Which moves there are in `here`, which is unpacked and looked at. */
static bool compute_calendar(soter_expander* e, struct soter_memo* memo, const uint64_t* packed) {
  soter_place* const x = &e->place;
  const soter_model* const m = x->m;
  const int64_t now = soter_schedule_of(x->p, x->here)->now;
  const bool observable = now >= 0 && x->limit > now;
  calendar c = {memo->plans.count, 0U, soter_ample(x, soter_enabled(x)), observable};
  for (uint32_t a = 0; a < m->actors; a++) {
    soter_move move;
    for (uint32_t n = 0; soter_move_of(x, a, n, &move); n++) {
      uint64_t after[SOTER_WORDS];
      /* the schedule after it, whatever the step does */
      (void)memcpy(x->there, x->here, x->size);
      soter_schedule_of(x->p, x->there)->now = move.time;
      soter_keep_others(x, x->there);
      soter_done_of(m, x->there)[a]++;
      if (move.kind == SOTER_SKIPPED) {
        soter_lost_of(m, x->there)[a]++;
      } else if (m->actor[a].skips > 0U) {
        soter_lost_of(m, x->there)[a] = 0U;
      }
      m->pack(x->there, after);
      plan* const p = push(&memo->plans, 1U);
      uint64_t* const bits = push(&memo->bits, 1U);
      if (p == NULL || bits == NULL) {
        return false;
      }
      p->actor = a;
      p->lost = move.kind == SOTER_SKIPPED;
      p->first = is_first(m, &move);
      for (uint32_t k = 0; k < m->words; k++) {
        bits[k] = after[k] & m->scheduled[k];
      }
      c.count++;
    }
  }
  calendar* const to = push(&memo->calendars, 1U);
  if (to == NULL) {
    return false;
  }
  *to = c;
  return map_put(memo, &memo->when, packed, m->scheduled, memo->calendars.count - 1U);
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

/* Keeps what a step wrote into `there`; false: it wrote what the model says it does not, or there
 * is no memory. Then the search does without this. */
static bool keep_outcome(soter_place* x, struct soter_memo* memo, const uint64_t* packed,
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
    const uint64_t may = m->scheduled[k] | writes[k];
    if (((after[k] ^ packed[k]) & ~may) != 0U) {
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

/* Runs the step of a plan in `here` with all picks, and keeps what it writes. Stopped, it keeps
 * what it has: the search ends with that. */
/* An outcome that breaks something: the first that is not known is told. */
static void note_broken(const soter_place* x, effect* found, const soter_broken* broken) {
  if (!found->broke && !soter_is_known(x, broken)) {
    found->broken = *broken;
    found->broke = true;
  }
}

/* Whether the world after a move violates what is not known. */
static bool breaks_news(soter_place* x) {
  soter_broken broken;
  return soter_violates(x, &broken) && !soter_is_known(x, &broken);
}

/* Whether the next answer of a step is to be tried, too: of very many the rest need not be. */
static bool more_answers(const soter_expander* e, bool breaks) {
  return !breaks || e->go_on || e->place.tried < LONG;
}

static bool compute_effect(soter_expander* e, struct soter_memo* memo, const uint64_t* packed,
                           const plan* p, map* steps) {
  soter_place* const x = &e->place;
  const soter_model* const m = x->m;
  effect found = {memo->values.count, 0U, false, {0U, 0U}};
  soter_move move;
  if (is_too_large(memo) || !soter_move_of(x, p->actor, 0U, &move)) {
    return false;
  }
  x->given = 0U;
  bool breaks = false; /* some outcome does */
  do {
    soter_broken broken;
    const uint32_t before = found.count;
    if (!soter_make(x, &move, &broken)) {
      note_broken(x, &found, &broken);
      breaks = breaks || found.broke;
      continue;
    }
    soter_cover(x, p->actor);
    if (!keep_outcome(x, memo, packed, p->actor, &found)) {
      soter_tell_answers(x, true);
      return false;
    }
    breaks = breaks || (found.count > before && breaks_news(x));
  } while (more_answers(e, breaks) && soter_next_picks(x));
  soter_tell_answers(x, true);
  effect* const to = push(&memo->effects, 1U);
  if (to == NULL) {
    return false;
  }
  *to = found;
  return map_put(memo, steps, packed, m->actor[p->actor].reads, memo->effects.count - 1U);
}

/* ------------------------------------------------------------------ expanding */

static bool give_up(soter_expander* e) {
  soter_memo_close(e->memo);
  e->memo = NULL;
  e->heirs.count = e->begin;
  e->broke = false;
  return false;
}

/* Looked up, or computed; *unpacked says that `here` is this world then. */
SOTER_INLINE const calendar* calendar_of(soter_expander* e, const uint64_t* packed,
                                         const uint32_t words, bool* unpacked) {
  struct soter_memo* const memo = e->memo;
  soter_place* const x = &e->place;
  uint32_t at = slot_of(&memo->when, packed, x->m->scheduled, words);
  if (memo->when.number[at] == EMPTY) {
    x->m->unpack(packed, x->here);
    soter_look(x);
    *unpacked = true;
    if (!compute_calendar(e, memo, packed)) {
      return NULL;
    }
    at = slot_of(&memo->when, packed, x->m->scheduled, words);
  }
  return (const calendar*)memo->calendars.item + memo->when.number[at];
}

/* What the step of a plan does to this world, looked up or computed; NULL: it cannot be kept. */
SOTER_INLINE const effect* effect_of(soter_expander* e, const uint64_t* packed, const plan* p,
                                     const uint32_t words, bool* unpacked) {
  struct soter_memo* const memo = e->memo;
  soter_place* const x = &e->place;
  const uint64_t* const reads = x->m->actor[p->actor].reads;
  map* const steps = &memo->steps[2U * p->actor + (p->first ? 1U : 0U)];
  uint32_t slot = slot_of(steps, packed, reads, words);
  if (steps->number[slot] == EMPTY) {
    if (!*unpacked) {
      x->m->unpack(packed, x->here);
      soter_look(x);
      *unpacked = true;
    }
    if (!compute_effect(e, memo, packed, p, steps)) {
      return NULL;
    }
    slot = slot_of(steps, packed, reads, words);
  }
  SOTER_CHECK(steps->number[slot] < memo->effects.count);
  return (const effect*)memo->effects.item + steps->number[slot];
}

/* The heirs by a step: schedule's bits, and what was written. False: there is no memory, or no room
 * for so many at once. */
SOTER_INLINE bool add_outcomes(soter_expander* e, const uint64_t* packed, const plan* p,
                               const uint64_t* bits, const effect* done, uint64_t asleep,
                               const uint32_t words) {
  const struct soter_memo* const memo = e->memo;
  const uint64_t* const clear = memo->clear + (size_t)p->actor * words;
  const uint64_t* value = (const uint64_t*)memo->values.item + (size_t)done->first * words;
  if (done->broke) {
    e->broken = e->broke ? e->broken : done->broken;
    e->broke = true;
    e->transitions++;
  }
  if ((uint64_t)(e->heirs.count + done->count) * words * sizeof *value > e->memory) {
    return false;
  }
  for (uint32_t o = 0; o < done->count; o++) {
    uint64_t* const heir = soter_next_heir(e, asleep);
    if (heir == NULL) {
      return false;
    }
    for (uint32_t k = 0; k < words; k++) {
      heir[k] = (packed[k] & ~clear[k]) | bits[k] | value[k];
    }
    value += words;
    e->transitions++;
  }
  return true;
}

/* The heir by a release that is lost: only the schedule's bits change. */
SOTER_INLINE bool add_lost(soter_expander* e, const uint64_t* packed, const uint64_t* bits,
                           uint64_t asleep, const uint32_t words) {
  const uint64_t* const scheduled = e->place.m->scheduled;
  uint64_t* const heir = soter_next_heir(e, asleep);
  for (uint32_t k = 0; heir != NULL && k < words; k++) {
    heir[k] = (packed[k] & ~scheduled[k]) | bits[k];
  }
  e->transitions++;
  return heir != NULL;
}

SOTER_INLINE bool expand(soter_expander* e, const uint64_t* packed, uint64_t sleep, uint64_t only,
                         const uint32_t words) {
  struct soter_memo* const memo = e->memo;
  bool unpacked = false;
  const calendar* const known = calendar_of(e, packed, words, &unpacked);
  if (known == NULL) {
    return give_up(e);
  }
  const calendar c = *known;
  const uint64_t ample = (e->reduce & SOTER_REDUCE_AMPLE) != 0U ? c.ample : UINT64_MAX;
  const uint64_t wanted = only & ~sleep & ample;
  uint64_t before = 0U;
  for (uint32_t i = 0; i < c.count; i++) {
    const plan p = ((const plan*)memo->plans.item)[c.first + i];
    const uint64_t self = UINT64_C(1) << p.actor;
    SOTER_CHECK(p.actor < memo->actors);
    if ((wanted & self) == 0U) {
      continue;
    }
    const uint64_t asleep = (e->reduce & SOTER_REDUCE_SLEEP) != 0U
                                ? soter_still_asleep(e->place.m, p.actor, sleep, before & ~self)
                                : 0U;
    before |= self;
    const effect* const done = p.lost ? NULL : effect_of(e, packed, &p, words, &unpacked);
    if (!p.lost && done == NULL) {
      return give_up(e);
    }
    const uint64_t* const bits = (const uint64_t*)memo->bits.item + (size_t)(c.first + i) * words;
    if (p.lost ? !add_lost(e, packed, bits, asleep, words)
               : !add_outcomes(e, packed, &p, bits, done, asleep, words)) {
      return e->no_memory || give_up(e);
    }
  }
  return true;
}

bool soter_memo_expand(soter_expander* e, const uint64_t* packed, uint64_t sleep, uint64_t only) {
  return e->memo->words == 1U ? expand(e, packed, sleep, only, 1U)
                              : expand(e, packed, sleep, only, e->memo->words);
}

/* Whether anything is observed depends on the schedule, what is on the bits of `observed`. */
SOTER_INLINE bool is_broken(soter_expander* e, const uint64_t* packed, soter_broken* broken,
                            const uint32_t words) {
  struct soter_memo* const memo = e->memo;
  soter_place* const x = &e->place;
  const soter_model* const m = x->m;
  bool unpacked = false;
  const calendar* const c = calendar_of(e, packed, words, &unpacked);
  if (c != NULL && !c->observable) {
    return false;
  }
  const uint32_t at = slot_of(&memo->seen, packed, m->observed, words);
  if (c != NULL && memo->seen.number[at] != EMPTY) {
    const effect* const known = (const effect*)memo->verdicts.item + memo->seen.number[at];
    *broken = known->broken;
    return known->broke;
  }
  effect found = {0U, 0U, false, {0U, 0U}};
  m->unpack(packed, x->there);
  found.broke = soter_violates(x, &found.broken);
  effect* const to = c != NULL ? push(&memo->verdicts, 1U) : NULL;
  if (to != NULL) {
    *to = found;
    if (!map_put(memo, &memo->seen, packed, m->observed, memo->verdicts.count - 1U)) {
      memo->verdicts.count--;
    }
  }
  *broken = found.broken;
  return found.broke;
}

bool soter_memo_broken(soter_expander* e, const uint64_t* packed, soter_broken* broken) {
  return e->memo->words == 1U ? is_broken(e, packed, broken, 1U)
                              : is_broken(e, packed, broken, e->memo->words);
}
