/* soter_actuator.c: the process of the actuators.
 *
 * Purpose: take the commands that the trusted part sends with their leases, obey each no longer
 * than its lease says, by a clock of our own, and then hold the fail-safe law until somebody arms
 * us anew: SIGUSR1, taken where the trusted part says that the proof speaks of this state, or
 * SIGUSR2, whatever the state is. What is applied goes to `soter_actuate` and, for whoever looks,
 * into the channels of the module's topics; what we are about into `soter.actuators`. At the end
 * the law is applied, whatever ends it, and it says what happened; no word waits for anybody.
 * Non-goals: the program; devices (actuate.c is yours).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_actuator.h"
#include "soter_actuator_app.h"
#include "soter_check.h"
#include "soter_outside.h"
#include "soter_process.h"
#include "soter_status_text.h"

#include <errno.h>
#include <inttypes.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#define EXIT_USAGE 2
#define EXIT_DEFECT 70
#define SECOND INT64_C(1000000000)
#define PERIOD_NS INT64_C(500000)
#define PRIORITY 81
#define HELD_UP_NS SECOND /* less than the patience of --arm */
#define HEAD_BYTES ((size_t)24)

static const char* const USAGE =
    "usage: %s --channels FOLDER [--period MICROSECONDS] [--until SECONDS] [--json] [--quiet]\n"
    "       %s --channels FOLDER --arm [--unchecked]\n"
    "--arm, or SIGUSR1, arms the leases of the actuators that run anew, where the trusted part\n"
    "says that every module's safer holds on fresh readings; --unchecked, or SIGUSR2, whatever it\n"
    "says. SIGTERM ends them, with the law and a report.\n";

typedef struct {
  soter_outside in;
  soter_outside out[ACTUATOR_TOPICS];
  soter_lease lease;
  uint64_t message[ACTUATOR_WORDS];
  uint64_t command[ACTUATOR_WORDS]; /* of the lease */
  uint64_t held[ACTUATOR_WORDS];
  int64_t head[3];  /* of the message that was heard last: stamp, expiry, until when to begin */
  uint32_t how;     /* it was armed last: soter_status_text.h */
  soter_arm answer; /* to the last request to arm */
  uint64_t taken, refused, bad;
  uint64_t ends;        /* leases that ended */
  uint64_t older;       /* commands that were applied after the end of their lease */
  int64_t law_after_ns; /* from the end of a lease until the law was applied, at most */
  int64_t gap_ns;       /* between two turns while a lease held, at most */
  int64_t turned_ns;
  uint8_t said; /* the state that was told last */
} module_times;

static struct {
  const char* channels;
  int64_t period_ns, until_ns;
  bool json, quiet, fifo, locked, failed;
  bool arm, unchecked; /* to ask actuators that run, and no more */
  uint64_t turns, armed, not_armed;
  soter_outside status;
  uint64_t told[SOTER_ACTUATORS_WORDS(ACTUATOR_MODULES)]; /* soter_status.h */
  int64_t told_ns, looked_ns;                             /* looked: for a request to arm */
  module_times module[ACTUATOR_MODULES];
} us;

static volatile sig_atomic_t ending, arming;

static void on_signal(int number) {
  if (number == SIGUSR1 || number == SIGUSR2) {
    arming = number;
  } else {
    ending = 1;
  }
}

static void on_fault(int number) {
  soter_check_failed("signal", number, "free of faults");
}

/* ------------------------------------------------------------------ a turn */

static void say(uint32_t k, int64_t now) {
  static const char* const words[4] = {"", "armed: the law is held until a command comes",
                                       "commands are obeyed",
                                       "the lease has ended: the law is held"};
  module_times* const m = &us.module[k];
  SOTER_CHECK(m->lease.state >= SOTER_LEASE_ARMED && m->lease.state <= SOTER_LEASE_ENDED);
  if (m->said == m->lease.state) {
    return;
  }
  m->said = m->lease.state;
  if (us.quiet) {
    return;
  }
  char late[64] = "";
  if (m->lease.state == SOTER_LEASE_ENDED) {
    (void)snprintf(late, sizeof late, ", %.1f us after it", (double)(now - m->lease.until) / 1e3);
  }
  soter_process_say("%.6f %s: %s%s", (double)now / 1e9, soter_actuator_modules[k].name,
                    words[m->lease.state], late);
}

static void take(uint32_t k) {
  module_times* const m = &us.module[k];
  int64_t written = 0;
  SOTER_CHECK(m->in.size == HEAD_BYTES + m->lease.info->size);
  if (!soter_outside_read(&m->in, &written, m->message, &m->bad)) {
    return;
  }
  (void)memcpy(m->head, m->message, sizeof m->head);
  const uint8_t* const command = (const uint8_t*)m->message + HEAD_BYTES;
  if (soter_lease_take(&m->lease, soter_actuator_clock(), command, m->head[0], m->head[1])) {
    m->taken++;
  } else {
    m->refused++;
  }
}

