/* soter_explore_step.c: the moves of a configuration (docs/testing.md, "Actors, steps, windows").
 *
 * Purpose: windows, order, times, faults; one move; what is observed after it.
 * Non-goals: which moves are made (strategies), which are left out
 * (soter_explore_sound_reductions.c).
 */
#include "soter_explore_internal.h"
#include "soter_explore_pack.h"

bool soter_workspace_open(soter_workspace* space, const soter_model* m,
                          const soter_explore_options* o, soter_explore_progress* progress,
                          soter_explore_coverage* coverage) {
  (void)memset(space, 0, sizeof *space);
  space->m = m;
  space->progress = progress;
  space->p = m->program;
  space->size = m->configuration_size;
  const bool whole = o == NULL || o->actors == 0U;
  space->turn = SOTER_NOTHING;
  space->seed = o == NULL ? 0U : o->seed;
  space->actors = whole ? UINT64_MAX : o->actors;
  space->properties = whole ? UINT64_MAX : o->properties;
  space->timeds = whole ? UINT64_MAX : o->timeds;
  space->known = o == NULL ? NULL : o->known;
  space->knowns = o == NULL ? 0U : o->knowns;
  space->coverage = coverage;
  space->started = calloc(3U, space->size);
  if (space->started == NULL) {
    return false;
  }
  space->here = space->started + space->size;
  space->there = space->here + space->size;
  space->answers.choices = space->choice;
  space->answers.room = SOTER_CHOICES;
  space->answers.taken = &space->taken;
  space->answers.branches = coverage != NULL ? coverage->branches : NULL;
  soter_make_start(space);
  (void)memcpy(space->started, space->there, space->size);
  (void)memcpy(space->here, space->there, space->size);
  return true;
}

void soter_workspace_close(soter_workspace* space) {
  free(space->started);
  space->started = NULL;
}

static soter_held* held_of(const soter_actor* a, void* configuration) {
  SOTER_CHECK(a->overrun_ns > 0);
  return (soter_held*)((char*)configuration + a->held);
}

static void answer(soter_workspace* space) {
  SOTER_CHECK(space->given <= SOTER_CHOICES);
  space->answers.given = space->given;
  space->taken = 0U;
}

static void answered(soter_workspace* space, uint32_t actor) {
  space->many = space->taken > SOTER_CHOICES;
  if (space->many) {
    space->chooser = space->too_many ? space->chooser : actor;
    space->too_many = true;
    space->taken = SOTER_CHOICES;
  }
}

void soter_make_start(soter_workspace* space) {
  const soter_model* const m = space->m;
  (void)memset(space->there, 0, space->size);
  answer(space);
  soter_start_with(space->p, space->there, space->seed, &space->answers);
  answered(space, SOTER_NOTHING);
  soter_schedule_of(space->p, space->there)->now = -1;
  int64_t* const due = soter_due_of(space->p, space->there);
  for (uint32_t i = 0; i < m->timeds; i++) {
    const bool owed =
        m->timed[i].kind == SOTER_EVENTUALLY && m->timed[i].within_ns <= m->horizon_ns;
    due[i] = owed ? m->timed[i].within_ns : SOTER_NO_DEADLINE;
  }
  for (uint32_t i = 0; i < m->actors; i++) {
    if (m->actor[i].overrun_ns > 0) {
      held_of(&m->actor[i], space->there)->since = -1;
    }
  }
}

/* Whether number `i` is in a set of them: those beyond 64 are never left out. */
static bool is_in(uint64_t set, uint32_t i) {
  return i >= 64U || (set >> i & 1U) != 0U;
}

void soter_keep_others(const soter_workspace* space, void* configuration) {
  const soter_model* const m = space->m;
  const int64_t now = soter_schedule_of(space->p, configuration)->now;
  for (uint32_t i = 0; space->actors != UINT64_MAX && i < m->actors; i++) {
    const soter_actor* const a = &m->actor[i];
    if (soter_is_part(space, i)) {
      continue;
    }
    soter_done_of(m, configuration)[i] =
        (uint32_t)soter_must(now, a->window_ns, a->phase_ns, a->period_ns, m->horizon_ns);
  }
}

