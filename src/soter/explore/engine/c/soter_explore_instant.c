/* soter_explore_instant.c: from one end of an instant to those of the next (docs/testing.md,
 * "Ends of instants").
 *
 * Purpose: where all windows are points nothing is observed in the middle of an instant. Its orders
 * and choices are run through with a scratch set, and only the ends are given to the search, which
 * stores nothing else. What the scratch set has forgotten is run through again, so it may be
 * forgotten at any time; it is at the beginning of an instant, when it has become large.
 * Non-goals: windows that are no points: there the reduction is off
 * (soter_explore_known_instants.c); the way back (soter_explore_trace_steps.c).
 */
#include "soter_explore_internal.h"

#define FIRST_SLOTS UINT64_C(1024)
#define LARGE (UINT64_C(1) << 17) /* entries: then it is forgotten before the next instant, */
#define SHARE 8U                  /* or when it takes this part of the memory that it may take */

/* A slot: a packed configuration, what sleeps in it, and in which round it was put. */
struct soter_instant {
  uint32_t words, width;
  uint64_t* slot;
  uint64_t slots, used, round;
  uint64_t large;  /* so many are forgotten before the next instant */
  uint64_t memory; /* most bytes that it may take */
  soter_row row;   /* what is still to be run through */
  uint32_t first;  /* the first successor of the configuration that is run through */
  bool broke;      /* what was found in the middle */
  soter_broken broken;
  bool (*spill)(void* to); /* takes ends away where they are very many */
  void* to;
};

struct soter_instant* soter_instant_open(const soter_model* m, uint64_t memory) {
  struct soter_instant* const t = calloc(1U, sizeof *t);
  if (t == NULL) {
    return NULL;
  }
  t->words = t->row.words = m->words;
  t->width = t->row.width = m->words + 2U;
  t->slots = FIRST_SLOTS;
  t->round = 1U; /* zeros are of no round */
  t->memory = memory;
  t->large = memory / (SHARE * 2U * t->width * sizeof *t->slot);
  t->large = t->large > LARGE ? LARGE : t->large;
  t->slot = soter_allocate(t->slots * t->width * sizeof *t->slot);
  if (t->slot == NULL) {
    free(t);
    return NULL;
  }
  return t;
}

void soter_instant_close(struct soter_instant* t) {
  if (t != NULL) {
    soter_free(t->slot, t->slots * t->width * sizeof *t->slot);
    soter_row_close(&t->row);
    free(t);
  }
}

uint64_t soter_instant_bytes(const struct soter_instant* t) {
  return t == NULL ? 0U : t->slots * t->width * sizeof *t->slot + soter_row_bytes(&t->row);
}

void soter_instant_allow(struct soter_instant* t, uint64_t more) {
  if (t != NULL) {
    t->memory = soter_instant_bytes(t) + more;
  }
}

/* Where a configuration stands, or would. */
static uint64_t* slot_of(const struct soter_instant* t, const uint64_t* packed) {
  SOTER_CHECK(t->used < t->slots && (t->slots & (t->slots - 1U)) == 0U);
  uint64_t i = soter_hash(packed, NULL, t->words) & (t->slots - 1U);
  for (;; i = (i + 1U) & (t->slots - 1U)) {
    uint64_t* const at = t->slot + i * t->width;
    bool same = true;
    for (uint32_t k = 0; k < t->words; k++) {
      same = same && at[k] == packed[k];
    }
    if (same || at[t->words + 1U] != t->round) {
      return at;
    }
  }
}

static bool grow(struct soter_instant* t) {
  struct soter_instant larger = *t;
  larger.slots = t->slots * 2U;
  if (larger.slots * t->width * sizeof *t->slot > t->memory) {
    return false;
  }
  larger.slot = soter_allocate(larger.slots * t->width * sizeof *larger.slot);
  if (larger.slot == NULL) {
    return false;
  }
  for (uint64_t i = 0; i < t->slots; i++) {
    const uint64_t* const from = t->slot + i * t->width;
    if (from[t->words + 1U] == t->round) {
      (void)memcpy(slot_of(&larger, from), from, t->width * sizeof *from);
    }
  }
  soter_free(t->slot, t->slots * t->width * sizeof *t->slot);
  *t = larger;
  return true;
}

int soter_instant_put(struct soter_instant* t, const uint64_t* packed, uint64_t* sleep,
                      uint64_t* again) {
  if (t->used * 2U >= t->slots && !grow(t)) {
    return -1;
  }
  uint64_t* const at = slot_of(t, packed);
  if (at[t->words + 1U] == t->round) {
    const uint64_t before = at[t->words];
    *again = before & ~*sleep;
    *sleep = at[t->words] = before & *sleep;
    return 0;
  }
  soter_copy_words(at, packed, t->words);
  at[t->words] = *sleep;
  at[t->words + 1U] = t->round;
  t->used++;
  SOTER_CHECK(t->used < t->slots);
  return 1;
}

