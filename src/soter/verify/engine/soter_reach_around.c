/* What the law gives around a tile.
 * Purpose: from a block of tiles on all of which the law gives one command a hold of a box does not
 * need the law, and where no run leaves C from it while that is held, its tube neither.
 * Non-goals: the hold (soter_reach_hold.c), boxes that no block holds.
 *
 * A block is a tile and the next one along every axis. Both facts are of each state of the block
 * and of each run from it, with everything else anywhere in its range: so they are facts of every
 * box within. Only of linear flows, without delay or jitter: else the law read another state, or an
 * earlier command may act. C is the same as long as a core is looked for, so that what is known of
 * a block stays true for that long. */
#include "soter_reach_ball.h"

enum { UNKNOWN, ASKED, ANSWERED };

/* Whether blocks are any use: of a law, where each hold is as any other. */
int soter_reach_may_look_around(const soter_reach_group* g) {
  const int as_any_other = g->delay <= 0 && g->jitter <= 0;
  int bounded = 1;
  SOTER_CHECK(!(g->delay < 0) && !(g->jitter < 0));
  for (int a = 0; a < g->axes; a++) {
    const int32_t low = g->kept_low[a], high = g->kept_high[a];
    bounded &= low != SOTER_REACH_UNBOUNDED && high != SOTER_REACH_UNBOUNDED;
  }
  return bounded && as_any_other && !g->is_map && !g->is_local && g->held_low == 0;
}

/* The first and last cell of the block of cell `at`; gives its tile. */
static inline int64_t block_of(const soter_reach_group* g, const uint16_t* at, int* first,
                               int* last) {
  int64_t tile = 0;
  for (int a = 0; a < g->axes; a++) {
    const int along = at[2 * a] / g->tile[a], end = (along + 2) * g->tile[a];
    SOTER_CHECK(at[2 * a] < g->cells[a]);
    tile = tile * g->tiles[a] + along;
    first[a] = along * g->tile[a];
    last[a] = (end < g->cells[a] ? end : g->cells[a]) - 1;
  }
  return tile;
}

/* Whether an end that runs keep cut more than dust from x along an axis. Its motion goes on from
 * all of it: what is enclosed of this hold may stick out of what is enclosed of the block. */
static inline int was_cut(const soter_reach_group* g, int axis, const soter_reach_chain* x) {
  const double low = g->edges[axis][0], high = g->edges[axis][g->cells[axis]];
  const double dust = (high - low) * 0x1p-40;
  double rad = x->box[axis];
  SOTER_CHECK(low < high);
  for (int j = 0; j < g->axes; j++) {
    rad += fabs(x->g[axis][j]);
  }
  return (g->kept_low[axis] == SOTER_REACH_KEPT && x->m[axis] - rad < low - dust) ||
         (g->kept_high[axis] == SOTER_REACH_KEPT && x->m[axis] + rad > high + dust);
}

static inline int holds_box(const soter_reach_group* g, const int* first, const int* last,
                            const soter_reach_chain* x) {
  for (int a = 0; a < g->axes; a++) {
    SOTER_CHECK(first[a] <= last[a]);
    if (!(g->edges[a][first[a]] <= x->lo[a] && x->hi[a] <= g->edges[a][last[a] + 1]) ||
        was_cut(g, a, x)) {
      return 0;
    }
  }
  return 1;
}

/* Whether the law gives the same number for every state of x, whatever the other inputs are. */
static int has_one_command(const soter_reach_group* g, soter_scratch* s, const soter_reach_chain* x,
                           double* command) {
  static const double none[AXES] = {0, 0, 0, 0};
  line u[COMMANDS];
  SOTER_CHECK(g->held_low == 0 && g->delay <= 0 && g->jitter <= 0);
  if (!read_law(g->axes, g->commands, g, s, x, none, none, u)) {
    return 0;
  }
  for (int a = 0; a < g->commands; a++) {
    if (u[a].lo != u[a].hi) {
      return 0;
    }
    command[a] = u[a].lo;
  }
  return 1;
}

/* Finds what is known of a block. */
static int find_command(const soter_reach_group* g, const uint64_t* allowed, soter_scratch* s,
                        const int* first, const int* last, double* command) {
  soter_reach_chain x;
  soter_hold h;
  uint16_t tube[2 * AXES];
  soter_reach_start_at(g, first, last, &x);
  SOTER_CHECK(x.from_low == 0 && x.from_high == 0);
  if (!has_one_command(g, s, &x, command)) {
    return SOTER_REACH_NOTHING;
  }
  return soter_reach_hold(g, s, &x, &h) && soter_reach_cover(g, h.tube_lo, h.tube_hi, tube) &&
                 soter_reach_inside(g, allowed, tube, 0)
             ? SOTER_REACH_IN_C
             : SOTER_REACH_COMMAND;
}

/* What is known around x: that the law gives one `command` all over a block that holds its box, and
 * that no run leaves C from there in one hold. `at`: cells around x. While another thread asks,
 * this one asks for itself: what a hold gives never depends on who came first. */
int soter_reach_around(const soter_reach_group* g, const soter_reach_work* w, soter_scratch* s,
                       const uint16_t* at, const soter_reach_chain* x, const double** command) {
  int first[AXES] = {0, 0, 0, 0}, last[AXES] = {0, 0, 0, 0}, answer;
  const int64_t tile = block_of(g, at, first, last);
  double* here = w->command + tile * g->commands;
  uint8_t known = __atomic_load_n(&w->known[tile], __ATOMIC_ACQUIRE), unknown = UNKNOWN;
  SOTER_CHECK(tile >= 0 && tile < soter_reach_tiles(g));
  if (!holds_box(g, first, last, x)) {
    return SOTER_REACH_NOTHING;
  }
  *command = here;
  if (known >= ANSWERED) {
    return known - ANSWERED;
  }
  const int to_tell = __atomic_compare_exchange_n(&w->known[tile], &unknown, ASKED, 0,
                                                  __ATOMIC_ACQUIRE, __ATOMIC_ACQUIRE);
  answer = find_command(g, w->allowed, s, first, last, s->command);
  if (to_tell) {
    memcpy(here, s->command, sizeof(double) * (size_t)g->commands);
    __atomic_store_n(&w->known[tile], (uint8_t)(ANSWERED + answer), __ATOMIC_RELEASE);
  }
  *command = s->command;
  return answer;
}
