/* soter_kernel.c: the four rules of the operational semantics over a program's tables.
 *
 * Purpose: time progress, DM steps, AC-or-SC steps with the gate, plants, properties, contracts.
 * Non-goals: clocks, threads, draws of inputs, input and output; those are drivers'.
 */
#include "soter.h"

#include <string.h>

soter_header* soter_header_of(void* state) {
  return (soter_header*)state;
}

soter_component* soter_components_of(void* state) {
  return (soter_component*)((soter_header*)state + 1);
}

soter_module* soter_modules_of(const soter_program* p, void* state) {
  return (soter_module*)(soter_components_of(state) + p->components);
}

soter_property* soter_properties_of(const soter_program* p, void* state) {
  return (soter_property*)(soter_modules_of(p, state) + p->modules);
}

int64_t* soter_stamps_of(const soter_program* p, void* state) {
  return (int64_t*)(soter_properties_of(p, state) + p->properties);
}

/* ------------------------------------------------------------------ start */

/* OE of the controllers of a module. */
static void give_control(const soter_program* p, void* state, uint32_t module) {
  soter_component* const c = soter_components_of(state);
  const soter_module_info* const info = &p->module[module];
  const soter_mode mode = (soter_mode)soter_modules_of(p, state)[module].mode;
  c[info->sc].oe = mode == SOTER_SC;
  c[info->ac].oe = mode == SOTER_AC;
}

/* The first release of a component after ct, from number `release` on. */
static int64_t release_after(const soter_program* p, const void* state, uint32_t component,
                             int64_t release) {
  const soter_component_info* const info = &p->component[component];
  const int64_t ct = ((const soter_header*)state)->ct;
  int64_t t = info->happens(state, release);
  while (t == SOTER_NEVER || t <= ct) { /* now and then one is on time whatever happens */
    release++;
    t = info->happens(state, release);
  }
  return t;
}

void soter_start(const soter_program* p, void* state, uint64_t seed) {
  soter_start_with(p, state, seed, NULL);
}

void soter_start_with(const soter_program* p, void* state, uint64_t seed, const void* answer) {
  SOTER_CHECK(p != NULL);
  SOTER_CHECK(state != NULL);
  (void)memset(state, 0, p->state_size);
  soter_header* const h = soter_header_of(state);
  h->ct = -1;
  h->seed = seed;
  h->seed_key = soter_mix(seed + UINT64_C(0x9e3779b97f4a7c15));
  soter_component* const c = soter_components_of(state);
  for (uint32_t i = 0; i < p->components; i++) {
    const soter_component_info* const info = &p->component[i];
    c[i].next = info->happens != NULL ? release_after(p, state, i, 0) : info->phase_ns;
    c[i].oe = 1;
  }
  soter_module* const m = soter_modules_of(p, state);
  for (uint32_t i = 0; i < p->modules; i++) {
    m[i].mode = (uint8_t)p->module[i].start;
    give_control(p, state, i);
  }
  soter_property* const q = soter_properties_of(p, state);
  for (uint32_t i = 0; i < p->properties; i++) {
    q[i].first_ns = SOTER_NEVER;
  }
  int64_t* const stamps = soter_stamps_of(p, state);
  for (uint32_t i = 0; i < p->topics; i++) {
    stamps[i] = SOTER_NEVER;
  }
  p->init(state, answer);
}

/* ------------------------------------------------------------------ Discrete-Time-Progress-Step */

/* When the step of a component ends that lasts; SOTER_NEVER: none does. */
static int64_t effect_of(const soter_program* p, const void* state, uint32_t component) {
  const soter_component* const c = (const soter_component*)((const soter_header*)state + 1);
  const soter_module* const m = (const soter_module*)(c + p->components);
  const soter_property* const q = (const soter_property*)(m + p->modules);
  const int64_t* const stamps = (const int64_t*)(q + p->properties);
  const soter_component_info* const info = &p->component[component];
  return info->effect != NULL ? stamps[info->held] : SOTER_NEVER;
}

