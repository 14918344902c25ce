/* soter_replay.c: a program in virtual time on a Cortex-M, its trace and its instructions counted.
 *
 * Purpose: the run that `soter run` makes, on the target: the same `trace_sha256`, and what each
 * instant costs by SysTick, which under `qemu -icount` counts instructions; then the same run once
 * more, for what each step costs alone. Topics from outside have the values of a recording.
 * Non-goals: clocks and devices (soter_loop.c). soter_app.h says which program, and is generated;
 * the words of its command line are the time in ns, the seed, how long an instruction takes, in ns,
 * and the file of the recording.
 */
#include "soter_app.h"
#include "soter_board.h"
#include "soter_check.h"
#include "soter_cortex_m.h"
#include "soter_loop.h"
#include "soter_loop_app.h"
#include "soter_recording.h"
#include "soter_semihosting.h"
#include "soter_sha256.h"

#include <string.h>

typedef struct {
  uint64_t until_ns, seed, instruction_ns;
  const char* recording; /* a file */
} settings;

typedef struct {
  uint64_t number, ticks, most; /* of instants, or of the steps of a component */
} costs;

static uint64_t number(const char** text) {
  SOTER_CHECK(text != NULL && *text != NULL);
  uint64_t n = 0;
  while (**text >= '0' && **text <= '9') {
    n = 10U * n + (uint64_t)(**text - '0');
    (*text)++;
  }
  *text += **text == ' ' ? 1 : 0;
  return n;
}

static settings read_settings(void) {
  static char room[160];
  const char* words = soter_semihosting_words(room, sizeof room);
  settings s;
  s.until_ns = number(&words);
  s.seed = number(&words);
  s.instruction_ns = number(&words);
  s.recording = words;
  return s;
}

static soter_recording recording;
static volatile uint32_t turns; /* of SysTick */

void SysTick_Handler(void) {
  turns++;
}

/* Ticks since SysTick began to count. */
static uint64_t ticks(void) {
  const uint32_t before = turns;
  const uint32_t left = SYST_CVR;
  const uint32_t around = turns;
  return (uint64_t)around * (SYST_MOST + 1U) + (before == around ? SYST_MOST - left : 0U);
}

static uint64_t instructions(uint64_t count, const settings* s) {
  const uint64_t ns = count * UINT64_C(1000000000) / BOARD_CLOCK_HZ;
  return s->instruction_ns == 0U ? 0U : (ns + s->instruction_ns / 2U) / s->instruction_ns;
}

static void note_cost(costs* c, uint64_t took) {
  SOTER_CHECK(c->most <= c->ticks);
  c->number++;
  c->ticks += took;
  c->most = took > c->most ? took : c->most;
}

static void say_cost(const char* before, const costs* c, const settings* s) {
  SOTER_CHECK(c->number > 0U || c->ticks == 0U);
  const uint64_t mean = c->number == 0U ? 0U : c->ticks / c->number;
  soter_say_number(before, instructions(c->most, s), " at most, ");
  soter_say_number("", instructions(mean, s), " on average, ");
  soter_say_number("", c->number, " times\n");
}

/* ------------------------------------------------------------------ externs */

/* An extern node; NULL: an extern plant. */
static const soter_loop_extern* node_of(uint32_t component) {
  SOTER_CHECK(component < APP_PROGRAM->components);
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    if (soter_app_externs[k].component == component) {
      return &soter_app_externs[k];
    }
  }
  return NULL;
}

/* What it answers, computed in place; NULL: a fault. */
static const void* answer_of(const soter_loop_extern* x, const APP_STATE* state) {
  SOTER_CHECK(x->gather != NULL && x->step != NULL);
  static uint64_t exchanged[2][APP_EXCHANGE_WORDS];
  (void)memset(exchanged, 0, sizeof exchanged);
  x->gather(state, exchanged[0]);
  return x->step(exchanged[0], exchanged[1]) == 0 ? exchanged[1] : NULL;
}

static void answer(APP_STATE* state, uint32_t due) {
  SOTER_CHECK(due < APP_PROGRAM->components);
  const soter_loop_extern* const x = node_of(due);
  if (x != NULL) {
    soter_answer(APP_PROGRAM, state, due, SOTER_OK, answer_of(x, state));
  } else {
    soter_app_answer(state, due);
  }
}

/* ------------------------------------------------------------------ the run */

static void run(APP_STATE* state, const settings* s, soter_sha256* hash, costs* c) {
  SOTER_CHECK(state != NULL && s->recording != NULL);
  const soter_program* const p = APP_PROGRAM;
  soter_recording_open(&recording, s->recording);
  for (int64_t next = soter_next_instant(p, state); next <= (int64_t)s->until_ns;
       next = soter_next_instant(p, state)) {
    uint32_t due = 0;
    soter_recording_publish(&recording, p, state, next);
    const uint64_t begin = ticks();
    while (soter_virtual_instant(p, state, &due) == SOTER_EXTERN_DUE) {
      answer(state, due);
    }
    note_cost(c, ticks() - begin);
    soter_sha256_add(hash, state, p->state_size);
  }
}

