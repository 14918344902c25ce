/* soter_explore_internal.h: what the files of the explorer share (not for drivers).
 *
 * Purpose: declare it. Each file says in its head what it is for; where one leaves out moves or
 * configurations, the argument stands in docs/testing.md, "Reduction", under the name in quotes:
 * - soter_explore_sound_reductions.c: "Sleep sets", "Ample sets"
 * - soter_explore_instant.c, _known_instants.c: "Ends of instants"
 * - soter_explore_independent_groups.c: "Groups within an instant"
 * - soter_explore_bfs.c: "Layers"; soter_explore_repeated_layers.c: "For ever"
 * - soter_explore_properties_across_parts.c: "Joined parts"
 * - soter_explore_transition_cache.c: "Remembered steps" (of "How it is stored and made fast")
 * Non-goals: what Python and generated code see (soter_explore.h).
 */
#ifndef SOTER_EXPLORE_INTERNAL_H
#define SOTER_EXPLORE_INTERNAL_H

#include <stdlib.h>
#include <string.h>

#include "soter_check.h"
#include "soter_explore.h"
#include "soter_explore_memory.h"

#define SOTER_NO_DEADLINE INT64_MAX
#define SOTER_NOTHING UINT32_MAX

typedef enum {
  SOTER_STEP = 0,
  SOTER_SKIPPED = 1,
  SOTER_BEGINS = 2, /* an overrunning step starts */
  SOTER_EFFECT = 3, /* what it published takes effect */
  SOTER_BIRTH = 4   /* the start, with the choices of initial values */
} soter_move_kind;

typedef struct {
  uint32_t actor;
  soter_move_kind kind;
  int64_t release, time; /* ns */
} soter_move;

/* When an actor's next step (or the effect of one that runs) may happen: in [low, high]. */
typedef struct {
  int64_t low, high; /* low SOTER_NO_DEADLINE: nothing is left */
} soter_window;

/* What a thread works with: two unpacked configurations, and the move between them. */
typedef struct {
  const soter_model* m;
  const soter_program* p;
  size_t size;
  uint8_t* started; /* a configuration that was started: what packing leaves out */
  uint8_t* here;    /* the configuration whose moves are made */
  uint8_t* there;   /* the configuration after a move */
  soter_choice choice[SOTER_CHOICES];
  uint32_t taken;
  uint32_t given;
  soter_answers answers;
  soter_window window[SOTER_ACTORS]; /* of `here` */
  int64_t limit;                     /* no move of `here` is later: the least `high` */
  uint32_t turn;  /* whose turn it is in `here`; SOTER_NOTHING: anybody's who may move */
  bool any_order; /* whoever asks sees to the order within an instant himself */
  soter_explore_coverage* coverage;
  uint64_t seed;
  uint64_t actors, properties, timeds; /* the part of the system that is looked at */
  const soter_broken* known;           /* [knowns]: what does not end the search */
  uint32_t knowns;
  const soter_broken* wanted;       /* nothing else is news; NULL: whatever is not known */
  soter_explore_progress* progress; /* NULL: nobody stops it, nobody looks */
  uint64_t tried;                   /* answers of the step that is being made */
  bool cut;                         /* stopped before all answers of a step were tried */
  bool many;     /* the step just made asked for more choices than there is room for */
  bool too_many; /* some step did: */
  uint32_t chooser;
} soter_workspace;

/* `o` NULL: the whole system, seed 0. */
bool soter_workspace_open(soter_workspace* space, const soter_model* m,
                          const soter_explore_options* o, soter_explore_progress* progress,
                          soter_explore_coverage* coverage);
void soter_workspace_close(soter_workspace* space);

/* Those who are not looked at have always done what they must: their part of a configuration never
 * changes. */
void soter_keep_others(const soter_workspace* space, void* configuration);

SOTER_INLINE bool soter_is_part(const soter_workspace* space, uint32_t actor) {
  return (space->actors >> actor & 1U) != 0U;
}

/* Looks at the configuration in `here`: windows and limit. */
void soter_find_windows(soter_workspace* space);

/* Whether an actor may move in `here`. */
SOTER_INLINE bool soter_may_move(const soter_workspace* space, uint32_t actor) {
  return space->window[actor].low <= space->limit &&
         (space->turn == SOTER_NOTHING || space->turn == actor);
}

