/* soter_apart.c: see soter_apart.h. The copy has one thread, which never goes back to Python. */
#define _POSIX_C_SOURCE 200809L
#include "soter_apart.h"

#include <errno.h>
#include <float.h>
#include <signal.h>
#include <stdio.h>
#include <sys/wait.h>
#include <unistd.h>
#if defined(__linux__)
#include <sys/prctl.h>
#endif

/* Signals end the copy, as nobody handles them here; so does the end of whoever waits for it. */
static void soter_die_with(pid_t parent) {
  static const int all[] = {SIGINT, SIGTERM, SIGHUP, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
  for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
    (void)signal(all[i], SIG_DFL);
  }
#if defined(__linux__)
  (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
#endif
  if (getppid() != parent) {
    _exit(1);
  }
}

/* Doubles are rounded to the nearest one, and small ones are kept (floating_point_mode.py). */
static bool soter_rounds_as_meant(void) {
  const volatile double one = 1.0, half_step = 0x1p-53, least = DBL_MIN;
  const volatile double odd = 1.0 + 0x1p-52;
  return one + half_step == one && odd + half_step != odd && -one - half_step == -one &&
         least * 0.5 > 0.0;
}

int soter_batch_apart(const soter_program* p, soter_flight* flights, uint32_t count,
                      const soter_order* order, int64_t* done) {
  *done = SOTER_APART_GONE;
  (void)fflush(NULL); /* what waits to be written is written once */
  const pid_t parent = getpid();
  const pid_t child = fork();
  if (child == 0) {
    size_t used = 0;
    soter_die_with(parent);
    const uint32_t flown = soter_batch(p, flights, count, order, &used);
    *done = soter_rounds_as_meant() ? (int64_t)flown : SOTER_APART_CHANGED;
    (void)fflush(NULL);
    _exit(0);
  }
  int status = -1;
  while (child > 0 && waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return status;
}
