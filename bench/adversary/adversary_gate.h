/* The shield of a module, and an AC that knows what it permits.
 *
 * Purpose: which commands may act, as docs/semantics.md has it: of each cell the time until which a
 * command of it stood on the topics, and the hull of what may still act; what AC proposes.
 * Non-goals: which commands are permitted where (a table of the program), when AC steps.
 */

#ifndef ADVERSARY_GATE_H
#define ADVERSARY_GATE_H

#include "adversary_choices.h"

static double cut(const loop *m, int k, int at) {
  double low = m->u_low[k], high = m->u_high[k];
  return at == m->shield ? high : low + (high - low) * ((double)at / m->shield);
}

/* The cell of a command of component k; -1 outside of its set. */
static int command_cell(const loop *m, int k, double u) {
  int at = 0;
  if (!(u >= m->u_low[k] && u <= m->u_high[k])) {
    return -1;
  }
  while (at + 1 < m->shield && u >= cut(m, k, at + 1)) {
    at++;
  }
  return at;
}

static int fresh(const state *s, const value *read, int64_t release) {
  return read->stamp != NEVER && release - read->stamp <= s->m->max_age;
}

/* The cells of V: of `u`, of what it replaces, and of all that may still act at this release. Of a
 * map it is `u` alone, which moves the state that was read. */
static int hull(const state *s, int k, double u, int64_t release, int *low, int *high) {
  const loop *m = s->m;
  int before = command_cell(m, k, s->published[k]);
  *low = *high = command_cell(m, k, u);
  for (int c = 0; c < m->shield && m->slip != ALONE && !m->is_map; c++) {
    if (c == before || s->until[k][c] >= release - m->acted) {
      *low = c < *low ? c : *low;
      *high = c > *high ? c : *high;
    }
  }
  return command_cell(m, k, u) >= 0;
}

/* Whether they are permitted at an estimate; of the groups that component `only` moves, or all. */
static int permitted_of(
    const state *s, const double *y, const double *u, int64_t release, int only) {
  const loop *m = s->m;
  for (int g = 0; g < (m->slip == FIRST_ONLY ? 1 : m->groups); g++) {
    int64_t at = cell_of(m, g, y);
    int low = 0, high = 0;
    if (only >= 0 && (m->moving[g] != 1 || m->moved[g][0] != only)) {
      continue;
    }
    if (at < 0) {
      return 0;
    }
    for (int a = 0; a < m->moving[g]; a++) {
      int k = m->moved[g][a];
      if (!hull(s, k, u[k], release, &low, &high)) {
        return 0;
      }
      at = at * m->shield + low;
      if (a + 1 < m->moving[g]) {
        at = at * m->shield + high;
      }
    }
    if (m->moving[g] == 0 ? m->level[g][at] == 0 : m->tops[g][at] <= high) {
      return 0;
    }
  }
  return 1;
}

static int permitted(const state *s, const double *y, const double *u, int64_t release) {
  return permitted_of(s, y, u, release, -1);
}

/* Whether a command of component k may act for longer in all groups that it moves. */
static int lasts(const state *s, int k, int cell, const double *y) {
  const loop *m = s->m;
  for (int g = 0; g < m->groups; g++) {
    int64_t at = cell_of(m, g, y);
    if (m->moving[g] == 1 && m->moved[g][0] == k
        && (at < 0 || m->lasting[g][at * m->shield + cell] == 0)) {
      return 0;
    }
  }
  return 1;
}

/* Moves what AC proposes toward `other`, as docs/semantics.md has it: each component to the first
 * cell on the way that lasts and is permitted, else to `other` where that is, else nowhere. What
 * the other components do is no matter of this one: groups have one command each. */
static void moves(const state *s, const double *y, int64_t release, const double *other, double *u) {
  const loop *m = s->m;
  double alone[U];
  memcpy(alone, s->published, sizeof alone);
  for (int k = 0; k < m->m; k++) {
    int own = command_cell(m, k, u[k]), to = command_cell(m, k, other[k]), done = own < 0 || to < 0;
    int step = to > own ? 1 : -1;
    for (int c = own; !done && c != to + step; c += step) {
      double high = c + 1 == m->shield ? cut(m, k, c + 1) : nextafter(cut(m, k, c + 1), -HUGE_VAL);
      double at = c == own ? u[k] : step > 0 ? cut(m, k, c) : high;
      alone[k] = at;
      if (lasts(s, k, c, y) && permitted_of(s, y, alone, release, k)) {
        u[k] = at;
        done = 1;
      }
    }
    alone[k] = other[k];
    if (!done && permitted_of(s, y, alone, release, k)) {
      u[k] = other[k];
    }
  }
}

