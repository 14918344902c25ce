/* Tubes under all of U, and predicates over cells.
 * Purpose: R(t), S_j (through soter_reach_shrink), three-valued truth of every cell.
 * Non-goals: the law (soter_reach.c). */
#include "soter_reach_internal.h"
#include "soter_reach_thread_pool.h"

#include <string.h>

typedef struct {
  const soter_reach_group* g;
  const soter_reach_tube* tube;
  const uint64_t* target;
  const uint64_t* known; /* cells of which it is known already */
  soter_reach_test test;
  uint8_t* out;
  int32_t steps;
  int by_cells;
  soter_scratch scratch[SOTER_REACH_THREADS];
} cell_job;

typedef int (*box_test)(cell_job* job, int who, const int* first, const int* last);

static void edges_of(const soter_reach_group* g, const int* first, const int* last, double* lo,
                     double* hi) {
  for (int a = 0; a < g->axes; a++) {
    SOTER_CHECK(0 <= first[a] && first[a] <= last[a] && last[a] < g->cells[a]);
    lo[a] = g->edges[a][first[a]];
    hi[a] = g->edges[a][last[a] + 1];
  }
}

/* The same where cells at ends that have no outer end go on. */
static void range_of_states(const soter_reach_group* g, const int* first, const int* last,
                            double* lo, double* hi) {
  unsigned low, high;
  edges_of(g, first, last, lo, hi);
  low = soter_reach_at_low(g, lo);
  high = soter_reach_at_high(g, hi);
  for (int a = 0; a < g->axes; a++) {
    lo[a] = low >> a & 1U ? -FARTHEST : lo[a];
    hi[a] = high >> a & 1U ? FARTHEST : hi[a];
  }
}

/* Writes a value for every cell of a box. */
static void fill_cells(cell_job* job, const int* first, const int* last, uint8_t value) {
  const soter_reach_group* g = job->g;
  int at[AXES], a = 0;
  memcpy(at, first, sizeof at);
  while (a >= 0) {
    int64_t cell = 0;
    for (int i = 0; i < g->axes; i++) {
      cell = cell * g->cells[i] + at[i];
    }
    SOTER_CHECK(cell >= 0 && last[g->axes - 1] < g->cells[g->axes - 1]);
    memset(job->out + cell, value, (size_t)(last[g->axes - 1] - first[g->axes - 1] + 1));
    for (a = g->axes - 2; a >= 0 && at[a] == last[a]; a--) {
      at[a] = first[a];
    }
    if (a >= 0) {
      at[a]++;
    }
  }
}

enum { FEW = 16 };

/* The test on a box; where it does not decide, on its halves. A predicate of several groups is
 * often undecided on every cell, so that few cells are not worth halving. */
static void test_halves(cell_job* job, int who, box_test test, const int* first, const int* last) {
  int widest = 0, size = 1, mid_last[AXES], mid_first[AXES];
  const int value = test(job, who, first, last);
  SOTER_CHECK(value >= 0 && (job->test == 0 || (value & 3) != 0)); /* true or false at least */
  for (int a = 0; a < job->g->axes; a++) {
    widest = last[a] - first[a] > last[widest] - first[widest] ? a : widest;
  }
  if ((value & 8) == 0 || last[widest] == first[widest]) {
    fill_cells(job, first, last, (uint8_t)(value & 7));
    return;
  }
  for (int a = 0; a < job->g->axes; a++) {
    size *= last[a] - first[a] + 1;
  }
  if (job->test != 0 && size <= FEW) {
    int at[AXES];
    memcpy(at, first, sizeof at);
    do {
      fill_cells(job, at, at, (uint8_t)(test(job, who, at, at) & 7));
    } while (soter_reach_next_cell(job->g->axes, first, last, at));
    return;
  }
  soter_reach_halves(job->g, first, last, mid_last, mid_first);
  test_halves(job, who, test, first, mid_last);
  test_halves(job, who, test, mid_first, last);
}

/* Every instant of every run from the box lies in the target (linear flows). What leaves it has
 * mostly left it at the end: that is looked at first. */
