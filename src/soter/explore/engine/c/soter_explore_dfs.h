/* soter_explore_dfs.h: the stack that depth-first search and iterative deepening share. */
#ifndef SOTER_EXPLORE_DFS_H
#define SOTER_EXPLORE_DFS_H

#include "soter_explore_internal.h"

typedef struct {
  soter_search* s;
  soter_expander expander;
  soter_store store;
  soter_row row; /* which moves: none left for those on the way */
  uint32_t words;
  uint64_t states, turns;
  uint64_t taken; /* successors since the bounds were looked at */
  uint32_t deepest;
  soter_calendar calendar; /* where only ends of instants are stored */
  bool full, broke, by_a_move;
  int64_t beyond; /* the least time of what lies deeper than the bound */
  bool cut;       /* something lies deeper than the bound */
  soter_broken broken;
  uint64_t last[SOTER_WORDS];   /* the configuration that violates */
  uint64_t stored[SOTER_WORDS]; /* what stands for the one that is taken in */
  uint64_t here[SOTER_WORDS];   /* the one that is expanded */
  soter_explore_status status;
} soter_stack;

bool soter_stack_open(soter_stack* t, soter_search* s);
void soter_stack_close(soter_stack* t);
/* Searches configurations of at most `bound` steps. */
void soter_stack_run(soter_stack* t, uint32_t bound);
void soter_stack_sum_up(soter_stack* t, soter_explore_result* r);

#endif
