/* soter_posix_main.c: a program as a command in real time.
 *
 * Purpose: options, then workers, then the trusted thread and the logger; at the end the report.
 * Non-goals: being on any path that has to be on time.
 *
 * Exits 0 safe, 1 it cannot run here, 2 usage, 3 a property was violated, 4 none was, but the
 * trusted part missed more than --misses allows, or gives no lease any more (--end-with-leases), 70
 * a check failed, 130 stopped by a signal.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_posix.h"
#include "soter_process.h"

#include <errno.h>
#include <inttypes.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define EXIT_USAGE 2
#define EXIT_VIOLATED 3
#define EXIT_LATE 4
#define EXIT_STOPPED 130
#define SECOND 1e9
#define S_MAX 4.0e9
#define EARLY_MOST_NS 10000000
#define IDLE_NAPS 500

static const char* const USAGE =
    "usage: %s [--until SECONDS] [--seed N] [--policy auto|fifo|deadline|other] [--core N|none]\n"
    "  [--late MICROSECONDS] [--misses N] [--early MICROSECONDS] [--log FILE] [--record FILE]\n"
    "  [--json] [--quiet [--live]] [--worker NAME=COMMAND]\n"
    "  [--bare SECONDS] [--restarts N] [--again SECONDS] [--patience SECONDS] [--wait SECONDS] "
    "[--worker-memory MIB]\n"
    "  [--worker-user UID] [--channels FOLDER] [--end-with-leases]\n";

/* ------------------------------------------------------------------ options */

static bool number(const char* text, double most, double* found) {
  char* end = NULL;
  *found = strtod(text, &end);
  if (end == text || (*end != '\0' && strcmp(end, "s") != 0)) {
    return false;
  }
  return *found >= 0.0 && *found <= most;
}

static bool whole(const char* text, uint64_t* found) {
  char* end = NULL;
  errno = 0;
  const unsigned long long read = strtoull(text, &end, 10);
  *found = (uint64_t)read;
  return text[0] >= '0' && text[0] <= '9' && *end == '\0' && errno == 0;
}

static bool duration(const char* text, double unit_ns, int64_t* ns) {
  double given = 0.0;
  const bool fine = number(text, S_MAX, &given);
  *ns = fine ? (int64_t)(given * unit_ns + 0.5) : 0;
  return fine;
}

static bool policy(const char* text, soter_policy* found) {
  static const char* const names[4] = {"auto", "fifo", "deadline", "other"};
  for (int i = 0; i < 4; i++) {
    if (strcmp(text, names[i]) == 0) {
      *found = (soter_policy)i;
      return true;
    }
  }
  return false;
}

static bool core(const char* text, int* found) {
  uint64_t n = 0;
  if (strcmp(text, "none") == 0) {
    *found = -2;
    return true;
  }
  const bool fine = whole(text, &n) && n < 4096U;
  *found = (int)n;
  return fine;
}

/* NAME=COMMAND: a full name, or the last part of one. */
static bool worker(soter_posix* d, const char* text) {
  const char* const equals = strchr(text, '=');
  if (equals == NULL || strlen(equals + 1) >= SOTER_COMMAND_MAX) {
    return false;
  }
  const size_t length = (size_t)(equals - text);
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    const char* const name = APP_PROGRAM->component[soter_app_externs[k].component].name;
    const char* const dot = strrchr(name, '.');
    const char* const last = dot == NULL ? name : dot + 1;
    const bool full = strlen(name) == length && strncmp(name, text, length) == 0;
    if (full || (strlen(last) == length && strncmp(last, text, length) == 0)) {
      (void)snprintf(d->workers[k].command, SOTER_COMMAND_MAX, "%s", equals + 1);
      return true;
    }
  }
  (void)fprintf(stderr, "there is no extern node `%.*s`\n", (int)length, text);
  return false;
}

