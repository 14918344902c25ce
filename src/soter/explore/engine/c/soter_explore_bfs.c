/* soter_explore_bfs.c: breadth first, on up to SOTER_THREADS threads.
 *
 * Purpose: all configurations, layer by layer; the shortest violation comes first. Each thread owns
 * the configurations whose hash says so: it has a table and a frontier of its own, and hands the
 * others their successors at the end of a layer, so that no table is shared and nothing is
 * locked. Where every way to a configuration has as many moves, configurations of different layers
 * differ: there is a table of the layer that is expanded, which is the frontier, and one of the
 * next. Where something is violated, the same search is made again with a link from every
 * configuration to the one it came from, until that violation: memory is not spent on links unless
 * they are needed. That one layer is enough is argued in docs/testing.md, "Layers".
 * Non-goals: a configuration's successors (soter_explore_expand.c, soter_explore_instant.c).
 */
#define _POSIX_C_SOURCE 200809L
#include "soter_explore_bfs.h"

#define AHEAD 32U       /* configurations that are expanded at once, */
#define TELL 4096U      /* and between two looks at the bounds */
#define SUCCESSORS 256U /* successors of configurations that are expanded at once, more or less */
#define OWED 16U        /* this part of a worker's memory is for what it found for others */
#define LOOK 32768U     /* configurations taken in between two looks at the bounds */
#define RECEIVED 64U    /* that others found are looked for at once, */
#define SHORT 1024U     /* or so many of a word */

