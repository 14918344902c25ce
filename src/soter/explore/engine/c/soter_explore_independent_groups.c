/* soter_explore_independent_groups.c: what a group of actors does in an instant, remembered.
 *
 * Purpose: the actors that are due at an instant fall into groups that share nothing in it. What a
 * group may have written when the instant is over depends on the packed bits that its steps may
 * read: its orders and choices are run through once for every value of these, and the ends of the
 * instant are all combinations of what the groups may write. Off unless SOTER_REDUCE_GROUPS is set.
 * docs/testing.md argues in "Groups within an instant" that these are all ends.
 * Non-goals: models where steps are not remembered; lost releases.
 */
#include "soter_explore_successors.h"

#define FIRST_SLOTS UINT64_C(64)
#define FEW 1024U /* runs of a group, before it is asked whether they come back */

/* Words, and behind them a number; 0: an empty slot. */
typedef struct {
  uint64_t* slot;
  uint64_t slots, used;
} table;

typedef struct {
  uint64_t actors, firsts; /* of these it is the first step: a plant's reads more than its bits */
  uint64_t* reads;         /* [words] */
  uint64_t* writes;        /* [words] */
  table known;             /* masked configuration: outcome, from 1 */
  uint64_t asked, ran;     /* how often that was looked up, and how often in vain */
} group;

/* What one group may have written: `count` times `words`, from `first` on. */
typedef struct {
  uint64_t first;
  uint32_t count;
  bool broke;
  soter_broken broken;
} outcome;

/* What an instant is, by the schedule: its groups, and the schedule's bits after it. */
typedef struct {
  uint64_t* after; /* [words] */
  uint64_t* clear; /* [words]: what is written in it */
  uint32_t groups;
  uint32_t group[SOTER_ACTORS];
} instant;

struct soter_groups {
  uint32_t words;
  table when;
  instant* instants;
  group* group;
  outcome* outcome;
  uint64_t* value;
  uint64_t instant_count, group_count, outcome_count, value_count;
  uint64_t outcome_room, value_room;
  table scratch;
  soter_row here, next; /* the middle of an instant, step by step */
  uint64_t* ones;       /* [words] */
  uint64_t memory;
};

bool soter_in_groups(const soter_model* m, const soter_explore_options* o) {
  bool ok = m->plain && !o->plainly && m->timeds == 0U && soter_by_instants(m, o) &&
            (o->reduce & SOTER_REDUCE_GROUPS) != 0U;
  for (uint32_t i = 0; i < m->actors; i++) {
    ok = ok && m->actor[i].skips == 0U;
  }
  return ok;
}

static bool table_open(table* t, uint32_t words) {
  t->slots = FIRST_SLOTS;
  t->used = 0U;
  t->slot = calloc(t->slots * (words + 1U), sizeof *t->slot);
  return t->slot != NULL;
}

/* Few entries are followed by few: clearing should not take longer than putting. */
static void table_clear(table* t, uint32_t words) {
  const uint64_t slots = t->slots / 4U;
  uint64_t* const less = slots >= FIRST_SLOTS && t->used * 16U < t->slots
                             ? realloc(t->slot, slots * (words + 1U) * sizeof *t->slot)
                             : NULL;
  t->slot = less != NULL ? less : t->slot;
  t->slots = less != NULL ? slots : t->slots;
  (void)memset(t->slot, 0, t->slots * (words + 1U) * sizeof *t->slot);
  t->used = 0U;
}

static uint64_t* slot_of(const table* t, uint32_t words, const uint64_t* packed,
                         const uint64_t* mask) {
  SOTER_CHECK(t->used < t->slots && (t->slots & (t->slots - 1U)) == 0U);
  for (uint64_t i = soter_hash(packed, mask, words) & (t->slots - 1U);;
       i = (i + 1U) & (t->slots - 1U)) {
    uint64_t* const at = t->slot + i * (words + 1U);
    bool same = true;
    for (uint32_t k = 0; k < words; k++) {
      same = same && at[k] == (packed[k] & mask[k]);
    }
    if (same || at[words] == 0U) {
      return at;
    }
  }
}

