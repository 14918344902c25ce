/* soter_faults.h: what goes wrong in a run, as the `faults` of its system say.
 *
 * Purpose: whether a fault is there at a time, when a release really happens, and what becomes of a
 * published value (docs/semantics.md, Faults). All of it follows from seed and time alone, so a
 * state that is copied and continued meets the same faults. Only programs with faults include it.
 * Non-goals: which faults there are (the generated file).
 */
#ifndef SOTER_FAULTS_H
#define SOTER_FAULTS_H

#include "soter.h"

typedef struct {
  uint64_t stream, at, by; /* FNV-1a of the stream's name, of name.at, of name.by */
  int64_t slot_ns;         /* 0: every release is a slot */
  double probability;      /* of a slot */
  bool apart;              /* never in two slots in a row */
} soter_chance;

#define SOTER_ON_TIME 4096 /* every so many releases one is on time, whatever happens */
#define SOTER_FINE 20      /* bits of the place between two quantiles of a lateness */

SOTER_INLINE int64_t soter_fault_offset(const soter_header* h, const soter_chance* f) {
  return (int64_t)(soter_bits(h, f->at, 0) % (uint64_t)f->slot_ns);
}

/* The slot that t lies in; where slots begin is drawn once. */
SOTER_INLINE int64_t soter_fault_slot(const soter_header* h, const soter_chance* f, int64_t t,
                                      int64_t period_ns) {
  return f->slot_ns == 0 ? t / period_ns : (t + soter_fault_offset(h, f)) / f->slot_ns;
}

SOTER_INLINE bool soter_fault_drawn(const soter_header* h, const soter_chance* f, int64_t slot) {
  return (double)(soter_bits(h, f->stream, slot) >> 11) * SOTER_ULP < f->probability;
}

/* Whether the fault is there at t. */
SOTER_INLINE bool soter_fault_active(const soter_header* h, const soter_chance* f, int64_t t,
                                     int64_t period_ns) {
  const int64_t slot = soter_fault_slot(h, f, t, period_ns);
  return soter_fault_drawn(h, f, slot) && (!f->apart || !soter_fault_drawn(h, f, slot - 1));
}

/* When what would happen at t does, where the component is held up then; else t. */
SOTER_INLINE int64_t soter_fault_held(const soter_header* h, const soter_chance* f, int64_t t,
                                      int64_t period_ns) {
  if (!soter_fault_active(h, f, t, period_ns)) {
    return t;
  }
  const int64_t slot = soter_fault_slot(h, f, t, period_ns);
  const int64_t begin = slot * f->slot_ns - soter_fault_offset(h, f);
  const int64_t end = begin + 1 + (int64_t)(soter_bits(h, f->by, slot) % (uint64_t)f->slot_ns);
  return end > t ? end : t;
}

/* How late a release is: between two of `count` quantiles, all stretches alike. */
SOTER_INLINE int64_t soter_fault_late(const soter_header* h, const soter_chance* f,
                                      const int64_t* quantile, uint32_t count, int64_t release) {
  const uint64_t places = (uint64_t)(count - 1U) << SOTER_FINE;
  const uint64_t place = soter_bits(h, f->by, release) % places;
  const uint64_t k = place >> SOTER_FINE;
  const uint64_t within = place & ((UINT64_C(1) << SOTER_FINE) - 1U);
  const uint64_t stretch = (uint64_t)(quantile[k + 1U] - quantile[k]);
  return quantile[k] + (int64_t)((stretch * within) >> SOTER_FINE);
}

SOTER_INLINE double soter_fault_by(const soter_header* h, const soter_chance* f, int64_t index,
                                   double most) {
  const double u = (double)(soter_bits(h, f->by, index) >> 11) * SOTER_ULP;
  return soter_min(-most + (most - -most) * u, most);
}

SOTER_INLINE bool soter_fault_high(const soter_header* h, const soter_chance* f, int64_t slot) {
  return soter_bits(h, f->by, slot) >> 63 != 0U;
}

#endif
