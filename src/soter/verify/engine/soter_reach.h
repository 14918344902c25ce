/* Sets of states on rectilinear grids: cores, tubes, predicates, ranks (docs/verification.md,
 * section 3).
 * Purpose: declare what Python asks of the engine. No heap, no globals: all memory is the caller's.
 * Every result rounds outward.
 * Non-goals: which sets a proof needs (verify/claims/claims.py).
 *
 * A group has up to four axes; a cell is a closed box; what lies outside the grid is unsafe.
 * Sets are bits: rows along the last axis, `words` words a row, least significant bit first. */
#ifndef SOTER_REACH_H
#define SOTER_REACH_H

#include <stdint.h>

#include "soter_form.h"

typedef unsigned (*soter_reach_map)(const soter_form*, const int64_t*, soter_form*);
typedef unsigned (*soter_reach_test)(const soter_form*, const int64_t*, soter_truth*);

/* Python reads this header too (native/c_interface.py): types, numbers, functions. */
#define SOTER_REACH_AXES 4
#define SOTER_REACH_COMMANDS 8
#define SOTER_REACH_PAST 4
#define SOTER_REACH_SEGMENTS 64
#define SOTER_REACH_KEPT 1
#define SOTER_REACH_UNBOUNDED 2
#define SOTER_REACH_WRAPS 3

/* x' is in a x + b u + c + [-w, w]. */
typedef struct {
  double a[SOTER_REACH_AXES][SOTER_REACH_AXES];
  double b[SOTER_REACH_AXES][SOTER_REACH_COMMANDS];
  double c[SOTER_REACH_AXES];
  double w[SOTER_REACH_AXES];
} soter_reach_model;

/* x(h) is in phi x(0) + gamma u + c + [-w, w]; the `_r` are radii of the matrices' entries.
 * dev bounds the integral of |e^(As)|, move the early part of gamma (jitter). */
typedef struct {
  double h;
  double phi[SOTER_REACH_AXES][SOTER_REACH_AXES];
  double phi_r[SOTER_REACH_AXES][SOTER_REACH_AXES];
  double gamma[SOTER_REACH_AXES][SOTER_REACH_COMMANDS];
  double gamma_r[SOTER_REACH_AXES][SOTER_REACH_COMMANDS];
  double c[SOTER_REACH_AXES];
  double c_r[SOTER_REACH_AXES];
  double w[SOTER_REACH_AXES];
  double dev[SOTER_REACH_AXES][SOTER_REACH_AXES];
  double move_lo[SOTER_REACH_AXES][SOTER_REACH_COMMANDS];
  double move_hi[SOTER_REACH_AXES][SOTER_REACH_COMMANDS];
} soter_reach_step;

