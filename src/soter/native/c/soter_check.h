/* soter_check.h: what must be so inside the engines of proofs and tests, checked as they run.
 *
 * SOTER_CHECKED switches it on. What fails is a defect of soter, and nothing that was computed may
 * be read as a verdict: the process ends here, with the exit code of a defect. Compiled into
 * engines only, never into what is deployed. */
#ifndef SOTER_CHECK_H
#define SOTER_CHECK_H

#ifdef SOTER_CHECKED

#include <stdio.h>
#include <stdlib.h>

enum { SOTER_DEFECT = 70 };

#if defined(__GNUC__)
__attribute__((cold, noinline, noreturn))
#endif
static void soter_check_failed(const char* where, const char* what) {
  (void)fprintf(stderr, "error[I001]: soter has a defect, sorry: in %s: not %s\n", where, what);
  _Exit(SOTER_DEFECT);
}

#define SOTER_CHECK(cond) ((cond) ? (void)0 : soter_check_failed(__func__, #cond))

#else

#define SOTER_CHECK(cond) ((void)0)

#endif

#endif
