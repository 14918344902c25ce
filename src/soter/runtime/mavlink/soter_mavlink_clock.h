/* soter_mavlink_clock.h: what a stamp of the autopilot is on CLOCK_MONOTONIC.
 *
 * Purpose: MAVLink's TIMESYNC. A request leaves at `sent`, its answer, which says `remote`, comes
 * at `received`: the autopilot's clock showed `remote` somewhere between. What it stamped s was
 * measured at sent + (s - remote) at the earliest, and that counts: half a round trip, and what two
 * crystals drift apart, make a message older and never newer.
 * Non-goals: the messages (soter_mavlink_bridge.c). Not shared between threads.
 *
 * A clock that jumped, as after a reboot, contradicts the exchanges before: they are forgotten.
 */
#ifndef SOTER_MAVLINK_CLOCK_H
#define SOTER_MAVLINK_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

#define SOTER_MAVLINK_EXCHANGES 16
#define SOTER_MAVLINK_PENDING 8
#define SOTER_MAVLINK_DRIFT_PPM 200              /* of two clocks against each other, at most */
#define SOTER_MAVLINK_ROUND_NS INT64_C(50000000) /* a longer round trip tells too little */
#define SOTER_MAVLINK_LASTS_NS INT64_C(5000000000)

typedef struct {
  int64_t sent, received, remote;
} soter_mavlink_exchange;

typedef struct {
  soter_mavlink_exchange exchange[SOTER_MAVLINK_EXCHANGES];
  uint64_t exchanges;                     /* so many; the last ones are kept */
  int64_t pending[SOTER_MAVLINK_PENDING]; /* when requests were sent that have no answer; 0: none */
  uint64_t requests;
  uint64_t slow, unasked, jumps; /* answers that told too little, or nothing; clocks that jumped */
} soter_mavlink_clock;

/* A request is sent, with this in ts1. */
void soter_mavlink_clock_ask(soter_mavlink_clock* clock, int64_t now);

/* An answer: whether it was one to a request. */
bool soter_mavlink_clock_hear(soter_mavlink_clock* clock, int64_t now, int64_t ts1, int64_t remote);

/* Whether stamps can be turned. */
bool soter_mavlink_clock_runs(const soter_mavlink_clock* clock, int64_t now);

/* The earliest and the latest time at which the autopilot's clock can have shown `stamp`. */
void soter_mavlink_clock_turn(const soter_mavlink_clock* clock, int64_t now, int64_t stamp,
                              int64_t* earliest, int64_t* latest);

#endif
