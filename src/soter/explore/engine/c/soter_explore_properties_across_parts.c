/* soter_explore_properties_across_parts.c: properties that read several parts of a
 * system which share nothing else (docs/testing.md, "Joined parts").
 *
 * Purpose: where all windows are points, what is reached at the end of an instant is every
 * combination of what the parts have reached then. So a property that reads several of them is
 * judged on all combinations of what it can see of each, which a search of each part alone noted.
 * Non-goals: executions (explore/engine/reductions.py puts those of the parts
 * together).
 */
#include "soter_explore_internal.h"

#define LOOK 4095U               /* combinations between two looks at whether it is to stop */
#define SIDES 8U                 /* at most */
#define MANY (UINT64_C(1) << 34) /* combinations that can be told apart, at most */

/* What a part shows at a time; `id` says what that is, whatever the time. */
typedef struct {
  int64_t now;
  uint32_t id, item; /* `item` in the row of its side */
} shown;

typedef struct {
  uint64_t* bits; /* [words] of the part, without the schedule's */
  soter_row row;  /* what was noted */
  shown* at;      /* [row.count], by time */
  uint64_t* each; /* [ids * words] */
  uint32_t ids;
  uint64_t from, until; /* in `at`: what it shows now */
} side;

typedef struct {
  soter_workspace space;
  const soter_model* m;
  uint32_t sides, property;
  side of[SIDES];
  uint8_t* tried;  /* a bit for each combination of ids */
  uint64_t* start; /* [words] */
  uint64_t turns;
} joint;

void soter_explore_noted(const soter_model* m, uint64_t actors, uint64_t* mask) {
  for (uint32_t k = 0; k < m->words; k++) {
    uint64_t written = 0U;
    for (uint32_t i = 0; i < m->actors; i++) {
      written |= (actors >> i & 1U) != 0U ? m->actor[i].writes[k] : 0U;
    }
    mask[k] = m->scheduled[k] | (written & m->observed[k]);
  }
  mask[0] |= 1U; /* always set: no entry of a table is all zeros */
  SOTER_CHECK(m->words > 0U);
}

static void take(void* to, const uint64_t* packed) {
  side* const s = to;
  if (!soter_row_put(&s->row, packed, 0U, 0U)) {
    s->ids = SOTER_NOTHING; /* no memory */
  }
}

static int by_time(const void* a, const void* b) {
  const shown* const left = a;
  const shown* const right = b;
  if (left->now != right->now) {
    return left->now < right->now ? -1 : 1;
  }
  return left->id < right->id ? -1 : left->id > right->id ? 1 : 0;
}

/* The number of what is shown, from 0; it is new where that is `s->ids`. */
static uint32_t id_of(const side* s, const uint32_t* slots, uint32_t mask, const uint64_t* bits,
                      uint32_t words, uint32_t* slot) {
  uint32_t i = (uint32_t)(soter_fingerprint(bits, words) >> 32) & mask;
  for (; slots[i] != 0U; i = (i + 1U) & mask) {
    if (memcmp(s->each + (size_t)(slots[i] - 1U) * words, bits, words * sizeof *bits) == 0) {
      break;
    }
  }
  *slot = i;
  SOTER_CHECK(slots[i] <= s->ids);
  return slots[i] != 0U ? slots[i] - 1U : s->ids;
}

/* Numbers all that is shown. */
static bool number(joint* j, side* s, uint32_t* slots, uint32_t mask) {
  const uint32_t words = j->m->words;
  for (uint32_t i = 0; i < s->row.count; i++) {
    uint64_t* const own = s->each + (size_t)s->ids * words;
    const uint64_t* const packed = soter_row_at(&s->row, i);
    uint32_t slot = 0U;
    for (uint32_t k = 0; k < words; k++) {
      own[k] = packed[k] & s->bits[k];
    }
    const uint32_t id = id_of(s, slots, mask, own, words, &slot);
    s->ids += id == s->ids ? 1U : 0U;
    slots[slot] = id + 1U;
    j->m->unpack(packed, j->space.there);
    const shown one = {soter_schedule_of(j->m->program, j->space.there)->now, id, i};
    s->at[i] = one;
  }
  qsort(s->at, s->row.count, sizeof *s->at, by_time);
  SOTER_CHECK(s->ids <= s->row.count);
  return s->row.count > 0U && s->at[0].now < 0;
}

static bool open_side(joint* j, side* s, const soter_side* given) {
  const uint32_t words = j->m->words;
  s->row.words = s->row.width = words;
  soter_kept_each(given->kept, take, s);
  if (s->ids != 0U || s->row.count == 0U || s->row.count > UINT32_MAX / 4U) {
    return false;
  }
  uint32_t mask = 15U;
  while (mask < 2U * s->row.count) {
    mask = mask * 2U + 1U;
  }
  s->bits = malloc(words * sizeof *s->bits);
  s->at = malloc(s->row.count * sizeof *s->at);
  s->each = malloc((s->row.count + 1U) * words * sizeof *s->each);
  uint32_t* const slots = calloc(mask + 1U, sizeof *slots);
  bool ok = s->bits != NULL && s->at != NULL && s->each != NULL && slots != NULL;
  if (ok) {
    soter_explore_noted(j->m, given->actors, s->bits);
    for (uint32_t k = 0; k < words; k++) {
      s->bits[k] &= ~j->m->scheduled[k];
    }
    ok = number(j, s, slots, mask);
  }
  free(slots);
  return ok;
}

