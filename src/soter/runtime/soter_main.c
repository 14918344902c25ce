/* soter_main.c: a program as a command: runs it in virtual time and prints what happened.
 *
 * Purpose: what `soter build --target c` gives needs nothing but a C compiler, and prints the same
 * `trace_sha256` as `soter run` (on a little-endian machine; the trace is the bytes of the state).
 * Non-goals: clocks, sensors, logs. soter_app.h says which program, and is generated.
 *
 * usage: PROGRAM [--until SECONDS] [--seed N]; exits 0 safe, 1 this machine does not compute as the
 * program means, 2 usage, 3 a property was violated, 70 a check of the run-time failed.
 */
#include "soter_app.h"
#include "soter_sha256.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EXIT_SAFE 0
#define EXIT_USAGE 2
#define EXIT_VIOLATED 3
#define EXIT_DEFECT 70
#define UNTIL_S_MAX 4.0e9

static bool parse_until(const char* text, int64_t* until_ns) {
  char* end = NULL;
  const double seconds = strtod(text, &end);
  if (end == text || (*end != '\0' && strcmp(end, "s") != 0)) {
    return false;
  }
  if (!(seconds > 0.0 && seconds < UNTIL_S_MAX)) {
    return false;
  }
  *until_ns = (int64_t)(seconds * 1e9 + 0.5);
  return true;
}

static bool parse_seed(const char* text, uint64_t* seed) {
  char* end = NULL;
  errno = 0;
  const unsigned long long number = strtoull(text, &end, 10);
  if (text[0] < '0' || text[0] > '9' || *end != '\0' || errno != 0) {
    return false;
  }
  *seed = (uint64_t)number;
  return true;
}

static bool parse(int count, char** words, int64_t* until_ns, uint64_t* seed) {
  for (int i = 1; i < count; i += 2) {
    if (i + 1 >= count) {
      return false;
    }
    if (strcmp(words[i], "--until") == 0 && parse_until(words[i + 1], until_ns)) {
      continue;
    }
    if (strcmp(words[i], "--seed") == 0 && parse_seed(words[i + 1], seed)) {
      continue;
    }
    return false;
  }
  return *until_ns > 0;
}

/* Runs to the end; hashes the state after every instant. */
static void run(const soter_program* p, APP_STATE* state, int64_t until_ns, soter_sha256* hash) {
  while (soter_next_instant(p, state) <= until_ns) {
    uint32_t due = 0;
    while (soter_virtual_instant(p, state, &due) == SOTER_EXTERN_DUE) {
      soter_app_answer(state, due);
    }
    soter_sha256_add(hash, state, p->state_size);
  }
}

static void print_module(const soter_program* p, APP_STATE* state, uint32_t index) {
  const soter_module* const m = soter_modules_of(p, state) + index;
  const int64_t end_ns = soter_header_of(state)->ct;
  const int64_t ac_ns = m->ac_ns + (m->mode == SOTER_AC ? end_ns - m->mode_since : 0);
  const double share = end_ns > 0 ? (double)ac_ns / (double)end_ns : 0.0;
  (void)printf("module %s: AC share %.1f %%, %" PRIu32 " to AC, %" PRIu32 " to SC, %" PRIu32
               " gate faults\n",
               p->module[index].name, 100.0 * share, m->to_ac, m->to_sc, m->gate_faults);
  if (m->nan_looks > 0U) {
    (void)printf("module %s: ttf or safer compared a NaN in %u steps of its DM\n",
                 p->module[index].name, (unsigned)m->nan_looks);
  }
}

static void print_faults(const soter_program* p, APP_STATE* state) {
  const soter_component* const c = soter_components_of(state);
  for (uint32_t i = 0; i < p->components; i++) {
    if (c[i].faults > 0U) {
      (void)printf("faults %s: %" PRIu32 ", the last of kind %u%s\n", p->component[i].name,
                   c[i].faults, (unsigned)c[i].last_fault, c[i].latched != 0U ? ", latched" : "");
    }
  }
}

static void print_properties(const soter_program* p, APP_STATE* state) {
  const soter_property* const q = soter_properties_of(p, state);
  for (uint32_t i = 0; i < p->properties; i++) {
    if (q[i].count > 0U) {
      (void)printf("violated %s: %" PRIu32 ", the first at %.3f s\n", p->property[i].text,
                   q[i].count, (double)q[i].first_ns / 1e9);
    }
  }
}

static void print_summary(const soter_program* p, APP_STATE* state, int64_t until_ns) {
  const soter_header* const h = soter_header_of(state);
  (void)printf("%s: program %.12s, seed %" PRIu64 ", %g s\n", p->name, p->hash, h->seed,
               (double)until_ns / 1e9);
  (void)printf("%s: %" PRIu32 " violations\n", h->violations == 0U ? "safe" : "violated",
               h->violations);
  print_properties(p, state);
  for (uint32_t i = 0; i < p->modules; i++) {
    print_module(p, state, i);
  }
  print_faults(p, state);
}

/* In virtual time nothing moves: the run ends, with the exit code of a defect. */
void soter_check_failed(const char* file, int line, const char* what) {
  (void)fprintf(stderr, "soter has a defect: %s:%d: not %s\n", file, line, what);
  _Exit(EXIT_DEFECT);
}

int main(int count, char** words) {
  static APP_STATE state;
  const soter_program* const p = APP_PROGRAM;
  int64_t until_ns = APP_UNTIL_NS;
  uint64_t seed = 1;
  const char* const wrong = soter_self_test(p);
  if (wrong != NULL) {
    (void)fprintf(stderr, "%s: not run: %s\n", words[0], wrong);
    return EXIT_FAILURE;
  }
  if (!parse(count, words, &until_ns, &seed)) {
    (void)fprintf(stderr, "usage: %s [--until SECONDS] [--seed N]\n", words[0]);
    return EXIT_USAGE;
  }
  soter_sha256 hash;
  char digest[65];
  soter_sha256_start(&hash);
  soter_start(p, &state, seed);
  run(p, &state, until_ns, &hash);
  soter_sha256_end(&hash, digest);
  print_summary(p, &state, until_ns);
  (void)printf("trace_sha256 %s\n", digest);
  if (fflush(stdout) != 0) {
    return EXIT_FAILURE;
  }
  return soter_header_of(&state)->violations == 0U ? EXIT_SAFE : EXIT_VIOLATED;
}
