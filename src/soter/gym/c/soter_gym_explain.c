/* soter_gym_explain.c: could the program's plant have done that?
 *
 * Purpose: a step of a plant outside against one of the plant of the proof: disturbances within
 * their bounds are sought that lead where it went. Its step is asked where it leads without them
 * and with each of them; least squares within the bounds; the answer is tried, and again.
 * Non-goals: proofs that there are none: what was not found counts as not explained.
 */
#include <string.h>

#include "soter_gym.h"
#include "soter_gym_leaves.h"

enum { SOTER_ROUNDS = 4, SOTER_SWEEPS = 64 };

/* Where the plant goes from `origin` under the disturbances `chosen`; false where its step faults.
 */
static bool soter_lead(const soter_model* m, double* to) {
  uint32_t published = 0;
  if (!soter_put_all(&m->states, m->origin, m->state)) {
    return false;
  }
  (void)soter_put_all(&m->drawn, m->chosen, m->state);
  const soter_fault fault =
      m->program->component[0].step(m->state, SOTER_ENABLED, &published, NULL);
  soter_get_all(&m->states, m->state, to);
  return fault == SOTER_OK;
}

static double soter_allowed(const soter_model* m, uint32_t i, double to) {
  return m->tolerance[i] + m->relative * fabs(to);
}

/* What is left of `to` after `reached`; whether all of it is within the tolerances. */
static bool soter_left(const soter_model* m, const double* to, const double* reached) {
  bool fits = true;
  for (uint32_t i = 0; i < m->states.count; i++) {
    const bool compared = m->tolerance[i] <= DBL_MAX;
    m->residual[i] = compared ? to[i] - reached[i] : 0.0;
    fits = fits && fabs(m->residual[i]) <= soter_allowed(m, i, to[i]);
  }
  return fits;
}

/* Column j of `slopes`: how the step changes from one bound of disturbance j to the other. */
static void soter_slope(const soter_model* m, uint32_t j, double* reached, double* column) {
  const double kept = m->chosen[j];
  const double width = m->high[j] - m->low[j];
  m->chosen[j] = m->low[j];
  const bool low = soter_lead(m, reached);
  m->chosen[j] = m->high[j];
  const bool high = soter_lead(m, column);
  m->chosen[j] = kept;
  for (uint32_t i = 0; i < m->states.count; i++) {
    column[i] = low && high && width > 0.0 ? (column[i] - reached[i]) / width : 0.0;
  }
}

/* Moves disturbance j to where it leaves least, in squares of the tolerances. */
static void soter_relax(const soter_model* m, const double* to, const double* column, uint32_t j) {
  double along = 0.0;
  double square = 0.0;
  for (uint32_t i = 0; i < m->states.count; i++) {
    if (m->tolerance[i] <= DBL_MAX) {
      const double weight = 1.0 / soter_max(soter_allowed(m, i, to[i]), DBL_MIN);
      along += (column[i] * weight) * (m->residual[i] * weight);
      square += (column[i] * weight) * (column[i] * weight);
    }
  }
  if (!(square > 0.0) || !(square <= DBL_MAX) || !(along - along == 0.0)) {
    return;
  }
  const double wished = m->chosen[j] + along / square;
  const double next = soter_min(soter_max(wished, m->low[j]), m->high[j]);
  for (uint32_t i = 0; i < m->states.count; i++) {
    m->residual[i] -= column[i] * (next - m->chosen[j]);
  }
  m->chosen[j] = next;
}

/* Time and topics are those of the world. */
static void soter_borrow(const soter_model* m, void* world) {
  const size_t stamps = m->program->topics * sizeof(int64_t);
  soter_header_of(m->state)->ct = soter_header_of(world)->ct;
  (void)memcpy(soter_stamps_of(m->program, m->state), soter_stamps_of(m->world, world), stamps);
  (void)memcpy(m->state + m->topics_at, (uint8_t*)world + m->topics_from, m->topics_size);
}

bool soter_model_explains(const soter_model* m, const double* to, void* world) {
  SOTER_CHECK(m != NULL);
  const uint32_t n = m->states.count;
  double* const reached = m->work;
  double* const slopes = m->work + n;
  soter_borrow(m, world);
  for (uint32_t j = 0; j < m->drawn.count; j++) {
    m->chosen[j] = m->low[j] + (m->high[j] - m->low[j]) / 2.0;
  }
  bool fits = soter_lead(m, reached);
  fits = soter_left(m, to, reached) && fits;
  (void)memcpy(m->undisturbed, m->residual, n * sizeof *m->residual);
  for (uint32_t round = 0; round < (uint32_t)SOTER_ROUNDS && !fits; round++) {
    for (uint32_t j = 0; j < m->drawn.count; j++) {
      soter_slope(m, j, reached, slopes + (size_t)j * n);
    }
    for (uint32_t k = 0; k < (uint32_t)SOTER_SWEEPS * m->drawn.count; k++) {
      const uint32_t j = k % m->drawn.count;
      soter_relax(m, to, slopes + (size_t)j * n, j);
    }
    const bool led = soter_lead(m, reached);
    fits = soter_left(m, to, reached) && led;
  }
  return fits;
}

void soter_outside_judge(const soter_outside* o) {
  SOTER_CHECK(o->model != NULL);
  soter_get_all(&o->view->start, o->state, o->model->origin);
  const bool explained = soter_model_explains(o->model, o->states, o->state);
  o->model->explained = explained ? 1U : 0U;
  o->facts->off_model |= explained ? 0U : 1U;
}
