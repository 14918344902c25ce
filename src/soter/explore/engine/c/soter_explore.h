/* soter_explore.h: the explorer, one more driver over the state struct (docs/testing.md).
 *
 * Purpose: declare what Python and generated code exchange with the explorer. A *configuration* is
 * the program's state followed by the schedule: the time, how many releases every actor has made,
 * the deadlines of properties. Generated code packs a configuration into a few words, which are
 * stored. Non-goals: what only the explorer's own files share (soter_explore_internal.h).
 */
#ifndef SOTER_EXPLORE_H
#define SOTER_EXPLORE_H

#include "soter.h"

#define SOTER_ACTORS 64U   /* at most: a set of actors is one word */
#define SOTER_CHOICES 256U /* choices in one step, at most */
#define SOTER_WORDS 4096U  /* of a packed configuration, at most */
#define SOTER_THREADS 16U  /* of breadth-first search, at most */
#define SOTER_INPUT \
  0x80000000U /* in `component` of an actor: input number (component & ~SOTER_INPUT) */

typedef struct {
  uint32_t component; /* or SOTER_INPUT | number of the input */
  int64_t period_ns, phase_ns;
  int64_t window_ns;      /* a step happens in [r, r + window] */
  int64_t overrun_ns;     /* its publications take effect up to this long after; 0: at once */
  int64_t least_ns;       /* and not before; > 0: a step always lasts */
  uint32_t skips;         /* releases in a row that may be lost; 0: none */
  uint64_t dependent;     /* actors whose steps do not commute with this one's, itself included */
  bool visible;           /* its step may change what a property reads */
  const uint32_t* output; /* topics that it publishes */
  const uint32_t* leaf;   /* per output: its first leaf in the model's table; the others follow */
  uint32_t outputs;
  const uint64_t* reads;  /* [words]: packed bits that its steps may read, */
  const uint64_t* writes; /* [words]: and write, but for the schedule's and deadlines */
  uint32_t held;          /* overrun: offset in the configuration of its soter_held; else 0 */
} soter_actor;

/* A configuration: the state, padded to 8 bytes; one soter_schedule; then
 *   int64_t due[timeds]     until when it has to hold; INT64_MAX: nothing is owed
 *   int64_t verdict[modules] when the DM last said AC; 0 at the start
 *   uint32_t done[actors]   releases made (or lost)
 *   uint32_t lost[actors]   releases lost in a row
 *   uint8_t acted[modules]  SC has published since the last AC verdict, and the mode is SC
 *   zeros up to a multiple of 8; then per overrunning actor a soter_held and, each padded to 8, the
 *   values of its outputs, that wait to take effect. */
typedef struct {
  int64_t now; /* ns; -1 before the first step */
} soter_schedule;

typedef struct {
  int64_t since; /* start of the step that still runs; -1: none does */
  uint64_t mask; /* outputs that it will publish */
} soter_held;

typedef enum { SOTER_EVENTUALLY = 0, SOTER_LEADSTO = 1, SOTER_INVARIANT = 2 } soter_timed_kind;

typedef struct {
  const char* text;
  soter_timed_kind kind;
  bool (*premise)(const void* state);   /* leadsto; a fault is false */
  bool (*condition)(const void* state); /* eventually, leadsto: a fault is false; invariant: safe */
  int64_t within_ns;                    /* for an invariant 2 * period of the module */
  uint32_t module;                      /* invariant */
} soter_timed;

/* A field of a packed configuration that grows older as time passes: ticks since something, at most
 * `most`; one more than ticks since a publication, 0 never; ticks until a deadline
 * (soter_pack_due). */
typedef enum { SOTER_SINCE = 0, SOTER_STAMP = 1, SOTER_DUE = 2 } soter_ageing_kind;
typedef struct {
  uint32_t at, width; /* bits */
  soter_ageing_kind kind;
  uint64_t most;
} soter_ageing;

/* The premise of an always that is an implication; a fault is false. */
typedef bool (*soter_premise)(const void* state);

