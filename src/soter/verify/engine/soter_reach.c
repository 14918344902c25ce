/* The core K: the greatest fixpoint, tile by tile.
 * Purpose: {c in C : some N <= longest: tube in C, image in K}; N is the witness.
 * Non-goals: tubes under all of U (soter_reach_tubes.c).
 *
 * Rounds: every tile whose images touch a cell that fell in the last round is looked at again,
 * against K as of the last round. K only shrinks, so an N that failed once has failed for good and
 * a chain goes on from where it stood. A tile whose one-hold image as a whole lies in K needs no
 * more. A chain whose images have been more than a cell away from K `patience` times in a row is
 * given up: that makes K smaller, never wrong. */
#include "soter_reach_internal.h"
#include "soter_reach_thread_pool.h"

#include <string.h>

typedef struct {
  const soter_reach_group* g;
  soter_reach_work* w;
  soter_scratch scratch[SOTER_REACH_THREADS];
  int64_t steps[SOTER_REACH_THREADS];
  int looks_around;
} core_job;

/* More than a cell away from every cell of K. */
static int remote(const soter_reach_group* g, const uint64_t* kept, const uint16_t* image) {
  uint16_t box[2 * AXES];
  for (int a = 0; a < g->axes; a++) {
    box[2 * a] = (uint16_t)(image[2 * a] > 0 ? image[2 * a] - 1 : 0);
    box[2 * a + 1] =
        (uint16_t)(image[2 * a + 1] + 1 < g->cells[a] ? image[2 * a + 1] + 1 : g->cells[a] - 1);
  }
  return !soter_reach_inside(g, kept, box, 1);
}

enum { STOPPED, HELD };

/* One hold from x, within the cells `at` (null: not told). `in_c`: the tube is known to lie in C,
 * and is not told. */
static int hold(core_job* job, int who, const uint16_t* at, soter_reach_chain* x, soter_hold* h,
                int* in_c) {
  const soter_reach_group* g = job->g;
  soter_scratch* s = &job->scratch[who];
  const int looks = at != 0 && job->looks_around;
  const double* command = looks ? soter_reach_around(g, job->w, s, at, x) : 0;
  SOTER_CHECK(x->holds >= 0);
  job->steps[who]++;
  *in_c = command != 0 && soter_reach_move(g, command, x);
  if (*in_c) {
    memcpy(h->image_lo, x->lo, sizeof x->lo);
    memcpy(h->image_hi, x->hi, sizeof x->hi);
    return HELD;
  }
  return soter_reach_hold(g, s, x, h) ? HELD : STOPPED;
}

/* One hold all of which is in C; 0: it may leave C, or nothing can be bounded. */
static int hold_in_c(core_job* job, int who, const uint16_t* at, soter_reach_chain* x,
                     soter_hold* h) {
  uint16_t tube[2 * AXES];
  int in_c;
  if (hold(job, who, at, x, h, &in_c) == STOPPED) {
    return 0;
  }
  return in_c || (soter_reach_cover(job->g, h->tube_lo, h->tube_hi, tube) &&
                  soter_reach_inside(job->g, job->w->allowed, tube, 0));
}

/* One hold; 2: the image lies in K, 1: not (yet), 0: never. `image` may be `at`. */
static int go_on(core_job* job, int who, const uint16_t* at, soter_reach_chain* x, uint16_t* image,
                 int* lost) {
  const soter_reach_group* g = job->g;
  const soter_reach_work* w = job->w;
  soter_hold h;
  if (!hold_in_c(job, who, at, x, &h)) {
    return 0;
  }
  if (!soter_reach_cover(g, h.image_lo, h.image_hi, image)) {
    return 1;
  }
  if (soter_reach_inside(g, w->r.kept, image, 0)) {
    return 2;
  }
  *lost = remote(g, w->r.kept, image) ? *lost + 1 : 0;
  return *lost >= w->patience ? 0 : 1;
}