/* Of those who may move now: whoever is next, where the order within an instant is declared. */
SOTER_INLINE uint64_t soter_in_order(const soter_model* m, uint64_t set) {
  return m->ordered ? set & (~set + 1U) : set;
}

/* The moves of an actor in `here` by their number: 0, 1, ...; false: there are no more. */
bool soter_move_of(const soter_workspace* space, uint32_t actor, uint32_t number, soter_move* move);

/* Makes a move from `here` into `there` with the picks in space->choice[0..given); `false` and
 * *broken where a contract is violated or a trusted component faults: then there is no
 * configuration after it. */
bool soter_make_move(soter_workspace* space, const soter_move* move, soter_broken* broken);

/* Whether somebody wants the search to end. */
SOTER_INLINE bool soter_is_stopped(const soter_workspace* space) {
  return space->progress != NULL && space->progress->stop != 0;
}

/* Tells how many answers of a step were tried, where that takes long. */
SOTER_INLINE void soter_tell_answers(soter_workspace* space, bool all) {
  const uint64_t many = UINT64_C(1) << 16;
  if (space->progress != NULL && space->tried >= many && (all || space->tried % many == 0U)) {
    space->progress->answers = all ? 0U : space->tried;
  }
  space->tried = all ? 0U : space->tried;
}

/* The next sequence of picks for the same move; false: all were made, or (`cut`) it is stopped: the
 * answers of one step may be more than can ever be tried. Of a step that asks for too many choices
 * the first answer is made. Begin with given = 0. */
SOTER_INLINE bool soter_next_picks(soter_workspace* space) {
  uint32_t i = space->taken;
  SOTER_CHECK(i <= SOTER_CHOICES);
  while (i > 0U && space->choice[i - 1U].pick + 1U >= space->choice[i - 1U].count) {
    i--;
  }
  if (i == 0U || space->many || soter_is_stopped(space)) {
    space->cut = space->cut || (i > 0U && !space->many);
    soter_tell_answers(space, true);
    return false;
  }
  space->tried++;
  soter_tell_answers(space, false);
  space->choice[i - 1U].pick++;
  space->given = i;
  return true;
}

SOTER_INLINE bool soter_same_broken(const soter_broken* a, const soter_broken* b) {
  return a->what == b->what && a->index == b->index;
}

/* Whether it is known already that this can be violated: then it does not end the search. */
SOTER_INLINE bool soter_is_known(const soter_workspace* space, const soter_broken* broken) {
  if (space->wanted != NULL) {
    return !soter_same_broken(space->wanted, broken);
  }
  for (uint32_t i = 0; i < space->knowns; i++) {
    if (soter_same_broken(&space->known[i], broken)) {
      return true;
    }
  }
  return false;
}

/* Whether time may pass in the configuration in `there`. */
bool soter_is_observable(soter_workspace* space);

/* Whether nobody has a step left in `there`. */
bool soter_at_the_end(soter_workspace* space);

/* Whether the configuration in `there` violates a property, and which: one that is not known, if
 * any. */
bool soter_finds_violation(soter_workspace* space, soter_broken* broken);
void soter_note_coverage(soter_workspace* space, uint32_t actor);

/* What is owed changes where it can be seen: in the configuration in `there`, which a move has
 * made. */
void soter_keep_obligations(soter_workspace* space);

/* Makes the first configurations, one for every sequence of initial choices: `there` after each
 * call; begin with given = 0 and go on while soter_next_picks. */
void soter_make_start(soter_workspace* space);

/* The reductions that are sound for a model, of those that the options ask for. */
uint32_t soter_sound_reductions(const soter_model* m, const soter_explore_options* o);

/* The actors whose moves from `here` are enough, of those in `enabled`. */
uint64_t soter_ample_set(const soter_workspace* space, uint64_t enabled);

/* All actors that may move in `here`. */
uint64_t soter_enabled_actors(const soter_workspace* space);

typedef struct {
  uint8_t* base;                  /* as allocated, */
  uint64_t bytes;                 /* so many */
  uint8_t* entry;                 /* at the beginning of a line */
  uint64_t buckets, count, limit; /* no more than so many */
  uint64_t homes;                 /* buckets that hashes say */
  uint64_t before;                /* count when last looked at; how often it was the same since */
  uint32_t idle;
} soter_segment;

