/* soter_status_text.c: what soter_status.h says of a module, for people. See soter_status_text.h.
 *
 * Purpose: the wording. Non-goals: as there.
 */
#include "soter_status_text.h"

#include <stdio.h>

#define SILENT_NS (5 * SOTER_STATUS_EVERY_NS)

static bool alive(int64_t now, int64_t written_ns) {
  /* what lies after now is of before this machine was started */
  return written_ns > 0 && now >= written_ns && now - written_ns < SILENT_NS;
}

soter_module_facts soter_module_facts_of(soter_module_place place, int64_t now,
                                         const uint64_t* status, int64_t status_ns,
                                         const uint64_t* actuators, int64_t actuators_ns) {
  const uint64_t* const m = status + SOTER_STATUS_HEAD + SOTER_STATUS_MODULE * place.module;
  soter_module_facts f = {.alive = alive(now, status_ns),
                          .ac = m[SOTER_STATUS_MODE] == 1U,
                          .safer = m[SOTER_STATUS_SAFER] == 1U,
                          .sure_until = (int64_t)m[SOTER_STATUS_SURE],
                          .why = (uint32_t)m[SOTER_STATUS_WHY],
                          .takeovers = m + SOTER_STATUS_TAKEOVERS,
                          .missed = status[SOTER_STATUS_MISSED],
                          .leased = place.lease >= 0};
  if (f.leased) {
    const uint32_t k = (uint32_t)place.lease;
    const uint64_t* const lease =
        status + SOTER_STATUS_HEAD + SOTER_STATUS_MODULE * place.modules + SOTER_STATUS_LEASE * k;
    const uint64_t* const a = actuators + SOTER_ACTUATORS_HEAD + SOTER_ACTUATORS_MODULE * k;
    f.given = lease[SOTER_STATUS_GIVEN];
    f.old_topic = (uint32_t)lease[SOTER_STATUS_OLD_TOPIC];
    f.old_ns = (int64_t)lease[SOTER_STATUS_OLD_NS];
    f.old_most_ns = (int64_t)lease[SOTER_STATUS_OLD_MOST_NS];
    f.lease_over = lease[SOTER_STATUS_ENDED] != 0U;
    f.actuators_alive = alive(now, actuators_ns);
    f.state = (uint32_t)a[SOTER_ACTUATORS_STATE];
    f.how = (uint32_t)a[SOTER_ACTUATORS_HOW];
    f.answer = (uint32_t)a[SOTER_ACTUATORS_ANSWER];
  }
  return f;
}

static bool waits(const soter_module_facts* f) {
  return f->leased && f->actuators_alive && f->state == SOTER_LEASE_ENDED;
}

static const char* const HELD = "the actuators hold the fail-safe law";

static void silent_message(const soter_module_facts* f, const char* arm, char* to, size_t size) {
  if (waits(f)) {
    (void)snprintf(to, size,
                   "the trusted part is silent; %s and, once it speaks, wait to be armed: %s", HELD,
                   arm);
  } else {
    (void)snprintf(to, size, "the trusted part is silent");
  }
}

static void control_message(const soter_module_facts* f, char* to, size_t size) {
  const bool unchecked = f->leased && f->how == SOTER_ARMED_UNCHECKED;
  (void)snprintf(to, size, "%s has control%s", f->ac ? "AC" : "SC",
                 unchecked ? "; armed without a look at the state, which no proof is about" : "");
}

int soter_module_level(const soter_module_facts* f) {
  if (!f->alive) {
    return SOTER_LEVEL_STALE;
  }
  if (f->leased && (f->lease_over || !f->actuators_alive || waits(f))) {
    return SOTER_LEVEL_ERROR;
  }
  const bool sure =
      !f->leased || (f->state == SOTER_LEASE_HOLDS && f->how != SOTER_ARMED_UNCHECKED);
  return f->ac && sure ? SOTER_LEVEL_OK : SOTER_LEVEL_WARN;
}

void soter_module_message(const soter_module_facts* f, const char* arm, char* to, size_t size) {
  if (!f->alive) {
    silent_message(f, arm, to, size);
  } else if (!f->leased) {
    control_message(f, to, size);
  } else if (!f->actuators_alive) {
    (void)snprintf(to, size, "the actuators are silent; in the trusted part %s has control",
                   f->ac ? "AC" : "SC");
  } else if (f->lease_over) {
    (void)snprintf(to, size,
                   "its leases have ended: %s until the trusted part was started again and a "
                   "person arms them: %s",
                   HELD, arm);
  } else if (waits(f)) {
    (void)snprintf(to, size, "%s until a person arms them: %s (%s)", HELD, arm,
                   soter_arming_text(f));
  } else if (f->state == SOTER_LEASE_ARMED) {
    (void)snprintf(to, size, "armed: %s until a command comes", HELD);
  } else {
    control_message(f, to, size);
  }
}

double soter_margin_s(const soter_module_facts* f, int64_t now) {
  return f->alive && f->ac && f->sure_until > now ? (double)(f->sure_until - now) / 1e9 : 0.0;
}

const char* soter_armed_text(const soter_module_facts* f) {
  static const char* const how[3] = {"yes, since they began", "yes, after a look at the state",
                                     "yes, without a look at the state (arm --unchecked)"};
  if (!f->leased) {
    return "it has no fail-safe law: nothing is to be armed";
  }
  if (!f->actuators_alive) {
    return "unknown: the actuators are silent";
  }
  return f->state == SOTER_LEASE_ENDED ? "no" : how[f->how < 3U ? f->how : 2U];
}

const char* soter_arming_text(const soter_module_facts* f) {
  if (!f->alive || f->lease_over) {
    return "refused now: the trusted part gives no lease";
  }
  return f->safer ? "taken now, as far as this module goes"
                  : "refused now: safer does not hold, or what it reads is old; --unchecked arms "
                    "all the same, and no proof is about that";
}

const char* soter_arm_text(uint32_t answer) {
  static const char* const texts[SOTER_ARMS] = {
      "armed", "the trusted part gives no lease",
      "safer does not hold in every module, or what it reads is old",
      "armed already: nothing was changed"};
  return texts[answer < SOTER_ARMS ? answer : SOTER_ARM_SILENT];
}

const char* soter_takeover_text(uint32_t why) {
  static const char* const texts[1 + SOTER_STATUS_CAUSES] = {
      "never",    "ttf",          "what the DM reads is old",
      "the gate", "AC is silent", "the trusted part was late"};
  return texts[why <= SOTER_STATUS_CAUSES ? why : 0U];
}

void soter_old_read_text(const soter_module_facts* f, const char* name, char* to, size_t size) {
  if (f->old_ns < 0) {
    (void)snprintf(to, size, "%s, which nobody had published", name);
  } else {
    (void)snprintf(to, size, "%s %.3f ms old, of %.3f ms", name, (double)f->old_ns / 1e6,
                   (double)f->old_most_ns / 1e6);
  }
}

const char* soter_outward_text(bool silent, uint64_t published) {
  if (silent) {
    return published > 0U ? "nobody writes it: the actuators, or the trusted part, are gone"
                          : "nobody writes it: the actuators, or the trusted part, were gone when "
                            "the bridge began, and nothing is published";
  }
  return published > 0U ? "published" : "nothing to publish yet";
}
