/* soter_grant.h: who gives leases, and when nobody does any more.
 *
 * Purpose: the trusted side. It is told what every release of DM, SC and of the nodes between
 * sensors and plant did, holds it against its times, and says until when the outputs of a module
 * may be obeyed: until SC's next output is due. One release that was not done in time, and nobody
 * gets a lease any more (docs/proof.md, "When the trusted part stops"). Non-goals: clocks, taking
 * commands (`soter_lease.h`), running anything.
 *
 * All times are ns on one clock, that of the actuators. Releases are at phase + k * period from an
 * origin on: after a restart the trusted part begins a new one, the clock goes on.
 */
#ifndef SOTER_GRANT_H
#define SOTER_GRANT_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Times of one node of the trusted part, as its proof has them. */
typedef struct {
  int64_t period, phase;
  int64_t late;     /* from a release to its start, at most */
  int64_t response; /* from its start to its output, at most */
} soter_budget;

/* Of a module, generated: constant. Node 0 is its DM, 1 its SC, then come the others. */
typedef struct {
  const soter_budget* node;
  uint32_t nodes;
} soter_grant_info;

typedef struct {
  const soter_grant_info* info;
  int64_t origin;    /* when the trusted part began: its time 0 */
  int64_t* done;     /* of each node how many releases are done */
  int64_t spoken[2]; /* when the DM's last verdict was out, and the one before it */
  bool broken;       /* a release was not done in time: for good */
} soter_grant;

/* `done`: room for `info->nodes` numbers. */
void soter_grant_init(soter_grant* grant, const soter_grant_info* info, int64_t* done);

/* The same, where the first releases are at `origin` + phase: what NAME_start was told. */
void soter_grant_begin(soter_grant* grant, const soter_grant_info* info, int64_t* done,
                       int64_t origin);

/* The next release of a node that is not done yet. */
int64_t soter_grant_next(const soter_grant* grant, uint32_t node);

/* Until when that release has to be done: its start, and its output. */
int64_t soter_grant_starts_by(const soter_grant* grant, uint32_t node);
int64_t soter_grant_due(const soter_grant* grant, uint32_t node);

/* The next release of a node is done: it started at `start`, its output was out at `out`. A step
 * that faulted is not done. False: not in time, or of SC: before the verdicts that it waits for. */
bool soter_grant_done(soter_grant* grant, uint32_t node, int64_t start, int64_t out);

/* Whether commands of the module may be passed on at `now`, and with which lease: `*stamp` is the
 * release of SC that gave it, `*expiry` its end. */
bool soter_grant_lease(soter_grant* grant, int64_t now, int64_t* stamp, int64_t* expiry);

#ifdef __cplusplus
}
#endif

#endif
