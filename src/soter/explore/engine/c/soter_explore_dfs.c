/* soter_explore_dfs.c: depth first.
 *
 * Purpose: all configurations with little more memory than the table: the stack holds the way and
 * what is still to be tried beside it. Also, with a bound on the depth, one round of iterative
 * deepening. Non-goals: shortest traces (breadth first, or deepening).
 */
#include "soter_explore_dfs.h"

#define LOOK 32768U /* successors between two looks at the bounds */

static bool take_away(void* to);

bool soter_stack_open(soter_stack* t, soter_search* s) {
  (void)memset(t, 0, sizeof *t);
  t->s = s;
  t->words = t->row.words = s->m->words;
  t->row.width = t->words + 2U;
  t->beyond = SOTER_NO_DEADLINE;
  const bool fine = soter_expander_open(&t->expander, s, s->coverage, s->o->memory / 4U) &&
                    soter_store_open(&t->store, s->m, s->o->storage,
                                     soter_keeps_sleep(&t->expander), 0U, s->o->memory);
  t->store.stop = &s->progress->stop;
  t->expander.spill = take_away;
  t->expander.to = t;
  s->result->needed_bytes = soter_store_bytes(&t->store);
  return fine;
}

void soter_stack_close(soter_stack* t) {
  soter_expander_close(&t->expander);
  soter_store_close(&t->store);
  soter_row_close(&t->row);
}

static bool out_of_bounds(soter_stack* t) {
  soter_search* const s = t->s;
  const uint64_t table = soter_store_bytes(&t->store);
  const uint64_t bytes = table + soter_row_bytes(&t->row) + soter_expander_bytes(&t->expander);
  const uint64_t left = s->o->memory > bytes ? s->o->memory - bytes : 0U;
  t->store.memory = table + left;
  soter_instant_allow(t->expander.instant, left / 2U);
  s->progress->bytes = bytes;
  if (s->progress->stop != 0) {
    t->status = SOTER_STOPPED;
  } else if (t->full || t->expander.no_memory || bytes > s->o->memory) {
    t->status = SOTER_MEMORY;
  } else if (t->expander.place.too_many) {
    t->status = SOTER_CHOOSY;
  } else if (s->o->max_states > 0U && t->states >= s->o->max_states) {
    t->status = SOTER_STATES;
  }
  return t->status != SOTER_EXHAUSTED;
}

/* Takes a configuration in: what has to be expanded lies on top of the stack then. */
static void take_in(soter_stack* t, const uint64_t* packed, uint64_t sleep) {
  uint64_t again = 0U;
  soter_copy_words(t->stored, packed, t->words);
  soter_fold(t->s->o, t->stored); /* on the stack it stays as it came: that is a way */
  const int fresh = soter_store_put(&t->store, t->stored, &sleep, &again);
  if (fresh < 0) {
    t->full = true;
    return;
  }
  if (fresh == 0 && again == 0U) {
    return;
  }
  SOTER_CHECK(fresh == 0 || again == 0U);
  if (fresh == 1) {
    soter_broken broken;
    t->states++;
    if (soter_is_broken(&t->expander, packed, &broken)) {
      if (!t->broke && !soter_is_known(&t->expander.place, &broken)) {
        t->broke = true;
        t->broken = broken;
        t->by_a_move = false;
        (void)memcpy(t->last, packed, t->words * sizeof *packed);
      }
      return;
    }
  }
  t->full = t->full || !soter_row_put(&t->row, packed, sleep, fresh == 1 ? UINT64_MAX : again);
}

/* The way: those entries of the stack that were expanded and have not been left. They are marked.
 */
#define ON_THE_WAY UINT64_C(0)

static bool write_way(soter_stack* t) {
  soter_search* const s = t->s;
  soter_place x;
  if (s->trace == NULL || !soter_place_open(&x, s->m, s->o, s->progress, NULL)) {
    return false;
  }
  const uint64_t* before = NULL;
  uint32_t written = 0U;
  bool fine = true;
  for (uint64_t i = 0; fine && i < t->row.count; i++) {
    const uint64_t* const here = soter_row_at(&t->row, i);
    if (here[t->words + 1U] != ON_THE_WAY) {
      continue;
    }
    fine = soter_find_way(s, &x, before, here, NULL, &written);
    before = here;
  }
  if (fine) {
    const uint64_t* const last = t->by_a_move ? NULL : t->last;
    fine = soter_find_way(s, &x, before, last, t->by_a_move ? &t->broken : NULL, &written);
  }
  soter_place_close(&x);
  s->result->length = fine ? written : 0U;
  return fine;
}

static bool found(const soter_stack* t) {
  return t->broke && !t->s->o->go_on;
}

/* How many steps the longest execution seen has. */
static uint32_t steps_of(soter_stack* t) {
  const bool ends = t->expander.instant != NULL && t->deepest > 0U;
  return ends ? soter_steps_until(t->s->m, t->s->o, &t->calendar, t->deepest - 1U) + 1U
              : t->deepest;
}

