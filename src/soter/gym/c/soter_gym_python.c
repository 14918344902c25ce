/* soter_gym_python.c: the calls of a step as functions of Python itself.
 *
 * Purpose: a step of one world is two calls, and a foreign-function interface takes as long as what
 * they do, NumPy's copy into an array of another type longer. These are methods of one argument
 * (METH_O of Python's stable ABI), whose numbers they read where they lie, by the buffer protocol;
 * `self` is an int, the address of a soter_outside. The functions of Python that they need are
 * given.
 * Non-goals: Python's headers, which a machine need not have; numbers that are neither float nor
 * double in native order, which the caller converts.
 */
#include <string.h>

#include "soter_gym.h"

/* Py_buffer of the stable ABI. */
typedef struct {
  uint8_t* data;
  void* object;
  intptr_t bytes;
  intptr_t item_size;
  int read_only;
  int axes;
  char* format;
  intptr_t* shape;
  intptr_t* strides;
  intptr_t* suboffsets;
  void* internal;
} soter_buffer;

#define SOTER_BUFFER_FORMAT 0x04
#define SOTER_BUFFER_STRIDES 0x18

static void* (*soter_int_of)(long);
static void* (*soter_address_of)(void*);
static int (*soter_buffer_of)(void*, soter_buffer*, int);
static void (*soter_buffer_release)(soter_buffer*);
static void (*soter_clear_error)(void);

void soter_python_given(const soter_python* python) {
  SOTER_CHECK(python != NULL);
  soter_int_of = (void* (*)(long))(uintptr_t)python->int_of;
  soter_address_of = (void* (*)(void*))(uintptr_t)python->address_of;
  soter_buffer_of = (int (*)(void*, soter_buffer*, int))(uintptr_t)python->buffer_of;
  soter_buffer_release = (void (*)(soter_buffer*))(uintptr_t)python->buffer_release;
  soter_clear_error = (void (*)(void))(uintptr_t)python->clear_error;
}

/* The type of the numbers of an array with one axis that has `count` of them; 0: they are not read.
 */
static char soter_type_of(const soter_buffer* b, uint32_t count) {
  const char type =
      b->format != NULL && b->format[0] != '\0' && b->format[1] == '\0' ? b->format[0] : '\0';
  const bool fits = b->axes == 1 && b->shape[0] == (intptr_t)count;
  return fits && (type == 'f' || type == 'd') ? type : '\0';
}

/* The numbers of such an array; false: they are not read. */
static bool soter_numbers_of(void* array, uint32_t count, double* into) {
  soter_buffer b;
  if (soter_buffer_of(array, &b, SOTER_BUFFER_FORMAT | SOTER_BUFFER_STRIDES) != 0) {
    soter_clear_error();
    return false;
  }
  const char type = soter_type_of(&b, count);
  for (uint32_t i = 0; i < count && type != '\0'; i++) {
    const uint8_t* const at = b.data + (intptr_t)i * b.strides[0];
    if (type == 'd') {
      (void)memcpy(&into[i], at, sizeof into[i]);
    } else {
      float single;
      (void)memcpy(&single, at, sizeof single);
      into[i] = (double)single;
    }
  }
  soter_buffer_release(&b);
  return type != '\0';
}

void* soter_python_act(void* self, void* action) {
  soter_outside* const o = (soter_outside*)soter_address_of(self);
  const bool read = soter_numbers_of(action, o->view->action.count, o->action);
  return soter_int_of(read ? (long)soter_outside_act(o) : (long)SOTER_NO_NUMBERS);
}

void* soter_python_move(void* self, void* states) {
  soter_outside* const o = (soter_outside*)soter_address_of(self);
  const bool read = soter_numbers_of(states, o->view->moved.count, o->states);
  return soter_int_of(read ? (long)soter_outside_move_on(o) : (long)SOTER_NO_NUMBERS);
}