int64_t soter_next_instant(const soter_program* p, const void* state) {
  SOTER_CHECK(p != NULL);
  const soter_header* const h = (const soter_header*)state;
  const soter_component* const c = (const soter_component*)(h + 1);
  int64_t next = INT64_MAX;
  for (uint32_t i = 0; i < p->components; i++) {
    next = c[i].next < next ? c[i].next : next;
    if (p->component[i].effect != NULL) {
      const int64_t effect = effect_of(p, state, i);
      next = effect != SOTER_NEVER && effect < next ? effect : next;
    }
  }
  for (uint32_t i = 0; i < p->inputs; i++) {
    const int64_t every = p->input[i].every_ns;
    const int64_t due = h->ct < 0 ? 0 : (h->ct / every + 1) * every;
    if (due < next) {
      next = due;
    }
  }
  return next;
}

/* The release after the one at ct. */
static int64_t following(const soter_program* p, const void* state, uint32_t component) {
  const soter_component_info* const info = &p->component[component];
  const int64_t ct = ((const soter_header*)state)->ct;
  if (info->happens == NULL) {
    return ct + info->period_ns;
  }
  return release_after(p, state, component, (ct - info->phase_ns) / info->period_ns);
}

void soter_progress(const soter_program* p, void* state) {
  SOTER_CHECK(p != NULL);
  soter_header* const h = soter_header_of(state);
  soter_component* const c = soter_components_of(state);
  SOTER_CHECK(h->firing == 0U);                  /* dt1: FN is empty */
  h->ct = soter_next_instant(p, state);          /* dt2 */
  for (uint32_t i = 0; i < p->components; i++) { /* dt3 */
    const bool released = c[i].next == h->ct;
    const int64_t effect = effect_of(p, state, i);
    if (effect == h->ct || (released && effect < h->ct)) { /* busy: a release is lost */
      c[i].pending = 1;
    }
    if (released) {
      c[i].next = following(p, state, i);
    }
  }
  h->firing = 1U;
}

/* ------------------------------------------------------------------ Environment-Input */

soter_fault soter_publish(const soter_program* p, void* state, uint32_t topic, const void* given,
                          int64_t time) {
  SOTER_CHECK(p != NULL);
  SOTER_CHECK(given != NULL);
  if (topic >= p->topics || p->topic[topic].publish == NULL) {
    return SOTER_EXTERN_FAULT;
  }
  const soter_header* const h = soter_header_of(state);
  const int64_t latest = h->firing != 0U ? h->ct : soter_next_instant(p, state);
  if (time < soter_stamps_of(p, state)[topic] || time > latest) {
    return SOTER_EXTERN_FAULT;
  }
  return p->topic[topic].publish(state, given, time);
}

/* ------------------------------------------------------------------ DM-Step */

bool soter_acknowledged(int8_t* latch, int64_t* since, bool pressed, int64_t stamp, int64_t ct,
                        int64_t max_age) {
  SOTER_CHECK(latch != NULL);
  SOTER_CHECK(since != NULL);
  if (*since == SOTER_NEVER) { /* the first look of this start: only what comes after it counts */
    *since = ct;
  }
  if (*latch == (int8_t)SOTER_LATCH_ACKNOWLEDGED && ct - *since > max_age) {
    *latch = (int8_t)SOTER_LATCH_WAITS;
  }
  const soter_latch before = pressed ? SOTER_LATCH_READY : SOTER_LATCH_WAITS;
  if (stamp > *since && *latch == (int8_t)before) { /* what it waits for */
    const soter_latch press = ct - stamp <= max_age ? SOTER_LATCH_ACKNOWLEDGED : SOTER_LATCH_WAITS;
    *latch = (int8_t)(pressed ? press : SOTER_LATCH_READY);
    *since = stamp;
  }
  return *latch == (int8_t)SOTER_LATCH_ACKNOWLEDGED;
}

static void dm_step(const soter_program* p, void* state, uint32_t module) {
  const soter_module_info* const info = &p->module[module];
  const soter_header* const h = soter_header_of(state);
  soter_module* const m = soter_modules_of(p, state) + module;
  m->saw_gate_fault = m->gate_fault;
  const soter_mode decided = info->decide(state);
  m->gate_fault = 0;
  if (info->forced || decided == (soter_mode)m->mode) {
    return;
  }
  if (decided == SOTER_AC) {
    m->to_ac++;
  } else {
    m->to_sc++;
    m->ac_ns += h->ct - m->mode_since;
  }
  m->mode = (uint8_t)decided;
  m->mode_since = h->ct;
  give_control(p, state, module); /* dm1, dm2 */
}

/* ------------------------------------------------------------------ AC-or-SC-Step and plants */

