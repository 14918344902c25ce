/* soter_explore_transition_cache.h: what a transition cache holds (not for drivers).
 *
 * Purpose: declare the cache for the file that fills it and the one that expands with it.
 * Non-goals: what other files ask of it (soter_explore_internal.h).
 */
#ifndef SOTER_EXPLORE_TRANSITION_CACHE_H
#define SOTER_EXPLORE_TRANSITION_CACHE_H

#include "soter_explore_hash_map.h"
#include "soter_explore_pack.h"
#include "soter_explore_successors.h"

#define AGED_STATES 16U  /* times at once at which a configuration is made older */
#define VERDICT_KINDS 3U /* of configurations: not looked at; looked at; nothing comes after it */

/* How a step may end: it breaks something, and these bits of `writes` are the new ones. */
typedef struct {
  uint32_t first, count; /* outcomes: in `value`, `count` times `words` */
  bool broke;
  soter_broken broken;
} effect;

/* An effect as one number that is not 0: a bit, where `broken` stands among the `violations` (0:
 * nothing broke), the count, and the first. */
#define PRESENT (UINT64_C(1) << 63)
#define BROKEN_BITS 13U
#define COUNT_BITS 18U
#define MOST_OUTCOMES ((1U << COUNT_BITS) - 1U)

/* A move by the schedule: who, and the schedule's bits after it. */
typedef struct {
  uint32_t actor, number; /* of its moves */
  uint64_t later;         /* ticks from now */
  bool lost, first;       /* first release of a plant: reads more than its bits */
  bool ends;              /* the instant is over then */
  bool observable;        /* what comes of it is observable */
} planned_move;

typedef struct {
  uint32_t first, count; /* planned moves, with `words` of schedule bits each */
  uint64_t ample, enabled;
  bool observable;
  bool over;     /* nobody moves any more */
  uint32_t last; /* the last one of many configurations that has it, */
  uint64_t turn; /* and when that was */
} move_list;

/* Configurations as old as they are at some later time. */
typedef struct {
  uint64_t* packed; /* [AGED_STATES * words] */
  uint64_t turn[AGED_STATES];
  uint64_t later[AGED_STATES];
} aged_states;

struct soter_cache {
  uint32_t words, actors;
  map* effects; /* [2 * actors]: 2a, and 2a + 1 for first releases */
  map by_schedule, owed;
  map verdicts[VERDICT_KINDS];
  list values, move_lists, planned_moves, bits, violations, obligations;
  uint64_t* changed;         /* [actors * words]: schedule and writes */
  uint64_t* verdict_bits;    /* [words]: what decides whether an observed configuration violates */
  uint64_t* obligation_bits; /* [words]: and what is owed after it */
  uint64_t* scratch;         /* [words]: a configuration, when a step is made in it */
  bool* reads_schedule;      /* [actors]: its steps read the schedule */
  bool* reads_no_time;       /* [actors]: or no time at all */
  bool has_deadlines;        /* some property has deadlines */
  aged_states aged_ones;
  uint64_t turn;   /* configurations expanded */
  uint64_t memory; /* most bytes of all this: beyond it, it is given up */
};

/* The effect that a number stands for. */
SPECIAL effect effect_of_word(const struct soter_cache* cache, uint64_t number) {
  const uint64_t broken = number >> (32U + COUNT_BITS) & ((UINT64_C(1) << BROKEN_BITS) - 1U);
  effect found = {(uint32_t)number,
                  (uint32_t)(number >> 32U) & ((1U << COUNT_BITS) - 1U),
                  broken != 0U,
                  {0U, 0U}};
  if (found.broke) {
    found.broken = ((const soter_broken*)cache->violations.item)[broken - 1U];
  }
  return found;
}

/* Whether there is an effect, and it breaks nothing. */
SPECIAL bool breaks_nothing(uint64_t number) {
  return number >> (32U + COUNT_BITS) == PRESENT >> (32U + COUNT_BITS);
}

/* Lists the moves of `here`, which is unpacked, its windows found. False: there is no memory, or
 * schedules seldom come back, so that looking them up gains nothing; nothing is kept then, as it
 * would be asked for again and again. */
bool soter_compute_move_list(soter_expander* expander, struct soter_cache* cache,
                             const uint64_t* packed);

/* Runs the step of a planned move in `here` with all picks, and keeps what it writes; `before` is
 * that configuration when the step begins. Stopped, it keeps what it has: the search ends with
 * that. */
bool soter_compute_effect(soter_expander* expander, struct soter_cache* cache,
                          const uint64_t* before, const planned_move* planned, map* effects);

/* Computes what properties owe in a configuration that is observed, after a move led to it. */
bool soter_compute_obligations(soter_expander* expander, const uint64_t* successor);

/* Judges a configuration, and keeps the verdict of these bits where there is room. */
effect soter_compute_verdict(soter_expander* expander, const uint64_t* packed, map* seen,
                             const uint64_t* decides);

#endif
