/* soter_explore.c: the explorer's door.
 *
 * Purpose: choose the strategy, begin and end in order.
 * Non-goals: everything else (soter_explore_internal.h says where it is).
 */
#include "soter_explore_internal.h"

/* By name: a strategy that was forgotten here ends the process, and none stands in for another. */
static void search(soter_search* s) {
  switch (s->o->strategy) {
    case SOTER_BFS:
      soter_search_bfs(s);
      return;
    case SOTER_RANDOM:
      soter_search_random(s);
      return;
    case SOTER_FALSIFY:
      soter_search_falsify(s);
      return;
  }
  SOTER_CHECK(false && "a strategy without a search");
}

#define BIRTHS 65536U /* that are looked at; with more it is not known */

bool soter_explore_starts_broken(const soter_model* m, soter_explore_progress* progress) {
  soter_workspace space;
  bool broken = !soter_workspace_open(&space, m, NULL, progress, NULL);
  if (!broken) {
    uint32_t births = 0U;
    space.given = 0U;
    do {
      soter_make_start(&space);
      broken = broken || ++births > BIRTHS;
      for (uint32_t i = 0; i < space.p->properties; i++) {
        const soter_property_info* const q = &space.p->property[i];
        broken = broken || (q->when == SOTER_AT_INSTANT && q->violated(space.there));
      }
    } while (!broken && soter_next_picks(&space));
    broken = broken || space.cut || space.too_many;
  }
  soter_workspace_close(&space);
  return broken;
}

void soter_explore(const soter_model* m, const soter_explore_options* o,
                   soter_explore_progress* progress, soter_explore_coverage* coverage,
                   soter_explore_result* result, soter_trace_step* trace, uint32_t room) {
  (void)memset(result, 0, sizeof *result);
  soter_search s = {m, o, progress, coverage, result, trace, room};
  result->threads = 1U;
  if (m->words > SOTER_WORDS) {
    result->status = SOTER_WIDE;
    return;
  }
  search(&s);
  progress->states = result->states;
  progress->transitions = result->transitions;
  progress->depth = result->depth;
}
