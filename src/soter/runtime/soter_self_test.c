/* soter_self_test.c: does this build compute as programs mean it?
 *
 * Purpose: find at start what no compiler tells: flags without a macro, and what was linked or set
 * before (start code of -ffast-math that flushes small numbers to zero, another rounding); in the
 * file of the program, too, which another build system may have compiled.
 * Non-goals: flags that soter.h refuses as it compiles; the test itself (soter.h, soter_computes).
 */
#include "soter.h"

const char* soter_self_test(const soter_program* p) {
  const char* const wrong = soter_computes();
  return wrong != NULL || p == NULL ? wrong : p->self_test();
}
