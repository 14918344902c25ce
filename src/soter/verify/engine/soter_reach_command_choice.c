/* K for any of a finite set of commands, one hold each.
 * Purpose: which commands keep which cell, down to the greatest fixpoint.
 * Non-goals: which command an estimate gets (verify/grid/recovery.py), chains of holds. */
#include "soter_reach_internal.h"
#include "soter_reach_thread_pool.h"

#include <string.h>

typedef struct {
  const soter_reach_group* g;
  soter_reach_choice* w;
  soter_scratch scratch[SOTER_REACH_THREADS];
  soter_reach_group group[SOTER_REACH_THREADS]; /* under one command */
} choice_job;

static uint16_t* image_of(const choice_job* job, int64_t cell, int k) {
  SOTER_CHECK(cell >= 0 && k >= 0 && k < job->w->count);
  return job->w->image + 2 * job->g->axes * (cell * job->w->count + k);
}

/* One hold of command k from a box of cells: 1 where the tube lies in C and the image in the grid.
 */
static int image_under(choice_job* job, int who, const int* first, const int* last, int k,
                       uint16_t* image) {
  soter_reach_group* g = &job->group[who];
  soter_reach_chain x;
  soter_hold h;
  uint16_t tube[2 * AXES];
  g->held_low = g->held_high = job->w->commands + k * g->controls;
  soter_reach_start_at(g, first, last, &x);
  return soter_reach_hold(g, &job->scratch[who], &x, &h) &&
         soter_reach_cover(g, h.tube_lo, h.tube_hi, tube) &&
         soter_reach_inside(g, job->w->allowed, tube, 0) &&
         soter_reach_cover(g, h.image_lo, h.image_hi, image);
}

/* Notes that command k keeps every cell of the box, by one image. */
static void note_all_keep(choice_job* job, const int* first, const int* last, int k,
                          const uint16_t* image) {
  const soter_reach_group* g = job->g;
  int at[AXES];
  memcpy(at, first, sizeof at);
  do {
    const int64_t cell = soter_reach_cell(g, at);
    job->w->fine[cell] |= UINT64_C(1) << k;
    memcpy(image_of(job, cell, k), image, sizeof(uint16_t) * 2 * (size_t)g->axes);
  } while (soter_reach_next_cell(g->axes, first, last, at));
}

/* Commands among `todo` for all cells of a box at once; the rest for its halves. */
static void look_at_halves(choice_job* job, int who, int64_t tile, const int* first,
                           const int* last, uint64_t todo) {
  const soter_reach_group* g = job->g;
  soter_reach_choice* w = job->w;
  uint16_t box[2 * AXES] = {0}, image[2 * AXES];
  int mid_last[AXES], mid_first[AXES];
  const int size = soter_reach_box(g, first, last, box);
  if (!soter_reach_inside(g, w->r.kept, box, 1)) {
    return;
  }
  for (int k = 0; k < w->count; k++) {
    if ((todo >> k & 1U) != 0 && image_under(job, who, first, last, k, image) &&
        (size == 1 || soter_reach_inside(g, w->r.kept, image, 0))) {
      todo &= ~(UINT64_C(1) << k);
      soter_reach_depend(g, w->r.reaches + 2 * g->axes * tile, image);
      note_all_keep(job, first, last, k, image);
    }
  }
  if (todo == 0 || size == 1) {
    return;
  }
  soter_reach_halves(g, first, last, mid_last, mid_first);
  look_at_halves(job, who, tile, first, mid_last, todo);
  look_at_halves(job, who, tile, mid_first, last, todo);
}