static void apply(uint32_t k, bool obeys, int64_t now) {
  const soter_actuator_module* const info = &soter_actuator_modules[k];
  module_times* const m = &us.module[k];
  SOTER_CHECK(!obeys || (m->lease.state == SOTER_LEASE_HOLDS && now <= m->lease.until));
  soter_actuate(k, m->held, obeys);
  for (uint32_t i = 0; i < info->topics; i++) {
    const uint8_t* const held = (const uint8_t*)m->held;
    soter_outside_write(&m->out[i], now, held + info->topic[i].offset);
  }
}

static int64_t most(int64_t a, int64_t b) {
  return a > b ? a : b;
}

static void turn(uint32_t k) {
  module_times* const m = &us.module[k];
  const bool held = m->lease.state == SOTER_LEASE_HOLDS;
  take(k);
  const int64_t now = soter_actuator_clock();
  const bool obeys = soter_lease_read(&m->lease, now, m->held);
  apply(k, obeys, now);
  const int64_t after = soter_actuator_clock();
  SOTER_CHECK(after >= now); /* the clock does not go back */
  m->older += obeys && after > m->lease.until ? 1U : 0U;
  if (held) {
    m->gap_ns = most(m->gap_ns, after - m->turned_ns);
  }
  if (held && !obeys) {
    m->ends++;
    m->law_after_ns = most(m->law_after_ns, after - m->lease.until);
  }
  m->turned_ns = after;
  say(k, after);
}

/* ------------------------------------------------------------------ arming */

/* Whether every lease that has ended may be armed. One that has not is left as it is. */
static bool may_arm(int64_t now) {
  bool fine = true;
  for (uint32_t k = 0; k < soter_actuator_count; k++) {
    module_times* const m = &us.module[k];
    SOTER_CHECK(m->lease.state >= SOTER_LEASE_ARMED && m->lease.state <= SOTER_LEASE_ENDED);
    if (m->lease.state != SOTER_LEASE_ENDED) {
      m->answer = SOTER_ARM_ALREADY;
      continue;
    }
    m->answer = soter_lease_may_arm(&m->lease, now, m->head[0], m->head[1], m->head[2]);
    if (m->answer != SOTER_ARM_FINE && !us.quiet) {
      soter_process_say("%.6f %s: not armed: %s", (double)now / 1e9, soter_actuator_modules[k].name,
                        soter_arm_text(m->answer));
    }
    fine = fine && m->answer == SOTER_ARM_FINE;
  }
  return fine;
}

/* After a look at the state the command that was looked at is taken at once: what would be armed
 * and wait might begin in another state. */
static void arm_one(module_times* m, bool checked, int64_t now) {
  if (m->lease.state != SOTER_LEASE_ENDED) {
    m->answer = SOTER_ARM_ALREADY;
    return;
  }
  soter_lease_arm(&m->lease);
  m->how = checked ? SOTER_ARMED_CHECKED : SOTER_ARMED_UNCHECKED;
  m->answer = SOTER_ARM_FINE;
  if (checked) {
    const uint8_t* const command = (const uint8_t*)m->message + HEAD_BYTES;
    const bool taken = soter_lease_take(&m->lease, now, command, m->head[0], m->head[1]);
    SOTER_CHECK(taken);
    m->taken += taken ? 1U : 0U;
  }
}

static void arm(int64_t now) {
  const bool checked = arming == SIGUSR1;
  arming = 0;
  if (now - us.looked_ns > HELD_UP_NS) {
    return; /* whoever asked has been told that nobody answers */
  }
  us.told_ns = 0; /* the answer is told at once */
  if (checked && !may_arm(now)) {
    us.not_armed++;
    return;
  }
  us.armed++;
  for (uint32_t k = 0; k < soter_actuator_count; k++) {
    arm_one(&us.module[k], checked, now);
  }
}

