/* tank.soter: one process, a nondeterministic choice over who is still due; `shown` is one more */
#ifndef H
#define H 18 /* ticks; releases at 0, 1, ..., H */
#endif
bit pt = 1, pd = 1, ps = 1, pa = 1, pw = 1, pl = 1; /* due */
unsigned t : 5;
unsigned level : 5 = 15; unsigned shown : 6 = 16; unsigned inflow : 2; unsigned lamp : 2;
bit alarm;
bit m; /* 1: AC in control */

inline next() {
  if
  :: !(pt | pd | ps | pa | pw | pl) ->
     assert(level < 30);
     if
     :: t < H -> t++; pt = 1; pa = 1; pd = !(t % 2); ps = !(t % 2); pw = !(t % 2); pl = !(t % 3)
     :: else
     fi
  :: else
  fi
}

#define FLOWS(out, wrong) \
  :: d_step { pt -> pt = 0; \
       if :: t > 0 -> level = (level + inflow < out -> 0 : \
                               (level + inflow - out > 30 -> 30 : level + inflow - out)) \
          :: else fi; \
       shown = level + wrong; next() }

active proctype all() {
  do
  FLOWS(0, 0) FLOWS(0, 1) FLOWS(0, 2)
  FLOWS(1, 0) FLOWS(1, 1) FLOWS(1, 2)
  FLOWS(2, 0) FLOWS(2, 1) FLOWS(2, 2)
  :: d_step { pd -> pd = 0;
       m = (m -> shown >= 13 && shown <= 19 : shown > 14 && shown < 18); next() }
  :: d_step { ps -> ps = 0;
       if :: m -> skip :: !m -> inflow = (shown > 16 -> 0 : (shown < 16 -> 2 : 1)) fi; next() }
  :: d_step { pa && !m -> pa = 0; next() }
  :: d_step { pa && m -> pa = 0; inflow = 0; next() }
  :: d_step { pa && m -> pa = 0; inflow = 1; next() }
  :: d_step { pa && m -> pa = 0; inflow = 2; next() }
  :: d_step { pw -> pw = 0; alarm = (shown < 10 || shown > 22); next() }
  :: d_step { pl -> pl = 0; lamp = (alarm -> 2 : (inflow > 0 -> 1 : 0)); next() }
  od
}
