/* The AC of bench/real_time_loop.soter, right until a step that the environment names. */
#define _GNU_SOURCE
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
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

int fast_step(const real_time_loop_SafeCart_Fast_in *in, real_time_loop_SafeCart_Fast_out *out) {
  static long steps;
  const char *const kind = getenv("AC_FAULT");
  const char *const at = getenv("AC_FAULT_AT");
  const double wanted = 4.0 * (9.0 - in->motion.x) - in->motion.v;
  out->accel = wanted < -3.0 ? -3.0 : wanted > 3.0 ? 3.0 : wanted;
  out->has_accel = 1;
  if (kind != NULL && at != NULL && ++steps > atol(at)) {
    fail(kind);
    out->accel = (double)NAN;
  }
  return 0;
}
