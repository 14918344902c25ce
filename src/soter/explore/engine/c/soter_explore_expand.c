/* soter_explore_expand.c: the worlds that come after a world.
 *
 * Purpose: all moves that the reduction asks for, made one by one on unpacked worlds.
 * Non-goals: remembering steps (soter_explore_memo.c), order of the search (strategies).
 */
#include "soter_explore_in.h"

#define FIRST_HEIRS 256U

bool soter_expander_open(soter_expander* e, const soter_model* m, const soter_explore_options* o,
                         soter_explore_coverage* coverage) {
  (void)memset(e, 0, sizeof *e);
  e->reduce = o->reduce;
  e->words = m->words;
  e->memory = o->memory;
  if (m->timely) {
    e->reduce &= ~SOTER_REDUCE_SLEEP; /* moving first changes at which times others may move */
  }
  for (uint32_t i = 0; i < m->timeds; i++) {
    if (m->timely && m->timed[i].kind != SOTER_INVARIANT) {
      e->reduce &= ~SOTER_REDUCE_AMPLE; /* it may add observations, and these keep promises */
    }
  }
  if (m->words > SOTER_WORDS || !soter_place_open(&e->place, m, o, coverage)) {
    return false;
  }
  e->memo = m->plain && !m->timely && !o->plainly ? soter_memo_open(e, o->memory / 4U) : NULL;
  return true;
}

void soter_expander_close(soter_expander* e) {
  soter_memo_close(e->memo);
  soter_place_close(&e->place);
  free(e->heirs.packed);
  free(e->heirs.sleep);
}

static bool more_heirs(soter_expander* e) {
  soter_heirs* const h = &e->heirs;
  const uint32_t room = h->room == 0U ? FIRST_HEIRS : h->room * 2U;
  if (room > FIRST_HEIRS && 4U * (uint64_t)room * e->words * sizeof *h->packed > e->memory) {
    e->no_memory = true; /* one world may have very many: the values of an input */
    return false;
  }
  uint64_t* const packed = realloc(h->packed, (size_t)room * e->words * sizeof *packed);
  h->packed = packed != NULL ? packed : h->packed;
  uint64_t* const sleep = realloc(h->sleep, room * sizeof *sleep);
  h->sleep = sleep != NULL ? sleep : h->sleep;
  if (packed == NULL || sleep == NULL) {
    e->no_memory = true;
    return false;
  }
  SOTER_CHECK(h->count < room);
  h->room = room;
  return true;
}

bool soter_add_heir(soter_expander* e, const uint64_t* packed, uint64_t sleep) {
  soter_heirs* const h = &e->heirs;
  if (h->count == h->room && !more_heirs(e)) {
    return false;
  }
  soter_copy_words(h->packed + (size_t)h->count * e->words, packed, e->words);
  SOTER_CHECK(h->count < h->room);
  h->sleep[h->count] = sleep;
  h->count++;
  return true;
}

static void make_one(soter_expander* e, const soter_move* move, uint64_t sleep) {
  soter_place* const x = &e->place;
  uint64_t packed[SOTER_WORDS];
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
  x->m->pack(x->there, packed);
  (void)soter_add_heir(e, packed, sleep);
}

void soter_expand(soter_expander* e, const uint64_t* packed, uint64_t sleep, uint64_t only) {
  soter_place* const x = &e->place;
  e->begin = e->heirs.count;
  SOTER_CHECK(e->words == x->m->words);
  e->broke = false;
  if (e->memo != NULL && soter_memo_expand(e, packed, sleep, only)) {
    return;
  }
  x->m->unpack(packed, x->here);
  soter_look(x);
  uint64_t set = soter_enabled(x);
  if ((e->reduce & SOTER_REDUCE_AMPLE) != 0U) {
    set = soter_ample(x, set);
  }
  uint64_t before = 0U;
  for (uint32_t a = 0; a < x->m->actors; a++) {
    const uint64_t bit = UINT64_C(1) << a;
    if ((set & only & ~sleep & bit) == 0U) {
      continue;
    }
    const uint64_t asleep =
        (e->reduce & SOTER_REDUCE_SLEEP) != 0U ? soter_still_asleep(x->m, a, sleep, before) : 0U;
    soter_move move;
    for (uint32_t n = 0; soter_move_of(x, a, n, &move); n++) {
      x->given = 0U;
      do {
        make_one(e, &move, asleep);
      } while (!e->no_memory && soter_next_picks(x));
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
  uint64_t packed[SOTER_WORDS];
  e->heirs.count = 0U;
  e->broke = false;
  x->given = 0U;
  do {
    soter_be_born(x);
    x->m->pack(x->there, packed);
    (void)soter_add_heir(e, packed, 0U);
  } while (!e->no_memory && soter_next_picks(x));
}

bool soter_row_put(soter_row* r, const uint64_t* packed, uint64_t first, uint64_t only) {
  if (r->count == r->room) {
    const uint64_t room = r->room == 0U ? 1024U : r->room + r->room / 2U;
    uint64_t* const item = realloc(r->item, room * r->width * sizeof *item);
    if (item == NULL) {
      return false;
    }
    r->item = item;
    r->room = room;
  }
  uint64_t* const to = soter_row_at(r, r->count);
  soter_copy_words(to, packed, r->words);
  to[r->words] = first;
  if (r->width > r->words + 1U) {
    to[r->words + 1U] = only;
  }
  r->count++;
  SOTER_CHECK(r->count <= r->room && r->width > r->words);
  return true;
}
