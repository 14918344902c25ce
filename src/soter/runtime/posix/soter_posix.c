/* soter_posix.c: the trusted thread.
 *
 * Purpose: wake at every instant of the calendar, run the plants and the trusted nodes, ask the
 * externs, take what they answered before the next instant; see whatever was late, and make it
 * safe. Non-goals: anything that may wait. It takes no lock, allocates nothing, writes no file;
 * workers and the logger are other processes and threads, whom it leaves what they need.
 *
 * An instant at ct:  wake at origin + ct | answers that came, at the ct before; that instant ends |
 * time moves | plants, DMs, SCs, other nodes, in the deployed order | externs are asked.
 * An extern that answers before the next instant has the effect it has in virtual time, so a run in
 * which nobody is late has the trace of `soter run`.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_posix.h"

#include <errno.h>
#include <linux/futex.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define SECOND INT64_C(1000000000)
#define LEAD_NS (SECOND / 20) /* from the decision to start until ct = 0 */
#define GIVE_UP_NS SECOND     /* so far behind the calendar begins anew */

static bool stopped(const soter_posix* d) {
  return __atomic_load_n(&d->stop, __ATOMIC_ACQUIRE) != 0;
}

/* Wakes `early_ns` before, and looks at the clock until it is time: what a wake-up costs, up to
 * that much, does not make us late. */
static void sleep_until(const soter_posix* d, int64_t at_ns) {
  SOTER_CHECK(d->options.early_ns >= 0);
  const int64_t ns = at_ns - d->options.early_ns;
  const struct timespec t = {.tv_sec = (time_t)(ns / SECOND), .tv_nsec = (long)(ns % SECOND)};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR && !stopped(d)) {
  }
  while (d->options.early_ns > 0 && soter_posix_clock() < at_ns && !stopped(d)) {
  }
}

/* ------------------------------------------------------------------ late */

static bool is_trusted(uint32_t component) {
  SOTER_CHECK(component < APP_PROGRAM->components);
  const soter_component_info* const info = &APP_PROGRAM->component[component];
  return info->role != SOTER_ROLE_PLANT && info->role != SOTER_ROLE_AC && !info->is_extern;
}

void soter_posix_missed(soter_posix* d, soter_miss kind, uint32_t component, int64_t by_ns) {
  SOTER_CHECK(component < APP_PROGRAM->components);
  SOTER_CHECK(by_ns > 0);
  (void)by_ns;
  if (kind == SOTER_MISS_RELEASE) {
    d->node[component].released_late++;
  } else if (kind == SOTER_MISS_COMPLETE) {
    d->node[component].completed_late++;
  } else {
    d->calendars++;
  }
  d->missed++;
  d->missed_now++;
  d->failsafe_now = true;
  soter_module* const m = soter_modules_of(APP_PROGRAM, &d->state);
  for (uint32_t i = 0; i < APP_PROGRAM->modules; i++) {
    m[i].gate_fault = 1;
    m[i].clean_needed = APP_PROGRAM->module[i].clean;
    d->cause[i] = SOTER_CAUSE_MISSED;
  }
}

static void publish_failsafe(soter_posix* d) {
  SOTER_CHECK(d->failsafe_now);
  const soter_component* const c = soter_components_of(&d->state);
  for (uint32_t i = 0; i < APP_PROGRAM->components; i++) {
    if (is_trusted(i) && c[i].oe != 0U && APP_PROGRAM->component[i].failsafe != NULL) {
      APP_PROGRAM->component[i].failsafe(&d->state);
    }
  }
  d->failsafe_now = false;
}

/* Releases of the trusted part that were slept through: misses that nobody makes up for. */
static void count_lost_releases(soter_posix* d, int64_t ct, int64_t behind_ns) {
  const soter_component* const c = soter_components_of(&d->state);
  SOTER_CHECK(behind_ns > GIVE_UP_NS);
  for (uint32_t i = 0; i < APP_PROGRAM->components; i++) {
    const int64_t period_ns = APP_PROGRAM->component[i].period_ns;
    SOTER_CHECK(period_ns > 0);
    if (is_trusted(i) && c[i].next <= ct + behind_ns) {
      const int64_t lost = (ct + behind_ns - c[i].next) / period_ns + 1;
      d->node[i].released_late += (uint64_t)lost;
      d->missed += (uint64_t)lost;
      d->missed_now += (uint32_t)lost;
    }
  }
}

