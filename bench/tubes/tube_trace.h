/* What a check did, a step at a time.
 *
 * Purpose: the hooks that `tube_module.py` puts into the generated check, and whether a state is in
 * what they saw. A form is its doubles in a row: c, r, lo, hi, then a factor of each symbol.
 * Non-goals: when something is compared (tube_loop.c).
 */

#ifndef TUBE_TRACE_H
#define TUBE_TRACE_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

enum { WIDTH = 4 + SYMBOLS, HOLDS_MAX = 1100, STEPS_MAX = 8, FREE_MAX = 8 };
enum { FREE, WINDOW, OPEN, CLOSED, STEP };

/* Over the symbols of the estimate's errors; all others are in `half`. */
typedef struct {
  double c, half, lo, hi, g[NS];
} row;
typedef struct {
  row way[NS], end[NS];
} flown;

static struct {
  bool on;
  int frees, laws, steps, end, opens; /* `end`: the hold at whose beginning it rests; -1: none */
  row begun[NS];
  flown free[FREE_MAX], window, open[HOLDS_MAX], closed[HOLDS_MAX];
  flown step[HOLDS_MAX][STEPS_MAX];
  row law[HOLDS_MAX][MS];
  /* where SC reads nothing: steps by their times in ns from a_0 on, and when it rests */
  bool timed;
  int spans;
  int64_t from[HOLDS_MAX], to[HOLDS_MAX], rest;
  flown span[HOLDS_MAX];
} trace;

static void rows(const double *forms, row *to, int count) {
  for (int i = 0; i < count; i++) {
    const double *f = forms + (size_t)i * WIDTH;
    to[i] = (row){.c = f[0], .half = f[1], .lo = f[2], .hi = f[3]};
    for (int k = 0; k < SYMBOLS; k++) {
      if (k < NS) {
        to[i].g[k] = f[4 + k];
      } else {
        to[i].half += fabs(f[4 + k]);
      }
    }
  }
}

static void trace_begin(const void *estimated) {
  if (trace.on) {
    trace.frees = trace.laws = trace.steps = trace.opens = trace.spans = 0;
    trace.timed = false;
    trace.end = -1;
    rows(estimated, trace.begun, NS);
  }
}

static void trace_flow(int kind, const void *step) {
  if (!trace.on || trace.laws >= HOLDS_MAX) {
    return;
  }
  int n = trace.laws - 1;
  trace.opens += kind == OPEN;
  flown *to = kind == FREE ? &trace.free[trace.frees++]
      : kind == WINDOW     ? &trace.window
      : kind == OPEN       ? &trace.open[n + 1]
      : kind == CLOSED     ? &trace.closed[n]
                           : &trace.step[n][trace.steps++];
  rows(step, to->end, NS);
  rows((const double *)step + (size_t)NS * WIDTH, to->way, NS);
}

static void trace_span(double passed, double time, const void *step) {
  trace.timed = true;
  if (!trace.on || trace.spans >= HOLDS_MAX) {
    return;
  }
  int n = trace.spans++;
  trace.from[n] = llround(1e9 * passed);
  trace.to[n] = llround(1e9 * (passed + time));
  rows(step, trace.span[n].end, NS);
  rows((const double *)step + (size_t)NS * WIDTH, trace.span[n].way, NS);
}

static void trace_law(const void *u) {
  if (trace.on && trace.laws < HOLDS_MAX) {
    trace.steps = 0;
    rows(u, trace.law[trace.laws++], MS);
  }
}

static void trace_end(double passed) {
  if (trace.on) {
    trace.end = trace.laws - 1;
    trace.rest = llround(1e9 * passed);
  }
}

/* How far numbers are outside, in parts of their size; not positive: inside. */
static double outside(const row *f, const double *x, const double *eps, int count) {
  double worst = -1.0;
  for (int i = 0; i < count; i++) {
    double at = f[i].c, size = 1.0 + fabs(x[i]);
    for (int k = 0; k < NS; k++) {
      at += f[i].g[k] * eps[k];
    }
    double off = fmax(f[i].lo - x[i], x[i] - f[i].hi);
    if (isfinite(f[i].half)) {
      off = fmax(off, fabs(x[i] - at) - f[i].half);
    }
    off = isnan(off) ? INFINITY : off;
    worst = fmax(worst, off / size);
  }
  return worst;
}

#endif
