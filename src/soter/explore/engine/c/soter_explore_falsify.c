/* soter_explore_falsify.c: executions guided by how near they come to a violation.
 *
 * Purpose: a *plan* has a signal for everything that is decided (who is first, when an actor steps,
 * each stream of choices): constant over a few pieces of the time, as S-TaLiRo and Breach take
 * them. An execution is worth the least robustness (soter_explore_robustness.h) of one property
 * along it. Plans are changed, at times before that least value, and crossed; one that is not worse
 * takes its parent's place. Each property has a pool of plans, and begins anew where nothing gets
 * better; the one that is nearest to a violation is followed most. Non-goals: other alternatives
 * than those of docs/testing.md; completeness.
 */
#include "soter_explore_sampled_walk.h"

#define STREAMS 256U /* signals; what is decided beyond them shares them */
#define PIECES 8U
#define KEPT 12U      /* plans */
#define FRESH 36U     /* plans that are tried before any is changed */
#define PATIENCE 200U /* executions without a better one; twice as many after each round */
#define ROUNDS 5U
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
  signal of[STREAMS];
  double worth;
  uint32_t when; /* it was worth so little */
} plan;

/* The plans that came nearest to violating one property, since it last began anew. */
typedef struct {
  plan kept[KEPT];
  uint32_t count, round; /* how often it began anew, up to ROUNDS */
  uint64_t age, better;  /* executions for its sake, in all and until the last better one */
  double best;
} pool;

typedef struct {
  uint64_t key[STREAMS];
  uint32_t kind[STREAMS]; /* as of soter_walk.decide */
  uint32_t known;
  plan now;
  pool* pool;      /* of each guide */
  uint32_t focus;  /* the guide for whose sake this execution is; */
  uint32_t turn;   /* whose turn it is */
  uint32_t parent; /* of `now`, in its pool; KEPT: none */
  double* scale;   /* of each comparison */
  double* least;   /* of each guide, along this execution */
  uint32_t* when;
  bool guided;    /* some property compares numbers */
  uint32_t actor; /* who moves */
} falsifier;

static uint32_t time_now(soter_walk* w) {
  const int64_t now = soter_schedule_of(w->x.p, w->x.here)->now;
  const double part = (double)soter_later(now, 0) / ((double)w->x.m->horizon_ns + 1.0);
  SOTER_CHECK(part >= 0.0);
  return part < 1.0 ? (uint32_t)(part * TIMES) : TIMES - 1U; /* a late step, after the horizon */
}

