/* soter_explore_store.c: the table of packed worlds.
 *
 * Purpose: exact storage at little more than the packed bytes, or 64-bit fingerprints.
 * An entry is the packed world, its first word mixed by a bijection so that it is its own hash;
 * entries are kept in the order of that word, each as near to the place its hash says as the ones
 * before it allow (ordered linear probing), so the table may be nine tenths full and grows in
 * place. Non-goals: deletion; sharing between threads (each has a table of its own).
 */
#include "soter_explore_in.h"

#define FIRST_ROOM UINT64_C(4096)
#define SLACK UINT64_C(512) /* entries behind the last place that a hash says */
#define K1 UINT64_C(0x9e3779b97f4a7c15)
#define K2 UINT64_C(0xd6e8feb86659fd93)

static uint64_t low_bits(uint32_t bits) {
  return bits >= 64U ? UINT64_MAX : (UINT64_C(1) << bits) - 1U;
}

/* The inverse of an odd number modulo 2^64. */
static uint64_t inverse(uint64_t k) {
  uint64_t x = k;
  for (int i = 0; i < 6; i++) {
    x *= 2U - k * x;
  }
  return x;
}

static uint64_t mixed(uint64_t x, uint32_t bits) {
  const uint64_t all = low_bits(bits);
  const uint32_t half = (bits + 1U) / 2U;
  x = (x * K1) & all;
  x ^= x >> half;
  x = (x * K2) & all;
  x ^= x >> half;
  return (x * K1) & all;
}

static uint64_t unmixed(uint64_t x, uint32_t bits) {
  const uint64_t all = low_bits(bits);
  const uint32_t half = (bits + 1U) / 2U;
  x = (x * inverse(K1)) & all;
  x ^= x >> half;
  x = (x * inverse(K2)) & all;
  x ^= x >> half;
  return (x * inverse(K1)) & all;
}

/* What the other words add to the first one; 0 for zeros. */
static uint64_t rest_hash(const uint64_t* packed, uint32_t words, uint32_t bits) {
  uint64_t h = 0U;
  for (uint32_t i = 1; i < words; i++) {
    h = soter_scramble(h + packed[i] * K1);
  }
  return h & low_bits(bits);
}

/* ------------------------------------------------------------------ entries */

static uint8_t* at(const soter_store* s, uint64_t i) {
  return s->entry + i * s->bytes;
}

static uint64_t load(const uint8_t* from, uint32_t bytes) {
  uint64_t x = 0U;
  (void)memcpy(&x, from, sizeof x); /* entries have eight bytes behind the last one */
  return bytes >= 8U ? x : x & low_bits(8U * bytes);
}

static uint32_t first_bytes(const soter_store* s) {
  return s->words > 1U ? 8U : s->bytes - s->sleep;
}

static uint64_t first_of(const soter_store* s, uint64_t i) {
  return load(at(s, i), first_bytes(s));
}

static bool is_empty(const soter_store* s, uint64_t i) {
  const uint8_t* const e = at(s, i);
  const uint32_t key = s->bytes - s->sleep;
  if (load(e, first_bytes(s)) != 0U) {
    return false;
  }
  for (uint32_t k = 8U; k < key; k++) {
    if (e[k] != 0U) {
      return false;
    }
  }
  return true;
}

static void write_key(const soter_store* s, uint8_t* e, const uint64_t* key) {
  (void)memcpy(e, key, s->bytes - s->sleep);
}

static uint64_t home(const soter_store* s, uint64_t first) {
  /* the leading bits of the mixed word, scaled to the room */
  const uint64_t top = first << (64U - s->first) >> 32;
  return (top * (s->room - SLACK)) >> 32;
}

static bool rest_is(const soter_store* s, const uint8_t* e, const uint64_t* key) {
  const uint32_t bytes = s->bytes - s->sleep;
  return bytes <= 8U || memcmp(e + 8, key + 1, bytes - 8U) == 0;
}

/* ------------------------------------------------------------------ opening, growing */

bool soter_store_open(soter_store* s, const soter_model* m, soter_storage storage, bool sleep,
                      uint64_t memory) {
  (void)memset(s, 0, sizeof *s);
  s->fingerprint = storage == SOTER_FINGERPRINT;
  s->packed = m->words;
  s->words = s->fingerprint ? 1U : m->words;
  const uint32_t bits = s->fingerprint ? 64U : m->bits;
  s->first = bits < 64U ? bits : 64U;
  s->sleep = sleep ? (m->actors + 7U) / 8U : 0U;
  s->bytes = (bits + 7U) / 8U + s->sleep;
  s->memory = memory;
  s->room = FIRST_ROOM + SLACK;
  if (s->room * s->bytes + 8U > memory) {
    return false;
  }
  s->entry = calloc(s->room * s->bytes + 8U, 1U);
  return s->entry != NULL;
}

void soter_store_close(soter_store* s) {
  free(s->entry);
  s->entry = NULL;
}

