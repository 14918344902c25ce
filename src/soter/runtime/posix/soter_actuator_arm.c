/* soter_actuator_arm.c: asks the actuators that run to be armed again, and says what they answer.
 *
 * Purpose: `NAME_actuator --channels FOLDER --arm [--unchecked]`, for a person: who the actuators
 * are stands in the channel of what they say of themselves, the request is a signal, the answer
 * comes in that channel. Non-goals: deciding it (soter_actuator.c).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_actuator.h"
#include "soter_actuator_app.h"
#include "soter_check.h"
#include "soter_outside.h"
#include "soter_status_text.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define WORDS SOTER_ACTUATORS_WORDS(ACTUATOR_MODULES)
#define PATIENCE_NS INT64_C(2000000000)
#define ALIVE_NS (5 * SOTER_STATUS_EVERY_NS)
#define PATH_MAX_BYTES 4096

int64_t soter_actuator_clock(void) {
  struct timespec t = {0, 0};
  const bool told = clock_gettime(CLOCK_MONOTONIC, &t) == 0;
  SOTER_CHECK(told);
  (void)told;
  return (int64_t)t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

/* The name of a process's program; "" where there is none. */
static void program_of(const char* process, char* to) {
  char path[64];
  (void)snprintf(path, sizeof path, "/proc/%s/exe", process);
  const ssize_t size = readlink(path, to, PATH_MAX_BYTES - 1);
  SOTER_CHECK(size < PATH_MAX_BYTES);
  to[size > 0 ? size : 0] = '\0';
  const char* const last = strrchr(to, '/');
  if (last != NULL) {
    (void)memmove(to, last + 1, strlen(last + 1) + 1);
  }
}

/* Whoever may write the channel is not believed to know a process: it has to be of our program. */
static bool is_actuator(uint64_t process) {
  char own[PATH_MAX_BYTES];
  char its[PATH_MAX_BYTES];
  char name[32];
  (void)snprintf(name, sizeof name, "%llu", (unsigned long long)process);
  program_of("self", own);
  program_of(name, its);
  SOTER_CHECK(process > 0U);
  return own[0] != '\0' && strncmp(own, its, strlen(own)) == 0;
}

static uint64_t count_answers(const uint64_t* words) {
  return words[SOTER_ACTUATORS_ARMED] + words[SOTER_ACTUATORS_REFUSED];
}

/* Waits for the answer of the actuators; false if none came. */
static bool answered(soter_outside* channel, uint64_t asked, uint64_t before, uint64_t* words) {
  const int64_t end = soter_actuator_clock() + PATIENCE_NS;
  int64_t written = 0;
  SOTER_CHECK(channel->size == WORDS * sizeof words[0]);
  while (soter_actuator_clock() < end) {
    soter_outside_wait(channel, SOTER_STATUS_EVERY_NS);
    if (soter_outside_read(channel, &written, words, NULL) &&
        words[SOTER_ACTUATORS_PROCESS] == asked && count_answers(words) != before) {
      return true;
    }
  }
  return false;
}

static uint32_t fact_of(const uint64_t* words, uint32_t module, uint32_t what) {
  const uint64_t* const m = words + SOTER_ACTUATORS_HEAD + SOTER_ACTUATORS_MODULE * module;
  SOTER_CHECK(module < ACTUATOR_MODULES);
  return (uint32_t)m[what];
}

/* The actuators say how they were armed, as somebody else may have asked at the same time. */
static void print_armed(const uint64_t* words) {
  const unsigned long long process = words[SOTER_ACTUATORS_PROCESS];
  bool any = false;
  bool unchecked = false;
  SOTER_CHECK(soter_actuator_count <= ACTUATOR_MODULES);
  for (uint32_t k = 0; k < soter_actuator_count; k++) {
    const bool already = fact_of(words, k, SOTER_ACTUATORS_ANSWER) == SOTER_ARM_ALREADY;
    any = any || !already;
    unchecked =
        unchecked || (!already && fact_of(words, k, SOTER_ACTUATORS_HOW) == SOTER_ARMED_UNCHECKED);
    if (already) {
      (void)printf("%s: %s\n", soter_actuator_modules[k].name, soter_arm_text(SOTER_ARM_ALREADY));
    }
  }
  if (any) {
    (void)printf("armed%s: process %llu\n",
                 unchecked ? ", without a look at the state, which no proof is about" : "",
                 process);
  }
}

static int print_outcome(const uint64_t* words, uint64_t refused_before) {
  SOTER_CHECK(soter_actuator_count <= ACTUATOR_MODULES);
  if (words[SOTER_ACTUATORS_REFUSED] == refused_before) {
    print_armed(words);
    return EXIT_SUCCESS;
  }
  for (uint32_t k = 0; k < soter_actuator_count; k++) {
    const uint32_t answer = fact_of(words, k, SOTER_ACTUATORS_ANSWER);
    if (answer != SOTER_ARM_FINE && answer != SOTER_ARM_ALREADY) {
      (void)fprintf(stderr, "not armed: %s: %s\n", soter_actuator_modules[k].name,
                    soter_arm_text(answer));
    }
  }
  (void)fprintf(stderr, "--unchecked arms them all the same: no proof is about what follows\n");
  return EXIT_FAILURE;
}

int soter_actuator_request(const char* folder, bool unchecked) {
  soter_outside channel;
  uint64_t words[WORDS];
  int64_t written = 0;
  SOTER_CHECK(folder != NULL);
  const char* const wrong = soter_outside_open(&channel, folder, SOTER_ACTUATORS_CHANNEL,
                                               ACTUATOR_STATUS_HASH, sizeof words, false);
  if (wrong != NULL) {
    (void)fprintf(stderr, "not armed: the channel `%s` in `%s`: %s\n", SOTER_ACTUATORS_CHANNEL,
                  folder, wrong);
    return EXIT_FAILURE;
  }
  const bool found = soter_outside_read(&channel, &written, words, NULL);
  if (!found || soter_actuator_clock() - written > ALIVE_NS ||
      words[SOTER_ACTUATORS_PROCESS] == 0U || !is_actuator(words[SOTER_ACTUATORS_PROCESS])) {
    (void)fprintf(stderr, "not armed: no actuators of this program run with channels in `%s`\n",
                  folder);
    return EXIT_FAILURE;
  }
  const uint64_t asked = words[SOTER_ACTUATORS_PROCESS];
  const uint64_t before = count_answers(words);
  const uint64_t refused = words[SOTER_ACTUATORS_REFUSED];
  (void)signal(SIGPIPE, SIG_IGN); /* whoever reads has gone: the exit code tells it */
  if (kill((pid_t)asked, unchecked ? SIGUSR2 : SIGUSR1) != 0) {
    perror("not armed");
    return EXIT_FAILURE;
  }
  if (!answered(&channel, asked, before, words)) {
    (void)fprintf(stderr, "not armed: the actuators do not answer\n");
    return EXIT_FAILURE;
  }
  return print_outcome(words, refused);
}
