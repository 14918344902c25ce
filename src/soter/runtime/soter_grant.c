/* soter_grant.c: who gives leases, and when nobody does any more. See soter_grant.h.
 *
 * Purpose: deadlines of releases, and one flag that is never taken back.
 * Non-goals: as there.
 */
#include "soter_grant.h"

#include "soter_check.h"

#include <stddef.h>

enum { DM = 0, SC = 1 };

void soter_grant_init(soter_grant* grant, const soter_grant_info* info, int64_t* done) {
  soter_grant_begin(grant, info, done, 0);
}

void soter_grant_begin(soter_grant* grant, const soter_grant_info* info, int64_t* done,
                       int64_t origin) {
  SOTER_CHECK(info != NULL && done != NULL && info->nodes > SC);
  grant->info = info;
  grant->origin = origin;
  grant->done = done;
  grant->spoken[0] = INT64_MIN;
  grant->spoken[1] = INT64_MIN;
  grant->broken = false;
  for (uint32_t k = 0; k < info->nodes; k++) {
    SOTER_CHECK(info->node[k].period > 0);
    done[k] = 0;
  }
}

int64_t soter_grant_next(const soter_grant* grant, uint32_t node) {
  SOTER_CHECK(node < grant->info->nodes && grant->done[node] >= 0);
  const soter_budget* const b = &grant->info->node[node];
  return grant->origin + b->phase + grant->done[node] * b->period;
}

int64_t soter_grant_starts_by(const soter_grant* grant, uint32_t node) {
  const int64_t release = soter_grant_next(grant, node);
  const int64_t own = release + grant->info->node[node].late;
  const soter_budget* const dm = &grant->info->node[DM];
  const int64_t first = grant->origin + dm->phase;
  if (node != SC || first > release) {
    return own;
  }
  const int64_t last = release - (release - first) % dm->period;
  const int64_t verdict = last + dm->late + dm->response; /* SC waits for it */
  return verdict > own ? verdict : own;
}

int64_t soter_grant_due(const soter_grant* grant, uint32_t node) {
  SOTER_CHECK(node < grant->info->nodes);
  return soter_grant_starts_by(grant, node) + grant->info->node[node].response;
}

/* Whether SC starts at `start` after every verdict that is due by its release. One more may be out
 * by now; where there are two, SC is late by any reckoning. */
static bool after_verdicts(const soter_grant* grant, int64_t start) {
  const soter_budget* const dm = &grant->info->node[DM];
  const int64_t since = soter_grant_next(grant, SC) - grant->origin - dm->phase;
  const int64_t due = since < 0 ? 0 : since / dm->period + 1;
  const int64_t more = grant->done[DM] - due;
  return (more == 0 || more == 1) && start >= grant->spoken[more];
}

bool soter_grant_done(soter_grant* grant, uint32_t node, int64_t start, int64_t out) {
  const bool early = start < soter_grant_next(grant, node) || out < start;
  const bool late = start > soter_grant_starts_by(grant, node);
  if (early || late || out - start > grant->info->node[node].response ||
      (node == SC && !after_verdicts(grant, start))) {
    grant->broken = true;
  }
  if (node == DM) {
    grant->spoken[1] = grant->spoken[0];
    grant->spoken[0] = out;
  }
  grant->done[node]++;
  return !grant->broken;
}

bool soter_grant_lease(soter_grant* grant, int64_t now, int64_t* stamp, int64_t* expiry) {
  SOTER_CHECK(stamp != NULL && expiry != NULL);
  for (uint32_t k = 0; k < grant->info->nodes; k++) {
    if (soter_grant_due(grant, k) < now) {
      grant->broken = true;
    }
  }
  if (grant->broken || grant->done[SC] == 0) {
    return false;
  }
  *stamp = soter_grant_next(grant, SC) - grant->info->node[SC].period;
  *expiry = soter_grant_due(grant, SC);
  return true;
}