/* A scalar of a topic, for coverage: kind 0 bool or enum, 1 int, 2 float. */
typedef struct {
  uint32_t topic;
  size_t offset; /* in the state */
  uint32_t kind, size;
  bool is_signed;
  double low, high; /* of its set; -inf and inf where it has none */
} soter_leaf;

typedef struct {
  const soter_program* program;
  const soter_actor* actor;
  const soter_timed* timed;
  const soter_leaf* leaf;
  const soter_premise* premise; /* [properties]: NULL of what is no implication; NULL: of none */
  uint32_t actors, timeds, leaves, branches;
  int64_t tick_ns;    /* every time is a multiple */
  int64_t quantum_ns; /* steps happen at multiples of it, where `timely` */
  int64_t horizon_ns;
  bool ordered;      /* the steps of an instant happen in the order of the actors */
  bool timely;       /* when a step happens matters: its time is a choice */
  bool sampled;      /* a continuum is sampled: never exhausted */
  uint64_t now_mask; /* of a packed configuration's first word without its lowest bit: now */
  bool plain;        /* nothing of the past is packed but values: no ages, no deadlines */
  bool brief;        /* no step lasts: it changes the schedule, its `writes`, and what time
                        changes */
  const soter_ageing* ageing;
  uint32_t ageings;
  const uint64_t* scheduled; /* [words]: packed bits of the schedule: now, done, lost */
  const uint64_t* clock;     /* [words]: of these: now */
  uint32_t calendar; /* bits behind the lowest one: now and releases made, where no step is late */
  const uint64_t* observed; /* [words]: packed bits that properties read, but for: */
  const uint64_t* dues;     /* [words]: deadlines */
  const uint64_t* verdicts; /* [words]: what invariants know of the past */
  uint32_t configuration_size;
  uint32_t bits;  /* of a packed configuration */
  uint32_t words; /* uint64_t that these take */
  void (*pack)(const void* configuration, uint64_t* words);
  void (*unpack)(const uint64_t* words,
                 void* configuration); /* into a configuration that was started once */
} soter_model;

/* Parts of a configuration. */
SOTER_INLINE size_t soter_padded(size_t size) {
  return (size + 7U) & ~(size_t)7U;
}
SOTER_INLINE soter_schedule* soter_schedule_of(const soter_program* p, void* configuration) {
  return (soter_schedule*)((char*)configuration + soter_padded(p->state_size));
}
SOTER_INLINE int64_t* soter_due_of(const soter_program* p, void* configuration) {
  return (int64_t*)(soter_schedule_of(p, configuration) + 1);
}
SOTER_INLINE int64_t* soter_verdict_of(const soter_model* m, void* configuration) {
  return soter_due_of(m->program, configuration) + m->timeds;
}
SOTER_INLINE uint32_t* soter_done_of(const soter_model* m, void* configuration) {
  return (uint32_t*)(soter_verdict_of(m, configuration) + m->program->modules);
}
SOTER_INLINE uint32_t* soter_lost_of(const soter_model* m, void* configuration) {
  return soter_done_of(m, configuration) + m->actors;
}
SOTER_INLINE uint8_t* soter_acted_of(const soter_model* m, void* configuration) {
  return (uint8_t*)(soter_lost_of(m, configuration) + m->actors);
}

/* When the last step of a packed configuration happened, ns; -1 (or less) before the first one. */
SOTER_INLINE int64_t soter_time_of(const soter_model* m, const uint64_t* packed) {
  return ((int64_t)(packed[0] >> 1 & m->now_mask) - 1) * m->tick_ns;
}

typedef enum { SOTER_BFS = 0, SOTER_RANDOM = 1, SOTER_FALSIFY = 2 } soter_strategy;

typedef enum { SOTER_EXACT = 0, SOTER_FINGERPRINT = 1 } soter_storage;

#define SOTER_REDUCE_SLEEP 1U
#define SOTER_REDUCE_AMPLE 2U
#define SOTER_REDUCE_INSTANTS 4U
#define SOTER_REDUCE_GROUPS 8U /* with instants */

/* What is violated: `what` 0 always/never (`index` property), 1 a contract (property), 2 a trusted
 * component faulted (component), 3 a timed property (timed). */
typedef struct {
  uint32_t what, index;
} soter_broken;

