/* soter_explore_shortest_trace.c: the least trace to a violation.
 *
 * Purpose: fewest steps, then fewest changes of actor, then fewest choices that are not the default
 * one, by an exhaustive search without reduction. Layer by layer over pairs (configuration, who
 * moved last): a shortest way enters each of its configurations as early as possible, so within a
 * layer only the least cost of every pair matters. Non-goals: speed; it goes no deeper than the
 * first violation.
 */
#include "soter_explore_internal.h"

#define NONE UINT32_MAX

typedef struct {
  uint32_t parent, actor; /* actor NONE: at the start */
  uint32_t changes, unusual;
} way;

typedef struct {
  soter_search* s;
  soter_workspace space;
  soter_store seen; /* configurations of earlier layers */
  uint64_t* packed; /* [count * words] */
  way* ways;
  uint32_t count, room, words;
  uint32_t* slot; /* pairs of the layer that grows: number + 1, 0: empty */
  uint32_t slots, used;
  uint32_t begin; /* first entry of the layer that grows */
  way best;       /* to the violation */
  bool broke, by_a_move, full;
  soter_broken wanted;
} ways;

static bool is_less(const way* a, const way* b) {
  return a->changes != b->changes ? a->changes < b->changes : a->unusual < b->unusual;
}

static uint64_t bytes_of(const ways* l) {
  return soter_store_bytes(&l->seen) + (uint64_t)l->room * (l->words * 8U + sizeof(way)) +
         l->slots * sizeof *l->slot;
}

static uint32_t slot_of(const ways* l, const uint64_t* packed, uint32_t actor) {
  uint64_t h = actor + 1U;
  for (uint32_t k = 0; k < l->words; k++) {
    h = soter_scramble(h ^ packed[k]);
  }
  SOTER_CHECK(l->used < l->slots && (l->slots & (l->slots - 1U)) == 0U);
  uint32_t i = (uint32_t)h & (l->slots - 1U);
  while (l->slot[i] != 0U) {
    const uint32_t at = l->slot[i] - 1U;
    if (l->ways[at].actor == actor &&
        memcmp(l->packed + (size_t)at * l->words, packed, l->words * sizeof *packed) == 0) {
      return i;
    }
    i = (i + 1U) & (l->slots - 1U);
  }
  return i;
}

static bool more_slots(ways* l) {
  const uint32_t slots = l->slots == 0U ? 4096U : l->slots * 2U;
  uint32_t* const slot = calloc(slots, sizeof *slot);
  if (slot == NULL) {
    return false;
  }
  free(l->slot);
  l->slot = slot;
  l->slots = slots;
  for (uint32_t i = l->begin; i < l->count; i++) {
    const uint32_t to = slot_of(l, l->packed + (size_t)i * l->words, l->ways[i].actor);
    l->slot[to] = i + 1U;
  }
  return true;
}

static bool more_ways(ways* l) {
  const uint32_t room = l->room == 0U ? 4096U : l->room + l->room / 2U;
  if (bytes_of(l) > l->s->o->memory) {
    return false;
  }
  uint64_t* const packed = realloc(l->packed, (size_t)room * l->words * sizeof *packed);
  l->packed = packed != NULL ? packed : l->packed;
  way* const more = realloc(l->ways, room * sizeof *more);
  l->ways = more != NULL ? more : l->ways;
  if (packed == NULL || more == NULL || room > UINT32_MAX / 2U) {
    return false;
  }
  l->room = room;
  return true;
}

static void add(ways* l, const uint64_t* packed, const way* w) {
  if (soter_store_has(&l->seen, packed)) {
    return;
  }
  if ((l->used * 2U >= l->slots && !more_slots(l)) || (l->count == l->room && !more_ways(l))) {
    l->full = true;
    return;
  }
  const uint32_t i = slot_of(l, packed, w->actor);
  if (l->slot[i] != 0U) {
    way* const known = &l->ways[l->slot[i] - 1U];
    if (is_less(w, known)) {
      *known = *w;
    }
    return;
  }
  (void)memcpy(l->packed + (size_t)l->count * l->words, packed, l->words * sizeof *packed);
  l->ways[l->count] = *w;
  l->slot[i] = ++l->count;
  l->used++;
  SOTER_CHECK(l->count <= l->room && (w->parent == NONE || w->parent < l->count));
}

