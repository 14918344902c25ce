/* two modules, a process each, everything local but the ticks: made for partial order reduction.
   A module that is done with tick k is in tick k+1 with everything due, and waits there. */
#define MID 9
#ifndef H
#define H 18 /* ticks; releases at 0, 1, ..., H */
#endif
unsigned t1 : 5; unsigned t2 : 5;

#define PLANT p -> p = 0; if :: w -> x = x + c - 1 :: else fi; assert(x > 0 && x < 18)
#define SC s -> s = 0; if :: m -> skip :: !m && x < MID -> c = 2 :: !m && x == MID -> c = 1 :: !m && x > MID -> c = 0 fi
#define DM d -> d = 0; m = (m -> (x >= MID-1 && x <= MID+1) : x == MID)
#define IDLE a && !m -> a = 0
#define AC0 a && m -> a = 0; c = 0
#define AC1 a && m -> a = 0; c = 1
#define AC2 a && m -> a = 0; c = 2
#define NEXT(mine) mine++; w = 1; p = 1; a = 1; s = !(mine % 2); d = !(mine % 3)
#define LEFT (p + a + s + d)

#define MODULE(name, mine, other) \
active proctype name() { \
  unsigned x : 5 = MID; unsigned c : 2 = 1; bit m; bit w; \
  bit p = 1; bit a = 1; bit s = 1; bit d = 1; \
first: \
  if \
  :: d_step { mine <= other && mine <= H && LEFT > 2 && PLANT }; goto mid \
  :: d_step { mine <= other && mine <= H && LEFT > 2 && SC }; goto mid \
  :: d_step { mine <= other && mine <= H && LEFT > 2 && DM }; goto mid \
  :: d_step { mine <= other && mine <= H && LEFT > 2 && IDLE }; goto mid \
  :: d_step { mine <= other && mine <= H && LEFT > 2 && AC0 }; goto mid \
  :: d_step { mine <= other && mine <= H && LEFT > 2 && AC1 }; goto mid \
  :: d_step { mine <= other && mine <= H && LEFT > 2 && AC2 }; goto mid \
  :: d_step { mine <= other && mine <= H && LEFT == 2 && PLANT }; goto last \
  :: d_step { mine <= other && mine <= H && LEFT == 2 && IDLE }; goto last \
  :: d_step { mine <= other && mine <= H && LEFT == 2 && AC0 }; goto last \
  :: d_step { mine <= other && mine <= H && LEFT == 2 && AC1 }; goto last \
  :: d_step { mine <= other && mine <= H && LEFT == 2 && AC2 }; goto last \
  fi; \
mid: \
  if \
  :: d_step { LEFT > 2 && PLANT }; goto mid \
  :: d_step { LEFT > 2 && SC }; goto mid \
  :: d_step { LEFT > 2 && DM }; goto mid \
  :: d_step { LEFT > 2 && IDLE }; goto mid \
  :: d_step { LEFT > 2 && AC0 }; goto mid \
  :: d_step { LEFT > 2 && AC1 }; goto mid \
  :: d_step { LEFT > 2 && AC2 }; goto mid \
  :: d_step { LEFT == 2 && PLANT }; goto last \
  :: d_step { LEFT == 2 && SC }; goto last \
  :: d_step { LEFT == 2 && DM }; goto last \
  :: d_step { LEFT == 2 && IDLE }; goto last \
  :: d_step { LEFT == 2 && AC0 }; goto last \
  :: d_step { LEFT == 2 && AC1 }; goto last \
  :: d_step { LEFT == 2 && AC2 }; goto last \
  fi; \
last: \
  if \
  :: d_step { PLANT; NEXT(mine) }; goto first \
  :: d_step { SC; NEXT(mine) }; goto first \
  :: d_step { DM; NEXT(mine) }; goto first \
  :: d_step { IDLE; NEXT(mine) }; goto first \
  :: d_step { AC0; NEXT(mine) }; goto first \
  :: d_step { AC1; NEXT(mine) }; goto first \
  :: d_step { AC2; NEXT(mine) }; goto first \
  fi \
}

MODULE(one, t1, t2)
MODULE(two, t2, t1)
