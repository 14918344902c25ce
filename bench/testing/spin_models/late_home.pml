/* late_home.soter: one process; who moves, and when. Times in ticks of 5 ms. */
#ifndef H
#define H 60 /* releases up to here */
#endif
#define NONE 100 /* no release is left */
#define MID 13
#define OLD 5    /* older than the max_age of four ticks, or never published */
byte t;                   /* now */
byte rp, re, ra, rs, rd;  /* next releases: plant, estimator, AC, SC, DM */
byte lim;                 /* nothing happens later: the least end of a window */
unsigned x : 5 = MID; unsigned est : 5 = MID; unsigned c : 2 = 1;
unsigned age : 3 = OLD;   /* of the estimate */
bit m;                    /* 1: AC in control */
hidden byte at, n;

#define LATER(a, b) ((a) > (b) -> (a) : (b))
#define EARLIER(a, b) ((a) < (b) -> (a) : (b))
#define MAY(r, j) (LATER(t, r) + j <= lim)

inline begin(r, period, j) {
  at = LATER(t, r) + j;
  age = (age + at - t >= OLD -> OLD : age + at - t);
  t = at;
  r = r + period;
  if :: r > H -> r = NONE :: else fi
}
inline end() {
  lim = EARLIER(EARLIER(EARLIER(rp, ra), rd), EARLIER(re + 3, rs + 4));
  if :: lim >= NONE -> lim = NONE - 1 :: else fi;
  assert(lim <= t || (x > 0 && x < 26))
}

#define ESTIMATOR(j) :: d_step { MAY(re, j) -> begin(re, 2, j); est = x; age = 0; end() }
#define HOME(j) \
  :: d_step { MAY(rs, j) -> begin(rs, 4, j); \
       if :: m -> skip :: !m -> c = (est > MID -> 0 : (est < MID -> 2 : 1)) fi; end() }
/* their windows are points: no later time is possible */
active proctype all() {
  do
  :: d_step { MAY(rp, 0) -> n = rp; begin(rp, 2, 0); if :: n > 0 -> x = x + c - 1 :: else fi; end() }
  ESTIMATOR(0) ESTIMATOR(1) ESTIMATOR(2) ESTIMATOR(3)
  :: d_step { MAY(ra, 0) && !m -> begin(ra, 2, 0); end() }
  :: d_step { MAY(ra, 0) && m -> begin(ra, 2, 0); c = 0; end() }
  :: d_step { MAY(ra, 0) && m -> begin(ra, 2, 0); c = 1; end() }
  :: d_step { MAY(ra, 0) && m -> begin(ra, 2, 0); c = 2; end() }
  HOME(0) HOME(1) HOME(2) HOME(3) HOME(4)
  :: d_step { MAY(rd, 0) -> begin(rd, 4, 0);
       m = (m -> age < OLD && est >= MID-2 && est <= MID+2 : age < OLD && est == MID); end() }
  od
}
