/* soter_gym.c: worlds whose agent is outside.
 *
 * Purpose: see soter_gym.h. What the agent sees is what is there as it is asked: plants, decision
 * modules and safe controllers have stepped at that instant, the rest has not.
 * Non-goals: the model that a step is compared with (soter_gym_explain.c).
 */
#include "soter_gym.h"

#include <string.h>

#include "soter_gym_leaves.h"

/* ------------------------------------------------------------------ what is known */

static soter_cause soter_cause_of(const soter_module* m, bool forced) {
  if (m->mode == (uint8_t)SOTER_AC || forced) {
    return m->mode == (uint8_t)SOTER_AC ? SOTER_CAUSE_NONE : SOTER_CAUSE_FORCED;
  }
  if (m->saw_gate_fault != 0U || m->clean_needed != 0U) {
    return SOTER_CAUSE_GATE;
  }
  if (m->stale != 0U) {
    return SOTER_CAUSE_STALE;
  }
  return m->ttf != 0U ? SOTER_CAUSE_TTF : SOTER_CAUSE_RECOVERING;
}

static void soter_know(const soter_view* v, void* state, soter_facts* f) {
  f->time = soter_header_of(state)->ct;
  if (v->module < 0) {
    return;
  }
  const soter_module* const m = soter_modules_of(v->program, state) + v->module;
  f->mode = m->mode;
  f->ttf = m->ttf;
  f->safer = m->safer;
  f->stale = m->stale;
  f->next_cause = (uint8_t)soter_cause_of(m, v->program->module[v->module].forced);
}

/* ------------------------------------------------------------------ instants */

bool soter_is_plain(const soter_program* p) {
  SOTER_CHECK(p != NULL);
  bool plain = p->order == NULL;
  for (uint32_t i = 0; i < p->components; i++) {
    plain = plain && p->component[i].effect == NULL && p->component[i].happens == NULL;
  }
  return plain;
}

/* soter_instant in the middle of one; who need not be asked what it holds steps at once. */
static soter_status soter_go_on(const soter_view* v, void* state, uint32_t* due) {
  const soter_program* const p = v->program;
  const soter_component* const c = soter_components_of(state);
  for (uint32_t i = 0; i < p->components && v->plain != 0U; i++) {
    if (c[i].pending != 0U) {
      if (p->component[i].is_extern) {
        break;
      }
      (void)soter_fire(p, state, i, NULL);
    }
  }
  return soter_instant(p, state, due);
}

/* soter_progress and what is drawn then, where every release is that of its period. */
static void soter_release(const soter_program* p, void* state) {
  soter_component* const c = soter_components_of(state);
  const int64_t ct = soter_next_instant(p, state);
  for (uint32_t i = 0; i < p->components; i++) {
    if (c[i].next == ct) {
      c[i].pending = 1;
      c[i].next = ct + p->component[i].period_ns;
    }
  }
  soter_header_of(state)->ct = ct;
  soter_header_of(state)->firing = 1;
  for (uint32_t i = 0; i < p->inputs; i++) {
    if (ct % p->input[i].every_ns == 0) {
      p->input[i].draw(state, NULL);
    }
  }
}

/* Runs until somebody outside is due. */
static uint32_t soter_await(const soter_view* v, void* state) {
  uint32_t due = 0;
  soter_status status = SOTER_INSTANT_DONE;
  while (status == SOTER_INSTANT_DONE) {
    if (v->plain == 0U) {
      status = soter_virtual_instant(v->program, state, &due);
      continue;
    }
    if (soter_header_of(state)->firing == 0U) {
      soter_release(v->program, state);
    }
    status = soter_go_on(v, state, &due);
  }
  return due;
}

/* ------------------------------------------------------------------ what is told */

/* Violations so far and, on a copy on which externs say nothing, to the end of this instant. */
static uint32_t soter_foresee(const soter_view* v, const void* state, uint8_t* room) {
  const soter_program* const p = v->program;
  uint8_t* const silent = room + p->state_size;
  uint32_t due = 0;
  (void)memcpy(room, state, p->state_size);
  (void)memset(silent, 0, v->answer_most);
  while (soter_header_of(room)->firing != 0U && soter_go_on(v, room, &due) == SOTER_EXTERN_DUE) {
    if (due == v->plant) { /* it did not move yet: nothing is known of this instant */
      break;
    }
    soter_answer(p, room, due, SOTER_OK, silent);
  }
  return soter_header_of(room)->violations;
}

/* The agent's answer; whether its numbers are values of what it publishes. */
static bool soter_wish(const soter_view* v, const double* action, uint8_t* answer) {
  (void)memset(answer, 0, v->action.size);
  for (uint32_t i = 0; i < v->given.count; i++) {
    answer[v->given.at[i].offset] = 1;
  }
  return soter_put_all(&v->action, action, answer);
}

