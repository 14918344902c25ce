/* Rounds over the tiles of a grid, until a set of cells changes no more.
 * Purpose: number tiles and cells; take the cells that changed out of the set, or into it; list the
 * tiles whose images touch one that changed.
 * Non-goals: which cells change (soter_reach.c, soter_reach_recovery.c). */
#include "soter_reach_ball.h"
#include "soter_reach_thread_pool.h"

#include <string.h>

/* First and last cell of a tile along each axis; how many cells it has. */
int64_t soter_reach_tile(const soter_reach_group* g, int64_t tile, int* first, int* last) {
  int64_t cells = 1;
  SOTER_CHECK(tile >= 0 && tile < soter_reach_tiles(g));
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
  SOTER_CHECK(cells >= 1 && cells <= 64);
  return cells;
}

int64_t soter_reach_tiles(const soter_reach_group* g) {
  int64_t n = 1;
  for (int a = 0; a < g->axes; a++) {
    n *= g->tiles[a];
  }
  return n;
}

int64_t soter_reach_cell(const soter_reach_group* g, const int* at) {
  int64_t c = 0;
  for (int a = 0; a < g->axes; a++) {
    SOTER_CHECK(at[a] >= 0 && at[a] < g->cells[a]);
    c = c * g->cells[a] + at[a];
  }
  return c;
}

