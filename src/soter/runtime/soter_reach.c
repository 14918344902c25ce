/* The core K: the greatest fixpoint, tile by tile.
 * Purpose: {c in C : some N <= longest: tube in C, image in K}; N is the witness.
 * Non-goals: tubes under all of U (soter_reach_safe.c).
 *
 * Rounds: every tile whose images touch a cell that fell in the last round is looked at again,
 * against K as of the last round. K only shrinks, so an N that failed once has failed for good and a
 * chain goes on from where it stood. A tile whose one-hold image as a whole lies in K needs no
 * more. A chain whose images have been more than a cell away from K `patience` times in a row is
 * given up: that makes K smaller, never wrong. */
#include "soter_reach_in.h"
#include "soter_reach_pool.h"

#include <string.h>

typedef struct {
  const soter_reach_group *g;
  soter_reach_work *w;
  soter_scratch scratch[SOTER_REACH_THREADS];
  int64_t steps[SOTER_REACH_THREADS];
} core_job;

/* First and last cell of a tile along each axis; how many cells it has. */
int64_t soter_reach_tile(const soter_reach_group *g, int64_t tile, int *first, int *last) {
  int64_t cells = 1;
  for (int a = g->axes - 1; a >= 0; a--) {
    const int at = (int)(tile % g->tiles[a]);
    tile /= g->tiles[a];
    first[a] = at * g->tile[a];
    last[a] = first[a] + g->tile[a] - 1;
    if (last[a] >= g->cells[a]) {
      last[a] = g->cells[a] - 1;
    }
    cells *= last[a] - first[a] + 1;
  }
  return cells;
}

static int64_t tiles_of(const soter_reach_group *g) {
  int64_t n = 1;
  for (int a = 0; a < g->axes; a++) {
    n *= g->tiles[a];
  }
  return n;
}

static int64_t cell_of(const soter_reach_group *g, const int *at) {
  int64_t c = 0;
  for (int a = 0; a < g->axes; a++) {
    c = c * g->cells[a] + at[a];
  }
  return c;
}

static int next_cell(int n, const int *first, const int *last, int *at) {
  int a = n - 1;
  while (a >= 0 && at[a] == last[a]) {
    at[a] = first[a];
    a--;
  }
  if (a < 0) {
    return 0;
  }
  at[a]++;
  return 1;
}

static int has(const soter_reach_group *g, const uint64_t *bits, const int *at) {
  uint16_t box[2 * AXES];
  for (int a = 0; a < g->axes; a++) {
    box[2 * a] = box[2 * a + 1] = (uint16_t)at[a];
  }
  return soter_reach_inside(g, bits, box, 0);
}

static void start_at(const soter_reach_group *g, const int *first, const int *last,
                     soter_reach_chain *x) {
  double lo[AXES], hi[AXES];
  for (int a = 0; a < g->axes; a++) {
    lo[a] = g->edges[a][first[a]];
    hi[a] = g->edges[a][last[a] + 1];
  }
  soter_reach_start(g, lo, hi, x);
}

static void depend(const soter_reach_group *g, uint16_t *reaches, const uint16_t *image) {
  for (int a = 0; a < g->axes; a++) {
    const uint16_t lo = (uint16_t)(image[2 * a] / g->tile[a]);
    const uint16_t hi = (uint16_t)(image[2 * a + 1] / g->tile[a]);
    reaches[2 * a] = lo < reaches[2 * a] ? lo : reaches[2 * a];
    reaches[2 * a + 1] = hi > reaches[2 * a + 1] ? hi : reaches[2 * a + 1];
  }
}

/* More than a cell away from every cell of K. */
static int remote(const soter_reach_group *g, const uint64_t *kept, const uint16_t *image) {
  uint16_t box[2 * AXES];
  for (int a = 0; a < g->axes; a++) {
    box[2 * a] = (uint16_t)(image[2 * a] > 0 ? image[2 * a] - 1 : 0);
    box[2 * a + 1] =
        (uint16_t)(image[2 * a + 1] + 1 < g->cells[a] ? image[2 * a + 1] + 1 : g->cells[a] - 1);
  }
  return !soter_reach_inside(g, kept, box, 1);
}

/* One hold; 2: the image lies in K, 1: not (yet), 0: never. */
static int go_on(const soter_reach_group *g, const soter_reach_work *w, soter_scratch *s,
                 soter_reach_chain *x, uint16_t *image, int *lost) {
  soter_hold h;
  uint16_t tube[2 * AXES];
  if (!soter_reach_hold(g, s, x, &h) || !soter_reach_cover(g, h.tube_lo, h.tube_hi, tube) ||
      !soter_reach_inside(g, w->allowed, tube, 0)) {
    return 0;
  }
  if (!soter_reach_cover(g, h.image_lo, h.image_hi, image)) {
    return 1;
  }
  if (soter_reach_inside(g, w->kept, image, 0)) {
    return 2;
  }
  *lost = remote(g, w->kept, image) ? *lost + 1 : 0;
  return *lost >= w->patience ? 0 : 1;
}

