/* soter_mavlink_clock.c: see soter_mavlink_clock.h. */
#include "soter_mavlink_clock.h"

#include "soter_check.h"

#include <stddef.h>
#include <string.h>

/* Half of what an int64_t holds: of two such numbers neither sum nor difference overflows. */
#define FAR (INT64_MAX / 4)

static int64_t drift(int64_t over_ns) {
  const int64_t passed = over_ns < 0 ? -over_ns : over_ns;
  return passed / 1000000 * SOTER_MAVLINK_DRIFT_PPM + SOTER_MAVLINK_DRIFT_PPM;
}

static size_t kept(const soter_mavlink_clock* clock) {
  SOTER_CHECK(clock != NULL);
  return clock->exchanges < SOTER_MAVLINK_EXCHANGES ? (size_t)clock->exchanges
                                                    : SOTER_MAVLINK_EXCHANGES;
}

void soter_mavlink_clock_ask(soter_mavlink_clock* clock, int64_t now) {
  SOTER_CHECK(clock != NULL);
  clock->pending[clock->requests++ % SOTER_MAVLINK_PENDING] = now;
}

/* Whether a request with this in it waits for an answer, and now no longer does. */
static bool was_asked(soter_mavlink_clock* clock, int64_t ts1) {
  for (size_t k = 0; k < SOTER_MAVLINK_PENDING; k++) {
    if (ts1 > 0 && clock->pending[k] == ts1) {
      clock->pending[k] = 0;
      return true;
    }
  }
  return false;
}

bool soter_mavlink_clock_hear(soter_mavlink_clock* clock, int64_t now, int64_t ts1,
                              int64_t remote) {
  SOTER_CHECK(clock != NULL);
  if (!was_asked(clock, ts1) || remote <= 0 || remote > FAR || ts1 > now) {
    clock->unasked++;
    return false;
  }
  if (now - ts1 > SOTER_MAVLINK_ROUND_NS) {
    clock->slow++;
    return true;
  }
  if (soter_mavlink_clock_runs(clock, now)) {
    int64_t earliest = 0;
    int64_t latest = 0;
    soter_mavlink_clock_turn(clock, now, remote, &earliest, &latest);
    if (earliest > now || latest < ts1) { /* it cannot have shown this within the round trip */
      clock->exchanges = 0;
      clock->jumps++;
    }
  }
  clock->exchange[clock->exchanges++ % SOTER_MAVLINK_EXCHANGES] =
      (soter_mavlink_exchange){.sent = ts1, .received = now, .remote = remote};
  return true;
}

bool soter_mavlink_clock_runs(const soter_mavlink_clock* clock, int64_t now) {
  SOTER_CHECK(clock != NULL);
  if (clock->exchanges == 0) {
    return false;
  }
  const size_t last = (size_t)((clock->exchanges - 1) % SOTER_MAVLINK_EXCHANGES);
  return now - clock->exchange[last].received <= SOTER_MAVLINK_LASTS_NS;
}

void soter_mavlink_clock_turn(const soter_mavlink_clock* clock, int64_t now, int64_t stamp,
                              int64_t* earliest, int64_t* latest) {
  SOTER_CHECK(earliest != NULL && latest != NULL && earliest != latest);
  const int64_t near = stamp > FAR ? FAR : stamp;
  *earliest = -FAR;
  *latest = FAR;
  for (size_t k = 0; k < kept(clock); k++) {
    const soter_mavlink_exchange* const e = &clock->exchange[k];
    const int64_t since = near - e->remote;
    const int64_t wide = drift(since) + drift(now - e->sent);
    const int64_t low = e->sent + since - wide;
    const int64_t high = e->received + since + wide;
    *earliest = low > *earliest ? low : *earliest;
    *latest = high < *latest ? high : *latest;
  }
}
