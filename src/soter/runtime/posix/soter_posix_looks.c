/* soter_posix_looks.c: what the last look of a DM found, and until when that counts.
 *
 * Purpose: for how long AC surely keeps control, and whether actuators that hold the law may begin
 * to obey in this state. Non-goals: deciding modes (the kernel), telling it (soter_posix_status.c,
 * soter_posix_world.c).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_posix.h"

int64_t soter_posix_late_limit(const soter_posix* d, uint32_t component) {
  SOTER_CHECK(component < APP_PROGRAM->components);
  return d->options.late_ns >= 0 ? d->options.late_ns : soter_app_late_ns[component];
}

/* A DM has looked: until when what it found counts. */
void soter_posix_looked(soter_posix* d, uint32_t component) {
  const int32_t module = APP_PROGRAM->component[component].module;
  const int64_t next = soter_components_of(&d->state)[component].next;
  SOTER_CHECK(module >= 0 && module < APP_MODULES);
  SOTER_CHECK(next > soter_header_of(&d->state)->ct);
  d->next_look_ns[module] = d->origin_ns + next;
  d->looked = true;
}

bool soter_posix_safer(soter_posix* d, uint32_t module) {
  SOTER_CHECK(module < APP_PROGRAM->modules);
  const soter_module* const m = soter_modules_of(APP_PROGRAM, &d->state) + module;
  return d->next_look_ns[module] != SOTER_NEVER && m->safer != 0U && m->stale == 0U;
}

/* Until when the DM surely leaves control with AC, by what its last look found: `margin` of the
 * language, counted from the release, for every module. 0 in mode SC. */
uint64_t soter_posix_surely_ac(soter_posix* d, uint32_t module) {
  const soter_module* const m = soter_modules_of(APP_PROGRAM, &d->state) + module;
  const soter_module_info* const info = &APP_PROGRAM->module[module];
  const bool unsafe = m->ttf != 0U || m->stale != 0U || m->saw_gate_fault != 0U;
  const int64_t next_ns = d->next_look_ns[module];
  SOTER_CHECK(soter_app_looks[module] >= 1U);
  if (m->mode != SOTER_AC || unsafe || next_ns == SOTER_NEVER) {
    return 0;
  }
  const bool long_safe = m->safer != 0U && m->gate_fault == 0U; /* a fault since: the next look */
  const int64_t more = long_safe ? (int64_t)soter_app_looks[module] - 1 : 0;
  const int64_t until = next_ns + more * info->period_ns - soter_posix_late_limit(d, info->dm);
  return until > 0 ? (uint64_t)until : 0U;
}

/* Until when actuators that hold the law may begin to obey: the last look of every DM found
 * `safer`, so the state is one at which AC could be given control; until the next look SC's next
 * output is early enough (docs/proof.md, "Arming"). */
int64_t soter_posix_begin_by(soter_posix* d) {
  int64_t first = INT64_MAX;
  SOTER_CHECK(APP_PROGRAM->modules > 0U);
  for (uint32_t i = 0; i < APP_PROGRAM->modules; i++) {
    const int64_t until = soter_posix_safer(d, i) ? d->next_look_ns[i] : SOTER_NEVER;
    first = until < first ? until : first;
  }
  return first;
}
