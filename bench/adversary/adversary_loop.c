/* One run of a closed loop against an adversary that knows everything.
 *
 * Purpose: plant, sensor, path nodes, DM, SC, gate and actuation as the definitions of the model
 * of time have them (docs/proof.md), a tick at a time; every choice that they leave open is made
 * against the module, by a policy. Shares no code with the run-time kernel or the prover.
 * Non-goals: choosing policies (closed_loop.py), reading programs (random_modules.py).
 *
 * Within a tick: publications of path nodes under way (seen now or after the module, both are
 * schedules), the sensor, the DM, SC, path nodes in order, AC, acting, then the plant moves.
 */

#include "adversary_gate.h"

/* ---------------------------------------------------------------- one run */

typedef struct {
  int busy, phase; /* 0: waits to start, 1: runs */
  int64_t release, start, done;
} task;

static int due(int64_t t, int32_t period, int32_t phase) {
  return t >= phase && (t - phase) % period == 0;
}

/* A command acts, within its latency and in order. */
static void act(state *s, queue *q, int k, double u) {
  const loop *m = s->m;
  int64_t at = s->t + m->acts_least[k] + choose(s, L_ACT, m->acts[k] - m->acts_least[k]);
  at += m->slip == BEHIND && s->ac ? 2 * m->dm_period : 0;
  at = at > q->last ? at : q->last;
  int slot = (q->first + q->count) % QUEUE;
  q->u[slot] = u;
  q->at[slot] = q->last = at;
  q->count += q->count < QUEUE;
}

/* A node behind the module publishes; the last one moves the plant. */
static void deliver(state *s, queue *q, task *driver, int i, const double *u) {
  memcpy(s->output[i + 1], u, sizeof s->output[i + 1]);
  driver[i].busy = 0;
  for (int k = 0; k < s->m->m && i + 1 == s->m->drivers; k++) {
    act(s, &q[k], k, u[k]);
  }
}

/*
 * `ticks` from `t0`, at `x0`; `ac`: AC has control, `y0` is what the sensor publishes at `t0`, and
 * `held` the command that acts, where there is a shield.
 * `log`: room for events, or null.
 */
