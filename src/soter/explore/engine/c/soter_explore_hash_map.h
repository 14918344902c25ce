/* soter_explore_hash_map.h: lists that grow, and maps from masked packed words to a number.
 *
 * Purpose: what soter_explore_transition_cache.c looks steps up with. Non-goals: deletion.
 */
#ifndef SOTER_EXPLORE_HASH_MAP_H
#define SOTER_EXPLORE_HASH_MAP_H

#include "soter_explore_internal.h"

/* What is done for every configuration is compiled for few words apart. */
#if defined(__GNUC__)
#define SPECIAL __attribute__((always_inline)) static inline
#else
#define SPECIAL SOTER_INLINE
#endif

#define FIRST_SLOTS 1024U
#define WIDE 32U /* words: fewer slots then */
#define MOST_SLOTS (UINT32_C(1) << 22)

/* A map from masked packed words to a number that is not 0: slots of `words` and it. */
typedef struct {
  uint64_t* slot;
  uint32_t slots, used;
} map;

typedef struct {
  void* item;
  uint32_t count, room;
  size_t size;
} list;

SOTER_INLINE void* push(list* l, uint32_t many) {
  if (many > UINT32_MAX / 2U - l->count) {
    return NULL; /* more than numbers of items tell apart */
  }
  if (l->count + many > l->room) {
    uint32_t room = l->room == 0U ? 256U : l->room * 2U;
    while (room < l->count + many) {
      room *= 2U;
    }
    void* const item = soter_reallocate(l->item, l->room * l->size, room * l->size);
    if (item == NULL) {
      return NULL;
    }
    l->item = item;
    l->room = room;
  }
  void* const found = (char*)l->item + l->count * l->size;
  l->count += many;
  SOTER_CHECK(l->count <= l->room && l->size > 0U);
  return found;
}

SOTER_INLINE uint64_t map_bytes(const map* m, uint32_t words) {
  return (uint64_t)m->slots * (words + 1U) * sizeof *m->slot;
}

SOTER_INLINE bool map_open(map* m, uint32_t words) {
  m->slots = words > WIDE ? FIRST_SLOTS / 64U : FIRST_SLOTS;
  m->used = 0U;
  m->slot = soter_allocate(map_bytes(m, words));
  return m->slot != NULL;
}

SOTER_INLINE void map_close(map* m, uint32_t words) {
  soter_free(m->slot, map_bytes(m, words));
}

SOTER_INLINE void list_close(list* l) {
  soter_free(l->item, l->room * l->size);
}

/* The slot of a key: where it stands, or where it would; behind it is its number, or 0. */
SPECIAL uint64_t* slot_of(const map* m, const uint64_t* packed, const uint64_t* mask,
                          uint32_t words) {
  SOTER_CHECK(m->used < m->slots);
  uint32_t i = (uint32_t)soter_hash(packed, mask, words) & (m->slots - 1U);
  for (;;) {
    uint64_t* const at = m->slot + (size_t)i * (words + 1U);
    bool same = true;
    for (uint32_t k = 0; k < words; k++) {
      same = same && at[k] == (packed[k] & mask[k]);
    }
    if (same || at[words] == 0U) {
      return at; /* the key of an empty slot is 0 */
    }
    i = (i + 1U) & (m->slots - 1U);
  }
}

SOTER_INLINE bool map_grow(map* m, uint32_t words) {
  uint64_t ones[SOTER_WORDS];
  (void)memset(ones, 0xff, words * sizeof ones[0]);
  map larger = *m;
  larger.slots = m->slots * 2U;
  if (larger.slots > MOST_SLOTS) {
    return false;
  }
  larger.slot = soter_allocate(map_bytes(&larger, words));
  if (larger.slot == NULL) {
    return false;
  }
  for (uint32_t i = 0; i < m->slots; i++) {
    const uint64_t* const from = m->slot + (size_t)i * (words + 1U);
    if (from[words] != 0U) {
      soter_copy_words(slot_of(&larger, from, ones, words), from, words + 1U);
    }
  }
  map_close(m, words);
  *m = larger;
  return true;
}

#endif
