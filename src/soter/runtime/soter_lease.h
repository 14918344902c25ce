/* soter_lease.h: what an actuator obeys, and until when.
 *
 * Purpose: the actuator side of a module. A command counts while its lease holds; afterwards the
 * fail-safe law does, for ever, until somebody arms the lease anew (docs/proof.md, "When the
 * trusted part stops"). Without heap, globals, callbacks or the kernel; every function returns at
 * once. Non-goals: how commands travel, clocks (times are ns on one clock, that of who gives
 * leases), several callers at once.
 *
 * A restart of the trusted part: it comes up in SC mode; whoever has seen to that calls
 * `soter_lease_arm`, after `soter_lease_may_arm` where the trusted part says of its state whether
 * the proof speaks of it. Until the first lease, and from the end of the last one on, the law is
 * read.
 */
#ifndef SOTER_LEASE_H
#define SOTER_LEASE_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
  SOTER_LEASE_ARMED = 1, /* none was given yet: the law, and the first lease is taken */
  SOTER_LEASE_HOLDS = 2, /* the last command that was taken */
  SOTER_LEASE_ENDED = 3  /* the law, and nothing is taken */
};

/* Whether a lease may be armed anew, and why not. */
typedef enum {
  SOTER_ARM_FINE = 0,
  SOTER_ARM_SILENT = 1, /* no command with a lease in force was heard */
  SOTER_ARM_STATE = 2,  /* who gave it does not say that the proof speaks of this state */
  SOTER_ARM_ALREADY = 3 /* it has not ended: nothing is changed */
} soter_arm;
#define SOTER_ARMS 4

/* Of a module, generated: constant. */
typedef struct {
  const void* law; /* `size` bytes: what is held when no lease holds */
  uint32_t size;   /* of a command, bytes */
  int64_t longest; /* ns from the release that gives a lease to its end, at most */
} soter_lease_info;

typedef struct {
  const soter_lease_info* info;
  void* command; /* `size` bytes: the last one that was taken */
  int64_t until; /* the last instant of the lease in force */
  int64_t stamp; /* the release that gave it */
  int64_t seen;  /* the latest time that was told: a clock that steps back does not lengthen it */
  uint8_t state;
} soter_lease;

/* `command`: room for `info->size` bytes, filled with the law. */
void soter_lease_init(soter_lease* lease, const soter_lease_info* info, void* command);

/* After a restart of the trusted part, or an end: the next lease may begin. */
void soter_lease_arm(soter_lease* lease);

/* Whether the command that was heard last, given by release `stamp` until `expiry`, may be obeyed
 * from `now` on by actuators that hold the law. `begin`: until when its state is one to begin from
 * (docs/proof.md, "Arming"). Where it is fine, soter_lease_arm and then soter_lease_take of this
 * command, at this instant, take it. */
soter_arm soter_lease_may_arm(const soter_lease* lease, int64_t now, int64_t stamp, int64_t expiry,
                              int64_t begin);

/* Takes a command with its lease, given by release `stamp` of SC, until `expiry`; false: not taken.
 * It is not where the lease in force has ended, where this one has, where it is older than the one
 * in force or longer than any can be. */
bool soter_lease_take(soter_lease* lease, int64_t now, const void* command, int64_t stamp,
                      int64_t expiry);

/* What to do at `now`: `command` gets the last one that was taken (true), or the law (false). */
bool soter_lease_read(soter_lease* lease, int64_t now, void* command);

#ifdef __cplusplus
}
#endif

#endif