typedef struct {
  soter_reach_map law;
  soter_reach_map rate; /* derivative or next */
  const int64_t* param;
  const double* low; /* ranges of all inputs; states: the domain of the enclosure */
  const double* high;
  const double* held_low; /* commands to be held in place of the law (synthesis), or null */
  const double* held_high;
  int32_t states, controls, inputs;
  int32_t is_map, is_local; /* is_local: linearised anew at every step */
  int32_t hold_steps;       /* maps: steps of the plant under one command, at least 1 */
  int32_t axes, commands;
  int32_t axis[SOTER_REACH_AXES];        /* state of each axis */
  int32_t command[SOTER_REACH_COMMANDS]; /* controls that move this group */
  int32_t cells[SOTER_REACH_AXES];
  int32_t tile[SOTER_REACH_AXES];  /* cells of a tile; at most 64 in all */
  int32_t tiles[SOTER_REACH_AXES]; /* tiles along each axis */
  int32_t words;
  const double* edges[SOTER_REACH_AXES];
  const int32_t* guess[SOTER_REACH_AXES]; /* bucket -> a cell near it */
  int32_t guesses[SOTER_REACH_AXES];
  double per_unit[SOTER_REACH_AXES]; /* buckets in a unit of the axis */
  double period, delay, jitter;      /* seconds: delta, d, j */
  /* Above 0: at each instant of a hold another command may act, that was read since `delay` before
   * the hold or up to `swept`, a hold or more, after its beginning; then j is 0. */
  double swept;
  int32_t past; /* how many commands back a read may lie under */
  double extra_w[SOTER_REACH_AXES];
  double dust[SOTER_REACH_AXES]; /* rates this wide may be 0 but for rounding */
  double scheme;                 /* seconds that the simulator's stages look ahead */
  /* Ends of the axes. 0: what lies beyond is unsafe; 1: no run passes; 2: what lies beyond belongs
   * to the last cell (soter_reach_invariant_ends.c); 3, both: the axis wraps around, where its
   * state is read modulo a full turn (soter_reach_grid.c). */
  int32_t kept_low[SOTER_REACH_AXES], kept_high[SOTER_REACH_AXES];
  soter_reach_model model;
  soter_reach_step first, later;                        /* hold 0 (period - jitter), the others */
  double reach_fwd[SOTER_REACH_AXES][SOTER_REACH_AXES]; /* dev over 2 j, or `swept` */
  double reach_bwd[SOTER_REACH_AXES][SOTER_REACH_AXES]; /* dev over d, backwards */
} soter_reach_group;

/* An enclosure along a chain of holds: m + g eps + [-box, box], within [lo, hi]. */
typedef struct {
  double m[SOTER_REACH_AXES];
  double g[SOTER_REACH_AXES][SOTER_REACH_AXES];
  double box[SOTER_REACH_AXES];
  double lo[SOTER_REACH_AXES];
  double hi[SOTER_REACH_AXES];
  uint32_t from_low, from_high; /* bit i: it began at an end of axis i that has no outer end */
  int32_t holds;
  double uc[SOTER_REACH_COMMANDS];
  double ug[SOTER_REACH_COMMANDS][SOTER_REACH_AXES];
  double ur[SOTER_REACH_COMMANDS];
  double past_lo[SOTER_REACH_PAST][SOTER_REACH_COMMANDS]; /* 0 is the last command */
  double past_hi[SOTER_REACH_PAST][SOTER_REACH_COMMANDS];
} soter_reach_chain;

/* A fixpoint under way, by rounds. `dirty` lists tiles to look at; `cursor` how far a call came. */
typedef struct {
  uint64_t* kept;    /* the set as of the last round */
  uint16_t* reaches; /* per tile: first and last tile its images touch */
  uint64_t* changed; /* per tile: cells that left (or joined) in this round */
  uint8_t* begun;    /* per tile */
  int32_t* dirty;
  int32_t* sums; /* (tiles + 1) along each axis */
  int32_t dirty_n, cursor, rounds;
  int32_t vain[2];   /* cells that were followed as far as may be, for nothing */
  int32_t vain_max;  /* with more of them the rounds end early; 0: however many there are */
  int64_t steps[2];  /* holds that were made, each counted once */
  int64_t steps_max; /* as vain_max */
} soter_reach_rounds;

/* K for the law. */
typedef struct {
  soter_reach_rounds r;
  const uint64_t* allowed; /* C */
  const uint64_t* resting; /* cells that are kept without a chain */
  const uint64_t* members; /* the cells that K may have; chains lie in C */
  uint8_t* witness;        /* per cell */
  uint16_t* image;         /* per cell: first and last cell of the witness's image, per axis */
  int32_t* slot;           /* per cell: where its chain is kept, -1: nowhere */
  uint8_t* known;          /* per tile: what soter_reach_around.c knows of its block */
  double* command;         /* per tile: the commands that act all over its block */
  soter_reach_chain* pool;
  int32_t pool_size;
  int32_t pool_used[2];
  int32_t longest, patience;
} soter_reach_work;

