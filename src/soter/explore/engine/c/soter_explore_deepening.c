/* soter_explore_deepening.c: iterative deepening.
 *
 * Purpose: shortest counterexamples with the memory of depth-first search: a search up to 1, 2, 3,
 * ... steps, each from an empty table. How many steps a configuration takes to reach does not
 * depend on the way (every step counts a release), but for overruns, which lose several at a time.
 */
#include "soter_explore_dfs.h"

/* Whether a deeper round would find nothing else, or cannot be. */
static bool is_last(const soter_stack* t) {
  return !t->cut || t->status != SOTER_EXHAUSTED || (t->broke && !t->s->o->go_on);
}

static void keep_configurations(const soter_search* s, soter_stack* t) {
  if (s->o->keep && s->o->storage == SOTER_EXACT) {
    s->result->kept = soter_keep(NULL, &t->store);
  }
}

void soter_search_deepening(soter_search* s) {
  for (uint32_t bound = 1U;; bound++) {
    soter_stack t;
    const bool opened = soter_stack_open(&t, s);
    SOTER_CHECK(bound >
                0U); /* no configuration is that deep: a round that cuts nothing comes before */
    if (opened) {
      s->result->states = 0U; /* of the last round; transitions of all */
      soter_stack_run(&t, bound);
      soter_stack_sum_up(&t, s->result);
    } else {
      s->result->status = SOTER_NO_MEMORY;
    }
    const bool last = !opened || is_last(&t);
    if (last && opened) {
      keep_configurations(s, &t);
    }
    soter_stack_close(&t);
    if (last) {
      return;
    }
  }
}
