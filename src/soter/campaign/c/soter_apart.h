/* soter_apart.h: a batch in a process of its own.
 *
 * Purpose: C of externs may keep anything in memory of its own. A copy of this process, in which
 * none of it was called before, flies and ends; so each call begins with the memory that a run
 * begins with. What the flights write has to be shared memory.
 * Non-goals: what externs keep outside of their process: files, other processes.
 */
#ifndef SOTER_APART_H
#define SOTER_APART_H

#include "soter_batch.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SOTER_APART_GONE (-1)    /* the process ended before it was through */
#define SOTER_APART_CHANGED (-2) /* C of externs changed how the processor rounds */

/* soter_batch, whose answer is `done`, or one of the above. Gives what waitpid says of the process;
 * -1: there was none. */
int soter_batch_apart(const soter_program* p, soter_flight* flights, uint32_t count,
                      const soter_order* order, int64_t* done);

#ifdef __cplusplus
}
#endif

#endif
