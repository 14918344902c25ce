/* alternating_bit.soter: one process, a nondeterministic choice over who is still due */
#ifndef H
#define H 100 /* ticks; releases at 0, 1, ..., H */
#endif
bit ps = 1, pw = 1, pr = 1, pb = 1; /* due */
unsigned t : 7;
bit odd; unsigned datum : 4; unsigned sent : 2;           /* of the sender */
bit seen; unsigned load : 4;                              /* what the wire has handed on */
bit reply; unsigned taken : 2; unsigned last : 4;         /* of the receiver */
bit heard;

inline next() {
  if
  :: !(ps | pw | pr | pb) ->
     assert(taken == sent || (taken + 1) % 4 == sent);
     if
     :: t < H -> t++; pw = 1; pb = 1; ps = !(t % 2); pr = !(t % 2)
     :: else
     fi
  :: else
  fi
}

#define SENDS(v) \
  :: d_step { ps && heard == odd -> ps = 0; odd = !odd; sent = (sent + 1) % 4; datum = v; next() }

active proctype all() {
  do
  SENDS(0) SENDS(1) SENDS(2) SENDS(3) SENDS(4) SENDS(5) SENDS(6) SENDS(7) SENDS(8) SENDS(9)
  :: d_step { ps && heard != odd -> ps = 0; next() }
  :: d_step { pw -> pw = 0; seen = odd; load = datum; next() }
  :: d_step { pw -> pw = 0; next() }
  :: d_step { pr -> pr = 0;
       if :: seen != reply -> reply = seen; taken = (taken + 1) % 4; last = load :: else fi;
       next() }
  :: d_step { pb -> pb = 0; heard = reply; next() }
  :: d_step { pb -> pb = 0; next() }
  od
}
