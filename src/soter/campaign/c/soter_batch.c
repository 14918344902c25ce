/* soter_batch.c: many runs in one call.
 *
 * Purpose: see soter_batch.h. What changed in an instant is found by comparing counters with those
 * of the state before it, which is kept beside.
 * Non-goals: threads: a caller gives each its own flights, states and events.
 */
#include "soter_batch.h"

#include <assert.h>
#include <string.h>

#include "soter_sha256.h"

typedef struct {
  soter_event* at;
  size_t room, used;
} soter_events;

static bool soter_note(soter_events* e, int64_t time, soter_event_kind kind, uint32_t index) {
  if (e->used == e->room) {
    return false;
  }
  e->at[e->used].time = time;
  e->at[e->used].kind = (uint32_t)kind;
  e->at[e->used].index = index;
  e->used++;
  return true;
}

/* Modes that are others than `before`, which follows. */
static bool soter_modes(const soter_program* p, void* state, void* before, soter_events* e) {
  const int64_t ct = soter_header_of(state)->ct;
  const soter_module* const m = soter_modules_of(p, state);
  soter_module* const n = soter_modules_of(p, before);
  bool fits = true;
  for (uint32_t i = 0; i < p->modules; i++) {
    if (m[i].mode != n[i].mode) {
      const soter_event_kind kind = m[i].mode == (uint8_t)SOTER_SC ? SOTER_TO_SC : SOTER_TO_AC;
      fits = soter_note(e, ct, kind, i) && fits;
      n[i].mode = m[i].mode;
    }
  }
  return fits;
}

/* Violations that `before` did not have; it follows. */
static bool soter_violations(const soter_program* p, void* state, void* before, soter_events* e) {
  const int64_t ct = soter_header_of(state)->ct;
  const soter_property* const q = soter_properties_of(p, state);
  soter_property* const r = soter_properties_of(p, before);
  bool fits = true;
  for (uint32_t i = 0; i < p->properties; i++) {
    if (q[i].count != r[i].count) {
      fits = soter_note(e, ct, SOTER_VIOLATED, i) && fits;
      r[i].count = q[i].count;
    }
  }
  const soter_component* const c = soter_components_of(state);
  soter_component* const d = soter_components_of(before);
  for (uint32_t i = 0; i < p->components; i++) {
    if (c[i].latched != d[i].latched) {
      fits = soter_note(e, ct, SOTER_LATCHED, i) && fits;
      d[i].latched = c[i].latched;
    }
  }
  return fits;
}

static bool soter_compare(const soter_program* p, void* state, void* before, soter_events* e) {
  const bool fits = soter_modes(p, state, before, e);
  soter_header* const h = soter_header_of(before);
  if (soter_header_of(state)->violations == h->violations) {
    return fits;
  }
  h->violations = soter_header_of(state)->violations;
  return soter_violations(p, state, before, e) && fits;
}

/* One flight; false where its events do not fit, or an extern is due. */
static bool soter_fly(const soter_program* p, uint64_t seed, int64_t until_ns, void* state,
                      void* before, soter_events* e) {
  uint32_t due = 0;
  soter_start(p, state, seed);
  (void)memcpy(before, state, p->state_size);
  while (soter_next_instant(p, state) <= until_ns) {
    if (soter_virtual_instant(p, state, &due) == SOTER_EXTERN_DUE) {
      return false;
    }
    if (!soter_compare(p, state, before, e)) {
      return false;
    }
  }
  return true;
}

uint32_t soter_batch(const soter_program* p, soter_flight* flights, uint32_t count,
                     int64_t until_ns, void* states, soter_event* events, size_t room,
                     size_t* used) {
  assert(p != NULL);
  assert(used != NULL);
  soter_events e = {events, room, 0};
  uint8_t* const before = (uint8_t*)states + (size_t)count * p->state_size;
  for (uint32_t k = 0; k < count; k++) {
    uint8_t* const state = (uint8_t*)states + (size_t)k * p->state_size;
    const size_t first = e.used;
    if (!soter_fly(p, flights[k].seed, until_ns, state, before, &e)) {
      *used = first;
      return k;
    }
    soter_sha256 s;
    soter_sha256_start(&s);
    soter_sha256_add(&s, events + first, (e.used - first) * sizeof *events);
    soter_sha256_add(&s, state, p->state_size);
    soter_sha256_end(&s, flights[k].digest);
    flights[k].events = (uint32_t)(e.used - first);
  }
  *used = e.used;
  return count;
}
