/* hostile_ac.c: an advanced controller that is fine for some steps and then means harm.
 *
 * Purpose: what an extern node may do to a core without processes; on the host, which would not
 * survive that, the same steps fail. KIND: what it does, of HOSTILE_KINDS.
 * Non-goals: what it may publish (the gate's tests).
 */
#include "cart.h"

#define FORCE 3.0

#if defined(__arm__)
extern unsigned soter_bss;
static const volatile unsigned limit = 0x600df00dU; /* the test writes another one into the image */

__attribute__((noinline)) static int deeper(volatile int* above) {
  volatile int here[16];
  here[0] = *above + 1;
  return deeper(here) + here[0];
}

static int misbehave(void) {
  volatile int zero = 0;
  switch (KIND) {
    case 0: /* never ends */
      for (;;) {
      }
    case 1: /* writes into what the trusted part keeps */
      for (volatile unsigned* word = &soter_bss;; word++) {
        *word = 0xffffffffU;
      }
    case 2: /* overflows its stack */
      return deeper(&zero);
    case 3:
      return 7 / zero;
    case 4: /* runs data */
      ((void (*)(void))0x20000101U)();
      return 0;
    default: /* switches off the protection, and the clock */
      *(volatile unsigned*)0xE000ED94U = 0U;
      *(volatile unsigned*)0xE000E010U = 0U;
      soter_bss = 0U;
      return 0;
  }
}
#else
#include <stdlib.h>
static unsigned limit, number; /* what the test says: a thousand times the run, and the limit */
static int misbehave(void) {
  return 1;
}
#endif

static volatile unsigned steps;
static volatile unsigned complement = ~0U; /* of steps: a stack that overflowed went over both */

int hostile(const cart_SafeCart_Fast_in* in, cart_SafeCart_Fast_out* out) {
#if !defined(__arm__)
  const unsigned told = (unsigned)atoi(getenv("HOSTILE_LIMIT"));
  steps = told == number ? steps : 0U;
  complement = ~steps;
  number = told;
  limit = told % 1000U;
#endif
  if (complement != ~steps || steps >= limit) {
    return misbehave();
  }
  steps++;
  complement--;
  const double u = 4.0 * (in->goal - in->motion.x) - 1.0 * in->motion.v;
  out->accel = u < -FORCE ? -FORCE : u > FORCE ? FORCE : u;
  out->has_accel = 1;
  return 0;
}