static void publish_failsafe(const soter_component_info* info, const soter_component* c,
                             void* state) {
  if (c->oe != 0U && info->failsafe != NULL) {
    info->failsafe(state);
  }
}

static void ac_fault(const soter_program* p, void* state, uint32_t index) {
  const soter_component_info* const info = &p->component[index];
  soter_module* const m = soter_modules_of(p, state) + info->module;
  m->gate_faults++;
  m->clean_needed = p->module[info->module].clean;
  if (soter_components_of(state)[index].oe != 0U) {
    m->gate_fault = 1;
  }
}

static void after_step(const soter_program* p, void* state, uint32_t index, soter_fault fault,
                       uint32_t published) {
  const soter_component_info* const info = &p->component[index];
  soter_component* const c = soter_components_of(state) + index;
  if (fault != SOTER_OK) {
    c->faults++;
    c->last_fault = (uint8_t)fault;
    if (info->role == SOTER_ROLE_AC) {
      ac_fault(p, state, index);
    } else {
      c->latched = 1;
      soter_header_of(state)->violations++;
      publish_failsafe(info, c, state);
    }
    return;
  }
  if (info->role != SOTER_ROLE_PLANT) {
    c->had_control = c->oe;
  }
  if (info->role == SOTER_ROLE_AC && published == info->outputs) {
    soter_module* const m = soter_modules_of(p, state) + info->module;
    m->clean_needed -= m->clean_needed > 0U ? 1U : 0U;
  }
}

static uint32_t flags_of(const soter_program* p, void* state, uint32_t index) {
  const soter_component* const c = soter_components_of(state) + index;
  uint32_t flags = c->oe != 0U ? SOTER_ENABLED : 0U;
  if (c->oe != 0U && c->had_control == 0U) {
    flags |= SOTER_TAKEOVER;
  }
  if (soter_header_of(state)->ct == p->component[index].phase_ns) {
    flags |= SOTER_FIRST;
  }
  return flags;
}

static void note_property(const soter_program* p, void* state, uint32_t index, bool violated) {
  soter_header* const h = soter_header_of(state);
  soter_property* const q = soter_properties_of(p, state) + index;
  if (violated && q->active == 0U) {
    q->count++;
    h->violations++;
    if (q->first_ns == SOTER_NEVER) {
      q->first_ns = h->ct;
    }
  }
  q->active = violated ? 1U : 0U;
}

/* The contracts of a component that are due now; whether all of them hold. */
static bool contracts_hold(const soter_program* p, void* state, uint32_t component,
                           soter_when when) {
  bool hold = true;
  if (!p->component[component].judged) {
    return hold;
  }
  for (uint32_t i = 0; i < p->properties; i++) {
    const soter_property_info* const info = &p->property[i];
    if (info->when == when && info->component == component) {
      const bool violated = info->violated(state);
      note_property(p, state, i, violated);
      hold = hold && !violated;
    }
  }
  return hold;
}

/* Contracts are judged as if what a step publishes counted at once. */
static void judge_guarantees(const soter_program* p, void* state, uint32_t index) {
  const soter_component_info* const info = &p->component[index];
  if (info->exchange != NULL) {
    info->exchange(state);
  }
  (void)contracts_hold(p, state, index, SOTER_AFTER_STEP);
  if (info->exchange != NULL) {
    info->exchange(state);
  }
}

/* A step that has begun lasts until a time that is drawn, whatever became of it. */
static void last(const soter_program* p, void* state, uint32_t index) {
  const soter_component_info* const info = &p->component[index];
  const soter_header* const h = soter_header_of(state);
  if (info->effect == NULL) {
    return;
  }
  const int64_t release = (h->ct - info->phase_ns) / info->period_ns;
  int64_t took = soter_draw_int(h, info->stream, release, info->least_ns, info->most_ns);
  if (info->overrun != NULL) {
    took += info->overrun(state);
  }
  soter_stamps_of(p, state)[info->held] = h->ct + took;
  if (took == 0) {
    info->effect(state);
  }
}

static uint32_t run_step(const soter_program* p, void* state, uint32_t index, const void* answer) {
  uint32_t published = 0U;
  const bool assumed = contracts_hold(p, state, index, SOTER_BEFORE_STEP);
  const uint32_t flags = flags_of(p, state, index);
  const soter_fault fault = p->component[index].step(state, flags, &published, answer);
  after_step(p, state, index, fault, published);
  last(p, state, index);
  if (fault != SOTER_OK) {
    return 0U;
  }
  if (assumed && soter_components_of(state)[index].oe != 0U) {
    judge_guarantees(p, state, index);
  }
  return published;
}

