/* token_ring.soter: one process, a nondeterministic choice over who is still due */
#ifndef H
#define H 10 /* ticks; releases at 0, 1, ..., H */
#endif
bit p1=1, p2=1, p3=1, p4=1, p5=1, p6=1; /* due */
unsigned t : 4;
unsigned a : 3; unsigned b : 3; unsigned c : 3; unsigned d : 3; unsigned e : 3; unsigned f : 3;

inline next() {
  if
  :: !(p1|p2|p3|p4|p5|p6) ->
     assert(a == f || a != b || b != c || c != d || d != e || e != f);
     if
     :: t < H -> t++; p1 = 1; p2 = 1; p3 = 1; p4 = 1; p5 = 1; p6 = 1
     :: else
     fi
  :: else
  fi
}
inline begin(p, x, v) { p = 0; x = v; next() }
inline pass(p, x, y) { p = 0; x = y; next() }

#define BEGINS(p, x) \
  :: d_step { p && t == 0 -> begin(p, x, 0) } \
  :: d_step { p && t == 0 -> begin(p, x, 1) } \
  :: d_step { p && t == 0 -> begin(p, x, 2) } \
  :: d_step { p && t == 0 -> begin(p, x, 3) } \
  :: d_step { p && t == 0 -> begin(p, x, 4) }

active proctype all() {
  do
  :: d_step { p1 && t > 0 -> p1 = 0; if :: a == f -> a = (a == 4 -> 0 : a + 1) :: else fi; next() }
  :: d_step { p2 && t > 0 -> pass(p2, b, a) }
  :: d_step { p3 && t > 0 -> pass(p3, c, b) }
  :: d_step { p4 && t > 0 -> pass(p4, d, c) }
  :: d_step { p5 && t > 0 -> pass(p5, e, d) }
  :: d_step { p6 && t > 0 -> pass(p6, f, e) }
  BEGINS(p1, a)
  BEGINS(p2, b)
  BEGINS(p3, c)
  BEGINS(p4, d)
  BEGINS(p5, e)
  BEGINS(p6, f)
  od
}
