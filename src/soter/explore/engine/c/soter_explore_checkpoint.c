/* soter_explore_checkpoint.c: breadth-first search on a disk.
 *
 * Purpose: all that a search needs to go on (frontiers, what was handed on but not taken in,
 * tables, coverage, counts), written while nobody works, in pieces; and back, on any number of
 * threads. Tables are their entries, in the order of their places. After a layer what was found is
 * what is expanded next; before all of it was expanded, the rest of it waits with what came of it
 * so far. Non-goals: whether a file is whole, and whose it is
 * (explore/checkpoints.py).
 */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <unistd.h>

#include "soter_explore_bfs.h"

#define PIECE (UINT64_C(1) << 20) /* bytes that are written at once */
#define NUMBERS 16U
#define MARK UINT64_C(0x32736579616c6f73)
#define COVERS 6U

enum {
  AT_MARK,
  AT_WORDS,
  AT_WIDTH,
  AT_ENTRY,
  AT_SEGMENTS,
  AT_KIND,
  AT_THREADS,
  AT_TABLES,
  AT_DEPTH,
  AT_STATES,
  AT_MADE,
  AT_MOST_BYTES,
  AT_MOST_TABLE,
  AT_MOST_ROWS
};

typedef struct {
  uint8_t* at;
  uint64_t bytes;
} piece;

/* The arrays of a coverage. */
static void pieces_of(const soter_model* m, const soter_explore_coverage* c, piece* p) {
  const uint64_t modules = m->program->modules;
  p[0] = (piece){(uint8_t*)c->branches, (m->branches + 63U) / 64U * sizeof *c->branches};
  p[1] = (piece){c->classes, (uint64_t)m->leaves * 256U};
  p[2] = (piece){c->modes, modules * 2U};
  p[3] = (piece){c->switches, modules * 2U};
  p[4] = (piece){c->fired, m->actors};
  p[5] = (piece){c->judged, (uint64_t)m->program->properties + m->timeds};
}

/* Whether what the tables of the next layer have is needed: they forget what is expanded then. */
static bool needs_tables(const layered* all) {
  return !all->whole || (!all->forgets && soter_layers_waiting(all) > 0U);
}

/* What has to be the same in the search that reads it. */
static void describe(const layered* all, uint64_t* number) {
  const worker* const w = &all->w[0];
  (void)memset(number, 0, NUMBERS * sizeof *number);
  number[AT_MARK] = MARK;
  number[AT_WORDS] = all->words;
  number[AT_WIDTH] = w->here.width;
  number[AT_ENTRY] = w->store.bytes;
  number[AT_SEGMENTS] = w->store.segments;
  number[AT_KIND] = (all->tables ? 1U : 0U) + (all->forgets ? 2U : 0U);
}

/* ------------------------------------------------------------------ writing */

typedef struct {
  int file;
  uint8_t* piece;
  uint64_t used;
  bool fine;
} pen;

static void write_all(pen* p, const uint8_t* bytes, uint64_t count) {
  while (p->fine && count > 0U) {
    const ssize_t written = write(p->file, bytes, count > PIECE ? PIECE : count);
    if (written > 0) {
      bytes += written;
      count -= (uint64_t)written;
    }
    p->fine = written > 0 || (written < 0 && errno == EINTR);
  }
}

static void put(void* to, const void* bytes, uint64_t count) {
  pen* const p = to;
  if (p->used + count > PIECE) {
    write_all(p, p->piece, p->used);
    p->used = 0U;
  }
  if (count > PIECE) {
    write_all(p, bytes, count);
  } else if (count > 0U) {
    (void)memcpy(p->piece + p->used, bytes, count);
    p->used += count;
  }
  SOTER_CHECK(p->used <= PIECE);
}

static void put_row(pen* p, const soter_row* r, uint64_t first) {
  const uint64_t count = r->count - first;
  SOTER_CHECK(first <= r->count);
  put(p, &count, sizeof count);
  if (count > 0U) {
    put(p, soter_row_at(r, first), count * r->width * sizeof *r->item);
  }
}

static void put_rows(pen* p, const layered* all, const worker* w) {
  const soter_row none = {0};
  put_row(p, all->whole ? &w->next : &w->here, all->whole || all->tables ? 0U : w->expanded);
  put_row(p, all->whole ? &none : &w->next, 0U);
  for (uint32_t k = 0; k < all->threads; k++) {
    put_row(p, &w->out[k], 0U);
  }
}

