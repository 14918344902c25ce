/* soter_check_failed_exit.c: a check that fails on this machine (soter_check.h).
 *
 * Purpose: what fails in an engine, or in the kernel under one, is a defect of soter, and nothing
 * that was computed may be read as a verdict: the process ends here, with the exit code of a
 * defect. Non-goals: what is deployed: its driver says what happens there.
 */
#include "soter_check.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { DEFECT = 70 };

void soter_check_failed(const char* file, int line, const char* what) {
  const char* const slash = strrchr(file, '/');
  (void)fprintf(stderr, "error[I001]: soter has a defect, sorry: %s:%d: not %s\n",
                slash == NULL ? file : slash + 1, line, what);
  _Exit(DEFECT);
}