/* What the actuators say of themselves, now and then. */
static void tell(int64_t now) {
  bool changed = now - us.told_ns >= SOTER_STATUS_EVERY_NS;
  for (uint32_t k = 0; k < soter_actuator_count; k++) {
    const module_times* const m = &us.module[k];
    uint64_t* const to = us.told + SOTER_ACTUATORS_HEAD + SOTER_ACTUATORS_MODULE * k;
    SOTER_CHECK(k < ACTUATOR_MODULES);
    changed = changed || to[SOTER_ACTUATORS_STATE] != m->lease.state;
    to[SOTER_ACTUATORS_STATE] = m->lease.state;
    to[SOTER_ACTUATORS_HOW] = m->how;
    to[SOTER_ACTUATORS_ANSWER] = m->answer;
  }
  us.told[SOTER_ACTUATORS_PROCESS] = (uint64_t)getpid();
  us.told[SOTER_ACTUATORS_ARMED] = us.armed;
  us.told[SOTER_ACTUATORS_REFUSED] = us.not_armed;
  if (changed) {
    soter_outside_write(&us.status, now, us.told);
    us.told_ns = now;
  }
}

static void turns(void) {
  int64_t next = soter_actuator_clock();
  SOTER_CHECK(us.period_ns > 0 && soter_actuator_count <= ACTUATOR_MODULES);
  const int64_t last = us.until_ns > 0 ? next + us.until_ns : INT64_MAX;
  while (ending == 0 && soter_actuator_clock() < last) {
    const int64_t now = soter_actuator_clock();
    if (arming != 0) {
      arm(now);
      tell(now); /* before a device may hold us up */
    }
    us.looked_ns = now;
    if (next <= now) {
      next = next + us.period_ns > now ? next + us.period_ns : now + us.period_ns;
    }
    int64_t wake = next;
    for (uint32_t k = 0; k < soter_actuator_count; k++) {
      turn(k);
      const soter_lease* const lease = &us.module[k].lease;
      if (lease->state == SOTER_LEASE_HOLDS && lease->until < wake) {
        wake = lease->until + 1; /* the first instant at which it has ended */
      }
    }
    tell(now);
    us.turns++;
    const struct timespec t = {.tv_sec = (time_t)(wake / SECOND), .tv_nsec = (long)(wake % SECOND)};
    (void)clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
  }
}

/* What is left behind counts until somebody else speaks. */
static void leave_the_law(void) {
  SOTER_CHECK(soter_actuator_count <= ACTUATOR_MODULES);
  for (uint32_t k = 0; k < soter_actuator_count; k++) {
    (void)memcpy(us.module[k].held, us.module[k].lease.info->law, us.module[k].lease.info->size);
    apply(k, false, soter_actuator_clock());
  }
}

/* ------------------------------------------------------------------ a check that fails */

/* Nothing of what was computed counts any more. The devices get the law, a constant, until somebody
 * ends this process; channels are left alone, as it may be one of them that is wrong: whoever
 * reads one sees it grow old. Where even the law cannot be given there is nothing left to do. */
void soter_check_failed(const char* file, int line, const char* what) {
  const struct timespec nap = {.tv_sec = 0, .tv_nsec = (long)PERIOD_NS};
  const bool again = us.failed;
  bool said = false;
  us.failed = true;
  while (ending == 0 && !again) {
    for (uint32_t k = 0; k < soter_actuator_count; k++) {
      soter_actuate(k, soter_actuator_modules[k].lease->law, false);
    }
    if (!said) { /* the devices come first */
      soter_process_say("soter has a defect: %s:%d: not %s", file, line, what);
      said = true;
    }
    (void)nanosleep(&nap, NULL);
  }
  _exit(again ? EXIT_DEFECT : soter_process_end(EXIT_DEFECT));
}

/* ------------------------------------------------------------------ the report */

static void report(FILE* out) {
  (void)fprintf(out,
                "{\"turns\": %" PRIu64 ", \"armed\": %" PRIu64 ", \"not_armed\": %" PRIu64
                ", \"policy\": \"%s\", \"locked\": %s, \"modules\": {",
                us.turns, us.armed, us.not_armed, us.fifo ? "fifo" : "ordinary",
                us.locked ? "true" : "false");
  for (uint32_t k = 0; k < soter_actuator_count; k++) {
    const module_times* const m = &us.module[k];
    static const char* const states[4] = {"", "armed", "holds", "ended"};
    (void)fprintf(out,
                  "%s\n \"%s\": {\"state\": \"%s\", \"taken\": %" PRIu64 ", \"refused\": %" PRIu64
                  ", \"bad\": %" PRIu64 ", \"ends\": %" PRIu64 ", \"older\": %" PRIu64
                  ", \"law_after_ns\": %" PRId64 ", \"gap_ns\": %" PRId64 "}",
                  k > 0U ? "," : "", soter_actuator_modules[k].name, states[m->lease.state],
                  m->taken, m->refused, m->bad, m->ends, m->older, m->law_after_ns, m->gap_ns);
  }
  (void)fprintf(out, "}}\n");
}