/* A step out of turn; not before the first release, nor while a step lasts. */
static void step_now(soter_posix* d, uint32_t component) {
  SOTER_CHECK(component < APP_PROGRAM->components);
  const soter_component_info* const info = &APP_PROGRAM->component[component];
  const int64_t ct = soter_header_of(&d->state)->ct;
  const bool busy =
      info->effect != NULL && soter_stamps_of(APP_PROGRAM, &d->state)[info->held] > ct;
  if (ct >= info->phase_ns && !busy) {
    soter_components_of(&d->state)[component].pending = 1;
  }
}

/* The calendar has begun anew: DMs decide and SCs step in this instant, not at their releases. */
static void begin_in_sc(soter_posix* d) {
  for (uint32_t i = 0; i < APP_PROGRAM->modules; i++) {
    const soter_module_info* const module = &APP_PROGRAM->module[i];
    SOTER_CHECK(APP_PROGRAM->component[module->dm].role == SOTER_ROLE_DM);
    SOTER_CHECK(APP_PROGRAM->component[module->sc].role == SOTER_ROLE_SC);
    step_now(d, module->dm);
    step_now(d, module->sc);
  }
}

/* How long nothing was done before `now_ns`, and what actuators that obey leases did meanwhile. */
static void note_silence(soter_posix* d, int64_t now_ns) {
  const int64_t since = d->heartbeat_ns;
  SOTER_CHECK(now_ns >= since); /* the clock does not go back */
  if (since == 0 || now_ns - since <= d->silence_ns) {
    return;
  }
  d->silence_ns = now_ns - since;
  d->silence_ct = soter_header_of(&d->state)->ct;
  for (uint32_t k = 0; k < soter_app_lease_count; k++) {
    const soter_lease* const lease = &d->lease[k].lease;
    const bool obeyed = lease->state == SOTER_LEASE_HOLDS && lease->until > since;
    const int64_t law = now_ns - (obeyed ? lease->until : since);
    d->lease[k].silence_law_ns = law > 0 ? law : 0;
  }
}

/* ------------------------------------------------------------------ externs */

static int32_t extern_of(uint32_t component) {
  SOTER_CHECK(component < APP_PROGRAM->components);
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    if (soter_app_externs[k].component == component) {
      return (int32_t)k;
    }
  }
  return -1;
}

/* Wakes the worker. The word is in a segment that only we can write; the call never waits. */
static void wake(const soter_worker* w) {
  SOTER_CHECK(w->request != NULL);
  (void)syscall(SYS_futex, &((soter_channel_head*)w->request)->sequence, FUTEX_WAKE, 1, NULL, NULL,
                0);
}

static void ask(soter_posix* d, uint32_t k) {
  const soter_posix_extern* const x = &soter_app_externs[k];
  soter_request* const r = &d->request[k];
  const int64_t ct = soter_header_of(&d->state)->ct;
  SOTER_CHECK(soter_components_of(&d->state)[x->component].pending != 0U);
  SOTER_CHECK(x->in_size <= sizeof d->value);
  r->number++;
  r->asked_at_ns = ct;
  r->until_ns = ct + x->budget_ns;
  r->outstanding = true;
  d->worker[k].asked++;
  soter_components_of(&d->state)[x->component].pending = 0; /* its step is still to come */
  if (!d->shared) {
    return;
  }
  const soter_channel_head head = {
      .hash = x->hash, .number = r->number, .time_ns = (uint64_t)ct, .more = d->options.seed};
  (void)memset(d->value, 0, sizeof d->value);
  x->gather(&d->state, d->value);
  soter_channel_write(d->workers[k].request, &head, x->in_size, d->value);
  wake(&d->workers[k]);
}

/* The step of an extern, with its answer or without one; a gate fault of an AC has its cause. */
static void step_extern(soter_posix* d, uint32_t component, const void* answer, soter_cause cause) {
  const soter_component_info* const info = &APP_PROGRAM->component[component];
  soter_module* const m = soter_modules_of(APP_PROGRAM, &d->state);
  const bool of_module = info->role == SOTER_ROLE_AC;
  SOTER_CHECK(!of_module || (info->module >= 0 && info->module < APP_MODULES));
  const bool latched = of_module && m[info->module].gate_fault != 0U;
  (void)soter_fire(APP_PROGRAM, &d->state, component, answer);
  if (of_module && !latched && m[info->module].gate_fault != 0U) {
    d->cause[info->module] = cause;
  }
  soter_posix_tell(d);
}