static uint32_t unusual(const soter_workspace* space, const soter_move* move, uint32_t number) {
  SOTER_CHECK(space->taken <= SOTER_CHOICES);
  uint32_t n = number > 0U || move->kind == SOTER_SKIPPED ? 1U : 0U;
  for (uint32_t i = 0; i < space->taken; i++) {
    n += space->choice[i].pick != 0U ? 1U : 0U;
  }
  return n;
}

static bool is_wanted(const ways* l, const soter_broken* b) {
  return soter_same_broken(b, &l->wanted);
}

static void arrive(ways* l, const way* w, bool by_a_move) {
  if (!l->broke || is_less(w, &l->best)) {
    l->best = *w;
    l->by_a_move = by_a_move;
  }
  l->broke = true;
}

/* A configuration that violates something else ends there as well: it is not continued. */
static void judge(ways* l, bool ok, const soter_broken* found, const way* w) {
  uint64_t packed[SOTER_WORDS];
  if (!ok) {
    if (is_wanted(l, found)) {
      arrive(l, w, true);
    }
    return;
  }
  soter_broken seen;
  if (soter_finds_violation(&l->space, &seen)) {
    if (is_wanted(l, &seen)) {
      arrive(l, w, false);
    }
    return;
  }
  l->space.m->pack(l->space.there, packed);
  add(l, packed, w);
}

static void expand(ways* l, uint32_t from) {
  SOTER_CHECK(from < l->count);
  soter_workspace* const space = &l->space;
  space->m->unpack(l->packed + (size_t)from * l->words, space->here);
  soter_find_windows(space);
  const way here = l->ways[from];
  for (uint32_t a = 0; a < space->m->actors && !l->full; a++) {
    soter_move move;
    for (uint32_t n = 0; soter_move_of(space, a, n, &move); n++) {
      space->given = 0U;
      do {
        soter_broken found;
        const bool ok = soter_make_move(space, &move, &found);
        const bool changes = here.actor != NONE && here.actor != a;
        const way w = {from, a, here.changes + (changes ? 1U : 0U),
                       here.unusual + unusual(space, &move, n)};
        judge(l, ok, &found, &w);
        l->s->result->transitions++;
      } while (!l->full && soter_next_picks(space));
      soter_tell_answers(space, true);
    }
  }
}

static void birth(ways* l) {
  static const soter_move none = {NONE, SOTER_BIRTH, -1, -1};
  soter_workspace* const space = &l->space;
  space->given = 0U;
  do {
    soter_make_start(space);
    const way w = {NONE, NONE, 0U, unusual(space, &none, 0U)};
    judge(l, true, NULL, &w);
  } while (!l->full && soter_next_picks(space));
  soter_tell_answers(space, true);
}

static soter_explore_status bounded(ways* l) {
  soter_search* const s = l->s;
  s->progress->states = l->seen.count;
  s->progress->transitions = s->result->transitions;
  s->progress->depth = s->result->depth;
  s->progress->bytes = bytes_of(l);
  if (s->progress->stop != 0) {
    return SOTER_STOPPED;
  }
  if (s->o->max_states > 0U && l->seen.count >= s->o->max_states) {
    return SOTER_STATES;
  }
  return l->full || bytes_of(l) > s->o->memory ? SOTER_MEMORY : SOTER_EXHAUSTED;
}

static soter_explore_status remember(ways* l, uint32_t begin, uint32_t end) {
  SOTER_CHECK(begin <= end && end <= l->count);
  for (uint32_t i = begin; i < end; i++) {
    uint64_t sleep = 0U;
    uint64_t again = 0U;
    if (soter_store_put(&l->seen, l->packed + (size_t)i * l->words, &sleep, &again) < 0) {
      return SOTER_MEMORY;
    }
    const soter_explore_status status = (i & 255U) == 0U ? bounded(l) : SOTER_EXHAUSTED;
    if (status != SOTER_EXHAUSTED) { /* layers may be large */
      return status;
    }
  }
  return SOTER_EXHAUSTED;
}

