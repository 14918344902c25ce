/* soter_explore_store.c: the table of packed configurations.
 *
 * Purpose: exact storage at little more than the packed bytes, or 64-bit fingerprints.
 * An entry is the packed configuration, its first word mixed by a bijection so that it is its own
 * hash; its leading bits say the bucket of eight entries and where in it the search begins; what
 * finds its bucket full goes to the next one. Segments grow by an eighth, one at a time, so that
 * the table is four fifths full and never has to exist twice; small ones are half full, so that
 * ways are short. Non-goals: deletion of one entry; sharing between threads (each has a table of
 * its own).
 */
#include "soter_explore_internal.h"

#define SEGMENTS 256U
#define FEW_SEGMENTS 8U                 /* of wide entries: */
#define WIDE 512U                       /* bytes */
#define MOVED 4096U                     /* buckets, between two looks at whether it is stopped */
#define BUCKET 8U                       /* entries */
#define FIRST_BUCKETS 4U                /* of a segment */
#define IDLE 3U                         /* layers without a new entry: a segment is settled */
#define SMALL (UINT64_C(1) << 16)       /* bytes of a segment, */
#define SMALL_LAYER (UINT64_C(1) << 20) /* and of all of a layer */
#define LINE 64U                        /* bytes that the machine fetches at once */
#define MOST_COMMON 62U                 /* bits: they are in the first word, behind the lowest */
#define AHEAD 64U                       /* places that are looked for at once */
#define TAIL 8U /* bytes behind the last entry: loads take eight at a time */
#define FACTOR1 UINT64_C(0x9e3779b97f4a7c15)
#define FACTOR2 UINT64_C(0xd6e8feb86659fd93)
#define INVERSE1 UINT64_C(0xf1de83e19937733d) /* of FACTOR1, modulo 2^64 */
#define INVERSE2 UINT64_C(0xcfee444d8b59a89b)

static uint64_t low_bits(uint32_t bits) {
  return bits >= 64U ? UINT64_MAX : (UINT64_C(1) << bits) - 1U;
}

SOTER_INLINE uint64_t mixed(uint64_t x, uint32_t bits, uint64_t all) {
  const uint32_t half = (bits + 1U) / 2U;
  x = (x * FACTOR1) & all;
  x ^= x >> half;
  x = (x * FACTOR2) & all;
  x ^= x >> half;
  return (x * FACTOR1) & all;
}

SOTER_INLINE uint64_t unmixed(uint64_t x, uint32_t bits, uint64_t all) {
  const uint32_t half = (bits + 1U) / 2U;
  SOTER_CHECK(FACTOR1 * INVERSE1 == 1U && FACTOR2 * INVERSE2 == 1U);
  x = (x * INVERSE1) & all;
  x ^= x >> half;
  x = (x * INVERSE2) & all;
  x ^= x >> half;
  return (x * INVERSE1) & all;
}

/* What the other words add to the first one; 0 for zeros. */
static uint64_t rest_hash(const uint64_t* packed, uint32_t words, uint64_t all) {
  uint64_t h = 0U;
  for (uint32_t i = 1; i < words; i++) {
    h = soter_scramble(h + packed[i] * FACTOR1);
  }
  return h & all;
}

/* What a first word is without the bits that all have in common. The lowest one stays: it is set in
 * every configuration, and an entry of zeros is none. */
SOTER_INLINE uint64_t without_common(const soter_store* s, uint64_t first) {
  return s->common > 0U ? first >> s->common | 1U : first;
}

static void squeeze_common_out(const soter_store* s, const uint64_t* packed, uint64_t* key) {
  SOTER_CHECK(s->common > 0U && s->common < 63U && s->words <= s->packed);
  for (uint32_t i = 0; i < s->words; i++) {
    key[i] = packed[i] >> s->common;
    key[i] |= i + 1U < s->packed ? packed[i + 1U] << (64U - s->common) : 0U;
  }
  key[0] |= 1U;
}