typedef struct {
  soter_segment* segment;
  uint64_t room, count; /* in entries */
  uint32_t bytes;       /* of one entry */
  uint32_t key;         /* of them: the packed configuration; behind it the sleep set */
  uint32_t sleep;
  uint32_t words;  /* of the key */
  uint32_t packed; /* words of a packed configuration */
  uint32_t first;  /* bits of the first word */
  uint64_t all;    /* these bits */
  uint64_t mask;   /* of a load of eight bytes: those of the key */
  uint64_t memory; /* most bytes that it may take */
  bool fingerprint;
  bool layer;      /* it has configurations of one layer of a search only, */
  uint32_t common; /* which have so many bits in common, behind the lowest one: no entry has them */
  uint64_t low;    /* these bits and the lowest one, */
  uint64_t prefix; /* and what they are, where there is an entry */
  uint32_t growth; /* a segment grows by this part of itself */
  uint32_t segments;
  uint64_t was;             /* buckets of its largest segment before it was emptied */
  uint64_t* own;            /* a key: on the stack its room costs time */
  const volatile int* stop; /* growing may take seconds; NULL: it always ends */
} soter_store;

/* A place in a table. */
typedef struct {
  uint32_t segment;
  uint64_t entry;
} soter_cursor;

/* `common`: bits behind the lowest one that all configurations share that are in it at one time. */
bool soter_store_open(soter_store* s, const soter_model* m, soter_storage storage, bool sleep,
                      uint32_t common, uint64_t memory);
void soter_store_close(soter_store* s);
SOTER_INLINE uint64_t soter_store_bytes(const soter_store* s) {
  return s->room * s->bytes;
}

/* Puts a packed configuration in. Returns 1 if it is new, 0 if it was there, -1 if there is no
 * memory left. With sleep sets *sleep is the set on arrival; after: of a new configuration the
 * same; of an old one the moves that have to be made again are in *again, and the stored set is the
 * intersection. */
int soter_store_put(soter_store* s, const uint64_t* packed, uint64_t* sleep, uint64_t* again);
bool soter_store_has(const soter_store* s, const uint64_t* packed);
/* Keeps a table beyond its search, with others (soter_explore_kept). */
void* soter_keep_table(void* others, soter_store* s);
/* Both, as one. */
void* soter_join_kept(void* others, void* more);
/* All that is in tables that are kept. */
void soter_kept_each(const void* kept, void (*each)(void* to, const uint64_t* packed), void* to);
/* What stands in the table for a packed configuration; with it, putting. */
void soter_store_key(const soter_store* s, const uint64_t* packed, uint64_t* key);
int soter_store_put_key(soter_store* s, const uint64_t* packed, const uint64_t* key,
                        uint64_t* sleep, uint64_t* again);
/* A hint that a configuration will be put soon. */
void soter_store_expect(const soter_store* s, const uint64_t* packed, const uint64_t* key);
/* The keys of `count` packed configurations, one after the other; `expect`: with that hint. */
void soter_store_keys(const soter_store* s, const uint64_t* packed, uint32_t count, uint64_t* key,
                      bool expect);
/* Whether configurations are put many at a time: they are a word each, and an entry is nothing
 * else. */
SOTER_INLINE bool soter_store_is_short(const soter_store* s) {
  return s->packed == 1U && s->sleep == 0U && !s->fingerprint;
}
/* Then: those that are new are in `fresh`, in the order in which they came; returns how many they
 * are. *count: how many configurations there are; after: how many were put, less where there is no
 * memory left. */
uint32_t soter_store_put_short(soter_store* s, const uint64_t* packed, uint32_t* count,
                               uint64_t* fresh);
/* The next entry from *at on, which is moved behind it; false: there is none. */
bool soter_store_next(const soter_store* s, soter_cursor* at, uint64_t* packed, uint64_t* sleep);
/* The next `count` entries where configurations are put many at a time: there are as many. */
void soter_store_next_short(const soter_store* s, soter_cursor* at, uint32_t count,
                            uint64_t* packed);
/* After a layer of a search: what has had no new entry for a while takes no more room than it
 * needs. */
