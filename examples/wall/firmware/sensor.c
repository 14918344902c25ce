/* sensor.c: a sensor and a drive in a process of their own (docs/real-time.md).
 *
 * Purpose: what stands on the other side of the channels of examples/wall/stop_vehicle.soter: it
 * says every 10 ms where the cart is, and moves it at the speed that the actuators apply.
 * Non-goals: a driver of a real sensor; being on time.
 */
#define _POSIX_C_SOURCE 200809L
#include "stop_vehicle_channels.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define TICK_NS INT64_C(10000000)

static int64_t now_ns(void) {
  struct timespec t;
  (void)clock_gettime(CLOCK_MONOTONIC, &t);
  return (int64_t)t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

int main(int count, char** words) {
  soter_outside position, speed;
  const char* const folder = count > 1 ? words[1] : ".";
  const long ticks = count > 2 ? strtol(words[2], NULL, 10) : 1000;
  const char* wrong = stop_vehicle_open_position(&position, folder);
  wrong = wrong != NULL ? wrong : stop_vehicle_open_speed(&speed, folder);
  if (wrong != NULL) {
    (void)fprintf(stderr, "not started: %s\n", wrong);
    return 1;
  }
  double x = 0.0, v = 0.0, farthest = 0.0;
  for (long tick = 0; tick < ticks; tick++) {
    int64_t applied = 0; /* when the actuators applied it */
    soter_outside_write(&position, now_ns(), &x);
    (void)soter_outside_read(&speed, &applied, &v, NULL); /* none since the last: v as it was */
    const struct timespec nap = {0, (long)TICK_NS};
    (void)nanosleep(&nap, NULL);
    x += v * 0.01;
    farthest = x > farthest ? x : farthest;
  }
  (void)printf("farthest %.3f m, last speed %.3f m/s\n", farthest, v);
  return farthest < 10.0 ? 0 : 3;
}
