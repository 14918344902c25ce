/* soter_explore_expand.c: the worlds that come after a world.
 *
 * Purpose: all moves that the reduction asks for, made one by one on unpacked worlds.
 * Non-goals: remembering steps (soter_explore_memo.c), order of the search (strategies).
 */
#include "soter_explore_in.h"

#define FIRST_HEIRS 256U
#define MOST_BYTES (UINT32_C(1) << 23) /* of heirs, before they are taken away, */
#define FEWEST 64U                     /* but so many */
#define LITTLE 4096U /* bytes of what may be remembered, for an heir of many worlds at once */
#define LONG 4096U   /* answers of a step: a violation need not wait for the rest */

/* The reductions that are sound for a model, of those asked for. */
static uint32_t reductions(const soter_model* m, const soter_explore_options* o) {
  uint32_t sound = o->reduce;
  if (m->ordered) {
    return sound & ~(SOTER_REDUCE_SLEEP | SOTER_REDUCE_AMPLE); /* one move at a time anyway */
  }
  if (m->timely) {
    sound &= ~SOTER_REDUCE_SLEEP; /* moving first changes at which times others may move */
  }
  if (o->families > 0U && !soter_by_instants(m, o)) {
    sound &= ~SOTER_REDUCE_SLEEP; /* who sleeps in a world does not in the one that is stored */
  }
  for (uint32_t i = 0; i < m->timeds; i++) {
    if (m->timely && m->timed[i].kind != SOTER_INVARIANT) {
      sound &= ~SOTER_REDUCE_AMPLE; /* it may add observations, and these keep promises */
    }
  }
  return sound;
}

/* What is remembered within an instant; false: there is no memory. */
static bool open_instants(soter_expander* e, const soter_model* m, const soter_explore_options* o) {
  if (!soter_by_instants(m, o)) {
    return true;
  }
  e->instant = soter_instant_open(m, e->memory);
  e->groups = soter_in_groups(m, o) ? soter_groups_open(m, e->memory) : NULL;
  return e->instant != NULL;
}

static void open_memo(soter_expander* e, const soter_model* m, const soter_explore_options* o) {
  e->memo = m->brief && !o->plainly ? soter_memo_open(e, e->memory) : NULL;
  if (e->memo != NULL && soter_memo_bytes(e->memo) > e->memory) {
    soter_memo_close(e->memo); /* it would be given up at once */
    e->memo = NULL;
  }
}

bool soter_expander_open(soter_expander* e, const soter_search* s, soter_explore_coverage* coverage,
                         uint64_t memory) {
  const soter_model* const m = s->m;
  const soter_explore_options* const o = s->o;
  (void)memset(e, 0, sizeof *e);
  e->reduce = reductions(m, o);
  e->words = m->words;
  e->memory = memory;
  e->go_on = o->go_on;
  e->most = MOST_BYTES / (m->words > 0U ? m->words * (uint32_t)sizeof(uint64_t) : 1U);
  e->most = e->most < FEWEST ? FEWEST : e->most;
  e->crowd_heirs = memory / LITTLE < SOTER_CROWD_HEIRS ? memory / LITTLE : SOTER_CROWD_HEIRS;
  SOTER_CHECK(m->words <= SOTER_WORDS);
  if (!soter_place_open(&e->place, m, o, s->progress, coverage) || !open_instants(e, m, o)) {
    return false;
  }
  e->place.any_order = true; /* of those that it is told to move, the first moves */
  open_memo(e, m, o);
  return true;
}

void soter_expander_close(soter_expander* e) {
  soter_memo_close(e->memo);
  soter_instant_close(e->instant);
  soter_groups_close(e->groups);
  soter_place_close(&e->place);
  soter_give(e->heirs.packed, (uint64_t)e->heirs.room * e->words * sizeof *e->heirs.packed);
  free(e->heirs.sleep);
}

bool soter_more_heirs(soter_expander* e) {
  soter_heirs* const h = &e->heirs;
  const uint32_t room = h->room == 0U ? FIRST_HEIRS : h->room * 2U;
  const uint64_t each = e->words * sizeof *h->packed;
  uint64_t* const packed = soter_regrow(h->packed, h->room * each, room * each);
  uint64_t* const sleep = packed != NULL ? realloc(h->sleep, room * sizeof *sleep) : NULL;
  if (packed == NULL || sleep == NULL) {
    soter_give(packed, packed != NULL ? room * each : 0U);
    h->packed = packed != NULL ? NULL : h->packed;
    h->count = packed != NULL ? 0U : h->count;
    h->room = packed != NULL ? 0U : h->room;
    e->no_memory = true;
    return false;
  }
  (void)memset(sleep + h->room, 0, (room - h->room) * sizeof *sleep);
  h->packed = packed;
  h->sleep = sleep;
  SOTER_CHECK(h->count < room);
  h->room = room;
  return true;
}

uint64_t soter_expander_bytes(const soter_expander* e) {
  const uint64_t each = e->words * sizeof *e->heirs.packed + sizeof *e->heirs.sleep;
  return e->heirs.room * each + (e->memo != NULL ? soter_memo_bytes(e->memo) : 0U) +
         soter_instant_bytes(e->instant) + soter_groups_bytes(e->groups);
}