static void answered(soter_posix* d, uint32_t k, const soter_channel_head* head) {
  const uint32_t component = soter_app_externs[k].component;
  soter_worker_times* const w = &d->worker[k];
  const soter_request* const r = &d->request[k];
  SOTER_CHECK(!r->outstanding && head->number == r->number);
  w->answered++;
  w->later += soter_header_of(&d->state)->ct > r->asked_at_ns ? 1U : 0U;
  __atomic_store_n(&w->in_a_row, 0U, __ATOMIC_RELAXED);
  const int64_t took = soter_posix_clock() - d->origin_ns - r->asked_at_ns;
  soter_histogram_add(&w->took, took);
  if (head->fault != 0U) {
    w->failed++;
  }
  step_extern(d, component, head->fault == 0U ? d->value : NULL, SOTER_CAUSE_GATE);
}

static void unanswered(soter_posix* d, uint32_t k, soter_channel_state found) {
  const uint32_t component = soter_app_externs[k].component;
  soter_worker_times* const w = &d->worker[k];
  SOTER_CHECK((uint32_t)found < SOTER_CHANNEL_STATES);
  w->missing++;
  w->seen[found]++;
  __atomic_store_n(&w->in_a_row, w->in_a_row + 1U, __ATOMIC_RELAXED);
  if (APP_PROGRAM->component[component].role == SOTER_ROLE_AC) {
    step_extern(d, component, NULL, SOTER_CAUSE_SILENT); /* other nodes: nothing is published */
  }
}

/* Takes what has come; gives up on whom `limit_ns`, a ct, leaves no more time. Where the calendar
 * is about to begin anew that is everybody: what they computed is about what was before. */
static void collect(soter_posix* d, int64_t limit_ns) {
  const bool lost = !stopped(d) && soter_posix_clock() - d->origin_ns - limit_ns > GIVE_UP_NS;
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    soter_request* const r = &d->request[k];
    if (!r->outstanding) {
      continue;
    }
    SOTER_CHECK(soter_app_externs[k].out_size <= sizeof d->value);
    soter_channel_head head;
    soter_channel_state found = SOTER_CHANNEL_EMPTY;
    if (d->shared) {
      found = soter_channel_read(d->workers[k].answer, soter_app_externs[k].hash,
                                 soter_app_externs[k].out_size, r->number, &head, d->value);
    }
    if (found == SOTER_CHANNEL_FRESH && !lost) {
      r->outstanding = false;
      answered(d, k, &head);
    } else if (lost || limit_ns >= r->until_ns) {
      r->outstanding = false;
      unanswered(d, k, found);
    }
  }
}

/* The first ct after which somebody's budget is over. */
static int64_t first_budget(const soter_posix* d) {
  int64_t first = INT64_MAX;
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    const soter_request* const r = &d->request[k];
    SOTER_CHECK(!r->outstanding || r->until_ns > r->asked_at_ns);
    if (r->outstanding && r->until_ns < first) {
      first = r->until_ns;
    }
  }
  return first;
}

/* ------------------------------------------------------------------ one instant */

static void note_takeover(soter_posix* d, uint32_t component, uint8_t before) {
  const int32_t module = APP_PROGRAM->component[component].module;
  SOTER_CHECK(module >= 0 && module < APP_MODULES);
  const soter_module* const m = soter_modules_of(APP_PROGRAM, &d->state) + module;
  if (before == SOTER_AC && m->mode == SOTER_SC) {
    uint32_t cause = d->cause[module];
    if (m->saw_gate_fault == 0U) {
      cause = m->ttf != 0U ? SOTER_CAUSE_TTF : SOTER_CAUSE_STALE;
    }
    SOTER_CHECK(cause < SOTER_CAUSES);
    d->takeovers[module][cause]++;
    d->why[module] = cause + 1U;
  }
}

static void fire(soter_posix* d, uint32_t component) {
  const soter_component_info* const info = &APP_PROGRAM->component[component];
  const soter_component* const c = soter_components_of(&d->state) + component;
  SOTER_CHECK(c->pending != 0U);
  if (info->is_extern && c->latched == 0U && soter_header_of(&d->state)->ct != info->phase_ns) {
    soter_app_answer(&d->state, component); /* an extern plant, in C */
    return;
  }
  if (info->role != SOTER_ROLE_DM) {
    if (info->role == SOTER_ROLE_AC) {
      step_extern(d, component, NULL, SOTER_CAUSE_GATE);
    } else {
      (void)soter_fire(APP_PROGRAM, &d->state, component, NULL);
    }
    return;
  }
  const uint8_t before = soter_modules_of(APP_PROGRAM, &d->state)[info->module].mode;
  (void)soter_fire(APP_PROGRAM, &d->state, component, NULL);
  note_takeover(d, component, before);
  soter_posix_looked(d, component);
}