typedef struct {
  soter_strategy strategy;
  soter_storage storage;
  uint32_t reduce; /* SOTER_REDUCE_... */
  uint32_t threads;
  uint64_t memory;     /* bytes that tables, frontiers and remembered steps may take together */
  uint64_t max_states; /* 0: no bound */
  uint64_t max_ran;    /* steps that are run and not combined of others; 0: no bound */
  uint64_t seed;
  uint64_t runs;       /* of the random strategies */
  bool keep;           /* keep the stored configurations for soter_explore_kept */
  uint64_t actors;     /* only these move, and only these properties and timed ones are judged: */
  uint64_t properties; /* a part of the system that shares nothing with the rest; actors 0: all */
  uint64_t timeds;
  bool plainly; /* never remember steps: run every one (a check of the explorer itself) */
  bool closes;  /* end where whatever comes later was there before: nothing reads the time */
  bool go_on;   /* do not stop at a violation: what violates is not expanded */
  const soter_broken* known; /* [knowns]: nor at one of these: others are looked for */
  uint32_t knowns;
  const uint64_t*
      noted; /* [words]: bits whose values at ends of instants are kept in place of
                configurations; breadth first, where only ends are stored. NULL: nothing is */
  const uint64_t*
      goal; /* [words]: an end with these noted bits violates `sought`; NULL: none does */
  soter_broken sought;
  uint64_t noted_bytes; /* that what is noted may take */
} soter_explore_options;

typedef enum {
  SOTER_EXHAUSTED = 0,
  SOTER_VIOLATED = 1,
  SOTER_MEMORY = 2,
  SOTER_STATES = 3,
  SOTER_RUNS = 4,
  SOTER_STOPPED = 5,
  SOTER_NO_MEMORY = 6, /* not even enough to begin */
  SOTER_CHOOSY = 7,    /* a step asks for more than SOTER_CHOICES choices */
  SOTER_WIDE = 8,      /* a packed configuration takes more than SOTER_WORDS words */
  SOTER_LONG = 9       /* the trace has more steps than there is room for */
} soter_explore_status;

/* One step of a trace. `kind`: 0 step, 1 lost release (skip), 2 start of an overrunning step, 3 its
 * publications take effect, 4 the start (choices of initial values). */
typedef struct {
  uint32_t actor, kind;
  int64_t release_ns, time_ns;
  uint32_t choices;
  soter_choice choice[SOTER_CHOICES];
} soter_trace_step;

typedef struct {
  soter_explore_status status;
  soter_broken broken;
  uint64_t states, transitions, runs;
  uint64_t combined; /* of the transitions: combinations of what groups do in an instant */
  uint64_t table_bytes, frontier_bytes;
  uint64_t memo_bytes;   /* of steps that are remembered, and of what one step leads to */
  uint64_t needed_bytes; /* SOTER_NO_MEMORY: to begin */
  int64_t covered_ns;    /* everything that is observed before this time was judged, INT64_MAX: all
                            that there is; of exhaustive searches */
  int64_t closed_ns;     /* options.closes: whatever comes later was there before; 0: not known */
  bool closable;         /* that was looked for, or would be before a later horizon */
  uint32_t threads;      /* that searched */
  uint32_t chooser;      /* SOTER_CHOOSY: the actor; UINT32_MAX: the start */
  uint32_t depth;        /* steps of the longest execution seen */
  uint32_t length;       /* of the trace */
  void* kept;            /* options.keep: for soter_explore_kept, until soter_explore_free */
} soter_explore_result;

typedef struct {
  volatile int stop; /* set by another thread: the search ends in order */
  volatile uint64_t states, transitions;
  volatile uint32_t depth;
  volatile int tracing;        /* something is violated: a way to it is looked for */
  volatile uint64_t bytes;     /* of tables, frontiers and remembered steps */
  volatile int64_t covered_ns; /* everything before was judged (breadth first) */
  volatile uint64_t answers;   /* of one step that were tried so far, where they are very many */
} soter_explore_progress;

