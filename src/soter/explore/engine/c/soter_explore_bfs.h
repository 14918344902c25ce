/* soter_explore_bfs.h: breadth-first search, for the file that sees what comes again.
 *
 * Purpose: what its workers have. Non-goals: the search (soter_explore_bfs.c).
 */
#ifndef SOTER_EXPLORE_BFS_H
#define SOTER_EXPLORE_BFS_H

#include "soter_explore_barrier.h"
#include "soter_explore_internal.h"

#define THREADS SOTER_THREADS
#define SOTER_APART 128U /* two lines: some machines fetch them together */

/* A layer at a beginning of the calendar: the sum of its configurations' numbers, times aside. */
typedef struct {
  int64_t at_ns;
  uint64_t digest, count;
} soter_layer_digest;

/* Whether what comes was there before (soter_explore_repeated_layers.c). */
typedef struct {
  bool may;                  /* it is a search that it is looked for in, */
  bool on;                   /* and there is enough before the end */
  int64_t from_ns, every_ns; /* beginnings: every so often from then on, */
  int64_t last_ns;           /* the last one before what the horizon changes */
  bool at;                   /* the layer that is expanded is at one, */
  int64_t at_ns;             /* of this time, */
  bool take;                 /* the one before is kept, */
  bool compare;              /* this one is compared with what was kept */
  int64_t anchored;          /* when; 0: none is; */
  int64_t again_ns;          /* the same is expected */
  int64_t closed_ns;         /* all that comes after was there before; 0: that is not known */
  uint64_t calendar;         /* the bits that entries have of it; 0: none, */
  soter_instant_count
      counted; /* else: steps until the last end of an instant that was looked for */
  soter_layer_digest* turn;
  uint32_t turns, room;
} soter_repetition;

typedef struct worker {
  struct layered* all;
  uint32_t id;
  soter_expander expander;
  soter_store store;
  soter_explore_coverage coverage;
  soter_row here, next, out[THREADS];
  uint64_t count, moved;
  uint64_t owed;           /* successors for others that they have not taken in */
  uint64_t first;          /* the configuration of the frontier that is expanded */
  uint64_t taken;          /* successors since the bounds were looked at */
  volatile uint64_t bytes; /* of all that is this worker's, */
  volatile uint64_t table; /* of which its table takes */
  volatile uint64_t rows;  /* and its frontier */
  int64_t here_ns;         /* the least time of a configuration of the layer that is expanded, */
  int64_t next_ns;         /* and of the next; */
  int64_t waiting_ns;      /* of those that are still to be expanded or taken in */
  uint64_t* key;           /* of successors that are about to be put */
  uint32_t keys;
  bool broke, full;
  soter_broken broken;
  void* kept;         /* tables of layers before */
  soter_store noted;  /* options.noted: what was seen of these bits */
  soter_store before; /* by tables: the layer that is expanded, */
  soter_cursor at;    /* as far as this, */
  uint64_t layer;     /* so many configurations, */
  uint32_t batch;     /* of which so many are expanded at once, 0: one by one; */
  uint64_t expanded;  /* of which so many are, and lost no successor; */
  bool rest;          /* others are to be, when what is theirs was taken in */
  uint64_t fresh;     /* and so many are in the next */
  uint64_t culprit;   /* links: the entry whose move breaks something */
  uint64_t last;      /* links: or the entry that is broken */
  soter_store
      anchor; /* closing: what this worker has of a layer before; whether it has come again */
  uint64_t digest;
  bool same;
  soter_row
      links; /* one thread: configurations as they came, each with the number of the one before */
  uint8_t apart[SOTER_APART]; /* no line of the machine's memory is two workers' */
} worker;

typedef struct layered {
  soter_search* s;
  uint32_t threads, words;
  uint32_t opened;
  bool link;
  bool forgets; /* a table has one layer only, */
  bool tables;  /* and is what is expanded then: rows are for traces and for fingerprints */
  uint64_t most_bytes, most_table, most_rows; /* when it took most */
  worker w[THREADS];
  soter_barrier barrier;
  bool done;
  bool born;  /* all that there is at the start was taken in */
  bool whole; /* the layer was expanded to its end */
  soter_explore_status status;
  uint32_t depth;               /* layers */
  soter_instant_count calendar; /* where only ends of instants are stored, */
  uint32_t steps;               /* of the longest execution seen */
  soter_repetition repetition;
} layered;

/* Whose a configuration of a word is: by what the table tells apart, but for its place in the
 * calendar where layers are compared whose places differ: what comes again has the same owner. */
SOTER_INLINE uint32_t soter_owner_of_short(const layered* all, const soter_store* s,
                                           uint64_t packed) {
  const uint64_t x = (packed & ~all->repetition.calendar) >> s->common | 1U;
  const uint64_t h = (x ^ x >> 32) * UINT64_C(0x9e3779b97f4a7c15);
  return (uint32_t)((h >> 32) * all->threads >> 32);
}

/* Whose a configuration is: as the table knows it, or as above. `s`: a table that nobody else
 * opens or closes meanwhile; they are alike. */
SOTER_INLINE uint32_t soter_owner_of(const layered* all, const soter_store* s,
                                     const uint64_t* packed, const uint64_t* key) {
  const uint64_t calendar =
      all->repetition.calendar; /* then the table has all of a configuration */
  uint64_t h = 0U;
  SOTER_CHECK(all->threads <= THREADS);
  if (soter_store_is_short(s)) {
    return soter_owner_of_short(all, s, packed[0]);
  }
  for (uint32_t k = 0; all->threads > 1U && k < s->words; k++) {
    const uint64_t word = calendar == 0U ? key[k] : k == 0U ? packed[0] & ~calendar : packed[k];
    h = (h ^ word) * UINT64_C(0x9e3779b97f4a7c15);
  }
  return (uint32_t)((h >> 32) * all->threads >> 32);
}

/* A worker's table of a layer. */
SOTER_INLINE bool soter_layers_open_store(worker* w, soter_store* store) {
  const soter_search* const s = w->all->s;
  const uint32_t common = w->all->forgets && w->expander.instant != NULL ? s->m->calendar : 0U;
  const bool ok = soter_store_open(store, s->m, s->o->storage, soter_keeps_sleep(&w->expander),
                                   common, s->o->memory / w->all->threads);
  store->growth = 4U; /* settled when their time is over */
  store->layer = w->all->forgets;
  store->stop = &s->progress->stop;
  return ok;
}

/* Before the search, when all workers are open, and after it. */
void soter_repetition_open(layered* all);
void soter_repetition_close(layered* all);
/* While nobody works, and there is more to expand: whether all of that was there before. */
bool soter_repetition_found(layered* all);
/* A worker begins a layer: `before`. Whether what it expanded last, `store`, was taken away. */
bool soter_repetition_take(worker* w);

#endif
