/* soter_lockstep.c: see soter_lockstep.h.
 *
 * What a step is, and what becomes of one that faults, is the kernel's (soter_fire). Here is
 * only what it does around a step that went well, for steps of all worlds at once.
 */
#include "soter_lockstep.h"

bool soter_lockstep_fits(const soter_program* p, const soter_lane_table* lanes) {
  if (lanes->count == 0U || lanes->count > SOTER_LOCKSTEP_WORLDS || p->order != NULL ||
      p->components > SOTER_LOCKSTEP_COMPONENTS) {
    return false;
  }
  for (uint32_t i = 0; i < p->components; i++) {
    if (p->component[i].effect != NULL || p->component[i].is_extern) {
      return false;
    }
  }
  return true;
}

void soter_lockstep_start(soter_lockstep* g, const soter_program* p, const soter_lane_table* lanes,
                          void* const* states) {
  g->p = p;
  g->lanes = lanes;
  g->worlds = lanes->count;
  g->moves = 0;
  for (uint32_t w = 0; w < g->worlds; w++) {
    g->state[w] = states[w];
    g->component[w] = soter_components_of(states[w]);
    g->module[w] = soter_modules_of(p, states[w]);
    g->property[w] = soter_properties_of(p, states[w]);
  }
  for (uint32_t i = 0; i < p->components; i++) {
    g->next[i] = p->component[i].phase_ns;
    g->pause[i] = 0;
    g->alone[i] = 0;
    g->is_moved[i] = p->component[i].happens != NULL;
    if (g->is_moved[i]) {
      g->next[i] = INT64_MAX;
      g->moved[g->moves] = i;
      g->moves++;
    }
  }
}

int64_t soter_lockstep_next(const soter_lockstep* g) {
  const int64_t ct = ((const soter_header*)g->state[0])->ct;
  int64_t next = INT64_MAX;
  for (uint32_t i = 0; i < g->p->components; i++) {
    next = g->next[i] < next ? g->next[i] : next;
  }
  for (uint32_t i = 0; i < g->p->inputs; i++) {
    const int64_t every = g->p->input[i].every_ns;
    const int64_t due = ct < 0 ? 0 : (ct / every + 1) * every;
    next = due < next ? due : next;
  }
  return next;
}

int64_t soter_lockstep_alone(const soter_lockstep* g, uint32_t world) {
  const soter_component* const c = g->component[world];
  int64_t next = INT64_MAX;
  for (uint32_t k = 0; k < g->moves; k++) {
    next = c[g->moved[k]].next < next ? c[g->moved[k]].next : next;
  }
  return next;
}

/* Time moves on in one world; who is moved there is released. */
static void soter_move(const soter_lockstep* g, uint32_t world, int64_t ct) {
  const soter_program* const p = g->p;
  void* const state = g->state[world];
  soter_component* const c = g->component[world];
  ((soter_header*)state)->ct = ct;
  for (uint32_t k = 0; k < g->moves; k++) {
    const uint32_t i = g->moved[k];
    const soter_component_info* const info = &p->component[i];
    if (c[i].next == ct) {
      int64_t release = (ct - info->phase_ns) / info->period_ns;
      int64_t t = info->happens(state, release);
      while (t == SOTER_NEVER || t <= ct) {
        release++;
        t = info->happens(state, release);
      }
      c[i].pending = 1;
      c[i].next = t;
    }
  }
  for (uint32_t i = 0; i < p->inputs; i++) {
    if (ct % p->input[i].every_ns == 0) {
      p->input[i].draw(state, NULL);
    }
  }
}

/* A DM of all worlds at once; false where it is one for each of them alone. */
static bool soter_decide_all(const soter_lockstep* g, uint32_t index) {
  const uint32_t module = (uint32_t)g->p->component[index].module;
  const soter_lane_decision* const dm = &g->lanes->decide[module];
  const void* const* const states = (const void* const*)g->state;
  bool ttf[SOTER_LOCKSTEP_WORLDS];
  bool safer[SOTER_LOCKSTEP_WORLDS];
  if (dm->ttf == NULL || dm->safer == NULL || !dm->ttf(states, ttf) || !dm->safer(states, safer)) {
    return false;
  }
  for (uint32_t w = 0; w < g->worlds; w++) {
    soter_module* const m = &g->module[w][module];
    const soter_mode decided = dm->decided(g->state[w], ttf[w], safer[w]);
    if (decided != (soter_mode)m->mode && !g->p->module[module].forced) {
      (void)soter_fire(g->p, g->state[w], index, NULL); /* who switches, decides once more */
    } else {
      m->saw_gate_fault = m->gate_fault;
      m->gate_fault = 0;
    }
  }
  return true;
}

/* Whether a step is one for all worlds at once, and the flags of each. */
static bool soter_steps_together(const soter_lockstep* g, uint32_t index, int64_t ct,
                                 uint32_t* flags) {
  const soter_component_info* const info = &g->p->component[index];
  if (g->lanes->step[index] == NULL || ct == info->phase_ns) {
    return false;
  }
  for (uint32_t w = 0; w < g->worlds; w++) {
    const soter_component* const c = &g->component[w][index];
    const bool taken_over = c->oe != 0U && c->had_control == 0U;
    if (c->latched != 0U || (taken_over && info->role != SOTER_ROLE_PLANT)) {
      return false;
    }
    flags[w] = c->oe != 0U ? SOTER_ENABLED : 0U;
  }
  return true;
}

