/* The AC of bench/real_time/real_time_loop.soter: right until, in each of its lives, a step drawn by chance, where
 * AC_FAULT names a kind of fault. AC_FAULT_LOG: a file for when they happened. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include "real_time_loop.h"

#define ANSWER_FD 4
#define SEGMENT_BYTES 80

static void flood(void) {
  static char page[4096];
  for (;;) {
    if (write(2, page, sizeof page) < 0) {
      continue;
    }
  }
}

static void hog(void) {
  for (;;) {
    char *const more = malloc(1 << 22);
    if (more != NULL) {
      memset(more, 1, 1 << 22);
    }
  }
}

/* Writes the answer's segment as the kind says, for ever. */
static void scribble(const char *kind) {
  volatile uint64_t *const s =
      mmap(NULL, SEGMENT_BYTES, PROT_READ | PROT_WRITE, MAP_SHARED, ANSWER_FD, 0);
  for (;;) {
    if (strcmp(kind, "torn") == 0) {
      s[0] |= 1U;
      s[8]++;
    } else if (strcmp(kind, "stale") == 0) {
      s[0] += 2U;
    } else if (strcmp(kind, "size") == 0) {
      s[0] = 2U;
      s[2] = UINT64_MAX;
    } else {
      for (int i = 0; i < SEGMENT_BYTES / 8; i++) {
        s[i] = ((uint64_t)rand() << 32) ^ (uint64_t)rand();
      }
    }
  }
}

static void fail(const char *kind) {
  if (strcmp(kind, "crash") == 0) {
    abort();
  } else if (strcmp(kind, "hang") == 0) {
    for (;;) {
      pause();
    }
  } else if (strcmp(kind, "spin") == 0) {
    for (volatile int i = 0;; i = 0) {
    }
  } else if (strcmp(kind, "hog") == 0) {
    hog();
  } else if (strcmp(kind, "flood") == 0) {
    flood();
  } else if (strcmp(kind, "nan") != 0) {
    scribble(kind);
  }
}

/* Says when the fault of this life happens, in ns of CLOCK_MONOTONIC. */
static void note(void) {
  const char *const path = getenv("AC_FAULT_LOG");
  const int file = path != NULL ? open(path, O_WRONLY | O_APPEND | O_CREAT, 0600) : -1;
  struct timespec t;
  char text[32];
  clock_gettime(CLOCK_MONOTONIC, &t);
  const int length = snprintf(text, sizeof text, "%lld\n", (long long)t.tv_sec * 1000000000 + t.tv_nsec);
  if (file >= 0 && write(file, text, (size_t)length) == length) {
    close(file);
  }
}

/* The step at which a life ends: 40 to 200 of it, by chance. */
static long drawn(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  uint64_t x = (uint64_t)t.tv_nsec ^ ((uint64_t)getpid() << 32);
  x = (x ^ (x >> 31)) * UINT64_C(0x9e3779b97f4a7c15);
  return 40 + (long)((x >> 33) % 161);
}

int fast_step(const real_time_loop_SafeCart_Fast_in *in, real_time_loop_SafeCart_Fast_out *out) {
  static long steps, last;
  const char *const kind = getenv("AC_FAULT");
  const double wanted = 4.0 * (9.0 - in->motion.x) - in->motion.v;
  out->accel = wanted < -3.0 ? -3.0 : wanted > 3.0 ? 3.0 : wanted;
  out->has_accel = 1;
  if (kind == NULL) {
    return 0;
  }
  last = last == 0 ? drawn() : last;
  steps++;
  if (steps == last + 1) {
    note();
    fail(kind);
  }
  if (steps > last) { /* the one that lives on: it says nonsense, and then dies */
    out->accel = (double)NAN;
    if (steps > last + 30) {
      abort();
    }
  }
  return 0;
}
