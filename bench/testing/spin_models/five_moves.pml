/* five_moves.soter: one process, a nondeterministic choice over what is still due */
#define MID 15
#ifndef H
#define H 9 /* ticks; releases at 0, 1, ..., H */
#endif
/* pending bits */
bit p1=1, a1=1, s1=1, d1=1, p2=1, a2=1, s2=1, d2=1;
unsigned t : 4 = 0;
unsigned x1 : 5 = MID; unsigned x2 : 5 = MID;
unsigned c1 : 3 = 2; unsigned c2 : 3 = 2;
bit m1, m2; /* 1: AC in control */

inline next() {
  if
  :: !(p1|a1|s1|d1|p2|a2|s2|d2) && t < H ->
     t++;
     p1 = 1; a1 = 1; p2 = 1; a2 = 1;
     s1 = !(t % 2); s2 = !(t % 2);
     d1 = !(t % 3); d2 = !(t % 3)
  :: else
  fi
}
inline plant(p, x, c) { p = 0; if :: t > 0 -> x = x + c - 2 :: else fi; assert(x > 0 && x < 30); next() }
inline sc(s, x, c, m) {
  s = 0;
  if
  :: m -> skip
  :: !m -> c = (x + 2 < MID -> 4 : (x > MID + 2 -> 0 : 2 + MID - x))
  fi;
  next()
}
inline dm(d, x, m) { d = 0; m = (m -> (x >= MID-1 && x <= MID+1) : x == MID); next() }
inline ac(a, c, v) { a = 0; c = v; next() }
inline idle(a) { a = 0; next() }

active proctype all() {
  do
  :: d_step { p1 -> plant(p1, x1, c1) }
  :: d_step { p2 -> plant(p2, x2, c2) }
  :: d_step { s1 -> sc(s1, x1, c1, m1) }
  :: d_step { s2 -> sc(s2, x2, c2, m2) }
  :: d_step { d1 -> dm(d1, x1, m1) }
  :: d_step { d2 -> dm(d2, x2, m2) }
  :: d_step { a1 && !m1 -> idle(a1) }
  :: d_step { a1 && m1 -> ac(a1, c1, 0) }
  :: d_step { a1 && m1 -> ac(a1, c1, 1) }
  :: d_step { a1 && m1 -> ac(a1, c1, 2) }
  :: d_step { a1 && m1 -> ac(a1, c1, 3) }
  :: d_step { a1 && m1 -> ac(a1, c1, 4) }
  :: d_step { a2 && !m2 -> idle(a2) }
  :: d_step { a2 && m2 -> ac(a2, c2, 0) }
  :: d_step { a2 && m2 -> ac(a2, c2, 1) }
  :: d_step { a2 && m2 -> ac(a2, c2, 2) }
  :: d_step { a2 && m2 -> ac(a2, c2, 3) }
  :: d_step { a2 && m2 -> ac(a2, c2, 4) }
  od
}