static soter_window window_of(const soter_workspace* space, uint32_t actor, void* configuration) {
  const soter_model* const m = space->m;
  const soter_actor* const a = &m->actor[actor];
  SOTER_CHECK(actor < m->actors);
  if (!soter_is_part(space, actor)) {
    const soter_window none = {SOTER_NO_DEADLINE, SOTER_NO_DEADLINE};
    return none;
  }
  if (a->overrun_ns > 0) {
    const int64_t since = held_of(a, configuration)->since;
    if (since >= 0) {
      const soter_window effect = {since + a->least_ns, since + a->overrun_ns};
      return effect;
    }
  }
  const int64_t release =
      a->phase_ns + (int64_t)soter_done_of(m, configuration)[actor] * a->period_ns;
  if (release > m->horizon_ns) {
    const soter_window none = {SOTER_NO_DEADLINE, SOTER_NO_DEADLINE};
    return none;
  }
  const soter_window step = {release, release + a->window_ns};
  return step;
}

void soter_find_windows(soter_workspace* space) {
  space->limit = SOTER_NO_DEADLINE;
  for (uint32_t i = 0; i < space->m->actors; i++) {
    space->window[i] = window_of(space, i, space->here);
    SOTER_CHECK(space->window[i].low <= space->window[i].high);
    if (space->window[i].high < space->limit) {
      space->limit = space->window[i].high;
    }
  }
  if (space->limit == SOTER_NO_DEADLINE) {
    space->limit = SOTER_NO_DEADLINE - 1; /* nothing is left: nobody may move */
  }
  space->turn = SOTER_NOTHING;
  for (uint32_t i = 0; space->m->ordered && !space->any_order && i < space->m->actors; i++) {
    if (space->window[i].low <= space->limit && space->turn == SOTER_NOTHING) {
      space->turn = i;
    }
  }
}

/* Time number `number` at which something due within the actor's window may happen. */
static bool time_of(const soter_workspace* space, uint32_t actor, uint32_t number, int64_t* time) {
  const int64_t now = soter_schedule_of(space->p, space->here)->now;
  const int64_t first = soter_later(now, space->window[actor].low);
  *time = first;
  if (number == 0U) {
    return true;
  }
  if (!space->m->timely) {
    return false;
  }
  const int64_t q = space->m->quantum_ns;
  SOTER_CHECK(q > 0);
  *time = (first / q + (int64_t)number) * q;
  return *time <= space->limit;
}

bool soter_move_of(const soter_workspace* space, uint32_t actor, uint32_t number,
                   soter_move* move) {
  SOTER_CHECK(actor < space->m->actors);
  if (!soter_may_move(space, actor)) {
    return false;
  }
  const soter_actor* const a = &space->m->actor[actor];
  const uint32_t done = soter_done_of(space->m, space->here)[actor];
  move->actor = actor;
  move->release = a->phase_ns + (int64_t)done * a->period_ns;
  if (a->overrun_ns > 0) {
    const bool runs = held_of(a, space->here)->since >= 0;
    move->kind = runs ? SOTER_EFFECT : SOTER_BEGINS;
    if (runs) {
      move->release -= a->period_ns;
    }
  } else {
    move->kind = SOTER_STEP;
  }
  if (a->skips > 0U && move->kind != SOTER_EFFECT) {
    if (soter_lost_of(space->m, space->here)[actor] < a->skips) {
      if (number == 0U) { /* the step that happens comes first: it is the default */
        return time_of(space, actor, 0U, &move->time);
      }
      if (number == 1U) {
        move->kind = SOTER_SKIPPED;
        return time_of(space, actor, 0U, &move->time);
      }
      number--;
    }
  }
  return time_of(space, actor, number, &move->time);
}

static bool look_for_faults(soter_workspace* space, uint32_t actor, soter_broken* broken) {
  if (soter_header_of(space->there)->violations == 0U) {
    return true;
  }
  const soter_property* const q = soter_properties_of(space->p, space->there);
  const soter_broken fault = {2U, space->m->actor[actor].component};
  *broken = fault;
  bool contract = false;
  for (uint32_t i = 0; i < space->p->properties; i++) {
    const soter_broken one = {1U, i};
    if (q[i].count > 0U && (!contract || soter_is_known(space, broken))) {
      *broken = one;
      contract = true;
    }
  }
  return false;
}