/* The way back, in place: the last words first. */
static void put_common_back(const soter_store* s, uint64_t* packed) {
  SOTER_CHECK(s->common > 0U && (packed[0] & 1U) != 0U);
  packed[0] &= ~UINT64_C(1);
  for (uint32_t i = s->packed; i-- > 0U;) {
    packed[i] <<= s->common;
    packed[i] |= i > 0U ? packed[i - 1U] >> (64U - s->common) : s->prefix;
  }
}

/* Whether a configuration may be in this table: the first one says what all have in common. */
SOTER_INLINE bool may_belong(soter_store* s, const uint64_t* packed) {
  if (s->common > 0U && s->count == 0U) {
    s->prefix = packed[0] & s->low;
  }
  return s->common == 0U || (packed[0] & s->low) == s->prefix;
}

/* What stands in the table for a packed configuration. */
void soter_store_key(const soter_store* s, const uint64_t* packed, uint64_t* key) {
  if (s->fingerprint) {
    key[0] = soter_fingerprint(packed, s->packed);
    return;
  }
  if (s->packed == 1U) {
    key[0] = mixed(without_common(s, packed[0]), s->first, s->all);
    return;
  }
  (void)memcpy(key, packed, s->words * sizeof key[0]);
  if (s->common > 0U) {
    squeeze_common_out(s, packed, key);
  }
  key[0] = mixed(key[0] ^ rest_hash(key, s->words, s->all), s->first, s->all);
}

SOTER_INLINE uint64_t load_word(const uint8_t* from, uint64_t mask) {
  uint64_t x;
  (void)memcpy(&x, from, sizeof x);
  return x & mask;
}

/* A segment holds what happens at one time (the bits behind the lowest one,
 * explore/model/bit_packing.py): a search goes through time, and what it has left behind need not
 * be in the machine's caches. A layer has one time or two: there all segments hold some of it, so
 * that the room for one to grow is little. */
SOTER_INLINE soter_segment* segment_of(const soter_store* s, const uint64_t* packed,
                                       const uint64_t* key) {
  const uint64_t of = s->layer ? key[0] : packed[0] >> 1;
  return &s->segment[of & (s->segments - 1U)];
}

/* The entry where the way of a key begins: it goes round its bucket, then on to the next one. */
SOTER_INLINE uint64_t home_of(const soter_store* s, const soter_segment* g, uint64_t first) {
  const uint64_t next = first << (64U - s->first) >> 32;
  SOTER_CHECK(s->first >= 1U && s->first <= 64U);
  return (next * (g->homes * BUCKET)) >> 32;
}

/* The entry after number `k` of a way that began at `home`. */
SOTER_INLINE uint64_t entry_after(uint64_t home, uint64_t k) {
  return (home & ~(uint64_t)(BUCKET - 1U)) + (k & ~(uint64_t)(BUCKET - 1U)) +
         ((home + k) & (BUCKET - 1U));
}

SOTER_INLINE bool is_empty(const soter_store* s, const uint8_t* e) {
  if (load_word(e, s->mask) != 0U) {
    return false;
  }
  for (uint32_t k = 8U; k < s->key; k++) {
    if (e[k] != 0U) {
      return false;
    }
  }
  return true;
}

/* The same for a key that takes one load. */
SOTER_INLINE uint8_t* short_place_of(const soter_store* s, const soter_segment* g, uint64_t key,
                                     bool* found) {
  const uint64_t home = home_of(s, g, key);
  const uint64_t most = g->buckets * BUCKET - (home & ~(uint64_t)(BUCKET - 1U));
  for (uint64_t k = 0U; k < most; k++) {
    uint8_t* const e = g->entry + entry_after(home, k) * s->bytes;
    const uint64_t there = load_word(e, s->mask);
    if (there == key || there == 0U) {
      *found = there != 0U;
      return e;
    }
  }
  return NULL;
}

/* Where a key stands, or the place for it; `found` says which. NULL: its way through the segment is
 * full. */
