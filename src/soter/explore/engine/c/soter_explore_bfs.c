/* soter_explore_bfs.c: breadth first, on up to SOTER_THREADS threads.
 *
 * Purpose: all worlds, layer by layer; the shortest violation comes first. Each thread owns the
 * worlds whose hash says so: it has a table and a frontier of its own, and hands the others what is
 * theirs at the end of a layer, so that no table is shared and nothing is locked.
 * Where something is violated, the same search is made again with a link from every world to the
 * one it came from, until that violation: memory is not spent on links unless they are needed.
 */
#define _POSIX_C_SOURCE 200809L
#include <pthread.h>

#include "soter_explore_dfs.h"

#define THREADS SOTER_THREADS
#define AHEAD 32U   /* worlds that are expanded at once, */
#define HEIRS 256U  /* unless they have so many heirs */
#define LOOK 32768U /* worlds taken in between two looks at the bounds */

typedef struct worker {
  struct layered* all;
  uint32_t id;
  soter_expander expander;
  soter_store store;
  soter_explore_coverage coverage;
  soter_row here, next, out[THREADS];
  uint64_t count, moved;
  uint64_t first;          /* the world of the frontier that is expanded */
  uint64_t taken;          /* heirs since the bounds were looked at */
  volatile uint64_t bytes; /* of all that is this worker's */
  uint64_t* key;           /* of heirs that are about to be put */
  uint32_t keys;
  bool broke, full;
  soter_broken broken;
  uint64_t culprit; /* links: the entry whose move breaks something */
  uint64_t last;    /* links: or the entry that is broken */
  soter_row links;  /* one thread: worlds as they came, each with the number of the one before */
} worker;

typedef struct layered {
  soter_search* s;
  uint32_t threads, words;
  uint32_t opened;
  bool link;
  worker w[THREADS];
  pthread_mutex_t mutex;
  pthread_cond_t turn;
  uint32_t waiting, turns; /* a barrier: not every system has one */
  bool open;               /* the workers may begin */
  bool done;
  soter_explore_status status;
  uint32_t depth;
} layered;

/* ------------------------------------------------------------------ room */

static bool more_keys(worker* w, uint32_t count) {
  if (count > w->keys) {
    uint64_t* const key = realloc(w->key, (size_t)count * 2U * w->all->words * sizeof *key);
    if (key == NULL) {
      w->full = true;
      return false;
    }
    w->key = key;
    w->keys = count * 2U;
  }
  return true;
}

static uint64_t frontier_of(const worker* w) {
  uint64_t bytes = soter_row_bytes(&w->here) + soter_row_bytes(&w->next) +
                   soter_row_bytes(&w->links) + (uint64_t)w->keys * w->all->words * sizeof *w->key;
  for (uint32_t k = 0; k < THREADS; k++) {
    bytes += soter_row_bytes(&w->out[k]);
  }
  return bytes;
}

/* ------------------------------------------------------------------ one world */

static void break_off(worker* w, const soter_broken* broken, uint64_t culprit) {
  if (!w->broke) {
    w->broke = true;
    w->broken = *broken;
    w->culprit = culprit;
    w->last = w->links.count - 1U; /* others may come after it */
  }
}

/* Takes a world in: new ones are judged and wait for the next layer. */
static void take_in(worker* w, const uint64_t* packed, const uint64_t* key, uint64_t sleep,
                    uint64_t from) {
  uint64_t again = 0U;
  const int fresh = soter_store_put_key(&w->store, packed, key, &sleep, &again);
  if (fresh < 0) {
    w->full = true;
    return;
  }
  if (fresh == 0) {
    if (again != 0U && !soter_row_put(&w->next, packed, sleep, again)) {
      w->full = true;
    }
    return;
  }
  soter_broken broken;
  SOTER_CHECK(again == 0U && w->count < w->store.count);
  w->count++;
  if (w->all->link && !soter_row_put(&w->links, packed, from, 0U)) {
    w->full = true;
  }
  if (soter_is_broken(&w->expander, packed, &broken)) {
    if (!soter_is_known(&w->expander.place, &broken)) {
      break_off(w, &broken, SOTER_NO_DEADLINE);
    }
    return;
  }
  if (!soter_row_put(&w->next, packed, sleep, UINT64_MAX)) {
    w->full = true;
  }
}

static uint32_t owner_of(const layered* all, const uint64_t* packed) {
  if (all->threads == 1U) {
    return 0U;
  }
  uint64_t h = 0U;
  for (uint32_t k = 0; k < all->words; k++) {
    h = (h ^ packed[k]) * UINT64_C(0x9e3779b97f4a7c15);
  }
  SOTER_CHECK(all->threads <= THREADS);
  return (uint32_t)(h >> 40) % all->threads;
}