/* What happened to the invariants' clocks. */
static void note_module(soter_workspace* space, uint32_t component, uint32_t published,
                        bool enabled) {
  SOTER_CHECK(component < space->p->components);
  const soter_component_info* const info = &space->p->component[component];
  if (info->module < 0 || space->m->timeds == 0U) {
    return;
  }
  const uint32_t module = (uint32_t)info->module;
  SOTER_CHECK(module < space->p->modules);
  const bool in_ac = soter_modules_of(space->p, space->there)[module].mode == (uint8_t)SOTER_AC;
  if (info->role == SOTER_ROLE_DM && in_ac) {
    soter_verdict_of(space->m, space->there)[module] =
        soter_schedule_of(space->p, space->there)->now;
    soter_acted_of(space->m, space->there)[module] = 0U;
  }
  if (info->role == SOTER_ROLE_SC && enabled && published != 0U && !in_ac) {
    soter_acted_of(space->m, space->there)[module] = 1U;
  }
}

/* Takes back what an overrunning step published, to be kept until it takes effect. */
static void hold_back(soter_workspace* space, const soter_actor* a, int64_t time,
                      uint32_t published) {
  soter_held* const held = held_of(a, space->there);
  uint8_t* value = (uint8_t*)(held + 1);
  int64_t* const stamps = soter_stamps_of(space->p, space->there);
  const int64_t* const before = soter_stamps_of(space->p, space->here);
  SOTER_CHECK(held->since < 0 && time >= 0 && a->outputs <= 64U);
  held->since = time;
  held->mask = published;
  for (uint32_t i = 0; i < a->outputs; i++) {
    const soter_topic_info* const t = &space->p->topic[a->output[i]];
    (void)memset(value, 0, soter_padded(t->size));
    if ((published >> i & 1U) != 0U) {
      (void)memcpy(value, space->there + t->offset, t->size);
      (void)memcpy(space->there + t->offset, space->here + t->offset, t->size);
      stamps[a->output[i]] = before[a->output[i]];
    }
    value += soter_padded(t->size);
  }
}

/* Lets it take effect, and loses the releases that passed meanwhile. */
static void take_effect(soter_workspace* space, uint32_t actor, int64_t time) {
  const soter_actor* const a = &space->m->actor[actor];
  soter_held* const held = held_of(a, space->there);
  const bool enabled = soter_components_of(space->there)[a->component].oe != 0U;
  SOTER_CHECK(held->since >= 0 && held->since <= time);
  uint8_t* value = (uint8_t*)(held + 1);
  for (uint32_t i = 0; i < a->outputs; i++) {
    const soter_topic_info* const t = &space->p->topic[a->output[i]];
    if ((held->mask >> i & 1U) != 0U && enabled) {
      (void)memcpy(space->there + t->offset, value, t->size);
      soter_stamps_of(space->p, space->there)[a->output[i]] = time;
    }
    (void)memset(value, 0, soter_padded(t->size));
    value += soter_padded(t->size);
  }
  note_module(space, a->component, (uint32_t)held->mask, enabled);
  held->since = -1;
  held->mask = 0U;
  uint32_t* const done = &soter_done_of(space->m, space->there)[actor];
  const int64_t until =
      time - (a->least_ns > 0 ? 1 : 0); /* who says so is there for the next one */
  while (a->phase_ns + (int64_t)*done * a->period_ns <= until &&
         a->phase_ns + (int64_t)*done * a->period_ns <= space->m->horizon_ns) {
    (*done)++;
  }
}

bool soter_is_observable(soter_workspace* space) {
  const int64_t now = soter_schedule_of(space->p, space->there)->now;
  if (now < 0) {
    return false; /* the start: nothing has happened */
  }
  for (uint32_t i = 0; i < space->m->actors; i++) {
    if (window_of(space, i, space->there).high <= now) {
      return false;
    }
  }
  return true;
}

bool soter_at_the_end(soter_workspace* space) {
  for (uint32_t i = 0; i < space->m->actors; i++) {
    if (window_of(space, i, space->there).low != SOTER_NO_DEADLINE) {
      return false;
    }
  }
  return true;
}