static void report_words(FILE* out) {
  for (uint32_t k = 0; k < soter_actuator_count; k++) {
    const module_times* const m = &us.module[k];
    (void)fprintf(out,
                  "%s: %" PRIu64 " commands taken, %" PRIu64 " refused, %" PRIu64
                  " leases ended; the law applied %.1f us after the end at most; %" PRIu64
                  " commands older than their lease applied\n",
                  soter_actuator_modules[k].name, m->taken, m->refused, m->ends,
                  (double)m->law_after_ns / 1e3, m->older);
  }
}

/* ------------------------------------------------------------------ the start */

static bool number(const char* text, double unit, int64_t* ns) {
  char* end = NULL;
  const double given = strtod(text, &end);
  *ns = given >= 0.0 && given <= 4e9 ? (int64_t)(given * unit + 0.5) : -1;
  return end != text && *end == '\0' && *ns > 0;
}

static bool option(const char* name, const char* value) {
  if (strcmp(name, "--channels") == 0) {
    us.channels = value;
    return true;
  }
  if (strcmp(name, "--period") == 0) {
    return number(value, 1e3, &us.period_ns);
  }
  return strcmp(name, "--until") == 0 && number(value, 1e9, &us.until_ns);
}

static bool flag(const char* word) {
  const struct {
    const char* name;
    bool* set;
  } flags[4] = {{"--json", &us.json},
                {"--quiet", &us.quiet},
                {"--arm", &us.arm},
                {"--unchecked", &us.unchecked}};
  for (int i = 0; i < 4; i++) {
    if (strcmp(word, flags[i].name) == 0) {
      *flags[i].set = true;
      return true;
    }
  }
  return false;
}

static bool parse(int count, char** words) {
  us.period_ns = PERIOD_NS;
  for (int i = 1; i < count; i++) {
    if (flag(words[i])) {
      continue;
    }
    if (i + 1 < count && option(words[i], words[i + 1])) {
      i++;
    } else {
      return false;
    }
  }
  return us.channels != NULL && (us.arm || !us.unchecked);
}

static bool open_channel(soter_outside* channel, const char* name, uint64_t hash, size_t size,
                         bool writes) {
  SOTER_CHECK(us.channels != NULL);
  const char* const wrong = soter_outside_open(channel, us.channels, name, hash, size, writes);
  if (wrong != NULL) {
    (void)fprintf(stderr, "not run: the channel `%s` in `%s`: %s\n", name, us.channels, wrong);
  }
  return wrong == NULL;
}

static bool open_all(void) {
  bool fine = true;
  for (uint32_t k = 0; k < soter_actuator_count; k++) {
    const soter_actuator_module* const info = &soter_actuator_modules[k];
    module_times* const m = &us.module[k];
    SOTER_CHECK(info->topics <= ACTUATOR_TOPICS && info->size <= sizeof m->message);
    fine = fine && open_channel(&m->in, info->channel, info->hash, info->size, false);
    for (uint32_t i = 0; i < info->topics; i++) {
      const soter_actuator_topic* const t = &info->topic[i];
      fine = fine && open_channel(&m->out[i], t->name, t->hash, t->size, true);
    }
    soter_lease_init(&m->lease, info->lease, m->command);
    m->head[0] = m->head[1] = m->head[2] = -1; /* nothing was heard */
  }
  fine = fine && open_channel(&us.status, SOTER_ACTUATORS_CHANNEL, ACTUATOR_STATUS_HASH,
                              sizeof us.told, true);
  return fine;
}

static void be_on_time(void) {
  const struct sched_param priority = {.sched_priority = PRIORITY};
  us.locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
  us.fifo = sched_setscheduler(0, SCHED_FIFO, &priority) == 0;
  if (!us.fifo && !us.quiet) {
    soter_process_say(
        "soter: SCHED_FIFO is not permitted (%s): the law comes late where the machine is busy",
        strerror(errno));
  }
}

int main(int count, char** words) {
  static const int faults[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGTRAP, SIGSYS};
  if (!parse(count, words)) {
    (void)fprintf(stderr, USAGE, words[0], words[0]);
    return EXIT_USAGE;
  }
  if (us.arm) {
    return soter_actuator_request(us.channels, us.unchecked);
  }
  if (!soter_process_begin(on_signal)) {
    return EXIT_FAILURE;
  }
  if (!open_all()) {
    return soter_process_end(EXIT_FAILURE);
  }
  be_on_time();
  for (size_t k = 0; k < sizeof faults / sizeof faults[0]; k++) {
    (void)signal(faults[k], on_fault);
  }
  turns();
  leave_the_law();
  soter_process_ending();
  if (us.json) {
    report(stdout);
  } else {
    report_words(stdout);
  }
  return soter_process_end(EXIT_SUCCESS);
}
