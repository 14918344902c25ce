/* soter_replay.c: a program in virtual time on a Cortex-M, its trace and its instructions counted.
 *
 * Purpose: the run that `soter run` makes, on the target: the same `trace_sha256`, and what each
 * instant costs by SysTick, which under `qemu -icount` counts instructions. Non-goals: clocks and
 * devices (soter_loop.c). soter_app.h says which program, and is generated; the words of its
 * command line are the time in ns, the seed, and how long an instruction takes, in ns.
 */
#include "soter_app.h"
#include "soter_board.h"
#include "soter_cortex_m.h"
#include "soter_loop.h"
#include "soter_loop_app.h"
#include "soter_semihosting.h"
#include "soter_sha256.h"

#include <string.h>

typedef struct {
  uint64_t until_ns, seed, instruction_ns;
} settings;

typedef struct {
  uint64_t instants, ticks, most;
} costs;

static uint64_t number(const char** text) {
  uint64_t n = 0;
  while (**text >= '0' && **text <= '9') {
    n = 10U * n + (uint64_t)(**text - '0');
    (*text)++;
  }
  *text += **text == ' ' ? 1 : 0;
  return n;
}

static settings read_settings(void) {
  char room[96];
  const char* words = soter_semihosting_words(room, sizeof room);
  settings s;
  s.until_ns = number(&words);
  s.seed = number(&words);
  s.instruction_ns = number(&words);
  return s;
}

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

/* The step of an extern, in place. */
static void answer(APP_STATE* state, uint32_t due) {
  static uint64_t exchanged[2][APP_EXCHANGE_WORDS];
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    const soter_loop_extern* const x = &soter_app_externs[k];
    if (x->component == due) {
      (void)memset(exchanged, 0, sizeof exchanged);
      x->gather(state, exchanged[0]);
      const bool fine = x->step(exchanged[0], exchanged[1]) == 0;
      soter_answer(APP_PROGRAM, state, due, fine ? SOTER_OK : SOTER_EXTERN_FAULT, exchanged[1]);
      return;
    }
  }
  soter_app_answer(state, due);
}

static void run(APP_STATE* state, const settings* s, soter_sha256* hash, costs* c) {
  const soter_program* const p = APP_PROGRAM;
  while (soter_next_instant(p, state) <= (int64_t)s->until_ns) {
    uint32_t due = 0;
    const uint64_t begin = ticks();
    while (soter_virtual_instant(p, state, &due) == SOTER_EXTERN_DUE) {
      answer(state, due);
    }
    const uint64_t took = ticks() - begin;
    c->instants++;
    c->ticks += took;
    c->most = took > c->most ? took : c->most;
    soter_sha256_add(hash, state, p->state_size);
  }
}

static void say_module(const soter_program* p, const soter_module* m, uint32_t index) {
  soter_board_say("module ");
  soter_board_say(p->module[index].name);
  soter_say_number(": ", m->to_ac, " to AC, ");
  soter_say_number("", m->to_sc, " to SC, ");
  soter_say_number("", m->gate_faults, " gate faults\n");
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
  const soter_program* const p = APP_PROGRAM;
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
  soter_say_number("", c.instants, " instants\n");
  for (uint32_t i = 0; i < p->modules; i++) {
    say_module(p, soter_modules_of(p, &state) + i, i);
  }
  soter_say_number("instructions ", instructions(c.most, &s), " an instant at most, ");
  const uint64_t mean = c.instants == 0U ? 0U : c.ticks / c.instants;
  soter_say_number("", instructions(mean, &s), " on average; ");
  soter_say_number("", instructions(tested, &s), " the self-test\n");
  soter_say_number("stack ", soter_stack_used(), " bytes used\n");
  soter_board_say("trace_sha256 ");
  soter_board_say(digest);
  soter_board_say("\n");
  return violations == 0U ? 0 : SOTER_EXIT_VIOLATED;
}
