/* Which cells of a tile stay in a set under all of U.
 * Purpose: tubes of linear flows from as many cells at once as there are lanes.
 * Non-goals: tiles that stay as a whole, axes without an end (soter_reach_tubes.c, which halves
 * boxes there).
 *
 * It tells of each cell what halving the tile tells. What an ancestor of a cell shows, the cell
 * shows, but for what is added for rounding: the sums of the cell's tube lie within the ancestor's,
 * for products and sums round monotonically. So where they alone, with nothing added, touch the
 * cells that fail, so does each ancestor. Where they do not, it is a tie, and nothing is told. */
#include "soter_reach_ball.h"
#include "soter_reach_lanes.h"

typedef struct {
  const soter_reach_group* g;
  const soter_reach_tube* tube;
  const uint64_t* target;
} cell_tubes;

typedef struct {
  lanes lo[AXES], hi[AXES];
} boxes;

/* Whether cells may be told of together: no axis goes on beyond an end, or around. */
int soter_reach_cells_may_stay(const soter_reach_group* g) {
  int ends = 1;
  SOTER_CHECK(g->axes >= 1 && g->axes <= AXES);
  for (int a = 0; a < g->axes; a++) {
    ends &= g->kept_low[a] != SOTER_REACH_UNBOUNDED && g->kept_high[a] != SOTER_REACH_UNBOUNDED &&
            g->kept_low[a] != SOTER_REACH_WRAPS;
  }
  return ends;
}

/* The states of a segment of the tube from `from`: the sums, and what is enclosed. As `tube_inside`
 * has it. */
ALWAYS void segment_of(int n, const soter_reach_segment* s, const boxes* from, boxes* sums,
                       boxes* all_of) {
  for (int i = 0; i < n; i++) {
    lanes low = all(s->lo[i]), high = all(s->hi[i]), sum = all(fabs(s->lo[i]) + fabs(s->hi[i]));
    SOTER_CHECK(!(s->lo[i] > s->hi[i]));
    for (int j = 0; j < n; j++) {
      const lanes a = s->phi_lo[i][j] * from->lo[j], b = s->phi_lo[i][j] * from->hi[j];
      const lanes c = s->phi_hi[i][j] * from->lo[j], d = s->phi_hi[i][j] * from->hi[j];
      const lanes p = least(least(a, b), least(c, d)), q = most(most(a, b), most(c, d));
      low += p;
      high += q;
      sum += size(p) + size(q);
    }
    sums->lo[i] = low;
    sums->hi[i] = high;
    all_of->lo[i] = low - (8 * EPS * sum + TINY);
    all_of->hi[i] = high + (8 * EPS * sum + TINY);
  }
}

static void move_segment(const cell_tubes* job, int k, const boxes* from, boxes* sums,
                         boxes* all_of) {
  const soter_reach_segment* s = &job->tube->at[k];
  SOTER_CHECK(k >= 0 && k < job->tube->segments);
  if (job->g->axes == 2) {
    segment_of(2, s, from, sums, all_of);
  } else if (job->g->axes == 3) {
    segment_of(3, s, from, sums, all_of);
  } else {
    segment_of(job->g->axes, s, from, sums, all_of);
  }
}

static void lane_of(int n, int l, const boxes* from, double* lo, double* hi) {
  SOTER_CHECK(l >= 0 && l < LANES);
  for (int i = 0; i < n; i++) {
    lo[i] = from->lo[i][l];
    hi[i] = from->hi[i][l];
  }
}

/* Whether [lo, hi], and so all that holds it, touches all cells of `box`. What is cut at an end
 * that runs keep touches the cell there still. */
static int touches(const soter_reach_group* g, const double* lo, const double* hi,
                   const uint16_t* box) {
  int each = 1;
  for (int a = 0; a < g->axes; a++) {
    const double* e = g->edges[a];
    SOTER_CHECK(!(lo[a] > hi[a]));
    each &= lo[a] < e[box[2 * a] + 1] && hi[a] > e[box[2 * a + 1]];
  }
  return each;
}