int soter_reach_next_cell(int n, const int* first, const int* last, int* at) {
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

int soter_reach_has(const soter_reach_group* g, const uint64_t* bits, const int* at) {
  const int last = at[g->axes - 1];
  return (int)(bits[soter_reach_row(g, at) + (last >> 6)] >> (last & 63) & 1U);
}

/* `wide` cells from `at` on along the last axis, which lie in one word. */
uint64_t soter_reach_part(const soter_reach_group* g, const uint64_t* bits, const int* at,
                          int wide) {
  const int begin = at[g->axes - 1], from = begin & 63;
  SOTER_CHECK(wide >= 1 && from + wide <= 64);
  return bits[soter_reach_row(g, at) + (begin >> 6)] >> from & ~UINT64_C(0) >> (64 - wide);
}

void soter_reach_start_at(const soter_reach_group* g, const int* first, const int* last,
                          soter_reach_chain* x) {
  double lo[AXES], hi[AXES];
  for (int a = 0; a < g->axes; a++) {
    lo[a] = g->edges[a][first[a]];
    hi[a] = g->edges[a][last[a] + 1];
  }
  soter_reach_start(g, lo, hi, x);
}

void soter_reach_depend(const soter_reach_group* g, uint16_t* reaches, const uint16_t* image) {
  for (int a = 0; a < g->axes; a++) {
    const int around = image[2 * a + 1] >= g->cells[a];
    SOTER_CHECK(image[2 * a] <= image[2 * a + 1] && image[2 * a + 1] < 2 * g->cells[a]);
    const uint16_t lo = (uint16_t)(around ? 0 : image[2 * a] / g->tile[a]);
    const uint16_t hi = (uint16_t)(around ? g->tiles[a] - 1 : image[2 * a + 1] / g->tile[a]);
    reaches[2 * a] = lo < reaches[2 * a] ? lo : reaches[2 * a];
    reaches[2 * a + 1] = hi > reaches[2 * a + 1] ? hi : reaches[2 * a + 1];
  }
}

/* Takes the cells that changed in a tile out of the set (`join`: into it). */
static void change_cells(const soter_reach_group* g, soter_reach_rounds* w, int64_t tile,
                         int join) {
  int first[AXES] = {0, 0, 0, 0}, last[AXES] = {0, 0, 0, 0}, in[AXES], bit = 0;
  (void)soter_reach_tile(g, tile, first, last);
  memcpy(in, first, sizeof in);
  do {
    if (w->changed[tile] >> bit & 1U) {
      uint64_t* word = &w->kept[soter_reach_row(g, in) + (in[g->axes - 1] >> 6)];
      const uint64_t one = UINT64_C(1) << (in[g->axes - 1] & 63);
      *word = join ? *word | one : *word & ~one;
    }
    bit++;
  } while (soter_reach_next_cell(g->axes, first, last, in));
  SOTER_CHECK(bit == 64 || w->changed[tile] >> bit == 0);
  w->changed[tile] = 0;
}

/* Where a tile is counted: its place, one further along each axis. */
static int64_t place_of(const soter_reach_group* g, const int64_t* stride, int64_t tile) {
  int64_t where = 0;
  for (int a = g->axes - 1; a >= 0; a--) {
    where += stride[a] * (tile % g->tiles[a] + 1);
    tile /= g->tiles[a];
  }
  SOTER_CHECK(tile == 0);
  return where;
}

/* Sums along each axis in turn. */
static void sum_up(const soter_reach_group* g, const int64_t* stride, int64_t count,
                   int32_t* sums) {
  for (int a = 0; a < g->axes; a++) {
    const int64_t lines = stride[a] * (g->tiles[a] + 1);
    SOTER_CHECK(count % lines == 0);
    for (int64_t begin = 0; begin < count; begin += lines) {
      for (int64_t i = begin + stride[a]; i < begin + lines; i++) {
        sums[i] += sums[i - stride[a]];
      }
    }
  }
}

/* How many tiles of the box `r` changed, from the sums. */
ALWAYS int64_t changed_in(int n, const soter_reach_rounds* w, const int64_t* stride,
                          const uint16_t* r) {
  int64_t count = 0;
  for (int corner = 0; corner < 1 << n; corner++) {
    int64_t where = 0;
    int sign = 1;
    for (int a = 0; a < n; a++) {
      const int low = corner >> a & 1;
      where += stride[a] * (low ? r[2 * a] : r[2 * a + 1] + 1);
      sign = low ? -sign : sign;
    }
    count += sign * w->sums[where];
  }
  SOTER_CHECK(count >= 0);
  return count;
}

/* Lists the tiles whose images touch one that changed. */
ALWAYS void list_tiles(int n, int64_t tiles, const int64_t* stride, soter_reach_rounds* w) {
  SOTER_CHECK(tiles >= 1);
  for (int64_t t = 0; t < tiles; t++) {
    const uint16_t* r = w->reaches + 2 * n * t;
    if (r[0] <= r[1] && changed_in(n, w, stride, r) > 0) {
      w->dirty[w->dirty_n++] = (int32_t)t;
    }
  }
}

/* Takes the cells that changed out of the set (`join`: into it), lists the tiles that may mind. */
void soter_reach_settle(const soter_reach_group* g, soter_reach_rounds* w, int join) {
  const int64_t tiles = soter_reach_tiles(g);
  int64_t fell = 0, stride[AXES], sums = 1;
  for (int a = g->axes - 1; a >= 0; a--) {
    stride[a] = sums;
    sums *= g->tiles[a] + 1;
  }
  memset(w->sums, 0, sizeof(int32_t) * (size_t)sums);
  for (int64_t t = 0; t < tiles; t++) {
    if (w->changed[t] != 0) {
      fell++;
      change_cells(g, w, t, join);
      w->sums[place_of(g, stride, t)] = 1;
    }
  }
  w->dirty_n = 0;
  w->cursor = 0;
  if (fell == 0) {
    return;
  }
  sum_up(g, stride, sums, w->sums);
  if (g->axes == 2) {
    list_tiles(2, tiles, stride, w);
  } else if (g->axes == 3) {
    list_tiles(3, tiles, stride, w);
  } else {
    list_tiles(g->axes, tiles, stride, w);
  }
}

/* Halves a box of cells along its longest axis: `mid_last` ends the first, `mid_first` begins the
 * other one. */
void soter_reach_halves(const soter_reach_group* g, const int* first, const int* last,
                        int mid_last[AXES], int mid_first[AXES]) {
  int widest = 0;
  for (int a = 0; a < g->axes; a++) {
    widest = last[a] - first[a] > last[widest] - first[widest] ? a : widest;
  }
  SOTER_CHECK(first[widest] < last[widest]);
  memcpy(mid_last, last, sizeof(int) * AXES);
  memcpy(mid_first, first, sizeof(int) * AXES);
  mid_last[widest] = first[widest] + (last[widest] - first[widest]) / 2;
  mid_first[widest] = mid_last[widest] + 1;
}

/* A box of cells as first and last of each axis in turn; how many cells it has. */
int soter_reach_box(const soter_reach_group* g, const int* first, const int* last, uint16_t* box) {
  int size = 1;
  for (int a = 0; a < g->axes; a++) {
    SOTER_CHECK(first[a] >= 0 && first[a] <= last[a] && last[a] < g->cells[a]);
    box[2 * a] = (uint16_t)first[a];
    box[2 * a + 1] = (uint16_t)last[a];
    size *= last[a] - first[a] + 1;
  }
  return size;
}

/* Every tile is to be looked at once; the set is as given. */
void soter_reach_rounds_begin(const soter_reach_group* g, soter_reach_rounds* r) {
  const int64_t tiles = soter_reach_tiles(g);
  memset(r->begun, 0, (size_t)tiles);
  memset(r->changed, 0, sizeof(uint64_t) * (size_t)tiles);
  for (int64_t t = 0; t < tiles; t++) {
    r->dirty[t] = (int32_t)t;
    for (int a = 0; a < g->axes; a++) {
      r->reaches[2 * (g->axes * t + a)] = UINT16_MAX;
      r->reaches[2 * (g->axes * t + a) + 1] = 0;
    }
  }
  r->dirty_n = (int32_t)tiles;
  r->cursor = r->rounds = 0;
  memset(r->vain, 0, sizeof r->vain);
  memset(r->steps, 0, sizeof r->steps);
}

/* Rounds until nothing changes any more, or too much was made or in vain, or for about `seconds`; 1
 * when done. */
int soter_reach_rounds_run(const soter_reach_group* g, soter_reach_rounds* r, int join,
                           soter_crew* crew) {
  while (r->dirty_n > 0) {
    r->cursor = (int32_t)soter_crew_run(crew, r->cursor, r->dirty_n);
    SOTER_CHECK(r->cursor >= 0 && r->cursor <= r->dirty_n);
    if (r->steps_max > 0 && r->steps[0] + r->steps[1] > r->steps_max) {
      break; /* they only rise: it comes to this whoever looks at what, and when */
    }
    if (r->cursor < r->dirty_n) {
      return 0;
    }
    soter_reach_settle(g, r, join);
    r->rounds++;
    if (r->vain_max > 0 && r->vain[0] + r->vain[1] > r->vain_max) {
      break; /* at the end of a round, where it is the same whoever looked at what */
    }
  }
  return 1;
}
