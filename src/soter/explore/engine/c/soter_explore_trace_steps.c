/* soter_explore_trace_steps.c: the steps between two ends of instants.
 *
 * Purpose: the way back, for traces: the middle of an instant is expanded once more, each
 * configuration with the number of the one before. Non-goals: which ends follow each other
 * (strategies).
 */
#include "soter_explore_internal.h"

typedef struct {
  soter_expander expander;
  soter_row row; /* the middle as it came, each with the number of the one before */
  uint64_t at;   /* the one that is expanded */
  const uint64_t* to;
  const soter_broken* broken;
  bool late, arrived;
} middle;

/* A configuration of the middle waits; or it is too late for something. */
static void keep_one(middle* q, const uint64_t* packed) {
  uint64_t sleep = 0U;
  uint64_t again = 0U;
  soter_broken found;
  const int fresh = soter_instant_put(q->expander.instant, packed, &sleep, &again);
  SOTER_CHECK(q->at < q->row.count);
  if (fresh == 1 && soter_is_late(&q->expander, packed, &found)) {
    q->late = true;
    return;
  }
  const bool ok = fresh == 0 || (fresh == 1 && soter_row_put(&q->row, packed, q->at, 0U));
  q->expander.no_memory = q->expander.no_memory || !ok;
}

/* Looks among the successors for the end that is wanted; what lies in the middle waits. */
static bool look_at_successors(void* to) {
  middle* const q = to;
  soter_expander* const expander = &q->expander;
  const uint32_t words = expander->words;
  for (uint32_t k = 0; k < expander->successors.count && !expander->no_memory && !q->arrived; k++) {
    const uint64_t* const packed = expander->successors.packed + (size_t)k * words;
    if (expander->successors.sleep[k] != SOTER_AT_END) {
      keep_one(q, packed);
    } else {
      q->arrived = q->to != NULL && memcmp(packed, q->to, words * sizeof *packed) == 0;
    }
  }
  soter_forget_successors(expander);
  return !expander->no_memory && !q->arrived;
}

/* Whether what is wanted comes after the configuration last expanded. */
static bool arrives(middle* q) {
  soter_trace_step step;
  const bool late = q->late || q->expander.broke;
  q->late = false;
  return q->arrived || (q->to == NULL && late &&
                        soter_find_move(&q->expander.space, soter_row_at(&q->row, q->at), NULL,
                                        q->broken, &step));
}

/* Writes the way to number `last`, and from there to what was looked for. */
static bool write_middle(middle* q, soter_search* s, uint64_t last, uint32_t* written) {
  uint32_t length = 1U;
  for (uint64_t i = last; i != 0U; i = soter_row_at(&q->row, i)[q->expander.words]) {
    length++;
  }
  if (length > s->room - *written) {
    return false;
  }
  const uint64_t* to = q->to;
  uint64_t i = last;
  bool ok = true;
  for (uint32_t k = length; ok && k > 0U; k--) {
    const uint64_t* const from = soter_row_at(&q->row, i);
    ok = soter_find_move(&q->expander.space, from, to, to == NULL ? q->broken : NULL,
                         &s->trace[*written + k - 1U]);
    to = from;
    i = from[q->expander.words];
  }
  *written += ok ? length : 0U;
  return ok;
}

static bool find_middle(middle* q, soter_search* s, const uint64_t* from, uint32_t* written) {
  bool ok = soter_row_put(&q->row, from, 0U, 0U);
  for (q->at = 0U; ok && q->at < q->row.count; q->at++) {
    uint64_t item[SOTER_WORDS];
    soter_copy_words(item, soter_row_at(&q->row, q->at), q->expander.words);
    soter_forget_successors(&q->expander);
    soter_expand(&q->expander, item, 0U, UINT64_MAX);
    (void)look_at_successors(q);
    if (arrives(q)) {
      return write_middle(q, s, q->at, written);
    }
    ok = !q->expander.no_memory && !soter_is_to_end(&q->expander);
  }
  return false;
}

/* With the orders that a reduction asks for. */
static bool find_way(soter_search* s, uint32_t reduce, const uint64_t* from, const uint64_t* to,
                     const soter_broken* broken, uint32_t* written) {
  middle q;
  soter_explore_options once = *s->o;
  soter_search own = *s;
  (void)memset(&q, 0, sizeof q);
  once.reduce = reduce;
  own.o = &once;
  q.row.words = s->m->words;
  q.row.width = s->m->words + 1U;
  q.to = to;
  q.broken = broken;
  bool ok = soter_expander_open(&q.expander, &own, NULL, s->o->memory / 4U);
  q.expander.spill = look_at_successors;
  q.expander.to = &q;
  ok = ok && find_middle(&q, s, from, written);
  soter_expander_close(&q.expander);
  soter_row_close(&q.row);
  return ok;
}

bool soter_find_moves(soter_search* s, soter_workspace* space, const uint64_t* from,
                      const uint64_t* to, const soter_broken* broken, uint32_t* written) {
  SOTER_CHECK(*written <= s->room);
  if (from == NULL || !soter_by_instants(s->m, s->o)) {
    const bool room = *written < s->room;
    return room && soter_find_move(space, from, to, broken, &s->trace[(*written)++]);
  }
  /* what breaks in some orders may not be met in few of them, before something else is broken */
  return find_way(s, SOTER_REDUCE_INSTANTS | SOTER_REDUCE_AMPLE, from, to, broken, written) ||
         find_way(s, SOTER_REDUCE_INSTANTS, from, to, broken, written);
}
