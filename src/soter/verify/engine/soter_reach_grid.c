/* Grids: from boxes to cells, sets as bits, erosion.
 * Purpose: say which cells cover a box, and whether a set of cells holds all or one of them. How an
 * axis wraps around is argued in docs/proof-sets.md, "Axes that wrap around".
 * Non-goals: where a box comes from (soter_reach_hold.c, soter_reach_tubes.c). */
#include "soter_reach_internal.h"

#include <string.h>

/* A cell near x, for x in the grid; the edges say which one it is. */
static inline int guess_cell(const soter_reach_group* g, int axis, double x) {
  const double* e = g->edges[axis];
  const int buckets = g->guesses[axis];
  const int b = (int)((x - e[0]) * g->per_unit[axis]);
  return g->guess[axis][b < 0 ? 0 : b >= buckets ? buckets - 1 : b];
}

/* The last cell that begins at lo or before. */
static inline int first_of(const soter_reach_group* g, int axis, double lo) {
  const double* e = g->edges[axis];
  int i = guess_cell(g, axis, lo);
  while (e[i] > lo) {
    i--;
  }
  while (i + 1 < g->cells[axis] && e[i + 1] <= lo) {
    i++;
  }
  return i;
}

/* The first cell that ends at hi or after. */
static inline int last_of(const soter_reach_group* g, int axis, double hi) {
  const double* e = g->edges[axis];
  int j = guess_cell(g, axis, hi);
  while (e[j + 1] < hi) {
    j++;
  }
  while (j > 0 && e[j] >= hi) {
    j--;
  }
  return j;
}

/* Of an interval that is not empty: beyond an axis without an end all is of the outer cell. */
static void move_into_outer_cells(const soter_reach_group* g, int axis, double* lo, double* hi) {
  const double low = g->edges[axis][0];
  const double high = g->edges[axis][g->cells[axis]];
  SOTER_CHECK(*lo <= *hi && low < high);
  if (g->kept_low[axis] == SOTER_REACH_UNBOUNDED) {
    *lo = *lo < low ? low : *lo;
    *hi = *hi < low ? low : *hi;
  }
  if (g->kept_high[axis] == SOTER_REACH_UNBOUNDED) {
    *lo = *lo > high ? high : *lo;
    *hi = *hi > high ? high : *hi;
  }
}

/* Brings what sticks out of the grid into it, where that may be; 0 where it may not. */
static int bring_in(const soter_reach_group* g, int axis, double* lo, double* hi) {
  const double* e = g->edges[axis];
  const int n = g->cells[axis];
  soter_reach_keep_axis(g, axis, lo, hi);
  if (*lo <= *hi) {
    move_into_outer_cells(g, axis, lo, hi);
  }
  SOTER_CHECK(n >= 1);
  return *lo >= e[0] && *hi <= e[n] && *lo <= *hi;
}

/* Axes that wrap around.
 *
 * Nothing reads how many turns a state has made, so that runs which differ by whole turns are one.
 * A chain goes on beyond the ends, as far as the enclosures' domain, and is brought back here: a
 * box is covered by cells `first` up to `last`, of which those from `cells` on are those from 0 on.
 * The declared ends are a turn apart but for rounding. The outer cells go SEAM further, so that
 * they meet, and what is brought back with rounding to the seam lies in one. */
#define FULL_TURN 6.283185307179586
#define SEAM 0x1p-40        /* as `SEAM` of group_model.py */
#define NEAR_A_TURN 0x1p-46 /* more than what less than 8 turns, and sums with them, are off */

/* The cell of a point along an axis, counted on through turns; `up`: the last of two that meet. */
static int cell_on_turns(const soter_reach_group* g, int axis, double x, int up) {
  const double* e = g->edges[axis];
  const int n = g->cells[axis];
  int turns = (int)floor((x - (e[0] + SEAM)) / FULL_TURN);
  if (up ? turns == 1 && x <= e[n] : turns == -1 && x >= e[0]) {
    turns = 0; /* in an outer cell still */
  }
  const double apart = turns == 0 ? 0.0 : up ? NEAR_A_TURN : -NEAR_A_TURN;
  const double y = x - turns * FULL_TURN + apart;
  SOTER_CHECK(turns > -8 && turns < 8 && y >= e[0] && y <= e[n]);
  return turns * n + (up ? last_of(g, axis, y) : first_of(g, axis, y));
}