/* In place: first everything to the end of the larger table, then each to where it belongs. */
static bool grow(soter_store* s) {
  const uint64_t old = s->room;
  const uint64_t more = s->count < (UINT64_C(1) << 16) ? s->count : s->count / 8U;
  const uint64_t room = old + more + 64U;
  if (room * s->bytes + 8U > s->memory) {
    return false;
  }
  uint8_t* const entry = realloc(s->entry, room * s->bytes + 8U);
  if (entry == NULL) {
    return false;
  }
  s->entry = entry;
  (void)memset(entry + old * s->bytes, 0, (room - old) * s->bytes + 8U);
  uint64_t to = room;
  for (uint64_t i = old; i > 0U; i--) {
    if (!is_empty(s, i - 1U)) {
      to--;
      if (to != i - 1U) {
        (void)memcpy(at(s, to), at(s, i - 1U), s->bytes);
        (void)memset(at(s, i - 1U), 0, s->bytes);
      }
    }
  }
  s->room = room;
  uint64_t next = 0U;
  for (uint64_t i = to; i < room; i++) {
    const uint64_t wanted = home(s, first_of(s, i));
    const uint64_t place = wanted > next ? wanted : next;
    if (place != i) {
      (void)memcpy(at(s, place), at(s, i), s->bytes);
      (void)memset(at(s, i), 0, s->bytes);
    }
    next = place + 1U;
  }
  return true;
}

/* ------------------------------------------------------------------ putting */

static uint64_t sleep_of(const soter_store* s, const uint8_t* e) {
  uint64_t x = 0U;
  (void)memcpy(&x, e + (s->bytes - s->sleep), s->sleep);
  return x;
}

static void set_sleep(const soter_store* s, uint8_t* e, uint64_t sleep) {
  (void)memcpy(e + (s->bytes - s->sleep), &sleep, s->sleep);
}

/* Makes place at i: what stands there and behind moves on by one. */
static bool shift(soter_store* s, uint64_t i) {
  uint64_t end = i;
  while (end < s->room && !is_empty(s, end)) {
    end++;
  }
  if (end == s->room) {
    return false;
  }
  (void)memmove(at(s, i + 1U), at(s, i), (end - i) * s->bytes);
  return true;
}

/* What stands in the table for a packed world. */
static void key_of(const soter_store* s, const uint64_t* packed, uint64_t* key) {
  if (s->fingerprint) {
    key[0] = soter_fingerprint(packed, s->packed);
    return;
  }
  (void)memcpy(key, packed, s->words * sizeof key[0]);
  key[0] = mixed(key[0] ^ rest_hash(key, s->words, s->first), s->first);
}

int soter_store_put(soter_store* s, const uint64_t* packed, uint64_t* sleep, uint64_t* again) {
  uint64_t key[SOTER_WORDS];
  key_of(s, packed, key);
  for (;;) {
    if (s->count * 10U >= (s->room - SLACK) * 9U && !grow(s)) {
      return -1;
    }
    uint64_t i = home(s, key[0]);
    while (i < s->room && !is_empty(s, i) && first_of(s, i) < key[0]) {
      i++;
    }
    while (i < s->room && !is_empty(s, i) && first_of(s, i) == key[0]) {
      if (rest_is(s, at(s, i), key)) {
        if (s->sleep > 0U) {
          const uint64_t before = sleep_of(s, at(s, i));
          *again = before & ~*sleep;
          set_sleep(s, at(s, i), before & *sleep);
        }
        return 0;
      }
      i++;
    }
    if (i < s->room && shift(s, i)) {
      (void)memset(at(s, i), 0, s->bytes);
      write_key(s, at(s, i), key);
      if (s->sleep > 0U) {
        set_sleep(s, at(s, i), *sleep);
      }
      s->count++;
      return 1;
    }
    if (!grow(s)) {
      return -1;
    }
  }
}

bool soter_store_has(const soter_store* s, const uint64_t* packed) {
  uint64_t key[SOTER_WORDS];
  key_of(s, packed, key);
  for (uint64_t i = home(s, key[0]); i < s->room && !is_empty(s, i); i++) {
    const uint64_t first = first_of(s, i);
    if (first > key[0]) {
      return false;
    }
    if (first == key[0] && rest_is(s, at(s, i), key)) {
      return true;
    }
  }
  return false;
}

bool soter_store_get(const soter_store* s, uint64_t index, uint64_t* packed) {
  if (index >= s->room || is_empty(s, index)) {
    return false;
  }
  (void)memset(packed, 0, s->words * sizeof packed[0]);
  (void)memcpy(packed, at(s, index), s->bytes - s->sleep);
  packed[0] = unmixed(packed[0], s->first) ^ rest_hash(packed, s->words, s->first);
  return true;
}

/* ------------------------------------------------------------------ tables that outlive a search
 */

typedef struct kept {
  soter_store store;
  struct kept* next;
} kept;

void* soter_keep(void* others, const soter_store* s) {
  kept* const k = malloc(sizeof *k);
  if (k == NULL) {
    free(s->entry);
    return others;
  }
  k->store = *s;
  k->next = others;
  return k;
}

uint64_t soter_explore_kept(const soter_model* m, const void* first, void* worlds) {
  uint64_t count = 0U;
  for (const kept* k = first; k != NULL; k = k->next) {
    for (uint64_t i = 0; i < k->store.room; i++) {
      uint64_t packed[SOTER_WORDS];
      if (!soter_store_get(&k->store, i, packed)) {
        continue;
      }
      if (worlds != NULL) {
        uint8_t* const to = (uint8_t*)worlds + count * m->world_size;
        (void)memset(to, 0, m->world_size);
        soter_start(m->program, to, 0U);
        m->unpack(packed, to);
      }
      count++;
    }
  }
  return count;
}

void soter_explore_free(void* first) {
  kept* k = first;
  while (k != NULL) {
    kept* const next = k->next;
    soter_store_close(&k->store);
    free(k);
    k = next;
  }
}