/* Whether what the module publishes is not what its AC just proposed. */
static bool soter_moved(const soter_view* v, const void* state) {
  const uint8_t* const base = (const uint8_t*)state;
  for (uint32_t i = 0; i < v->proposed.count; i++) {
    if (soter_get(&v->proposed.at[i], base) != soter_get(&v->outputs.at[i], base)) {
      return true;
    }
  }
  return false;
}

/* Why the action does not count: of the module, else of the gate. */
static void soter_take_cause(soter_facts* f) {
  f->cause = f->next_cause;
  if (f->cause == (uint8_t)SOTER_CAUSE_NONE && f->gate_fault != 0U) {
    f->cause = (uint8_t)SOTER_CAUSE_GATE;
  }
  if (f->moved != 0U) {
    f->cause = (uint8_t)SOTER_CAUSE_TOWARD_SC;
  }
}

/* The agent is due: it answers, and facts tell what becomes of that. */
static void soter_take(const soter_view* v, void* state, const double* action, uint8_t* answer,
                       soter_facts* f) {
  const soter_program* const p = v->program;
  const bool fits = soter_wish(v, action, answer);
  const soter_module* const m = v->module < 0 ? NULL : soter_modules_of(p, state) + v->module;
  const uint32_t faults = m == NULL ? 0U : m->gate_faults;
  f->taken_by = m == NULL ? (uint8_t)SOTER_AC : m->mode;
  soter_answer(p, state, v->agent, fits ? SOTER_OK : SOTER_EXTERN_FAULT, answer);
  f->gate_fault = m != NULL && m->gate_faults != faults ? 1U : 0U;
  f->moved =
      f->taken_by == (uint8_t)SOTER_AC && f->gate_fault == 0U && soter_moved(v, state) ? 1U : 0U;
  soter_take_cause(f);
  f->off_model = 0;
  f->steps++;
}

/* ------------------------------------------------------------------ many worlds */

static void soter_show(const soter_worlds* w, uint32_t k, void* state, uint8_t before) {
  const soter_view* const v = w->view;
  soter_facts* const f = &w->facts[k];
  soter_know(v, state, f);
  f->switched = f->mode != before ? 1U : 0U;
  f->violations = soter_foresee(v, state, w->room);
  soter_get_all(&v->observe, state, w->observations + (size_t)k * v->observe.count);
}

static bool soter_world_begin(const soter_worlds* w, uint32_t k) {
  const soter_view* const v = w->view;
  uint8_t* const state = w->states + (size_t)k * v->program->state_size;
  soter_start(v->program, state, w->seeds[k]);
  w->seeds[k] += w->stride;
  (void)memset(&w->facts[k], 0, sizeof w->facts[k]);
  const uint8_t mode = v->module < 0 ? 0U : soter_modules_of(v->program, state)[v->module].mode;
  if (soter_await(v, state) != v->agent) {
    return false;
  }
  soter_get_all(&v->apply, state, w->applied + (size_t)k * v->apply.count);
  soter_show(w, k, state, mode);
  return true;
}

static bool soter_world_step(const soter_worlds* w, uint32_t k) {
  const soter_view* const v = w->view;
  const soter_program* const p = v->program;
  uint8_t* const state = w->states + (size_t)k * p->state_size;
  uint32_t due = 0;
  soter_take(v, state, w->actions + (size_t)k * v->action.count, w->room + p->state_size,
             &w->facts[k]);
  if (soter_go_on(v, state, &due) != SOTER_INSTANT_DONE) {
    return false;
  }
  soter_get_all(&v->apply, state, w->applied + (size_t)k * v->apply.count);
  if (soter_await(v, state) != v->agent) {
    return false;
  }
  soter_show(w, k, state, w->facts[k].taken_by);
  return true;
}

uint32_t soter_worlds_begin(const soter_worlds* w) {
  SOTER_CHECK(w != NULL);
  for (uint32_t k = 0; k < w->count; k++) {
    if (w->begin[k] != 0U && !soter_world_begin(w, k)) {
      return k;
    }
  }
  return w->count;
}

uint32_t soter_worlds_step(const soter_worlds* w) {
  SOTER_CHECK(w != NULL);
  for (uint32_t k = 0; k < w->count; k++) {
    if (!(w->begin[k] != 0U ? soter_world_begin(w, k) : soter_world_step(w, k))) {
      return k;
    }
  }
  return w->count;
}

