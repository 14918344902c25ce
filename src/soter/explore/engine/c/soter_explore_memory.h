/* soter_explore_memory.h: memory for what grows (not for drivers).
 *
 * Purpose: pieces that go back to the machine at once. Non-goals: what is in them.
 */
#ifndef SOTER_EXPLORE_MEMORY_H
#define SOTER_EXPLORE_MEMORY_H

#include <stdint.h>

/* Zeros; NULL: there is no memory. */
void* soter_allocate(uint64_t bytes);
/* The same with more room; NULL: there is no memory, and it is as it was. */
void* soter_reallocate(void* piece, uint64_t before, uint64_t bytes);
void soter_free(void* piece, uint64_t bytes);

#endif
