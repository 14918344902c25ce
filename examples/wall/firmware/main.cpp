// main.cpp: the cart's firmware in C++, with the clock of the machine (docs/deploy.md).
#include "Vehicle_firmware.h"

#include <chrono>
#include <cstdio>
#include <thread>

static int64_t clock_ns() {
  const auto since = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(since).count();
}

int main() {
  static Vehicle vehicle;
  double x = 0.0, v = 0.0, accel = 0.0;
  const int64_t start = clock_ns();
  if (const char* wrong = Vehicle_start(&vehicle, start)) {
    std::fprintf(stderr, "not started: %s\n", wrong);
    return 1;
  }
  unsigned missed = 0;
  for (int64_t now = start; now < start + 500'000'000; now = clock_ns()) {
    Vehicle_motion seen{};
    seen.x = x;
    seen.v = v;
    Vehicle_publish_goal(&vehicle, 9.9, now, now);
    Vehicle_publish_motion(&vehicle, &seen, now, now);
    missed += (Vehicle_step(&vehicle, now) & (SOTER_BEHIND | SOTER_LATE)) != 0 ? 1 : 0;
    Vehicle_read_accel(&vehicle, &accel, nullptr);
    x += 0.005 * v;
    v += 0.005 * accel;
    std::this_thread::sleep_for(std::chrono::nanoseconds(Vehicle_next(&vehicle) - clock_ns()));
  }
  const bool ac = Vehicle_mode_SafeCart(&vehicle) == SOTER_AC;
  std::printf("%s has control, %u late steps of the loop\n", ac ? "AC" : "SC", missed);
  return x < 10.0 ? 0 : 3;
}