static void put_table(pen* p, const soter_store* s, soter_cursor from) {
  put(p, &s->prefix, sizeof s->prefix);
  for (uint32_t g = 0; g < s->segments; g++) {
    const uint64_t count = soter_store_count(s, g, from);
    put(p, &count, sizeof count);
    soter_store_write(s, g, from, put, p);
  }
}

/* The frontier, where it is one, and what is known of the next. */
static void put_tables(pen* p, const layered* all, bool next) {
  const soter_cursor begin = {0U, 0U};
  for (uint32_t k = 0; all->tables && k < all->threads; k++) {
    const worker* const w = &all->w[k];
    put_table(p, all->whole ? &w->store : &w->before, all->whole ? begin : w->at);
  }
  for (uint32_t k = 0; next && k < all->threads; k++) {
    put_table(p, &all->w[k].store, begin);
  }
}

/* Whether what comes was there before. */
static void put_closing(pen* p, const layered* all) {
  const soter_cursor begin = {0U, 0U};
  const soter_closing_kept kept = soter_closed_kept(all);
  put(p, &kept, sizeof kept);
  put(p, all->closing.turn, kept.turns * sizeof *all->closing.turn);
  for (uint32_t k = 0; kept.table != 0U && k < all->threads; k++) {
    put_table(p, soter_closed_table(all, k), begin);
  }
}

static void put_numbers(pen* p, const layered* all, bool tables) {
  uint64_t number[NUMBERS];
  describe(all, number);
  number[AT_THREADS] = all->threads;
  number[AT_TABLES] = tables ? 1U : 0U;
  number[AT_DEPTH] = all->depth - (all->done && !all->whole ? 1U : 0U);
  for (uint32_t k = 0; k < all->threads; k++) {
    number[AT_STATES] += all->w[k].count;
    number[AT_MADE] += all->w[k].made;
  }
  number[AT_MOST_BYTES] = all->most_bytes;
  number[AT_MOST_TABLE] = all->most_table;
  number[AT_MOST_ROWS] = all->most_rows;
  put(p, number, sizeof number);
}

bool soter_layers_write(const layered* all, int file) {
  const soter_search* const s = all->s;
  piece cover[COVERS];
  pen p = {file, soter_take(PIECE), 0U, true};
  if (p.piece == NULL) {
    return false;
  }
  const bool tables = needs_tables(all);
  put_numbers(&p, all, tables);
  for (uint32_t k = 0; k < all->threads; k++) {
    soter_merge_coverage(s->m, s->coverage, &all->w[k].coverage);
  }
  pieces_of(s->m, s->coverage, cover);
  for (uint32_t k = 0; k < COVERS; k++) {
    put(&p, &cover[k].bytes, sizeof cover[k].bytes);
    put(&p, cover[k].at, cover[k].bytes);
  }
  for (uint32_t k = 0; k < all->threads; k++) {
    put_rows(&p, all, &all->w[k]);
  }
  put_tables(&p, all, tables);
  put_closing(&p, all);
  const uint64_t end = MARK;
  put(&p, &end, sizeof end);
  write_all(&p, p.piece, p.used);
  soter_give(p.piece, PIECE);
  return p.fine;
}

/* ------------------------------------------------------------------ reading */

typedef struct {
  const uint8_t* at;
  uint64_t left;
  uint32_t threads; /* that wrote it */
} reader;

/* The next bytes; NULL: there are not so many. */
static const uint8_t* get(reader* r, uint64_t count, uint64_t each) {
  if (each > 0U && count > r->left / each) {
    return NULL;
  }
  const uint8_t* const at = r->at;
  r->at += count * each;
  r->left -= count * each;
  return at;
}

static bool get_number(reader* r, uint64_t* number) {
  const uint8_t* const at = get(r, 1U, sizeof *number);
  if (at != NULL) {
    (void)memcpy(number, at, sizeof *number);
  }
  return at != NULL;
}

/* Who may have one more configuration: the row is its own. */
typedef soter_row* row_of(layered* all, uint32_t owner);

static soter_row* here_of(layered* all, uint32_t owner) {
  return &all->w[owner].here;
}

static soter_row* next_of(layered* all, uint32_t owner) {
  return &all->w[owner].next;
}