static int cells_around(const soter_reach_group* g, int axis, double lo, double hi, int* first,
                        int* last) {
  const int n = g->cells[axis], state = g->axis[axis];
  if (!(lo >= g->low[state] && hi <= g->high[state] && lo <= hi)) {
    return 0;
  }
  *first = cell_on_turns(g, axis, lo, 0);
  *last = cell_on_turns(g, axis, hi, 1);
  SOTER_CHECK(g->high[state] - g->low[state] < 8 * FULL_TURN);
  if (*last - *first >= n - 1 || hi - lo >= FULL_TURN) {
    *first = 0;
    *last = n - 1;
    return 1;
  }
  *last = *last < *first ? *first : *last;
  const int begin = (*first % n + n) % n;
  *last += begin - *first;
  *first = begin;
  return 1;
}

/* First and last cell that cover [lo, hi] along an axis; 0 where the grid does not. */
static inline int cells_along(const soter_reach_group* g, int axis, double lo, double hi,
                              int* first, int* last) {
  const double* e = g->edges[axis];
  const int n = g->cells[axis];
  if (g->kept_low[axis] == SOTER_REACH_WRAPS) {
    return cells_around(g, axis, lo, hi, first, last);
  }
  if (!(lo >= e[0] && hi <= e[n] && lo <= hi) && !bring_in(g, axis, &lo, &hi)) {
    return 0;
  }
  *first = first_of(g, axis, lo);
  *last = last_of(g, axis, hi);
  if (*last < *first) { /* a point on an edge */
    *last = *first;
  }
  SOTER_CHECK(*first >= 0 && *last < n);
  return 1;
}

/* Cells that cover a box: [first, last] of every axis in turn; of one that wraps around `last` may
 * be up to twice the number of cells. */
int soter_reach_cover(const soter_reach_group* g, const double* lo, const double* hi,
                      uint16_t* image) {
  for (int a = 0; a < g->axes; a++) {
    int first, last;
    if (!cells_along(g, a, lo[a], hi[a], &first, &last)) {
      return 0;
    }
    image[2 * a] = (uint16_t)first;
    image[2 * a + 1] = (uint16_t)last;
  }
  return 1;
}

/* Masks of the words from..to of a row that hold bits first..last. */
static inline uint64_t word_mask(int word, int first, int last) {
  uint64_t m = ~UINT64_C(0);
  if (word == first >> 6) {
    m &= ~UINT64_C(0) << (first & 63);
  }
  if (word == last >> 6) {
    m &= ~UINT64_C(0) >> (63 - (last & 63));
  }
  return m;
}

/* Whether the cells first..last of a row differ from what would go on: for `any` none is in the
 * set, else all are. */
static inline int row_tells(const uint64_t* row, int first, int last, int any) {
  for (int w = first >> 6; w <= last >> 6; w++) {
    const uint64_t m = word_mask(w, first, last);
    if (any ? (row[w] & m) != 0 : (row[w] & m) != m) {
      return 1;
    }
  }
  return 0;
}

/* The same of `rows` rows, `words` words each. Within one word is the usual case. */
static inline int plane_tells(const uint64_t* row, int64_t words, int rows, int first, int last,
                              int any) {
  const int one_word = first >> 6 == last >> 6;
  const uint64_t m = word_mask(first >> 6, first, last);
  SOTER_CHECK(rows >= 1 && first <= last);
  for (int r = 0; r < rows; r++, row += words) {
    const uint64_t here = row[first >> 6] & m;
    if (one_word ? (any ? here != 0 : here != m) : row_tells(row, first, last, any)) {
      return 1;
    }
  }
  return 0;
}

/* `soter_reach_inside` of a box that is beyond no end. By planes of the last two axes. */
static int inside_grid(const soter_reach_group* g, const uint64_t* bits, const uint16_t* box,
                       int any) {
  int at[AXES] = {0, 0, 0, 0};
  const int n = g->axes, first = box[2 * (n - 1)], last = box[2 * (n - 1) + 1];
  const int rows = n > 1 ? box[2 * n - 3] - box[2 * n - 4] + 1 : 1;
  if (n == 2) {
    const uint64_t* row = bits + (int64_t)box[0] * g->words;
    return plane_tells(row, g->words, rows, first, last, any) ? any : !any;
  }
  for (int a = 0; a + 1 < n; a++) {
    at[a] = box[2 * a];
  }
  for (;;) {
    int a = n - 3;
    if (plane_tells(bits + soter_reach_row(g, at), g->words, rows, first, last, any)) {
      return any;
    }
    while (a >= 0 && at[a] == box[2 * a + 1]) {
      at[a] = box[2 * a];
      a--;
    }
    if (a < 0) {
      return !any;
    }
    at[a]++;
  }
}