static bool table_grow(table* t, uint32_t words, const uint64_t* ones) {
  table larger = {NULL, t->slots * 2U, t->used};
  larger.slot = calloc(larger.slots * (words + 1U), sizeof *larger.slot);
  if (larger.slot == NULL) {
    return false;
  }
  for (uint64_t i = 0; i < t->slots; i++) {
    const uint64_t* const from = t->slot + i * (words + 1U);
    if (from[words] != 0U) {
      soter_copy_words(slot_of(&larger, words, from, ones), from, words + 1U);
    }
  }
  free(t->slot);
  *t = larger;
  return true;
}

/* 1 if it is new, 0 if it was there, -1 if there is no memory. */
static int table_put(table* t, const struct soter_groups* q, const uint64_t* packed,
                     const uint64_t* mask, uint64_t number) {
  if (t->used * 2U >= t->slots && !table_grow(t, q->words, q->ones)) {
    return -1;
  }
  uint64_t* const at = slot_of(t, q->words, packed, mask);
  if (at[q->words] != 0U) {
    return 0;
  }
  for (uint32_t k = 0; k < q->words; k++) {
    at[k] = packed[k] & mask[k];
  }
  SOTER_CHECK(number != 0U);
  at[q->words] = number;
  t->used++;
  return 1;
}

struct soter_groups* soter_groups_open(const soter_model* m, uint64_t memory) {
  struct soter_groups* const q = calloc(1U, sizeof *q);
  if (q == NULL) {
    return NULL;
  }
  q->words = q->here.words = q->next.words = q->here.width = q->next.width = m->words;
  q->memory = memory;
  q->ones = malloc(m->words * sizeof *q->ones);
  const bool ok = table_open(&q->when, m->words) && table_open(&q->scratch, m->words);
  if (!ok || q->ones == NULL) {
    soter_groups_close(q);
    return NULL;
  }
  (void)memset(q->ones, 0xff, m->words * sizeof *q->ones);
  return q;
}

void soter_groups_close(struct soter_groups* q) {
  if (q == NULL) {
    return;
  }
  for (uint64_t i = 0; i < q->instant_count; i++) {
    free(q->instants[i].after); /* and `clear`, behind it */
  }
  for (uint64_t i = 0; i < q->group_count; i++) {
    free(q->group[i].reads); /* and `writes`, behind it */
    free(q->group[i].known.slot);
  }
  free(q->when.slot);
  free(q->scratch.slot);
  soter_row_close(&q->here);
  soter_row_close(&q->next);
  free(q->instants);
  free(q->group);
  free(q->outcome);
  free(q->value);
  free(q->ones);
  free(q);
}

uint64_t soter_groups_bytes(const struct soter_groups* q) {
  if (q == NULL) {
    return 0U;
  }
  uint64_t slots = q->when.slots + q->scratch.slots;
  for (uint64_t i = 0; i < q->group_count; i++) {
    slots += q->group[i].known.slots;
  }
  return slots * (q->words + 1U) * sizeof(uint64_t) + q->outcome_room * sizeof *q->outcome +
         q->value_room * q->words * sizeof *q->value + soter_row_bytes(&q->here) +
         soter_row_bytes(&q->next);
}

/* Forgets what groups do; which groups there are it keeps. */
static void forget(struct soter_groups* q) {
  for (uint64_t i = 0; i < q->group_count; i++) {
    table_clear(&q->group[i].known, q->words);
  }
  q->outcome_count = q->value_count = 0U;
}

/* What its actors read and write; where one reads of the schedule, all of that is read. */
static void add_masks(const group* g, const soter_model* m) {
  bool timed = false;
  for (uint32_t k = 0; k < m->words; k++) {
    for (uint32_t i = 0; i < m->actors; i++) {
      const uint64_t in = (g->actors >> i & 1U) != 0U ? UINT64_MAX : 0U;
      g->reads[k] |= m->actor[i].reads[k] & in;
      g->writes[k] |= m->actor[i].writes[k] & in;
    }
    timed = timed || (g->reads[k] & m->scheduled[k]) != 0U;
  }
  for (uint32_t k = 0; timed && k < m->words; k++) {
    g->reads[k] |= m->scheduled[k];
  }
}