/* One world may have very many heirs: the answers of a step, the values of an input. */
static void spill(soter_expander* e) {
  if (e->heirs.count >= e->most && e->spill != NULL) {
    e->enough = e->enough || !e->spill(e->to);
    e->begin = e->heirs.count;
  }
}

static bool wants_more(const soter_expander* e) {
  const bool broke = e->broke && !e->go_on && e->place.tried >= LONG;
  return !e->no_memory && !e->enough && !broke;
}

static void make_one(soter_expander* e, const soter_move* move, uint64_t sleep) {
  soter_place* const x = &e->place;
  soter_broken broken;
  e->transitions++;
  if (!soter_make(x, move, &broken)) {
    if (!e->broke && !soter_is_known(x, &broken)) {
      e->broken = broken;
      e->broke = true;
    }
    return;
  }
  soter_cover(x, move->actor);
  const bool ends = e->instant != NULL && soter_is_observable(x);
  uint64_t* const heir = soter_next_heir(e, ends ? SOTER_AT_END : sleep);
  if (heir != NULL) {
    x->m->pack(x->there, heir);
  }
  spill(e);
}

/* All answers of a move, or as many as are wanted. */
static void make_all(soter_expander* e, const soter_move* move, uint64_t sleep) {
  e->place.given = 0U;
  do {
    make_one(e, move, sleep);
  } while (wants_more(e) && soter_next_picks(&e->place));
  soter_tell_answers(&e->place, true);
}

void soter_expand(soter_expander* e, const uint64_t* packed, uint64_t sleep, uint64_t only) {
  soter_place* const x = &e->place;
  e->begin = e->heirs.count;
  SOTER_CHECK(e->words == x->m->words);
  e->broke = false;
  e->enough = false;
  if (e->memo != NULL && soter_memo_expand(e, packed, sleep, only)) {
    return;
  }
  x->m->unpack(packed, x->here);
  soter_look(x);
  uint64_t set = soter_enabled(x);
  if ((e->reduce & SOTER_REDUCE_AMPLE) != 0U) {
    set = soter_ample(x, set);
  }
  set = soter_in_order(x->m, set & only);
  uint64_t before = 0U;
  for (uint32_t a = 0; a < x->m->actors; a++) {
    const uint64_t bit = UINT64_C(1) << a;
    if ((set & ~sleep & bit) == 0U) {
      continue;
    }
    const uint64_t asleep =
        (e->reduce & SOTER_REDUCE_SLEEP) != 0U ? soter_still_asleep(x->m, a, sleep, before) : 0U;
    soter_move move;
    for (uint32_t n = 0; !x->cut && wants_more(e) && soter_move_of(x, a, n, &move); n++) {
      make_all(e, &move, asleep);
      x->cut = x->cut || soter_is_stopped(x);
    }
    before |= bit;
  }
}

bool soter_is_broken(soter_expander* e, const uint64_t* packed, soter_broken* broken) {
  soter_place* const x = &e->place;
  if (x->p->properties == 0U && x->m->timeds == 0U) {
    return false;
  }
  if (e->memo != NULL) {
    return soter_memo_broken(e, packed, broken);
  }
  x->m->unpack(packed, x->there);
  return soter_violates(x, broken);
}

void soter_expand_birth(soter_expander* e) {
  soter_place* const x = &e->place;
  e->heirs.count = 0U;
  e->broke = false;
  e->enough = false;
  x->given = 0U;
  do {
    soter_be_born(x);
    uint64_t* const heir = soter_next_heir(e, 0U);
    if (heir != NULL) {
      x->m->pack(x->there, heir);
    }
    spill(e);
  } while (wants_more(e) && soter_next_picks(x));
  soter_tell_answers(x, true);
}

int64_t soter_row_time(const soter_row* r, const soter_model* m, uint64_t first) {
  int64_t least = SOTER_NO_DEADLINE;
  for (uint64_t i = first; i < r->count; i++) {
    least = soter_earlier(least, soter_time_of(m, soter_row_at(r, i)));
  }
  return least;
}

void soter_row_close(soter_row* r) {
  soter_give(r->item, r->room * r->width * sizeof *r->item);
  r->item = NULL;
}

void soter_row_drop(soter_row* r, uint64_t count) {
  SOTER_CHECK(count <= r->count);
  if (count > 0U && count < r->count) {
    (void)memmove(r->item, soter_row_at(r, count), (r->count - count) * r->width * sizeof *r->item);
  }
  r->count -= count;
}

bool soter_row_put(soter_row* r, const uint64_t* packed, uint64_t first, uint64_t only) {
  if (r->count == r->room) {
    const uint64_t room = r->room == 0U ? 1024U : r->room + r->room / 2U;
    const uint64_t each = r->width * sizeof *r->item;
    uint64_t* const item = soter_regrow(r->item, r->room * each, room * each);
    if (item == NULL) {
      return false;
    }
    r->item = item;
    r->room = room;
  }
  uint64_t* const to = soter_row_at(r, r->count);
  soter_copy_words(to, packed, r->words);
  if (r->width > r->words) {
    to[r->words] = first;
  }
  if (r->width > r->words + 1U) {
    to[r->words + 1U] = only;
  }
  r->count++;
  r->most = r->count > r->most ? r->count : r->most;
  SOTER_CHECK(r->count <= r->room && r->width >= r->words);
  return true;
}
