/* soter_self_test.c: does this build compute as programs mean it?
 *
 * Purpose: find at start what no compiler tells: flags without a macro, and what was linked or set
 * before (start code of -ffast-math that flushes small numbers to zero, another rounding).
 * Non-goals: flags that soter.h refuses at compile time.
 */
#include "soter.h"

/* The same number; what is made of it is computed when it runs, not by the compiler. */
static double plain(double x) {
  volatile double kept = x;
  return kept;
}

static bool catches(double x) {
  soter_fault fault = SOTER_OK;
  soter_check_finite(x, &fault);
  return fault == SOTER_NONFINITE;
}

static const char* comparing(void) {
  const double zero = plain(0.0);
  const double nan = zero / zero;
  const double inf = plain(1.0) / zero;
  if (nan == nan || nan < 1.0 || nan >= 1.0 || !(nan != nan) || !(inf > DBL_MAX)) {
    return "comparisons with NaN or infinity are wrong (-ffast-math, -ffinite-math-only?)";
  }
  if (!catches(nan) || !catches(inf) || !catches(-inf) || catches(zero)) {
    return "the gate does not see NaN or infinity (-ffast-math, -ffinite-math-only?)";
  }
  if (!(plain(1.0) / -zero < 0.0)) {
    return "the sign of zero is lost (-fno-signed-zeros?)";
  }
  return NULL;
}

static const char* rounding(void) {
  const double one = plain(1.0);
  const double half = plain(DBL_EPSILON / 2.0);
  const double odd = plain(1.0 + DBL_EPSILON);
  if (sizeof(1.0) != sizeof(double)) {
    return "constants are of single precision (-fsingle-precision-constant?)";
  }
  if (plain(one + half) != 1.0 || plain(odd + half) - odd != DBL_EPSILON ||
      plain(-one - half) != -1.0) {
    return "sums are not rounded to the nearest double, once (fesetround, x87?)";
  }
  if (odd * odd - (one + 2.0 * DBL_EPSILON) != 0.0) {
    return "a product and a sum are rounded together (-ffp-contract=fast?)";
  }
  const double small = plain(plain(DBL_MIN) / 2.0);
  if (!(small > 0.0) || plain(small * 2.0) != DBL_MIN) {
    return "small numbers are flushed to zero (linked with -ffast-math or -Ofast?)";
  }
  return NULL;
}

const char* soter_self_test(void) {
  const char* const wrong = comparing();
  return wrong != NULL ? wrong : rounding();
}
