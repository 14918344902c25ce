/* What the soter_reach_*.c share.
 * Purpose: declare boxes, holds and sets of cells for them.
 * Non-goals: what Python asks for (soter_reach.h). */
#ifndef SOTER_REACH_INTERNAL_H
#define SOTER_REACH_INTERNAL_H

#include "soter_check.h"
#include "soter_reach.h"
#include "soter_reach_thread_pool.h"

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

enum { AXES = SOTER_REACH_AXES, COMMANDS = SOTER_REACH_COMMANDS };

/* Beyond this no number is looked at where an axis has no end. */
#define FARTHEST 0x1p1000

#define EPS 2.220446049250313e-16
#define TINY 1e-300

typedef struct {
  soter_form in[SOTER_INPUTS];
  soter_form out[SOTER_INPUTS];
  double command[COMMANDS]; /* of soter_reach_around */
} soter_scratch;

/* The first word of the row of a set that a cell lies in; `at` counts the axes but the last. */
static inline int64_t soter_reach_row(const soter_reach_group* g, const int* at) {
  int64_t row = 0;
  for (int a = 0; a + 1 < g->axes; a++) {
    row = row * g->cells[a] + at[a];
  }
  return row * g->words;
}

/* At least one unit in the last place outward: beyond what x was rounded from, see
 * soter_reach_ball.h (1). */
static inline double soter_up(double x) {
  return x + (fabs(x) * EPS + TINY);
}

static inline double soter_down(double x) {
  return x - (fabs(x) * EPS + TINY);
}

/* [lo, hi] within c + [-r, r]: any c will do, r is measured from it. */
static inline void soter_centre(double lo, double hi, double* c, double* r) {
  SOTER_CHECK(!(lo > hi));
  *c = lo == hi ? lo : lo / 2 + hi / 2;
  *r = lo == hi ? 0 : soter_up(soter_most(hi - *c, *c - lo));
}

/* g / rad within u of it; 0: there is no such slope, or the quotient underflows. */
static inline double soter_slope(double g, double rad) {
  const double slope = rad > 0 ? g / rad : 0;
  return fabs(slope) >= DBL_MIN ? slope : 0;
}

/* Makes `f` the variable of input i over [lo, hi]; the g of other inputs must be 0 already. */
static inline void soter_range(soter_form* f, int i, double lo, double hi) {
  SOTER_CHECK(i >= 0 && i < SOTER_INPUTS);
  f->lo = lo;
  f->hi = hi;
  f->r = 0;
  soter_centre(lo, hi, &f->c, &f->g[i]);
}

static inline void soter_set(soter_form* f, int i, double lo, double hi) {
  for (int k = 0; k < SOTER_INPUTS; k++) {
    f->g[k] = 0;
  }
  soter_range(f, i, lo, hi);
}

/* Cuts an enclosure of a run that began in the grid, along one axis: see
 * soter_reach_invariant_ends.c. */
static inline void soter_reach_keep_axis(const soter_reach_group* g, int axis, double* lo,
                                         double* hi) {
  const double low = g->edges[axis][0], high = g->edges[axis][g->cells[axis]];
  if (g->kept_low[axis] == SOTER_REACH_KEPT && *lo < low && *hi >= low) {
    *lo = low;
  }
  if (g->kept_high[axis] == SOTER_REACH_KEPT && *hi > high && *lo <= high) {
    *hi = high;
  }
}

/* `from` without its commands. */
static inline void soter_copy_state(soter_reach_chain* to, const soter_reach_chain* from) {
  memcpy(to, from, offsetof(soter_reach_chain, uc));
}

typedef struct {
  double tube_lo[AXES], tube_hi[AXES];   /* every instant of the hold */
  double image_lo[AXES], image_hi[AXES]; /* every instant at which the next hold may begin */
} soter_hold;

/* How many boxes move at once. */
#if defined(__AVX512F__)
enum { LANES = 8 };
#elif defined(__AVX__)
enum { LANES = 4 };
#else
enum { LANES = 2 };
#endif

