/* soter_lockstep.h: several worlds of one program that take their instants together.
 *
 * Purpose: instants of as many worlds as there are lanes, in the meaning of soter_virtual_instant;
 * what is released in all of them at the same time is looked up once, and steps that have lanes
 * are computed for all at once.
 * Non-goals: programs with steps that last, of an order that is left to chance, or with externs.
 */
#ifndef SOTER_LOCKSTEP_H
#define SOTER_LOCKSTEP_H

#include "soter_batch.h"

#define SOTER_LOCKSTEP_WORLDS 8U
#define SOTER_LOCKSTEP_COMPONENTS 256U
/* So many releases of a component are not tried together, at most. */
#define SOTER_LOCKSTEP_PAUSE 255U

typedef struct {
  const soter_program* p;
  const soter_lane_table* lanes;
  uint32_t worlds;
  void* state[SOTER_LOCKSTEP_WORLDS];
  soter_component* component[SOTER_LOCKSTEP_WORLDS]; /* of each state, as the two below */
  soter_module* module[SOTER_LOCKSTEP_WORLDS];
  soter_property* property[SOTER_LOCKSTEP_WORLDS];
  int64_t next[SOTER_LOCKSTEP_COMPONENTS];   /* of each component whose releases nothing moves */
  uint32_t moved[SOTER_LOCKSTEP_COMPONENTS]; /* the others */
  uint32_t moves;
  bool is_moved[SOTER_LOCKSTEP_COMPONENTS];
  uint32_t pause[SOTER_LOCKSTEP_COMPONENTS]; /* so many releases are not tried together */
  uint32_t alone[SOTER_LOCKSTEP_COMPONENTS]; /* so many were not, last */
} soter_lockstep;

/* Whether the worlds of a program can go in step. */
bool soter_lockstep_fits(const soter_program* p, const soter_lane_table* lanes);

/* A group of `lanes->count` worlds that have been started, at `states`. */
void soter_lockstep_start(soter_lockstep* g, const soter_program* p, const soter_lane_table* lanes,
                          void* const* states);

/* The next instant that all of them take together. */
int64_t soter_lockstep_next(const soter_lockstep* g);

/* The next release that is moved in one of them: before the instant of all of them, or at the same
 * time, it takes that instant alone. */
int64_t soter_lockstep_alone(const soter_lockstep* g, uint32_t world);

/* The instant of all of them at `ct`, which soter_lockstep_next said. */
void soter_lockstep_instant(soter_lockstep* g, int64_t ct);

#endif
