/* soter_loop.c: a program against the clock on a Cortex-M.
 *
 * Purpose: SysTick is the clock. In its interrupt actuators obey leases or hold the law; below it,
 * in PendSV, plants, DMs and SCs step at their instants; below that, in a thread without
 * privileges, extern nodes compute (soter_unprivileged.h), until their budget ends. A fault of the
 * trusted part, a check that fails: the law, and then the watchdog. Non-goals: devices
 * (soter_board.h).
 *
 * After a start, whatever its cause, actuators hold the law until the last look of every DM found
 * `safer` on fresh reads and a lease is in force (docs/proof.md, "Arming"): once, then never again.
 */
#include "soter_loop.h"

#include "soter_app.h"
#include "soter_board.h"
#include "soter_check.h"
#include "soter_cortex_m.h"
#include "soter_loop_app.h"
#include "soter_sha256.h"

#include <string.h>

#define SCB_ICSR (*(volatile uint32_t*)0xE000ED04U)
#define FROM_THREAD 8U /* of an EXC_RETURN */
#define PEND_INSTANT (1U << 28)
#define SC 1U /* of the nodes of a grant */
#define TICK_COUNTS ((uint32_t)(BOARD_CLOCK_HZ * APP_TICK_NS / INT64_C(1000000000)))
#define APART __attribute__((section(".ac_bss")))

typedef struct {
  bool outstanding;
  int64_t asked_ns, until_ns;
} request;

/* A lease, on both sides. */
typedef struct {
  soter_lease lease;
  soter_grant grant;
  int64_t done[APP_NODES];
  uint64_t taken[APP_COMMAND_WORDS];
  bool armed;
  bool silent; /* SC read what was too old: of what it does then nothing is proved */
} held;

static APP_STATE state;
static volatile uint32_t ticks_low = UINT32_MAX; /* since the start; the first one is at 0 */
static volatile uint32_t ticks_high = UINT32_MAX;
static volatile int64_t next_ns;     /* the instant that comes */
static volatile uint32_t unfinished; /* ticks since an instant became due */
static request requests[APP_EXTERNS + 1];
static int64_t begun_ns[APP_COMPONENTS + 1], ended_ns[APP_COMPONENTS + 1]; /* of this instant */
static held modules[APP_LEASES + 1];
static uint64_t law_or_command[APP_COMMAND_WORDS];
static int64_t fault_ns = -1, takeover_ns;
APART static uint64_t exchanged[APP_EXTERNS + 1][2][APP_EXCHANGE_WORDS];

#if defined(SOTER_TRACED)
static soter_sha256 trace;   /* of all of the state */
static soter_sha256 trusted; /* of modes, stamps, topics, variables: not of who was at fault when */
static uint32_t instants;
#endif
#if defined(SOTER_COUNTED) /* ns that an instruction takes, in an emulator */
static struct {
  uint64_t instants, total, most; /* ns from an interrupt to the commands of its instant */
  uint64_t long_ones;             /* instants that were still going on at the next tick */
  uint64_t tick;                  /* ns from an interrupt until actuators have obeyed, at most */
  int64_t due;                    /* the tick whose interrupt made the instant due */
} counted;
#endif

/* ------------------------------------------------------------------ the clock */

static int64_t tick_time(void) {
  return (int64_t)((uint64_t)ticks_high << 32 | ticks_low) * APP_TICK_NS;
}

/* Gives the ns since the start. */
static int64_t clock_ns(void) {
  for (;;) {
    const int64_t before = tick_time();
    const uint32_t passed = TICK_COUNTS - 1U - SYST_CVR;
    if (tick_time() == before) {
      return before + (int64_t)passed * INT64_C(1000000000) / BOARD_CLOCK_HZ;
    }
  }
}

/* ------------------------------------------------------------------ actuators */

static void apply(uint32_t i, int64_t now) {
  const soter_loop_lease* const m = &soter_app_leases[i];
  SOTER_CHECK(i < soter_app_lease_count && m->lease->size <= sizeof law_or_command);
  const bool leased = soter_lease_read(&modules[i].lease, now, law_or_command);
  soter_board_actuate(m->module, law_or_command, m->lease->size, leased);
}

/* Constants alone: nothing of the program is read. */
static void hold_the_law(void) {
  __asm volatile("cpsid i" ::: "memory");
  for (uint32_t i = 0; i < soter_app_lease_count; i++) {
    const soter_lease_info* const lease = soter_app_leases[i].lease;
    soter_board_actuate(soter_app_leases[i].module, lease->law, lease->size, false);
  }
}

/* A fault: of the thread, whose step ends, or of the trusted part. */
__attribute__((used)) static uint32_t faulted(uint32_t from) {
  if ((from & FROM_THREAD) == 0U) {
    hold_the_law();
    soter_board_end(SOTER_EXIT_FAULT);
  }
  return soter_unprivileged_stopped(from);
}