/* The witness of a cell, from where its chain stood; 0: there is none. */
static uint8_t witness(core_job *job, int who, int64_t cell, const int *at, uint16_t *image) {
  const soter_reach_group *g = job->g;
  soter_reach_work *w = job->w;
  soter_reach_chain x;
  soter_hold ignored;
  int lost = 0, found = 1, n = w->witness[cell];
  if (n > 0 && w->slot[cell] >= 0) {
    x = w->pool[w->slot[cell]];
  } else {
    start_at(g, at, at, &x);
    for (int k = 0; k < n; k++) {
      job->steps[who]++;
      if (!soter_reach_hold(g, &job->scratch[who], &x, &ignored)) {
        return 0;
      }
    }
  }
  while (found == 1 && n < w->longest) {
    n++;
    job->steps[who]++;
    found = go_on(g, w, &job->scratch[who], &x, image, &lost);
  }
  if (found != 2) {
    return 0;
  }
  if (n > 1 && n < w->longest) {
    const int half = w->pool_size / SOTER_REACH_THREADS;
    if (w->slot[cell] < 0 && w->pool_used[who] < half) {
      w->slot[cell] = who * half + w->pool_used[who]++;
    }
    if (w->slot[cell] >= 0) {
      w->pool[w->slot[cell]] = x;
    }
  }
  return (uint8_t)n;
}

static void by_cells(core_job *job, int who, int64_t tile, const int *first, const int *last) {
  const soter_reach_group *g = job->g;
  soter_reach_work *w = job->w;
  int at[AXES], bit = 0;
  memcpy(at, first, sizeof at);
  do {
    const int64_t cell = cell_of(g, at);
    uint16_t *image = w->image + 2 * g->axes * cell;
    if (has(g, w->kept, at) && (w->gone[tile] >> bit & 1U) == 0) {
      if (w->witness[cell] == 0 || !soter_reach_inside(g, w->kept, image, 0)) {
        w->witness[cell] = witness(job, who, cell, at, image);
        if (w->witness[cell] == 0) {
          w->gone[tile] |= UINT64_C(1) << bit;
        } else {
          depend(g, w->reaches + 2 * g->axes * tile, image);
        }
      }
    }
    bit++;
  } while (next_cell(g->axes, first, last, at));
}

/* Tries a part of a tile as one box; halves it where that fails. */
static void by_halves(core_job *job, int who, int64_t tile, const int *first, const int *last) {
  const soter_reach_group *g = job->g;
  soter_reach_work *w = job->w;
  soter_reach_chain x;
  uint16_t image[2 * AXES] = {0}, box[2 * AXES] = {0};
  int widest = 0, lost = 0, size = 1, mid_last[AXES], mid_first[AXES];
  for (int a = 0; a < g->axes; a++) {
    box[2 * a] = (uint16_t)first[a];
    box[2 * a + 1] = (uint16_t)last[a];
    size *= last[a] - first[a] + 1;
    widest = last[a] - first[a] > last[widest] - first[widest] ? a : widest;
  }
  if (!soter_reach_inside(g, w->kept, box, 1)) {
    return;
  }
  if (size > 1 && soter_reach_inside(g, w->kept, box, 0)) {
    start_at(g, first, last, &x);
    job->steps[who]++;
    if (go_on(g, w, &job->scratch[who], &x, image, &lost) == 2) {
      int at[AXES];
      memcpy(at, first, sizeof at);
      depend(g, w->reaches + 2 * g->axes * tile, image);
      do {
        const int64_t cell = cell_of(g, at);
        w->witness[cell] = 1;
        memcpy(w->image + 2 * g->axes * cell, image, sizeof(uint16_t) * 2 * (size_t)g->axes);
      } while (next_cell(g->axes, first, last, at));
      return;
    }
  }
  if (size <= 4) {
    return; /* cell by cell, afterwards */
  }
  memcpy(mid_last, last, sizeof mid_last);
  memcpy(mid_first, first, sizeof mid_first);
  mid_last[widest] = first[widest] + (last[widest] - first[widest]) / 2;
  mid_first[widest] = mid_last[widest] + 1;
  by_halves(job, who, tile, first, mid_last);
  by_halves(job, who, tile, mid_first, last);
}

static void look(soter_crew *crew, int who, int64_t k) {
  core_job *job = crew->job;
  const soter_reach_group *g = job->g;
  soter_reach_work *w = job->w;
  const int64_t tile = w->dirty[k];
  uint16_t *reaches = w->reaches + 2 * g->axes * tile;
  int first[AXES] = {0, 0, 0, 0}, last[AXES] = {0, 0, 0, 0};
  (void)soter_reach_tile(g, tile, first, last);
  if (w->whole[tile] == 0) {
    w->whole[tile] = 1;
    for (int a = 0; a < g->axes; a++) {
      reaches[2 * a] = UINT16_MAX;
      reaches[2 * a + 1] = 0;
    }
    by_halves(job, who, tile, first, last);
  }
  by_cells(job, who, tile, first, last);
}