static bool make_room_for_keys(worker* w, uint32_t count) {
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

static uint64_t bytes_of_frontier(const worker* w) {
  uint64_t bytes = soter_row_bytes(&w->here) + soter_row_bytes(&w->next) +
                   soter_row_bytes(&w->links) + soter_store_bytes(&w->noted) +
                   soter_store_bytes(&w->before) + soter_store_bytes(&w->anchor) +
                   (uint64_t)w->keys * w->all->words * sizeof *w->key;
  for (uint32_t k = 0; k < THREADS; k++) {
    bytes += soter_row_bytes(&w->out[k]);
  }
  return bytes;
}

static void break_off(worker* w, const soter_broken* broken, uint64_t culprit) {
  if (!w->broke) {
    w->broke = true;
    w->broken = *broken;
    w->culprit = culprit;
    w->last = w->links.count - 1U; /* others may come after it */
  }
}

/* Keeps what is noted of an end; whether there is something about it that was sought. */
static bool note_end(worker* w, const uint64_t* packed) {
  const soter_explore_options* const o = w->all->s->o;
  uint64_t seen[SOTER_WORDS];
  uint64_t sleep = 0U;
  uint64_t again = 0U;
  bool found = o->goal != NULL;
  SOTER_CHECK(w->expander.instant != NULL && w->all->words <= SOTER_WORDS);
  for (uint32_t k = 0; k < w->all->words; k++) {
    seen[k] = packed[k] & o->noted[k];
    found = found && seen[k] == o->goal[k];
  }
  if (o->goal == NULL && soter_store_put(&w->noted, seen, &sleep, &again) < 0) {
    w->full = true;
  }
  return found;
}

/* Whether a new configuration ends an execution: it is judged. */
static bool ends_execution(worker* w, const uint64_t* packed) {
  const soter_explore_options* const o = w->all->s->o;
  soter_broken broken;
  if (soter_is_broken(&w->expander, packed, &broken)) {
    if (!soter_is_known(&w->expander.space, &broken)) {
      break_off(w, &broken, SOTER_NO_DEADLINE);
    }
    return true;
  }
  SOTER_CHECK(w->all->words > 0U);
  if (o->noted != NULL && note_end(w, packed)) {
    break_off(w, &o->sought, SOTER_NO_DEADLINE);
    return true;
  }
  return false;
}

/* A configuration waits for the next layer; by tables it does so where it stands. */
static void wait_for_next_layer(worker* w, const uint64_t* packed, uint64_t sleep, uint64_t moves) {
  const bool ok = w->all->tables || soter_row_put(&w->next, packed, sleep, moves);
  w->next_ns = soter_earlier(w->next_ns, soter_time_of(w->all->s->m, packed));
  w->full = w->full || !ok;
}

/* A new configuration: it is judged, and waits for the next layer. */
static void take_new(worker* w, const uint64_t* packed, uint64_t sleep, uint64_t from) {
  w->count++;
  if (w->all->link && !soter_row_put(&w->links, packed, from, 0U)) {
    w->full = true;
  }
  if (!ends_execution(w, packed)) {
    w->fresh++;
    wait_for_next_layer(w, packed, sleep, UINT64_MAX);
  }
}

/* Takes a configuration in. */
static void take_in(worker* w, const uint64_t* packed, const uint64_t* key, uint64_t sleep,
                    uint64_t from) {
  uint64_t again = 0U;
  const int fresh = soter_store_put_key(&w->store, packed, key, &sleep, &again);
  if (fresh < 0) {
    w->full = true;
    return;
  }
  if (fresh == 0) {
    if (again != 0U) { /* by tables it is expanded after all have come, with what sleeps then */
      wait_for_next_layer(w, packed, sleep, again);
    }
    return;
  }
  SOTER_CHECK(again == 0U && w->store.count > 0U);
  take_new(w, packed, sleep, from);
}

static bool stops(const layered* all) {
  return all->s->progress->stop != 0;
}

/* New configurations that violate nothing wait in the table. */
static void take_unviolated(worker* w, const uint64_t* packed, uint32_t count) {
  const soter_model* const m = w->all->s->m;
  int64_t least = w->next_ns;
  for (uint32_t k = 0; k < count; k++) {
    least = soter_earlier(least, soter_time_of(m, packed + k));
  }
  w->next_ns = least;
  w->count += count;
  w->fresh += count;
}

/* Takes in configurations of a word that are all this worker's; returns how many there was room
 * for. Room for their keys is there. */
static uint32_t take_words_in(worker* w, const uint64_t* packed, uint32_t count, uint64_t from) {
  uint32_t put = count;
  const uint32_t news = soter_store_put_short(&w->store, packed, &put, w->key);
  w->full = w->full || put < count;
  SOTER_CHECK(put <= count && news <= put && count <= w->keys);
  const bool wait = w->all->tables && w->all->s->o->noted == NULL;
  for (uint32_t k = 0; k < news;) {
    const uint32_t ok =
        wait ? soter_cache_count_unviolated(&w->expander, w->key + k, news - k) : 0U;
    take_unviolated(w, w->key + k, ok);
    k += ok;
    if (k < news) {
      take_new(w, w->key + k++, 0U, from);
    }
  }
  return put;
}

/* Whether configurations are a word each, and are stored as they are: many are put at a time. */
static bool takes_words(const worker* w) {
  return soter_store_is_short(&w->store);
}

/* What is told in the end is what it took when it took most. */
static void note_most(layered* all, uint64_t bytes) {
  if (bytes < all->most_bytes) {
    return;
  }
  all->most_bytes = bytes;
  all->most_table = all->most_rows = 0U;
  for (uint32_t k = 0; k < all->threads; k++) {
    all->most_table += all->w[k].table;
    all->most_rows += all->w[k].rows;
  }
}

/* Memory is one budget: what tables, frontiers and remembered steps of all workers take together.
 * The table may grow into this worker's share of what is left. */
static void count_memory(worker* w) {
  layered* const all = w->all;
  const uint64_t all_of_it = all->s->o->memory;
  const uint64_t memory = all_of_it - all_of_it / 64U * (all->threads > 1U ? 3U : 1U);
  const uint64_t table = soter_store_bytes(&w->store);
  w->table = table;
  w->rows = bytes_of_frontier(w);
  w->bytes = table + w->rows + soter_expander_bytes(&w->expander);
  uint64_t bytes = 0U;
  for (uint32_t k = 0; k < all->threads; k++) {
    bytes += all->w[k].bytes;
  }
  const uint64_t left = memory > bytes ? (memory - bytes) / all->threads : 0U;
  w->store.memory = table + left;
  soter_instant_allow(w->expander.instant, left / 2U);
  w->full = w->full || bytes > memory; /* others go on until they look */
  w->taken = 0U;
  if (w->id == 0U) {
    all->s->progress->bytes = bytes;
    note_most(all, bytes);
  }
}

/* Takes in some of what another worker has found; returns how many there was room for. */
static uint64_t receive_some(worker* w, const soter_row* row, uint64_t first, uint32_t count) {
  const uint32_t words = w->all->words;
  const uint64_t* const packed = soter_row_at(row, first);
  if (!make_room_for_keys(w, count)) {
    return 0U;
  }
  if (takes_words(w)) {
    return take_words_in(w, packed, count, 0U);
  }
  for (uint32_t k = 0; k < count; k++) {
    soter_store_keys(&w->store, packed + (size_t)k * row->width, 1U, w->key + (size_t)k * words,
                     true);
  }
  uint32_t taken = 0U;
  for (; taken < count && !w->full; taken++) {
    const uint64_t* const item = packed + (size_t)taken * row->width;
    take_in(w, item, w->key + (size_t)taken * words, item[words], 0U);
  }
  return w->full && taken > 0U ? taken - 1U : taken; /* it may be the one without room */
}

/* Takes in what another worker has found; what there is no room for stays. */
static void receive_from(worker* w, soter_row* row) {
  const uint32_t most = takes_words(w) ? SHORT : RECEIVED;
  uint64_t i = 0U;
  while (i < row->count && !w->full && !stops(w->all)) {
    const uint32_t count = row->count - i < most ? (uint32_t)(row->count - i) : most;
    w->taken += count;
    if (w->taken >= LOOK) {
      count_memory(w);
    }
    i += receive_some(w, row, i, count);
  }
  soter_row_drop(row, i);
}

/* Gives every successor of a word to its owner; a worker's own wait until they are many, at most
 * until others' are taken in. No branch asks whose one is: no machine knows beforehand. */
static void hand_on_words(worker* w) {
  layered* const all = w->all;
  const soter_successors* const h = &w->expander.successors;
  uint64_t* end[THREADS] = {NULL};
  if (all->threads == 1U || h->count == 0U) {
    (void)take_words_in(w, h->packed, h->count, w->moved + w->first);
    return;
  }
  for (uint32_t k = 0; k < all->threads; k++) {
    if (!soter_row_reserve(&w->out[k], h->count)) {
      w->full = true;
      return;
    }
    end[k] = soter_row_at(&w->out[k], w->out[k].count);
  }
  for (uint32_t k = 0; k < h->count; k++) {
    *end[soter_owner_of_short(all, &w->store, h->packed[k])]++ = h->packed[k];
  }
  for (uint32_t k = 0; k < all->threads; k++) {
    const uint64_t* const first = soter_row_at(&w->out[k], w->out[k].count);
    const uint64_t count = (uint64_t)(end[k] - first);
    w->out[k].count += count;
    w->owed += k != w->id ? count : 0U;
  }
  if (w->out[w->id].count >= SHORT) {
    receive_from(w, &w->out[w->id]);
  }
}

/* Gives the successors of others to their owners: what is left is this worker's. */
static void hand_over(worker* w) {
  const layered* const all = w->all;
  const uint32_t words = all->words;
  soter_successors* const h = &w->expander.successors;
  uint32_t own = 0U;
  for (uint32_t k = 0; k < h->count && !w->full; k++) {
    const uint64_t* const packed = h->packed + (size_t)k * words;
    const uint64_t* const key = w->key + (size_t)k * words;
    const uint32_t owner = soter_owner_of(all, &w->store, packed, key);
    SOTER_CHECK(owner < all->threads && own <= k);
    if (owner != w->id) {
      w->full = !soter_row_put(&w->out[owner], packed, h->sleep[k], 0U);
      w->owed++;
      continue;
    }
    soter_store_expect(&w->store, packed, key);
    soter_copy_words(h->packed + (size_t)own * words, packed, words);
    soter_copy_words(w->key + (size_t)own * words, key, words);
    h->sleep[own++] = h->sleep[k];
  }
  h->count = own;
}

/* Gives every successor to its owner, of which this worker may be one. */
static void hand_on(worker* w) {
  const uint32_t words = w->all->words;
  const soter_successors* const h = &w->expander.successors;
  w->taken += h->count;
  if (takes_words(w)) {
    hand_on_words(w);
    return;
  }
  soter_store_keys(&w->store, h->packed, h->count, w->key, w->all->threads == 1U);
  if (w->all->threads > 1U) {
    hand_over(w);
  }
  for (uint32_t k = 0; k < h->count && !w->full; k++) {
    take_in(w, h->packed + (size_t)k * words, w->key + (size_t)k * words, h->sleep[k],
            w->moved + w->first);
  }
}

static bool is_over(const worker* w) {
  const soter_search* const s = w->all->s;
  return w->full || w->expander.space.too_many || stops(w->all) || (w->broke && !s->o->go_on) ||
         soter_ran_enough(&w->expander);
}

static void report_progress(worker* w) {
  soter_search* const s = w->all->s;
  count_memory(w);
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
  s->progress->depth = w->all->steps;
  w->full = w->full || (s->o->max_states > 0U && states >= s->o->max_states);
}

/* Successors of one configuration, or of a few, go to their owners; false: no more are wanted. */
static bool take_away(void* to) {
  worker* const w = to;
  if (make_room_for_keys(w, w->expander.successors.count)) {
    hand_on(w);
    w->full = w->full || w->expander.no_memory;
  }
  if (w->taken >= LOOK) {
    report_progress(w);
  }
  soter_forget_successors(&w->expander);
  return !is_over(w);
}

/* The next configuration of the frontier, number `i`, what sleeps in it and which moves are to be
 * made: none where it violates something, in a search that goes on. */
static void read_next_of_frontier(worker* w, uint64_t i, uint64_t* item) {
  const layered* const all = w->all;
  const uint32_t words = all->words;
  soter_broken broken;
  if (!all->tables) {
    soter_copy_words(item, soter_row_at(&w->here, i), w->here.width);
  } else if (!soter_store_next(&w->before, &w->at, item, &item[words])) {
    SOTER_CHECK(false && "a layer has as many configurations as were put into its table");
  }
  if (w->expander.instant != NULL) { /* nothing sleeps */
    item[words] = 0U;
    item[words + 1U] = UINT64_MAX;
  } else if (all->tables) {
    item[words + 1U] = UINT64_MAX;
  }
  const bool may_break = all->tables && (all->s->o->go_on || all->s->o->knowns > 0U);
  if (may_break && soter_is_broken(&w->expander, item, &broken)) {
    item[words + 1U] = 0U;
  }
}

/* Whether configurations of the frontier are expanded many at a time. */
static bool expands_in_batches(const worker* w) {
  const bool ok = w->all->tables && w->expander.instant == NULL;
  return ok && w->batch > 0U && soter_store_is_short(&w->before);
}

/* Expands configurations of the frontier, from number `first`, at once. Returns how many; 0: these
 * have to be expanded one by one. */
static uint32_t expand_batch(worker* w, uint64_t first) {
  const soter_explore_options* const o = w->all->s->o;
  const bool may_break = o->go_on || o->knowns > 0U;
  const uint64_t left = w->layer - first;
  const uint32_t count = left < w->batch ? (uint32_t)left : w->batch;
  const soter_cursor at = w->at;
  uint64_t configuration[SOTER_BATCH];
  uint32_t kept = 0U;
  soter_broken broken;
  soter_store_next_short(&w->before, &w->at, count, configuration);
  for (uint32_t i = 0; i < count; i++) {
    configuration[kept] = configuration[i];
    kept += !may_break || !soter_is_broken(&w->expander, &configuration[i], &broken);
  }
  if (!soter_cache_expand_batch(&w->expander, configuration, kept)) {
    w->at = at;
    w->batch /= 2U; /* none: until the next layer */
    return 0U;
  }
  const bool few = w->expander.successors.count * 2U < w->expander.batch_successors;
  w->batch *= few && w->batch < SOTER_BATCH ? 2U : 1U;
  SOTER_CHECK(w->batch <= SOTER_BATCH);
  if (w->expander.broke) {
    break_off(w, &w->expander.broken, w->moved + first);
  }
  return count;
}

/* Expands configurations of the frontier, from number `first`: as many as are looked for at once,
 * so that the machine can fetch the places of their successors while others are computed. Returns
 * how many. */
static uint64_t expand_some(worker* w, uint64_t first) {
  layered* const all = w->all;
  const uint32_t words = all->words;
  const uint64_t most = all->link ? 1U : AHEAD;
  soter_successors* const h = &w->expander.successors;
  uint64_t i = first;
  uint64_t item[SOTER_WORDS + 2U];
  SOTER_CHECK(first < w->layer);
  soter_forget_successors(&w->expander);
  w->first = first;
  i += expands_in_batches(w) ? expand_batch(w, first) : 0U;
  if (i > first) {
    (void)take_away(w);
    return i - first;
  }
  for (; i < w->layer && i - first < most && h->count < SUCCESSORS && !is_over(w); i++) {
    read_next_of_frontier(w, i, item);
    if (item[words + 1U] == 0U) {
      continue;
    }
    soter_expand_next(&w->expander, item, item[words], item[words + 1U]);
    if (w->expander.broke) {
      break_off(w, &w->expander.broken, w->moved + i);
    }
  }
  (void)take_away(w);
  return i - first;
}

/* Expands some configurations; where a successor may be lost they count as not expanded. */
static void expand_some_more(worker* w) {
  const uint64_t count = expand_some(w, w->expanded);
  w->expanded += is_over(w) ? 0U : count;
}

/* Expands all of it, or until there is much that others have to take in. */
static void expand_layer(worker* w) {
  const uint64_t each = w->out[0].width * sizeof(uint64_t) * OWED;
  const uint64_t most = w->all->s->o->memory / w->all->threads / each + 1U;
  uint64_t told = w->expanded;
  SOTER_CHECK(w->expanded <= w->layer);
  w->owed = 0U;
  while (w->expanded < w->layer && w->owed < most && !is_over(w)) {
    expand_some_more(w);
    if (w->expanded - told >= TELL) {
      told = w->expanded;
      report_progress(w);
    }
  }
  w->rest = w->expanded < w->layer && !is_over(w);
}

static void receive_from_all(worker* w) {
  w->waiting_ns = w->expanded < w->layer ? w->here_ns : SOTER_NO_DEADLINE;
  for (uint32_t k = 0; k < w->all->threads; k++) {
    soter_row* const row = &w->all->w[k].out[w->id];
    receive_from(w, row);
    w->waiting_ns = soter_earlier(w->waiting_ns, soter_row_time(row, w->all->s->m, 0U));
  }
  w->waiting_ns = soter_earlier(w->waiting_ns, w->next_ns);
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
  if (soter_ran_enough(&w->expander)) {
    return SOTER_STATES;
  }
  return w->expander.space.too_many ? SOTER_CHOOSY : SOTER_EXHAUSTED;
}

/* How many configurations wait for the next layer. */
static uint64_t count_waiting(const layered* all) {
  uint64_t count = 0U;
  for (uint32_t k = 0; k < all->threads; k++) {
    count += all->tables ? all->w[k].fresh : all->w[k].next.count;
  }
  return count;
}

/* Before which time all was judged. */
static int64_t covered_until(const layered* all) {
  int64_t time = all->born ? SOTER_NO_DEADLINE : -1;
  for (uint32_t k = 0; k < all->threads; k++) {
    time = soter_earlier(time, all->w[k].waiting_ns);
  }
  return time;
}

/* Whether the layer was expanded to its end. */
static bool is_whole(const layered* all) {
  bool whole = true;
  for (uint32_t k = 0; k < all->threads; k++) {
    whole = whole && all->w[k].expanded == all->w[k].layer;
    for (uint32_t i = 0; i < all->threads; i++) {
      whole = whole && all->w[k].out[i].count == 0U;
    }
  }
  return whole;
}

/* The steps of so many layers. */
static void count_steps(layered* all) {
  all->steps = all->depth;
  if (all->depth > 0U && all->w[0].expander.instant != NULL) {
    all->steps = soter_steps_until(all->s->m, all->s->o, &all->calendar, all->depth - 1U) + 1U;
  }
}

/* A violation counts before all else, then what the first worker says. */
static void decide_what_next(layered* all) {
  for (uint32_t k = 0; k < all->threads; k++) {
    const soter_explore_status said = status_of(all, &all->w[k]);
    if (said == SOTER_VIOLATED || all->status == SOTER_EXHAUSTED) {
      all->status = said;
    }
  }
  all->whole = is_whole(all);
  all->s->progress->covered_ns = covered_until(all);
  const bool ends = all->status != SOTER_EXHAUSTED;
  const bool closed = !ends && soter_repetition_found(all);
  all->done = all->done || ends || closed || (all->whole && count_waiting(all) == 0U);
  all->depth += (uint32_t)(all->whole || ends);
  count_steps(all);
}

/* Decides after a layer, or a part of one, while nobody works and all have taken in theirs. */
static void sum_and_decide(void* to) {
  layered* const all = to;
  for (uint32_t k = all->threads; k-- > 0U;) {
    report_progress(&all->w[k]); /* the first one, last, adds up */
  }
  decide_what_next(all);
}

/* Forgets the table of a layer, or keeps it for who wants to see it. */
static void forget_layer(worker* w) {
  const soter_search* const s = w->all->s;
  if (s->o->keep && s->o->storage == SOTER_EXACT) {
    w->kept = soter_keep_table(w->kept, &w->store);
    soter_store_close(&w->store); /* where it could not be kept */
    w->full = !soter_layers_open_store(w, &w->store) || w->full;
  } else {
    w->full = !soter_store_empty(&w->store) || w->full;
  }
}

/* What was found is what is expanded next. */
static void begin_next_layer(worker* w) {
  w->moved += w->layer;
  if (w->all->tables) {
    const soter_store swap = w->before;
    const soter_cursor begin = {0U, 0U};
    w->before = w->store;
    w->store = swap;
    w->at = begin;
    w->layer = w->before.count;
  } else {
    const soter_row swap = w->here;
    w->here = w->next;
    w->next = swap;
    w->next.count = 0U;
    w->layer = w->here.count;
  }
  w->fresh = w->expanded = 0U;
  w->batch = w->batch > 0U ? w->batch : 1U;
  w->here_ns = w->next_ns;
  w->next_ns = SOTER_NO_DEADLINE;
  if (soter_repetition_take(w)) {
    w->full = !soter_layers_open_store(w, &w->store) || w->full;
  } else if (w->all->forgets) {
    forget_layer(w); /* by rows, what is in it has a row */
  } else {
    soter_store_settle(&w->store);
  }
}

static bool any_rest(const layered* all) {
  bool any = false;
  for (uint32_t k = 0; k < all->threads; k++) {
    any = any || all->w[k].rest;
  }
  return any;
}

static void* work_through_layers(void* argument) {
  worker* const w = argument;
  layered* const all = w->all;
  soter_patience patience = 0U;
  if (w->id > 0U) {
    soter_barrier_enter(&all->barrier);
  }
  while (!all->done) {
    bool more = true;
    while (more) {
      expand_layer(w);
      soter_barrier_wait(&all->barrier, &patience, NULL, NULL);
      more = any_rest(all); /* all say the same: nobody goes on before the next wait */
      receive_from_all(w);
      soter_barrier_wait(&all->barrier, &patience, more ? NULL : sum_and_decide, all);
    }
    if (all->whole && !all->done) {
      begin_next_layer(w);
    }
  }
  return NULL;
}

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

static bool open_noted(worker* w) {
  const soter_search* const s = w->all->s;
  return s->o->noted == NULL || soter_store_open(&w->noted, s->m, SOTER_EXACT, false, 0U,
                                                 s->o->noted_bytes / w->all->threads);
}

static bool open_worker(layered* all, uint32_t id) {
  const soter_search* const s = all->s;
  worker* const w = &all->w[id];
  w->all = all;
  w->id = id;
  w->here.words = w->next.words = w->links.words = all->words;
  w->links.width = all->words + 1U;
  w->here_ns = w->next_ns = w->waiting_ns = SOTER_NO_DEADLINE;
  const bool ok =
      coverage_open(&w->coverage, s->m) &&
      soter_expander_open(&w->expander, s, &w->coverage, s->o->memory / 4U / all->threads) &&
      soter_layers_open_store(w, &w->store) &&
      (!all->tables || soter_layers_open_store(w, &w->before)) && open_noted(w);
  for (uint32_t k = 0; k < THREADS; k++) {
    w->out[k].words = all->words;
    w->out[k].width = all->words + (takes_words(w) ? 0U : 1U);
  }
  w->here.width = w->next.width = all->words + (w->expander.instant != NULL ? 0U : 2U);
  w->expander.spill = take_away;
  w->expander.to = w;
  return ok;
}

static void close_worker(worker* w) {
  coverage_close(&w->coverage);
  soter_expander_close(&w->expander);
  soter_store_close(&w->store);
  soter_store_close(&w->noted);
  soter_store_close(&w->before);
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
  all->forgets = true;
  for (uint32_t i = 0; i < s->m->actors; i++) {
    all->forgets = all->forgets && s->m->actor[i].overrun_ns == 0; /* it loses releases */
  }
  all->tables = all->forgets && !link && s->o->storage == SOTER_EXACT;
  bool ok = true;
  all->opened = all->threads;
  for (uint32_t k = 0; k < all->threads; k++) {
    ok = open_worker(all, k) && ok;
    count_memory(&all->w[k]);
  }
  soter_repetition_open(all);
  return ok;
}

static void close_all(layered* all) {
  soter_repetition_close(all);
  for (uint32_t k = 0; k < all->opened; k++) {
    close_worker(&all->w[k]);
  }
}

/* Before anybody moves, whatever the owner: there are no queues yet that it would look at. */
static bool hand_starts_on(void* to) {
  worker* const first = to;
  layered* const all = first->all;
  const soter_successors* const h = &first->expander.successors;
  bool ok = true;
  for (uint32_t k = 0; ok && k < h->count; k++) {
    const uint64_t* const packed = h->packed + (size_t)k * all->words;
    uint64_t key[SOTER_WORDS];
    soter_store_key(&first->store, packed, key);
    worker* const owner = &all->w[soter_owner_of(all, &first->store, packed, key)];
    take_in(owner, packed, key, 0U, SOTER_NO_DEADLINE);
    if (++owner->taken >= LOOK) {
      report_progress(owner);
    }
    ok = !is_over(owner);
  }
  soter_forget_successors(&first->expander);
  all->born = all->born && ok;
  return ok;
}

static void take_starts(layered* all) {
  worker* const w = &all->w[0];
  w->expander.spill = hand_starts_on;
  all->born = true;
  soter_expand_start(&w->expander);
  (void)hand_starts_on(w);
  w->full = w->full || w->expander.no_memory;
  all->born = all->born && !is_over(w) && !w->expander.space.cut;
  w->expander.spill = take_away;
  for (uint32_t k = 0; k < all->threads; k++) {
    begin_next_layer(&all->w[k]);
  }
}

/* On as many threads as the machine gives. */
static void run_threads(layered* all) {
  pthread_t other[THREADS];
  const uint32_t wanted = all->threads;
  uint32_t made = 1U;
  soter_barrier_open(&all->barrier);
  while (made < wanted &&
         pthread_create(&other[made], NULL, work_through_layers, &all->w[made]) == 0) {
    made++;
  }
  all->threads = made;
  take_starts(all);
  soter_barrier_begin(&all->barrier, made);
  (void)work_through_layers(&all->w[0]);
  for (uint32_t k = 1; k < made; k++) {
    (void)pthread_join(other[k], NULL);
  }
  soter_barrier_close(&all->barrier);
}

static void sum_up_workers(layered* all, soter_explore_result* r) {
  r->status = all->status;
  r->depth = all->depth;
  r->threads = all->threads;
  r->closed_ns = all->status == SOTER_EXHAUSTED ? all->repetition.closed_ns : 0;
  r->closable = all->repetition.may;
  r->covered_ns = r->closed_ns != 0 ? SOTER_NO_DEADLINE : covered_until(all);
  for (uint32_t k = 0; k < all->threads; k++) {
    worker* const w = &all->w[k];
    r->states += w->count;
    r->transitions += w->expander.transitions;
    r->combined += w->expander.combined;
    count_memory(w);
    if (w->expander.space.too_many) {
      r->chooser = w->expander.space.chooser;
    }
    if (w->broke) {
      r->broken = w->broken;
      r->status = SOTER_VIOLATED;
    }
    soter_merge_coverage(all->s->m, all->s->coverage, &w->coverage);
  }
  count_memory(&all->w[0]);
  r->table_bytes = all->most_table;
  r->frontier_bytes = all->most_rows;
  r->memo_bytes = all->most_bytes - all->most_table - all->most_rows;
}

static bool write_links(layered* all, soter_search* s, uint64_t last, const soter_broken* broken) {
  worker* const w = &all->w[0];
  soter_workspace space;
  if (!soter_workspace_open(&space, s->m, s->o, s->progress, NULL)) {
    return false;
  }
  uint64_t* const way = malloc((s->room + 1U) * sizeof *way);
  uint32_t length = 0U;
  for (uint64_t i = last; way != NULL && i != SOTER_NO_DEADLINE && length < s->room;
       i = soter_row_at(&w->links, i)[all->words]) {
    way[length++] = i;
  }
  bool ok = way != NULL && length < s->room;
  const uint64_t* before = NULL;
  uint32_t written = 0U;
  for (uint32_t k = length; ok && k > 0U; k--) {
    const uint64_t* const here = soter_row_at(&w->links, way[k - 1U]);
    SOTER_CHECK(way[k - 1U] < w->links.count);
    ok = soter_find_moves(s, &space, before, here, NULL, &written);
    before = here;
  }
  if (ok && broken != NULL) {
    ok = soter_find_moves(s, &space, before, NULL, broken, &written);
  }
  soter_workspace_close(&space);
  free(way);
  s->result->length = ok ? written : 0U;
  return ok;
}

/* Searches again with links, and writes the way; nothing is revisited, so order is expansion's. */
static void search_with_links(soter_search* s) {
  layered* const all = malloc(sizeof *all);
  soter_explore_options once = *s->o;
  if (!soter_by_instants(s->m, s->o)) {
    once.reduce &= ~SOTER_REDUCE_SLEEP; /* no configuration is expanded twice */
  }
  once.go_on = false;
  once.max_states = 0U; /* of what is looked at, which it was already */
  once.max_ran = 0U;
  soter_search again = *s;
  again.o = &once;
  soter_explore_result unused = {0};
  again.result = &unused;
  if (all == NULL) {
    return;
  }
  if (open_all(all, &again, 1U, true)) {
    run_threads(all);
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

/* What is wanted beyond the search: all configurations, or what was noted of them. */
static void keep_tables(layered* all, soter_explore_result* r) {
  const soter_explore_options* const o = all->s->o;
  for (uint32_t k = 0; k < all->threads; k++) {
    worker* const w = &all->w[k];
    if (o->keep && o->storage == SOTER_EXACT) {
      r->kept = soter_keep_table(soter_join_kept(r->kept, w->kept), &w->store);
      r->kept = all->tables ? soter_keep_table(r->kept, &w->before) : r->kept;
    }
    if (o->noted != NULL) {
      r->kept = soter_keep_table(r->kept, &w->noted);
    }
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
  run_threads(all);
  sum_up_workers(all, s->result);
  const uint32_t steps = all->steps;
  keep_tables(all, s->result);
  close_all(all);
  free(all);
  if (s->result->status == SOTER_VIOLATED && s->trace != NULL) {
    s->progress->tracing = 1;
    search_with_links(s);
    soter_trace_depth_first(s);
    s->progress->tracing = 0;
  }
  s->result->depth = steps;
}
