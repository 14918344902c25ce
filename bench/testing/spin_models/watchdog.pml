/* watchdog.soter: one process; who moves, and when. Times in ticks of 10 ms. */
#ifndef H
#define H 48 /* releases up to here */
#endif
#define SKEW 2
#define NONE 100 /* no release is left */
byte t;                  /* now */
byte r1, r2, r3, r4;     /* next releases */
byte lim = SKEW;         /* nothing happens later: the least end of a window */
byte beaten;             /* when the beat was published, and one; 0: never */
unsigned beat : 3; unsigned misses : 2; unsigned order : 3; unsigned told : 3;
hidden byte first;

#define LATER(a, b) ((a) > (b) -> (a) : (b))
#define EARLIER(a, b) ((a) < (b) -> (a) : (b))
#define MAY(r, j) (LATER(t, r) + j <= lim)

inline begin(r, period, j) {
  t = LATER(t, r) + j;
  r = r + period;
  if :: r > H -> r = NONE :: else fi
}
inline end() {
  lim = EARLIER(EARLIER(r1, r2), EARLIER(r3, r4)) + SKEW;
  if :: lim >= NONE -> lim = NONE - 1 :: else fi;
  assert(lim <= t || (misses <= 2 && told <= 7))
}

#define BEAT(j, v) :: d_step { MAY(r1, j) -> begin(r1, 4, j); beat = v; beaten = t + 1; end() }
#define SENSOR(j) \
  BEAT(j, 0) BEAT(j, 1) BEAT(j, 2) BEAT(j, 3) BEAT(j, 4) BEAT(j, 5) BEAT(j, 6) BEAT(j, 7)
#define WATCHDOG(j) \
  :: d_step { MAY(r2, j) -> begin(r2, 2, j); \
       misses = (beaten == 0 || t + 1 - beaten > 4 -> (misses < 3 -> misses + 1 : 3) : 0); end() }
#define PILOT(j) \
  :: d_step { MAY(r3, j) -> begin(r3, 3, j); order = (misses > 0 -> 0 : beat); end() }
#define DISPLAY(j) \
  :: d_step { MAY(r4, j) -> begin(r4, 4, j); told = order; end() }

active proctype all() {
  do
  SENSOR(0) SENSOR(1) SENSOR(2)
  WATCHDOG(0) WATCHDOG(1) WATCHDOG(2)
  PILOT(0) PILOT(1) PILOT(2)
  DISPLAY(0) DISPLAY(1) DISPLAY(2)
  od
}
