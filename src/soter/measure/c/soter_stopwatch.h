/* soter_stopwatch.h: how long steps take on this machine.
 *
 * Purpose: `soter measure`: times of single steps of one component, each on a state of its own.
 * Non-goals: bounds; what the times mean; anything that ships.
 */
#ifndef SOTER_STOPWATCH_H
#define SOTER_STOPWATCH_H

#include "soter.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One step of `component` from each of `count` states of `stride` bytes at `from`, which stay as
 * they are; `state` has room for one. What it took, in ns, goes to `took` [count]. Before each the
 * `size` bytes at `swept` are written, so that caches hold little of the program; 0: they keep what
 * they have. */
typedef struct {
  const soter_program* program;
  uint32_t component;
  const void* from;
  size_t stride;
  size_t count;
  void* state;
  unsigned char* swept;
  size_t size;
  int64_t* took;
} soter_timing;

/* Gives how many of the steps faulted. */
uint32_t soter_stopwatch(const soter_timing* t);

#ifdef __cplusplus
}
#endif

#endif