/* The same where nothing was replaced yet. */
int adversary_permitted(const loop *m, const double *y, const double *u) {
  state s = {.m = m};
  for (int k = 0; k < m->m; k++) {
    s.published[k] = u[k];
    for (int c = 0; c < CELLS; c++) {
      s.until[k][c] = NEVER;
    }
  }
  return permitted(&s, y, u, 0);
}

/* Whether a command that acts on a state of time `since`, or will, is not in V. */
static int forgotten(const state *s, const queue *q, const double *u, int64_t since,
    int64_t release) {
  const loop *m = s->m;
  for (int k = 0; k < m->m && !m->is_map; k++) {
    int low, high, lost = 0;
    (void)hull(s, k, u[k], release, &low, &high);
    for (int64_t t = since > s->t - PAST ? since : s->t - PAST + 1; t < s->t; t++) {
      int c = t < 0 ? low : command_cell(m, k, s->past[k][t % PAST]);
      lost |= c < low || c > high;
    }
    for (int i = 0; i < q[k].count; i++) {
      int c = command_cell(m, k, q[k].u[(q[k].first + i) % QUEUE]);
      lost |= c < low || c > high;
    }
    int now = command_cell(m, k, s->u[k]);
    int replaced = q[k].count > 0 && q[k].at[q[k].first] <= s->t;
    if (lost || (!replaced && (now < low || now > high))) {
      return 1;
    }
  }
  return 0;
}

/* The topics hold `u` from now on, by a step of this release. */
static void replaced(state *s, const double *u, int64_t release) {
  for (int k = 0; k < s->m->m; k++) {
    int before = command_cell(s->m, k, s->m->slip == BEGAN ? u[k] : s->published[k]);
    if (before >= 0) {
      s->until[k][before] = release;
    }
    s->published[k] = u[k];
  }
}

/* The command of the cell that is furthest up, or down. */
static double end_of(const loop *m, int k, int cell, int up) {
  double high = cut(m, k, cell + 1);
  if (!up) {
    return cut(m, k, cell);
  }
  return cell + 1 == m->shield ? high : nextafter(high, m->u_low[k]);
}

/*
 * What AC would publish at this tick; 0: nothing. What it wants is `advanced`'s; where that is
 * refused it takes the next best that is permitted, component by component.
 */
static int proposes(
    state *s, const value *read, const double *y, int64_t release, double *u) {
  const loop *m = s->m;
  int64_t pattern = s->p[PATTERN] > 1 ? s->p[PATTERN] : 2, n = s->judges++;
  for (int k = 0; k < m->m; k++) {
    u[k] = advanced(s, k);
  }
  switch (s->p[TRIES]) {
  case 0: /* whatever it wants, permitted or not */
    return 1;
  case 1:
    break;
  case 2: /* now and then, silent in between */
    if (n % (pattern * pattern) != 0) {
      return 0;
    }
    break;
  case 3: /* to and fro */
    for (int k = 0; k < m->m; k++) {
      u[k] = n / pattern % 2 == 0 ? m->u_low[k] : m->u_high[k];
    }
    break;
  case 4:
    for (int k = 0; k < m->m; k++) {
      u[k] = m->u_low[k] + unit(s) * (m->u_high[k] - m->u_low[k]);
    }
    break;
  case 5: /* a milder one some time before a look, so that the look is good */
    s->yields = (s->t + pattern * pattern / 3 - m->dm_phase) % m->dm_period == 0;
    break;
  default: /* right after the DM's look, and silent until the next */
    if ((s->t - m->dm_phase) % m->dm_period != m->j_dm) {
      return 0;
    }
  }
  for (int k = 0; k < m->m; k++) {
    int up = u[k] > 0.5 * (m->u_low[k] + m->u_high[k]);
    double wanted[U];
    int at = command_cell(m, k, u[k]);
    memcpy(wanted, s->published, sizeof wanted);
    memcpy(wanted, u, (size_t)(k + 1) * sizeof *wanted);
    if (s->p[TRIES] == 5 && s->yields) {
      int milder = command_cell(m, k, s->published[k]) + (up ? -1 : 1);
      at = milder >= 0 && milder < m->shield ? milder : at;
      wanted[k] = end_of(m, k, at, up);
    }
    while (!permitted(s, y, wanted, release) && at >= 0 && at < m->shield) {
      wanted[k] = end_of(m, k, at, up);
      at += up ? -1 : 1;
    }
    double less = up ? s->published[k] - wanted[k] : wanted[k] - s->published[k];
    u[k] = s->p[TRIES] == 5 && !s->yields && less > 0.0 ? s->published[k] : wanted[k];
  }
  return m->slip > 0 || (fresh(s, read, release) && permitted(s, y, u, release));
}

#endif