static soter_row* handed_to(layered* all, uint32_t owner) {
  return &all->w[0].out[owner];
}

static bool get_row(reader* r, layered* all, row_of* row, uint64_t width) {
  uint64_t count;
  if (!get_number(r, &count)) {
    return false;
  }
  const uint8_t* from = get(r, count, width * sizeof(uint64_t));
  for (uint64_t i = 0; from != NULL && i < count; i++) {
    uint64_t item[SOTER_WORDS + 2U];
    uint64_t key[SOTER_WORDS];
    (void)memcpy(item, from, width * sizeof *item);
    from += width * sizeof *item;
    soter_store_key(&all->w[0].store, item, key);
    const uint32_t owner = soter_owner_of(all, &all->w[0].store, item, key);
    const uint64_t only = width > all->words + 1U ? item[all->words + 1U] : 0U;
    if (!soter_row_put(row(all, owner), item, width > all->words ? item[all->words] : 0U, only)) {
      all->w[owner].full = all->w[owner].torn = true;
    }
  }
  return from != NULL;
}

static bool get_rows(reader* r, layered* all) {
  const uint64_t width = all->w[0].here.width;
  bool fine = get_row(r, all, here_of, width) && get_row(r, all, next_of, width);
  for (uint32_t k = 0; fine && k < r->threads; k++) {
    fine = get_row(r, all, handed_to, all->w[0].out[0].width);
  }
  return fine;
}

/* What a table may take: they are weighed against each other when all of it is read. */
static void allow(layered* all, soter_store* s) {
  uint64_t others = 0U;
  for (uint32_t k = 0; k < all->threads; k++) {
    const worker* const w = &all->w[k];
    others += soter_store_bytes(&w->store) + soter_store_bytes(&w->before);
    others += soter_row_bytes(&w->here) + soter_row_bytes(&w->next);
  }
  others -= soter_store_bytes(s);
  const uint64_t memory = all->s->o->memory;
  s->memory = memory > others ? memory - others : 0U;
}

/* A table that entries go to, and the least time of what it has; NULL: rows tell it. */
typedef soter_store* table_of(worker* w, int64_t** time);

static soter_store* frontier_of(worker* w, int64_t** time) {
  *time = &w->here_ns;
  return &w->before;
}

static soter_store* store_of(worker* w, int64_t** time) {
  *time = w->all->tables ? &w->next_ns : NULL;
  return &w->store;
}

static soter_store* anchor_of(worker* w, int64_t** time) {
  *time = NULL;
  return &w->anchor;
}

static void put_entry(layered* all, table_of* table, uint32_t segment, soter_entry* e) {
  int64_t* time;
  worker* const w = &all->w[soter_owner_of(all, &all->w[0].store, e->packed, e->key)];
  soter_store* const s = table(w, &time);
  if (w->full || !soter_store_put_entry(s, segment, e)) {
    w->full = w->torn = true;
  }
  if (time != NULL) {
    *time = soter_earlier(*time, soter_time_of(all->s->m, e->packed));
  }
}

static bool get_segment(reader* r, layered* all, table_of* table, uint32_t segment,
                        soter_entry* e) {
  uint64_t count;
  int64_t* time;
  if (!get_number(r, &count)) {
    return false;
  }
  for (uint32_t k = 0; k < all->threads; k++) {
    allow(all, table(&all->w[k], &time));
  }
  soter_store* const first = table(&all->w[0], &time);
  const uint8_t* from = get(r, count, first->bytes);
  if (from != NULL && all->threads == 1U) {
    soter_store_reserve(first, segment, count);
  }
  for (uint64_t i = 0; from != NULL && i < count; i++, from += first->bytes) {
    soter_store_read(first, from, e);
    put_entry(all, table, segment, e);
  }
  return from != NULL;
}

/* What the entries of a table have in common, for who reads them: the same in all tables of a layer
 * that have one, and what stands there for an empty one does not count. */
static bool get_prefix(reader* r, layered* all, table_of* table) {
  int64_t* time;
  uint64_t prefix;
  soter_store* const first = table(&all->w[0], &time);
  if (!get_number(r, &prefix)) {
    return false;
  }
  if (first->count == 0U) {
    first->prefix = prefix;
  }
  return true;
}

