/* soter_explore_depth_first_trace.c: a way to a violation, depth first.
 *
 * Purpose: the links of a breadth-first search may take more memory than the search that needed
 * none; a stack holds the way and what is still to be tried beside it, and no more than a table is
 * needed besides. Non-goals: shortest traces (soter_explore_shortest_trace.c); verdicts, which
 * breadth-first search gives.
 */
#include "soter_explore_internal.h"

#define LOOK 32768U /* successors between two looks at the bounds */

typedef struct {
  soter_search* s;
  soter_expander expander;
  soter_store store;
  soter_row row; /* which moves: none left for those on the way */
  uint32_t words;
  uint64_t states, turns;
  uint64_t taken; /* successors since the bounds were looked at */
  bool full, broke, by_a_move;
  bool over; /* stopped, out of memory, or a step has too many choices */
  soter_broken broken;
  uint64_t last[SOTER_WORDS]; /* the configuration that violates */
  uint64_t here[SOTER_WORDS]; /* the one that is expanded */
} stack;

static bool take_away(void* to);

static bool open_stack(stack* t, soter_search* s) {
  (void)memset(t, 0, sizeof *t);
  t->s = s;
  t->words = t->row.words = s->m->words;
  t->row.width = t->words + 2U;
  const bool ok = soter_expander_open(&t->expander, s, s->coverage, s->o->memory / 4U) &&
                  soter_store_open(&t->store, s->m, s->o->storage, soter_keeps_sleep(&t->expander),
                                   0U, s->o->memory);
  t->store.stop = &s->progress->stop;
  t->expander.spill = take_away;
  t->expander.to = t;
  return ok;
}

static void close_stack(stack* t) {
  soter_expander_close(&t->expander);
  soter_store_close(&t->store);
  soter_row_close(&t->row);
}

/* Takes a configuration in: what has to be expanded lies on top of the stack then. */
static void take_in(stack* t, const uint64_t* packed, uint64_t sleep) {
  uint64_t again = 0U;
  const int fresh = soter_store_put(&t->store, packed, &sleep, &again);
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
      if (!t->broke && !soter_is_known(&t->expander.space, &broken)) {
        t->broke = true;
        t->broken = broken;
        (void)memcpy(t->last, packed, t->words * sizeof *packed);
      }
      return;
    }
  }
  t->full = t->full || !soter_row_put(&t->row, packed, sleep, fresh == 1 ? UINT64_MAX : again);
}

/* The way: those entries of the stack that were expanded and not left. They are marked. */
#define ON_THE_WAY UINT64_C(0)

static void write_way(stack* t) {
  soter_search* const s = t->s;
  soter_workspace space;
  const uint64_t* before = NULL;
  uint32_t written = 0U;
  bool ok = soter_workspace_open(&space, s->m, s->o, s->progress, NULL);
  for (uint64_t i = 0; ok && i < t->row.count; i++) {
    const uint64_t* const here = soter_row_at(&t->row, i);
    if (here[t->words + 1U] == ON_THE_WAY) {
      ok = soter_find_moves(s, &space, before, here, NULL, &written);
      before = here;
    }
  }
  if (ok) {
    const uint64_t* const last = t->by_a_move ? NULL : t->last;
    ok = soter_find_moves(s, &space, before, last, t->by_a_move ? &t->broken : NULL, &written);
  }
  soter_workspace_close(&space);
  s->result->length = ok ? written : 0U;
}

/* Tells how far it is, and whether it goes on. */
static bool look(stack* t) {
  soter_search* const s = t->s;
  const uint64_t table = soter_store_bytes(&t->store);
  const uint64_t bytes = table + soter_row_bytes(&t->row) + soter_expander_bytes(&t->expander);
  const uint64_t left = s->o->memory > bytes ? s->o->memory - bytes : 0U;
  t->store.memory = table + left;
  soter_instant_allow(t->expander.instant, left / 2U);
  s->progress->bytes = bytes;
  s->progress->states = t->states;
  s->progress->transitions = t->expander.transitions;
  t->taken = 0U;
  t->over = t->over || s->progress->stop != 0 || t->full || t->expander.no_memory ||
            bytes > s->o->memory || t->expander.space.too_many;
  return !t->over;
}

/* Every now and then; whether it is stopped, always. */
static bool go_on(stack* t) {
  const bool now = (++t->turns & 1023U) == 0U || t->taken >= LOOK || t->s->progress->stop != 0;
  return !now || look(t);
}

/* The successors of a configuration lie on the stack then, the first one on top; false: no more are
 * wanted. */
static bool take_away(void* to) {
  stack* const t = to;
  const soter_successors* const h = &t->expander.successors;
  t->taken += h->count;
  for (uint32_t k = h->count; k > 0U && !t->broke && !t->full; k--) {
    take_in(t, h->packed + (size_t)(k - 1U) * t->words, h->sleep[k - 1U]);
  }
  soter_forget_successors(&t->expander);
  return !t->broke && !t->full && (t->taken < LOOK || look(t));
}

/* Expands the configuration on top of the stack, which is on the way now. Where successors of it
 * may be missing, the search ends. */
static void expand_top(stack* t, uint64_t* top) {
  const uint64_t sleep = top[t->words];
  const uint64_t only = top[t->words + 1U];
  soter_copy_words(t->here, top, t->words); /* the stack may move */
  top[t->words + 1U] = ON_THE_WAY;
  soter_forget_successors(&t->expander);
  soter_expand_next(&t->expander, t->here, sleep, only);
  if (t->expander.broke && !t->broke) {
    t->broke = true;
    t->broken = t->expander.broken;
    t->by_a_move = true;
  }
  (void)take_away(t);
  t->over = t->over || t->full || t->expander.no_memory;
}

/* Searches configurations of at most `bound` steps until one violates. */
static void run(stack* t, uint32_t bound) {
  uint32_t depth = 0U;
  soter_expand_start(&t->expander);
  (void)take_away(t);
  while (t->row.count > 0U && !t->broke && !t->over) {
    uint64_t* const top = soter_row_at(&t->row, t->row.count - 1U);
    if (top[t->words + 1U] == ON_THE_WAY) {
      SOTER_CHECK(depth > 0U);
      t->row.count--;
      depth--;
    } else if (depth >= bound) {
      t->row.count--;
    } else if (go_on(t)) {
      depth++;
      expand_top(t, top);
    }
  }
}

/* No deeper than the violation lies; where overruns hide it there, to the end. */
void soter_trace_depth_first(soter_search* s) {
  if (s->o->goal != NULL) {
    return; /* it does not look for goals */
  }
  const uint32_t bounds[] = {s->result->depth, UINT32_MAX};
  soter_explore_options once = *s->o;
  once.go_on = false;
  once.max_ran = 0U;
  for (uint32_t k = 0; s->result->length == 0U && k < 2U && s->progress->stop == 0; k++) {
    soter_explore_result unused = {0};
    soter_search again = *s;
    stack t;
    again.o = &once;
    again.result = &unused;
    if (open_stack(&t, &again)) {
      run(&t, bounds[k]);
      if (t.broke) {
        write_way(&t);
      }
      if (unused.length > 0U) {
        s->result->broken = t.broken;
        s->result->length = unused.length;
      }
    }
    close_stack(&t);
  }
}