static int tube_inside(const cell_job* job, const double* lo, const double* hi) {
  const soter_reach_group* g = job->g;
  const int n = g->axes;
  uint16_t box[2 * AXES];
  for (int k = job->tube->segments - 1; k >= 0; k--) {
    const soter_reach_segment* s = &job->tube->at[k];
    double low[AXES], high[AXES];
    for (int i = 0; i < n; i++) {
      double size = fabs(s->lo[i]) + fabs(s->hi[i]);
      low[i] = s->lo[i];
      high[i] = s->hi[i];
      for (int j = 0; j < n; j++) {
        const double a = s->phi_lo[i][j] * lo[j], b = s->phi_lo[i][j] * hi[j];
        const double c = s->phi_hi[i][j] * lo[j], d = s->phi_hi[i][j] * hi[j];
        const double least = soter_least(soter_least(a, b), soter_least(c, d));
        const double most = soter_most(soter_most(a, b), soter_most(c, d));
        low[i] += least;
        high[i] += most;
        size += fabs(least) + fabs(most);
      }
      SOTER_CHECK(!(low[i] > high[i]) && !(size < 0));
      low[i] -= 8 * EPS * size + TINY;
      high[i] += 8 * EPS * size + TINY;
    }
    soter_reach_to_ends(g, soter_reach_at_low(g, lo), soter_reach_at_high(g, hi), low, high);
    if (!soter_reach_cover(g, low, high, box) || !soter_reach_inside(g, job->target, box, 0)) {
      return 0;
    }
  }
  return 1;
}

/* The same step by step: maps (each state lies in the target), and flows linearised on the way. */
static int walk_inside(const cell_job* job, int who, const double* lo, const double* hi) {
  const soter_reach_group* g = job->g;
  soter_scratch* s = (soter_scratch*)&job->scratch[who];
  soter_reach_group held = *g;
  soter_reach_chain x;
  soter_hold h;
  uint16_t box[2 * AXES];
  held.held_low = g->low + g->states; /* any command of U, and any other one at the next step */
  held.held_high = g->high + g->states;
  held.delay = held.jitter = held.swept = 0;
  SOTER_CHECK(job->steps >= 1 && job->tube == 0);
  held.hold_steps = 1;
  soter_reach_start(g, lo, hi, &x);
  if (!soter_reach_cover(g, x.lo, x.hi, box) || !soter_reach_inside(g, job->target, box, 0)) {
    return 0;
  }
  for (int32_t k = 0; k < job->steps; k++) {
    if (!soter_reach_hold(&held, s, &x, &h) || !soter_reach_cover(g, h.tube_lo, h.tube_hi, box) ||
        !soter_reach_inside(g, job->target, box, 0) ||
        !soter_reach_cover(g, h.image_lo, h.image_hi, box) ||
        !soter_reach_inside(g, job->target, box, 0)) {
      return 0;
    }
  }
  return 1;
}

static int safe_box(cell_job* job, int who, const int* first, const int* last) {
  const soter_reach_group* g = job->g;
  uint16_t box[2 * AXES];
  double lo[AXES], hi[AXES];
  for (int a = 0; a < g->axes; a++) {
    box[2 * a] = (uint16_t)first[a];
    box[2 * a + 1] = (uint16_t)last[a];
  }
  SOTER_CHECK(job->test == 0);
  if (!soter_reach_inside(g, job->target, box, 0)) {
    return soter_reach_inside(g, job->target, box, 1) ? 8 : 0;
  }
  if (soter_reach_inside(g, job->known, box, 0)) {
    return 1;
  }
  edges_of(g, first, last, lo, hi);
  if (job->tube != 0 ? tube_inside(job, lo, hi) : walk_inside(job, who, lo, hi)) {
    return 1;
  }
  return 8;
}

static int truth_box(cell_job* job, int who, const int* first, const int* last) {
  const soter_reach_group* g = job->g;
  soter_scratch* s = &job->scratch[who];
  soter_truth answer[1] = {3};
  double lo[AXES], hi[AXES];
  range_of_states(g, first, last, lo, hi);
  SOTER_CHECK(0 <= who && who < SOTER_REACH_THREADS);
  for (int a = 0; a < g->axes; a++) {
    soter_range(&s->in[g->axis[a]], g->axis[a], lo[a], hi[a]);
  }
  if (job->test(s->in, g->param, answer)) {
    return 8 | 4 | 3; /* a step fault is possible */
  }
  SOTER_CHECK(answer[0] >= 1 && answer[0] <= 3);
  return answer[0] == 3 ? 8 | 3 : answer[0] & 3;
}

