/* The core K: the greatest fixpoint, tile by tile.
 * Purpose: {c in C : some N <= longest: tube in C, image in K}; N is the witness.
 * That it is a core is argued in docs/proof-sets.md, "Chains" and "Late commands".
 * Non-goals: tubes under all of U (soter_reach_tubes.c).
 *
 * Rounds: every tile whose images touch a cell that fell in the last round is looked at again,
 * against K as of the last round. K only shrinks, so an N that failed once has failed for good and
 * a chain goes on from where it stood. A tile whose one-hold image as a whole lies in K needs no
 * more. A chain whose images have been more than a cell away from K `patience` times in a row is
 * given up: that makes K smaller, never wrong.
 *
 * Chains of up to LANES cells of a tile make a hold together; those that are done make room for the
 * next. What comes of a cell does not depend on which others are looked at with it. */
#include "soter_reach_internal.h"
#include "soter_reach_thread_pool.h"

#include <string.h>

typedef struct {
  const soter_reach_group* g;
  soter_reach_work* w;
  soter_scratch scratch[SOTER_REACH_THREADS];
  int looks_around;
} core_job;

/* More than a cell away from every cell of K. */
static int is_remote(const soter_reach_group* g, const uint64_t* kept, const uint16_t* image) {
  uint16_t box[2 * AXES];
  for (int a = 0; a < g->axes; a++) {
    const int n = g->cells[a], last = image[2 * a + 1];
    const int around = g->kept_low[a] == SOTER_REACH_WRAPS && (image[2 * a] == 0 || last + 1 >= n);
    box[2 * a] = (uint16_t)(around || image[2 * a] == 0 ? 0 : image[2 * a] - 1);
    box[2 * a + 1] = (uint16_t)(around || last + 1 >= n ? n - 1 : last + 1);
  }
  return !soter_reach_inside(g, kept, box, 1);
}

/* A chain on its way to a witness. */
typedef struct {
  soter_reach_chain x;
  uint16_t* image; /* cells around it, and in the end the witness's image */
  int64_t cell;
  int bit;      /* of the cell in its tile */
  int n, again; /* holds that were looked at, and those of them that are to be made again */
  int lost;
  int moved, in_c; /* its hold is made; its tube is known to lie in C, and `h` is not told */
  soter_hold h;
} cell_chain;

/* Chains of a tile that are held together: the first `count` of `going`. */
typedef struct {
  cell_chain at[LANES];
  cell_chain* going[LANES];
  int64_t tile;
  int count;
} chain_batch;

static void start_batch(chain_batch* c, int64_t tile) {
  SOTER_CHECK(tile >= 0);
  for (int k = 0; k < LANES; k++) {
    c->going[k] = &c->at[k];
  }
  c->tile = tile;
  c->count = 0;
}

enum { NEVER, NOT_YET, FOUND };

/* Says whether an image lies in K; it was reached with all before it in C. */
static int judge_image(const core_job* job, const double* lo, const double* hi, uint16_t* image,
                       int* lost) {
  const soter_reach_group* g = job->g;
  const soter_reach_work* w = job->w;
  SOTER_CHECK(*lost >= 0);
  if (!soter_reach_cover(g, lo, hi, image)) {
    return NOT_YET;
  }
  if (soter_reach_inside(g, w->r.kept, image, 0)) {
    return FOUND;
  }
  *lost = is_remote(g, w->r.kept, image) ? *lost + 1 : 0;
  return *lost >= w->patience ? NEVER : NOT_YET;
}