SOTER_INLINE uint8_t* place_of(const soter_store* s, const soter_segment* g, const uint64_t* key,
                               bool* found) {
  *found = false;
  if (s->key <= 8U) {
    return short_place_of(s, g, key[0], found);
  }
  const uint64_t home = home_of(s, g, key[0]);
  const uint64_t most = g->buckets * BUCKET - (home & ~(uint64_t)(BUCKET - 1U));
  const uint8_t* const bytes = (const uint8_t*)key;
  const uint64_t last = load_word(bytes + (s->key - 8U), UINT64_MAX); /* most keys take two loads */
  SOTER_CHECK(most <= g->buckets * BUCKET);
  for (uint64_t k = 0U; k < most; k++) {
    uint8_t* const e = g->entry + entry_after(home, k) * s->bytes;
    if (load_word(e, s->mask) == key[0] && load_word(e + (s->key - 8U), UINT64_MAX) == last &&
        (s->key <= 16U || memcmp(e + 8, key + 1, s->key - 8U) == 0)) {
      *found = !is_empty(s, e);
      return e;
    }
    if (is_empty(s, e)) {
      return e;
    }
  }
  return NULL;
}

/* It stays in the machine's caches, and room is not what matters: it may be half full. */
static bool is_small(const soter_store* s, const soter_segment* g) {
  return g->buckets * BUCKET * s->bytes <= (s->layer ? SMALL_LAYER / s->segments : SMALL);
}

static bool open_segment(const soter_store* s, soter_segment* g, uint64_t buckets) {
  g->buckets = buckets;
  g->homes =
      buckets - 1U - (buckets < 2048U ? buckets / 64U : 32U); /* the rest takes what overflows */
  SOTER_CHECK(buckets >= FIRST_BUCKETS && g->homes >= 1U);
  g->limit = buckets * BUCKET / (is_small(s, g) ? 2U : 8U) * (is_small(s, g) ? 1U : 7U);
  g->count = g->before = 0U;
  g->idle = 0U;
  g->bytes = buckets * BUCKET * s->bytes + TAIL + LINE;
  g->base = soter_allocate(g->bytes);
  if (g->base == NULL) {
    return false;
  }
  /* Written before anybody looks: a page that was read as zeros first is another one once it is
   * written, and every core that runs a thread of this process is interrupted for that. */
  (void)memset(g->base, 0, g->bytes);
  /* a bucket of eight-byte entries is then one line of the cache */
  g->entry = g->base + (LINE - (uintptr_t)g->base % LINE) % LINE;
  return true;
}

static bool open_segments(soter_store* s) {
  s->room = (uint64_t)s->segments * FIRST_BUCKETS * BUCKET;
  if (soter_store_bytes(s) > s->memory) {
    return false;
  }
  s->segment = calloc(s->segments, sizeof *s->segment);
  s->own = malloc(s->words * sizeof *s->own);
  bool ok = s->segment != NULL && s->own != NULL;
  for (uint32_t i = 0; ok && i < s->segments; i++) {
    ok = open_segment(s, &s->segment[i], FIRST_BUCKETS);
  }
  return ok;
}

bool soter_store_open(soter_store* s, const soter_model* m, soter_storage storage, bool sleep,
                      uint32_t common, uint64_t memory) {
  (void)memset(s, 0, sizeof *s);
  s->fingerprint = storage == SOTER_FINGERPRINT;
  s->packed = m->words;
  s->common = s->fingerprint ? 0U : common < MOST_COMMON ? common : MOST_COMMON;
  s->low = low_bits(s->common + 1U);
  const uint32_t bits = s->fingerprint ? 64U : m->bits - s->common;
  s->words = (bits + 63U) / 64U;
  SOTER_CHECK(s->fingerprint || (m->bits > common && s->words <= m->words));
  s->first = bits < 64U ? bits : 64U;
  s->all = low_bits(s->first);
  s->sleep = sleep ? (m->actors + 7U) / 8U : 0U;
  s->key = (bits + 7U) / 8U;
  s->bytes = s->key + s->sleep;
  s->mask = s->key >= 8U ? UINT64_MAX : low_bits(8U * s->key);
  SOTER_CHECK(s->bytes > 0U && s->words <= SOTER_WORDS);
  s->memory = memory;
  s->growth = 8U;
  s->segments = s->bytes > WIDE ? FEW_SEGMENTS : SEGMENTS;
  return open_segments(s);
}

