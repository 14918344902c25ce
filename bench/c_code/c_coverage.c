/* c_coverage.c: runs a generated program through what happens, and through what hardly ever does.
 *
 * Purpose: bench/c_code/c_coverage.py measures which lines, branches and conditions this reaches. Externs
 * are answered in turns by nobody, with a fault, with zeros and with noise; the environment's
 * topics are set from outside, rightly and wrongly; now and then a topic is overwritten where it
 * lies, as no run would. Nothing here asks whether what comes out is right. Non-goals: tests: those
 * are elsewhere.
 */
#include COVERED_HEADER
#include "soter_sha256.h"

#include <fenv.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

void covered_loop(const soter_program* p, uint64_t (*next)(void));

#define ANSWER_BYTES 65536U
#define TOPIC_BYTES 65536U
#define REFUSED 6 /* so many wrong environments does `refused` try */

static uint64_t drawn;

static uint64_t next(void) {
  drawn += UINT64_C(0x9e3779b97f4a7c15);
  return soter_mix(drawn);
}

/* Bytes that say something: zeros, noise, or numbers of every kind. */
static void fill(unsigned char* at, size_t size) {
  static const double numbers[] = {0.0, -0.0, 1.0, -1.0, 0.3, 5.0, -40.0, 1e9, -1e300, 1e-310};
  const uint64_t how = next() % 4U;
  (void)memset(at, 0, size);
  for (size_t i = 0; how != 0U && i + sizeof(double) <= size; i += sizeof(double)) {
    const uint64_t bits = next();
    double x = numbers[bits % (sizeof numbers / sizeof *numbers)];
    if (how == 1U) {
      (void)memcpy(at + i, &bits, sizeof bits);
      continue;
    }
    if (how == 2U && bits >> 60 == 0U) {
      x = bits >> 59 & 1U ? (double)NAN : (double)INFINITY;
    }
    if (how == 3U) {
      x = (double)(bits >> 11) * 0x1p-53 * 20.0 - 10.0;
    }
    (void)memcpy(at + i, &x, sizeof x);
  }
}

static void from_outside(const soter_program* p, void* state) {
  static unsigned char given[TOPIC_BYTES];
  const uint32_t topic = (uint32_t)(next() % (p->topics + 1U));
  const int64_t ahead = (int64_t)(next() % 3U) - 1;
  const int64_t time = soter_next_instant(p, state) + ahead * (int64_t)(next() % 50000000U);
  if (topic < p->topics && p->topic[topic].size > sizeof given) {
    return;
  }
  fill(given, sizeof given);
  (void)soter_publish(p, state, topic, given, time);
}

static void overwrite(const soter_program* p, unsigned char* state) {
  static const uint32_t floats[] =
      COVERED_FLOATS; /* how many, and which topics hold nothing else */
  if (floats[0] > 0U) {
    const soter_topic_info* const topic = &p->topic[floats[1U + next() % floats[0]]];
    fill(state + topic->offset, topic->size);
  }
}

static void answer(const soter_program* p, void* state, uint32_t due) {
  static double room[ANSWER_BYTES / sizeof(double)];
  const uint64_t how = next() % 5U;
  fill((unsigned char*)room, sizeof room);
  if (how == 0U) {
    (void)memset(room, 0, sizeof room);
  }
  if (how == 4U) {
    from_outside(p, state); /* while one waits */
  }
  const soter_fault fault = how == 1U ? SOTER_DIVIDE : SOTER_OK;
  soter_answer(p, state, due, fault, how == 2U ? NULL : room);
}

/* A step whose choices somebody makes, and has its branches told. */
static void choose(const soter_program* p, void* state) {
  static soter_choice choices[64];
  static uint64_t branches[1024];
  uint32_t taken = 0;
  soter_answers answers = {choices, 0, 0, &taken, branches};
  answers.room = (uint32_t)(next() % 64U);
  answers.given = (uint32_t)(next() % 64U);
  for (uint32_t i = 0; i < 64U; i++) {
    choices[i].pick = (uint32_t)(next() % 4U);
  }
  const uint32_t component = (uint32_t)(next() % p->components);
  const soter_component_info* const info = &p->component[component];
  if (info->effect != NULL && next() % 2U == 0U) { /* what it holds is due now */
    soter_stamps_of(p, state)[info->held] = soter_header_of(state)->ct;
  }
  if (!info->is_extern) {
    (void)soter_fire(p, state, component, &answers);
  }
  for (uint32_t i = 0; i < p->inputs; i++) {
    taken = 0;
    p->input[i].draw(state, &answers);
  }
}

/* What has latched works again, and modules are as they hardly ever are. */
static void unlatch(const soter_program* p, void* state) {
  for (uint32_t i = 0; i < p->modules; i++) {
    soter_module* const m = soter_modules_of(p, state) + i;
    m->gate_fault = (uint8_t)(next() % 2U);
    m->clean_needed = (uint32_t)(next() % 2U);
  }
  for (uint32_t i = 0; i < p->components; i++) {
    soter_components_of(state)[i].latched = 0;
  }
}