/* When an obligation is due after what is seen in `there` at `now`; it was due at `due`. */
static int64_t due_after(const soter_workspace* space, const soter_timed* t, int64_t due,
                         int64_t now) {
  const bool is_owed = due != SOTER_NO_DEADLINE;
  SOTER_CHECK(due >= now);
  if (t->kind == SOTER_EVENTUALLY && !is_owed) {
    return due;
  }
  if (t->condition(space->there)) {
    return SOTER_NO_DEADLINE;
  }
  const bool begins = t->kind == SOTER_LEADSTO && !is_owed && t->premise(space->there) &&
                      now + t->within_ns <= space->m->horizon_ns;
  return begins ? now + t->within_ns : due;
}

/* Notes that a property (`number`: of all, the timed ones last) was judged, or met. */
static void note_judged(const soter_workspace* space, uint32_t number, uint8_t what) {
  SOTER_CHECK(number < space->p->properties + space->m->timeds);
  if (space->coverage != NULL) {
    space->coverage->judged[number] |= what;
  }
}

/* Notes that the premise of an always holds, once. */
static void note_premise(const soter_workspace* space, uint32_t number) {
  if (space->coverage != NULL && space->m->premise != NULL && space->m->premise[number] != NULL &&
      (space->coverage->judged[number] & SOTER_MET) == 0U &&
      space->m->premise[number](space->there)) {
    note_judged(space, number, SOTER_MET);
  }
}

/* Whether what a property promises is asked for here, and its end lies before the horizon. */
static bool asks(const soter_workspace* space, const soter_timed* t, int64_t now) {
  return t->kind == SOTER_EVENTUALLY ||
         (now + t->within_ns <= space->m->horizon_ns && t->premise(space->there));
}

/* What is owed changes where it can be seen: obligations are part of the configuration. */
void soter_keep_obligations(soter_workspace* space) {
  const soter_model* const m = space->m;
  int64_t* const due = soter_due_of(space->p, space->there);
  const int64_t now = soter_schedule_of(space->p, space->there)->now;
  if (!soter_is_observable(space)) {
    return;
  }
  for (uint32_t i = 0; i < m->timeds; i++) {
    const soter_timed* const t = &m->timed[i];
    if (t->kind != SOTER_INVARIANT && due[i] >= now) { /* a missed deadline stays missed */
      if (space->coverage != NULL && space->coverage->judged[space->p->properties + i] == 0U &&
          asks(space, t, now)) {
        note_judged(space, space->p->properties + i, SOTER_JUDGED);
      }
      due[i] = due_after(space, t, due[i], now);
      if (t->kind == SOTER_EVENTUALLY && due[i] != SOTER_NO_DEADLINE) {
        note_judged(space, space->p->properties + i, SOTER_MET);
      }
    }
  }
}

bool soter_make_move(soter_workspace* space, const soter_move* move, soter_broken* broken) {
  const soter_model* const m = space->m;
  SOTER_CHECK(move->actor < m->actors && move->kind != SOTER_BIRTH);
  const soter_actor* const a = &m->actor[move->actor];
  (void)memcpy(space->there, space->here, space->size);
  soter_header_of(space->there)->ct = move->time;
  soter_schedule_of(space->p, space->there)->now = move->time;
  soter_keep_others(space, space->there);
  space->taken = 0U;
  space->many = false;
  bool ok = true;
  if (move->kind == SOTER_EFFECT) {
    take_effect(space, move->actor, move->time);
  } else {
    soter_done_of(m, space->there)[move->actor]++;
    if (move->kind == SOTER_SKIPPED) {
      soter_lost_of(m, space->there)[move->actor]++;
    } else {
      if (a->skips > 0U) {
        soter_lost_of(m, space->there)[move->actor] = 0U;
      }
      answer(space);
      if ((a->component & SOTER_INPUT) != 0U) {
        space->p->input[a->component & ~SOTER_INPUT].draw(space->there, &space->answers);
      } else {
        soter_component* const c = &soter_components_of(space->there)[a->component];
        const bool enabled = c->oe != 0U;
        c->next = move->release + a->period_ns;
        uint32_t published = soter_fire(space->p, space->there, a->component, &space->answers);
        ok = look_for_faults(space, move->actor, broken);
        if (move->kind == SOTER_BEGINS) {
          hold_back(space, a, move->time, enabled ? published : 0U);
          published = 0U;
        }
        note_module(space, a->component, published, enabled);
      }
      answered(space, move->actor);
    }
  }
  if (ok && m->timeds > 0U) {
    soter_keep_obligations(space);
  }
  return ok;
}

