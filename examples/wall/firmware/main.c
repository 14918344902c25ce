/* main.c: the cart's firmware: a loop and a clock of one's own (docs/deploy.md).
 *
 * Purpose: what a user writes around a generated program; the clock is a counter here and the sensor
 * a sum, so that it runs anywhere and always says the same.
 * Non-goals: a driver of a real board.
 */
#include "Vehicle_firmware.h"

#include <stdio.h>

#define TICK_NS INT64_C(5000000)

static Vehicle vehicle; /* everything that changes: no heap, no other global */

int main(void) {
  double x = 0.0, v = 0.0, accel = 0.0, farthest = 0.0; /* the world, in place of a board */
  int64_t now = INT64_C(123456789);                     /* a clock may start anywhere */
  const char* const wrong = Vehicle_start(&vehicle, now);
  if (wrong != NULL) {
    (void)fprintf(stderr, "not started: %s\n", wrong);
    return 1;
  }
  soter_mode mode = SOTER_SC;
  for (int tick = 0; tick < 6000; tick++, now += TICK_NS) {
    Vehicle_motion seen;
    seen.x = x;
    seen.v = v;
    (void)Vehicle_publish_goal(&vehicle, 9.9, now, now);
    if (Vehicle_publish_motion(&vehicle, &seen, now, now) != SOTER_TAKEN) {
      (void)printf("%d: a reading was refused\n", tick);
    }
    const uint32_t said = Vehicle_step(&vehicle, now);
    if ((said & (SOTER_LATE | SOTER_BEHIND | SOTER_UNHEARD | SOTER_LATCHED)) != 0U) {
      (void)printf("%d: the step says %u\n", tick, (unsigned)said);
    }
    (void)Vehicle_read_accel(&vehicle, &accel, NULL); /* to the actuator */
    if (Vehicle_mode_SafeCart(&vehicle) != mode) {
      mode = Vehicle_mode_SafeCart(&vehicle);
      (void)printf("%d: %s has control\n", tick, mode == SOTER_AC ? "AC" : "SC");
    }
    x += 0.005 * v + 0.0000125 * accel;
    v += 0.005 * accel;
    farthest = x > farthest ? x : farthest;
  }
  (void)printf("farthest %.3f m, %s\n", farthest, farthest < 10.0 ? "before the wall" : "CRASHED");
  return farthest < 10.0 ? 0 : 3;
}
