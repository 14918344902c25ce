/* From K to Q under the law: ranks, numbers of holds, longest time.
 * Purpose: W_(k+1) = W_k and {c in K: for some N the tube lies in C, the image in W_k}. That
 * control comes back is argued in docs/proof-sets.md, "P2b: control comes back".
 * Non-goals: what Q is. */
#include "soter_reach_internal.h"
#include "soter_reach_thread_pool.h"

#include <string.h>

typedef struct {
  const soter_reach_group* g;
  soter_reach_way* w;
  soter_scratch scratch[SOTER_REACH_THREADS];
} way_job;

/* Holds until `until` are done; 0: the tube leaves C. */
static int hold_until(way_job* job, int who, int* held, int until, soter_reach_chain* x,
                      soter_hold* h) {
  const soter_reach_group* g = job->g;
  uint16_t tube[2 * AXES];
  SOTER_CHECK(*held < until);
  for (; *held < until; (*held)++) {
    job->w->r.steps[who]++;
    if (!soter_reach_hold(g, &job->scratch[who], x, h) ||
        !soter_reach_cover(g, h->tube_lo, h->tube_hi, tube) ||
        !soter_reach_inside(g, job->w->inside, tube, 0)) {
      return 0;
    }
  }
  return 1;
}

/* Images of a cell that lie in K, as long as the tube lies in C. */
static void find_images(way_job* job, int who, const int* at, uint16_t* image, uint16_t* reaches) {
  const soter_reach_group* g = job->g;
  const soter_reach_way* w = job->w;
  soter_reach_chain x;
  soter_hold h;
  int held = 0;
  for (int k = 0; k < w->count; k++) {
    image[2 * g->axes * k] = UINT16_MAX;
    image[2 * g->axes * k + 1] = 0;
  }
  soter_reach_start_at(g, at, at, &x);
  for (int k = 0; k < w->count; k++) {
    if (!hold_until(job, who, &held, w->holds[k], &x, &h)) {
      return;
    }
    uint16_t box[2 * AXES];
    if (soter_reach_cover(g, h.image_lo, h.image_hi, box) &&
        soter_reach_inside(g, w->allowed, box, 0)) {
      memcpy(image + 2 * g->axes * k, box, sizeof(uint16_t) * 2 * (size_t)g->axes);
      soter_reach_depend(g, reaches, box);
      if (w->r.rounds == 0 && w->base == 0 && soter_reach_inside(g, w->r.kept, box, 0)) {
        return; /* in Q: nothing is sooner */
      }
    }
  }
}

/* The longest time from the cells of an image. */
static int64_t longest_time_from(const way_job* job, const uint16_t* image) {
  const soter_reach_group* g = job->g;
  int first[AXES] = {0, 0, 0, 0}, last[AXES] = {0, 0, 0, 0}, at[AXES], in[AXES];
  int64_t most = 0;
  for (int a = 0; a < g->axes; a++) {
    first[a] = image[2 * a];
    last[a] = image[2 * a + 1];
  }
  memcpy(at, first, sizeof at);
  SOTER_CHECK(first[0] <= last[0]);
  do {
    for (int a = 0; a < g->axes; a++) {
      in[a] = at[a] < g->cells[a] ? at[a] : at[a] - g->cells[a];
    }
    const int64_t t = job->w->time[soter_reach_cell(g, in)];
    most = t > most ? t : most;
  } while (soter_reach_next_cell(g->axes, first, last, at));
  return most;
}

/* The least of the longest times from a cell, over the numbers of holds whose image lies in W; the
 * number is `taken`. INT64_MAX: there is none. */
static int64_t soonest_time_from(way_job* job, int who, int64_t cell, const int* at, int fresh,
                                 uint16_t* reaches) {
  const soter_reach_group* g = job->g;
  soter_reach_way* w = job->w;
  uint16_t* image = w->image + (int64_t)2 * g->axes * w->count * w->slot[cell];
  int64_t best = INT64_MAX;
  if (fresh) {
    find_images(job, who, at, image, reaches);
  }
  for (int k = 0; k < w->count; k++) {
    const uint16_t* to = image + 2 * g->axes * k;
    if (to[0] <= to[1] && soter_reach_inside(g, w->r.kept, to, 0)) {
      const int64_t t = longest_time_from(job, to) + w->holds[k] * w->period_ns + w->jitter_ns;
      if (t < best) {
        best = t;
        w->taken[cell] = (uint8_t)w->holds[k];
      }
    }
  }
  SOTER_CHECK(best >= 0);
  return best;
}

/* Looks at a tile: cells from which some number of holds leads into W join it. */
static void look_at_tile(soter_crew* crew, int who, int64_t n) {
  way_job* job = crew->job;
  const soter_reach_group* g = job->g;
  soter_reach_way* w = job->w;
  const int64_t tile = w->r.dirty[n];
  uint16_t* reaches = w->r.reaches + 2 * g->axes * tile;
  int first[AXES] = {0, 0, 0, 0}, last[AXES] = {0, 0, 0, 0}, at[AXES], bit = 0;
  const int fresh = w->r.begun[tile] == 0;
  int64_t joined[64];
  for (int i = 0; i < 64; i++) {
    joined[i] = -1;
  }
  (void)soter_reach_tile(g, tile, first, last);
  memcpy(at, first, sizeof at);
  do {
    const int64_t cell = soter_reach_cell(g, at);
    if (w->rank[cell] == 0 && w->slot[cell] >= 0 && (w->r.changed[tile] >> bit & 1U) == 0) {
      const int64_t best = soonest_time_from(job, who, cell, at, fresh, reaches);
      if (best < INT64_MAX && w->base + w->r.rounds < UINT16_MAX - 2) {
        /* `rank` stays 0 for the others of this round: they read `kept`, and times there */
        joined[bit] = best;
        w->r.changed[tile] |= UINT64_C(1) << bit;
      }
    }
    bit++;
  } while (soter_reach_next_cell(g->axes, first, last, at));
  w->r.begun[tile] = 1;
  memcpy(at, first, sizeof at);
  bit = 0;
  do {
    if (joined[bit] >= 0) {
      const int64_t cell = soter_reach_cell(g, at);
      w->rank[cell] = (uint16_t)(w->base + w->r.rounds + 2);
      w->time[cell] = joined[bit];
    }
    bit++;
  } while (soter_reach_next_cell(g->axes, first, last, at));
}

/* kept, rank and time hold Q (or an earlier W) to begin with. */
void soter_reach_way_begin(const soter_reach_group* g, soter_reach_way* w) {
  soter_reach_rounds_begin(g, &w->r);
}

/* Goes on for about `seconds`; 1 when no cell joins any more. */
int soter_reach_way_continue(const soter_reach_group* g, soter_reach_way* w, double seconds,
                             int32_t threads) {
  way_job job = {.g = g, .w = w};
  soter_crew crew;
  int done;
  soter_reach_inputs(g, &job.scratch[0]);
  soter_reach_inputs(g, &job.scratch[1]);
  (void)soter_crew_begin(&crew, look_at_tile, &job, seconds, threads);
  done = soter_reach_rounds_run(g, &w->r, 1, &crew);
  soter_crew_end(&crew);
  return done;
}