/* Options that are a length of time (in units of so many ns), a whole number, or a text. */
static bool plain_option(soter_options* o, const char* name, const char* value) {
  const struct {
    const char* name;
    double unit_ns;
    int64_t* ns;
  } times[7] = {{"--until", SECOND, &o->until_ns}, {"--bare", SECOND, &o->bare_ns},
                {"--again", SECOND, &o->again_ns}, {"--patience", SECOND, &o->patience_ns},
                {"--wait", SECOND, &o->wait_ns},   {"--late", 1e3, &o->late_ns},
                {"--early", 1e3, &o->early_ns}};
  const struct {
    const char* name;
    uint64_t below;
    uint64_t* n;
  } numbers[4] = {{"--seed", 0U, &o->seed}, /* 0: any */
                  {"--misses", 0U, &o->misses_allowed},
                  {"--restarts", 1000000U, &o->restarts},
                  {"--worker-memory", UINT64_C(1) << 40, &o->memory_mib}};
  const struct {
    const char* name;
    const char** text;
  } texts[3] = {{"--log", &o->log}, {"--record", &o->record}, {"--channels", &o->channels}};
  for (int i = 0; i < 7; i++) {
    if (strcmp(name, times[i].name) == 0) {
      return duration(value, times[i].unit_ns, times[i].ns) && o->early_ns <= EARLY_MOST_NS;
    }
  }
  for (int i = 0; i < 4; i++) {
    if (strcmp(name, numbers[i].name) == 0) {
      return whole(value, numbers[i].n) &&
             (numbers[i].below == 0U || *numbers[i].n < numbers[i].below);
    }
  }
  for (int i = 0; i < 3; i++) {
    if (strcmp(name, texts[i].name) == 0) {
      *texts[i].text = value;
      return true;
    }
  }
  return false;
}

static bool option(soter_posix* d, const char* name, const char* value) {
  soter_options* const o = &d->options;
  uint64_t n = 0;
  if (strcmp(name, "--policy") == 0) {
    return policy(value, &o->policy);
  }
  if (strcmp(name, "--core") == 0) {
    return core(value, &o->core);
  }
  if (strcmp(name, "--worker") == 0) {
    return worker(d, value);
  }
  if (strcmp(name, "--worker-user") == 0) {
    const bool fine = whole(value, &n) && n < UINT32_MAX;
    o->user = (int64_t)n;
    return fine;
  }
  return plain_option(o, name, value);
}

static bool parse(soter_posix* d, int count, char** words) {
  for (int i = 1; i < count; i++) {
    if (strcmp(words[i], "--json") == 0) {
      d->options.json = true;
    } else if (strcmp(words[i], "--quiet") == 0) {
      d->options.quiet = true;
    } else if (strcmp(words[i], "--live") == 0) {
      d->options.live = true;
    } else if (strcmp(words[i], "--end-with-leases") == 0) {
      d->options.end_with_leases = true;
    } else if (i + 1 < count && option(d, words[i], words[i + 1])) {
      i++;
    } else {
      return false;
    }
  }
  return d->options.until_ns > 0;
}

/* ------------------------------------------------------------------ the end */

static void print_words(const soter_posix* d) {
  const soter_header* const h = &d->state.header;
  (void)printf("%s: program %.12s, seed %" PRIu64 ", %g s\n", APP_PROGRAM->name, APP_PROGRAM->hash,
               h->seed, (double)h->ct / SECOND);
  (void)printf("%s: %" PRIu32 " violations\n", h->violations == 0U ? "safe" : "violated",
               h->violations);
  soter_posix_report(d, stdout);
  if (d->ring.dropped == 0U && d->calendars == 0U && d->digest[0] != '\0') {
    (void)printf("trace_sha256 %s\n", d->digest);
  }
}

static int finish(const soter_posix* d) {
  SOTER_CHECK(d->done);
  if (d->options.json) {
    soter_posix_json(d, stdout);
  } else {
    print_words(d);
  }
  if (d->stop != 0 && !d->leases_over) {
    return EXIT_STOPPED;
  }
  if (d->state.header.violations > 0U) {
    return EXIT_VIOLATED;
  }
  return d->leases_over || d->missed > d->options.misses_allowed ? EXIT_LATE : EXIT_SUCCESS;
}

