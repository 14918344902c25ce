/* soter_apart.c: see soter_apart.h. The copy has one thread, which never goes back to Python. */
#define _POSIX_C_SOURCE 200809L
#define _DEFAULT_SOURCE /* on_exit */
#include "soter_apart.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <float.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
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

#if defined(__GLIBC__)
/* C that calls `exit` ends the copy here: what the first process has to do at its end, with threads
 * that the copy has not, may wait for ever. */
static void soter_end(int status, void* nothing) {
  (void)nothing;
  (void)fflush(NULL);
  _exit(status);
}
#endif

/* Doubles are rounded to the nearest one, and small ones are kept (arithmetic.py). */
static bool soter_rounds_as_meant(void) {
  const volatile double one = 1.0, half_step = 0x1p-53, least = DBL_MIN;
  const volatile double odd = 1.0 + 0x1p-52;
  return one + half_step == one && odd + half_step != odd && -one - half_step == -one &&
         least * 0.5 > 0.0;
}

/* What `soter_batch` of a library gives, or SOTER_APART_UNLOADED. */
static int64_t soter_flown(const soter_library* library, soter_flight* flights, uint32_t count,
                           const soter_order* order) {
  typedef uint32_t soter_batch_fn(const soter_program*, soter_flight*, uint32_t, const soter_order*,
                                  size_t*);
  soter_order own = *order;
  size_t used = 0;
  void* const loaded = dlopen(library->path, RTLD_NOW | RTLD_LOCAL);
  if (!loaded) {
    return SOTER_APART_UNLOADED;
  }
  soter_batch_fn* batch = NULL;
  *(void**)&batch = dlsym(loaded, "soter_batch");
  const soter_program* const program = dlsym(loaded, library->program);
  own.measured = dlsym(loaded, library->measured);
  if (!batch || !program || !own.measured) {
    return SOTER_APART_UNLOADED;
  }
  return (int64_t)batch(program, flights, count, &own, &used);
}

static void soter_read_nothing(void) {
  const int nothing = open("/dev/null", O_RDONLY);
  if (nothing < 0 || dup2(nothing, STDIN_FILENO) < 0) {
    _exit(1);
  }
  if (nothing != STDIN_FILENO) {
    (void)close(nothing);
  }
}

int soter_batch_apart(const soter_library* library, soter_flight* flights, uint32_t count,
                      const soter_order* order, int64_t* done) {
  *done = SOTER_APART_GONE;
  (void)fflush(NULL); /* what waits to be written is written once */
  const pid_t parent = getpid();
  const pid_t child = fork();
  if (child == 0) {
    soter_die_with(parent);
    soter_read_nothing();
#if defined(__GLIBC__)
    (void)on_exit(soter_end, NULL);
#endif
    const int64_t flown = soter_flown(library, flights, count, order);
    *done = soter_rounds_as_meant() ? flown : SOTER_APART_CHANGED;
    (void)fflush(NULL);
    _exit(0);
  }
  int status = -1;
  while (child > 0 && waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return status;
}
