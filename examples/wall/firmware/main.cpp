// main.cpp: the shuttle's firmware in C++, with the clock of the machine (docs/deploy.md).
//
// Purpose: as main.c. `./shuttle 7300`: the sensor dies after 7.3 s, and the time is counted.
// Non-goals: a driver of a real board.
#include "Vehicle_firmware.h"
#include "shuttle_firmware_lease.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <thread>

constexpr double wall = 10.0;
constexpr int64_t ms = 1'000'000;
// what SC did in such a step no proof speaks of
constexpr uint32_t not_done = SOTER_STALE | SOTER_UNHEARD | SOTER_LATCHED | SOTER_NO_ANSWER;

// The time in ns: a monotonic clock's, or counted.
struct Clock {
  bool counted;
  int64_t at;

  int64_t now() const {
    const auto since = std::chrono::steady_clock::now().time_since_epoch();
    return counted ? at : std::chrono::duration_cast<std::chrono::nanoseconds>(since).count();
  }
  void wait_until(int64_t time) {
    counted ? void(at = time) : std::this_thread::sleep_for(std::chrono::nanoseconds(time - now()));
  }
};

// The trusted side: the program, and who says until when its commands may be obeyed.
struct Trusted {
  Vehicle vehicle{};
  soter_grant grant{};
  int64_t done[2]{};
  bool silent = false;  // no command is passed on any more

  // One step; the drive is sent a command with its lease, where the step gave one.
  void turn(Clock& clock, soter_lease& drive) {
    const int64_t start = clock.now();
    const uint32_t said = Vehicle_step(&vehicle, start);
    const int64_t out = clock.now();
    silent = silent || (said & not_done) != 0;
    if (silent) {
      return;  // for good: a person starts the trusted part anew, and arms the lease
    }
    const uint32_t dm = shuttle_firmware_Guard_node_Guard_dm;
    const bool looks = soter_grant_next(&grant, dm) <= start;  // SC then begins behind the DM
    report(dm, start, out);
    report(shuttle_firmware_Guard_node_Guard_Back, looks ? out : start, out);
    shuttle_firmware_Guard_command command{};
    int64_t stamp = 0, expiry = 0;
    if (soter_grant_lease(&grant, out, &stamp, &expiry)) {
      Vehicle_read_speed(&vehicle, &command.speed, nullptr);
      soter_lease_take(&drive, out, &command, stamp, expiry);
    }
  }
  void report(uint32_t node, int64_t start, int64_t out) {
    while (soter_grant_next(&grant, node) <= start) {
      soter_grant_done(&grant, node, start, out);
    }
  }
};

// Something of the program is not as it must be: nothing that it says counts any more. A board gives
// the drive its law, a constant, and waits for its watchdog; here nothing moves once we have ended.
void soter_check_failed(const char* file, int line, const char* what) {
  std::fprintf(stderr, "%s:%d: not %s\n", file, line, what);
  std::exit(70);
}

int main(int count, char** words) {
  const bool given = count > 1;
  static Trusted trusted;
  Clock clock{given, 1};
  const int64_t start = clock.now();
  const int64_t end = start + (given ? 120'000 : 500) * ms;
  const int64_t dies = given ? start + std::strtol(words[1], nullptr, 10) * ms : end;
  if (const char* wrong = Vehicle_start(&trusted.vehicle, start)) {
    std::fprintf(stderr, "not started: %s\n", wrong);
    return 1;
  }
  soter_grant_begin(&trusted.grant, &shuttle_firmware_Guard_grant, trusted.done, start);
  soter_lease drive;  // may be on another processor
  shuttle_firmware_Guard_command room, held{};
  soter_lease_init(&drive, &shuttle_firmware_Guard_lease, &room);
  bool obeys = false;
  double x = 0.0, farthest = 0.0;
  for (int64_t now = start, last = start; now < end; last = now, now = clock.now()) {
    x += held.speed * 1e-9 * static_cast<double>(now - last);
    farthest = std::max(farthest, std::fabs(x));  // there is a wall at either end
    Vehicle_publish_goal(&trusted.vehicle, 12.0, now, now);
    if (now < dies) {
      Vehicle_publish_position(&trusted.vehicle, x, now, now);
    }
    trusted.turn(clock, drive);
    obeys = soter_lease_read(&drive, clock.now(), &held);  // the drive does what `held` says
    clock.wait_until(std::min(Vehicle_next(&trusted.vehicle), now + 5 * ms));
  }
  std::printf("the drive %s, farthest %.3f m from the middle: %s\n",
              obeys ? "obeys" : "holds the law", farthest,
              farthest < wall ? "between the walls" : "CRASHED");
  return farthest < wall ? 0 : 3;
}