/* A chain, what is held while it moves on, and where its tube and image go (null: nowhere). */
typedef struct {
  soter_reach_chain* x;
  const double* command;
  soter_hold* out;
} soter_reach_mover;

/* What is known around a box: nothing, its command, and that it stays in C under it. */
enum { SOTER_REACH_NOTHING, SOTER_REACH_COMMAND, SOTER_REACH_IN_C };

int soter_reach_cover(const soter_reach_group* g, const double* lo, const double* hi,
                      uint16_t* image);
int soter_reach_inside(const soter_reach_group* g, const uint64_t* bits, const uint16_t* box,
                       int any);
int64_t soter_reach_tile(const soter_reach_group* g, int64_t tile, int* first, int* last);
int64_t soter_reach_tiles(const soter_reach_group* g);
int64_t soter_reach_cell(const soter_reach_group* g, const int* at);
int64_t soter_reach_words(const soter_reach_group* g);
int soter_reach_next_cell(int n, const int* first, const int* last, int* at);
int soter_reach_has(const soter_reach_group* g, const uint64_t* bits, const int* at);
uint64_t soter_reach_part(const soter_reach_group* g, const uint64_t* bits, const int* at,
                          int wide);
void soter_reach_start_at(const soter_reach_group* g, const int* first, const int* last,
                          soter_reach_chain* x);
void soter_reach_depend(const soter_reach_group* g, uint16_t* reaches, const uint16_t* image);
void soter_reach_halves(const soter_reach_group* g, const int* first, const int* last,
                        int mid_last[AXES], int mid_first[AXES]);
int soter_reach_box(const soter_reach_group* g, const int* first, const int* last, uint16_t* box);
void soter_reach_rounds_begin(const soter_reach_group* g, soter_reach_rounds* r);
void soter_reach_settle(const soter_reach_group* g, soter_reach_rounds* w, int join);
int soter_reach_rounds_run(const soter_reach_group* g, soter_reach_rounds* r, int join,
                           soter_crew* crew);
int soter_reach_make_step(const soter_reach_group* g, const soter_reach_model* m, double h,
                          double early, soter_reach_step* out);
int soter_reach_dev(const soter_reach_group* g, const soter_reach_model* m, double h, int backwards,
                    double dev[AXES][AXES]);
int soter_reach_model_of(const soter_reach_group* g, soter_scratch* s, soter_reach_model* m);
void soter_reach_keep(const soter_reach_group* g, double* lo, double* hi);
void soter_reach_to_ends(const soter_reach_group* g, unsigned from_low, unsigned from_high,
                         double* lo, double* hi);
unsigned soter_reach_at_low(const soter_reach_group* g, const double* lo);
unsigned soter_reach_at_high(const soter_reach_group* g, const double* hi);
void soter_reach_stands(const soter_reach_group* g, soter_scratch* s, const double* lo,
                        const double* hi, const double* rate, const double* ulo, const double* uhi,
                        unsigned* rises, unsigned* falls);
void soter_reach_inputs(const soter_reach_group* g, soter_scratch* s);
void soter_reach_start(const soter_reach_group* g, const double* lo, const double* hi,
                       soter_reach_chain* x);
int soter_reach_hold(const soter_reach_group* g, soter_scratch* s, soter_reach_chain* x,
                     soter_hold* out);
unsigned soter_reach_move(const soter_reach_group* g, int count, const soter_reach_mover* movers);
int soter_reach_cells_may_stay(const soter_reach_group* g);
int soter_reach_cells_stay(const soter_reach_group* g, const soter_reach_tube* tube,
                           const uint64_t* target, const uint64_t* known, const int* first,
                           const int* last, uint8_t* out);
int soter_reach_may_look_around(const soter_reach_group* g);
int soter_reach_around(const soter_reach_group* g, const soter_reach_work* w, soter_scratch* s,
                       const uint16_t* at, const soter_reach_chain* x, const double** command);

#endif