void adversary_run(const loop *m, const int32_t *policy, uint64_t seed, int64_t t0, int64_t ticks,
    const double *x0, int ac, const double *y0, const double *held, outcome *out, event *log,
    int32_t *logged) {
  state s = {.m = m, .p = policy, .seed = seed, .t = t0, .ac = ac};
  task dm = {0}, sc = {0}, node[NODES] = {{0}}, driver[NODES] = {{0}};
  double carried[NODES][U];
  queue q[U] = {{{0}}};
  value sent[NODES] = {{{0}}};
  double command[U] = {0};
  int verdict = 0, which = 0;
  double looked[N] = {0};
  int64_t last = t0; /* the latest release of DM or SC that has begun */
  int64_t ac_since = ac ? t0 : NEVER, ac_until[U] = {NEVER, NEVER};
  s.log = log;
  s.room = log == 0 ? 0 : *logged;
  memset(out, 0, sizeof *out);
  memcpy(s.x, x0, (size_t)m->n * sizeof(double));
  for (int k = 0; k < m->m; k++) {
    s.u[k] = !ac ? m->u_first[k] : m->shield > 0 ? held[k] : m->u_high[k];
    s.published[k] = s.u[k];
    for (int i = 0; i < PAST; i++) {
      s.past[k][i] = s.u[k];
    }
    for (int c = 0; c < CELLS; c++) {
      s.until[k][c] = NEVER;
    }
    q[k].last = t0;
    for (int i = 0; i <= m->drivers; i++) {
      s.output[i][k] = m->u_first[k];
    }
  }
  for (int i = 0; i <= m->nodes; i++) {
    s.topic[i].stamp = s.topic[i].state = NEVER;
  }
  int64_t end = t0 + ticks;
  for (; s.t < end; s.t++) {
    int64_t t = s.t;
    int later[NODES] = {0};
    direction(&s);
    /* what path nodes publish that started before */
    for (int i = 0; i < m->nodes; i++) {
      if (node[i].busy && node[i].phase == 1 && node[i].done == t) {
        int seen = s.p[SEEN] == 2 ? (int)(draw(&s) & 1U) : s.p[SEEN] == 1;
        later[i] = !seen;
        if (seen) {
          s.topic[i + 1] = sent[i];
          s.topic[i + 1].stamp = t;
          node[i].busy = 0;
        }
      }
    }
    if (due(t, m->sensor_period, m->sensor_phase)) {
      /* silent for `dropout` longer than its period, once it has spoken at its first release */
      int64_t since = s.topic[0].stamp + m->sensor_period;
      int drop = s.topic[0].stamp != NEVER && t + m->sensor_period <= since + m->dropout
          && choose(&s, DROP, 1) > 0;
      if (!drop) {
        if (ac && t == t0) {
          memcpy(s.topic[0].v, y0, (size_t)m->n * sizeof(double));
        } else {
          errors(&s, s.topic[0].v);
        }
        s.topic[0].stamp = s.topic[0].state = t;
      } else {
        note(&s, 1, 0.0);
      }
    }
    const value *read = &s.topic[m->nodes];
    /* DM */
    int before = s.ac;
    if (dm.busy && dm.phase == 1 && dm.done == t) {
      s.ac = verdict;
      dm.busy = 0;
    }
    if (due(t, m->dm_period, m->dm_phase)) {
      dm = (task){1, 0, t, t + choose(&s, LJ_DM, m->j_dm), 0};
    }
    if (dm.busy && dm.phase == 0 && dm.start == t) {
      int level = read->stamp == NEVER || t - read->stamp > m->max_age
          ? 0
          : adversary_level(m, read->v);
      verdict = s.ac ? level >= 1 : level >= 2;
      if (m->shield > 0) {
        verdict = fresh(&s, read, dm.release) && !s.gate_fault
            && (s.ac && m->slip == SILENCE ? 1 : s.ac ? permitted(&s, read->v, s.published, dm.release) : level >= 2);
        s.gate_fault = 0;
        out->forgot |= s.ac && verdict
            && forgotten(&s, q, s.published, read->state, dm.release);
        memcpy(looked, read->v, sizeof looked);
      }
      last = dm.release;
      dm.phase = 1;
      dm.done = t + choose(&s, LR_DM, m->r_dm);
      note(&s, 2, (double)verdict);
      if (dm.done == t) {
        s.ac = verdict;
        dm.busy = 0;
      }
    }
    if (s.ac != before) {
      out->switches++;
      if (s.ac) {
        ac_since = t;
      } else {
        for (int k = 0; k < m->m; k++) {
          ac_until[k] = t;
        }
      }
      note(&s, 3, (double)s.ac);
    }
    /* SC */
    if (due(t, m->sc_period, m->sc_phase)) {
      sc = (task){1, 0, t, t + choose(&s, LJ_SC, m->j_sc), 0};
    }
    if (sc.busy && sc.phase == 0 && t >= sc.start && !(dm.busy && dm.release <= sc.release)) {
      law(m, which, read->v, command); /* zeros, the default, before anything was published */
      which = (which + 1) % m->laws;
      sc.phase = 1;
      sc.done = t + choose(&s, LR_SC, m->r_sc);
      last = sc.release;
      note(&s, 4, read->state == NEVER ? -1.0 : (double)(t - read->state));
    }
    if (sc.busy && sc.phase == 1 && sc.done == t) {
      sc.busy = 0;
      if (!s.ac && m->shield > 0) {
        replaced(&s, command, sc.release);
      }
      for (int k = 0; k < m->m && !s.ac; k++) {
        s.output[0][k] = command[k];
        if (m->drivers == 0) {
          act(&s, &q[k], k, command[k]);
        }
      }
    }
    /* path nodes */
    for (int i = 0; i < m->nodes; i++) {
      if (later[i]) {
        s.topic[i + 1] = sent[i];
        s.topic[i + 1].stamp = t;
        node[i].busy = 0;
      }
      if (due(t, m->node_period[i], m->node_phase[i])) {
        node[i] = (task){1, 0, t, t + choose(&s, LJ_NODE, m->node_j[i]), 0};
      }
      if (node[i].busy && node[i].phase == 0 && node[i].start == t) {
        sent[i] = s.topic[i];
        node[i].phase = 1;
        node[i].done = t + choose(&s, LR_NODE, m->node_r[i]);
        if (node[i].done == t) {
          s.topic[i + 1] = sent[i];
          s.topic[i + 1].stamp = t;
          node[i].busy = 0;
        }
      }
    }
    /* AC, below a shield: any command at any tick, that is judged; its release may be older */
    if (m->shield > 0 && s.ac) {
      double wanted[U];
      int oldest = s.p[OLDEST] == 2 ? (int)(draw(&s) & 1U) : s.p[OLDEST] == 1;
      int64_t release = oldest ? last : t;
      if (m->slip != LOOKED) {
        memcpy(looked, read->v, sizeof looked);
      }
      if (proposes(&s, read, looked, release, wanted)) {
        double proposed[U];
        memcpy(proposed, wanted, sizeof proposed);
        if (m->toward && m->slip != SC_JUDGED) {
          moves(&s, looked, release, command, wanted);
        }
        const double *judged = m->slip == HELD_ONLY ? s.published : wanted;
        judged = m->slip == SC_JUDGED ? command : judged;
        int fine = fresh(&s, read, release)
            && (m->slip == UNJUDGED || permitted(&s, looked, judged, release));
        s.gate_fault |= !fine;
        out->forgot |= fine && forgotten(&s, q, wanted, read->state, release);
        if (fine || m->slip == AFTERWARDS) {
          replaced(&s, m->slip == PROPOSED ? proposed : wanted, release);
          for (int k = 0; k < m->m; k++) {
            if (m->drivers == 0) {
              act(&s, &q[k], k, wanted[k]);
            }
          }
        }
      }
    }
    /* nodes behind the module; what AC publishes stands on its topic until SC's replaces it */
    for (int k = 0; k < m->m && s.ac && m->drivers > 0; k++) {
      s.output[0][k] = m->shield > 0 ? s.published[k] : advanced(&s, k);
    }
    for (int i = 0; i < m->drivers; i++) {
      /* what it publishes now may be read by the next one now, or only later */
      int last = s.p[SEEN] == 1 ? i : m->drivers - 1 - i;
      if (driver[last].busy && driver[last].phase == 1 && driver[last].done == t) {
        deliver(&s, q, driver, last, carried[last]);
      }
      if (due(t, m->driver_period[last], m->driver_phase[last])) {
        driver[last] = (task){1, 0, t, t + choose(&s, LJ_NODE, m->driver_j[last]), 0};
      }
      /* in the module's thread: behind SC and the DM, however late they are */
      int waits = m->in_step && (sc.busy || dm.busy);
      int starts = m->in_step ? driver[last].start <= t && !waits : driver[last].start == t;
      if (driver[last].busy && driver[last].phase == 0 && starts) {
        memcpy(carried[last], s.output[last], sizeof carried[last]);
        driver[last].phase = 1;
        driver[last].done = t + choose(&s, LR_NODE, m->driver_r[last]);
        if (driver[last].done == t) {
          deliver(&s, q, driver, last, carried[last]);
        }
      }
    }
    /* what acts */
    for (int k = 0; k < m->m; k++) {
      int64_t l = m->acts[k];
      int free = m->shield == 0; /* whether what AC says acts unjudged */
      int tail = free && !s.ac && m->drivers == 0 && ac_until[k] != NEVER && t < ac_until[k] + l;
      tail = tail && t - l >= ac_since;
      while (q[k].count > 0 && q[k].at[q[k].first] <= t) {
        s.u[k] = q[k].u[q[k].first];
        q[k].first = (q[k].first + 1) % QUEUE;
        q[k].count--;
        tail = 0;
        if (!s.ac) {
          ac_until[k] = NEVER; /* order: nothing of AC acts after SC */
        }
        note(&s, 5 + k, s.u[k]);
      }
      if ((s.ac && free && m->drivers == 0 && t >= q[k].last) || tail) {
        s.u[k] = advanced(&s, k);
      }
    }
    for (int k = 0; k < m->m; k++) {
      s.past[k][t % PAST] = s.u[k];
    }
    winds(&s);
    move(m, s.x, s.u, s.w);
    out->steps++;
    double near = nearness(m, s.x);
    out->worst = near > out->worst ? near : out->worst;
    if (!s.ac && near > out->worst_sc) {
      out->worst_sc = near;
    }
    if (!(near <= 1.0 + 1e-6)) {
      out->left = 1;
      out->at = t + 1;
      break;
    }
  }
  memcpy(out->x, s.x, sizeof s.x);
  if (log != 0) {
    *logged = s.logged;
  }
}