/* The number of a group, from 0; new ones are added. SOTER_NOTHING: no memory. */
static uint32_t group_of(struct soter_groups* q, const soter_model* m, uint64_t actors,
                         uint64_t firsts) {
  const uint32_t words = q->words;
  for (uint32_t i = 0; i < q->group_count; i++) {
    if (q->group[i].actors == actors && q->group[i].firsts == firsts) {
      return i;
    }
  }
  group* const all = realloc(q->group, (q->group_count + 1U) * sizeof *all);
  q->group = all != NULL ? all : q->group;
  uint64_t* const masks = calloc(2U * words, sizeof *masks);
  group g = {actors, firsts, masks, masks == NULL ? NULL : masks + words, {NULL, 0U, 0U}, 0U, 0U};
  if (all == NULL || masks == NULL || !table_open(&g.known, words)) {
    free(masks);
    return SOTER_NOTHING;
  }
  add_masks(&g, m);
  q->group[q->group_count] = g;
  return (uint32_t)q->group_count++;
}

/* Splits those who are due in `here` into groups. */
static bool split(struct soter_groups* q, const soter_workspace* space, uint64_t due, instant* n) {
  const soter_model* const m = space->m;
  while (due != 0U) {
    uint64_t set = due & (~due + 1U);
    uint64_t firsts = 0U;
    for (uint64_t before = 0U; before != set;) {
      before = set;
      for (uint32_t i = 0; i < m->actors; i++) {
        set |= (before >> i & 1U) != 0U ? m->actor[i].dependent & due : 0U;
      }
    }
    for (uint32_t i = 0; i < m->actors; i++) {
      const bool is_first = (set >> i & 1U) != 0U && soter_done_of(m, space->here)[i] == 0U;
      firsts |= is_first ? UINT64_C(1) << i : 0U;
    }
    const uint32_t g = group_of(q, m, set, firsts);
    if (g == SOTER_NOTHING) {
      return false;
    }
    SOTER_CHECK(n->groups < SOTER_ACTORS && (due & set) == set);
    n->group[n->groups++] = g;
    due &= ~set;
  }
  return true;
}

/* The instant after an end that is unpacked in `here`, added. */
static const instant* add_instant(struct soter_groups* q, soter_workspace* space,
                                  const uint64_t* packed) {
  const soter_model* const m = space->m;
  const uint32_t words = q->words;
  instant* const all = realloc(q->instants, (q->instant_count + 1U) * sizeof *all);
  q->instants = all != NULL ? all : q->instants;
  uint64_t* const masks = calloc(2U * words, sizeof *masks);
  if (all == NULL || masks == NULL) {
    free(masks);
    return NULL;
  }
  instant* const n = &q->instants[q->instant_count];
  (void)memset(n, 0, sizeof *n);
  n->after = masks;
  n->clear = masks + words;
  q->instant_count++;
  const uint64_t due = soter_enabled_actors(space);
  if (!split(q, space, due, n)) {
    return NULL;
  }
  (void)memcpy(space->there, space->here, space->size);
  soter_schedule_of(space->p, space->there)->now = due == 0U ? 0 : space->limit;
  soter_keep_others(space, space->there);
  for (uint32_t i = 0; i < m->actors; i++) {
    soter_done_of(m, space->there)[i] += due >> i & 1U;
  }
  SOTER_CHECK(soter_is_observable(space));
  m->pack(space->there, n->after);
  for (uint32_t k = 0; k < words; k++) {
    n->after[k] &= m->scheduled[k];
    n->clear[k] = m->scheduled[k];
    for (uint32_t g = 0; g < n->groups; g++) {
      n->clear[k] |= q->group[n->group[g]].writes[k];
    }
  }
  return table_put(&q->when, q, packed, m->scheduled, q->instant_count) < 0 ? NULL : n;
}

static const instant* instant_of(soter_expander* expander, const uint64_t* packed) {
  struct soter_groups* const q = expander->groups;
  if (soter_groups_bytes(q) > q->memory / 2U) {
    forget(q);
  }
  soter_workspace* const space = &expander->space;
  const uint64_t* const at = slot_of(&q->when, q->words, packed, space->m->scheduled);
  if (at[q->words] != 0U) {
    return &q->instants[at[q->words] - 1U];
  }
  space->m->unpack(packed, space->here);
  soter_find_windows(space);
  return add_instant(q, space, packed);
}

