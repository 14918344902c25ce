/* firmware_stack.c: how much stack the cart's firmware really uses.
 *
 * Purpose: the stack is painted before every call and looked at afterwards; prints the most that was
 * touched, in bytes.
 * Non-goals: portable C; it reads what it has not written, on purpose, and is compiled as it stands.
 */
#include "Vehicle_firmware.h"

#include <stdio.h>

#define DEEP 65536
#define PAINT 0xA5

static Vehicle vehicle;
static size_t most;

static __attribute__((noinline)) void paint(void) {
  volatile unsigned char below[DEEP];
  for (size_t i = 0; i < DEEP; i++) {
    below[i] = PAINT;
  }
}

static __attribute__((noinline)) void look(void) {
  volatile unsigned char below[DEEP];
  size_t i = 0;
  while (i < DEEP && below[i] == PAINT) {
    i++;
  }
  most = DEEP - i > most ? DEEP - i : most;
}

int main(void) {
  Vehicle_motion seen;
  seen.x = 0.0;
  seen.v = 0.0;
  paint();
  (void)Vehicle_start(&vehicle, 0);
  look();
  for (int64_t now = 0; now < INT64_C(2000000000); now += 5000000) {
    seen.x += 0.02;
    paint();
    (void)Vehicle_publish_motion(&vehicle, &seen, now, now);
    look();
    paint();
    (void)Vehicle_step(&vehicle, now);
    look();
  }
  (void)printf("%zu\n", most);
  return 0;
}
