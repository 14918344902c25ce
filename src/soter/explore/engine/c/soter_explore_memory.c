/* soter_explore_memory.c: memory for what grows.
 *
 * Purpose: give what has been outgrown back to the machine at once. In the heap it would leave
 * holes that nothing larger fits into, and the process would take far more than `memory` says.
 * Large pieces are pages of their own, therefore; small ones come from the heap.
 * Non-goals: how much memory a search may take (soter_explore_bfs.c counts that).
 */
#define _GNU_SOURCE /* mremap */
#include "soter_explore_memory.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "soter_check.h"

#define PAGES 16384U /* bytes: pieces as large as this are pages of their own */

void* soter_allocate(uint64_t bytes) {
  if (bytes < PAGES) {
    return calloc(bytes, 1U);
  }
  void* const found = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  return found == MAP_FAILED ? NULL : found;
}

void soter_free(void* piece, uint64_t bytes) {
  if (bytes < PAGES || piece == NULL) {
    free(piece);
  } else {
    (void)munmap(piece, bytes);
  }
}

void* soter_reallocate(void* piece, uint64_t before, uint64_t bytes) {
  SOTER_CHECK(bytes >= before);
#if defined(__linux__)
  if (piece != NULL && before >= PAGES) {
    void* const moved = mremap(piece, before, bytes, MREMAP_MAYMOVE);
    return moved == MAP_FAILED ? NULL : moved;
  }
#endif
  void* const larger = soter_allocate(bytes);
  if (larger != NULL && piece != NULL) {
    (void)memcpy(larger, piece, before);
    soter_free(piece, before);
  }
  return larger;
}
