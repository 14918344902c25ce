/* soter_apart.h: a batch in a process of its own.
 *
 * Purpose: C of externs may keep anything in memory of its own. A copy of this process, where
 * that C was never loaded, loads it, flies and ends; so each call begins with the memory that a run
 * begins with, also of what C does as it is loaded. What the flights write has to be shared memory.
 * Standard input is empty there: what one flight reads of it the others would miss.
 * Non-goals: what externs keep outside of their process: files, other processes.
 */
#ifndef SOTER_APART_H
#define SOTER_APART_H

#include "soter_batch.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SOTER_APART_GONE (-1)     /* the process ended before it was through */
#define SOTER_APART_CHANGED (-2)  /* C of externs changed how the processor rounds */
#define SOTER_APART_UNLOADED (-3) /* the library cannot be loaded, or lacks what is needed */

/* A compiled program with its batch driver: the file, and what its tables are called there. */
typedef struct {
  const char* path;
  const char* program;
  const char* measured;
} soter_library;

/* soter_batch of a library, whose answer is `done`, or one of the above; `measured` of the order
 * is the library's. Gives what waitpid says of the process; -1: there was none. */
int soter_batch_apart(const soter_library* library, soter_flight* flights, uint32_t count,
                      const soter_order* order, int64_t* done);

#ifdef __cplusplus
}
#endif

#endif