/* New successors, from number `first`, go to `next`. */
static void take_successors(soter_expander* expander, uint32_t first) {
  struct soter_groups* const q = expander->groups;
  soter_successors* const h = &expander->successors;
  SOTER_CHECK(first <= h->count);
  for (uint32_t k = first; k < h->count && !expander->no_memory; k++) {
    const uint64_t* const packed = h->packed + (size_t)k * q->words;
    const int fresh = table_put(&q->scratch, q, packed, q->ones, 1U);
    expander->no_memory = fresh < 0 || (fresh == 1 && !soter_row_put(&q->next, packed, 0U, 0U));
  }
  h->count = first;
}

/* Steps that have so many successors are not remembered. */
static bool no_more(void* to) {
  (void)to;
  return false;
}

/* One step further: the successors of all configurations in `here` by this group go to `next`. */
static bool run_step(soter_expander* expander, uint64_t actors, outcome* found) {
  struct soter_groups* const q = expander->groups;
  const uint32_t first = expander->successors.count;
  table_clear(&q->scratch, q->words);
  q->next.count = 0U;
  for (uint64_t i = 0; i < q->here.count && !expander->no_memory; i++) {
    if (soter_is_to_end(expander)) {
      return false;
    }
    soter_expand(expander, soter_row_at(&q->here, i), 0U, actors);
    if (expander->cache == NULL) {
      expander->successors.count = first;
      return false;
    }
    if (expander->broke && !found->broke) {
      found->broke = true;
      found->broken = expander->broken;
    }
    take_successors(expander, first);
    expander->no_memory = expander->no_memory || soter_groups_bytes(q) > q->memory;
  }
  return !expander->no_memory;
}

/* Keeps what is written in the configurations of `here`. */
static bool keep_values(struct soter_groups* q, const group* g, outcome* found) {
  const uint32_t words = q->words;
  table_clear(&q->scratch, words);
  found->first = q->value_count;
  for (uint64_t i = 0; i < q->here.count; i++) {
    const uint64_t* const packed = soter_row_at(&q->here, i);
    const int fresh = table_put(&q->scratch, q, packed, g->writes, 1U);
    if (q->value_count == q->value_room) {
      const uint64_t room = q->value_room == 0U ? 256U : q->value_room * 2U;
      uint64_t* const value = realloc(q->value, room * words * sizeof *value);
      if (value == NULL) {
        return false;
      }
      q->value = value;
      q->value_room = room;
    }
    if (fresh < 0) {
      return false;
    }
    for (uint32_t k = 0; fresh == 1 && k < words; k++) {
      q->value[q->value_count * words + k] = packed[k] & g->writes[k];
    }
    q->value_count += (uint64_t)fresh;
    found->count += (uint32_t)fresh;
  }
  return true;
}

static bool keep_outcome(struct soter_groups* q, const outcome* found) {
  if (q->outcome_count == q->outcome_room) {
    const uint64_t room = q->outcome_room == 0U ? 64U : q->outcome_room * 2U;
    outcome* const all = realloc(q->outcome, room * sizeof *all);
    if (all == NULL) {
      return false;
    }
    q->outcome = all;
    q->outcome_room = room;
  }
  q->outcome[q->outcome_count++] = *found;
  return true;
}

/* Runs a group through the instant, and remembers what it does. */
static bool run_group(soter_expander* expander, uint32_t number, const uint64_t* packed) {
  struct soter_groups* const q = expander->groups;
  outcome found = {0U, 0U, false, {0U, 0U}};
  const uint32_t reduce = expander->reduce;
  const uint64_t actors = q->group[number].actors;
  bool (*const spill)(void* to) = expander->spill;
  bool ok = true;
  q->here.count = 0U;
  expander->reduce = 0U; /* all orders within the group */
  expander->spill = no_more;
  ok = soter_row_put(&q->here, packed, 0U, 0U);
  for (int step = 0; ok && step < __builtin_popcountll(actors); step++) {
    ok = run_step(expander, actors, &found);
    const soter_row swap = q->here;
    q->here = q->next;
    q->next = swap;
  }
  expander->reduce = reduce;
  expander->spill = spill;
  group* const g = &q->group[number];
  if (!ok || expander->cache == NULL) {
    expander->no_memory = expander->no_memory || (!expander->space.cut && expander->cache != NULL);
    return false;
  }
  ok = keep_values(q, g, &found) && keep_outcome(q, &found) &&
       table_put(&g->known, q, packed, g->reads, q->outcome_count) == 1;
  expander->no_memory = expander->no_memory || !ok;
  return ok;
}

