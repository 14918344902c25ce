/* soter_gym_python.c: the calls of a step as functions of Python itself.
 *
 * Purpose: a step of one world is two calls, and a foreign-function interface takes as long as what
 * they do. These are methods without arguments (METH_NOARGS of Python's stable ABI) of an int, the
 * address of a soter_outside. The two functions of Python that they need are given.
 * Non-goals: Python's headers, which a machine need not have.
 */
#include "soter_gym.h"

static void* (*soter_int_of)(long);
static void* (*soter_address_of)(void*);

void soter_python_given(void* int_of, void* address_of) {
  SOTER_CHECK(int_of != NULL);
  SOTER_CHECK(address_of != NULL);
  soter_int_of = (void* (*)(long))(uintptr_t)int_of;
  soter_address_of = (void* (*)(void*))(uintptr_t)address_of;
}

void* soter_python_act(void* self, void* nothing) {
  (void)nothing;
  return soter_int_of((long)soter_outside_act((soter_outside*)soter_address_of(self)));
}

void* soter_python_move(void* self, void* nothing) {
  (void)nothing;
  return soter_int_of((long)soter_outside_move_on((soter_outside*)soter_address_of(self)));
}
