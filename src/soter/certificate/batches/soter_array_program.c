/* Runs a program over arrays of doubles (recorded_arrays.py), some columns at a time.
 * Purpose: what NumPy does with the same operations, bit for bit.
 * Non-goals: what is computed, and why that is a bound (ball_arrays.py). */
#include "soter_array_program.h"
#include "soter_check.h"

#include <fenv.h>
#include <math.h>
#include <string.h>

enum { ADD, SUBTRACT, MULTIPLY, DIVIDE, MAXIMUM, MINIMUM, LESS, LESS_EQUAL, EQUAL, UNARY };
enum { NEGATIVE = UNARY, ABSOLUTE, SQUARE_ROOT, FLOOR, COPY, WHERE };
enum { WIDE = 64, ROWS = 16384 };

/* Of a row or constant a where `vector`, else its only number. */
#define EACH(x, vector) ((vector) ? (x)[i] : *(x))
#define BOTH(vector_a, vector_b, result) \
  for (int i = 0; i < n; i++) {          \
    const double x = EACH(a, vector_a);  \
    const double y = EACH(b, vector_b);  \
    to[i] = (result);                    \
  }
#define BINARY(name, result) \
  case name:                 \
    if (kinds == 0) {        \
      BOTH(1, 1, result)     \
    } else if (kinds == 1) { \
      BOTH(0, 1, result)     \
    } else {                 \
      BOTH(1, 0, result)     \
    }                        \
    break;
#define ONE_BY_ONE(name, result)  \
  case name:                      \
    for (int i = 0; i < n; i++) { \
      const double x = a[i];      \
      to[i] = (result);           \
    }                             \
    break;

/* `kinds`: bit 0: a is one number, bit 1: b is. */
static void of_two(int code, int n, int kinds, const double* a, const double* b, double* to) {
  SOTER_CHECK(kinds >= 0 && kinds < 3 && n <= WIDE);
  switch (code) {
    BINARY(ADD, x + y)
    BINARY(SUBTRACT, x - y)
    BINARY(MULTIPLY, x * y)
    BINARY(DIVIDE, x / y)
    BINARY(MAXIMUM, ((x >= y) | (x != x)) ? x : y)
    BINARY(MINIMUM, ((x <= y) | (x != x)) ? x : y)
    BINARY(LESS, x < y ? 1.0 : 0.0)
    BINARY(LESS_EQUAL, x <= y ? 1.0 : 0.0)
    BINARY(EQUAL, x == y ? 1.0 : 0.0)
    default:
      SOTER_CHECK(0);
  }
}

static void of_one(int code, int n, const double* a, double* to) {
  SOTER_CHECK(n <= WIDE);
  switch (code) {
    ONE_BY_ONE(NEGATIVE, -x)
    ONE_BY_ONE(ABSOLUTE, fabs(x))
    ONE_BY_ONE(SQUARE_ROOT, sqrt(x))
    ONE_BY_ONE(FLOOR, floor(x))
    ONE_BY_ONE(COPY, x)
    default:
      SOTER_CHECK(0);
  }
}

static void where(int n, const double* a, int one_b, const double* b, int one_c, const double* c,
                  double* to) {
  double left[WIDE], right[WIDE];
  SOTER_CHECK(n <= WIDE);
  for (int i = 0; i < n && one_b; i++) {
    left[i] = *b;
  }
  for (int i = 0; i < n && one_c; i++) {
    right[i] = *c;
  }
  b = one_b ? left : b;
  c = one_c ? right : c;
  for (int i = 0; i < n; i++) {
    const double x = b[i], y = c[i];
    to[i] = a[i] != 0 ? x : y;
  }
}

static const double* row(int32_t at, const double* constants, double* const* rows) {
  SOTER_CHECK(at < ROWS);
  return at < 0 ? &constants[~at] : rows[at];
}

static void columns_of(const soter_array_program* p, double* const* rows, int n) {
  SOTER_CHECK(n >= 1 && n <= WIDE);
  for (int32_t k = 0; k < p->operations; k++) {
    const soter_array_operation* o = &p->all[k];
    const double* a = row(o->a, p->constants, rows);
    if (o->code < UNARY) {
      of_two(o->code, n, (o->a < 0 ? 1 : 0) | (o->b < 0 ? 2 : 0), a, row(o->b, p->constants, rows),
             rows[o->to]);
    } else if (o->code < WHERE) {
      of_one(o->code, n, a, rows[o->to]);
    } else {
      where(n, a, o->b < 0, row(o->b, p->constants, rows), o->c < 0, row(o->c, p->constants, rows),
            rows[o->to]);
    }
  }
}

/* Each of `in` has `columns` numbers, `out` a row of as many for each output, `scratch` a row of
 * WIDE for each between. Gives -1 if there are too many rows, 1 if something underflowed. */
int soter_array_run(const soter_array_program* p, int64_t columns, const double* const* in,
                    double* out, double* scratch) {
  double* rows[ROWS];
  const int32_t inputs = p->inputs, outputs = p->outputs;
  SOTER_CHECK(columns >= 0);
  if (inputs + outputs + p->between > ROWS) {
    return -1;
  }
  for (int32_t k = 0; k < p->between; k++) {
    rows[inputs + outputs + k] = scratch + (int64_t)k * WIDE;
  }
  (void)feclearexcept(FE_UNDERFLOW);
  for (int64_t at = 0; at < columns; at += WIDE) {
    for (int32_t k = 0; k < inputs; k++) {
      rows[k] = (double*)(uintptr_t)(in[k] + at);
    }
    for (int32_t k = 0; k < outputs; k++) {
      rows[inputs + k] = out + (int64_t)k * columns + at;
    }
    columns_of(p, rows, columns - at < WIDE ? (int)(columns - at) : WIDE);
  }
  SOTER_CHECK(p->operations >= 0);
  return fetestexcept(FE_UNDERFLOW) != 0;
}