/* Every word of what computes wrongly: rounding and small numbers as no program wants them. */
static int refused(const soter_program* p) {
  static const int ways[] = {FE_UPWARD, FE_DOWNWARD, FE_TOWARDZERO};
  int seen = 0;
  for (size_t i = 0; i < sizeof ways / sizeof *ways; i++) {
    (void)fesetround(ways[i]);
    seen += soter_self_test(p) != NULL;
  }
  (void)fesetround(FE_TONEAREST);
#if defined(__SSE2__)
  for (unsigned bits = 1; bits < 4U; bits++) { /* to zero what comes out, what goes in, both */
    const unsigned kept = _mm_getcsr();
    _mm_setcsr(kept | ((bits & 1U) != 0U ? 0x8000U : 0U) | ((bits & 2U) != 0U ? 0x40U : 0U));
    seen += soter_self_test(p) != NULL;
    _mm_setcsr(kept);
  }
#endif
  return seen;
}

/* Helpers of generated code, with arguments that no program gives them. */
static void ends(void* state) {
  soter_header* const h = soter_header_of(state);
  uint8_t ages[2] = {255U, 255U}; /* nobody may be taken any more */
  uint32_t made = 0;
  (void)soter_choose_fair(h, NULL, 1U, 0, &made, ages, 2U);
  (void)soter_draw_int(h, 1U, 0, INT64_MIN, INT64_MAX);
  (void)soter_plain(soter_div(5, 0, &(soter_fault){SOTER_OK}));
  (void)soter_sub(INT64_MIN, 1, &(soter_fault){SOTER_OK});
  (void)soter_sub(INT64_MAX, -1, &(soter_fault){SOTER_OK});
  (void)soter_mod(5, 0, &(soter_fault){SOTER_OK});
  uint64_t seen[1] = {0U};
  soter_answers told = {NULL, 0U, 0U, &made, seen};
  const soter_fault none = SOTER_OK;
  const soter_fault one = SOTER_DIVIDE;
  soter_branch(&told, &none, 3U);
  soter_branch(&told, &one, 4U);
  soter_branch(NULL, &none, 5U);
  told.branches = NULL;
  soter_branch(&told, &none, 6U);
}

/* usage: PROGRAM SEED INSTANTS WILD, where `WILD` of 100 instants are not left alone. */
int main(int count, char** words) {
  const soter_program* const p = &COVERED_PROGRAM;
  const uint64_t seed = count > 1 ? strtoull(words[1], NULL, 10) : 1U;
  const long instants = count > 2 ? strtol(words[2], NULL, 10) : 1000L;
  const uint64_t wild = count > 3 ? strtoull(words[3], NULL, 10) : 0U;
  unsigned char* const state = (unsigned char*)malloc(p->state_size);
  unsigned char* const trace = (unsigned char*)malloc(3U * p->state_size);
  uint32_t due = 0;
  size_t written = 0;
  drawn = seed;
  if (state == NULL || trace == NULL) {
    return EXIT_FAILURE;
  }
  if (count > 4) { /* compiled wrongly on purpose: the self-test has to see it */
    return soter_self_test(p) != NULL ? EXIT_SUCCESS : EXIT_FAILURE;
  }
  if (soter_self_test(p) != NULL || soter_self_test(NULL) != NULL || refused(p) != REFUSED) {
    return EXIT_FAILURE;
  }
  if (seed % 3U == 0U) {
    soter_choice picks[64] = {{0, 0, 1}, {0, 0, 2}};
    uint32_t taken = 0;
    const soter_answers answers = {picks, 64, 64, &taken, NULL};
    soter_start_with(p, state, seed, &answers);
  } else {
    soter_start(p, state, seed);
  }
  ends(state);
  covered_loop(p, next);
  for (long i = 0; i < instants; i++) {
    if (next() % 100U < wild) {
      from_outside(p, state);
    }
    if (next() % 100U < wild / 2U) {
      overwrite(p, state);
    }
    if (next() % 100U < wild / 2U) {
      unlatch(p, state);
    }
    if (next() % 100U < wild / 4U) {
      choose(p, state);
    }
    soter_status status = SOTER_INSTANT_DONE;
    if (i % 2 == 0) {
      status = i % 8 == 0 && p->inputs == 0U ? soter_instant(p, state, &due)
                                             : soter_virtual_instant(p, state, &due);
    }
    while (status == SOTER_EXTERN_DUE) {
      answer(p, state, due);
      status = i % 4 == 0 ? soter_virtual_instant(p, state, &due) : soter_instant(p, state, &due);
    }
    if (i % 2 != 0) {
      const int64_t until = soter_next_instant(p, state) + (int64_t)(next() % 2U) * 20000000;
      const soter_run_status ran =
          soter_run(p, state, until, i % 3 == 0 ? NULL : trace, 3U, &written, &due);
      status = ran == SOTER_RUN_EXTERN ? SOTER_EXTERN_DUE : SOTER_INSTANT_DONE;
      while (status == SOTER_EXTERN_DUE) {
        answer(p, state, due);
        status = soter_run(p, state, until, NULL, 0U, &written, &due) == SOTER_RUN_EXTERN
                     ? SOTER_EXTERN_DUE
                     : SOTER_INSTANT_DONE;
      }
    }
  }
  soter_sha256 hash;
  char digest[65];
  soter_sha256_start(&hash);
  for (size_t cut = 0; cut < p->state_size; cut += 1U + (size_t)(next() % 150U)) {
    soter_sha256_add(&hash, state, cut);
  }
  soter_sha256_end(&hash, digest);
  (void)printf("%u violations, %s\n", soter_header_of(state)->violations, digest);
  free(state);
  free(trace);
  return EXIT_SUCCESS;
}
