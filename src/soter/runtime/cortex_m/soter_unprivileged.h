/* soter_unprivileged.h: untrusted steps on a core without processes.
 *
 * Purpose: one thread, without privileges, behind the MPU, in which extern nodes compute while the
 * trusted part is done; it may loop, divide by zero, overflow its stack, write anywhere: nothing
 * but its own answer is lost. Non-goals: budgets (soter_loop.c ends a step), what an answer says
 * (gate).
 *
 * Memory of the thread lies in one region (`soter_ac`, linker script), a power of two. It reads
 * flash.
 */
#ifndef SOTER_UNPRIVILEGED_H
#define SOTER_UNPRIVILEGED_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A step: 0 is success. */
typedef int soter_unprivileged_step(const void* in, void* out);

typedef enum {
  SOTER_UNPRIVILEGED_IDLE = 0,
  SOTER_UNPRIVILEGED_RUNS = 1,
  SOTER_UNPRIVILEGED_DONE = 2, /* `soter_unprivileged_result` says how */
  SOTER_UNPRIVILEGED_FAULT = 3 /* the core stopped it */
} soter_unprivileged_state;

/* MPU, traps, priorities of faults; before interrupts. */
void soter_unprivileged_protect(void);

/* From `main`: becomes the thread, which waits. Does not return. */
#if defined(__GNUC__)
__attribute__((noreturn))
#endif
void soter_unprivileged_become(void);

/* In an interrupt whose return is soter_unprivileged_return: begins a step, or ends whatever runs.
 */
void soter_unprivileged_begin(soter_unprivileged_step* step, const void* in, void* out);
void soter_unprivileged_end(void);

soter_unprivileged_state soter_unprivileged_now(void);
int soter_unprivileged_result(void);

/* What an interrupt that was given `from` (its EXC_RETURN) has to return to. */
uint32_t soter_unprivileged_return(uint32_t from);

/* The core stopped the thread: what the interrupt that says so has to return to. */
uint32_t soter_unprivileged_stopped(uint32_t from);

#ifdef __cplusplus
}
#endif

#endif