/* A tile by what is told of all of it, or of each cell; 0: neither. */
static int tell_whole_tile(cell_job* job, int who, const int* first, const int* last) {
  const int value = safe_box(job, who, first, last);
  SOTER_CHECK(job->by_cells && job->tube != 0);
  if ((value & 8) == 0) {
    fill_cells(job, first, last, (uint8_t)value);
    return 1;
  }
  return soter_reach_cells_stay(job->g, job->tube, job->target, job->known, first, last, job->out);
}

static void safe_tile(soter_crew* crew, int who, int64_t tile) {
  cell_job* job = crew->job;
  int first[AXES] = {0, 0, 0, 0}, last[AXES] = {0, 0, 0, 0};
  (void)soter_reach_tile(job->g, tile, first, last);
  if (job->by_cells && tell_whole_tile(job, who, first, last)) {
    return;
  }
  test_halves(job, who, job->test != 0 ? truth_box : safe_box, first, last);
}

static int64_t run_over_tiles(cell_job* job, int64_t first_tile, double seconds, int32_t threads) {
  soter_crew crew;
  int64_t tiles = 1, done;
  for (int a = 0; a < job->g->axes; a++) {
    tiles *= job->g->tiles[a];
  }
  (void)soter_crew_begin(&crew, safe_tile, job, seconds, threads);
  done = soter_crew_run(&crew, first_tile, tiles);
  soter_crew_end(&crew);
  SOTER_CHECK(done >= first_tile || first_tile >= tiles);
  return done;
}

/* out[cell] = 1: every run from the cell under U stays in the target. `tube` for globally linear
 * flows; else `steps` steps of the period. Cells of `known` are 1 without a look. From `first_tile`
 * on; returns the first tile not done. */
int64_t soter_reach_safe(const soter_reach_group* g, const soter_reach_tube* tube, int32_t steps,
                         const uint64_t* target, const uint64_t* known, uint8_t* out,
                         int64_t first_tile, double seconds, int32_t threads) {
  cell_job job = {
      .g = g, .tube = tube, .target = target, .known = known, .out = out, .steps = steps};
  job.by_cells = tube != 0 && soter_reach_cells_may_stay(g);
  soter_reach_inputs(g, &job.scratch[0]);
  soter_reach_inputs(g, &job.scratch[1]);
  return run_over_tiles(&job, first_tile, seconds, threads);
}

/* out[cell]: truth (bit 0 may be false, bit 1 may be true, bit 2 may fault) of a predicate over the
 * cell, the other inputs over [low, high]. */
int64_t soter_reach_truth(const soter_reach_group* g, const double* low, const double* high,
                          const void* test, uint8_t* out, int64_t first_tile, double seconds,
                          int32_t threads) {
  cell_job job = {.g = g, .out = out};
  memcpy(&job.test, &test, sizeof job.test);
  for (int t = 0; t < SOTER_REACH_THREADS; t++) {
    for (int i = 0; i < SOTER_INPUTS; i++) {
      soter_set(&job.scratch[t].in[i], i, low[i], high[i]);
    }
  }
  return run_over_tiles(&job, first_tile, seconds, threads);
}

/* Images and tubes of `holds` holds from a box, for tests: [hold][axis][lo, hi].
 * Returns how many could be bounded. */
int soter_reach_run(const soter_reach_group* g, const double* low, const double* high,
                    int32_t holds, double* images, double* tubes) {
  soter_scratch s;
  soter_reach_chain x;
  soter_hold h;
  soter_reach_inputs(g, &s);
  soter_reach_start(g, low, high, &x);
  for (int k = 0; k < holds; k++) {
    if (!soter_reach_hold(g, &s, &x, &h)) {
      return k;
    }
    for (int i = 0; i < g->axes; i++) {
      images[2 * (k * g->axes + i)] = h.image_lo[i];
      images[2 * (k * g->axes + i) + 1] = h.image_hi[i];
      tubes[2 * (k * g->axes + i)] = h.tube_lo[i];
      tubes[2 * (k * g->axes + i) + 1] = h.tube_hi[i];
    }
  }
  return holds;
}
