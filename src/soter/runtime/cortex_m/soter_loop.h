/* soter_loop.h: what the time-triggered loop needs to know of a program; soter_app.c has it.
 *
 * Purpose: extern nodes with their budgets, modules with leases. Non-goals: how they are run
 * (soter_loop.c).
 */
#ifndef SOTER_LOOP_H
#define SOTER_LOOP_H

#include "soter_firmware.h"
#include "soter_grant.h"
#include "soter_lease.h"
#include "soter_unprivileged.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  uint32_t component;
  int64_t budget_ns;
  void (*gather)(const void* state, void* in);
  soter_unprivileged_step* step;
} soter_loop_extern;

/* A module with a fail-safe law. */
typedef struct {
  uint32_t module;
  const soter_lease_info* lease;
  const soter_grant_info* grant;
  const uint32_t* components; /* of each node of the grant */
  const soter_read_age* ages; /* how old what its SC reads may be */
  uint32_t age_count;
  void (*gather)(const void* state, void* command);
} soter_loop_lease;

extern const soter_loop_extern soter_app_externs[];
extern const uint32_t soter_app_extern_count;
extern const soter_loop_lease soter_app_leases[];
extern const uint32_t soter_app_lease_count;

#ifdef __cplusplus
}
#endif

#endif