static void wait_for_end(soter_posix* d) {
  const struct timespec nap = {0, 20000000L};
  while (!__atomic_load_n(&d->done, __ATOMIC_ACQUIRE)) {
    (void)nanosleep(&nap, NULL);
    soter_posix_watch(d);
    if (d->stop == 0 && d->options.end_with_leases && soter_posix_leases_over(d)) {
      d->leases_over = true;
      __atomic_store_n(&d->stop, SIGTERM, __ATOMIC_RELEASE);
    }
  }
}

/* Whoever takes what the logger writes may stand still: then it is left alone. */
static bool joined(soter_posix* d, pthread_t logger) {
  const struct timespec nap = {0, 10000000L};
  uint64_t before = 0;
  for (int idle = 0; idle < IDLE_NAPS; idle++) {
    if (pthread_tryjoin_np(logger, NULL) == 0) {
      return true;
    }
    (void)nanosleep(&nap, NULL);
    const uint64_t written = __atomic_load_n(&d->ring.tail, __ATOMIC_ACQUIRE);
    idle = written == before ? idle : 0;
    before = written;
  }
  soter_posix_note(d, "nobody takes what the log has: it ends here");
  return false;
}

static int go(soter_posix* d) {
  pthread_t trusted;
  pthread_t logger;
  soter_posix_lock(d);
  if (!soter_posix_thread(d, &trusted, soter_posix_run)) {
    (void)fprintf(stderr, "not run: no thread can be made\n");
    soter_posix_release(d);
    return soter_process_end(EXIT_FAILURE);
  }
  const struct timespec nap = {0, 1000000L};
  while (!__atomic_load_n(&d->began, __ATOMIC_ACQUIRE)) {
    (void)nanosleep(&nap, NULL);
  }
  const bool logged = soter_posix_thread(d, &logger, soter_posix_logger);
  if (!logged) {
    soter_posix_note(d, "no thread can be made for the log: the run goes on without");
  }
  wait_for_end(d);
  (void)pthread_join(trusted, NULL);
  const bool over = !logged || joined(d, logger);
  soter_posix_release(d);
  soter_posix_note_old_reads(d);
  soter_process_ending();
  const int code = soter_process_end(finish(d));
  if (!over) {
    _exit(code); /* `exit` would wait for its files */
  }
  return code;
}

static soter_posix driver;

static void on_end(int number) {
  __atomic_store_n(&driver.stop, number, __ATOMIC_RELEASE);
}

int main(int count, char** words) {
  soter_posix* const d = &driver;
  const char* const wrong = soter_self_test(APP_PROGRAM);
  if (wrong != NULL) {
    (void)fprintf(stderr, "%s: not run: %s\n", words[0], wrong);
    return EXIT_FAILURE;
  }
  d->options = (soter_options){.until_ns = APP_UNTIL_NS,
                               .seed = 1,
                               .core = -1,
                               .late_ns = -1,
                               .restarts = 5,
                               .patience_ns = 1000000000,
                               .again_ns = 100000000,
                               .bare_ns = 100000000,
                               .wait_ns = 10000000000,
                               .memory_mib = 4096,
                               .user = -1};
  if (!parse(d, count, words)) {
    (void)fprintf(stderr, USAGE, words[0]);
    return EXIT_USAGE;
  }
  if (!soter_process_begin(on_end)) {
    return EXIT_FAILURE;
  }
  if (!soter_posix_open(d)) {
    return soter_process_end(EXIT_FAILURE);
  }
  soter_posix_workers(d, words[0]);
  soter_posix_await(d);
  if (!soter_posix_hear(d)) {
    soter_posix_release(d);
    return soter_process_end(EXIT_STOPPED);
  }
  return go(d);
}
