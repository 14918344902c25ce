/* soter_posix_status.c: what the trusted part says of itself.
 *
 * Purpose: the words of soter_status.h in their channel, as often as they say. Without a folder of
 * channels, or modules, nothing is said.
 * Non-goals: the report at the end (soter_posix_report.c).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_posix.h"

uint32_t soter_posix_modes(soter_posix* d) {
  const soter_module* const m = soter_modules_of(APP_PROGRAM, &d->state);
  uint32_t modes = 0;
  for (uint32_t i = 0; i < APP_PROGRAM->modules && i < 32U; i++) {
    SOTER_CHECK(m[i].mode == SOTER_AC || m[i].mode == SOTER_SC);
    modes |= m[i].mode == SOTER_AC ? 1U << i : 0U;
  }
  return modes;
}

static uint64_t* of_modules(soter_posix* d, uint64_t* to, uint32_t modes) {
  for (uint32_t k = 0; k < APP_PROGRAM->modules; k++) {
    to[SOTER_STATUS_MODE] = k < 32U ? (modes >> k) & 1U : 0U;
    to[SOTER_STATUS_SURE] = soter_posix_surely_ac(d, k);
    to[SOTER_STATUS_SAFER] = soter_posix_safer(d, k) ? 1U : 0U;
    to[SOTER_STATUS_WHY] = d->why[k];
    for (uint32_t c = 0; c < SOTER_STATUS_CAUSES; c++) {
      to[SOTER_STATUS_TAKEOVERS + c] = d->takeovers[k][c];
    }
    to += SOTER_STATUS_MODULE;
  }
  return to;
}

/* With which reading the leases of a module ended, the first of its nodes; NULL: with none. */
static const soter_old_read* ended_with(const soter_lease_times* t, uint32_t nodes) {
  SOTER_CHECK(nodes <= APP_BUDGETS);
  for (uint32_t n = 0; n < nodes && t->ended_ns >= 0; n++) {
    if (t->old[n].of != NULL) {
      return &t->old[n];
    }
  }
  return NULL;
}

static void of_old_read(const soter_old_read* old, uint64_t* to) {
  uint32_t k = 0;
  SOTER_CHECK(old->of != NULL);
  while (k < soter_app_outside_count && soter_app_outside[k].topic != old->of->topic) {
    k++;
  }
  to[SOTER_STATUS_OLD_TOPIC] = 1U + k;
  to[SOTER_STATUS_OLD_NS] = (uint64_t)old->age_ns;
  to[SOTER_STATUS_OLD_MOST_NS] = (uint64_t)old->of->most_ns;
}

static uint64_t* of_leases(const soter_posix* d, uint64_t* to) {
  for (uint32_t k = 0; k < soter_app_lease_count; k++) {
    to[SOTER_STATUS_GIVEN] = d->lease[k].given;
    to[SOTER_STATUS_STALE] = d->lease[k].stale;
    to[SOTER_STATUS_ENDED] = d->lease[k].ended_ns >= 0 ? 1U : 0U;
    const soter_old_read* const old = ended_with(&d->lease[k], soter_app_leases[k].grant->nodes);
    to[SOTER_STATUS_OLD_TOPIC] = 0U;
    if (old != NULL) {
      of_old_read(old, to);
    }
    to += SOTER_STATUS_LEASE;
  }
  return to;
}

static uint64_t* of_topics(const soter_posix* d, uint64_t* to) {
  for (uint32_t k = 0; k < soter_app_outside_count; k++) {
    const soter_outside_times* const o = &d->outside[k];
    to[SOTER_STATUS_TOLD] = o->told;
    to[SOTER_STATUS_TAKEN] = o->taken;
    to[SOTER_STATUS_REFUSED] = o->refused;
    to[SOTER_STATUS_OLDER] = o->older;
    to[SOTER_STATUS_FUTURE] = o->future;
    to[SOTER_STATUS_BAD] = o->bad;
    to += SOTER_STATUS_TOPIC;
  }
  return to;
}

void soter_posix_status(soter_posix* d, uint32_t modes) {
  if (d->status_channel.place[0] == NULL) {
    return;
  }
  const int64_t now = soter_posix_clock();
  const int64_t least_ns = d->looked ? SOTER_STATUS_LOOK_NS : SOTER_STATUS_EVERY_NS;
  if (modes == d->said_modes && now - d->said_ns < least_ns) {
    return;
  }
  d->said[SOTER_STATUS_INSTANTS] = d->instants;
  d->said[SOTER_STATUS_MISSED] = d->missed;
  d->said[SOTER_STATUS_CALENDARS] = d->calendars;
  const uint64_t* const end =
      of_topics(d, of_leases(d, of_modules(d, d->said + SOTER_STATUS_HEAD, modes)));
  SOTER_CHECK(end == d->said + sizeof d->said / sizeof d->said[0]);
  (void)end;
  soter_outside_write(&d->status_channel, now, d->said);
  d->said_modes = modes;
  d->said_ns = now;
  d->looked = false;
}