static soter_explore_status search(ways* l) {
  birth(l);
  uint32_t begin = 0U;
  while (!l->broke && begin < l->count) {
    const uint32_t end = l->count;
    const soter_explore_status remembered = remember(l, begin, end);
    if (remembered != SOTER_EXHAUSTED) {
      return remembered;
    }
    l->begin = end;
    l->used = 0U;
    (void)memset(l->slot, 0, l->slots * sizeof *l->slot);
    for (uint32_t i = begin; i < end; i++) {
      expand(l, i);
      if ((i & 255U) == 0U || l->full) {
        const soter_explore_status status = bounded(l);
        if (status != SOTER_EXHAUSTED) {
          return status;
        }
      }
    }
    l->s->result->depth++;
    begin = end;
  }
  if (l->space.cut) {
    return SOTER_STOPPED;
  }
  if (l->space.too_many) {
    return SOTER_CHOOSY; /* what was not tried may be less */
  }
  return l->broke ? SOTER_VIOLATED : SOTER_EXHAUSTED;
}

/* Whether a move from `here` ends in a configuration, or (`to` NONE) in the violation. */
static bool makes(ways* l, const soter_move* move, uint32_t to) {
  soter_workspace* const space = &l->space;
  soter_broken found;
  const bool made = soter_make_move(space, move, &found);
  if (to == NONE) {
    return made ? !l->by_a_move && soter_finds_violation(space, &found) && is_wanted(l, &found)
                : l->by_a_move && is_wanted(l, &found);
  }
  uint64_t packed[SOTER_WORDS];
  if (!made) {
    return false;
  }
  space->m->pack(space->there, packed);
  return memcmp(packed, l->packed + (size_t)to * l->words, l->words * sizeof *packed) == 0;
}

/* The least unusual move of an actor from a configuration to another, or to the violation. */
static bool write_one(ways* l, uint32_t from, uint32_t to, uint32_t actor, soter_trace_step* step) {
  soter_workspace* const space = &l->space;
  uint32_t least = NONE;
  space->m->unpack(l->packed + (size_t)from * l->words, space->here);
  soter_find_windows(space);
  soter_move move;
  for (uint32_t n = 0; soter_move_of(space, actor, n, &move); n++) {
    space->given = 0U;
    do {
      const bool fits = makes(l, &move, to);
      const uint32_t cost = unusual(space, &move, n);
      if (fits && cost < least) {
        least = cost;
        soter_write_step(space, &move, step);
      }
    } while (soter_next_picks(space));
  }
  return least != NONE;
}

static bool write_all(ways* l) {
  soter_search* const s = l->s;
  uint32_t length = 1U;
  for (uint32_t i = l->best.parent; i != NONE; i = l->ways[i].parent) {
    length++;
  }
  if (length > s->room) {
    return false;
  }
  s->result->length = length;
  uint32_t to = NONE;
  uint32_t actor = l->best.actor;
  uint32_t from = l->best.parent;
  for (uint32_t k = length; k > 1U; k--) {
    if (!write_one(l, from, to, actor, &s->trace[k - 1U])) {
      return false;
    }
    to = from;
    actor = l->ways[from].actor;
    from = l->ways[from].parent;
  }
  (void)memcpy(l->space.here, l->space.started, l->space.size);
  return soter_find_move(&l->space, NULL, to == NONE ? NULL : l->packed + (size_t)to * l->words,
                         &l->wanted, &s->trace[0]);
}

void soter_explore_least(const soter_model* m, const soter_explore_options* o, soter_broken broken,
                         soter_explore_progress* progress, soter_explore_result* result,
                         soter_trace_step* trace, uint32_t room) {
  (void)memset(result, 0, sizeof *result);
  soter_search s = {m, o, progress, NULL, result, trace, room};
  ways l;
  (void)memset(&l, 0, sizeof l);
  l.s = &s;
  l.words = m->words;
  l.wanted = broken;
  result->threads = 1U;
  result->status = m->words > SOTER_WORDS ? SOTER_WIDE : SOTER_NO_MEMORY;
  if (m->words <= SOTER_WORDS && soter_workspace_open(&l.space, m, o, progress, NULL)) {
    if (soter_store_open(&l.seen, m, SOTER_EXACT, false, 0U, o->memory) && more_slots(&l)) {
      l.seen.stop = &progress->stop;
      (void)memcpy(l.space.here, l.space.started, l.space.size);
      l.space.wanted = &l.wanted; /* what is violated with it does not hide it */
      result->status = search(&l);
      result->broken = broken;
      result->states = l.count;
      if (result->status == SOTER_VIOLATED && (!write_all(&l) || l.space.cut)) {
        result->status = progress->stop != 0 ? SOTER_STOPPED : SOTER_LONG;
      }
    }
    soter_store_close(&l.seen);
    soter_workspace_close(&l.space);
  }
  free(l.packed);
  free(l.ways);
  free(l.slot);
}