void soter_store_close(soter_store* s) {
  for (uint32_t i = 0; s->segment != NULL && i < s->segments; i++) {
    soter_free(s->segment[i].base, s->segment[i].bytes);
  }
  free(s->segment);
  free(s->own);
  s->segment = NULL;
  s->own = NULL;
}

/* memcpy of an entry: a call costs more than most entries. */
SOTER_INLINE void copy_entry(uint8_t* to, const uint8_t* from, uint32_t bytes) {
  if (bytes >= 8U && bytes <= 16U) {
    uint64_t a;
    uint64_t b;
    (void)memcpy(&a, from, 8U);
    (void)memcpy(&b, from + (bytes - 8U), 8U);
    (void)memcpy(to, &a, 8U);
    (void)memcpy(to + (bytes - 8U), &b, 8U);
  } else if (bytes >= 4U && bytes < 8U) {
    uint32_t a;
    uint32_t b;
    (void)memcpy(&a, from, 4U);
    (void)memcpy(&b, from + (bytes - 4U), 4U);
    (void)memcpy(to, &a, 4U);
    (void)memcpy(to + (bytes - 4U), &b, 4U);
  } else {
    (void)memcpy(to, from, bytes);
  }
}

static bool is_stopped(const soter_store* s) {
  return s->stop != NULL && *s->stop != 0;
}

/* Moves all entries to another segment; `false` where its last buckets overflow, and where it is
 * stopped. */
static bool move_all(const soter_store* s, const soter_segment* from, soter_segment* to) {
  const uint8_t* e = from->entry;
  for (uint64_t i = 0; i < from->buckets * BUCKET; i++, e += s->bytes) {
    if (i % (MOVED * BUCKET) == 0U && is_stopped(s)) {
      return false;
    }
    if (is_empty(s, e)) {
      continue;
    }
    const uint64_t home = home_of(s, to, load_word(e, s->mask));
    const uint64_t most = to->buckets * BUCKET - (home & ~(uint64_t)(BUCKET - 1U));
    SOTER_CHECK(home < to->homes * BUCKET);
    uint64_t k = 0U;
    while (k < most && !is_empty(s, to->entry + entry_after(home, k) * s->bytes)) {
      k++;
    }
    if (k == most) {
      return false;
    }
    copy_entry(to->entry + entry_after(home, k) * s->bytes, e, s->bytes);
  }
  return true;
}

/* The same entries in another number of buckets, or in a few more where they do not fit. */
static bool rebuild_segment(soter_store* s, soter_segment* g, uint64_t buckets) {
  soter_segment other;
  for (;;) {
    if ((s->room + buckets * BUCKET) * s->bytes > s->memory || !open_segment(s, &other, buckets)) {
      return false;
    }
    if (move_all(s, g, &other)) {
      break;
    }
    soter_free(other.base, other.bytes); /* the last buckets overflow */
    if (is_stopped(s)) {
      return false;
    }
    buckets += buckets / 128U + 4U;
  }
  s->room = s->room - g->buckets * BUCKET + other.buckets * BUCKET;
  other.count = other.before = g->count;
  SOTER_CHECK(other.count <= other.buckets * BUCKET);
  soter_free(g->base, g->bytes);
  *g = other;
  return true;
}

/* The time before this one needed as much, most likely: fewer steps to the same size. */
static uint64_t expected_buckets(const soter_store* s, const soter_segment* g) {
  const uint64_t last = g > s->segment ? (g - 1)->buckets : 0U;
  const uint64_t before = last > s->was ? last : s->was;
  const uint64_t most = g->buckets * (is_small(s, g) ? 64U : 2U);
  return before > most ? g->buckets * 2U : before > g->buckets ? before : 0U;
}

static bool grow_segment(soter_store* s, soter_segment* g) {
  const uint64_t least = is_small(s, g) ? g->buckets : g->buckets / s->growth;
  const uint64_t hoped = s->growth < 8U ? expected_buckets(s, g) : 0U;
  const uint64_t more = hoped > g->buckets + least ? hoped - g->buckets : least;
  return rebuild_segment(s, g, g->buckets + more) ||
         rebuild_segment(s, g, g->buckets + g->buckets / 32U + 1U);
}

