/* Programs over arrays of doubles: straight lines of operations, every one rounded once.
 *
 * An operand is the number of a row, or ~k for the kth constant. Rows are first those of `in`, then
 * those of `out`, then ones for what is between. What is true is 1.0, what is false 0.0. */
#ifndef SOTER_ARRAY_PROGRAM_H
#define SOTER_ARRAY_PROGRAM_H

#include <stdint.h>

typedef struct {
  int32_t code, to, a, b, c;
} soter_array_operation;

typedef struct {
  const soter_array_operation* all;
  const double* constants;
  int32_t operations, inputs, outputs, between; /* rows of each kind */
} soter_array_program;

int soter_array_run(const soter_array_program* p, int64_t columns, const double* const* in,
                    double* out, double* scratch);

#endif