/* Whether every cell of the box is in the set; `any`: whether one is. */
int soter_reach_inside(const soter_reach_group* g, const uint64_t* bits, const uint16_t* box,
                       int any) {
  uint16_t parts[1 << AXES][2 * AXES]; /* what goes on beyond an end comes in at the other one */
  int count = 1, around = 0;
  for (int a = 0; a < g->axes; a++) {
    around |= box[2 * a + 1] >= g->cells[a];
  }
  if (!around) {
    return inside_grid(g, bits, box, any);
  }
  memcpy(parts[0], box, sizeof(uint16_t) * 2 * (size_t)g->axes);
  for (int a = 0; a < g->axes; a++) {
    const int n = g->cells[a], last = box[2 * a + 1];
    SOTER_CHECK(last < 2 * n);
    for (int k = count; last >= n && k-- > 0;) {
      memcpy(parts[count], parts[k], sizeof parts[k]);
      parts[k][2 * a + 1] = (uint16_t)(n - 1);
      parts[count][2 * a] = 0;
      parts[count++][2 * a + 1] = (uint16_t)(last - n);
    }
  }
  for (int k = 0; k < count; k++) {
    if (inside_grid(g, bits, parts[k], any) == any) {
      return any;
    }
  }
  return !any;
}

/* Words of a set. */
int64_t soter_reach_words(const soter_reach_group* g) {
  int64_t rows = 1;
  for (int a = 0; a + 1 < g->axes; a++) {
    rows *= g->cells[a];
  }
  return rows * g->words;
}

/* Bytes (0 or not) of cells to bits. */
void soter_reach_pack(const soter_reach_group* g, const uint8_t* cells, uint64_t* bits) {
  const int64_t rows = soter_reach_words(g) / g->words;
  const int n = g->cells[g->axes - 1];
  SOTER_CHECK(n <= 64 * g->words);
  for (int64_t r = 0; r < rows; r++) {
    for (int w = 0; w < g->words; w++) {
      uint64_t x = 0;
      const int end = n - 64 * w < 64 ? n - 64 * w : 64;
      for (int b = 0; b < end; b++) {
        x |= (uint64_t)(cells[64 * w + b] != 0) << b;
      }
      bits[w] = x;
    }
    cells += n;
    bits += g->words;
  }
}

void soter_reach_unpack(const soter_reach_group* g, const uint64_t* bits, uint8_t* cells) {
  const int64_t rows = soter_reach_words(g) / g->words;
  const int n = g->cells[g->axes - 1];
  SOTER_CHECK(n <= 64 * g->words);
  for (int64_t r = 0; r < rows; r++) {
    for (int b = 0; b < n; b++) {
      cells[b] = (uint8_t)((bits[b >> 6] >> (b & 63)) & 1U);
    }
    cells += n;
    bits += g->words;
  }
}

/* Along one axis (`before` lines of `n` cells, `after` values each): out[i] says that all (`grow`:
 * one) of in[first[i]..last[i]] are set; a first below 0 or a last of n or more is outside.
 * scratch: (n + 1) * after ints. */
void soter_reach_shrink(int64_t before, int64_t n, int64_t after, const int32_t* first,
                        const int32_t* last, int32_t grow, const uint8_t* in, uint8_t* out,
                        int32_t* scratch) {
  for (int64_t b = 0; b < before; b++) {
    const uint8_t* from = in + b * n * after;
    uint8_t* to = out + b * n * after;
    memset(scratch, 0, sizeof(int32_t) * (size_t)after);
    for (int64_t i = 0; i < n; i++) {
      const int32_t* sum = scratch + i * after;
      int32_t* next = scratch + (i + 1) * after;
      for (int64_t k = 0; k < after; k++) {
        next[k] = sum[k] + (from[i * after + k] != 0);
      }
    }
    for (int64_t i = 0; i < n; i++) {
      const int32_t lo = first[i] < 0 ? 0 : first[i];
      const int32_t hi = last[i] >= n ? (int32_t)n - 1 : last[i];
      const int32_t whole = last[i] - first[i] + 1;
      for (int64_t k = 0; k < after; k++) {
        const int32_t count = hi < lo ? 0 : scratch[(hi + 1) * after + k] - scratch[lo * after + k];
        to[i * after + k] = (uint8_t)(grow ? count > 0 : count == whole);
      }
    }
  }
}
