/* soter_batch.c: many runs in one call.
 *
 * Purpose: see soter_batch.h. What changed in an instant is found by comparing counters with those
 * of the state before it, which is kept beside.
 * Non-goals: threads: a caller gives each its own flights, states and events.
 */
#include "soter_batch.h"

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

/* Modes that are others than before, which follow. */
static bool soter_modes(const soter_program* p, int64_t ct, const soter_module* m, soter_module* n,
                        soter_events* e) {
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

/* ------------------------------------------------------------------ measures */

static uint32_t soter_bin(const soter_measure* m, double x) {
  if (x < m->low) {
    return 0U;
  }
  if (x > m->high) {
    return m->bins + 1U;
  }
  const double place = (x - m->low) / (m->high - m->low) * (double)m->bins;
  const uint32_t bin = place > 0.0 ? (uint32_t)place : 0U;
  return bin < m->bins ? bin + 1U : m->bins;
}

static void soter_note_look(const soter_measure* m, soter_look* look, uint32_t* bins, double x) {
  if (!(x - x == 0.0)) {
    return;
  }
  look->least = look->count == 0U || x < look->least ? x : look->least;
  look->most = look->count == 0U || x > look->most ? x : look->most;
  look->sum += x;
  look->count++;
  bins[soter_bin(m, x)]++;
}

/* Looks at what is due after an instant, and tells when the next look is due. */
static int64_t soter_measure_all(const soter_measured* all, const void* state, int64_t since,
                                 soter_look* looks, uint32_t* bins) {
  const int64_t ct = ((const soter_header*)state)->ct;
  int64_t next = INT64_MAX;
  for (uint32_t i = 0; i < all->count; i++) {
    const soter_measure* const m = &all->measure[i];
    const int64_t part = ct / m->every_ns;
    if (since < 0 || part != since / m->every_ns) {
      soter_note_look(m, &looks[i], bins, m->value(state));
    }
    next = (part + 1) * m->every_ns < next ? (part + 1) * m->every_ns : next;
    bins += m->bins + 2U;
  }
  return next;
}

/* ------------------------------------------------------------------ counterfactual saves */

/* Whether AC does harm within the horizon where this module's DM leaves it in control; `copy` is
 * the state before the instant in which the DM did not. */
static bool soter_would_harm(const soter_program* p, uint32_t module, int64_t horizon_ns,
                             void* copy) {
  soter_module_info modules[SOTER_BATCH_MODULES];
  soter_program alone = *p;
  uint32_t due = 0;
  (void)memcpy(modules, p->module, p->modules * sizeof *modules);
  modules[module].forced = true;
  alone.module = modules;
  const soter_header* const h = soter_header_of(copy);
  const uint32_t violations = h->violations;
  const int64_t end = soter_next_instant(&alone, copy) + horizon_ns;
  while (h->violations == violations && soter_next_instant(&alone, copy) <= end) {
    if (soter_virtual_instant(&alone, copy, &due) == SOTER_EXTERN_DUE) {
      return false;
    }
  }
  return h->violations != violations;
}

typedef struct {
  int64_t last[SOTER_BATCH_MODULES]; /* when each module was taken off AC last; or SOTER_NEVER */
  uint32_t *saves, *precautions;
} soter_saves;

/* Whether a DM decides at the time `next`, which is that of the next instant. */
static bool soter_decides(const soter_program* p, void* state, int64_t next) {
  const soter_component* const c = soter_components_of(state);
  for (uint32_t i = 0; i < p->modules; i++) {
    if (c[p->module[i].dm].next == next) {
      return true;
    }
  }
  return false;
}

/* Judges what an instant took off AC, from event number `first` on; `pre`: the state before it. */
static void soter_judge(const soter_program* p, const soter_order* o, const soter_events* e,
                        size_t first, const void* pre, void* work, soter_saves* s) {
  for (size_t i = first; i < e->used; i++) {
    const soter_event* const event = &e->at[i];
    if (event->kind != (uint32_t)SOTER_TO_SC) {
      continue;
    }
    const int64_t last = s->last[event->index];
    s->last[event->index] = event->time;
    if (last != SOTER_NEVER && event->time - last <= o->episode_ns) {
      continue;
    }
    (void)memcpy(work, pre, p->state_size);
    if (soter_would_harm(p, event->index, o->horizon_ns, work)) {
      s->saves[event->index]++;
    } else {
      s->precautions[event->index]++;
    }
  }
}

/* ------------------------------------------------------------------ flights */

typedef struct {
  uint8_t *state, *before, *pre, *work;
  size_t modules; /* where in a state they lie */
  soter_look* looks;
  uint32_t* bins;
  soter_saves* saves; /* NULL: they are not counted */
  soter_sha256* trajectory;
} soter_places;

/* A state, but for what every seed has of its own: copies of a flight have the same ones. */
static void soter_add_state(soter_sha256* s, const void* state, size_t size) {
  soter_header h = *(const soter_header*)state;
  h.seed = 0;
  h.seed_key = 0;
  soter_sha256_add(s, &h, sizeof h);
  soter_sha256_add(s, (const uint8_t*)state + sizeof h, size - sizeof h);
}

typedef struct {
  int64_t since;  /* the last time of which looks know */
  int64_t look;   /* when the next of them is due */
  int64_t sample; /* when the trajectory is looked at next */
} soter_due;

/* What an instant changed; `before` follows. */
static bool soter_compare(const soter_program* p, const soter_places* at, soter_events* e) {
  const soter_header* const h = (const soter_header*)at->state;
  soter_header* const before = (soter_header*)at->before;
  const bool fits = soter_modes(p, h->ct, (const soter_module*)(at->state + at->modules),
                                (soter_module*)(at->before + at->modules), e);
  if (h->violations == before->violations) {
    return fits;
  }
  before->violations = h->violations;
  return soter_violations(p, at->state, at->before, e) && fits;
}

/* What is noted after an instant, whose events begin at `first`; false where they do not fit. */
static bool soter_after(const soter_program* p, const soter_order* o, const soter_places* at,
                        soter_due* due, soter_events* e, size_t first) {
  const int64_t ct = ((const soter_header*)at->state)->ct;
  if (!soter_compare(p, at, e)) {
    return false;
  }
  if (ct >= due->look) {
    due->look = soter_measure_all(o->measured, at->state, due->since, at->looks, at->bins);
    due->since = ct;
  }
  if (ct >= due->sample) {
    const int64_t apart = o->until_ns / SOTER_SAMPLES + 1;
    soter_add_state(at->trajectory, at->state, p->state_size);
    due->sample = (ct / apart + 1) * apart;
  }
  if (at->saves != NULL && e->used != first) {
    soter_judge(p, o, e, first, at->pre, at->work, at->saves);
  }
  return true;
}

/* How far the next instant is from the one before, at most: somebody is released again by then. */
static int64_t soter_wait_most(const soter_program* p) {
  int64_t most = INT64_MAX;
  for (uint32_t i = 0; i < p->components; i++) {
    const soter_component_info* const info = &p->component[i];
    if (info->happens == NULL && info->phase_ns == 0 && info->period_ns < most) {
      most = info->period_ns;
    }
  }
  return most;
}

/* One flight; false where its events do not fit, or an extern is due. */
static bool soter_fly(const soter_program* p, uint64_t seed, const soter_order* o,
                      const soter_places* at, soter_events* e) {
  uint32_t due = 0;
  const int64_t wait = soter_wait_most(p);
  const soter_header* const h = (const soter_header*)at->state;
  soter_due noted = {.since = -1, .look = 0, .sample = 0};
  soter_start(p, at->state, seed);
  (void)memcpy(at->before, at->state, p->state_size);
  for (;;) {
    const size_t first = e->used;
    if (at->saves != NULL || wait > o->until_ns - h->ct) {
      const int64_t next = soter_next_instant(p, at->state);
      if (next > o->until_ns) {
        return true;
      }
      if (at->saves != NULL && soter_decides(p, at->state, next)) {
        (void)memcpy(at->pre, at->state, p->state_size);
      }
    }
    if (soter_virtual_instant(p, at->state, &due) == SOTER_EXTERN_DUE ||
        !soter_after(p, o, at, &noted, e, first)) {
      return false;
    }
  }
}

static size_t soter_bins(const soter_measured* all) {
  size_t found = 0;
  for (uint32_t i = 0; i < all->count; i++) {
    found += all->measure[i].bins + 2U;
  }
  return found;
}

static void soter_flown(const soter_program* p, soter_flight* flight, const soter_event* events,
                        size_t count, const void* state, soter_sha256* trajectory) {
  soter_sha256 s;
  soter_sha256_start(&s);
  soter_sha256_add(&s, events, count * sizeof *events);
  soter_sha256_add(&s, state, p->state_size);
  soter_sha256_end(&s, flight->digest);
  soter_add_state(trajectory, state, p->state_size);
  soter_sha256_add(trajectory, events, count * sizeof *events);
  soter_sha256_end(trajectory, flight->trajectory);
  flight->events = (uint32_t)count;
}

/* Where flight number k writes; `saves` and `trajectory` are its own. */
static soter_places soter_places_of(const soter_program* p, const soter_order* o, uint32_t count,
                                    uint32_t k, soter_saves* saves, soter_sha256* trajectory) {
  uint8_t* const states = (uint8_t*)o->states;
  uint8_t* const spare = states + (size_t)count * p->state_size;
  soter_sha256_start(trajectory);
  for (uint32_t i = 0; i < SOTER_BATCH_MODULES; i++) {
    saves->last[i] = SOTER_NEVER;
  }
  saves->saves = o->saves + (size_t)k * p->modules;
  saves->precautions = o->precautions + (size_t)k * p->modules;
  const soter_places at = {
      .state = states + (size_t)k * p->state_size,
      .before = spare + p->state_size,
      .pre = spare + 2U * p->state_size,
      .work = spare,
      .modules = (size_t)((const uint8_t*)soter_modules_of(p, states) - states),
      .looks = o->looks + (size_t)k * o->measured->count,
      .bins = o->histogram + (size_t)k * soter_bins(o->measured),
      .saves = o->horizon_ns > 0 ? saves : NULL,
      .trajectory = trajectory,
  };
  return at;
}

uint32_t soter_batch(const soter_program* p, soter_flight* flights, uint32_t count,
                     const soter_order* order, size_t* used) {
  SOTER_CHECK(p != NULL);
  SOTER_CHECK(order != NULL);
  SOTER_CHECK(used != NULL);
  SOTER_CHECK(order->horizon_ns == 0 || p->modules <= SOTER_BATCH_MODULES);
  soter_events e = {order->events, order->room, 0};
  for (uint32_t k = 0; k < count; k++) {
    const size_t first = e.used;
    soter_saves saves;
    soter_sha256 trajectory;
    const soter_places at = soter_places_of(p, order, count, k, &saves, &trajectory);
    if (!soter_fly(p, flights[k].seed, order, &at, &e)) {
      *used = first;
      return k;
    }
    soter_flown(p, &flights[k], order->events + first, e.used - first, at.state, &trajectory);
  }
  *used = e.used;
  return count;
}
