/* soter_explore_replay.c: the execution that a trace says. */
#include "soter_explore_in.h"

static bool same_move(const soter_move* a, const soter_trace_step* b) {
  return a->kind == (soter_move_kind)b->kind && a->time == b->time_ns &&
         a->release == b->release_ns;
}

static bool find(soter_place* x, const soter_trace_step* step, soter_move* move) {
  if (step->actor >= x->m->actors) {
    return false;
  }
  for (uint32_t n = 0; soter_move_of(x, step->actor, n, move); n++) {
    if (same_move(move, step)) {
      return true;
    }
  }
  return false;
}

static void give(soter_place* x, const soter_trace_step* step) {
  x->given = step->choices < SOTER_CHOICES ? step->choices : SOTER_CHOICES;
  (void)memcpy(x->choice, step->choice, x->given * sizeof step->choice[0]);
}

static bool in_range(const soter_place* x, const soter_trace_step* step) {
  for (uint32_t i = 0; i < step->choices && i < x->taken; i++) {
    if (step->choice[i].pick >= x->choice[i].count) {
      return false;
    }
  }
  return step->choices == x->taken;
}

uint32_t soter_explore_replay(const soter_model* m, uint64_t seed, const soter_trace_step* trace,
                              uint32_t length, void* worlds, bool* violates, soter_broken* broken) {
  soter_place x;
  uint32_t done = 0U;
  *violates = false;
  if (!soter_place_open(&x, m, seed, NULL)) {
    return 0U;
  }
  while (done < length && !*violates) {
    const soter_trace_step* const step = &trace[done];
    give(&x, step);
    bool fine = true;
    if (step->kind == (uint32_t)SOTER_BIRTH) {
      if (done > 0U) {
        break;
      }
      soter_be_born(&x);
    } else {
      soter_move move;
      soter_look(&x);
      if (!find(&x, step, &move)) {
        break;
      }
      fine = soter_make(&x, &move, broken);
    }
    if (!in_range(&x, step)) {
      break;
    }
    *violates = !fine || soter_violates(&x, broken);
    if (worlds != NULL) {
      (void)memcpy((uint8_t*)worlds + (size_t)done * x.size, x.there, x.size);
    }
    (void)memcpy(x.here, x.there, x.size);
    done++;
  }
  soter_place_close(&x);
  return done;
}