static void break_off(struct soter_instant* t, const soter_broken* found) {
  t->broken = t->broke ? t->broken : *found;
  t->broke = true;
  SOTER_CHECK(t->round > 0U);
}

bool soter_is_late(soter_expander* expander, const uint64_t* packed, soter_broken* broken) {
  return expander->space.m->timeds > 0U && soter_is_broken(expander, packed, broken);
}

/* What lies in the middle is judged, and waits to be run through. */
static void let_wait(soter_expander* expander, const uint64_t* packed, uint64_t sleep) {
  struct soter_instant* const t = expander->instant;
  uint64_t again = 0U;
  soter_broken found;
  const int fresh = soter_instant_put(t, packed, &sleep, &again);
  expander->no_memory = expander->no_memory || fresh < 0;
  SOTER_CHECK(fresh <= 0 || again == 0U);
  if (fresh == 1 && soter_is_late(expander, packed, &found)) {
    if (!soter_is_known(&expander->space, &found)) {
      break_off(t, &found);
    }
  } else if (fresh == 1 || again != 0U) {
    const bool ok = soter_row_put(&t->row, packed, sleep, fresh == 1 ? UINT64_MAX : again);
    expander->no_memory = expander->no_memory || !ok;
  }
}

/* Sorts the successors from number `first`: ends stay, what lies in the middle goes on to be run
 * through. */
static void sort_successors(soter_expander* expander, uint32_t first) {
  struct soter_instant* const t = expander->instant;
  soter_successors* const h = &expander->successors;
  uint32_t kept = first;
  SOTER_CHECK(first <= h->count);
  for (uint32_t k = first; k < h->count && !expander->no_memory; k++) {
    const uint64_t* const packed = h->packed + (size_t)k * t->words;
    uint64_t sleep = 0U;
    uint64_t again = 0U;
    if (h->sleep[k] != SOTER_AT_END) {
      let_wait(expander, packed, h->sleep[k]);
      continue;
    }
    /* where there are very many it is the table that tells them apart */
    const int fresh = t->used > t->large ? 1 : soter_instant_put(t, packed, &sleep, &again);
    expander->no_memory = fresh < 0;
    if (fresh == 1) {
      soter_copy_words(h->packed + (size_t)kept * t->words, packed, t->words);
      h->sleep[kept++] = 0U;
    }
  }
  h->count = kept;
}

/* Where one step has very many successors: the middle is sorted out, and the ends are taken away if
 * they are very many. False: no more are wanted. */
static bool sort_out(void* to) {
  soter_expander* const expander = to;
  struct soter_instant* const t = expander->instant;
  sort_successors(expander, t->first);
  expander->no_memory = expander->no_memory || soter_instant_bytes(t) > t->memory;
  const bool many =
      !expander->no_memory && expander->successors.count >= expander->most && t->spill != NULL;
  const bool more = !many || t->spill(t->to);
  t->first = expander->successors.count;
  return more && !expander->no_memory;
}

/* Runs through what waits. */
static void run_row(soter_expander* expander) {
  struct soter_instant* const t = expander->instant;
  uint64_t item[SOTER_WORDS + 2U];
  bool enough = false;
  while (t->row.count > 0U && !expander->no_memory && !enough && !soter_is_to_end(expander)) {
    t->row.count--;
    soter_copy_words(item, soter_row_at(&t->row, t->row.count), t->width);
    t->first = expander->successors.count;
    soter_expand(expander, item, item[t->words], item[t->words + 1U]);
    if (expander->broke) {
      break_off(t, &expander->broken);
    }
    /* also where that was the last one: what lies in the middle is never given to the search */
    const bool more = sort_out(expander);
    enough = expander->enough || (t->broke && !expander->go_on) || !more;
  }
}

static void run_through(soter_expander* expander, const uint64_t* packed) {
  struct soter_instant* const t = expander->instant;
  if (t->used > t->large) {
    t->used = 0U;
    t->round++;
  }
  SOTER_CHECK(t->row.count == 0U);
  t->broke = false;
  /* what was lost before this instant stays lost: the search looks later */
  expander->no_memory = !soter_row_put(&t->row, packed, 0U, UINT64_MAX) || expander->no_memory;
  t->spill = expander->spill;
  t->to = expander->to;
  expander->spill = sort_out;
  expander->to = expander;
  run_row(expander);
  expander->spill = t->spill;
  expander->to = t->to;
  t->row.count = 0U; /* of what was stopped, too */
  expander->broke = t->broke;
  expander->broken = t->broken;
}

void soter_expand_next(soter_expander* expander, const uint64_t* packed, uint64_t sleep,
                       uint64_t only) {
  if (expander->instant == NULL) {
    soter_expand(expander, packed, sleep, only);
    return;
  }
  SOTER_CHECK(sleep == 0U && only == UINT64_MAX);
  if (expander->groups == NULL || !soter_groups_expand(expander, packed)) {
    run_through(expander, packed);
  }
}