static bool invariant_fails(soter_workspace* space, const soter_timed* t) {
  const int64_t now = soter_schedule_of(space->p, space->there)->now;
  if (!t->condition(space->there)) {
    return true;
  }
  const bool in_time = now <= soter_verdict_of(space->m, space->there)[t->module] + t->within_ns;
  const bool acted = soter_acted_of(space->m, space->there)[t->module] != 0U &&
                     soter_modules_of(space->p, space->there)[t->module].mode == (uint8_t)SOTER_SC;
  return !in_time && !acted;
}

static bool timed_fails(soter_workspace* space, uint32_t i, bool observable) {
  const soter_timed* const t = &space->m->timed[i];
  if (t->kind == SOTER_INVARIANT) {
    if (observable) {
      note_judged(space, space->p->properties + i, SOTER_JUDGED);
    }
    return observable && invariant_fails(space, t);
  }
  const int64_t due = soter_due_of(space->p, space->there)[i];
  if (due == SOTER_NO_DEADLINE) {
    return false;
  }
  const int64_t now = soter_schedule_of(space->p, space->there)->now;
  return due < now || (now >= 0 && soter_at_the_end(space));
}

/* Something that is violated: the first of it, and of that the first that is not known. Whether it
 * is one that is not known: then no other is looked for. */
static bool tell(const soter_workspace* space, uint32_t what, uint32_t index, bool* any,
                 soter_broken* broken) {
  const soter_broken found = {what, index};
  const bool news = !soter_is_known(space, &found);
  if (news || !*any) {
    *broken = found;
  }
  *any = true;
  return news;
}

/* Whether an always or never that is looked at is violated. */
static bool instant_fails(soter_workspace* space, uint32_t i) {
  const soter_property_info* const q = &space->p->property[i];
  if (q->when != SOTER_AT_INSTANT || !is_in(space->properties, i)) {
    return false;
  }
  note_judged(space, i, SOTER_JUDGED);
  note_premise(space, i);
  return q->violated(space->there);
}

bool soter_finds_violation(soter_workspace* space, soter_broken* broken) {
  const bool observable = soter_is_observable(space);
  bool any = false;
  bool news = false;
  for (uint32_t i = 0; observable && !news && i < space->p->properties; i++) {
    if (instant_fails(space, i)) {
      news = tell(space, 0U, i, &any, broken);
    }
  }
  for (uint32_t i = 0; !news && i < space->m->timeds; i++) {
    if (is_in(space->timeds, i) && timed_fails(space, i, observable)) {
      news = tell(space, 3U, i, &any, broken);
    }
  }
  return any;
}

#define CLASSES 256U /* of a leaf; further members of an enum have none */

static double leaf_value(const soter_leaf* leaf, const void* configuration) {
  const uint8_t* const at = (const uint8_t*)configuration + leaf->offset;
  if (leaf->kind == 2U) {
    double d;
    (void)memcpy(&d, at, sizeof d);
    return d;
  }
  int64_t v = 0;
  for (uint32_t i = 0; i < leaf->size; i++) {
    v |= (int64_t)((uint64_t)at[i] << (8U * i));
  }
  if (leaf->is_signed && leaf->size < 8U && (v >> (8U * leaf->size - 1U) & 1) != 0) {
    v -= (int64_t)(UINT64_C(1) << (8U * leaf->size));
  }
  return (double)v;
}

static uint32_t class_of(const soter_leaf* leaf, double v) {
  if (leaf->kind == 0U) {
    return v < (double)CLASSES ? (uint32_t)v : SOTER_NOTHING;
  }
  if (leaf->kind == 1U && leaf->high - leaf->low < 64.0) {
    return 8U + (uint32_t)(v - leaf->low); /* every value of a small set */
  }
  if (v == leaf->low) {
    return 0U;
  }
  if (v == leaf->high) {
    return 1U;
  }
  return v < 0.0 ? 2U : v > 0.0 ? 4U : 3U;
}

