/* main.c: the shuttle's firmware: a loop and a clock of one's own (docs/deploy.md).
 *
 * Purpose: what a user writes around a generated program: sensors in, a step, a lease, and a drive
 * that obeys no longer than its lease. The clock is a counter here and the world a sum, so that it
 * runs anywhere and always says the same; a loop on a real clock prints nothing, as whoever reads
 * that may hold it up, or end it. `./shuttle 7300`: the sensor dies after 7.3 s.
 * Non-goals: a driver of a real board.
 */
#include "Vehicle_firmware.h"
#include "shuttle_firmware_lease.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define WALL 10.0
#define TICK_NS INT64_C(5000000)
#define TICKS 24000
/* what SC did in such a step no proof speaks of */
#define NOT_DONE (SOTER_STALE | SOTER_UNHEARD | SOTER_LATCHED | SOTER_NO_ANSWER)

enum { DM = shuttle_firmware_Guard_node_Guard_dm, SC = shuttle_firmware_Guard_node_Guard_Back };

static Vehicle vehicle;   /* everything that changes: no heap */
static soter_grant grant; /* the trusted side: until when a command may be obeyed */
static int64_t done[2];
static bool silent;       /* no command is passed on any more */
static soter_lease lease; /* the drive's side: what it obeys; may be on another processor */
static shuttle_firmware_Guard_command room;
static double driven; /* the drive: m/s */

/* The drive is sent a command with its lease, where the step from `start` to `out` gave one. */
static void pass_on(uint32_t said, int64_t start, int64_t out) {
  shuttle_firmware_Guard_command command;
  int64_t stamp = 0, expiry = 0;
  if (silent || (said & NOT_DONE) != 0U) {
    silent = true; /* for good: a person starts the trusted part anew, and arms the lease */
    return;
  }
  const bool looks = soter_grant_next(&grant, DM) <= start; /* SC then begins behind the DM */
  while (soter_grant_next(&grant, DM) <= start) {
    (void)soter_grant_done(&grant, DM, start, out);
  }
  while (soter_grant_next(&grant, SC) <= start) {
    (void)soter_grant_done(&grant, SC, looks ? out : start, out);
  }
  if (soter_grant_lease(&grant, out, &stamp, &expiry)) {
    (void)Vehicle_read_speed(&vehicle, &command.speed, NULL);
    (void)soter_lease_take(&lease, out, &command, stamp, expiry);
  }
}

/* Something of the program is not as it must be: nothing that it says counts any more. The drive is
 * given its law, a constant; a board then waits for its watchdog. */
void soter_check_failed(const char* file, int line, const char* what) {
  driven = ((const shuttle_firmware_Guard_command*)shuttle_firmware_Guard_lease.law)->speed;
  (void)printf("%s:%d: not %s: the drive holds the law, %g m/s\n", file, line, what, driven);
  exit(70);
}

int main(int count, char** words) {
  const long dies = count > 1 ? strtol(words[1], NULL, 10) : -1; /* ms after the start */
  double x = 0.0, farthest = 0.0;                                /* the world */
  int64_t now = INT64_C(123456789);                              /* a clock may start anywhere */
  const char* const wrong = Vehicle_start(&vehicle, now);
  if (wrong != NULL) {
    (void)fprintf(stderr, "not started: %s\n", wrong);
    return 1;
  }
  soter_grant_begin(&grant, &shuttle_firmware_Guard_grant, done, now);
  soter_lease_init(&lease, &shuttle_firmware_Guard_lease, &room);
  bool obeys = false;
  int ac = 0;
  for (long tick = 0; tick < TICKS; tick++, now += TICK_NS) {
    (void)Vehicle_publish_goal(&vehicle, 12.0, now, now);
    if ((dies < 0 || tick * 5 < dies) &&
        Vehicle_publish_position(&vehicle, x, now, now) != SOTER_TAKEN) {
      (void)printf("%ld ms: a reading was refused\n", tick * 5);
    }
    pass_on(Vehicle_step(&vehicle, now), now, now);
    ac += Vehicle_mode_Guard(&vehicle) == SOTER_AC ? 1 : 0;
    shuttle_firmware_Guard_command held;
    if (soter_lease_read(&lease, now, &held) != obeys) { /* the drive does what `held` says */
      obeys = !obeys;
      (void)printf("%ld ms: the drive %s\n", tick * 5, obeys ? "obeys" : "holds the law");
    }
    driven = held.speed;
    x += 0.005 * driven;
    farthest = fmax(farthest, fabs(x)); /* there is a wall at either end */
  }
  (void)printf("AC had control in %d of %d turns, farthest %.3f m from the middle: %s\n", ac, TICKS,
               farthest, farthest < WALL ? "between the walls" : "CRASHED");
  return farthest < WALL ? 0 : 3;
}
