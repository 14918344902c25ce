/* soter_lease.c: what an actuator obeys, and until when. See soter_lease.h.
 *
 * Purpose: one state machine of three states, and one place where a lease ends: by time, or as what
 * is remembered of it can be no lease. Then the law is read: SOTER_CHECK would end who obeys it.
 * Non-goals: everything else; this file is the whole of the actuator side, beside a constant.
 */
#include "soter_lease.h"

#include <string.h>

/* Whether a command is obeyed at `seen`; false where memory was overwritten so that no take could
 * have left it. */
static bool in_force(const soter_lease* lease) {
  return lease->state == SOTER_LEASE_HOLDS && lease->stamp >= 0 && lease->stamp <= lease->seen &&
         lease->seen <= lease->until && lease->until - lease->stamp <= lease->info->longest;
}

/* The time, never less than it was told before; at an instant after its end a lease has ended. */
static int64_t at(soter_lease* lease, int64_t now) {
  if (now > lease->seen) {
    lease->seen = now;
  }
  if (lease->state != SOTER_LEASE_ARMED && !in_force(lease)) {
    lease->state = SOTER_LEASE_ENDED;
  }
  return lease->seen;
}

void soter_lease_init(soter_lease* lease, const soter_lease_info* info, void* command) {
  lease->info = info;
  lease->command = command;
  lease->seen = INT64_MIN;
  memcpy(command, info->law, info->size);
  soter_lease_arm(lease);
}

void soter_lease_arm(soter_lease* lease) {
  lease->until = INT64_MIN;
  lease->stamp = INT64_MIN;
  lease->state = SOTER_LEASE_ARMED;
}

soter_arm soter_lease_may_arm(const soter_lease* lease, int64_t now, int64_t stamp, int64_t expiry,
                              int64_t begin) {
  const int64_t time = now > lease->seen ? now : lease->seen;
  if (stamp < 0 || stamp > time || expiry < time || expiry - stamp > lease->info->longest) {
    return SOTER_ARM_SILENT;
  }
  return begin < time ? SOTER_ARM_STATE : SOTER_ARM_FINE;
}

bool soter_lease_take(soter_lease* lease, int64_t now, const void* command, int64_t stamp,
                      int64_t expiry) {
  const int64_t time = at(lease, now);
  if (lease->state == SOTER_LEASE_ENDED || stamp < 0 || stamp > time || stamp < lease->stamp) {
    return false;
  }
  if (expiry < time || expiry < lease->until || expiry - stamp > lease->info->longest) {
    return false;
  }
  memcpy(lease->command, command, lease->info->size);
  lease->until = expiry;
  lease->stamp = stamp;
  lease->state = SOTER_LEASE_HOLDS;
  return true;
}

bool soter_lease_read(soter_lease* lease, int64_t now, void* command) {
  (void)at(lease, now);
  if (lease->state == SOTER_LEASE_HOLDS) {
    memcpy(command, lease->command, lease->info->size);
    return true;
  }
  memcpy(command, lease->info->law, lease->info->size);
  return false;
}