/* Takes commands from a cell that keep it in the set no longer. */
static void check_commands(choice_job* job, int who, int64_t tile, int64_t cell, const int* at) {
  const soter_reach_group* g = job->g;
  soter_reach_choice* w = job->w;
  for (int k = 0; k < w->count; k++) {
    uint16_t* image = image_of(job, cell, k);
    if ((w->fine[cell] >> k & 1U) == 0 || soter_reach_inside(g, w->r.kept, image, 0)) {
      continue;
    }
    /* what was found for a larger box is looked at for this cell */
    if (!image_under(job, who, at, at, k, image) || !soter_reach_inside(g, w->r.kept, image, 0)) {
      w->fine[cell] &= ~(UINT64_C(1) << k);
    } else {
      soter_reach_depend(g, w->r.reaches + 2 * g->axes * tile, image);
    }
  }
}

static void look_at_tile(soter_crew* crew, int who, int64_t n) {
  choice_job* job = crew->job;
  const soter_reach_group* g = job->g;
  soter_reach_choice* w = job->w;
  const int64_t tile = w->r.dirty[n];
  int first[AXES] = {0, 0, 0, 0}, last[AXES] = {0, 0, 0, 0}, at[AXES], bit = 0;
  (void)soter_reach_tile(g, tile, first, last);
  if (w->r.begun[tile] == 0) {
    w->r.begun[tile] = 1;
    look_at_halves(job, who, tile, first, last,
                   w->count == 64 ? ~UINT64_C(0) : (UINT64_C(1) << w->count) - 1);
  }
  memcpy(at, first, sizeof at);
  do {
    const int64_t cell = soter_reach_cell(g, at);
    if (soter_reach_has(g, w->r.kept, at) && (w->r.changed[tile] >> bit & 1U) == 0) {
      check_commands(job, who, tile, cell, at);
      if (w->fine[cell] == 0) {
        w->r.changed[tile] |= UINT64_C(1) << bit;
      }
    }
    bit++;
  } while (soter_reach_next_cell(g->axes, first, last, at));
}

void soter_reach_choice_begin(const soter_reach_group* g, soter_reach_choice* w) {
  int64_t cells = 1;
  for (int a = 0; a < g->axes; a++) {
    cells *= g->cells[a];
  }
  memcpy(w->r.kept, w->allowed, sizeof(uint64_t) * (size_t)soter_reach_words(g));
  memset(w->fine, 0, sizeof(uint64_t) * (size_t)cells);
  soter_reach_rounds_begin(g, &w->r);
}

/* Goes on for about `seconds`; 1 when no command fails any more. */
int soter_reach_choice_continue(const soter_reach_group* g, soter_reach_choice* w, double seconds,
                                int32_t threads) {
  choice_job job = {.g = g, .w = w};
  soter_crew crew;
  int done;
  for (int t = 0; t < SOTER_REACH_THREADS; t++) {
    soter_reach_inputs(g, &job.scratch[t]);
    job.group[t] = *g;
    job.group[t].delay = 0; /* when the command was read matters to which one it is, not here */
  }
  (void)soter_crew_begin(&crew, look_at_tile, &job, seconds, threads);
  done = soter_reach_rounds_run(g, &w->r, 0, &crew);
  soter_crew_end(&crew);
  return done;
}

/* Takes cells out; the fixpoint goes on from there. */
void soter_reach_choice_remove(const soter_reach_group* g, soter_reach_choice* w,
                               const uint8_t* cells) {
  const int64_t tiles = soter_reach_tiles(g);
  int first[AXES] = {0, 0, 0, 0}, last[AXES] = {0, 0, 0, 0}, at[AXES];
  for (int64_t t = 0; t < tiles; t++) {
    int bit = 0;
    (void)soter_reach_tile(g, t, first, last);
    memcpy(at, first, sizeof at);
    do {
      if (cells[soter_reach_cell(g, at)] != 0 && soter_reach_has(g, w->r.kept, at)) {
        w->r.changed[t] |= UINT64_C(1) << bit;
        w->fine[soter_reach_cell(g, at)] = 0;
      }
      bit++;
    } while (soter_reach_next_cell(g->axes, first, last, at));
  }
  soter_reach_settle(g, &w->r, 0);
}