/* Tells how far it is, and whether it goes on. */
static bool look(soter_stack* t) {
  soter_search* const s = t->s;
  s->progress->states = t->states;
  s->progress->transitions = t->expander.transitions;
  s->progress->depth = steps_of(t);
  t->taken = 0U;
  return !out_of_bounds(t);
}

/* Every now and then; whether it is stopped, always. */
static bool go_on(soter_stack* t) {
  const bool now = (++t->turns & 1023U) == 0U || t->taken >= LOOK || t->s->progress->stop != 0;
  return !now || look(t);
}

/* The successors of a configuration lie on the stack then, the first one on top; false: no more are
 * wanted.
 */
static bool take_away(void* to) {
  soter_stack* const t = to;
  const soter_successors* const h = &t->expander.successors;
  t->taken += h->count;
  for (uint32_t k = h->count; k > 0U && !found(t) && !t->full; k--) {
    take_in(t, h->packed + (size_t)(k - 1U) * t->words, h->sleep[k - 1U]);
  }
  soter_forget(&t->expander);
  return !found(t) && !t->full && (t->taken < LOOK || look(t));
}

/* Expands the configuration on top of the stack, which is on the way now. */
static void expand_top(soter_stack* t, uint64_t* top) {
  const uint64_t sleep = top[t->words];
  const uint64_t only = top[t->words + 1U];
  soter_copy_words(t->here, top, t->words); /* the stack may move */
  top[t->words + 1U] = ON_THE_WAY;
  soter_forget(&t->expander);
  soter_expand_next(&t->expander, t->here, sleep, only);
  if (t->expander.broke && !t->broke) {
    t->broke = true;
    t->broken = t->expander.broken;
    t->by_a_move = true;
  }
  (void)take_away(t);
}

/* Whether successors of the configuration just expanded may be missing: the search ends there, as
 * no later one may hide it. */
static bool is_cut(soter_stack* t) {
  if (t->status == SOTER_EXHAUSTED && (t->full || t->expander.no_memory)) {
    t->status = SOTER_MEMORY;
  }
  return t->status != SOTER_EXHAUSTED;
}

void soter_stack_run(soter_stack* t, uint32_t bound) {
  uint32_t depth = 0U;
  soter_expand_birth(&t->expander);
  (void)take_away(t);
  while (t->row.count > 0U && !found(t)) {
    uint64_t* const top = soter_row_at(&t->row, t->row.count - 1U);
    if (top[t->words + 1U] == ON_THE_WAY) {
      SOTER_CHECK(depth > 0U);
      t->row.count--;
      depth--;
      continue;
    }
    if (!go_on(t)) {
      return;
    }
    if (depth >= bound) {
      t->cut = true;
      t->beyond = soter_earlier(t->beyond, soter_time_of(t->s->m, top));
      t->row.count--;
      continue;
    }
    depth++;
    t->deepest = depth > t->deepest ? depth : t->deepest;
    expand_top(t, top);
    if (found(t)) {
      (void)write_way(t);
      return;
    }
    if (is_cut(t)) {
      return;
    }
  }
}

/* Before which time everything was observed. */
static int64_t covered(const soter_stack* t) {
  const soter_model* const m = t->s->m;
  if (t->status == SOTER_EXHAUSTED) {
    return t->beyond;
  }
  int64_t time = t->deepest > 0U ? soter_time_of(m, t->here) : -1; /* perhaps not to its end */
  for (uint64_t i = 0; i < t->row.count; i++) {
    const uint64_t* const item = soter_row_at(&t->row, i);
    if (item[t->words + 1U] != ON_THE_WAY) {
      time = soter_earlier(time, soter_time_of(m, item));
    }
  }
  return soter_earlier(time, t->beyond);
}

void soter_stack_sum_up(soter_stack* t, soter_explore_result* r) {
  if (t->status == SOTER_EXHAUSTED) { /* what ends between two looks at the bounds */
    const bool full = t->full || t->expander.no_memory;
    t->status = t->expander.place.cut        ? SOTER_STOPPED
                : full                       ? SOTER_MEMORY
                : t->expander.place.too_many ? SOTER_CHOOSY
                                             : t->status;
  }
  r->covered_ns = soter_later(r->covered_ns, covered(t));
  r->status = t->broke ? SOTER_VIOLATED : t->status;
  r->broken = t->broken;
  r->states += t->states;
  r->transitions += t->expander.transitions;
  r->depth = steps_of(t);
  r->chooser = t->expander.place.chooser;
  r->threads = 1U;
  r->table_bytes = soter_store_bytes(&t->store);
  r->frontier_bytes = soter_row_bytes(&t->row);
  r->memo_bytes = soter_expander_bytes(&t->expander);
}

void soter_search_dfs(soter_search* s) {
  soter_stack t;
  if (soter_stack_open(&t, s)) {
    soter_stack_run(&t, UINT32_MAX);
    soter_stack_sum_up(&t, s->result);
  } else {
    s->result->status = SOTER_NO_MEMORY;
  }
  const bool keep = s->o->keep && s->o->storage == SOTER_EXACT;
  s->result->kept = keep ? soter_keep(NULL, &t.store) : NULL;
  soter_stack_close(&t);
}
