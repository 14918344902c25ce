/* soter_firmware.c: a program in somebody's own loop.
 *
 * Purpose: the time that is told, checked and made the program's; values from outside, stamped;
 * instants as they come due, and how late they were.
 * Non-goals: clocks, threads, waiting; types and names (the generated NAME_firmware.c).
 */
#include "soter_firmware.h"

#include <string.h>

/* Differences of times between these never overflow: 146 years either way. */
#define CLOCK_MOST (INT64_C(1) << 61)

static bool tellable(int64_t time) {
  return time >= -CLOCK_MOST && time <= CLOCK_MOST;
}

const char* soter_firmware_start(soter_firmware* f, const soter_program* p, void* state,
                                 uint64_t seed, int64_t now) {
  SOTER_CHECK(f != NULL);
  SOTER_CHECK(p != NULL);
  f->program = NULL;
  const char* const wrong = soter_self_test(p);
  if (wrong != NULL) {
    return wrong;
  }
  if (!tellable(now)) {
    return "the time of the start is more than 73 years from the zero of its clock";
  }
  soter_start(p, state, seed);
  f->program = p;
  f->origin = now;
  f->now = now;
  f->lateness = 0;
  f->latest = 0;
  f->late_steps = 0;
  f->behind_steps = 0;
  f->stale_steps = 0;
  return NULL;
}

int64_t soter_firmware_next(const soter_firmware* f, const void* state) {
  SOTER_CHECK(f != NULL);
  if (f->program == NULL) {
    return INT64_MAX;
  }
  const int64_t next = soter_next_instant(f->program, state);
  return next > CLOCK_MOST ? INT64_MAX : f->origin + next;
}

bool soter_firmware_stamp(const soter_firmware* f, int64_t stamp, int64_t* time) {
  const bool published = f->program != NULL && stamp != SOTER_NEVER;
  if (time != NULL) {
    *time = published ? f->origin + stamp : SOTER_NEVER;
  }
  return published;
}

static soter_taken taken_of(soter_fault fault) {
  switch (fault) {
    case SOTER_OK:
      return SOTER_TAKEN;
    case SOTER_NONFINITE:
      return SOTER_NOT_FINITE;
    case SOTER_RANGE:
      return SOTER_NOT_IN_SET;
    default:
      return SOTER_NO_VALUE;
  }
}

soter_taken soter_firmware_publish(soter_firmware* f, void* state, uint32_t topic,
                                   const void* value, int64_t measured, int64_t now) {
  SOTER_CHECK(f != NULL);
  if (f->program == NULL) {
    return SOTER_NOT_STARTED;
  }
  if (now < f->now || !tellable(now)) {
    return SOTER_BACKWARDS;
  }
  f->now = now;
  if (measured > now) {
    return SOTER_FROM_FUTURE;
  }
  const int64_t stamp = soter_stamps_of(f->program, state)[topic];
  const int64_t next = soter_next_instant(f->program, state);
  int64_t at = tellable(measured) ? measured - f->origin : SOTER_NEVER;
  if (at > next) {
    at = next;
  }
  if (at < stamp || at <= SOTER_NEVER) {
    return SOTER_OLDER;
  }
  return taken_of(soter_publish(f->program, state, topic, value, at));
}

/* ------------------------------------------------------------------ instants */

/* Whether something that is due now runs later than it may. */
static bool too_late(const soter_firmware* f, const void* state, int64_t instant, int64_t behind) {
  const soter_component* const c = (const soter_component*)((const soter_header*)state + 1);
  bool late = false;
  for (uint32_t i = 0; i < f->program->components; i++) {
    late = late || (c[i].next == instant && f->late[i] >= 0 && behind > f->late[i]);
  }
  return late;
}

/* Whether something that is due now reads what is older than it may be. What was never published is
 * another matter: SOTER_UNHEARD. */
static bool too_old(const soter_firmware* f, void* state, int64_t instant) {
  const soter_component* const c = soter_components_of(state);
  const int64_t* const stamps = soter_stamps_of(f->program, state);
  bool old = false;
  for (uint32_t i = 0; i < f->age_count; i++) {
    const soter_read_age* const a = &f->ages[i];
    const int64_t stamp = stamps[a->topic];
    const bool due = c[a->component].next == instant && stamp != SOTER_NEVER;
    old = old || (due && instant - stamp > a->most);
  }
  return old;
}

static uint32_t run_instant(const soter_firmware* f, void* state) {
  uint32_t due = 0;
  uint32_t said = 0;
  while (soter_instant(f->program, state, &due) == SOTER_EXTERN_DUE) {
    soter_answer(f->program, state, due, SOTER_EXTERN_FAULT, NULL);
    said = SOTER_NO_ANSWER;
  }
  return said;
}

static uint32_t what_holds(const soter_firmware* f, void* state) {
  uint32_t said = 0;
  const int64_t* const stamps = soter_stamps_of(f->program, state);
  for (uint32_t i = 0; i < f->outside_count; i++) {
    said |= stamps[f->outside[i]] == SOTER_NEVER ? SOTER_UNHEARD : 0U;
  }
  const soter_component* const c = soter_components_of(state);
  for (uint32_t i = 0; i < f->program->components; i++) {
    said |= c[i].latched != 0U ? SOTER_LATCHED : 0U;
  }
  return said;
}

/* Everything up to `time`; notes the greatest lateness. */
static uint32_t run_until(soter_firmware* f, void* state, int64_t time) {
  uint32_t said = 0;
  int64_t next = soter_next_instant(f->program, state);
  while (next <= time) {
    const int64_t behind = time - next;
    if (behind > f->lateness) {
      f->lateness = behind;
    }
    said |= (said & SOTER_RAN) != 0U ? SOTER_BEHIND : SOTER_RAN;
    said |= too_late(f, state, next, behind) ? SOTER_LATE : 0U;
    said |= too_old(f, state, next) ? SOTER_STALE : 0U;
    said |= run_instant(f, state);
    next = soter_next_instant(f->program, state);
  }
  return said;
}

static void count(soter_firmware* f, uint32_t said) {
  if (f->lateness > f->latest) {
    f->latest = f->lateness;
  }
  f->late_steps += (said & SOTER_LATE) != 0U ? 1U : 0U;
  f->behind_steps += (said & SOTER_BEHIND) != 0U ? 1U : 0U;
  f->stale_steps += (said & SOTER_STALE) != 0U ? 1U : 0U;
}

uint32_t soter_firmware_step(soter_firmware* f, void* state, int64_t now) {
  SOTER_CHECK(f != NULL);
  if (f->program == NULL) {
    return SOTER_REFUSED;
  }
  if (now < f->now || !tellable(now)) {
    return SOTER_TIME_BACKWARDS;
  }
  const uint32_t unheard = what_holds(f, state) & SOTER_UNHEARD; /* what instants could not read */
  f->now = now;
  f->lateness = 0;
  const uint32_t said = run_until(f, state, now - f->origin);
  count(f, said);
  return said | unheard | (what_holds(f, state) & SOTER_LATCHED);
}