/* What the kernel does after a step that went well, in one world. */
static void soter_stepped(const soter_lockstep* g, uint32_t world, uint32_t index,
                          uint32_t published) {
  const soter_component_info* const info = &g->p->component[index];
  soter_component* const c = &g->component[world][index];
  if (info->role == SOTER_ROLE_PLANT) {
    return;
  }
  c->had_control = c->oe;
  if (info->role == SOTER_ROLE_AC && published == info->outputs) {
    soter_module* const m = &g->module[world][info->module];
    m->clean_needed -= m->clean_needed > 0U ? 1U : 0U;
  }
}

static void soter_note_violation(const soter_lockstep* g, uint32_t world, uint32_t index,
                                 bool violated) {
  soter_header* const h = (soter_header*)g->state[world];
  soter_property* const q = &g->property[world][index];
  if (violated && q->active == 0U) {
    q->count++;
    h->violations++;
    q->first_ns = q->first_ns == SOTER_NEVER ? h->ct : q->first_ns;
  }
  q->active = violated ? 1U : 0U;
}

/* The properties that are due now, those of a component or of the instant, in the worlds of
 * `where`; in which of them all hold. */
static void soter_judge_all(const soter_lockstep* g, soter_when when, uint32_t component,
                            const bool* where, bool* hold) {
  for (uint32_t i = 0; i < g->p->properties; i++) {
    const soter_property_info* const info = &g->p->property[i];
    bool violated[SOTER_LOCKSTEP_WORLDS];
    if (info->when != when || (when != SOTER_AT_INSTANT && info->component != component)) {
      continue;
    }
    const soter_lane_verdict all = g->lanes->violated[i];
    const bool known = all != NULL && all((const void* const*)g->state, violated);
    for (uint32_t w = 0; w < g->worlds; w++) {
      if (where[w]) {
        const bool bad = known ? violated[w] : info->violated(g->state[w]);
        soter_note_violation(g, w, i, bad);
        hold[w] = hold[w] && !bad;
      }
    }
  }
}

/* ------------------------------------------------------------------ steps */

/* A step of all worlds at once; false where it is one for each of them alone: what it assumes is
 * judged again then, to no effect. */
static bool soter_step_all(const soter_lockstep* g, uint32_t index, int64_t ct) {
  const soter_component_info* const info = &g->p->component[index];
  uint32_t flags[SOTER_LOCKSTEP_WORLDS];
  uint32_t published[SOTER_LOCKSTEP_WORLDS];
  bool where[SOTER_LOCKSTEP_WORLDS];
  bool hold[SOTER_LOCKSTEP_WORLDS];
  if (info->role == SOTER_ROLE_DM) {
    return soter_decide_all(g, index);
  }
  if (!soter_steps_together(g, index, ct, flags)) {
    return false;
  }
  for (uint32_t w = 0; w < g->worlds; w++) {
    where[w] = hold[w] = true;
  }
  if (info->judged) {
    soter_judge_all(g, SOTER_BEFORE_STEP, index, where, hold);
  }
  if (!g->lanes->step[index](g->state, flags, published)) {
    return false;
  }
  for (uint32_t w = 0; w < g->worlds; w++) {
    soter_stepped(g, w, index, published[w]);
    where[w] = hold[w] && g->component[w][index].oe != 0U;
  }
  if (info->judged) {
    soter_judge_all(g, SOTER_AFTER_STEP, index, where, hold);
  }
  return true;
}

/* The same; who could not for some releases on end is not tried at the next ones. */
static bool soter_try_all(soter_lockstep* g, uint32_t index, int64_t ct) {
  if (g->pause[index] > 0U) {
    g->pause[index]--;
    return false;
  }
  const bool together = soter_step_all(g, index, ct);
  const uint32_t twice = 2U * g->alone[index] + 1U;
  g->alone[index] = together ? 0U : (twice < SOTER_LOCKSTEP_PAUSE ? twice : SOTER_LOCKSTEP_PAUSE);
  g->pause[index] = g->alone[index];
  return together;
}

/* Steps of a component in those worlds where it is released now. */
static void soter_step_each(const soter_lockstep* g, uint32_t index, bool released) {
  for (uint32_t w = 0; w < g->worlds; w++) {
    if (released || g->component[w][index].pending != 0U) {
      (void)soter_fire(g->p, g->state[w], index, NULL);
    }
  }
}

void soter_lockstep_instant(soter_lockstep* g, int64_t ct) {
  const soter_program* const p = g->p;
  bool everywhere[SOTER_LOCKSTEP_WORLDS];
  bool hold[SOTER_LOCKSTEP_WORLDS];
  for (uint32_t w = 0; w < g->worlds; w++) {
    everywhere[w] = hold[w] = true;
    soter_move(g, w, ct);
  }
  for (uint32_t i = 0; i < p->components; i++) {
    const bool released = g->next[i] == ct;
    if (released) {
      g->next[i] = ct + p->component[i].period_ns;
      for (uint32_t w = 0; w < g->worlds; w++) {
        g->component[w][i].next = g->next[i];
      }
    }
    if (released ? !soter_try_all(g, i, ct) : g->is_moved[i]) {
      soter_step_each(g, i, released);
    }
  }
  soter_judge_all(g, SOTER_AT_INSTANT, 0U, everywhere, hold);
}