/* Whether it goes beyond an end of the grid that runs do not keep. */
static int leaves_grid(const soter_reach_group* g, const double* lo, const double* hi) {
  int out = 0;
  for (int a = 0; a < g->axes; a++) {
    const double* e = g->edges[a];
    SOTER_CHECK(!(lo[a] > hi[a]));
    out |= g->kept_low[a] == 0 && lo[a] < e[0];
    out |= g->kept_high[a] == 0 && hi[a] > e[g->cells[a]];
  }
  return out;
}

enum { LEAVES, STAYS, TIE };

/* What a lane of a segment says of its cell. */
static int verdict_of_lane(const cell_tubes* job, int l, const boxes* sums, const boxes* all_of) {
  const soter_reach_group* g = job->g;
  double lo[AXES], hi[AXES];
  uint16_t box[2 * AXES];
  SOTER_CHECK(job->target != 0);
  lane_of(g->axes, l, all_of, lo, hi);
  const int covered = soter_reach_cover(g, lo, hi, box);
  if (covered && soter_reach_inside(g, job->target, box, 0)) {
    return STAYS;
  }
  lane_of(g->axes, l, sums, lo, hi);
  return (covered ? touches(g, lo, hi, box) : leaves_grid(g, lo, hi)) ? LEAVES : TIE;
}

/* Cells that are asked about together, and where it is told of them. */
typedef struct {
  boxes from;
  uint8_t* out[LANES];
  int count;
} asked;

/* Tells of the cells of `c`, and empties it; 0: there was a tie. What leaves has mostly left at the
 * end: that is looked at first. */
static int tell_cells(const cell_tubes* job, asked* c) {
  unsigned left = (1U << c->count) - 1U;
  SOTER_CHECK(c->count >= 0 && c->count <= LANES);
  for (int k = job->tube->segments - 1; k >= 0 && left != 0; k--) {
    boxes sums, all_of;
    move_segment(job, k, &c->from, &sums, &all_of);
    for (int l = 0; l < c->count; l++) {
      const int said = left >> l & 1U ? verdict_of_lane(job, l, &sums, &all_of) : STAYS;
      if (said == TIE) {
        return 0;
      }
      left &= said == LEAVES ? ~(1U << l) : ~0U;
    }
  }
  for (int l = 0; l < c->count; l++) {
    *c->out[l] = (uint8_t)(left >> l & 1U);
  }
  c->count = 0;
  return 1;
}

static void add_cell(const soter_reach_group* g, const int* at, uint8_t* out, asked* c) {
  SOTER_CHECK(c->count < LANES);
  for (int a = 0; a < g->axes; a++) {
    c->from.lo[a][c->count] = g->edges[a][at[a]];
    c->from.hi[a][c->count] = g->edges[a][at[a] + 1];
  }
  c->out[c->count++] = out;
}

/* Tells of every cell of a tile whether each run from it stays in the target; cells of `known` are
 * not looked at. 0: a tie of rounding, and nothing is told. */
int soter_reach_cells_stay(const soter_reach_group* g, const soter_reach_tube* tube,
                           const uint64_t* target, const uint64_t* known, const int* first,
                           const int* last, uint8_t* out) {
  const cell_tubes job = {.g = g, .tube = tube, .target = target};
  const int end = g->axes - 1, wide = last[end] - first[end] + 1;
  asked c = {.count = 0};
  int at[AXES];
  memcpy(at, first, sizeof at);
  SOTER_CHECK(soter_reach_cells_may_stay(g));
  do {
    const uint64_t in = soter_reach_part(g, target, at, wide);
    const uint64_t done = in & soter_reach_part(g, known, at, wide);
    uint8_t* cells = out + soter_reach_cell(g, at);
    for (int k = 0; k < wide; k++, at[end]++) {
      cells[k] = (uint8_t)(done >> k & 1U);
      if ((in & ~done) >> k & 1U) {
        add_cell(g, at, &cells[k], &c);
        if (c.count == LANES && !tell_cells(&job, &c)) {
          return 0;
        }
      }
    }
    at[end] = first[end];
  } while (soter_reach_next_cell(end, first, last, at));
  return tell_cells(&job, &c);
}