static void timed(soter_posix* d, uint32_t component) {
  const int64_t due_ns = d->origin_ns + soter_header_of(&d->state)->ct;
  const bool trusted = is_trusted(component);
  const int64_t limit = soter_posix_late_limit(d, component);
  soter_node_times* const times = &d->node[component];
  const int64_t start_ns = soter_posix_clock();
  const int64_t late_ns = start_ns - due_ns;
  soter_histogram_add(&times->late, late_ns);
  if (trusted && late_ns > limit) {
    soter_posix_missed(d, SOTER_MISS_RELEASE, component, late_ns);
  }
  fire(d, component);
  const int64_t end_ns = soter_posix_clock();
  SOTER_CHECK(end_ns >= start_ns); /* the clock does not go back */
  const int64_t complete_ns = end_ns - due_ns;
  soter_posix_done(d, component, start_ns, end_ns);
  soter_histogram_add(&times->complete, complete_ns);
  if (APP_PROGRAM->component[component].role == SOTER_ROLE_SC) {
    soter_histogram_add(&d->output, complete_ns);
  } else if (APP_PROGRAM->component[component].role == SOTER_ROLE_DM) {
    const int32_t module = APP_PROGRAM->component[component].module;
    SOTER_CHECK(module >= 0 && module < APP_MODULES);
    d->times.look_late_ns[module] = late_ns + d->moved_ns;
    d->times.look_done_ns[module] = complete_ns + d->moved_ns;
  }
  if (trusted && late_ns <= limit && complete_ns > limit + soter_app_response_ns[component]) {
    soter_posix_missed(d, SOTER_MISS_COMPLETE, component, complete_ns);
  }
  d->untrusted_late_now = d->untrusted_late_now || (!trusted && late_ns > limit);
}

static void draw_inputs(soter_posix* d) {
  const int64_t ct = soter_header_of(&d->state)->ct;
  for (uint32_t i = 0; i < APP_PROGRAM->inputs; i++) {
    SOTER_CHECK(APP_PROGRAM->input[i].every_ns > 0);
    if (ct % APP_PROGRAM->input[i].every_ns == 0) {
      APP_PROGRAM->input[i].draw(&d->state, NULL);
    }
  }
  soter_posix_listen(d);
}

/* The trusted part; externs are asked when all of it is done. */
static void steps(soter_posix* d) {
  SOTER_CHECK(soter_header_of(&d->state)->firing != 0U);
  const soter_component* const c = soter_components_of(&d->state);
  for (uint32_t i = 0; i < APP_PROGRAM->components; i++) {
    if (c[i].pending != 0U && extern_of(i) < 0) {
      timed(d, i);
    }
  }
  if (d->failsafe_now) {
    publish_failsafe(d);
  }
  soter_posix_tell(d);
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    const uint32_t i = soter_app_externs[k].component;
    if (c[i].pending != 0U && c[i].latched == 0U) {
      ask(d, k);
    } else if (c[i].pending != 0U) {
      (void)soter_fire(APP_PROGRAM, &d->state, i, NULL);
    }
  }
}

/* The instant at ct is complete: its properties are judged, the logger gets it. */
static void end_instant(soter_posix* d) {
  uint32_t due = 0;
  if (soter_header_of(&d->state)->firing == 0U) {
    return;
  }
  const soter_status status = soter_instant(APP_PROGRAM, &d->state, &due);
  SOTER_CHECK(status == SOTER_INSTANT_DONE); /* whoever was due has stepped or was asked */
  (void)status;
  d->times.modes = soter_posix_modes(d);
  soter_posix_status(d, d->times.modes);
  (void)soter_ring_put(&d->ring, &d->times, &d->state);
}