/* K for any of up to 64 commands, one hold each. */
typedef struct {
  soter_reach_rounds r;
  const uint64_t* allowed;
  uint64_t* fine;         /* per cell: commands that keep it */
  uint16_t* image;        /* per cell and command */
  const double* commands; /* one row of all controls each */
  int32_t count;
} soter_reach_choice;

/* The way to Q: images after some numbers of holds, ranks, times. */
typedef struct {
  soter_reach_rounds r;    /* kept: W */
  const uint64_t* allowed; /* K; runs stay in `inside` */
  const uint64_t* inside;  /* C */
  const int32_t* holds;    /* increasing, at most 250 */
  const int32_t* slot;     /* per cell of K: its row in `image`; -1: no way is wanted */
  uint16_t* image;         /* per slot and number of holds; first > last: none */
  uint16_t* rank;          /* per cell: 0 not in W, 1 Q, 2.. */
  uint8_t* taken;          /* per cell: the number of holds */
  int64_t* time;           /* per cell, ns, at most until Q */
  int64_t period_ns, jitter_ns;
  int32_t count;
  int32_t base; /* the largest rank there is to begin with, less 1 */
} soter_reach_way;

/* All runs over [0, t] under all of U, cut into segments: at every instant of a segment x is in
 * phi x(0) + [lo, hi] for some phi in [phi_lo, phi_hi]. */
typedef struct {
  double phi_lo[SOTER_REACH_AXES][SOTER_REACH_AXES];
  double phi_hi[SOTER_REACH_AXES][SOTER_REACH_AXES];
  double lo[SOTER_REACH_AXES];
  double hi[SOTER_REACH_AXES];
} soter_reach_segment;

typedef struct {
  int32_t segments;
  soter_reach_segment at[SOTER_REACH_SEGMENTS];
} soter_reach_tube;

int soter_reach_linearize(soter_reach_group* g, const double* low, const double* high);
int soter_reach_prepare(soter_reach_group* g);
int soter_reach_tube_prepare(const soter_reach_group* g, double t, int32_t segments,
                             soter_reach_tube* out);
void soter_reach_pack(const soter_reach_group* g, const uint8_t* cells, uint64_t* bits);
void soter_reach_unpack(const soter_reach_group* g, const uint64_t* bits, uint8_t* cells);
void soter_reach_core_begin(const soter_reach_group* g, soter_reach_work* w);
int soter_reach_core_continue(const soter_reach_group* g, soter_reach_work* w, double seconds,
                              int32_t threads);
void soter_reach_core_end(const soter_reach_group* g, soter_reach_work* w);
void soter_reach_choice_begin(const soter_reach_group* g, soter_reach_choice* w);
int soter_reach_choice_continue(const soter_reach_group* g, soter_reach_choice* w, double seconds,
                                int32_t threads);
void soter_reach_choice_remove(const soter_reach_group* g, soter_reach_choice* w,
                               const uint8_t* cells);
void soter_reach_way_begin(const soter_reach_group* g, soter_reach_way* w);
int soter_reach_way_continue(const soter_reach_group* g, soter_reach_way* w, double seconds,
                             int32_t threads);
int64_t soter_reach_safe(const soter_reach_group* g, const soter_reach_tube* tube, int32_t steps,
                         const uint64_t* target, const uint64_t* known, uint8_t* out,
                         int64_t first_tile, double seconds, int32_t threads);
int64_t soter_reach_truth(const soter_reach_group* g, const double* low, const double* high,
                          const void* test, uint8_t* out, int64_t first_tile, double seconds,
                          int32_t threads);
int soter_reach_run(const soter_reach_group* g, const double* low, const double* high,
                    int32_t holds, double* images, double* tubes);
void soter_reach_shrink(int64_t before, int64_t n, int64_t after, const int32_t* first,
                        const int32_t* last, int32_t grow, const uint8_t* in, uint8_t* out,
                        int32_t* scratch);

#endif
