/* owned_clock.c: the clock and the scheduler of a real-time driver, in the hands of a test.
 *
 * Purpose: linked into a trusted program whose calls of clock_gettime and clock_nanosleep, and of
 * soter_posix_run, are wrapped (ld --wrap). Time passes where the trusted thread sleeps, by exactly
 * that much, and LOOK_NS where it looks at the clock. It wakes when every worker that has a request
 * has answered it, or has ended, and the logger has room. What else happens stands in OWNED_CLOCK,
 * words separated by spaces; AT is a ct in ns, and each happens as the thread wakes at it or later:
 *   held:AT:NS        nobody schedules the thread for so long
 *   killed:AT:N       the worker is killed, and its end, the Nth, seen
 *   ended:AT:N        the worker's Nth end is waited for
 *   started:AT:N      its Nth start is waited for, and that it is ready
 *   terminated:AT:0   SIGTERM, and it is heard
 *   answers:N:ANY     requests behind the Nth are waited for only (ANY 1) until something else than
 *                     an old answer stands there, or not at all (ANY 0)
 *   clock:NS:0        what the clock shows as the run begins
 * Non-goals: the keeper of workers, workers, the main thread: they have the machine's clock.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif

#include "soter_posix.h"

#include <inttypes.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define SECOND INT64_C(1000000000)
#define LOOK_NS 1000
#define EVENTS 16

typedef struct {
  char what[16];
  int64_t at_ns, more;
  bool over;
} event;

int __real_clock_gettime(clockid_t id, struct timespec* t);
int __real_clock_nanosleep(clockid_t id, int flags, const struct timespec* t,
                           struct timespec* left);
void* __real_soter_posix_run(void* driver);
int __wrap_clock_gettime(clockid_t id, struct timespec* t);
int __wrap_clock_nanosleep(clockid_t id, int flags, const struct timespec* t,
                           struct timespec* left);
void* __wrap_soter_posix_run(void* driver);

static soter_posix* d;
static pthread_t trusted;
static int64_t clock_ns = 1000 * SECOND;
static bool owned;
static event events[EVENTS];
static int event_count;
static int64_t answers = INT64_MAX;
static bool any_answer;

static bool ours(void) {
  return __atomic_load_n(&owned, __ATOMIC_ACQUIRE) && pthread_equal(pthread_self(), trusted);
}

static void read_events(void) {
  const char* const text = getenv("OWNED_CLOCK");
  const char* at = text == NULL ? "" : text;
  int length = 0;
  event e;
  (void)memset(&e, 0, sizeof e);
  while (sscanf(at, " %15[a-z]:%" SCNd64 ":%" SCNd64 "%n", e.what, &e.at_ns, &e.more, &length) ==
         3) {
    if (strcmp(e.what, "answers") == 0) {
      answers = e.at_ns;
      any_answer = e.more != 0;
    } else if (strcmp(e.what, "clock") == 0) {
      clock_ns = e.at_ns;
    } else if (event_count < EVENTS) {
      events[event_count++] = e;
    }
    at += length;
  }
}

static void nap(void) {
  const struct timespec t = {0, 20000};
  (void)__real_clock_nanosleep(CLOCK_MONOTONIC, 0, &t, NULL);
}

/* ------------------------------------------------------------------ the others */

static bool stopping(void) {
  return __atomic_load_n(&d->stop, __ATOMIC_ACQUIRE) != 0;
}

/* Whether nothing more is to be expected for the request that a worker has. */
static bool settled(uint32_t k) {
  static uint64_t value[APP_WORDS];
  const soter_posix_extern* const x = &soter_app_externs[k];
  const soter_request* const r = &d->request[k];
  const soter_worker_status* const s = &d->status->worker[k];
  if (!r->outstanding || d->workers[k].command[0] == '\0') {
    return true;
  }
  if (__atomic_load_n(&s->starts, __ATOMIC_ACQUIRE) > 0U &&
      __atomic_load_n(&s->pid, __ATOMIC_ACQUIRE) == 0) {
    return true; /* it has ended */
  }
  const bool late = r->number > (uint64_t)answers;
  if (late && !any_answer) {
    return true;
  }
  soter_channel_head head;
  const soter_channel_state found =
      soter_channel_read(d->workers[k].answer, x->hash, x->out_size, r->number, &head, value);
  return found == SOTER_CHANNEL_FRESH ||
         (late && found != SOTER_CHANNEL_OTHER && found != SOTER_CHANNEL_EMPTY);
}

static bool all_settled(void) {
  const uint64_t taken = __atomic_load_n(&d->ring.tail, __ATOMIC_ACQUIRE);
  bool found = d->ring.head - taken < APP_SLOTS / 2U;
  for (uint32_t k = 0; d->shared && k < soter_app_extern_count; k++) {
    found = found && settled(k);
  }
  return found || stopping();
}

/* ------------------------------------------------------------------ what happens */

static void wait_for_ends(uint32_t many) {
  while (__atomic_load_n(&d->status->worker[0].ends, __ATOMIC_ACQUIRE) < many && !stopping()) {
    nap();
  }
}

static void happen(event* e) {
  soter_worker_status* const s = d->status == NULL ? NULL : &d->status->worker[0];
  e->over = true;
  if (strcmp(e->what, "held") == 0) {
    clock_ns += e->more;
  } else if (strcmp(e->what, "terminated") == 0) {
    (void)kill(getpid(), SIGTERM);
    while (!stopping()) {
      nap();
    }
  } else if (strcmp(e->what, "killed") == 0) {
    (void)kill(__atomic_load_n(&s->pid, __ATOMIC_ACQUIRE), SIGKILL);
    wait_for_ends((uint32_t)e->more);
  } else if (strcmp(e->what, "ended") == 0) {
    wait_for_ends((uint32_t)e->more);
  } else if (strcmp(e->what, "started") == 0) {
    while (__atomic_load_n(&s->starts, __ATOMIC_ACQUIRE) < (uint32_t)e->more && !stopping()) {
      nap();
    }
  } else {
    abort();
  }
}

/* ------------------------------------------------------------------ the clock */

int __wrap_clock_gettime(clockid_t id, struct timespec* t) {
  if (!__atomic_load_n(&owned, __ATOMIC_ACQUIRE)) {
    return __real_clock_gettime(id, t);
  }
  if (ours()) {
    (void)__atomic_add_fetch(&clock_ns, LOOK_NS, __ATOMIC_ACQ_REL);
  }
  const int64_t now = __atomic_load_n(&clock_ns, __ATOMIC_ACQUIRE);
  t->tv_sec = (time_t)(now / SECOND);
  t->tv_nsec = (long)(now % SECOND);
  return 0;
}

int __wrap_clock_nanosleep(clockid_t id, int flags, const struct timespec* t,
                           struct timespec* left) {
  if (!ours()) {
    return __real_clock_nanosleep(id, flags, t, left);
  }
  const int64_t at = (int64_t)t->tv_sec * SECOND + t->tv_nsec;
  while (!all_settled()) {
    nap();
  }
  clock_ns = at > clock_ns ? at : clock_ns;
  for (int i = 0; d->origin_ns > 0 && i < event_count; i++) {
    if (!events[i].over && clock_ns - d->origin_ns >= events[i].at_ns) {
      happen(&events[i]);
    }
  }
  return 0;
}

void* __wrap_soter_posix_run(void* driver) {
  d = (soter_posix*)driver;
  trusted = pthread_self();
  read_events();
  __atomic_store_n(&owned, true, __ATOMIC_RELEASE);
  return __real_soter_posix_run(driver);
}