void soter_store_settle(soter_store* s) {
  for (uint32_t i = 0; i < s->segments && !is_stopped(s); i++) {
    soter_segment* const g = &s->segment[i];
    g->idle = g->count == g->before ? g->idle + 1U : 0U;
    g->before = g->count;
    const uint64_t enough = g->count / 7U + 16U; /* seven eighths full */
    if (g->idle == IDLE && enough + enough / 16U < g->buckets) {
      (void)rebuild_segment(s, g, enough);
      g->idle = IDLE; /* until it changes */
    }
  }
}

/* Forgets a segment's entries; it has `buckets` afterwards, or somewhat more. */
static bool empty_segment(soter_store* s, soter_segment* g, uint64_t buckets) {
  if (g->buckets <= 2U * buckets) {
    if (g->count > 0U) {
      (void)memset(g->base, 0, g->bytes);
    }
    g->count = g->before = 0U;
    return true;
  }
  soter_segment fresh = *g;
  if (!open_segment(s, &fresh, buckets)) {
    return false;
  }
  SOTER_CHECK(fresh.count == 0U && fresh.buckets < g->buckets);
  s->room -= (g->buckets - fresh.buckets) * BUCKET;
  soter_free(g->base, g->bytes);
  *g = fresh;
  return true;
}

bool soter_store_empty(soter_store* s) {
  bool ok = true;
  s->was = 0U;
  for (uint32_t i = 0; ok && i < s->segments; i++) {
    soter_segment* const g = &s->segment[i];
    s->was = g->count > 0U && g->buckets > s->was ? g->buckets : s->was;
    const uint64_t each = is_small(s, g) ? BUCKET / 2U : BUCKET - 1U;
    ok = empty_segment(s, g, g->count / each + FIRST_BUCKETS);
  }
  s->count = 0U;
  SOTER_CHECK(!ok || s->room >= (uint64_t)s->segments * FIRST_BUCKETS * BUCKET);
  return ok;
}

static uint64_t sleep_of(const soter_store* s, const uint8_t* e) {
  return load_word(e + s->key, low_bits(8U * s->sleep));
}

/* Tells the machine that a place will be looked at soon. */
SOTER_INLINE void prefetch(const uint8_t* place) {
#if defined(__GNUC__)
  __builtin_prefetch(place);
#else
  (void)place;
#endif
}

SOTER_INLINE void prefetch_home(const soter_store* s, const uint64_t* packed, uint64_t first) {
  const soter_segment* const g = segment_of(s, packed, &first);
  prefetch(g->entry + home_of(s, g, first) * s->bytes);
}

void soter_store_expect(const soter_store* s, const uint64_t* packed, const uint64_t* key) {
  prefetch_home(s, packed, key[0]);
}

void soter_store_keys(const soter_store* s, const uint64_t* packed, uint32_t count, uint64_t* key,
                      bool expect) {
  const uint32_t words = s->packed;
  SOTER_CHECK(s->words <= words);
  const bool mixes = words == 1U && !s->fingerprint;
  for (uint32_t i = 0; i < count; i++) {
    const uint64_t* const one = packed + (size_t)i * words;
    uint64_t* const to = key + (size_t)i * words;
    if (mixes) {
      *to = mixed(without_common(s, *one), s->first, s->all);
    } else {
      soter_store_key(s, one, to);
    }
    if (expect) {
      prefetch_home(s, one, *to);
    }
  }
}

int soter_store_put(soter_store* s, const uint64_t* packed, uint64_t* sleep, uint64_t* again) {
  soter_store_key(s, packed, s->own);
  return soter_store_put_key(s, packed, s->own, sleep, again);
}

