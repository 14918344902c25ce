/* soter_status.h: what the trusted part says of itself, in the channel `soter.status`.
 *
 * Purpose: numbers for whoever shows them (diagnostics of ROS, say), as words of 64 bits: a head,
 * then of each module, each lease and each topic that meets the world so many, in the order of the
 * program. They are written whenever a module changes its mode, and at least ten times a second.
 * Non-goals: values of topics; being listened to: nothing waits for a reader.
 */
#ifndef SOTER_STATUS_H
#define SOTER_STATUS_H

#include <stdint.h>

#define SOTER_STATUS_CHANNEL "soter.status"
#define SOTER_STATUS_EVERY_NS INT64_C(100000000)

/* the head */
#define SOTER_STATUS_INSTANTS 0
#define SOTER_STATUS_MISSED 1    /* releases and completions of the trusted part that were late */
#define SOTER_STATUS_CALENDARS 2 /* the calendar began anew: a second behind */
#define SOTER_STATUS_HEAD 3

/* of a module: its mode (1 is AC), then why SC took over, how often: soter_cause */
#define SOTER_STATUS_MODE 0
#define SOTER_STATUS_TAKEOVERS 1
#define SOTER_STATUS_CAUSES 5
#define SOTER_STATUS_MODULE 6

/* of the leases of a module */
#define SOTER_STATUS_GIVEN 0
#define SOTER_STATUS_STALE 1 /* releases that read what was too old */
#define SOTER_STATUS_ENDED 2 /* 1: no lease is given any more */
#define SOTER_STATUS_LEASE 3

/* of a topic that meets the world */
#define SOTER_STATUS_TOLD 0
#define SOTER_STATUS_TAKEN 1
#define SOTER_STATUS_REFUSED 2 /* not finite, not in its set */
#define SOTER_STATUS_OLDER 3
#define SOTER_STATUS_FUTURE 4
#define SOTER_STATUS_BAD 5
#define SOTER_STATUS_TOPIC 6

#define SOTER_STATUS_WORDS(modules, leases, topics)                                      \
  (SOTER_STATUS_HEAD + SOTER_STATUS_MODULE * (modules) + SOTER_STATUS_LEASE * (leases) + \
   SOTER_STATUS_TOPIC * (topics))

#endif