static bool get_table(reader* r, layered* all, table_of* table) {
  soter_entry* const e = malloc(sizeof *e);
  bool fine = e != NULL;
  for (uint32_t k = 0; fine && k < r->threads; k++) {
    fine = get_prefix(r, all, table);
    for (uint32_t g = 0; fine && g < all->w[0].store.segments; g++) {
      fine = get_segment(r, all, table, g, e);
    }
  }
  free(e);
  return fine;
}

/* What was read is what the workers begin with. */
static void set_out(layered* all) {
  const soter_model* const m = all->s->m;
  for (uint32_t k = 0; k < all->threads; k++) {
    worker* const w = &all->w[k];
    w->layer = all->tables ? w->before.count : w->here.count;
    w->fresh = all->tables ? w->store.count : w->next.count;
    w->here_ns = soter_earlier(w->here_ns, soter_row_time(&w->here, m, 0U));
    w->next_ns = soter_earlier(w->next_ns, soter_row_time(&w->next, m, 0U));
  }
}

static bool get_coverage(reader* r, layered* all) {
  piece cover[COVERS];
  pieces_of(all->s->m, &all->w[0].coverage, cover);
  bool fine = true;
  for (uint32_t k = 0; fine && k < COVERS; k++) {
    uint64_t bytes;
    fine = get_number(r, &bytes) && bytes == cover[k].bytes;
    const uint8_t* const from = fine ? get(r, bytes, 1U) : NULL;
    fine = from != NULL;
    if (fine) {
      (void)memcpy(cover[k].at, from, bytes);
    }
  }
  return fine;
}

static bool get_numbers(reader* r, layered* all, bool* tables) {
  uint64_t wanted[NUMBERS];
  uint64_t number[NUMBERS];
  describe(all, wanted);
  for (uint32_t k = 0; k < NUMBERS; k++) {
    if (!get_number(r, &number[k])) {
      return false;
    }
  }
  const uint64_t threads = number[AT_THREADS];
  if (memcmp(number, wanted, AT_THREADS * sizeof *number) != 0 || threads < 1U ||
      threads > THREADS) {
    return false;
  }
  worker* const w = &all->w[0];
  r->threads = (uint32_t)threads;
  *tables = number[AT_TABLES] != 0U;
  all->depth = (uint32_t)number[AT_DEPTH];
  w->count = number[AT_STATES];
  w->made = w->expander.transitions = number[AT_MADE];
  all->most_bytes = number[AT_MOST_BYTES];
  all->most_table = number[AT_MOST_TABLE];
  all->most_rows = number[AT_MOST_ROWS];
  return true;
}

static bool get_configurations(reader* r, layered* all, bool tables) {
  bool fine = true;
  for (uint32_t k = 0; fine && k < r->threads; k++) {
    fine = get_rows(r, all);
  }
  fine = fine && (!all->tables || get_table(r, all, frontier_of));
  return fine && (!tables || get_table(r, all, store_of));
}

/* The last of it: `set_out` comes before. */
static bool get_closing(reader* r, layered* all) {
  soter_closing_kept kept;
  const uint8_t* from = get(r, 1U, sizeof kept);
  if (from == NULL) {
    return false;
  }
  (void)memcpy(&kept, from, sizeof kept);
  from = get(r, kept.turns, sizeof *all->closing.turn);
  soter_turn* const turn = from == NULL ? NULL : soter_closed_room(all, kept.turns);
  if (turn == NULL) {
    return false;
  }
  (void)memcpy(turn, from, kept.turns * sizeof *turn);
  bool fine = true;
  for (uint32_t k = 0; kept.table != 0U && fine && k < all->threads; k++) {
    fine = soter_layers_open_store(&all->w[k], &all->w[k].anchor);
  }
  fine = fine && (kept.table == 0U || get_table(r, all, anchor_of));
  if (fine) {
    soter_closed_resume(all, &kept);
  }
  return fine;
}

bool soter_layers_read(layered* all, const uint8_t* from, uint64_t bytes) {
  reader r = {from, bytes, 0U};
  bool tables = false;
  uint64_t end = 0U;
  const bool fine =
      get_numbers(&r, all, &tables) && get_coverage(&r, all) && get_configurations(&r, all, tables);
  set_out(all);
  const bool read = fine && get_closing(&r, all);
  return read && get_number(&r, &end) && end == MARK && r.left == 0U;
}