void soter_answer(const soter_program* p, void* state, uint32_t component, soter_fault fault,
                  const void* answer) {
  SOTER_CHECK(component < p->components);
  soter_component* const c = soter_components_of(state) + component;
  SOTER_CHECK(c->pending != 0U);
  c->pending = 0;
  if (fault == SOTER_OK && answer != NULL) {
    (void)run_step(p, state, component, answer);
  } else {
    (void)contracts_hold(p, state, component, SOTER_BEFORE_STEP);
    after_step(p, state, component, fault == SOTER_OK ? SOTER_EXTERN_FAULT : fault, 0U);
    last(p, state, component);
  }
}

/* ------------------------------------------------------------------ properties */

static void check_properties(const soter_program* p, void* state) {
  for (uint32_t i = 0; i < p->properties; i++) {
    if (p->property[i].when == SOTER_AT_INSTANT) {
      note_property(p, state, i, p->property[i].violated(state));
    }
  }
}

/* ------------------------------------------------------------------ one instant */

/* An extern plant's first release only publishes: nobody needs to be asked. */
static bool needs_driver(const soter_program* p, void* state, uint32_t index) {
  const soter_component_info* const info = &p->component[index];
  if (!info->is_extern) {
    return false;
  }
  const bool first = (flags_of(p, state, index) & SOTER_FIRST) != 0U;
  return info->role != SOTER_ROLE_PLANT || !first;
}

/* What a component holds and is due now counts; false where there is no step besides. */
static bool take_effect(const soter_program* p, void* state, uint32_t index) {
  const soter_component_info* const info = &p->component[index];
  const int64_t ct = soter_header_of(state)->ct;
  if (effect_of(p, state, index) != ct) {
    return true;
  }
  info->effect(state);
  const int64_t since = ct - info->phase_ns; /* who holds something has been released before */
  if (info->happens != NULL) {
    return info->happens(state, since / info->period_ns) == ct;
  }
  return since % info->period_ns == 0;
}

uint32_t soter_fire(const soter_program* p, void* state, uint32_t component, const void* answer) {
  SOTER_CHECK(component < p->components);
  soter_component* const c = soter_components_of(state) + component;
  const soter_component_info* const info = &p->component[component];
  c->pending = 0;
  if (!take_effect(p, state, component)) {
    return 0U;
  }
  if (c->latched != 0U) {
    publish_failsafe(info, c, state);
  } else if (info->role == SOTER_ROLE_DM) {
    dm_step(p, state, (uint32_t)info->module);
  } else {
    return run_step(p, state, component, answer);
  }
  return 0U;
}

/* Who steps next: the first that waits, from `from` on where nobody before it can; else, of nodes,
 * whoever chance says. */
static uint32_t next_of(const soter_program* p, void* state, uint32_t from) {
  const soter_component* const c = soter_components_of(state);
  uint32_t i = p->order == NULL ? from : 0U;
  while (i < p->components && c[i].pending == 0U) {
    i++;
  }
  if (p->order == NULL || i == p->components || p->component[i].role == SOTER_ROLE_PLANT) {
    return i;
  }
  uint32_t waiting = 0;
  for (uint32_t k = i; k < p->components; k++) {
    waiting += c[k].pending;
  }
  for (uint32_t left = p->order(state, waiting); left > 0U; left--) {
    do {
      i++;
    } while (c[i].pending == 0U);
  }
  return i;
}

soter_status soter_instant(const soter_program* p, void* state, uint32_t* due) {
  SOTER_CHECK(p != NULL);
  SOTER_CHECK(due != NULL);
  soter_header* const h = soter_header_of(state);
  soter_component* const c = soter_components_of(state);
  if (h->firing == 0U) {
    soter_progress(p, state);
  }
  for (uint32_t i = next_of(p, state, 0); i < p->components; i = next_of(p, state, i)) {
    if (!take_effect(p, state, i)) {
      c[i].pending = 0;
      continue;
    }
    if (c[i].latched == 0U && needs_driver(p, state, i)) {
      *due = i;
      return SOTER_EXTERN_DUE;
    }
    (void)soter_fire(p, state, i, NULL);
  }
  h->firing = 0U;
  check_properties(p, state);
  return SOTER_INSTANT_DONE;
}