/* Where one combination goes, as a successor; false: no more are wanted. */
static bool add_end(soter_expander* expander, const uint64_t* packed, const instant* n,
                    const outcome* const* done, const uint32_t* at) {
  const struct soter_groups* const q = expander->groups;
  const uint32_t words = q->words;
  uint64_t* const successor = soter_next_successor(expander, 0U);
  for (uint32_t k = 0; successor != NULL && k < words; k++) {
    successor[k] = (packed[k] & ~n->clear[k]) | n->after[k];
    for (uint32_t i = 0; i < n->groups; i++) {
      successor[k] |= q->value[(done[i]->first + at[i]) * words + k];
    }
  }
  expander->transitions++;
  expander->combined++;
  SOTER_CHECK(n->groups <= SOTER_ACTORS);
  const bool many = expander->successors.count >= expander->most && expander->spill != NULL;
  return successor != NULL && (!many || expander->spill(expander->to));
}

/* All combinations of what the groups may write. */
static void combine(soter_expander* expander, const uint64_t* packed, const instant* n,
                    const outcome* const* done) {
  uint32_t at[SOTER_ACTORS] = {0U};
  uint32_t g = 0U;
  for (uint32_t i = 0; i < n->groups; i++) {
    if (done[i]->count == 0U) {
      return; /* a group that always fails */
    }
  }
  while (g < n->groups) {
    if (!add_end(expander, packed, n, done, at)) {
      return;
    }
    for (g = 0U; g < n->groups && ++at[g] == done[g]->count; g++) {
      at[g] = 0U;
    }
  }
}

/* Whether what some group does is seldom asked again: running it apart gains nothing then, and what
 * the reductions leave out of an instant is left out of no group. */
static bool is_vain(const struct soter_groups* q, const instant* n) {
  for (uint32_t i = 0; i < n->groups; i++) {
    const group* const g = &q->group[n->group[i]];
    if (g->ran >= FEW && g->ran > g->asked / 4U) {
      return true;
    }
  }
  return false;
}

/* Numbers of the outcomes of all groups, looked up or computed. */
static bool look_up(soter_expander* expander, const uint64_t* packed, const instant* n,
                    uint64_t* number) {
  const struct soter_groups* const q = expander->groups;
  for (uint32_t i = 0; i < n->groups; i++) {
    group* const g = &q->group[n->group[i]];
    const uint64_t* at = slot_of(&g->known, q->words, packed, g->reads);
    g->asked++;
    if (at[q->words] == 0U) {
      g->ran++;
      if (!run_group(expander, n->group[i], packed)) {
        return false;
      }
      at = slot_of(&g->known, q->words, packed, g->reads);
    }
    number[i] = at[q->words] - 1U;
    SOTER_CHECK(number[i] < q->outcome_count);
  }
  return true;
}

bool soter_groups_expand(soter_expander* expander, const uint64_t* packed) {
  struct soter_groups* const q = expander->groups;
  const outcome* done[SOTER_ACTORS];
  uint64_t number[SOTER_ACTORS];
  if (expander->cache == NULL) {
    return false; /* what was remembered of steps was not enough */
  }
  const instant* const n = instant_of(expander, packed);
  if (n == NULL) {
    expander->no_memory = true;
    return true;
  }
  if (is_vain(q, n)) {
    return false;
  }
  bool broke = false;
  soter_broken broken = {0U, 0U};
  if (!look_up(expander, packed, n, number)) {
    return expander->cache != NULL; /* interrupted, or no memory */
  }
  for (uint32_t i = 0; i < n->groups; i++) {
    done[i] = &q->outcome[number[i]];
    broken = !broke && done[i]->broke ? done[i]->broken : broken;
    broke = broke || done[i]->broke;
  }
  combine(expander, packed, n, done);
  expander->broke = broke;
  expander->broken = broke ? broken : expander->broken;
  return true;
}