static bool stops(const layered* all) {
  return all->s->progress->stop != 0;
}

/* Gives every heir to its owner, of which this worker may be one. */
static void hand_on(worker* w) {
  layered* const all = w->all;
  const uint32_t words = all->words;
  const soter_heirs* const h = &w->expander.heirs;
  for (uint32_t k = 0; k < h->count; k++) {
    const uint64_t* const packed = h->packed + (size_t)k * words;
    soter_store_key(&w->store, packed, w->key + (size_t)k * words);
    soter_store_hint(&w->store, packed, w->key + (size_t)k * words);
  }
  w->taken += h->count;
  for (uint32_t k = 0; k < h->count && !w->full; k++) {
    const uint64_t* const packed = h->packed + (size_t)k * words;
    const uint32_t owner = owner_of(all, packed);
    SOTER_CHECK(owner < all->threads);
    if (owner == w->id) {
      take_in(w, packed, w->key + (size_t)k * words, h->sleep[k], w->moved + w->first);
    } else if (!soter_row_put(&w->out[owner], packed, h->sleep[k], 0U)) {
      w->full = true;
    }
  }
}

static bool over(const worker* w) {
  const soter_search* const s = w->all->s;
  return w->full || w->expander.place.too_many || stops(w->all) || (w->broke && !s->o->go_on);
}

/* Memory is one budget: what tables, frontiers and remembered steps of all workers take together.
 * The table may grow into this worker's share of what is left. */
static void weigh(worker* w) {
  layered* const all = w->all;
  const uint64_t memory = all->s->o->memory;
  const uint64_t table = soter_store_bytes(&w->store);
  w->bytes = table + frontier_of(w) + soter_expander_bytes(&w->expander);
  uint64_t bytes = 0U;
  for (uint32_t k = 0; k < all->threads; k++) {
    bytes += all->w[k].bytes;
  }
  const uint64_t left = memory > bytes ? (memory - bytes) / all->threads : 0U;
  w->store.memory = table + left;
  w->full = w->full || bytes > memory;
  w->taken = 0U;
  if (w->id == 0U) {
    all->s->progress->bytes = bytes;
  }
}

static void tell(worker* w) {
  soter_search* const s = w->all->s;
  weigh(w);
  if (w->id != 0U) {
    return;
  }
  uint64_t states = 0U;
  uint64_t transitions = 0U;
  for (uint32_t k = 0; k < w->all->threads; k++) {
    states += w->all->w[k].count;
    transitions += w->all->w[k].expander.transitions;
  }
  s->progress->states = states;
  s->progress->transitions = transitions;
  s->progress->depth = w->all->depth;
  w->full = w->full || (s->o->max_states > 0U && states >= s->o->max_states);
}

/* Heirs of one world, or of a few, go to their owners; false: no more are wanted. */
static bool take_away(void* to) {
  worker* const w = to;
  if (more_keys(w, w->expander.heirs.count)) {
    hand_on(w);
    w->full = w->full || w->expander.no_memory;
  }
  if (w->taken >= LOOK) {
    tell(w);
  }
  return !over(w);
}

/* Expands worlds of the frontier, from number `first`: as many as are looked for at once, so that
 * the machine can fetch the places of their heirs while others are computed. Returns how many. */
static uint64_t expand_some(worker* w, uint64_t first) {
  layered* const all = w->all;
  const uint32_t words = all->words;
  const uint64_t most = all->link ? 1U : AHEAD;
  soter_heirs* const h = &w->expander.heirs;
  uint64_t i = first;
  SOTER_CHECK(first < w->here.count);
  soter_forget(&w->expander);
  w->first = first;
  for (; i < w->here.count && i - first < most && h->count < HEIRS && !over(w); i++) {
    const uint64_t* const item = soter_row_at(&w->here, i);
    soter_expand(&w->expander, item, item[words], item[words + 1U]);
    if (w->expander.broke) {
      break_off(w, &w->expander.broken, w->moved + i);
    }
  }
  (void)take_away(w);
  return i - first;
}

/* ------------------------------------------------------------------ layers */

static void expand_layer(worker* w) {
  uint64_t told = 0U;
  uint64_t i = 0U;
  while (i < w->here.count && !over(w)) {
    i += expand_some(w, i);
    if (i - told >= 4096U) {
      told = i;
      tell(w);
    }
  }
}