typedef struct {
  uint64_t* branches; /* [(branches + 63) / 64] */
  uint8_t* classes; /* [leaves * 256]: kinds 0: value % 256; 1 and 2: 0 low 1 high 2 negative 3 zero
                       4 positive */
  uint8_t* modes;   /* [modules * 2] seen; */
  uint8_t* switches; /* [modules * 2] to SC, to AC */
  uint8_t* fired;    /* [actors] */
  uint8_t* judged;   /* [properties + timeds]: an always or never was looked at where time may pass;
                        what a timed property promises was due within the horizon: SOTER_JUDGED;
                        the premise of an always held there, an eventually was owed: SOTER_MET */
} soter_explore_coverage;

#define SOTER_JUDGED 1U
#define SOTER_MET 2U

/* Searches. `trace` has room for `room` steps. `coverage` is added to. */
void soter_explore(const soter_model* m, const soter_explore_options* o,
                   soter_explore_progress* progress, soter_explore_coverage* coverage,
                   soter_explore_result* result, soter_trace_step* trace, uint32_t room);

/* The least trace to a violation of `broken`: fewest steps, then fewest changes of actor, then
 * fewest non-default choices; by a search without reduction. SOTER_VIOLATED, or why not. */
void soter_explore_least(const soter_model* m, const soter_explore_options* o, soter_broken broken,
                         soter_explore_progress* progress, soter_explore_result* result,
                         soter_trace_step* trace, uint32_t room);

/* Whether a configuration at the start, before any step, violates an always or never (or whether
 * that is not known: no memory, too many of them, stopped). */
bool soter_explore_starts_broken(const soter_model* m, soter_explore_progress* progress);

/* Makes an execution of the whole system out of one of a part of it (options.actors): the others'
 * steps are put in where the order asks for them, with default choices, until something is
 * violated. Returns the number of steps written to `whole`; 0: there was no room, or it is no
 * execution. */
uint32_t soter_explore_complete(const soter_model* m, const soter_explore_options* o,
                                const soter_trace_step* part, uint32_t length,
                                soter_trace_step* whole, uint32_t room, soter_broken* broken);

/* Steps that are wished, and where it is written down what comes of them. The first `begin` wishes
 * are taken for made, and led to the configuration `from`. `made`, `unusual` (how many choices of a
 * step are not the default one, its time and loss among them) and `configurations` (the
 * configuration after each step; NULL: nobody wants them) have room for `limit` steps; more are not
 * made. */
typedef struct {
  uint64_t seed;
  soter_broken wanted;
  const soter_trace_step* wish;
  uint32_t length, begin, limit;
  const void* from;
  soter_trace_step* made;
  uint32_t* unusual;
  void* configurations;
} soter_guide;

/* Makes an execution of the whole system that follows wishes as far as that is possible, by default
 * steps otherwise, until something is violated: `violates` says whether `wanted` is. Returns how
 * many steps it has, those before `begin` among them. */
uint32_t soter_explore_guided(const soter_model* m, const soter_guide* g, bool* violates);

/* One of several parts of a system that share nothing: who moves in it, what was noted of it. */
typedef struct {
  uint64_t actors;
  const void* kept;
} soter_side;

/* The bits of a part that are noted: the schedule's, and what always and never read of what its
 * actors write. */
void soter_explore_noted(const soter_model* m, uint64_t actors, uint64_t* mask);

/* Whether an always or never is violated where time passes, in the system that has these parts: all
 * combinations of what was noted of them at one time. SOTER_VIOLATED, and per part in `goals`
 * ([sides * words]) what it has then; SOTER_EXHAUSTED; SOTER_MEMORY where there are too many, or
 * the start is not the only one: nothing is known then; SOTER_STOPPED. */
soter_explore_status soter_explore_joined(const soter_model* m, const soter_explore_options* o,
                                          const soter_side* side, uint32_t sides, uint32_t property,
                                          soter_explore_progress* progress,
                                          soter_explore_coverage* coverage, uint64_t* goals);

/* All configurations that a search with exact storage stored, written to `configurations` one after
 * the other (NULL: nothing is written); returns how many there are. */
uint64_t soter_explore_kept(const soter_model* m, const void* kept, void* configurations);
void soter_explore_free(void* kept);

#endif
