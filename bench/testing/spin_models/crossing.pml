/* crossing.soter: one process; who moves. Times in ticks of 5 ms; nothing reads them, so a step is as early as it may be. */
#ifndef H
#define H 120 /* releases up to here */
#endif
#define NONE 200 /* no release is left */
byte t;                  /* now */
byte rt, rb, rs, rk, rl; /* next releases: train, bar, sensor, keeper, lamp */
byte lim;                /* nothing happens later: the least end of a window */
unsigned at : 6; unsigned seen : 6; unsigned open : 3 = 4;
bit close, lamp;
hidden byte n;

#define LATER(a, b) ((a) > (b) -> (a) : (b))
#define EARLIER(a, b) ((a) < (b) -> (a) : (b))
#define MAY(r) (LATER(t, r) <= lim)

inline begin(r, period) {
  t = LATER(t, r);
  r = r + period;
  if :: r > H -> r = NONE :: else fi
}
inline end() {
  lim = EARLIER(EARLIER(EARLIER(rt, rb), rs), EARLIER(rk + 2, rl + 3));
  if :: lim >= NONE -> lim = NONE - 1 :: else fi;
  assert(lim <= t || !(at == 30 && open > 0))
}

active proctype all() {
  do
  :: d_step { MAY(rt) -> begin(rt, 2); end() }
  :: d_step { MAY(rt) && rt > 0 -> begin(rt, 2); at = (at == 40 -> 0 : at + 1); end() }
  :: d_step { MAY(rb) -> n = rb; begin(rb, 2);
       if :: n > 0 -> open = (close -> (open > 0 -> open - 1 : 0) : (open < 4 -> open + 1 : 4))
          :: else fi; end() }
  :: d_step { MAY(rs) -> begin(rs, 2); seen = at; end() }
  :: d_step { MAY(rk) -> begin(rk, 2); close = (seen >= 20 && seen <= 30); end() }
  :: d_step { MAY(rl) -> begin(rl, 4); lamp = (open < 4 || seen > 0); end() }
  od
}