/* Copies what a chain goes on from. */
static void copy_chain(const soter_reach_group* g, soter_reach_chain* to,
                       const soter_reach_chain* from) {
  if (g->delay > 0 || g->jitter > 0) {
    *to = *from;
  } else { /* it remembers no commands */
    soter_copy_state(to, from);
  }
}

/* The chain of a cell as it stood after its witness's holds: as it was kept, or made again.
 * `image`: cells around it. */
static int resume(core_job* job, int who, int64_t cell, const int* at, soter_reach_chain* x,
                  uint16_t* image) {
  const soter_reach_group* g = job->g;
  const soter_reach_work* w = job->w;
  soter_hold ignored;
  int in_c;
  const int n = w->witness[cell];
  if (n > 0 && w->slot[cell] >= 0) {
    SOTER_CHECK(w->slot[cell] < w->pool_size);
    copy_chain(g, x, &w->pool[w->slot[cell]]);
    return 1;
  }
  soter_reach_start_at(g, at, at, x);
  (void)soter_reach_box(g, at, at, image);
  for (int k = 0; k < n; k++) {
    if (hold(job, who, image, x, &ignored, &in_c) == STOPPED) {
      return 0;
    }
    (void)soter_reach_cover(g, x->lo, x->hi, image);
  }
  return 1;
}

/* Keeps the chain of a cell, while there is room: each thread has a half of it. */
static void put_away(const soter_reach_group* g, soter_reach_work* w, int who, int64_t cell,
                     const soter_reach_chain* x) {
  const int half = w->pool_size / SOTER_REACH_THREADS;
  if (w->slot[cell] < 0 && w->pool_used[who] < half) {
    w->slot[cell] = who * half + w->pool_used[who]++;
  }
  if (w->slot[cell] >= 0) {
    SOTER_CHECK(w->slot[cell] < w->pool_size);
    copy_chain(g, &w->pool[w->slot[cell]], x);
  }
}

/* The witness of a cell, from where its chain stood; 0: there is none. */
static uint8_t witness(core_job* job, int who, int64_t cell, const int* at, uint16_t* image) {
  const soter_reach_group* g = job->g;
  soter_reach_work* w = job->w;
  soter_reach_chain x;
  int lost = 0, found = 1, n = w->witness[cell];
  if (n > 0 && w->patience <= 1 && remote(g, w->r.kept, image)) {
    return 0;
  }
  if (!resume(job, who, cell, at, &x, image)) {
    return 0;
  }
  while (found == 1 && n < w->longest) {
    n++;
    found = go_on(job, who, image, &x, image, &lost);
  }
  if (found != 2) {
    return 0;
  }
  if (n > 1 && n < w->longest) {
    put_away(g, w, who, cell, &x);
  }
  SOTER_CHECK(n >= 1 && n <= UINT8_MAX);
  return (uint8_t)n;
}

static void by_cells(core_job* job, int who, int64_t tile, const int* first, const int* last) {
  const soter_reach_group* g = job->g;
  soter_reach_work* w = job->w;
  int at[AXES], bit = 0;
  memcpy(at, first, sizeof at);
  do {
    const int64_t cell = soter_reach_cell(g, at);
    uint16_t* image = w->image + 2 * g->axes * cell;
    if (soter_reach_has(g, w->r.kept, at) && (w->r.changed[tile] >> bit & 1U) == 0) {
      if (w->witness[cell] == 0 || !soter_reach_inside(g, w->r.kept, image, 0)) {
        w->witness[cell] = witness(job, who, cell, at, image);
        if (w->witness[cell] == 0) {
          w->r.changed[tile] |= UINT64_C(1) << bit;
        } else {
          soter_reach_depend(g, w->r.reaches + 2 * g->axes * tile, image);
        }
      }
    }
    bit++;
  } while (soter_reach_next_cell(g->axes, first, last, at));
}