void soter_store_settle(soter_store* s);
/* Forgets all entries; the room for as many is kept. False: there is no memory. */
bool soter_store_empty(soter_store* s);
/* All stored configurations, in no order; returns how many there are. */
uint64_t soter_store_each(const soter_store* s, void (*each)(void* to, const uint64_t* packed),
                          void* to);

/* The sum of a number for every entry, and whether two tables have the same ones: of configurations
 * as they are but for what they have in common, and for these bits of the first word, which all of
 * a table have in common though it keeps them (`calendar`; 0: none). */
uint64_t soter_store_digest(const soter_store* s, uint64_t calendar);
bool soter_store_same(const soter_store* s, const soter_store* other, uint64_t calendar);

SOTER_INLINE uint64_t soter_scramble(uint64_t x) {
  x ^= x >> 32;
  x *= UINT64_C(0xd6e8feb86659fd93);
  x ^= x >> 32;
  x *= UINT64_C(0xd6e8feb86659fd93);
  return x ^ (x >> 32);
}

/* A hash of the bits of some words that a mask has (NULL: of all), 32 bits: the highest bits of the
 * last word count in it, too. */
SOTER_INLINE uint64_t soter_hash(const uint64_t* words, const uint64_t* mask, uint32_t count) {
  const uint64_t odd = UINT64_C(0x9e3779b97f4a7c15);
  uint64_t h = 0U;
  for (uint32_t k = 0; k < count; k++) {
    h = (h ^ (h >> 29) ^ (mask == NULL ? words[k] : words[k] & mask[k])) * odd;
  }
  return ((h ^ (h >> 32)) * odd) >> 32;
}

/* memcpy of a few words: a call costs more. */
SOTER_INLINE void soter_copy_words(uint64_t* to, const uint64_t* from, uint32_t words) {
  for (uint32_t k = 0; k < words; k++) {
    to[k] = from[k];
  }
}

SOTER_INLINE int64_t soter_later(int64_t a, int64_t b) {
  return a > b ? a : b;
}

/* 64 bits of a packed configuration; never 0. */
SOTER_INLINE uint64_t soter_fingerprint(const uint64_t* packed, uint32_t words) {
  uint64_t a = UINT64_C(0x243f6a8885a308d3);
  for (uint32_t i = 0; i < words; i++) {
    a = soter_scramble(a ^ packed[i]) + UINT64_C(0x9e3779b97f4a7c15);
  }
  a = soter_scramble(a);
  return a == 0U ? 1U : a;
}

/* What one expansion found: packed configurations one after the other, and what then sleeps. */
typedef struct {
  uint64_t* packed;
  uint64_t* sleep;
  uint32_t count, room;
} soter_successors;

struct soter_cache;
struct soter_instant;
struct soter_groups;

/* In place of what sleeps in a successor, where only ends of instants are stored: it is one.
 * Whoever has just moved never sleeps. */
#define SOTER_AT_END UINT64_MAX

/* Expands packed configurations. Where no step lasts, one is run once for every value of the packed
 * bits that it may read, and remembered (soter_explore_transition_cache.c); otherwise
 * configurations are unpacked. */
typedef struct {
  soter_workspace space;
  soter_successors successors;
  uint32_t reduce;
  uint32_t words;
  struct soter_cache* cache;     /* NULL: nothing is remembered */
  struct soter_instant* instant; /* NULL: all configurations are given to the search */
  struct soter_groups* groups;   /* NULL: not by groups */
  uint64_t transitions;
  uint64_t combined; /* of these: ends that are combinations of what groups do */
  uint64_t max_ran;  /* of the others: no more are wanted then; 0: no bound */
  uint32_t begin;    /* the first successor of the configuration last expanded */
  bool broke; /* a move of the configuration last expanded violates `broken`: no configuration comes
                 after it */
  soter_broken broken;
  uint64_t memory; /* bytes that what is remembered may take */
  bool no_memory;
  bool go_on; /* also behind a violation */
  /* Takes the successors away where one configuration has very many (and forgets them); false: no
   * more are wanted. */
  bool (*spill)(void* to);
  void* to;
  uint32_t most;             /* successors, before that */
  uint64_t batch_successors; /* of many configurations that are expanded at once, at most */
  bool enough;               /* no more successors of this configuration */
} soter_expander;

