/* soter_status.h: what the trusted part and the actuators say of themselves.
 *
 * Purpose: numbers for whoever shows them (diagnostics of ROS, say), as words of 64 bits, in two
 * channels. `soter.status` of the trusted part: a head, then of each module, each lease and each
 * topic that meets the world so many, in the order of the program; written whenever a module
 * changes its mode, after a look of a DM at most a hundred times a second, and at least ten times.
 * `soter.actuators`: a head, then of each module with a fail-safe law so many; written whenever the
 * state of a lease changes, and at least ten times a second.
 * Non-goals: values of topics; being listened to: nothing waits for a reader.
 */
#ifndef SOTER_STATUS_H
#define SOTER_STATUS_H

#include <stdint.h>

#define SOTER_STATUS_CHANNEL "soter.status"
#define SOTER_STATUS_EVERY_NS INT64_C(100000000)
#define SOTER_STATUS_LOOK_NS INT64_C(10000000)

/* the head */
#define SOTER_STATUS_INSTANTS 0
#define SOTER_STATUS_MISSED 1    /* releases and completions of the trusted part that were late */
#define SOTER_STATUS_CALENDARS 2 /* the calendar began anew: a second behind */
#define SOTER_STATUS_HEAD 3

/* of a module: its mode (1 is AC); until when AC surely keeps control (proof-sets.md, "Margin"), ns
 * on CLOCK_MONOTONIC, 0 in mode SC; whether the DM's last look found `safer` on fresh reads; why SC
 * took over last (0: never, else 1 + soter_cause), and how often for each cause */
#define SOTER_STATUS_MODE 0
#define SOTER_STATUS_SURE 1
#define SOTER_STATUS_SAFER 2
#define SOTER_STATUS_WHY 3
#define SOTER_STATUS_TAKEOVERS 4
#define SOTER_STATUS_CAUSES 5
#define SOTER_STATUS_MODULE 9

/* of the leases of a module */
#define SOTER_STATUS_GIVEN 0
#define SOTER_STATUS_STALE 1 /* releases that read what was too old */
#define SOTER_STATUS_ENDED 2 /* 1: no lease is given any more */
/* where they ended with a read that was too old: 1 + the topic, of those that meet the world, one
 * more than there are of a topic inside; 0: they did not. How old it was, ns as an int64_t,
 * negative: nobody had published it; and how old it might be */
#define SOTER_STATUS_OLD_TOPIC 3
#define SOTER_STATUS_OLD_NS 4
#define SOTER_STATUS_OLD_MOST_NS 5
#define SOTER_STATUS_LEASE 6

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

#define SOTER_ACTUATORS_CHANNEL "soter.actuators"

/* the head */
#define SOTER_ACTUATORS_PROCESS 0 /* its id */
#define SOTER_ACTUATORS_ARMED 1   /* requests to arm that were taken */
#define SOTER_ACTUATORS_REFUSED 2 /* and that were not */
#define SOTER_ACTUATORS_HEAD 3

/* of a module with a fail-safe law: the state of its lease (SOTER_LEASE_ARMED and so on); how it
 * was armed last (soter_status_text.h); how the last request to arm was answered (soter_arm) */
#define SOTER_ACTUATORS_STATE 0
#define SOTER_ACTUATORS_HOW 1
#define SOTER_ACTUATORS_ANSWER 2
#define SOTER_ACTUATORS_MODULE 3

#define SOTER_ACTUATORS_WORDS(leases) (SOTER_ACTUATORS_HEAD + SOTER_ACTUATORS_MODULE * (leases))

#endif
