/* soter_status_text.h: what soter_status.h says of a module, for people.
 *
 * Purpose: one reading of the words and one wording, for every bridge that shows them: a level, a
 * sentence (who has control; whether the actuators obey, wait to be armed and with which command),
 * and single facts. Non-goals: how they are shown, channels. C99, and C++.
 */
#ifndef SOTER_STATUS_TEXT_H
#define SOTER_STATUS_TEXT_H

#include "soter_lease.h"
#include "soter_status.h"

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The levels of diagnostic_msgs. */
enum { SOTER_LEVEL_OK = 0, SOTER_LEVEL_WARN = 1, SOTER_LEVEL_ERROR = 2, SOTER_LEVEL_STALE = 3 };

#define SOTER_MESSAGE_MAX 320

/* How actuators came to obey: SOTER_ACTUATORS_HOW. */
enum { SOTER_BEGAN_ARMED = 0, SOTER_ARMED_CHECKED = 1, SOTER_ARMED_UNCHECKED = 2 };

/* Of one module. */
typedef struct {
  bool alive;                /* the trusted part was heard, and not long ago */
  bool ac, safer;            /* its mode; what its DM's last look found, on fresh reads */
  int64_t sure_until;        /* ns on CLOCK_MONOTONIC */
  uint32_t why;              /* SC took over last: an index of soter_takeover_text */
  const uint64_t* takeovers; /* SOTER_STATUS_CAUSES numbers, in the words that were read */
  uint64_t missed;
  bool leased;     /* it has a fail-safe law; the rest is about its actuators */
  bool lease_over; /* the trusted part gives none any more */
  uint64_t given;
  uint32_t old_topic; /* its leases ended with a read of it: as SOTER_STATUS_OLD_TOPIC */
  int64_t old_ns, old_most_ns;
  bool actuators_alive;
  uint32_t state, how, answer; /* SOTER_LEASE_ENDED and so on; how they were armed; soter_arm */
} soter_module_facts;

/* Numbers of modules, leases, and the module's and its lease's, -1 where it has none. */
typedef struct {
  uint32_t modules, module;
  int32_t lease;
} soter_module_place;

/* `status`, `actuators`: the words of both channels; `status_ns`, `actuators_ns`: when each was
 * written, CLOCK_MONOTONIC, 0: never. The words have to outlive what comes back. */
soter_module_facts soter_module_facts_of(soter_module_place place, int64_t now,
                                         const uint64_t* status, int64_t status_ns,
                                         const uint64_t* actuators, int64_t actuators_ns);

int soter_module_level(const soter_module_facts* f);

/* The sentence. `arm`: the command that arms the actuators, as a person types it. */
void soter_module_message(const soter_module_facts* f, const char* arm, char* to, size_t size);

/* For how long AC surely keeps control (`margin` of the language), s; 0 in mode SC. */
double soter_margin_s(const soter_module_facts* f, int64_t now);

/* "yes", "no", and how: of a module without a law nobody has to be armed. */
const char* soter_armed_text(const soter_module_facts* f);

/* Whether a request to arm would be taken now. */
const char* soter_arming_text(const soter_module_facts* f);

const char* soter_arm_text(uint32_t answer);   /* of a soter_arm */
const char* soter_takeover_text(uint32_t why); /* 0: never, 1 + soter_cause */

#define SOTER_OLD_READ "its leases ended with a read of" /* a key, where `old_topic` is not 0 */

/* What follows that key. `name`: of the topic. */
void soter_old_read_text(const soter_module_facts* f, const char* name, char* to, size_t size);

/* Of a topic that a bridge publishes. `silent`: nobody writes its channel in time. */
const char* soter_outward_text(bool silent, uint64_t published);

#ifdef __cplusplus
}
#endif

#endif