/* Takes the cells that fell out of K, and lists the tiles that may mind. */
static void settle(const soter_reach_group *g, soter_reach_work *w) {
  const int64_t tiles = tiles_of(g);
  int64_t fell = 0, stride[AXES], sums = 1;
  int first[AXES] = {0, 0, 0, 0}, last[AXES] = {0, 0, 0, 0};
  for (int a = g->axes - 1; a >= 0; a--) {
    stride[a] = sums;
    sums *= g->tiles[a] + 1;
  }
  memset(w->sums, 0, sizeof(int32_t) * (size_t)sums);
  for (int64_t t = 0; t < tiles; t++) {
    if (w->gone[t] != 0) {
      int bit = 0, in[AXES];
      int64_t where = 0, left = t;
      fell++;
      (void)soter_reach_tile(g, t, first, last);
      memcpy(in, first, sizeof in);
      do {
        if (w->gone[t] >> bit & 1U) {
          int64_t row = 0;
          for (int a = 0; a + 1 < g->axes; a++) {
            row = row * g->cells[a] + in[a];
          }
          w->kept[row * g->words + (in[g->axes - 1] >> 6)] &=
              ~(UINT64_C(1) << (in[g->axes - 1] & 63));
        }
        bit++;
      } while (next_cell(g->axes, first, last, in));
      w->gone[t] = 0;
      for (int a = g->axes - 1; a >= 0; a--) {
        where += stride[a] * (left % g->tiles[a] + 1);
        left /= g->tiles[a];
      }
      w->sums[where] = 1;
    }
  }
  w->dirty_n = 0;
  w->cursor = 0;
  if (fell == 0) {
    return;
  }
  for (int a = 0; a < g->axes; a++) { /* sums along each axis in turn */
    for (int64_t i = stride[a]; i < sums; i++) {
      if (i / stride[a] % (g->tiles[a] + 1) != 0) {
        w->sums[i] += w->sums[i - stride[a]];
      }
    }
  }
  for (int64_t t = 0; t < tiles; t++) {
    const uint16_t *r = w->reaches + 2 * g->axes * t;
    int64_t count = 0;
    if (r[0] > r[1]) {
      continue;
    }
    for (int corner = 0; corner < 1 << g->axes; corner++) {
      int64_t where = 0;
      int sign = 1;
      for (int a = 0; a < g->axes; a++) {
        const int low = corner >> a & 1;
        where += stride[a] * (low ? r[2 * a] : r[2 * a + 1] + 1);
        sign = low ? -sign : sign;
      }
      count += sign * w->sums[where];
    }
    if (count > 0) {
      w->dirty[w->dirty_n++] = (int32_t)t;
    }
  }
}

/* Everything begins in K = C and is looked at once. */
void soter_reach_core_begin(const soter_reach_group *g, soter_reach_work *w) {
  const int64_t tiles = tiles_of(g);
  int64_t rows = 1, cells = 1;
  for (int a = 0; a + 1 < g->axes; a++) {
    rows *= g->cells[a];
  }
  cells = rows * g->cells[g->axes - 1];
  memcpy(w->kept, w->allowed, sizeof(uint64_t) * (size_t)(rows * g->words));
  memset(w->witness, 0, (size_t)cells);
  memset(w->slot, 0xff, sizeof(int32_t) * (size_t)cells);
  memset(w->whole, 0, (size_t)tiles);
  memset(w->gone, 0, sizeof(uint64_t) * (size_t)tiles);
  for (int64_t t = 0; t < tiles; t++) {
    w->dirty[t] = (int32_t)t;
  }
  w->dirty_n = (int32_t)tiles;
  w->cursor = w->rounds = 0;
  w->pool_used[0] = w->pool_used[1] = 0;
  w->steps = 0;
}

/* Goes on for about `seconds`; 1 when it is the fixpoint. */
int soter_reach_core_continue(const soter_reach_group *g, soter_reach_work *w, double seconds,
                              int32_t threads) {
  core_job job = {.g = g, .w = w};
  soter_crew crew;
  soter_reach_inputs(g, &job.scratch[0]);
  soter_reach_inputs(g, &job.scratch[1]);
  (void)soter_crew_begin(&crew, look, &job, seconds, threads);
  while (w->dirty_n > 0) {
    w->cursor = (int32_t)soter_crew_run(&crew, w->cursor, w->dirty_n);
    if (w->cursor < w->dirty_n) {
      break;
    }
    settle(g, w);
    w->rounds++;
  }
  soter_crew_end(&crew);
  w->steps += job.steps[0] + job.steps[1];
  return w->dirty_n == 0;
}

/* Witnesses of what is left; 0 elsewhere. */
void soter_reach_core_end(const soter_reach_group *g, soter_reach_work *w) {
  int64_t rows = 1;
  const int n = g->cells[g->axes - 1];
  for (int a = 0; a + 1 < g->axes; a++) {
    rows *= g->cells[a];
  }
  for (int64_t r = 0; r < rows; r++) {
    for (int b = 0; b < n; b++) {
      if ((w->kept[r * g->words + (b >> 6)] >> (b & 63) & 1U) == 0) {
        w->witness[r * n + b] = 0;
      }
    }
  }
}