/* Moves all parts on to the next time that one of them has; false: there is none. */
static bool go_on(joint* j) {
  int64_t next = SOTER_NO_DEADLINE;
  for (uint32_t i = 0; i < j->sides; i++) {
    const side* const s = &j->of[i];
    if (s->until < s->row.count && s->at[s->until].now < next) {
      next = s->at[s->until].now;
    }
  }
  for (uint32_t i = 0; next < SOTER_NO_DEADLINE && i < j->sides; i++) {
    side* const s = &j->of[i];
    if (s->until < s->row.count && s->at[s->until].now == next) {
      s->from = s->until;
      while (s->until < s->row.count && s->at[s->until].now == next) {
        s->until++;
      }
    }
    SOTER_CHECK(s->from < s->until);
  }
  return next < SOTER_NO_DEADLINE;
}

/* Whether a combination was not tried before; it is now. */
static bool is_new(joint* j, const uint64_t* at) {
  uint64_t number = 0U;
  for (uint32_t i = 0; i < j->sides; i++) {
    number = number * j->of[i].ids + j->of[i].at[at[i]].id;
  }
  SOTER_CHECK(number < MANY);
  const uint8_t bit = (uint8_t)(1U << (number & 7U));
  const bool fresh = (j->tried[number >> 3] & bit) == 0U;
  j->tried[number >> 3] |= bit;
  return fresh;
}

static bool violates(joint* j, const uint64_t* at) {
  const uint32_t words = j->m->words;
  uint64_t packed[SOTER_WORDS];
  soter_copy_words(packed, j->start, words);
  for (uint32_t i = 0; i < j->sides; i++) {
    const side* const s = &j->of[i];
    const uint64_t* const own = s->each + (size_t)s->at[at[i]].id * words;
    for (uint32_t k = 0; k < words; k++) {
      packed[k] = (packed[k] & ~s->bits[k]) | own[k];
    }
  }
  j->m->unpack(packed, j->space.there);
  SOTER_CHECK(j->property < j->space.p->properties);
  return j->space.p->property[j->property].violated(j->space.there);
}

/* All combinations of what is shown now; `at` is one that violates then. */
static soter_explore_status combine(joint* j, uint64_t* at) {
  for (uint32_t i = 0; i < j->sides; i++) {
    at[i] = j->of[i].from;
  }
  for (uint32_t i = 0; i < j->sides;) {
    if ((++j->turns & LOOK) == 0U && soter_is_stopped(&j->space)) {
      return SOTER_STOPPED;
    }
    if (is_new(j, at) && violates(j, at)) {
      return SOTER_VIOLATED;
    }
    for (i = 0U; i < j->sides && ++at[i] == j->of[i].until; i++) {
      at[i] = j->of[i].from;
    }
  }
  return SOTER_EXHAUSTED;
}

/* Whether there is one start; it is in `start`. */
static bool begin(joint* j) {
  j->space.given = 0U;
  soter_make_start(&j->space);
  j->m->pack(j->space.there, j->start);
  SOTER_CHECK(j->start[0] != 0U);
  return !soter_next_picks(&j->space) && !j->space.too_many && !j->space.cut;
}

/* All parts, and room for all combinations. */
static bool open_all(joint* j, const soter_explore_options* o, const soter_side* given) {
  uint64_t many = 1U;
  bool ok = true;
  for (uint32_t i = 0; ok && i < j->sides; i++) {
    ok = open_side(j, &j->of[i], &given[i]) && many <= MANY / j->of[i].ids;
    many *= ok ? j->of[i].ids : 1U;
  }
  j->start = malloc(j->m->words * sizeof *j->start);
  if (!ok || j->start == NULL || many / 8U > o->memory / 4U) {
    return false;
  }
  j->tried = soter_allocate(many / 8U + 1U);
  return j->tried != NULL && begin(j);
}

static void close_all(joint* j) {
  uint64_t many = 1U;
  for (uint32_t i = 0; i < j->sides; i++) {
    side* const s = &j->of[i];
    many *= s->ids;
    soter_row_close(&s->row);
    free(s->bits);
    free(s->at);
    free(s->each);
  }
  soter_free(j->tried, j->tried == NULL ? 0U : many / 8U + 1U);
  free(j->start);
  soter_workspace_close(&j->space);
}

/* Goes through time. */
static soter_explore_status judge(joint* j, soter_explore_coverage* coverage, uint64_t* at) {
  soter_explore_status status = SOTER_EXHAUSTED;
  (void)go_on(j); /* the start, which nobody sees */
  while (status == SOTER_EXHAUSTED && go_on(j)) {
    coverage->judged[j->property] = SOTER_JUDGED | SOTER_MET; /* no premise is looked at here */
    status = combine(j, at);
  }
  SOTER_CHECK(j->sides >= 2U);
  return status;
}

soter_explore_status soter_explore_joined(const soter_model* m, const soter_explore_options* o,
                                          const soter_side* given, uint32_t sides,
                                          uint32_t property, soter_explore_progress* progress,
                                          soter_explore_coverage* coverage, uint64_t* goals) {
  joint j;
  uint64_t at[SIDES];
  (void)memset(&j, 0, sizeof j);
  if (sides < 2U || sides > SIDES || !soter_workspace_open(&j.space, m, NULL, progress, NULL)) {
    soter_workspace_close(&j.space);
    return SOTER_MEMORY;
  }
  j.m = m;
  j.sides = sides;
  j.property = property;
  const soter_explore_status status =
      open_all(&j, o, given) ? judge(&j, coverage, at) : SOTER_MEMORY;
  for (uint32_t i = 0; status == SOTER_VIOLATED && i < sides; i++) {
    soter_copy_words(goals + (size_t)i * m->words,
                     soter_row_at(&j.of[i].row, j.of[i].at[at[i]].item), m->words);
  }
  close_all(&j);
  return status;
}