/* Whether the tube of a hold lies in C. */
static int tube_is_in_c(const core_job* job, const soter_hold* h) {
  uint16_t tube[2 * AXES];
  SOTER_CHECK(job->w->allowed != 0);
  return soter_reach_cover(job->g, h->tube_lo, h->tube_hi, tube) &&
         soter_reach_inside(job->g, job->w->allowed, tube, 0);
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

/* Whether a chain is kept of the cell, as it stood after its witness's holds; `x` is that one, or
 * the cell. */
static int resume_chain(const soter_reach_group* g, const soter_reach_work* w, int64_t cell,
                        const int* at, soter_reach_chain* x) {
  if (w->witness[cell] > 0 && w->slot[cell] >= 0) {
    SOTER_CHECK(w->slot[cell] < w->pool_size);
    copy_chain(g, x, &w->pool[w->slot[cell]]);
    return 1;
  }
  soter_reach_start_at(g, at, at, x);
  return 0;
}

/* Keeps the chain of a cell, while there is room: each thread has a half of it. */
static void put_chain_away(const soter_reach_group* g, soter_reach_work* w, int who, int64_t cell,
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

/* The cell of a chain leaves K at the end of the round. */
static void drop_cell(soter_reach_work* w, int64_t tile, const cell_chain* k) {
  SOTER_CHECK(k->bit >= 0 && k->bit < 64);
  w->witness[k->cell] = 0;
  w->r.changed[tile] |= UINT64_C(1) << k->bit;
}

/* A witness was found for the cell of a chain, or none ever will be. */
static void end_chain(core_job* job, int who, int64_t tile, const cell_chain* k, int found) {
  soter_reach_work* w = job->w;
  if (found != FOUND) {
    drop_cell(w, tile, k);
    return;
  }
  if (k->n > 1 && k->n < w->longest) {
    put_chain_away(job->g, w, who, k->cell, &k->x);
  }
  SOTER_CHECK(k->n >= 1 && k->n <= UINT8_MAX);
  w->witness[k->cell] = (uint8_t)k->n;
  soter_reach_depend(job->g, w->r.reaches + 2 * job->g->axes * tile, k->image);
}

/* Starts a chain where that of its cell stood, or from the cell; 0: it has gone too far. */
static int start_chain(const core_job* job, int64_t cell, const int* at, cell_chain* k) {
  const soter_reach_work* w = job->w;
  k->lost = k->again = 0;
  k->n = w->witness[cell];
  k->image = w->image + 2 * job->g->axes * cell;
  SOTER_CHECK(k->n <= w->longest);
  if (k->n >= w->longest) {
    return 0;
  }
  if (!resume_chain(job->g, w, cell, at, &k->x)) {
    (void)soter_reach_box(job->g, at, at, k->image);
    k->again = k->n;
  }
  return 1;
}

/* What comes of a hold of a chain, which it made or is to make. What is made again was looked at
 * before. */
static int continue_chain(core_job* job, int who, cell_chain* k) {
  int found;
  if (!k->moved && !soter_reach_hold(job->g, &job->scratch[who], &k->x, &k->h)) {
    return NEVER;
  }
  SOTER_CHECK(k->again >= 0 && k->n < job->w->longest);
  if (k->again > 0) {
    k->again--;
    job->w->r.steps[who]--; /* it depends on threads which chains are kept */
    (void)soter_reach_cover(job->g, k->x.lo, k->x.hi, k->image);
    return NOT_YET;
  }
  k->n++;
  if (k->in_c) {
    found = judge_image(job, k->x.lo, k->x.hi, k->image, &k->lost);
  } else if (tube_is_in_c(job, &k->h)) {
    found = judge_image(job, k->h.image_lo, k->h.image_hi, k->image, &k->lost);
  } else {
    return NEVER;
  }
  if (found == NOT_YET && k->n == job->w->longest) {
    job->w->r.vain[who]++;
    return NEVER;
  }
  return found;
}

/* Asks for the commands around the chains, and moves those on for which they are known. */
static void move_together(core_job* job, int who, chain_batch* c) {
  double command[LANES][COMMANDS];
  soter_reach_mover movers[LANES];
  cell_chain* of[LANES];
  int count = 0;
  SOTER_CHECK(job->looks_around && c->count <= LANES);
  for (int k = 0; k < c->count; k++) {
    cell_chain* one = c->going[k];
    const double* u = 0;
    const int known =
        soter_reach_around(job->g, job->w, &job->scratch[who], one->image, &one->x, &u);
    one->in_c = known == SOTER_REACH_IN_C;
    if (known != SOTER_REACH_NOTHING) { /* it may be told in scratch */
      memcpy(command[count], u, sizeof(double) * (size_t)job->g->commands);
      movers[count].x = &one->x;
      movers[count].command = command[count];
      movers[count].out = one->in_c ? 0 : &one->h;
      of[count++] = one;
    }
  }
  if (count > 0) {
    const unsigned moved = soter_reach_move(job->g, count, movers);
    for (int k = 0; k < count; k++) {
      of[k]->moved = (int)(moved >> k & 1U);
      of[k]->in_c = of[k]->in_c && of[k]->moved;
    }
  }
}

/* One hold of every chain of a batch. */
static void hold_batch(core_job* job, int who, chain_batch* c) {
  for (int k = 0; k < c->count; k++) {
    c->going[k]->moved = c->going[k]->in_c = 0;
  }
  if (job->looks_around) {
    move_together(job, who, c);
  }
  job->w->r.steps[who] += c->count;
  for (int k = c->count - 1; k >= 0; k--) {
    cell_chain* one = c->going[k];
    const int found = continue_chain(job, who, one);
    if (found != NOT_YET) {
      end_chain(job, who, c->tile, one, found);
      c->going[k] = c->going[--c->count];
      c->going[c->count] = one;
    }
  }
  SOTER_CHECK(c->count >= 0 && c->count <= LANES);
}

/* What K says of an image. Cells that went as one box have the same one. */
typedef struct {
  uint16_t image[2 * AXES];
  int inside; /* -1: not asked */
} last_answer;

static inline int same_image(int n, const uint16_t* a, const uint16_t* b) {
  int same = 1;
  SOTER_CHECK(n >= 1 && n <= AXES);
  for (int k = 0; k < 2 * n; k++) {
    same &= a[k] == b[k];
  }
  return same;
}

static void remember_answer(const soter_reach_group* g, const uint64_t* kept, const uint16_t* image,
                            last_answer* s) {
  SOTER_CHECK(image[0] <= image[1]);
  if (s->inside < 0 || !same_image(g->axes, s->image, image)) {
    memcpy(s->image, image, sizeof(uint16_t) * 2 * (size_t)g->axes);
    s->inside = soter_reach_inside(g, kept, image, 0);
  }
}

/* Whether the chain of a cell is given up where its witness's image lies. */
static int is_given_up(const core_job* job, int64_t cell) {
  const soter_reach_work* w = job->w;
  SOTER_CHECK(cell >= 0);
  return w->patience <= 1 && w->witness[cell] > 0 &&
         is_remote(job->g, w->r.kept, w->image + 2 * job->g->axes * cell);
}

/* A cell of K is looked at: its witness serves still, it falls, or a chain starts from it. */
static void look_at_cell(core_job* job, int64_t cell, const int* at, int bit, last_answer* s,
                         chain_batch* c) {
  const soter_reach_group* g = job->g;
  const soter_reach_work* w = job->w;
  cell_chain* one = c->going[c->count];
  SOTER_CHECK(c->count < LANES && bit < 64);
  if (w->witness[cell] > 0) {
    remember_answer(g, w->r.kept, w->image + 2 * g->axes * cell, s);
    if (s->inside) {
      return;
    }
  }
  one->cell = cell;
  one->bit = bit;
  if (is_given_up(job, cell) || !start_chain(job, cell, at, one)) {
    drop_cell(job->w, c->tile, one);
  } else {
    c->count++;
  }
}

static void look_at_cells(core_job* job, int who, int64_t tile, const int* first, const int* last) {
  const soter_reach_group* g = job->g;
  const soter_reach_work* w = job->w;
  const int end = g->axes - 1, begin = first[end], wide = last[end] - begin + 1;
  chain_batch c;
  last_answer s = {.inside = -1};
  int at[AXES], bit = 0;
  memcpy(at, first, sizeof at);
  start_batch(&c, tile);
  do {
    const int64_t cell = soter_reach_cell(g, at);
    uint64_t here = soter_reach_part(g, w->r.kept, at, wide) & ~(w->r.changed[tile] >> bit);
    here &= ~soter_reach_part(g, w->resting, at, wide);
    for (; here != 0; here &= here - 1) {
      const int k = __builtin_ctzll(here);
      at[end] = begin + k;
      look_at_cell(job, cell + k, at, bit + k, &s, &c);
      while (c.count == LANES) {
        hold_batch(job, who, &c);
      }
    }
    at[end] = begin;
    bit += wide;
  } while (soter_reach_next_cell(end, first, last, at));
  while (c.count > 0) {
    hold_batch(job, who, &c);
  }
  SOTER_CHECK(bit <= 64);
}

/* Whether a box as a whole is back in K after one hold. */
static int box_returns_in_one_hold(core_job* job, int who, const int* first, const int* last,
                                   uint16_t* image) {
  soter_reach_chain x;
  soter_hold h;
  soter_reach_start_at(job->g, first, last, &x);
  SOTER_CHECK(x.holds == 0);
  job->w->r.steps[who]++;
  return soter_reach_hold(job->g, &job->scratch[who], &x, &h) && tube_is_in_c(job, &h) &&
         soter_reach_cover(job->g, h.image_lo, h.image_hi, image) &&
         soter_reach_inside(job->g, job->w->r.kept, image, 0);
}

/* Tries a part of a tile as one box; halves it where that fails. */
static void look_at_halves(core_job* job, int who, int64_t tile, const int* first,
                           const int* last) {
  const soter_reach_group* g = job->g;
  soter_reach_work* w = job->w;
  uint16_t image[2 * AXES] = {0}, box[2 * AXES] = {0};
  int mid_last[AXES], mid_first[AXES];
  const int size = soter_reach_box(g, first, last, box);
  if (!soter_reach_inside(g, w->r.kept, box, 1)) {
    return;
  }
  if (size > 1 && soter_reach_inside(g, w->r.kept, box, 0)) {
    if (box_returns_in_one_hold(job, who, first, last, image)) {
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
  look_at_halves(job, who, tile, first, mid_last);
  look_at_halves(job, who, tile, mid_first, last);
}

/* Looks at a tile that may mind what fell, box by box or cell by cell. */
static void look_at_tile(soter_crew* crew, int who, int64_t k) {
  core_job* job = crew->job;
  const soter_reach_group* g = job->g;
  soter_reach_work* w = job->w;
  const int64_t tile = w->r.dirty[k];
  int first[AXES] = {0, 0, 0, 0}, last[AXES] = {0, 0, 0, 0};
  (void)soter_reach_tile(g, tile, first, last);
  if (w->r.begun[tile] == 0) {
    w->r.begun[tile] = 1;
    look_at_halves(job, who, tile, first, last);
  }
  look_at_cells(job, who, tile, first, last);
}

/* Every cell that may be in K begins there and is looked at once. */
void soter_reach_core_begin(const soter_reach_group* g, soter_reach_work* w) {
  int64_t cells = 1;
  for (int a = 0; a < g->axes; a++) {
    cells *= g->cells[a];
  }
  memcpy(w->r.kept, w->members, sizeof(uint64_t) * (size_t)soter_reach_words(g));
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
  (void)soter_crew_begin(&crew, look_at_tile, &job, seconds, threads);
  done = soter_reach_rounds_run(g, &w->r, 0, &crew);
  soter_crew_end(&crew);
  return done;
}

/* Witnesses of what is left; 0 elsewhere. */
void soter_reach_core_end(const soter_reach_group* g, soter_reach_work* w) {
  const int64_t rows = soter_reach_words(g) / g->words;
  const int n = g->cells[g->axes - 1];
  for (int64_t r = 0; r < rows; r++) {
    for (int b = 0; b < n; b++) {
      if ((w->r.kept[r * g->words + (b >> 6)] >> (b & 63) & 1U) == 0) {
        w->witness[r * n + b] = 0;
      }
    }
  }
}
