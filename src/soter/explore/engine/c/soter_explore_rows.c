/* soter_explore_rows.c: rows of packed configurations, and the room of successors.
 *
 * Purpose: what grows while configurations are expanded.
 * Non-goals: memory itself (soter_explore_memory.c), who waits in a row (strategies).
 */
#include "soter_explore_internal.h"

#define FIRST_SUCCESSORS 256U

bool soter_more_successors(soter_expander* expander) {
  soter_successors* const h = &expander->successors;
  const uint32_t room = h->room == 0U ? FIRST_SUCCESSORS : h->room * 2U;
  const uint64_t each = expander->words * sizeof *h->packed;
  uint64_t* const packed = soter_reallocate(h->packed, h->room * each, room * each);
  uint64_t* const sleep = packed != NULL ? realloc(h->sleep, room * sizeof *sleep) : NULL;
  if (packed == NULL || sleep == NULL) {
    soter_free(packed, packed != NULL ? room * each : 0U);
    h->packed = packed != NULL ? NULL : h->packed;
    h->count = packed != NULL ? 0U : h->count;
    h->room = packed != NULL ? 0U : h->room;
    expander->no_memory = true;
    return false;
  }
  (void)memset(sleep + h->room, 0, (room - h->room) * sizeof *sleep);
  h->packed = packed;
  h->sleep = sleep;
  SOTER_CHECK(h->count < room);
  h->room = room;
  return true;
}

int64_t soter_row_time(const soter_row* r, const soter_model* m, uint64_t first) {
  int64_t least = SOTER_NO_DEADLINE;
  for (uint64_t i = first; i < r->count; i++) {
    least = soter_earlier(least, soter_time_of(m, soter_row_at(r, i)));
  }
  return least;
}

void soter_row_close(soter_row* r) {
  soter_free(r->item, r->room * r->width * sizeof *r->item);
  r->item = NULL;
}

void soter_row_drop(soter_row* r, uint64_t count) {
  SOTER_CHECK(count <= r->count);
  if (count > 0U && count < r->count) {
    (void)memmove(r->item, soter_row_at(r, count), (r->count - count) * r->width * sizeof *r->item);
  }
  r->count -= count;
}

bool soter_row_reserve(soter_row* r, uint64_t more) {
  uint64_t room = r->room == 0U ? 1024U : r->room;
  while (room - r->count < more) {
    room += room / 2U;
  }
  if (room > r->room) {
    const uint64_t each = r->width * sizeof *r->item;
    uint64_t* const item = soter_reallocate(r->item, r->room * each, room * each);
    if (item == NULL) {
      return false;
    }
    r->item = item;
    r->room = room;
  }
  r->most = r->count + more > r->most ? r->count + more : r->most;
  SOTER_CHECK(r->most <= r->room);
  return true;
}

bool soter_row_put(soter_row* r, const uint64_t* packed, uint64_t first, uint64_t only) {
  if (!soter_row_reserve(r, 1U)) {
    return false;
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
  SOTER_CHECK(r->count <= r->room && r->width >= r->words);
  return true;
}