SOTER_INLINE int put_into_segment(soter_store* s, soter_segment* g, const uint64_t* key,
                                  uint64_t* sleep, uint64_t* again) {
  for (;;) {
    bool found;
    uint8_t* const e = place_of(s, g, key, &found);
    if (e != NULL && found) {
      if (s->sleep > 0U) {
        const uint64_t before = sleep_of(s, e);
        const uint64_t both = before & *sleep;
        *again = before & ~*sleep;
        *sleep = both;
        if (both != before) {
          (void)memcpy(e + s->key, &both, s->sleep);
        }
      }
      return 0;
    }
    if (e != NULL && g->count < g->limit) {
      copy_entry(e, (const uint8_t*)key, s->key);
      if (s->sleep > 0U) {
        (void)memcpy(e + s->key, sleep, s->sleep);
      }
      g->count++;
      s->count++;
      SOTER_CHECK(s->count <= s->room);
      return 1;
    }
    const uint64_t most = g->buckets * (BUCKET - 1U);
    if (!grow_segment(s, g)) {
      if (e == NULL || g->count >= most) {
        return -1;
      }
      g->limit = most; /* there is no room for short ways */
    }
  }
}

int soter_store_put_key(soter_store* s, const uint64_t* packed, const uint64_t* key,
                        uint64_t* sleep, uint64_t* again) {
  if (!may_belong(s, packed)) {
    SOTER_CHECK(false && "all configurations of a table have its bits in common");
    return -1;
  }
  return put_into_segment(s, segment_of(s, packed, key), key, sleep, again);
}

/* A configuration of a word that is about to be put: its key, where its way begins, and in what. */
typedef struct {
  uint64_t key;
  uint8_t* place;
  soter_segment* of;
} coming;

/* The machine fetches one place while the next is computed. */
SOTER_INLINE void prefetch_all(const soter_store* s, const uint64_t* packed, uint32_t count,
                               coming* to) {
  const uint32_t bits = s->first;
  const uint32_t common = s->common;
  const uint64_t lowest = common > 0U ? 1U : 0U;
  const uint64_t all = s->all;
  uint64_t differ = 0U;
  for (uint32_t i = 0; i < count; i++) {
    const uint64_t key = mixed(packed[i] >> common | lowest, bits, all);
    soter_segment* const g = segment_of(s, packed + i, &key);
    uint8_t* const place = g->entry + home_of(s, g, key) * s->bytes;
    prefetch(place);
    to[i].key = key;
    to[i].place = place;
    to[i].of = g;
    differ |= packed[i] ^ packed[0];
  }
  SOTER_CHECK((differ & s->low) == 0U || common == 0U);
}

/* Puts a key into an entry that is empty. */
SOTER_INLINE int put_into_empty(soter_store* s, const coming* c, uint8_t* place) {
  uint64_t both;
  (void)memcpy(&both, place, sizeof both);
  both |= c->key; /* behind it another one may begin */
  (void)memcpy(place, &both, sizeof both);
  c->of->count++;
  s->count++;
  SOTER_CHECK(s->count <= s->room);
  return 1;
}

/* Puts what does not stand where its way begins. As soter_store_put. */
SOTER_INLINE int put_short(soter_store* s, const coming* c) {
  uint64_t none = 0U;
  bool found = false;
  uint8_t* const place =
      load_word(c->place, s->mask) == 0U ? c->place : short_place_of(s, c->of, c->key, &found);
  if (found) {
    return 0;
  }
  if (place != NULL && c->of->count < c->of->limit) {
    return put_into_empty(s, c, place);
  }
  return put_into_segment(s, c->of, &c->key, &none, &none);
}

/* Puts them until the table grows, or there is no memory; returns how many. */
static uint32_t put_some(soter_store* s, const uint64_t* packed, uint32_t count, uint64_t* fresh,
                         uint32_t* news) {
  coming ahead[AHEAD];
  const uint64_t mask = s->mask;
  const uint64_t room = s->room;
  uint32_t found = *news;
  uint32_t i = 0U;
  prefetch_all(s, packed, count, ahead);
  for (; i < count && s->room == room; i++) {
    if (load_word(ahead[i].place, mask) == ahead[i].key) {
      continue; /* most that are known stand where their way begins */
    }
    const int put = put_short(s, &ahead[i]);
    if (put < 0) {
      break;
    }
    fresh[found] = packed[i];
    found += (uint32_t)put;
  }
  *news = found;
  return i;
}