__attribute__((naked)) void HardFault_Handler(void) {
  __asm volatile("mov r0, lr\n push {r0, lr}\n bl faulted\n pop {r1, r2}\n bx r0");
}

void soter_check_failed(const char* file, int line, const char* what) {
  (void)file;
  (void)line;
  (void)what;
  hold_the_law();
  soter_board_end(SOTER_EXIT_DEFECT);
}

#if defined(SOTER_COUNTED)
static void count_instant(void) {
  const uint64_t took = (uint64_t)(clock_ns() - counted.due);
  counted.instants++;
  counted.total += took;
  counted.most = took > counted.most ? took : counted.most;
  counted.long_ones += took >= (uint64_t)APP_TICK_NS ? 1U : 0U;
}

static void count_tick(int64_t now) {
  const uint64_t took = (uint64_t)(clock_ns() - now);
  counted.tick = took > counted.tick ? took : counted.tick;
}
#endif

void SysTick_Handler(void) {
  ticks_low++;
  ticks_high += ticks_low == 0U ? 1U : 0U;
  const int64_t now = tick_time();
  for (uint32_t i = 0; i < soter_app_lease_count; i++) {
    apply(i, now);
  }
#if defined(SOTER_COUNTED)
  count_tick(now);
#endif
  unfinished = unfinished > 0U ? unfinished + 1U : 0U;
  if (unfinished == 0U && next_ns <= now) {
    unfinished = 1U;
#if defined(SOTER_COUNTED)
    counted.due = now;
#endif
    SCB_ICSR = PEND_INSTANT;
  }
  if (unfinished < APP_PATIENCE) {
    soter_board_watchdog();
  }
}

/* ------------------------------------------------------------------ leases */

/* Whether a part of the module that is due at ct reads what is older than it may be. */
static bool reads_old(const soter_loop_lease* m, int64_t ct) {
  const soter_component* const c = soter_components_of(&state);
  const int64_t* const stamps = soter_stamps_of(APP_PROGRAM, &state);
  bool old = false;
  for (uint32_t i = 0; i < m->age_count; i++) {
    const soter_read_age* const a = &m->ages[i];
    SOTER_CHECK(a->component < APP_PROGRAM->components && a->topic < APP_PROGRAM->topics);
    const int64_t stamp = stamps[a->topic];
    old = old || (c[a->component].pending != 0U && (stamp == SOTER_NEVER || ct - stamp > a->most));
  }
  return old;
}

/* Of a module that was never armed nobody counts on a lease: sensors may still be silent. */
static void note_old_reads(int64_t ct) {
  for (uint32_t i = 0; i < soter_app_lease_count; i++) {
    modules[i].silent = modules[i].silent && modules[i].armed;
    modules[i].silent = modules[i].silent || reads_old(&soter_app_leases[i], ct);
  }
}

/* Each step counts from its own beginning; SC's output is out with all the others. */
static void granted(uint32_t i, int64_t out) {
  const soter_loop_lease* const m = &soter_app_leases[i];
  SOTER_CHECK(m->grant->nodes <= APP_NODES);
  held* const h = &modules[i];
  const soter_component* const c = soter_components_of(&state);
  for (uint32_t k = 0; k < m->grant->nodes; k++) {
    const uint32_t x = m->components[k];
    if (begun_ns[x] >= 0 && c[x].latched == 0U) {
      (void)soter_grant_done(&h->grant, k, begun_ns[x], k == SC ? out : ended_ns[x]);
    }
  }
}

/* Until when actuators that hold the law may begin to obey; SOTER_NEVER: not in this state. */
static int64_t begin_by(uint32_t module) {
  SOTER_CHECK(module < APP_PROGRAM->modules);
  const soter_module* const m = soter_modules_of(APP_PROGRAM, &state) + module;
  const uint32_t dm = APP_PROGRAM->module[module].dm;
  return m->safer != 0U && m->stale == 0U ? soter_components_of(&state)[dm].next : SOTER_NEVER;
}

static void give_lease(uint32_t i, int64_t now) {
  const soter_loop_lease* const m = &soter_app_leases[i];
  SOTER_CHECK(m->lease->size <= APP_COMMAND_WORDS * sizeof(uint64_t));
  held* const h = &modules[i];
  uint64_t command[APP_COMMAND_WORDS];
  int64_t stamp = 0;
  int64_t expiry = 0;
  if (h->silent || !soter_grant_lease(&h->grant, now, &stamp, &expiry)) {
    return;
  }
  m->gather(&state, command);
  __asm volatile("cpsid i" ::: "memory");
  if (!h->armed &&
      soter_lease_may_arm(&h->lease, now, stamp, expiry, begin_by(m->module)) == SOTER_ARM_FINE) {
    soter_lease_arm(&h->lease);
    h->armed = true;
  }
  (void)soter_lease_take(&h->lease, now, command, stamp, expiry);
  __asm volatile("cpsie i" ::: "memory");
}