void soter_expander_close(soter_expander* expander);

/* All moves of a configuration that the reduction asks for: `only` says which actors (a mask),
 * `sleep` which of them sleep. The successors of the last call are overwritten. */
void soter_expand(soter_expander* expander, const uint64_t* packed, uint64_t sleep, uint64_t only);

/* The same, or, where only ends of instants are stored, the ends that come next: no successor
 * sleeps. What breaks something in the middle is `broken`. */
void soter_expand_next(soter_expander* expander, const uint64_t* packed, uint64_t sleep,
                       uint64_t only);

/* Whether all windows are points: every execution goes from one end of an instant to the next. */
bool soter_has_instants(const soter_model* m);
/* Whether a search stores only ends of instants: it was asked to, and all windows are points. */
bool soter_by_instants(const soter_model* m, const soter_explore_options* o);
/* Steps in so many instants: the same in all executions. */
typedef struct {
  int64_t now;
  uint32_t instants, steps;
} soter_instant_count;
/* Counts on to `instants`; a zeroed one has counted none. Returns the steps. */
uint32_t soter_steps_until(const soter_model* m, const soter_explore_options* o,
                           soter_instant_count* c, uint32_t instants);
/* The scratch set of one expander. */
struct soter_instant* soter_instant_open(const soter_model* m, uint64_t memory);
void soter_instant_close(struct soter_instant* t);
uint64_t soter_instant_bytes(const struct soter_instant* t);
/* As soter_store_put. */
int soter_instant_put(struct soter_instant* t, const uint64_t* packed, uint64_t* sleep,
                      uint64_t* again);
/* Whether a mid of an instant violates a property: it can only be too late for something. */
bool soter_is_late(soter_expander* expander, const uint64_t* packed, soter_broken* broken);
/* How many bytes more it may take. */
void soter_instant_allow(struct soter_instant* t, uint64_t more);

/* Whether instants are run through by groups that share nothing in them: steps are remembered, none
 * is lost, and SOTER_REDUCE_GROUPS asks for it. */
bool soter_in_groups(const soter_model* m, const soter_explore_options* o);
struct soter_groups* soter_groups_open(const soter_model* m, uint64_t memory);
void soter_groups_close(struct soter_groups* q);
uint64_t soter_groups_bytes(const struct soter_groups* q);
/* soter_expand_next by groups; false: nothing was done, it has to be done otherwise. */
bool soter_groups_expand(soter_expander* expander, const uint64_t* packed);

/* Whether a table has to keep what sleeps. */
SOTER_INLINE bool soter_keeps_sleep(const soter_expander* expander) {
  return (expander->reduce & SOTER_REDUCE_SLEEP) != 0U && expander->instant == NULL;
}

/* Whether so many steps were run as a search may run that only looks which reduction is quicker. */
SOTER_INLINE bool soter_ran_enough(const soter_expander* expander) {
  return expander->max_ran > 0U && expander->transitions - expander->combined >= expander->max_ran;
}

/* Whether the search is to end: then successors are missing. */
SOTER_INLINE bool soter_is_to_end(soter_expander* expander) {
  expander->space.cut =
      expander->space.cut || soter_is_stopped(&expander->space) || soter_ran_enough(expander);
  return expander->space.cut;
}

SOTER_INLINE void soter_forget_successors(soter_expander* expander) {
  expander->successors.count = 0U;
}

/* Whether a packed configuration violates a property. */
bool soter_is_broken(soter_expander* expander, const uint64_t* packed, soter_broken* broken);

/* The configurations at the start, as successors. */
void soter_expand_start(soter_expander* expander);

/* Makes room for more successors; false: there is no memory. */
bool soter_more_successors(soter_expander* expander);

#ifndef SOTER_BATCH      /* tests stop anywhere */
#define SOTER_BATCH 512U /* configurations that are expanded at once, at most; */
#endif
#define SOTER_BATCH_SUCCESSORS 4096U /* with so many successors */

/* At most `memory` bytes, more or less. */
struct soter_cache* soter_cache_open(soter_expander* expander, uint64_t memory);
void soter_cache_close(struct soter_cache* cache);
uint64_t soter_cache_bytes(const struct soter_cache* cache);
/* Bytes of the successors, and of what is remembered. */
uint64_t soter_expander_bytes(const soter_expander* expander);
bool soter_cache_expand(soter_expander* expander, const uint64_t* packed, uint64_t sleep,
                        uint64_t only);
