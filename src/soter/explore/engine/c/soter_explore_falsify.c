/* soter_explore_falsify.c: executions by simple plans.
 *
 * Purpose: a *plan* has a signal for everything that is decided (who is first, when an actor steps,
 * each stream of choices): constant over a few pieces of the time, as S-TaLiRo and Breach take
 * them. Every execution has a plan of its own, drawn where it is first asked for: what is done for
 * a while brings a float further than pushes to and fro, which cancel each other. Non-goals: other
 * alternatives than those of docs/testing.md; completeness.
 */
#include "soter_explore_sampled_walk.h"

#define STREAMS 256U /* signals; what is decided beyond them shares them */
#define PIECES 4U
#define TIMES 65536U /* parts of the horizon */

/* A decision: how it is made (the upper two bits), and a number. */
#define FIRST 0U /* the default; of who moves: in the deployed order */
#define LAST 1U
#define FIXED \
  2U /* one that is not the default, by the number; of who moves: priorities made of it */
#define NOISE 3U /* another one each time, made of the number */
#define NUMBER ((1U << 30) - 1U)

typedef struct {
  uint32_t at; /* in parts of the horizon; the first begins at 0 */
  uint32_t value;
} piece;

typedef struct {
  piece piece[PIECES]; /* by time */
  uint32_t count;      /* 0: nothing has asked yet */
} signal;

typedef struct {
  uint64_t key[STREAMS];
  uint32_t known;
  signal plan[STREAMS];
  uint32_t actor; /* who moves */
} falsifier;

static uint32_t time_now(soter_walk* w) {
  const int64_t now = soter_schedule_of(w->space.p, w->space.here)->now;
  const double part = (double)soter_later(now, 0) / ((double)w->space.m->horizon_ns + 1.0);
  SOTER_CHECK(part >= 0.0);
  return part < 1.0 ? (uint32_t)(part * TIMES) : TIMES - 1U; /* a late step, after the horizon */
}

static uint32_t draw_value(soter_walk* w, uint32_t kind) {
  static const uint32_t how[3][10] = {
      {FIRST, FIRST, FIRST, FIRST, FIXED, FIXED, FIXED, FIXED, NOISE, NOISE},
      {FIRST, FIRST, FIRST, FIRST, FIRST, LAST, LAST, LAST, FIXED, NOISE},
      {FIRST, FIRST, FIXED, FIXED, FIXED, FIXED, FIXED, FIXED, FIXED, NOISE}};
  SOTER_CHECK(kind < 3U);
  return how[kind][soter_walk_random(w, 10U)] << 30 | soter_walk_random(w, 1U << 30);
}

/* Puts a piece where its time is; the same time: in place of what is there. */
static void put_piece(signal* g, uint32_t at, uint32_t value) {
  uint32_t i = g->count;
  while (i > 0U && g->piece[i - 1U].at > at) {
    i--;
  }
  if (i > 0U && g->piece[i - 1U].at == at) {
    g->piece[i - 1U].value = value;
    return;
  }
  SOTER_CHECK(g->count < PIECES);
  for (uint32_t k = g->count; k > i; k--) {
    g->piece[k] = g->piece[k - 1U];
  }
  g->piece[i].at = at;
  g->piece[i].value = value;
  g->count++;
}

static void draw_signal(soter_walk* w, signal* g, uint32_t kind) {
  g->count = 0U;
  put_piece(g, 0U, draw_value(w, kind));
  while (g->count < PIECES && soter_walk_random(w, 2U) == 0U) {
    put_piece(g, 1U + soter_walk_random(w, TIMES - 1U), draw_value(w, kind));
  }
}

static uint32_t value_at(const signal* g, uint32_t time) {
  uint32_t i = g->count - 1U;
  SOTER_CHECK(g->count > 0U && g->piece[0].at == 0U);
  while (g->piece[i].at > time) {
    i--;
  }
  return g->piece[i].value;
}

static uint32_t stream_of(falsifier* f, uint64_t key) {
  for (uint32_t i = 0; i < f->known; i++) {
    if (f->key[i] == key) {
      return i;
    }
  }
  if (f->known == STREAMS) {
    return (uint32_t)(key % STREAMS);
  }
  f->key[f->known] = key;
  return f->known++;
}

/* What the plan says; where nothing has asked yet, it is made up. */
static uint32_t planned(soter_walk* w, uint64_t key, uint32_t kind, uint32_t time) {
  falsifier* const f = w->own;
  signal* const g = &f->plan[stream_of(f, key)];
  if (g->count == 0U) {
    draw_signal(w, g, kind);
  }
  return value_at(g, time);
}

/* What is decided: a stream, and which of its choices in this step. */
static uint64_t choice_key(const soter_workspace* space) {
  const uint64_t stream = space->choice[space->given].stream;
  uint64_t before = 0U;
  for (uint32_t i = 0; i < space->given; i++) {
    before += space->choice[i].stream == stream ? 1U : 0U;
  }
  return soter_mix(stream + before);
}

static uint32_t decide(soter_walk* w, uint32_t kind, uint32_t count) {
  const falsifier* const f = w->own;
  if (count <= 1U) {
    return 0U;
  }
  const uint64_t key = kind == 1U ? soter_mix(f->actor) : choice_key(&w->space);
  const uint32_t time = time_now(w);
  const uint32_t value = planned(w, key, kind, time);
  switch (value >> 30) {
    case FIRST:
      return 0U;
    case LAST:
      return count - 1U;
    case NOISE:
      return (uint32_t)(soter_mix(key ^ soter_mix(value + (uint64_t)w->steps)) % count);
    default:
      return 1U + (value & NUMBER) % (count - 1U);
  }
}

static uint32_t who(soter_walk* w, uint64_t enabled) {
  falsifier* const f = w->own;
  const uint32_t value = planned(w, 0U, 0U, time_now(w));
  const uint64_t also = value >> 30 == NOISE ? w->steps : 0U;
  uint32_t best = SOTER_ACTORS;
  uint64_t highest = 0U;
  for (uint32_t i = 0; i < SOTER_ACTORS; i++) {
    const bool in_order = value >> 30 == FIRST;
    const uint64_t rank = in_order ? SOTER_ACTORS - i : soter_mix(soter_mix(value + also) ^ i);
    if ((enabled >> i & 1U) != 0U && (best == SOTER_ACTORS || rank > highest)) {
      best = i;
      highest = rank;
    }
  }
  SOTER_CHECK(best < SOTER_ACTORS); /* somebody may move */
  f->actor = best;
  return best;
}

static void begin(soter_walk* w, uint64_t run) {
  falsifier* const f = w->own;
  w->random = soter_mix(w->s->o->seed ^ soter_mix(run + 1U));
  (void)memset(f->plan, 0, sizeof f->plan);
}

void soter_search_falsify(soter_search* s) {
  const soter_sampling by_plans = {decide, who, begin};
  falsifier* const own = calloc(1U, sizeof *own);
  soter_walk_all(s, &by_plans, own, own != NULL);
  free(own);
}
