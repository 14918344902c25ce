/* soter_posix_setup.c: memory, policy and processor of the trusted thread.
 *
 * Purpose: ask for what keeps a thread on time, and say in words what could not be had and what is
 * lost without it. Nothing here is needed to run.
 * Non-goals: changing the machine (interrupts, isolated processors, cgroups): docs/real-time.md.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_posix.h"
#include "soter_process.h"

#include <errno.h>
#include <sched.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#define STACK_BYTES ((size_t)2 * 1024 * 1024)
#define TOUCHED_BYTES ((size_t)256 * 1024)
#define PRIORITY 80
#define POLICY_DEADLINE 6U

void soter_posix_note(soter_posix* d, const char* format, ...) {
  const uint32_t at = __atomic_fetch_add(&d->note_count, 1U, __ATOMIC_ACQ_REL); /* any thread */
  char* const text = d->notes[at < SOTER_NOTES ? at : SOTER_NOTES - 1];
  va_list rest;
  va_start(rest, format);
  (void)vsnprintf(text, SOTER_NOTE_MAX, format, rest);
  va_end(rest);
  if (!d->options.quiet) {
    soter_process_say("soter: %s", text);
  }
}

void soter_posix_lock(soter_posix* d) {
  d->locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
  if (!d->locked) {
    soter_posix_note(d,
                     "memory is not locked (%s): a page that is away delays a step by "
                     "milliseconds; raise RLIMIT_MEMLOCK or give CAP_IPC_LOCK",
                     strerror(errno));
  }
}

/* ------------------------------------------------------------------ one processor */

static int chosen_core(const soter_posix* d, const cpu_set_t* allowed) {
  int last = -1;
  for (int i = 0; i < CPU_SETSIZE; i++) {
    if (CPU_ISSET((size_t)i, allowed)) {
      last = i;
      if (i == d->options.core) {
        return i;
      }
    }
  }
  return d->options.core >= 0 ? -1 : last;
}

static void pin(soter_posix* d) {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  if (d->options.core == -2 || sched_getaffinity(0, sizeof allowed, &allowed) != 0) {
    return;
  }
  if (CPU_COUNT(&allowed) == 1) {
    soter_posix_note(d, "one processor only: workers and all else share it with the trusted part");
  }
  const int core = chosen_core(d, &allowed);
  cpu_set_t own;
  CPU_ZERO(&own);
  if (core >= 0) {
    CPU_SET((size_t)core, &own);
  }
  if (core < 0 || sched_setaffinity(0, sizeof own, &own) != 0) {
    soter_posix_note(d, "not pinned to processor %d: it is not ours", d->options.core);
    return;
  }
  d->pinned = true;
  d->core = core;
}

/* ------------------------------------------------------------------ policy */

int64_t soter_posix_shortest(void) {
  int64_t least = INT64_C(1000000000);
  for (uint32_t i = 0; i < APP_PROGRAM->components; i++) {
    const int64_t period = APP_PROGRAM->component[i].period_ns;
    SOTER_CHECK(period > 0);
    least = period < least ? period : least;
  }
  return least;
}

/* SCHED_DEADLINE: half of the shortest period is ours. glibc has no function for it. */
static bool take_deadline(void) {
#ifdef SYS_sched_setattr
  struct {
    uint32_t size, policy;
    uint64_t flags;
    int32_t nice;
    uint32_t priority;
    uint64_t runtime, deadline, period;
  } wanted;
  (void)memset(&wanted, 0, sizeof wanted);
  wanted.size = (uint32_t)sizeof wanted;
  wanted.policy = POLICY_DEADLINE;
  wanted.period = (uint64_t)soter_posix_shortest();
  wanted.deadline = wanted.period;
  wanted.runtime = wanted.period / 2U;
  return syscall(SYS_sched_setattr, 0, &wanted, 0U) == 0;
#else
  errno = ENOSYS;
  return false;
#endif
}

static void without(soter_posix* d, const char* what) {
  soter_posix_note(d,
                   "%s is not permitted (%s): an ordinary thread is late whenever the machine is "
                   "busy; every late step is seen and made safe, but there will be many. Give "
                   "CAP_SYS_NICE or RLIMIT_RTPRIO",
                   what, strerror(errno));
  (void)snprintf(d->policy, sizeof d->policy, "ordinary");
}

/* The thread that calls this becomes the trusted one. */
void soter_posix_become(soter_posix* d) {
  uint8_t stack[TOUCHED_BYTES];
  volatile uint8_t* const touched = stack;
  for (size_t i = 0; i < TOUCHED_BYTES; i += 1024U) {
    touched[i] = 1U; /* every page is there before the first instant */
  }
  const struct sched_param priority = {.sched_priority = PRIORITY};
  (void)snprintf(d->policy, sizeof d->policy, "ordinary");
  if (d->options.policy == SOTER_POLICY_DEADLINE) {
    if (take_deadline()) { /* it may not be pinned */
      (void)snprintf(d->policy, sizeof d->policy, "deadline");
      return;
    }
    without(d, "SCHED_DEADLINE");
  }
  pin(d);
  if (d->options.policy == SOTER_POLICY_AUTO || d->options.policy == SOTER_POLICY_FIFO) {
    if (sched_setscheduler(0, SCHED_FIFO, &priority) == 0) {
      (void)snprintf(d->policy, sizeof d->policy, "fifo");
      return;
    }
    without(d, "SCHED_FIFO");
  }
}

bool soter_posix_thread(soter_posix* d, pthread_t* thread, void* (*run)(void*)) {
  pthread_attr_t attributes;
  SOTER_CHECK(thread != NULL && run != NULL);
  if (pthread_attr_init(&attributes) != 0) {
    return false;
  }
  (void)pthread_attr_setstacksize(&attributes, STACK_BYTES);
  const bool made = pthread_create(thread, &attributes, run, d) == 0;
  (void)pthread_attr_destroy(&attributes);
  return made;
}