static void wait_for_others(layered* all) {
  if (all->threads == 1U) {
    return;
  }
  (void)pthread_mutex_lock(&all->mutex);
  const uint32_t turn = all->turns;
  SOTER_CHECK(all->waiting < all->threads);
  if (++all->waiting == all->threads) {
    all->waiting = 0U;
    all->turns++;
    (void)pthread_cond_broadcast(&all->turn);
  }
  while (turn == all->turns) {
    (void)pthread_cond_wait(&all->turn, &all->mutex);
  }
  (void)pthread_mutex_unlock(&all->mutex);
}

static void receive(worker* w) {
  layered* const all = w->all;
  for (uint32_t k = 0; k < all->threads; k++) {
    soter_row* const q = &all->w[k].out[w->id];
    for (uint64_t i = 0; i < q->count && !w->full && !stops(all); i++) {
      const uint64_t* const item = soter_row_at(q, i);
      if (++w->taken >= LOOK) {
        weigh(w);
      }
      uint64_t key[SOTER_WORDS];
      soter_store_key(&w->store, item, key);
      take_in(w, item, key, item[all->words], 0U);
    }
    q->count = 0U;
  }
}

/* What ends the search after this layer, as far as one worker says. */
static soter_explore_status status_of(const layered* all, const worker* w) {
  const soter_search* const s = all->s;
  if (w->broke && !s->o->go_on) {
    return SOTER_VIOLATED;
  }
  if (stops(all)) {
    return SOTER_STOPPED;
  }
  if (w->full) {
    const bool many = s->o->max_states > 0U && s->progress->states >= s->o->max_states;
    return many ? SOTER_STATES : SOTER_MEMORY;
  }
  return w->expander.place.too_many ? SOTER_CHOOSY : SOTER_EXHAUSTED;
}

/* A violation counts before all else, then what the first worker says. */
static void decide(layered* all) {
  uint64_t waiting = 0U;
  all->depth++;
  for (uint32_t k = 0; k < all->threads; k++) {
    const soter_explore_status said = status_of(all, &all->w[k]);
    waiting += all->w[k].next.count;
    if (said == SOTER_VIOLATED || all->status == SOTER_EXHAUSTED) {
      all->status = said;
    }
  }
  all->done = all->done || all->status != SOTER_EXHAUSTED || waiting == 0U;
}

/* The first worker opens the gate, when it is known how many there are. */
static void wait_at_the_gate(worker* w) {
  layered* const all = w->all;
  if (w->id == 0U) {
    return;
  }
  (void)pthread_mutex_lock(&all->mutex);
  while (!all->open) {
    (void)pthread_cond_wait(&all->turn, &all->mutex);
  }
  (void)pthread_mutex_unlock(&all->mutex);
}

static void* work(void* argument) {
  worker* const w = argument;
  layered* const all = w->all;
  wait_at_the_gate(w);
  while (!all->done) {
    expand_layer(w);
    wait_for_others(all);
    receive(w);
    wait_for_others(all);
    tell(w);
    if (w->id == 0U) {
      decide(all);
    }
    wait_for_others(all);
    soter_store_settle(&w->store);
    w->moved += w->here.count;
    const soter_row swap = w->here;
    w->here = w->next;
    w->next = swap;
    w->next.count = 0U;
  }
  return NULL;
}

/* ------------------------------------------------------------------ beginning and end */

static bool coverage_open(soter_explore_coverage* c, const soter_model* m) {
  c->branches = calloc((m->branches + 63U) / 64U + 1U, sizeof *c->branches);
  c->classes = calloc((size_t)m->leaves * 256U + 1U, 1U);
  c->modes = calloc(m->program->modules * 2U + 1U, 1U);
  c->switches = calloc(m->program->modules * 2U + 1U, 1U);
  c->fired = calloc(m->actors + 1U, 1U);
  c->judged = calloc((size_t)m->program->properties + m->timeds + 1U, 1U);
  return c->branches != NULL && c->classes != NULL && c->modes != NULL && c->switches != NULL &&
         c->fired != NULL && c->judged != NULL;
}

static void coverage_close(soter_explore_coverage* c) {
  free(c->branches);
  free(c->classes);
  free(c->modes);
  free(c->switches);
  free(c->fired);
  free(c->judged);
}