void soter_note_coverage(soter_workspace* space, uint32_t actor) {
  soter_explore_coverage* const c = space->coverage;
  if (c == NULL) {
    return;
  }
  const soter_model* const m = space->m;
  const soter_actor* const a = &m->actor[actor];
  c->fired[actor] = 1U;
  for (uint32_t k = 0; k < a->outputs; k++) {
    for (uint32_t i = a->leaf[k]; i < m->leaves && m->leaf[i].topic == a->output[k]; i++) {
      const uint32_t number = class_of(&m->leaf[i], leaf_value(&m->leaf[i], space->there));
      if (number < CLASSES) {
        c->classes[(size_t)i * CLASSES + number] = 1U;
      }
    }
  }
  if ((a->component & SOTER_INPUT) == 0U &&
      space->p->component[a->component].role == SOTER_ROLE_DM) {
    const uint32_t module = (uint32_t)space->p->component[a->component].module;
    const uint8_t before = soter_modules_of(space->p, space->here)[module].mode;
    const uint8_t after = soter_modules_of(space->p, space->there)[module].mode;
    c->modes[module * 2U + after] = 1U;
    if (before != after) {
      c->switches[module * 2U + after] = 1U;
    }
  }
}

void soter_merge_coverage(const soter_model* m, soter_explore_coverage* into,
                          const soter_explore_coverage* from) {
  for (uint32_t i = 0; i < (m->branches + 63U) / 64U; i++) {
    into->branches[i] |= from->branches[i];
  }
  for (size_t i = 0; i < (size_t)m->leaves * 256U; i++) {
    into->classes[i] |= from->classes[i];
  }
  for (uint32_t i = 0; i < m->program->modules * 2U; i++) {
    into->modes[i] |= from->modes[i];
    into->switches[i] |= from->switches[i];
  }
  for (uint32_t i = 0; i < m->actors; i++) {
    into->fired[i] |= from->fired[i];
  }
  for (uint32_t i = 0; i < m->program->properties + m->timeds; i++) {
    into->judged[i] |= from->judged[i];
  }
}

void soter_write_step(const soter_workspace* space, const soter_move* move, soter_trace_step* to) {
  (void)memset(to, 0, sizeof *to);
  to->actor = move->actor;
  to->kind = (uint32_t)move->kind;
  to->release_ns = move->release;
  to->time_ns = move->time;
  to->choices = space->taken;
  (void)memcpy(to->choice, space->choice, space->taken * sizeof to->choice[0]);
}

/* Whether the move just made is the one that is looked for. */
static bool is_wanted(soter_workspace* space, bool ok, const soter_broken* found,
                      const uint64_t* to, const soter_broken* broken) {
  if (!ok) {
    return to == NULL && soter_same_broken(found, broken);
  }
  if (to == NULL) {
    soter_broken seen;
    return soter_finds_violation(space, &seen) && soter_same_broken(&seen, broken);
  }
  uint64_t packed[SOTER_WORDS];
  space->m->pack(space->there, packed);
  return memcmp(packed, to, space->m->words * sizeof packed[0]) == 0;
}

static bool find_birth(soter_workspace* space, const uint64_t* to, const soter_broken* broken,
                       soter_trace_step* step) {
  static const soter_move birth = {SOTER_NOTHING, SOTER_BIRTH, -1, -1};
  space->given = 0U;
  do {
    soter_make_start(space);
    if (is_wanted(space, true, NULL, to, broken)) {
      soter_write_step(space, &birth, step);
      return true;
    }
  } while (soter_next_picks(space));
  return false;
}

bool soter_find_move(soter_workspace* space, const uint64_t* from, const uint64_t* to,
                     const soter_broken* broken, soter_trace_step* step) {
  if (from == NULL) {
    return find_birth(space, to, broken, step);
  }
  (void)memcpy(space->here, space->started, space->size);
  space->m->unpack(from, space->here);
  soter_find_windows(space);
  for (uint32_t a = 0; a < space->m->actors; a++) {
    soter_move move;
    for (uint32_t n = 0; soter_move_of(space, a, n, &move); n++) {
      space->given = 0U;
      do {
        soter_broken found;
        const bool ok = soter_make_move(space, &move, &found);
        if (is_wanted(space, ok, &found, to, broken)) {
          soter_write_step(space, &move, step);
          return true;
        }
      } while (soter_next_picks(space));
    }
  }
  return false;
}