/* The same for a batch of configurations of a word, all moves, where nothing sleeps and all
 * configurations are given to the search; false: they have to be expanded one by one, and nothing
 * was done. */
bool soter_cache_expand_batch(soter_expander* expander, const uint64_t* packed, uint32_t count);
/* How many configurations of a word, from the first one on, are known to violate nothing. */
uint32_t soter_cache_count_unviolated(const soter_expander* expander, const uint64_t* packed,
                                      uint32_t count);
bool soter_cache_finds_violation(soter_expander* expander, const uint64_t* packed,
                                 soter_broken* broken);

/* Sleep sets: what sleeps after `actor` has moved, when `before` are the siblings made earlier. */
SOTER_INLINE uint64_t soter_still_asleep(const soter_model* m, uint32_t actor, uint64_t sleep,
                                         uint64_t before) {
  return (sleep | before) & ~m->actor[actor].dependent;
}

/* Packed configurations that wait, in a row: each with what sleeps in it and which moves are still
 * to be made
 * (`width` words + 2), or with one number (words + 1). */
typedef struct {
  uint64_t* item;
  uint64_t count, room;
  uint64_t most; /* items that it ever had: so much memory is in use */
  uint32_t words, width;
} soter_row;

/* Appends; false: there is no memory. `first` and `only` are left out where the row has no place
 * for them. */
bool soter_row_put(soter_row* r, const uint64_t* packed, uint64_t first, uint64_t only);
/* Room for so many more; false: there is no memory. */
bool soter_row_reserve(soter_row* r, uint64_t more);
void soter_row_close(soter_row* r);
/* Takes the first ones away. */
void soter_row_drop(soter_row* r, uint64_t count);

SOTER_INLINE uint64_t* soter_row_at(const soter_row* r, uint64_t i) {
  SOTER_CHECK(i < r->room);
  return r->item + i * r->width;
}

/* The least time of those from number `first` on: what comes of them is observed then or later.
 * INT64_MAX: there are none. */
int64_t soter_row_time(const soter_row* r, const soter_model* m, uint64_t first);

SOTER_INLINE int64_t soter_earlier(int64_t a, int64_t b) {
  return a < b ? a : b;
}

SOTER_INLINE uint64_t soter_row_bytes(const soter_row* r) {
  return r->most * r->width * sizeof *r->item;
}

typedef struct {
  const soter_model* m;
  const soter_explore_options* o;
  soter_explore_progress* progress;
  soter_explore_coverage* coverage;
  soter_explore_result* result;
  soter_trace_step* trace;
  uint32_t room;
} soter_search;

/* `memory`: bytes that what it remembers may take. */
bool soter_expander_open(soter_expander* expander, const soter_search* s,
                         soter_explore_coverage* coverage, uint64_t memory);

typedef void soter_strategy_fn(soter_search* s);
soter_strategy_fn soter_search_bfs, soter_search_random, soter_search_falsify;

/* Looks depth first for an execution to a violation that breadth-first search has found, and writes
 * it down; nothing is written where it is not found. */
void soter_trace_depth_first(soter_search* s);

/* Writes one step of a trace from the last move made at `space`. */
void soter_write_step(const soter_workspace* space, const soter_move* move, soter_trace_step* to);

/* Finds the move (with its picks) that leads from `from` to `to` (packed configurations; `from`
 * NULL: birth), or, where `to` is NULL, to a violation of `broken`, and writes it down. */
bool soter_find_move(soter_workspace* space, const uint64_t* from, const uint64_t* to,
                     const soter_broken* broken, soter_trace_step* step);

/* The same for a row of moves, where only ends of instants are stored and `from` and `to` are two
 * that follow each other; written from number *written on, which is moved on. */
bool soter_find_moves(soter_search* s, soter_workspace* space, const uint64_t* from,
                      const uint64_t* to, const soter_broken* broken, uint32_t* written);

void soter_merge_coverage(const soter_model* m, soter_explore_coverage* into,
                          const soter_explore_coverage* from);

#endif
