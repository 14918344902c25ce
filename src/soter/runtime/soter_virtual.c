/* soter_virtual.c: the virtual-time driver.
 *
 * Purpose: run instants as fast as the machine can, in the deployed order, with the environment's
 * inputs drawn by chance, and copy the state after each where a trace is wanted.
 * Non-goals: clocks; answering extern steps (the caller does).
 */
#include "soter.h"

#include <string.h>

soter_status soter_virtual_instant(const soter_program* p, void* state, uint32_t* due) {
  SOTER_CHECK(p != NULL);
  const soter_header* const h = soter_header_of(state);
  if (h->firing == 0U) {
    soter_progress(p, state);
    for (uint32_t i = 0; i < p->inputs; i++) { /* before anything else at this instant */
      if (h->ct % p->input[i].every_ns == 0) {
        p->input[i].draw(state, NULL);
      }
    }
  }
  return soter_instant(p, state, due);
}

soter_run_status soter_run(const soter_program* p, void* state, int64_t until_ns, void* trace,
                           size_t room, size_t* written, uint32_t* due) {
  SOTER_CHECK(p != NULL);
  SOTER_CHECK(written != NULL);
  uint8_t* const out = (uint8_t*)trace;
  const soter_header* const h = soter_header_of(state);
  *written = 0;
  while (h->firing != 0U || soter_next_instant(p, state) <= until_ns) {
    if (trace != NULL && *written == room) {
      return SOTER_RUN_FULL;
    }
    if (soter_virtual_instant(p, state, due) == SOTER_EXTERN_DUE) {
      return SOTER_RUN_EXTERN;
    }
    if (trace != NULL) {
      (void)memcpy(out + *written * p->state_size, state, p->state_size);
      (*written)++;
    }
  }
  return SOTER_RUN_END;
}
