/* soter_posix_log.c: the logger's thread, and the ring between it and the trusted one.
 *
 * Purpose: hash the states, write a line an instant and a recording, say on a terminal how it goes;
 * and for the main thread, which no file holds up, end workers that answer no more and notice that
 * the trusted thread is silent. Non-goals: being on time. What has no room is dropped and counted.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_posix.h"
#include "soter_process.h"
#include "soter_sha256.h"

#include <errno.h>
#include <inttypes.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define NAP_NS 10000000L
#define SECOND INT64_C(1000000000)
#define SILENT_NS (SECOND / 2) /* beyond the longest wait between instants */

bool soter_ring_put(soter_ring* ring, const soter_instant_times* times, const APP_STATE* state) {
  const uint64_t head = ring->head; /* ours */
  const uint64_t filled = head - __atomic_load_n(&ring->tail, __ATOMIC_ACQUIRE);
  SOTER_CHECK(filled <= APP_SLOTS);
  if (filled == APP_SLOTS) {
    __atomic_store_n(&ring->dropped, ring->dropped + 1U, __ATOMIC_RELAXED);
    return false;
  }
  soter_record* const slot = &ring->slot[head % APP_SLOTS];
  slot->number = head + ring->dropped;
  slot->times = *times;
  slot->state = *state;
  __atomic_store_n(&ring->head, head + 1U, __ATOMIC_RELEASE);
  return true;
}

bool soter_ring_take(soter_ring* ring, soter_record* record) {
  const uint64_t tail = ring->tail; /* ours */
  const uint64_t filled = __atomic_load_n(&ring->head, __ATOMIC_ACQUIRE) - tail;
  SOTER_CHECK(filled <= APP_SLOTS);
  if (filled == 0U) {
    return false;
  }
  *record = ring->slot[tail % APP_SLOTS];
  __atomic_store_n(&ring->tail, tail + 1U, __ATOMIC_RELEASE);
  return true;
}

/* ------------------------------------------------------------------ files and words */

static void failed(soter_posix* d, FILE** log, const char* path) {
  SOTER_CHECK(*log != NULL && path != NULL);
  soter_posix_note(d, "the log `%s` cannot be written (%s): it ends here, the run goes on", path,
                   strerror(errno));
  (void)fclose(*log);
  *log = NULL;
}

static void write_line(soter_posix* d, FILE** log, const soter_instant_times* t) {
  if (*log == NULL) {
    d->lines_lost += d->options.log != NULL ? 1U : 0U;
    return;
  }
  if (fprintf(*log, "%" PRId64 ",%" PRId64 ",%" PRId64 ",%" PRId64 ",%" PRIu32 ",%" PRIu32 "\n",
              t->ct, t->wake_ns, t->done_ns, t->independent_ns, t->misses, t->modes) < 0) {
    failed(d, log, d->options.log);
  }
}

/* ------------------------------------------------------------------ a recording */

/* What `soter run --recorded` reads: a head of lines and an empty one, records, and at the end how
 * many instants there were, and the hash of all before. Who dies leaves one without an end. */
typedef struct {
  FILE* file; /* NULL: there is none */
  soter_sha256 hash;
} soter_flight_file;

static void record(soter_posix* d, soter_flight_file* r, const void* bytes, size_t size) {
  SOTER_CHECK(bytes != NULL && size > 0U);
  if (r->file == NULL) {
    return;
  }
  soter_sha256_add(&r->hash, bytes, size);
  if (fwrite(bytes, size, 1U, r->file) != 1U) {
    failed(d, &r->file, d->options.record);
  }
}

static void begin_recording(soter_posix* d, soter_flight_file* r, FILE* file) {
  char seed[32];
  r->file = file;
  soter_sha256_start(&r->hash);
  const int size = snprintf(seed, sizeof seed, "seed=%" PRIu64 "\n\n", d->options.seed);
  SOTER_CHECK(size > 0 && (size_t)size < sizeof seed);
  record(d, r, soter_app_flown, strlen(soter_app_flown));
  record(d, r, seed, (size_t)size);
}

static void end_recording(soter_posix* d, soter_flight_file* r) {
  char digest[65];
  char end[96];
  soter_sha256_end(&r->hash, digest);
  const uint64_t instants = d->ring.head + d->ring.dropped;
  const int size = snprintf(end, sizeof end, "end %020" PRIu64 " %s\n", instants, digest);
  SOTER_CHECK(size > 0 && (size_t)size < sizeof end);
  soter_sha256_start(&r->hash);
  record(d, r, end, (size_t)size);
}