uint32_t soter_store_put_short(soter_store* s, const uint64_t* packed, uint32_t* count,
                               uint64_t* fresh) {
  uint32_t news = 0U;
  uint32_t done = 0U;
  uint32_t some = 1U;
  SOTER_CHECK(soter_store_is_short(s) && s->key <= 8U);
  if (*count > 0U && !may_belong(s, packed)) {
    SOTER_CHECK(false && "all configurations of a table have its bits in common");
    *count = 0U;
  }
  while (done < *count && some > 0U) {
    const uint32_t left = *count - done;
    some = put_some(s, packed + done, left < AHEAD ? left : AHEAD, fresh, &news);
    done += some;
  }
  *count = done;
  return news;
}

bool soter_store_has(const soter_store* s, const uint64_t* packed) {
  bool found;
  SOTER_CHECK(s->common == 0U);
  soter_store_key(s, packed, s->own);
  (void)place_of(s, segment_of(s, packed, s->own), s->own, &found);
  return found;
}

SOTER_INLINE void read_entry(const soter_store* s, const uint8_t* e, uint64_t* packed) {
  (void)memset(packed, 0, s->packed * sizeof packed[0]);
  if (s->words == 1U) {
    packed[0] = unmixed(load_word(e, s->mask), s->first, s->all);
  } else {
    (void)memcpy(packed, e, s->key);
    packed[0] = unmixed(packed[0], s->first, s->all) ^ rest_hash(packed, s->words, s->all);
  }
  if (s->common > 0U) {
    put_common_back(s, packed);
  }
  SOTER_CHECK(!s->fingerprint);
}

bool soter_store_next(const soter_store* s, soter_cursor* at, uint64_t* packed, uint64_t* sleep) {
  for (; at->segment < s->segments; at->segment++, at->entry = 0U) {
    const soter_segment* const g = &s->segment[at->segment];
    while (g->count > 0U && at->entry < g->buckets * BUCKET) {
      const uint8_t* const e = g->entry + at->entry++ * s->bytes;
      if (!is_empty(s, e)) {
        read_entry(s, e, packed);
        *sleep = s->sleep > 0U ? sleep_of(s, e) : 0U;
        return true;
      }
    }
  }
  return false;
}

void soter_store_next_short(const soter_store* s, soter_cursor* at, uint32_t count,
                            uint64_t* packed) {
  uint32_t found = 0U;
  SOTER_CHECK(soter_store_is_short(s));
  while (found < count) {
    const soter_segment* const g = &s->segment[at->segment];
    const uint64_t end = g->count > 0U ? g->buckets * BUCKET : 0U;
    const uint8_t* e = g->entry + at->entry * s->bytes;
    SOTER_CHECK(at->segment < s->segments);
    for (; at->entry < end && found < count; at->entry++, e += s->bytes) {
      packed[found] = load_word(e, s->mask);
      found += packed[found] != 0U; /* no branch: no machine knows beforehand */
    }
    if (at->entry >= end) {
      at->segment++;
      at->entry = 0U;
    }
  }
  for (uint32_t i = 0; i < count; i++) {
    packed[i] = unmixed(packed[i], s->first, s->all);
    if (s->common > 0U) {
      put_common_back(s, packed + i);
    }
  }
}

uint64_t soter_store_each(const soter_store* s, void (*each)(void* to, const uint64_t* packed),
                          void* to) {
  uint64_t count = 0U;
  for (uint32_t g = 0; g < s->segments; g++) {
    for (uint64_t i = 0; i < s->segment[g].buckets * BUCKET; i++) {
      const uint8_t* const e = s->segment[g].entry + i * s->bytes;
      uint64_t packed[SOTER_WORDS];
      if (is_empty(s, e)) {
        continue;
      }
      count++;
      SOTER_CHECK(count <= s->count);
      if (each != NULL) {
        read_entry(s, e, packed);
        each(to, packed);
      }
    }
  }
  return count;
}

static void key_of(const soter_store* s, const uint8_t* e, uint64_t* key) {
  (void)memset(key, 0, s->words * sizeof *key);
  (void)memcpy(key, e, s->key);
}