static void start_leases(void) {
  SOTER_CHECK(soter_app_lease_count == APP_LEASES);
  for (uint32_t i = 0; i < soter_app_lease_count; i++) {
    held* const h = &modules[i];
    soter_grant_init(&h->grant, soter_app_leases[i].grant, h->done);
    soter_lease_init(&h->lease, soter_app_leases[i].lease, h->taken);
    h->lease.state = SOTER_LEASE_ENDED; /* the start set comes first */
  }
}

/* ------------------------------------------------------------------ externs */

static void note_fault(int64_t asked_ns) {
  SOTER_CHECK(asked_ns >= 0);
  fault_ns = fault_ns < 0 ? asked_ns : fault_ns;
}

static void note_takeover(void) {
  SOTER_CHECK(fault_ns <= soter_header_of(&state)->ct);
  const soter_module* const m = soter_modules_of(APP_PROGRAM, &state);
  bool sc = true;
  for (uint32_t i = 0; i < APP_PROGRAM->modules; i++) {
    sc = sc && m[i].mode == SOTER_SC;
  }
  if (fault_ns >= 0 && sc && takeover_ns == 0) {
    takeover_ns = soter_header_of(&state)->ct - fault_ns;
  }
}

/* Takes the answer of the extern that was asked, if it is there or its budget is over. */
static void collect(int64_t limit_ns) {
  SOTER_CHECK(soter_app_extern_count == APP_EXTERNS);
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    request* const r = &requests[k];
    const soter_unprivileged_state now = soter_unprivileged_now();
    if (!r->outstanding || (now == SOTER_UNPRIVILEGED_RUNS && limit_ns < r->until_ns)) {
      continue;
    }
    const bool fine = now == SOTER_UNPRIVILEGED_DONE && soter_unprivileged_result() == 0;
    r->outstanding = false;
    soter_unprivileged_end();
    if (!fine) {
      note_fault(r->asked_ns);
    }
    const uint32_t component = soter_app_externs[k].component;
    (void)soter_fire(APP_PROGRAM, &state, component, fine ? exchanged[k][1] : NULL);
  }
}

/* The first one that waits: one at a time computes. */
static void ask(int64_t ct) {
  soter_component* const c = soter_components_of(&state);
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    const soter_loop_extern* const x = &soter_app_externs[k];
    if (c[x->component].pending == 0U) {
      continue;
    }
    SOTER_CHECK(!requests[k].outstanding);
    c[x->component].pending = 0; /* its step is still to come */
    requests[k].outstanding = true;
    requests[k].asked_ns = ct;
    requests[k].until_ns = ct + x->budget_ns;
    (void)memset(exchanged[k], 0, sizeof exchanged[k]);
    x->gather(&state, exchanged[k][0]);
    soter_unprivileged_begin(x->step, exchanged[k][0], exchanged[k][1]);
  }
}

static bool is_unprivileged(uint32_t component) {
  SOTER_CHECK(component < APP_PROGRAM->components);
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    if (soter_app_externs[k].component == component) {
      return true;
    }
  }
  return false;
}

/* ------------------------------------------------------------------ one instant */

static void sense(int64_t ct) {
  uint64_t value[APP_TOPIC_WORDS];
  for (uint32_t i = 0; i < APP_PROGRAM->inputs; i++) {
    if (ct % APP_PROGRAM->input[i].every_ns == 0) {
      APP_PROGRAM->input[i].draw(&state, NULL);
    }
  }
  for (uint32_t i = 0; i < APP_PROGRAM->topics; i++) {
    int64_t measured = 0;
    SOTER_CHECK(APP_PROGRAM->topic[i].size <= sizeof value);
    if (APP_PROGRAM->topic[i].publish != NULL && soter_board_sense(i, value, ct, &measured)) {
      (void)soter_publish(APP_PROGRAM, &state, i, value, measured < ct ? measured : ct);
    }
  }
}

static void trusted_steps(void) {
  SOTER_CHECK(APP_PROGRAM->components <= APP_COMPONENTS);
  const soter_component* const c = soter_components_of(&state);
  for (uint32_t i = 0; i < APP_PROGRAM->components; i++) {
    begun_ns[i] = -1;
    if (c[i].pending != 0U && !is_unprivileged(i)) {
      begun_ns[i] = clock_ns();
      if (APP_PROGRAM->component[i].is_extern && c[i].latched == 0U &&
          soter_header_of(&state)->ct != APP_PROGRAM->component[i].phase_ns) {
        soter_app_answer(&state, i); /* an extern plant, in C */
      } else {
        (void)soter_fire(APP_PROGRAM, &state, i, NULL);
      }
      ended_ns[i] = clock_ns();
    }
  }
}