static void begin_instant(soter_posix* d, int64_t ct) {
  soter_instant_times* const times = &d->times;
  SOTER_CHECK(ct > soter_header_of(&d->state)->ct); /* instants come in the calendar's order */
  const int64_t now = soter_posix_clock();
  d->missed_now = 0;
  d->untrusted_late_now = false;
  note_silence(d, now);
  times->independent_ns = soter_posix_independent();
  times->ct = ct;
  times->wake_ns = now - d->origin_ns - ct;
  for (uint32_t i = 0; i < APP_PROGRAM->modules; i++) {
    times->look_late_ns[i] = SOTER_NEVER;
    times->look_done_ns[i] = SOTER_NEVER;
  }
  soter_histogram_add(&d->wake, times->wake_ns);
  const bool anew = times->wake_ns > GIVE_UP_NS;
  d->moved_ns = anew ? times->wake_ns : 0;
  if (anew) {
    count_lost_releases(d, ct, times->wake_ns);
    d->origin_ns = now - ct;
    soter_posix_missed(d, SOTER_MISS_CALENDAR, 0, times->wake_ns);
  }
  soter_progress(APP_PROGRAM, &d->state);
  SOTER_CHECK(soter_header_of(&d->state)->ct == ct);
  if (anew) {
    begin_in_sc(d);
  }
  draw_inputs(d);
  steps(d);
  const int64_t done = soter_posix_clock();
  times->done_ns = done - d->origin_ns - ct;
  times->misses = d->missed_now;
  d->instants++;
  d->late_instants += d->missed_now > 0U ? 1U : 0U;
  d->late_untrusted += d->missed_now == 0U && d->untrusted_late_now ? 1U : 0U;
  __atomic_store_n(&d->heartbeat_ns, done, __ATOMIC_RELEASE);
}

/* Sleeps until the instant at ct; between, whoever's budget ends is looked at. */
static void wait_for(soter_posix* d, int64_t ct) {
  for (int64_t end = first_budget(d); end < ct && !stopped(d); end = first_budget(d)) {
    sleep_until(d, d->origin_ns + end);
    collect(d, end);
  }
  sleep_until(d, d->origin_ns + ct);
}

/* ------------------------------------------------------------------ the run */

/* An AC that is not there yet is not given control: its first outputs have to be clean. */
static void distrust(soter_posix* d) {
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    const soter_component_info* const info =
        &APP_PROGRAM->component[soter_app_externs[k].component];
    SOTER_CHECK(info->role != SOTER_ROLE_AC || (info->module >= 0 && info->module < APP_MODULES));
    if (info->role == SOTER_ROLE_AC && !(d->shared && soter_posix_ready(d, k))) {
      soter_modules_of(APP_PROGRAM, &d->state)[info->module].clean_needed =
          APP_PROGRAM->module[info->module].clean;
    }
  }
}

/* What this machine's wake-ups cost with nothing to do, as often as ours, for comparison. */
static void bare_wakeups(soter_posix* d) {
  const int64_t period = soter_posix_shortest();
  SOTER_CHECK(period > 0);
  int64_t at = soter_posix_clock() + period;
  for (int64_t left = d->options.bare_ns; left > 0 && !stopped(d); left -= period) {
    sleep_until(d, at);
    soter_histogram_add(&d->bare, soter_posix_clock() - at);
    at += period;
  }
}

static void page_faults(const struct rusage* before, soter_posix* d) {
  struct rusage now;
  (void)getrusage(RUSAGE_THREAD, &now);
  d->minor_faults = (uint64_t)(now.ru_minflt - before->ru_minflt);
  d->major_faults = (uint64_t)(now.ru_majflt - before->ru_majflt);
}

void* soter_posix_run(void* driver) {
  soter_posix* const d = (soter_posix*)driver;
  SOTER_CHECK(d != NULL && d->options.until_ns > 0);
  soter_posix_become(d);
  __atomic_store_n(&d->began, true, __ATOMIC_RELEASE);
  soter_start(APP_PROGRAM, &d->state, d->options.seed);
  distrust(d);
  bare_wakeups(d);
  struct rusage before;
  (void)getrusage(RUSAGE_THREAD, &before);
  d->origin_ns = soter_posix_clock() + LEAD_NS;
  soter_posix_begin(d);
  int64_t ct = soter_next_instant(APP_PROGRAM, &d->state);
  while (ct <= d->options.until_ns && !stopped(d)) {
    wait_for(d, ct);
    if (stopped(d)) {
      break;
    }
    collect(d, ct);
    end_instant(d);
    begin_instant(d, ct);
    ct = soter_next_instant(APP_PROGRAM, &d->state);
  }
  ct = stopped(d) ? 0 : ct;
  wait_for(d, ct);
  if (!stopped(d)) {
    note_silence(d, soter_posix_clock());
  }
  collect(d, ct);
  end_instant(d);
  page_faults(&before, d);
  __atomic_store_n(&d->done, true, __ATOMIC_RELEASE);
  return NULL;
}