/* Tries a part of a tile as one box; halves it where that fails. */
static void by_halves(core_job* job, int who, int64_t tile, const int* first, const int* last) {
  const soter_reach_group* g = job->g;
  soter_reach_work* w = job->w;
  soter_reach_chain x;
  uint16_t image[2 * AXES] = {0}, box[2 * AXES] = {0};
  int lost = 0, mid_last[AXES], mid_first[AXES];
  const int size = soter_reach_box(g, first, last, box);
  if (!soter_reach_inside(g, w->r.kept, box, 1)) {
    return;
  }
  if (size > 1 && soter_reach_inside(g, w->r.kept, box, 0)) {
    soter_reach_start_at(g, first, last, &x);
    if (go_on(job, who, 0, &x, image, &lost) == 2) {
      int at[AXES];
      memcpy(at, first, sizeof at);
      soter_reach_depend(g, w->r.reaches + 2 * g->axes * tile, image);
      do {
        const int64_t cell = soter_reach_cell(g, at);
        w->witness[cell] = 1;
        memcpy(w->image + 2 * g->axes * cell, image, sizeof(uint16_t) * 2 * (size_t)g->axes);
      } while (soter_reach_next_cell(g->axes, first, last, at));
      return;
    }
  }
  if (size <= 4) {
    return; /* cell by cell, afterwards */
  }
  soter_reach_halves(g, first, last, mid_last, mid_first);
  by_halves(job, who, tile, first, mid_last);
  by_halves(job, who, tile, mid_first, last);
}

static void look(soter_crew* crew, int who, int64_t k) {
  core_job* job = crew->job;
  const soter_reach_group* g = job->g;
  soter_reach_work* w = job->w;
  const int64_t tile = w->r.dirty[k];
  int first[AXES] = {0, 0, 0, 0}, last[AXES] = {0, 0, 0, 0};
  (void)soter_reach_tile(g, tile, first, last);
  if (w->r.begun[tile] == 0) {
    w->r.begun[tile] = 1;
    by_halves(job, who, tile, first, last);
  }
  by_cells(job, who, tile, first, last);
}

/* Everything begins in K = C and is looked at once. */
void soter_reach_core_begin(const soter_reach_group* g, soter_reach_work* w) {
  int64_t cells = 1;
  for (int a = 0; a < g->axes; a++) {
    cells *= g->cells[a];
  }
  memcpy(w->r.kept, w->allowed, sizeof(uint64_t) * (size_t)soter_reach_words(g));
  memset(w->witness, 0, (size_t)cells);
  memset(w->slot, 0xff, sizeof(int32_t) * (size_t)cells);
  memset(w->known, 0, (size_t)soter_reach_tiles(g));
  w->pool_used[0] = w->pool_used[1] = 0;
  soter_reach_rounds_begin(g, &w->r);
}

/* Goes on for about `seconds`; 1 when it is the fixpoint. */
int soter_reach_core_continue(const soter_reach_group* g, soter_reach_work* w, double seconds,
                              int32_t threads) {
  core_job job = {.g = g, .w = w, .looks_around = soter_reach_may_look_around(g)};
  soter_crew crew;
  int done;
  soter_reach_inputs(g, &job.scratch[0]);
  soter_reach_inputs(g, &job.scratch[1]);
  (void)soter_crew_begin(&crew, look, &job, seconds, threads);
  done = soter_reach_rounds_run(g, &w->r, 0, &crew);
  soter_crew_end(&crew);
  w->r.steps += job.steps[0] + job.steps[1];
  return done;
}

/* Witnesses of what is left; 0 elsewhere. */
void soter_reach_core_end(const soter_reach_group* g, soter_reach_work* w) {
  int64_t rows = 1;
  const int n = g->cells[g->axes - 1];
  for (int a = 0; a + 1 < g->axes; a++) {
    rows *= g->cells[a];
  }
  for (int64_t r = 0; r < rows; r++) {
    for (int b = 0; b < n; b++) {
      if ((w->r.kept[r * g->words + (b >> 6)] >> (b & 63) & 1U) == 0) {
        w->witness[r * n + b] = 0;
      }
    }
  }
}