static bool open_worker(layered* all, uint32_t id) {
  const soter_search* const s = all->s;
  worker* const w = &all->w[id];
  w->all = all;
  w->id = id;
  w->here.words = w->next.words = w->links.words = all->words;
  w->here.width = w->next.width = all->words + 2U;
  w->links.width = all->words + 1U;
  for (uint32_t k = 0; k < THREADS; k++) {
    w->out[k].words = all->words;
    w->out[k].width = all->words + 1U;
  }
  const bool fine =
      coverage_open(&w->coverage, s->m) &&
      soter_expander_open(&w->expander, s, &w->coverage, s->o->memory / 4U / all->threads) &&
      soter_store_open(&w->store, s->m, s->o->storage,
                       (w->expander.reduce & SOTER_REDUCE_SLEEP) != 0U,
                       s->o->memory / all->threads);
  w->store.growth = 4U; /* settled when their time is over */
  w->store.stop = &s->progress->stop;
  w->expander.spill = take_away;
  w->expander.to = w;
  return fine;
}

static void close_worker(worker* w) {
  coverage_close(&w->coverage);
  soter_expander_close(&w->expander);
  soter_store_close(&w->store);
  free(w->key);
  soter_row_close(&w->here);
  soter_row_close(&w->next);
  soter_row_close(&w->links);
  for (uint32_t k = 0; k < THREADS; k++) {
    soter_row_close(&w->out[k]);
  }
}

static bool open_all(layered* all, soter_search* s, uint32_t threads, bool link) {
  (void)memset(all, 0, sizeof *all);
  all->s = s;
  all->words = s->m->words;
  all->threads = threads < 1U ? 1U : threads > THREADS ? THREADS : threads;
  all->link = link;
  bool fine = true;
  all->opened = all->threads;
  for (uint32_t k = 0; k < all->threads; k++) {
    fine = open_worker(all, k) && fine;
    weigh(&all->w[k]);
  }
  return fine;
}

static void close_all(layered* all) {
  for (uint32_t k = 0; k < all->opened; k++) {
    close_worker(&all->w[k]);
  }
}

/* Before anybody moves, whatever the owner: there are no queues yet that it would look at. */
static bool take_births(void* to) {
  worker* const first = to;
  layered* const all = first->all;
  const soter_heirs* const h = &first->expander.heirs;
  bool fine = true;
  for (uint32_t k = 0; fine && k < h->count; k++) {
    const uint64_t* const packed = h->packed + (size_t)k * all->words;
    uint64_t key[SOTER_WORDS];
    worker* const owner = &all->w[owner_of(all, packed)];
    soter_store_key(&owner->store, packed, key);
    take_in(owner, packed, key, 0U, SOTER_NO_DEADLINE);
    if (++owner->taken >= LOOK) {
      tell(owner);
    }
    fine = !over(owner);
  }
  return fine;
}

static void be_born(layered* all) {
  worker* const w = &all->w[0];
  w->expander.spill = take_births;
  soter_expand_birth(&w->expander);
  (void)take_births(w);
  soter_forget(&w->expander);
  w->expander.spill = take_away;
  for (uint32_t k = 0; k < all->threads; k++) {
    const soter_row swap = all->w[k].here;
    all->w[k].here = all->w[k].next;
    all->w[k].next = swap;
  }
}

/* On as many threads as the machine gives. */
static void run(layered* all) {
  pthread_t other[THREADS];
  const uint32_t wanted = all->threads;
  uint32_t made = 1U;
  (void)pthread_mutex_init(&all->mutex, NULL);
  (void)pthread_cond_init(&all->turn, NULL);
  while (made < wanted && pthread_create(&other[made], NULL, work, &all->w[made]) == 0) {
    made++;
  }
  all->threads = made;
  be_born(all);
  (void)pthread_mutex_lock(&all->mutex);
  all->open = true;
  (void)pthread_cond_broadcast(&all->turn);
  (void)pthread_mutex_unlock(&all->mutex);
  (void)work(&all->w[0]);
  for (uint32_t k = 1; k < made; k++) {
    (void)pthread_join(other[k], NULL);
  }
  (void)pthread_cond_destroy(&all->turn);
  (void)pthread_mutex_destroy(&all->mutex);
}

static void sum_up(layered* all, soter_explore_result* r) {
  r->status = all->status;
  r->depth = all->depth;
  r->threads = all->threads;
  for (uint32_t k = 0; k < all->threads; k++) {
    worker* const w = &all->w[k];
    r->states += w->count;
    r->transitions += w->expander.transitions;
    r->table_bytes += soter_store_bytes(&w->store);
    r->frontier_bytes += frontier_of(w);
    r->memo_bytes += soter_expander_bytes(&w->expander);
    if (w->expander.place.too_many) {
      r->chooser = w->expander.place.chooser;
    }
    if (w->broke) {
      r->broken = w->broken;
      r->status = SOTER_VIOLATED;
    }
    soter_merge_coverage(all->s->m, all->s->coverage, &w->coverage);
  }
}

