/* skewed_buffer.soter: one process; who moves. Times in ticks of 10 ms; nothing reads them, so a step is as early as it may be. */
#ifndef H
#define H 24 /* releases up to here */
#endif
#define SKEW 2
#define NONE 100 /* no release is left */
byte t;                      /* now */
byte rp, rc, rg, rl, rn, rm; /* next releases: producer, consumer, gauge, lamp, noise, mixer */
byte lim = SKEW;             /* nothing happens later: the least end of a window */
unsigned made : 3; unsigned used : 3; unsigned level : 3; unsigned noise : 2; unsigned mixed : 2;
bit lamp;

#define LATER(a, b) ((a) > (b) -> (a) : (b))
#define EARLIER(a, b) ((a) < (b) -> (a) : (b))
#define MAY(r) (LATER(t, r) <= lim)

inline begin(r, period) {
  t = LATER(t, r);
  r = r + period;
  if :: r > H -> r = NONE :: else fi
}
inline end() {
  lim = EARLIER(EARLIER(EARLIER(rp, rc), EARLIER(rg, rl)), EARLIER(rn, rm)) + SKEW;
  if :: lim >= NONE -> lim = NONE - 1 :: else fi;
  assert(lim <= t || level <= 4)
}

active proctype all() {
  do
  :: d_step { MAY(rp) && (made + 6 - used) % 6 < 4 -> begin(rp, 2); made = (made + 1) % 6; end() }
  :: d_step { MAY(rp) -> begin(rp, 2); end() }
  :: d_step { MAY(rc) -> begin(rc, 3); used = (made != used -> (used + 1) % 6 : used); end() }
  :: d_step { MAY(rg) -> begin(rg, 2); level = (made + 6 - used) % 6; end() }
  :: d_step { MAY(rl) -> begin(rl, 4); lamp = level > 2; end() }
  :: d_step { MAY(rn) -> begin(rn, 3); noise = 0; end() }
  :: d_step { MAY(rn) -> begin(rn, 3); noise = 1; end() }
  :: d_step { MAY(rn) -> begin(rn, 3); noise = 2; end() }
  :: d_step { MAY(rn) -> begin(rn, 3); noise = 3; end() }
  :: d_step { MAY(rm) -> begin(rm, 2); mixed = (lamp -> noise : 0); end() }
  od
}