/* The step of a component that is due; of an extern node what is trusted: the gate. */
static uint64_t step_cost(APP_STATE* state, uint32_t i) {
  SOTER_CHECK(i < APP_PROGRAM->components);
  const soter_component_info* const info = &APP_PROGRAM->component[i];
  const bool latched = soter_components_of(state)[i].latched != 0U;
  const soter_loop_extern* const x = latched ? NULL : node_of(i);
  const bool moved = soter_header_of(state)->ct != info->phase_ns;
  const void* const given = x != NULL ? answer_of(x, state) : NULL;
  const uint64_t begin = ticks();
  if (info->is_extern && info->role == SOTER_ROLE_PLANT && !latched && moved) {
    soter_app_answer(state, i);
  } else {
    (void)soter_fire(APP_PROGRAM, state, i, given);
  }
  return ticks() - begin;
}

/* The run once more, step by step. */
static void count_steps(APP_STATE* state, const settings* s, costs* c) {
  SOTER_CHECK(APP_PROGRAM->components <= APP_COMPONENTS);
  const soter_program* const p = APP_PROGRAM;
  uint32_t due = 0;
  soter_recording_open(&recording, s->recording);
  for (int64_t next = soter_next_instant(p, state); next <= (int64_t)s->until_ns;
       next = soter_next_instant(p, state)) {
    soter_recording_publish(&recording, p, state, next);
    soter_progress(p, state);
    for (uint32_t i = 0; i < p->inputs; i++) {
      if (soter_header_of(state)->ct % p->input[i].every_ns == 0) {
        p->input[i].draw(state, NULL);
      }
    }
    for (uint32_t i = 0; i < p->components; i++) {
      if (soter_components_of(state)[i].pending != 0U) {
        note_cost(&c[i], step_cost(state, i));
      }
    }
    (void)soter_instant(p, state, &due);
  }
}

static void say_module(const soter_program* p, const soter_module* m, uint32_t index) {
  SOTER_CHECK(index < p->modules);
  soter_board_say("module ");
  soter_board_say(p->module[index].name);
  soter_say_number(": ", m->to_ac, " to AC, ");
  soter_say_number("", m->to_sc, " to SC, ");
  soter_say_number("", m->gate_faults, " gate faults\n");
  if (m->nan_looks > 0U) {
    soter_say_number("ttf or safer compared a NaN in ", m->nan_looks, " steps of its DM\n");
  }
}

void soter_check_failed(const char* file, int line, const char* what) {
  soter_board_say("soter has a defect: ");
  soter_board_say(file);
  soter_say_number(":", (uint64_t)line, ": not ");
  soter_board_say(what);
  soter_board_say("\n");
  soter_board_end(SOTER_EXIT_DEFECT);
}

int main(void) {
  static APP_STATE state;
  static costs steps[APP_COMPONENTS];
  const soter_program* const p = APP_PROGRAM;
  SOTER_CHECK(p->state_size == sizeof state);
  const settings s = read_settings();
  costs c = {0, 0, 0};
  SYST_RVR = SYST_MOST;
  SYST_CVR = 0U;
  SYST_CSR = 7U; /* counts processor clocks */
  const uint64_t begin = ticks();
  if (!soter_tested(p)) {
    return SOTER_EXIT_ARITHMETIC;
  }
  const uint64_t tested = ticks() - begin;
  soter_sha256 hash;
  char digest[65];
  soter_sha256_start(&hash);
  soter_start(p, &state, s.seed);
  run(&state, &s, &hash, &c);
  soter_sha256_end(&hash, digest);
  const uint32_t violations = soter_header_of(&state)->violations;
  soter_board_say(p->name);
  soter_say_number(violations == 0U ? ": safe, " : ": violated, ", violations, " violations, ");
  soter_say_number("", c.number, " instants\n");
  for (uint32_t i = 0; i < p->modules; i++) {
    say_module(p, soter_modules_of(p, &state) + i, i);
  }
  say_cost("instructions of an instant ", &c, &s);
  soter_say_number("instructions of the self-test ", instructions(tested, &s), "\n");
  soter_say_number("stack ", soter_stack_used(), " bytes used\n");
  soter_start(p, &state, s.seed);
  count_steps(&state, &s, steps);
  for (uint32_t i = 0; i < p->components; i++) {
    soter_board_say("instructions of a step of ");
    soter_board_say(p->component[i].name);
    say_cost(" ", &steps[i], &s);
  }
  soter_board_say("trace_sha256 "); /* last: it says that all of it ran */
  soter_board_say(digest);
  soter_board_say("\n");
  return violations == 0U ? 0 : SOTER_EXIT_VIOLATED;
}