/* ------------------------------------------------------------------ signals */

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
  if (g->count == PIECES) {
    return;
  }
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
  while (g->count < PIECES / 2U && soter_walk_random(w, 2U) == 0U) {
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

static uint32_t stream_of(falsifier* f, uint64_t key, uint32_t kind) {
  for (uint32_t i = 0; i < f->known; i++) {
    if (f->key[i] == key) {
      return i;
    }
  }
  if (f->known == STREAMS) {
    return (uint32_t)(key % STREAMS);
  }
  f->key[f->known] = key;
  f->kind[f->known] = kind;
  return f->known++;
}

/* What the plan says; where nothing has asked yet, it is made up. */
static uint32_t planned(soter_walk* w, uint64_t key, uint32_t kind, uint32_t time) {
  falsifier* const f = w->own;
  signal* const g = &f->now.of[stream_of(f, key, kind)];
  if (g->count == 0U) {
    draw_signal(w, g, kind);
  }
  return value_at(g, time);
}

/* ------------------------------------------------------------------ decisions */

/* What is decided: a stream, and which of its choices in this step. */
static uint64_t choice_key(const soter_place* x) {
  const uint64_t stream = x->choice[x->given].stream;
  uint64_t before = 0U;
  for (uint32_t i = 0; i < x->given; i++) {
    before += x->choice[i].stream == stream ? 1U : 0U;
  }
  return soter_mix(stream + before);
}

static uint32_t decide(soter_walk* w, uint32_t kind, uint32_t count) {
  const falsifier* const f = w->own;
  if (count <= 1U) {
    return 0U;
  }
  const uint64_t key = kind == 1U ? soter_mix(f->actor) : choice_key(&w->x);
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

/* ------------------------------------------------------------------ robustness */

/* The share of a time that is left, positive at its last instant; negative: it is over. */
static double share(int64_t left_ns, int64_t within_ns) {
  return (double)(left_ns < 0 ? left_ns : left_ns + 1) / ((double)within_ns + 1.0);
}

/* Of a promise that was not kept in its time: how long it has been over, negative. Nothing keeps
 * one after the end of an execution. Seen in every configuration. */
static double missed(soter_walk* w, const soter_aim* g) {
  soter_place* const x = &w->x;
  const int64_t due = soter_due_of(x->p, x->there)[g->index];
  const int64_t now = soter_schedule_of(x->p, x->there)->now;
  const int64_t within = x->m->timed[g->index].within_ns;
  if (due == SOTER_NO_DEADLINE || now < 0) {
    return (double)INFINITY;
  }
  if (due < now) {
    return share(due - now, within);
  }
  return soter_at_the_end(x) ? share(due - x->m->horizon_ns - 1, within) : (double)INFINITY;
}

/* Of a promise: what was left of its time when it was kept; where none was asked for, how far the
 * premise is from asking. */
static double promise(soter_walk* w, const soter_aim* g, double* scale) {
  soter_place* const x = &w->x;
  const soter_timed* const t = &x->m->timed[g->index];
  const int64_t before = soter_due_of(x->p, x->here)[g->index];
  const int64_t after = soter_due_of(x->p, x->there)[g->index];
  if (before != SOTER_NO_DEADLINE) {
    const int64_t now = soter_schedule_of(x->p, x->there)->now;
    return before == after ? (double)INFINITY : share(before - now, t->within_ns);
  }
  if (after != SOTER_NO_DEADLINE || g->premise == NULL) {
    return (double)INFINITY; /* it is asked for from now on; or was kept for good */
  }
  const double asks = g->premise(x->there, scale);
  return asks > 0.0 ? 1.0 : 1.0 - asks;
}

/* Of an invariant: safe, and the time until SC has to act. */
static double invariant(soter_walk* w, const soter_aim* g, double* scale) {
  soter_place* const x = &w->x;
  const soter_timed* const t = &x->m->timed[g->index];
  const double safe = g->of(x->there, scale);
  if (soter_acted_of(x->m, x->there)[t->module] != 0U) {
    return safe;
  }
  const int64_t now = soter_schedule_of(x->p, x->there)->now;
  const int64_t until = soter_verdict_of(x->m, x->there)[t->module] + t->within_ns;
  const double left = share(until - now, t->within_ns);
  return left < safe ? left : safe;
}

static double robustness(soter_walk* w, const soter_aim* g, double* scale, bool observable) {
  if (g->what == 0U) {
    return observable ? g->of(w->x.there, scale) : (double)INFINITY;
  }
  if (w->x.m->timed[g->index].kind == SOTER_INVARIANT) {
    return observable ? invariant(w, g, scale) : (double)INFINITY;
  }
  const double over = missed(w, g);
  return observable && over > 0.0 ? promise(w, g, scale) : over;
}

static void observe(soter_walk* w) {
  falsifier* const f = w->own;
  const bool observable = soter_is_observable(&w->x);
  for (uint32_t i = 0; i < w->x.m->guides; i++) {
    const double found = robustness(w, &w->x.m->guide[i], f->scale, observable);
    if (found < f->least[i]) {
      f->least[i] = found;
      f->when[i] = time_now(w);
    }
    if (found < w->s->coverage->nearest[i]) {
      w->s->coverage->nearest[i] = found;
    }
  }
}

/* ------------------------------------------------------------------ plans */

/* A length of time, from half of the horizon to half a hundredth of it. */
static uint32_t some_width(soter_walk* w) {
  return TIMES >> (1U + 2U * soter_walk_random(w, 4U));
}

/* A time at which a change may matter: not after the least value, often shortly before. */
static uint32_t early(soter_walk* w, const plan* p) {
  const uint32_t before = soter_walk_random(w, 2U) == 0U ? some_width(w) : TIMES;
  const uint32_t room = before <= p->when ? before : p->when + 1U;
  return p->when - soter_walk_random(w, room);
}

/* Another time, a little off or far off. */
static uint32_t near(soter_walk* w, uint32_t at) {
  const uint32_t width = some_width(w);
  const uint32_t later = at + soter_walk_random(w, width);
  const uint32_t found = later < width / 2U ? 0U : later - width / 2U;
  return found < TIMES ? found : TIMES - 1U;
}

static void change_piece(soter_walk* w, const plan* p, signal* g, uint32_t kind) {
  const uint32_t i = soter_walk_random(w, g->count);
  piece* const one = &g->piece[i];
  const piece old = *one;
  if (i > 0U && soter_walk_random(w, 2U) == 0U) { /* another time, or none */
    g->count--;
    for (uint32_t k = i; k < g->count; k++) {
      g->piece[k] = g->piece[k + 1U];
    }
    if (soter_walk_random(w, 3U) != 0U) {
      put_piece(g, near(w, old.at), old.value);
    }
    return;
  }
  if (old.at <= p->when) {
    one->value = draw_value(w, kind);
  }
}

/* For a while something else. */
static void put_burst(soter_walk* w, const plan* p, signal* g, uint32_t kind) {
  const uint32_t begin = early(w, p);
  const uint32_t end = begin + 1U + soter_walk_random(w, some_width(w));
  if (g->count + 2U > PIECES) {
    return;
  }
  const uint32_t after = value_at(g, end < TIMES ? end : TIMES - 1U);
  put_piece(g, begin, draw_value(w, kind));
  if (end < TIMES) {
    put_piece(g, end, after);
  }
}

static void change(soter_walk* w, plan* p) {
  const falsifier* const f = w->own;
  const uint32_t stream = soter_walk_random(w, f->known);
  const uint32_t kind = f->kind[stream];
  signal* const g = &p->of[stream];
  if (g->count == 0U) {
    return;
  }
  switch (soter_walk_random(w, 5U)) {
    case 0U:
      draw_signal(w, g, kind);
      break;
    case 1U:
      put_piece(g, early(w, p), draw_value(w, kind));
      break;
    case 2U:
      put_burst(w, p, g, kind);
      break;
    default:
      change_piece(w, p, g, kind);
      break;
  }
}

/* The better one of two. */
static uint32_t parent(soter_walk* w, const pool* p) {
  const uint32_t a = soter_walk_random(w, p->count);
  const uint32_t b = soter_walk_random(w, p->count);
  SOTER_CHECK(p->count > 0U && p->count <= KEPT);
  return p->kept[a].worth <= p->kept[b].worth ? a : b;
}

/* What is not drawn here is drawn where it is first asked for. */
static void draw_plan(falsifier* f) {
  f->parent = KEPT;
  (void)memset(&f->now, 0, sizeof f->now);
}

static void change_plan(soter_walk* w, const pool* p) {
  falsifier* const f = w->own;
  f->parent = parent(w, p);
  f->now = p->kept[f->parent];
  if (soter_walk_random(w, 4U) == 0U) {
    const plan* const other = &p->kept[parent(w, p)];
    for (uint32_t i = 0; i < f->known; i++) {
      if (soter_walk_random(w, 2U) == 0U) {
        f->now.of[i] = other->of[i];
      }
    }
  }
  do {
    change(w, &f->now);
  } while (soter_walk_random(w, 3U) == 0U);
}

static void start(pool* p) {
  p->count = 0U;
  p->age = 0U;
  p->better = 0U;
  p->best = (double)INFINITY;
}

/* Whether a guide is of something that numbers decide, and that is not known already. */
static bool leads(const soter_search* s, uint32_t i) {
  const soter_aim* const g = &s->m->guide[i];
  bool wanted = !g->flat;
  for (uint32_t k = 0; k < s->o->knowns; k++) {
    wanted = wanted && (s->o->known[k].what != g->what || s->o->known[k].index != g->index);
  }
  return wanted;
}

/* Half of the time the property that is nearest to a violation, else each in turn. */
static uint32_t next_focus(soter_walk* w) {
  falsifier* const f = w->own;
  const soter_model* const m = w->s->m;
  do {
    f->turn = f->turn + 1U < m->guides ? f->turn + 1U : 0U;
  } while (!leads(w->s, f->turn));
  if (soter_walk_random(w, 2U) == 0U) {
    return f->turn;
  }
  uint32_t nearest = f->turn;
  for (uint32_t i = 0; i < m->guides; i++) {
    nearest = leads(w->s, i) && f->pool[i].best < f->pool[nearest].best ? i : nearest;
  }
  return nearest;
}

static void begin(soter_walk* w, uint64_t run) {
  falsifier* const f = w->own;
  w->random = soter_mix(w->s->o->seed ^ soter_mix(run + 1U));
  for (uint32_t i = 0; i < w->s->m->guides; i++) {
    f->least[i] = (double)INFINITY;
    f->when[i] = TIMES - 1U;
  }
  draw_plan(f);
  if (!f->guided) {
    return;
  }
  f->focus = next_focus(w);
  pool* const p = &f->pool[f->focus];
  if (p->age - p->better > (uint64_t)PATIENCE << p->round) {
    p->round += p->round < ROUNDS ? 1U : 0U;
    start(p);
  }
  if (p->age >= FRESH && p->count > 0U && soter_walk_random(w, 8U) != 0U) {
    change_plan(w, p);
  }
}

/* Which plan of a pool gives way to this one; KEPT: none. `parent`: it was changed; KEPT: none. */
static uint32_t place_for(const pool* p, double worth, uint32_t parent) {
  uint32_t worst = 0U;
  if (parent < KEPT) {
    return worth <= p->kept[parent].worth ? parent : KEPT;
  }
  if (p->count < KEPT) {
    return p->count;
  }
  for (uint32_t i = 1U; i < p->count; i++) {
    worst = p->kept[i].worth > p->kept[worst].worth ? i : worst;
  }
  return worth < p->kept[worst].worth ? worst : KEPT;
}

/* Whatever an execution was for: it counts for every property that it came near to violating. */
static void end(soter_walk* w, uint64_t run) {
  falsifier* const f = w->own;
  (void)run;
  for (uint32_t i = 0; f->guided && i < w->s->m->guides; i++) {
    pool* const p = &f->pool[i];
    const bool own = i == f->focus;
    f->now.worth = f->least[i];
    f->now.when = f->when[i];
    p->age += own || f->parent == KEPT ? 1U : 0U;
    if (f->now.worth < p->best) {
      p->best = f->now.worth;
      p->better = p->age;
    }
    const uint32_t at = place_for(p, f->now.worth, own ? f->parent : KEPT);
    if (at < KEPT) {
      p->kept[at] = f->now;
      p->count += at == p->count ? 1U : 0U;
    }
  }
}

static bool open(falsifier* f, const soter_search* s) {
  const soter_model* const m = s->m;
  f->scale = calloc((size_t)m->scales + 1U, sizeof *f->scale);
  f->least = calloc((size_t)m->guides + 1U, sizeof *f->least);
  f->when = calloc((size_t)m->guides + 1U, sizeof *f->when);
  f->pool = calloc((size_t)m->guides + 1U, sizeof *f->pool);
  if (f->scale == NULL || f->least == NULL || f->when == NULL || f->pool == NULL) {
    return false;
  }
  for (uint32_t i = 0; i < m->guides; i++) {
    f->guided = f->guided || (leads(s, i) && !s->o->unguided);
    start(&f->pool[i]);
  }
  return true;
}

void soter_search_falsify(soter_search* s) {
  const soter_sampling by_margins = {decide, who, observe, begin, end};
  falsifier* const own = calloc(1U, sizeof *own);
  soter_walk_all(s, &by_margins, own, own != NULL && open(own, s));
  if (own != NULL) {
    free(own->scale);
    free(own->least);
    free(own->when);
    free(own->pool);
  }
  free(own);
}