uint64_t soter_store_digest(const soter_store* s, uint64_t calendar) {
  uint64_t sum = 0U;
  uint64_t key[SOTER_WORDS];
  soter_cursor at = {0U, 0U};
  uint64_t sleep = 0U;
  while (calendar != 0U && soter_store_next(s, &at, key, &sleep)) {
    key[0] &= ~calendar;
    sum += soter_fingerprint(key, s->packed);
  }
  if (calendar != 0U) {
    return sum;
  }
  for (uint32_t g = 0; g < s->segments; g++) {
    const uint8_t* e = s->segment[g].entry;
    for (uint64_t i = 0; i < s->segment[g].buckets * BUCKET; i++, e += s->bytes) {
      if (!is_empty(s, e)) {
        key_of(s, e, key);
        sum += soter_fingerprint(key, s->words);
      }
    }
  }
  return sum;
}

/* Whether all of it is in another table, at the other one's place in the calendar. */
static bool is_in(const soter_store* s, const soter_store* other, uint64_t calendar) {
  uint64_t packed[SOTER_WORDS];
  uint64_t key[SOTER_WORDS];
  uint64_t sleep = 0U;
  soter_cursor at = {0U, 0U};
  bool same = soter_store_next(other, &at, packed, &sleep);
  const uint64_t then = packed[0] & calendar;
  const soter_cursor begin = {0U, 0U};
  at = begin;
  while (same && soter_store_next(s, &at, packed, &sleep)) {
    packed[0] = (packed[0] & ~calendar) | then;
    soter_store_key(other, packed, key);
    (void)place_of(other, segment_of(other, packed, key), key, &same);
  }
  return same;
}

static bool segment_is_in(const soter_store* s, uint32_t segment, const soter_store* other) {
  uint64_t key[SOTER_WORDS];
  bool same = true;
  const uint8_t* e = s->segment[segment].entry;
  for (uint64_t i = 0; same && i < s->segment[segment].buckets * BUCKET; i++, e += s->bytes) {
    if (!is_empty(s, e)) {
      key_of(s, e, key); /* a layer's segments are told apart by keys alone */
      (void)place_of(other, segment_of(other, key, key), key, &same);
    }
  }
  return same;
}

bool soter_store_same(const soter_store* s, const soter_store* other, uint64_t calendar) {
  bool same = s->count == other->count && s->bytes == other->bytes && s->layer && other->layer;
  if (calendar != 0U) {
    return same && (other->count == 0U || is_in(s, other, calendar));
  }
  for (uint32_t g = 0; same && g < s->segments; g++) {
    same = segment_is_in(s, g, other);
  }
  return same;
}

typedef struct kept {
  soter_store store;
  struct kept* next;
} kept;

void* soter_keep_table(void* others, soter_store* s) {
  kept* const k = s->segment == NULL ? NULL : malloc(sizeof *k);
  if (k == NULL) { /* it never opened, or there is no memory: its table is closed by who has it */
    return others;
  }
  k->store = *s;
  k->store.stop = NULL; /* which ends with the search */
  s->segment = NULL;    /* it is no longer the search's */
  s->own = NULL;
  k->next = others;
  return k;
}

void* soter_join_kept(void* others, void* more) {
  kept* last = more;
  while (last != NULL && last->next != NULL) {
    last = last->next;
  }
  if (last == NULL) {
    return others;
  }
  last->next = others;
  return more;
}

typedef struct {
  const soter_model* m;
  uint8_t* next;
} unpacking;

static void unpack_one(void* to, const uint64_t* packed) {
  unpacking* const u = to;
  SOTER_CHECK(u->next != NULL);
  (void)memset(u->next, 0, u->m->configuration_size);
  soter_start(u->m->program, u->next, 0U);
  u->m->unpack(packed, u->next);
  u->next += u->m->configuration_size;
}

void soter_kept_each(const void* first, void (*each)(void* to, const uint64_t* packed), void* to) {
  for (const kept* k = first; k != NULL; k = k->next) {
    (void)soter_store_each(&k->store, each, to);
  }
}

uint64_t soter_explore_kept(const soter_model* m, const void* first, void* configurations) {
  uint64_t count = 0U;
  unpacking u = {m, configurations};
  for (const kept* k = first; k != NULL; k = k->next) {
    count += soter_store_each(&k->store, configurations != NULL ? unpack_one : NULL, &u);
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