static void end_instant(void) {
  uint32_t due = 0;
  if (soter_header_of(&state)->firing == 0U) {
    return;
  }
  const soter_status status = soter_instant(APP_PROGRAM, &state, &due);
  SOTER_CHECK(status == SOTER_INSTANT_DONE); /* whoever was due has stepped or was asked */
  (void)status;
#if defined(SOTER_TRACED)
  const uint8_t* const stamps = (const uint8_t*)soter_stamps_of(APP_PROGRAM, &state);
  soter_sha256_add(&trace, &state, sizeof state);
  for (uint32_t i = 0; i < APP_PROGRAM->modules; i++) {
    soter_sha256_add(&trusted, &soter_modules_of(APP_PROGRAM, &state)[i].mode, 1U);
  }
  soter_sha256_add(&trusted, stamps, sizeof state - (size_t)(stamps - (const uint8_t*)&state));
  instants++;
#endif
}

#if defined(SOTER_TRACED) || defined(SOTER_COUNTED)
/* The end of a run that is compared with another one, or counted. */
static void finish(void) {
  __asm volatile("cpsid i" ::: "memory");
#if defined(SOTER_COUNTED)
  soter_say_number("interrupt to command ", counted.most / SOTER_COUNTED, " at most, ");
  soter_say_number("", counted.total / counted.instants / SOTER_COUNTED, " on average\n");
  soter_say_number("interrupt to actuators ", counted.tick / SOTER_COUNTED, " at most\n");
  soter_say_number("", counted.instants, " instants, ");
  soter_say_number("", counted.long_ones, " longer than a tick\n");
  soter_say_number("stack ", soter_stack_used(), " bytes used\n");
#endif
#if defined(SOTER_TRACED)
  char digest[65];
  soter_sha256_end(&trusted, digest);
  soter_board_say("trusted_sha256 ");
  soter_board_say(digest);
  soter_board_say("\n");
  soter_sha256_end(&trace, digest);
  soter_say_number("", instants, " instants, ");
  soter_say_number("", soter_header_of(&state)->violations, " violations\n");
  soter_say_number("takeover ", (uint64_t)takeover_ns, " ns\n");
  for (uint32_t i = 0; i < soter_app_lease_count; i++) {
    soter_say_number("lease ", modules[i].lease.state, "\n");
  }
  soter_board_say("trace_sha256 ");
  soter_board_say(digest);
  soter_board_say("\n");
#endif
  soter_board_end(0);
}
#endif

/* What is due at next_ns; gives what PendSV returns to. */
__attribute__((used)) static uint32_t instant(uint32_t from) {
  const int64_t ct = next_ns;
  SOTER_CHECK(unfinished > 0U);
  collect(ct);
  end_instant();
#if defined(SOTER_TRACED) || defined(SOTER_COUNTED)
  if (ct > APP_TRACED_NS) {
    finish();
  }
#endif
  soter_progress(APP_PROGRAM, &state);
  sense(ct);
  note_old_reads(ct);
  trusted_steps();
  note_takeover();
  const int64_t out = clock_ns();
  for (uint32_t i = 0; i < soter_app_lease_count; i++) {
    granted(i, out);
    give_lease(i, out);
  }
#if defined(SOTER_COUNTED)
  count_instant();
#endif
  ask(ct);
  next_ns = soter_next_instant(APP_PROGRAM, &state);
  SOTER_CHECK(next_ns > ct);
  unfinished = 0U;
  return soter_unprivileged_return(from);
}

__attribute__((naked)) void PendSV_Handler(void) {
  __asm volatile("mov r0, lr\n push {r0, lr}\n bl instant\n pop {r1, r2}\n bx r0");
}

int main(void) {
  SOTER_CHECK(APP_PROGRAM->state_size == sizeof state);
  if (!soter_tested(APP_PROGRAM)) {
    return SOTER_EXIT_ARITHMETIC;
  }
#if defined(SOTER_TRACED)
  soter_sha256_start(&trace);
  soter_sha256_start(&trusted);
#endif
  soter_start(APP_PROGRAM, &state, 1U);
  next_ns = soter_next_instant(APP_PROGRAM, &state);
  start_leases();
  soter_unprivileged_protect();
  SYST_RVR = TICK_COUNTS - 1U;
  SYST_CVR = 0U;
  SYST_CSR = 7U; /* the first tick, at 0, is a tick away */
  soter_unprivileged_become();
}
