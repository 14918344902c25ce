/* soter_explore_successors.h: places for the configurations that come after a configuration (not
 * for drivers).
 *
 * Purpose: what makes configurations takes a place for each. Non-goals: their room
 * (soter_explore_rows.c).
 */
#ifndef SOTER_EXPLORE_SUCCESSORS_H
#define SOTER_EXPLORE_SUCCESSORS_H

#include "soter_explore_internal.h"

/* The place of one more successor; NULL: there is no memory. */
SOTER_INLINE uint64_t* soter_next_successor(soter_expander* expander, uint64_t sleep) {
  soter_successors* const h = &expander->successors;
  if (h->count == h->room && !soter_more_successors(expander)) {
    return NULL;
  }
  SOTER_CHECK(h->count < h->room);
  h->sleep[h->count] = sleep;
  return h->packed + (size_t)h->count++ * expander->words;
}

/* The places of some more successors of a batch, one after the other, where nothing sleeps; NULL:
 * there is no memory, or they are too many. */
SOTER_INLINE uint64_t* soter_next_successors(soter_expander* expander, uint64_t count) {
  soter_successors* const h = &expander->successors;
  const uint32_t first = h->count;
  if (first + count > expander->batch_successors) {
    return NULL;
  }
  while (h->room - first < count) {
    if (!soter_more_successors(expander)) {
      return NULL;
    }
  }
  SOTER_CHECK(expander->words == 1U && (count == 0U || h->sleep[first] == 0U));
  h->count = first + (uint32_t)count;
  expander->transitions += count;
  return h->packed + first;
}

#endif