/* ------------------------------------------------------------------ the trace */

static bool write_links(layered* all, soter_search* s, uint64_t last, const soter_broken* broken) {
  worker* const w = &all->w[0];
  soter_place x;
  if (!soter_place_open(&x, s->m, s->o, s->progress, NULL)) {
    return false;
  }
  uint64_t* const way = malloc((s->room + 1U) * sizeof *way);
  uint32_t length = 0U;
  for (uint64_t i = last; way != NULL && i != SOTER_NO_DEADLINE && length < s->room;
       i = soter_row_at(&w->links, i)[all->words]) {
    way[length++] = i;
  }
  bool fine = way != NULL && length < s->room;
  const uint64_t* before = NULL;
  uint32_t written = 0U;
  for (uint32_t k = length; fine && k > 0U; k--) {
    const uint64_t* const here = soter_row_at(&w->links, way[k - 1U]);
    SOTER_CHECK(way[k - 1U] < w->links.count);
    fine = soter_find_move(&x, before, here, NULL, &s->trace[written++]);
    before = here;
  }
  if (fine && broken != NULL) {
    fine = soter_find_move(&x, before, NULL, broken, &s->trace[written++]);
  }
  soter_place_close(&x);
  free(way);
  s->result->length = fine ? written : 0U;
  return fine;
}

/* With links the order of the worlds is the order of their expansion only without revisits. */
static void trace_back(soter_search* s) {
  layered* const all = malloc(sizeof *all);
  soter_explore_options once = *s->o;
  once.reduce &= ~SOTER_REDUCE_SLEEP; /* no world is expanded twice */
  once.go_on = false;
  once.max_states = 0U; /* of what is looked at, which it was already */
  soter_search again = *s;
  again.o = &once;
  soter_explore_result unused = {0};
  again.result = &unused;
  if (all == NULL) {
    return;
  }
  if (open_all(all, &again, 1U, true)) {
    run(all);
    worker* const w = &all->w[0];
    if (w->broke) {
      s->result->broken = w->broken;
      const bool by_a_move = w->culprit != SOTER_NO_DEADLINE;
      const uint64_t last = by_a_move ? w->culprit : w->last;
      again.result = s->result;
      (void)write_links(all, &again, last, by_a_move ? &w->broken : NULL);
    }
  }
  close_all(all);
  free(all);
}

/* Links may take more memory than the search that needed none: depth first then, no deeper than the
 * violation lies; where overruns hide it there, to the end. */
static void trace_depth_first(soter_search* s) {
  const uint32_t bounds[] = {s->result->depth, UINT32_MAX};
  soter_explore_options once = *s->o;
  once.go_on = false;
  once.max_states = 0U;
  for (uint32_t k = 0; s->result->length == 0U && k < 2U && s->progress->stop == 0; k++) {
    soter_explore_result unused = {0};
    soter_search again = *s;
    soter_stack t;
    again.o = &once;
    again.result = &unused;
    if (soter_stack_open(&t, &again)) {
      soter_stack_run(&t, bounds[k]);
      if (t.broke && unused.length > 0U) {
        s->result->broken = t.broken;
        s->result->length = unused.length;
      }
    }
    soter_stack_close(&t);
  }
}

void soter_search_bfs(soter_search* s) {
  layered* const all = malloc(sizeof *all);
  if (all == NULL) {
    s->result->status = SOTER_NO_MEMORY;
    return;
  }
  if (!open_all(all, s, s->o->threads, false)) {
    s->result->status = SOTER_NO_MEMORY;
    s->result->needed_bytes = 0U;
    for (uint32_t k = 0; k < all->threads; k++) {
      s->result->needed_bytes += soter_store_bytes(&all->w[k].store);
    }
    close_all(all);
    free(all);
    return;
  }
  run(all);
  sum_up(all, s->result);
  const bool keep = s->o->keep && s->o->storage == SOTER_EXACT;
  for (uint32_t k = 0; keep && k < all->threads; k++) {
    s->result->kept = soter_keep(s->result->kept, &all->w[k].store);
  }
  close_all(all);
  free(all);
  if (s->result->status == SOTER_VIOLATED && s->trace != NULL) {
    s->progress->tracing = 1;
    trace_back(s);
    trace_depth_first(s);
    s->progress->tracing = 0;
  }
}