void soter_worlds_mask(const soter_worlds* w, const double* answers, uint32_t count,
                       uint8_t* masks) {
  SOTER_CHECK(w != NULL);
  const soter_view* const v = w->view;
  const size_t size = v->program->state_size;
  soter_facts facts;
  for (size_t i = 0; i < (size_t)w->count * count; i++) {
    (void)memcpy(w->room, w->states + (i / count) * size, size);
    soter_components_of(w->room)[v->agent].oe = 1;
    (void)memset(&facts, 0, sizeof facts);
    soter_take(v, w->room, answers + (i % count) * v->action.count, w->room + size, &facts);
    masks[i] = facts.gate_fault == 0U && !soter_moved(v, w->room) ? 1U : 0U;
  }
}

/* ------------------------------------------------------------------ one world, its plant outside
 */

/* docs/proof-sets.md, Margin: what is left of the looks that keep AC; 0 in mode SC. */
static int64_t soter_margin(const soter_view* v, void* state) {
  if (v->module < 0) {
    return 0;
  }
  const soter_module* const m = soter_modules_of(v->program, state) + v->module;
  const soter_module_info* const info = &v->program->module[v->module];
  const soter_component* const dm = soter_components_of(state) + info->dm;
  if (m->mode != (uint8_t)SOTER_AC || m->ttf != 0U || m->stale != 0U || m->saw_gate_fault != 0U) {
    return 0;
  }
  const int64_t late = (dm->next - v->program->component[info->dm].phase_ns) % info->period_ns;
  const int64_t waits =
      dm->pending != 0U ? 2 : 1; /* it is due at this instant and has not looked */
  const int64_t looked = dm->next - late - waits * info->period_ns;
  const int64_t looks = m->safer != 0U ? (int64_t)v->looks : 1;
  const int64_t left = looks * info->period_ns - v->late_ns - (soter_header_of(state)->ct - looked);
  return left > 0 ? left : 0;
}

/* Each fact in bits of its own. */
static uint32_t soter_flags(const soter_facts* f) {
  return (uint32_t)f->mode | (uint32_t)f->ttf << 1U | (uint32_t)f->safer << 2U |
         (uint32_t)f->stale << 3U | (uint32_t)f->taken_by << 4U | (uint32_t)f->gate_fault << 5U |
         (uint32_t)f->off_model << 6U | (f->steps != 0U ? 1U : 0U) << 7U | (uint32_t)f->cause << 8U;
}

int32_t soter_outside_go(soter_outside* o) {
  SOTER_CHECK(o != NULL);
  const soter_view* const v = o->view;
  const uint32_t due = soter_await(v, o->state);
  if (due != v->plant && due != v->agent) {
    return (int32_t)due;
  }
  if (due == v->plant) {
    soter_get_all(&v->apply, o->state, o->command);
    for (uint32_t i = 0; i < v->apply.count && o->single != NULL; i++) {
      o->single[i] = (float)o->command[i];
    }
  }
  soter_know(v, o->state, o->facts);
  /* until the plant has moved nothing is known of this instant */
  o->facts->violations = o->looks != 0U && due == v->agent ? soter_foresee(v, o->state, o->room)
                                                           : soter_header_of(o->state)->violations;
  o->margin_ns = soter_margin(v, o->state);
  o->flags = soter_flags(o->facts);
  o->latched = soter_components_of(o->state)[v->plant].latched;
  return (int32_t)due;
}

uint32_t soter_outside_violations(const soter_outside* o) {
  SOTER_CHECK(o != NULL);
  return soter_foresee(o->view, o->state, o->room);
}

int32_t soter_outside_place(const soter_outside* o) {
  SOTER_CHECK(o != NULL);
  return soter_put_all(&o->view->start, o->states, o->state) ? 0 : -1;
}

int32_t soter_outside_act(soter_outside* o) {
  SOTER_CHECK(o != NULL);
  const size_t behind = o->view->program->state_size;
  soter_take(o->view, o->state, o->action, o->room + behind, o->facts);
  return soter_outside_go(o);
}

int32_t soter_outside_move(soter_outside* o) {
  SOTER_CHECK(o != NULL);
  const soter_view* const v = o->view;
  uint8_t* const answer = o->room + v->program->state_size;
  (void)memset(answer, 0, v->moved.size);
  if (!soter_put_all(&v->moved, o->states, answer)) {
    return -1;
  }
  if (o->model != NULL) {
    soter_outside_judge(o);
  }
  soter_answer(v->program, o->state, v->plant, SOTER_OK, answer);
  return soter_outside_go(o);
}

int32_t soter_outside_move_on(soter_outside* o) {
  const int32_t due = soter_outside_move(o);
  const bool same = o->told != 0U && o->flags == o->told_flags &&
                    o->facts->violations == o->told_violations && o->latched == 0U;
  return same && due == (int32_t)o->view->agent ? SOTER_AS_TOLD : due;
}

void soter_outside_tell(soter_outside* o) {
  SOTER_CHECK(o != NULL);
  o->told = 1;
  o->told_flags = o->flags;
  o->told_violations = o->facts->violations;
}