static FILE* opened(soter_posix* d, const char* path, const char* head) {
  FILE* const file = path == NULL ? NULL : fopen(path, "wb");
  if (path != NULL && file == NULL) {
    soter_posix_note(d, "the log `%s` cannot be written (%s): the run goes on without", path,
                     strerror(errno));
  }
  if (file != NULL) {
    (void)fputs(head, file);
  }
  return file;
}

static void closed(soter_posix* d, FILE** file, const char* path) {
  if (*file != NULL && fflush(*file) != 0) {
    failed(d, file, path);
  }
  if (*file != NULL) {
    (void)fclose(*file);
  }
}

/* ------------------------------------------------------------------ what it watches */

/* Workers that left so many requests unanswered as patience allows are ended; whoever starts them
 * starts them again. */
static void watch_workers(soter_posix* d) {
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    const int64_t period = APP_PROGRAM->component[soter_app_externs[k].component].period_ns;
    const uint64_t row = __atomic_load_n(&d->worker[k].in_a_row, __ATOMIC_RELAXED);
    soter_worker_status* const s = &d->status->worker[k];
    const uint32_t asked = s->kill_asked; /* ours */
    const bool busy = asked != __atomic_load_n(&s->kill_done, __ATOMIC_ACQUIRE);
    if (!busy && (int64_t)row * period > d->options.patience_ns &&
        __atomic_load_n(&s->pid, __ATOMIC_ACQUIRE) != 0) {
      __atomic_store_n(&s->kill_asked, asked + 1U, __ATOMIC_RELEASE);
    }
  }
}

void soter_posix_watch(soter_posix* d) {
  watch_workers(d);
  const int64_t beat = __atomic_load_n(&d->heartbeat_ns, __ATOMIC_ACQUIRE);
  const int64_t period = APP_LONGEST_NS + SILENT_NS;
  if (beat != 0 && !d->silent_seen && soter_posix_clock() - beat > period &&
      !__atomic_load_n(&d->done, __ATOMIC_ACQUIRE)) {
    d->silent_seen = true;
    soter_posix_note(d, "the trusted thread has been silent for more than %.1f s",
                     (double)period / 1e9);
  }
}

static void show(const soter_posix* d, const soter_record* r, uint64_t instants, uint64_t misses) {
  char modes[33] = {0};
  for (uint32_t i = 0; i < APP_PROGRAM->modules && i < 32U; i++) {
    modes[i] = (r->times.modes >> i & 1U) != 0U ? 'A' : 'S';
  }
  (void)fprintf(stderr, "\r%8.1f s  %" PRIu64 " instants, %" PRIu64 " misses  %s  %s ",
                (double)r->times.ct / 1e9, instants, misses, modes, d->policy);
  (void)fflush(stderr);
}

void* soter_posix_logger(void* driver) {
  soter_posix* const d = (soter_posix*)driver;
  static soter_record taken; /* too large for a stack */
  const bool live = (d->options.live || !d->options.quiet) && isatty(soter_process_stderr) != 0;
  const struct timespec nap = {0, NAP_NS};
  uint64_t instants = 0;
  uint64_t misses = 0;
  int64_t shown = 0;
  soter_sha256 hash;
  soter_sha256_start(&hash);
  FILE* log = opened(d, d->options.log, "ct_ns,wake_late_ns,done_ns,raw_ns,misses,modes\n");
  soter_flight_file recording;
  begin_recording(d, &recording, opened(d, d->options.record, ""));
  for (bool last = false; !last;) {
    last = __atomic_load_n(&d->done, __ATOMIC_ACQUIRE);
    while (soter_ring_take(&d->ring, &taken)) {
      SOTER_CHECK(taken.times.ct == taken.state.header.ct);
      soter_sha256_add(&hash, &taken.state, sizeof taken.state);
      write_line(d, &log, &taken.times);
      record(d, &recording, &taken, sizeof taken);
      instants++;
      misses += taken.times.misses;
    }
    if (live && taken.times.ct >= shown) {
      show(d, &taken, instants, misses);
      shown = taken.times.ct + SECOND / 4;
    }
    (void)nanosleep(&nap, NULL);
  }
  if (live) {
    (void)fputc('\n', stderr);
  }
  closed(d, &log, d->options.log);
  end_recording(d, &recording);
  closed(d, &recording.file, d->options.record);
  soter_sha256_end(&hash, d->digest);
  return NULL;
}
