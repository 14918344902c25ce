/* soter_posix_world.c: what meets the world.
 *
 * Purpose: values from outside, checked, stamped and published before the steps of an instant;
 * what goes out after them; and of a module with a fail-safe law its commands with their leases,
 * for the process of the actuators. Plants that are here obey leases, too.
 * Non-goals: the actuators (soter_actuator.c); waiting on the trusted path; where no folder of
 * channels is given everything but the leases of plants that are here is nothing.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_posix.h"

#include <string.h>
#include <time.h>

#define NAP_NS 2000000L
#define SC 1U /* of the nodes of a grant */

/* ------------------------------------------------------------------ before the start */

static bool opened(soter_posix* d, soter_outside* channel, const char* name, uint64_t hash,
                   size_t size, bool writes) {
  SOTER_CHECK(d->options.channels != NULL);
  const char* const wrong =
      soter_outside_open(channel, d->options.channels, name, hash, size, writes);
  if (wrong != NULL) {
    (void)fprintf(stderr, "not run: the channel `%s` in `%s`: %s\n", name, d->options.channels,
                  wrong);
  }
  return wrong == NULL;
}

bool soter_posix_open(soter_posix* d) {
  bool fine = true;
  if (d->options.channels == NULL) {
    if (APP_OUTSIDE > 0) {
      (void)fprintf(stderr, "not run: `%s` comes from outside: --channels FOLDER\n",
                    soter_app_outside[0].name);
    }
    return APP_OUTSIDE == 0;
  }
  for (uint32_t k = 0; k < soter_app_outside_count; k++) {
    const soter_posix_topic* const t = &soter_app_outside[k];
    SOTER_CHECK(t->topic < APP_PROGRAM->topics);
    fine = fine && opened(d, &d->outside[k].channel, t->name, t->hash,
                          APP_PROGRAM->topic[t->topic].size, !t->inward);
  }
  for (uint32_t k = 0; k < soter_app_lease_count; k++) {
    const soter_posix_lease* const l = &soter_app_leases[k];
    SOTER_CHECK(l->size == sizeof(soter_posix_lease_head) + l->lease->size);
    d->lease[k].ended_ns = -1; /* nothing has begun, and nothing has ended */
    fine = fine && opened(d, &d->lease[k].channel, l->channel, l->hash, l->size, true);
  }
  /* plants beside a robot share its folder: the channel of the status is the robot's */
  return fine && (APP_PROGRAM->modules == 0U || opened(d, &d->status_channel, SOTER_STATUS_CHANNEL,
                                                       APP_STATUS_HASH, sizeof d->said, true));
}

/* Whether somebody speaks: there is a value, and none too old where the topic says what that is. */
static bool heard(soter_posix* d, uint32_t k) {
  const soter_posix_topic* const t = &soter_app_outside[k];
  soter_outside* const channel = &d->outside[k].channel;
  int64_t time_ns = 0;
  SOTER_CHECK(t->inward && channel->size <= sizeof d->value);
  const bool found = soter_outside_read(channel, &time_ns, d->value, NULL);
  channel->number = 0; /* the first instant reads it again */
  return found && (t->max_age_ns < 0 || soter_posix_clock() - time_ns <= t->max_age_ns);
}

bool soter_posix_hear(soter_posix* d) {
  const struct timespec nap = {0, NAP_NS};
  const int64_t end_ns = soter_posix_clock() + d->options.wait_ns;
  for (uint32_t k = 0; k < soter_app_outside_count; k++) {
    if (!soter_app_outside[k].inward || !soter_app_outside[k].awaited) {
      continue;
    }
    bool found = heard(d, k);
    while (!found && soter_posix_clock() < end_ns && d->stop == 0) {
      (void)nanosleep(&nap, NULL);
      found = heard(d, k);
    }
    if (!found) {
      soter_posix_note(d,
                       "nobody speaks on `%s`: until somebody does its default is read, which no "
                       "proof is about",
                       soter_app_outside[k].name);
    }
  }
  return d->stop == 0;
}

bool soter_posix_leases_over(const soter_posix* d) {
  bool over = false;
  for (uint32_t k = 0; k < soter_app_lease_count; k++) {
    over = over || __atomic_load_n(&d->lease[k].ended_ns, __ATOMIC_ACQUIRE) >= 0;
  }
  return over;
}

void soter_posix_begin(soter_posix* d) {
  for (uint32_t k = 0; k < soter_app_lease_count; k++) {
    soter_lease_times* const t = &d->lease[k];
    SOTER_CHECK(soter_app_leases[k].grant->nodes <= APP_BUDGETS);
    SOTER_CHECK(soter_app_leases[k].lease->size <= sizeof t->command);
    soter_grant_begin(&t->grant, soter_app_leases[k].grant, t->done, d->origin_ns);
    soter_lease_init(&t->lease, soter_app_leases[k].lease, t->command);
    t->ended_ns = -1;
    (void)memset(t->old, 0, sizeof t->old);
  }
  for (uint32_t i = 0; i < APP_PROGRAM->modules; i++) {
    d->next_look_ns[i] = SOTER_NEVER;
  }
}

/* ------------------------------------------------------------------ in */

static void publish(soter_posix* d, uint32_t k, int64_t time_ns) {
  soter_outside_times* const o = &d->outside[k];
  const uint32_t topic = soter_app_outside[k].topic;
  const int64_t ct = soter_header_of(&d->state)->ct;
  int64_t stamp = time_ns - d->origin_ns;
  SOTER_CHECK(topic < APP_PROGRAM->topics);
  if (time_ns > soter_posix_clock()) {
    o->future++;
    return;
  }
  stamp = stamp > ct ? ct : stamp; /* measured since: it counts as measured at the instant */
  if (stamp < soter_stamps_of(APP_PROGRAM, &d->state)[topic]) {
    o->older++;
  } else if (soter_publish(APP_PROGRAM, &d->state, topic, d->value, stamp) == SOTER_OK) {
    o->taken++;
  } else {
    o->refused++;
  }
}

/* Plants that are here are actuators: what they read is the law once the lease has ended. */
static void obey(soter_posix* d) {
  for (uint32_t k = 0; k < soter_app_lease_count; k++) {
    soter_lease_times* const t = &d->lease[k];
    if (soter_app_leases[k].apply == NULL) {
      continue;
    }
    SOTER_CHECK(soter_app_leases[k].lease->size <= sizeof d->value);
    (void)soter_lease_read(&t->lease, soter_posix_clock(), d->value);
    SOTER_CHECK(t->lease.state >= SOTER_LEASE_ARMED && t->lease.state <= SOTER_LEASE_ENDED);
    if (t->lease.state == SOTER_LEASE_ENDED) {
      soter_app_leases[k].apply(&d->state, d->value);
      t->law++;
    }
  }
}

void soter_posix_listen(soter_posix* d) {
  for (uint32_t k = 0; k < soter_app_outside_count; k++) {
    soter_outside_times* const o = &d->outside[k];
    int64_t time_ns = 0;
    SOTER_CHECK(o->channel.size <= sizeof d->value);
    if (soter_app_outside[k].inward &&
        soter_outside_read(&o->channel, &time_ns, d->value, &o->bad)) {
      publish(d, k, time_ns);
    }
  }
  obey(d);
}

/* ------------------------------------------------------------------ out */

/* A command with the lease that is in force, if there is one; nothing is sent without. */
static void give(soter_posix* d, uint32_t k) {
  const soter_posix_lease* const l = &soter_app_leases[k];
  soter_lease_times* const t = &d->lease[k];
  soter_posix_lease_head head;
  const int64_t now = soter_posix_clock();
  if (!soter_grant_lease(&t->grant, now, &head.stamp, &head.expiry)) {
    if (t->grant.broken && t->ended_ns < 0) {
      __atomic_store_n(&t->ended_ns, soter_header_of(&d->state)->ct, __ATOMIC_RELEASE);
    }
    return;
  }
  SOTER_CHECK(head.stamp <= now && head.expiry - head.stamp <= l->lease->longest);
  SOTER_CHECK(l->size <= sizeof t->message);
  head.begin = soter_posix_begin_by(d);
  uint8_t* const message = (uint8_t*)t->message;
  (void)memcpy(message, &head, sizeof head);
  l->gather(&d->state, message + sizeof head);
  (void)soter_lease_take(&t->lease, now, message + sizeof head, head.stamp, head.expiry);
  if (t->channel.place[0] != NULL) {
    soter_outside_write(&t->channel, now, message);
  }
  t->given++;
}

/* What a component read and its proof is not about. */
static soter_old_read old_read(soter_posix* d, const soter_posix_lease* l, uint32_t component) {
  const int64_t* const stamps = soter_stamps_of(APP_PROGRAM, &d->state);
  const int64_t ct = soter_header_of(&d->state)->ct;
  soter_old_read found = {NULL, 0};
  for (uint32_t i = 0; i < l->ages && found.of == NULL; i++) {
    const soter_posix_age* const a = &l->age[i];
    SOTER_CHECK(a->topic < APP_PROGRAM->topics);
    const int64_t stamp = stamps[a->topic];
    const bool old = stamp == SOTER_NEVER ? a->outside : ct - stamp > a->most_ns;
    if (a->component == component && old) {
      found = (soter_old_read){a, stamp == SOTER_NEVER ? SOTER_NEVER : ct - stamp};
    }
  }
  return found;
}

/* A node of a grant has run; `out_ns`: when what it says was out. */
static void done(soter_posix* d, uint32_t k, uint32_t n, int64_t start_ns, int64_t out_ns) {
  const soter_posix_lease* const l = &soter_app_leases[k];
  soter_lease_times* const t = &d->lease[k];
  const soter_old_read old = old_read(d, l, l->component[n]);
  SOTER_CHECK(n < APP_BUDGETS);
  if (old.of != NULL) {
    t->stale++; /* not done: a sensor that is late is a part that is late */
    t->old[n] = t->old[n].of == NULL && t->ended_ns < 0 ? old : t->old[n];
    return;
  }
  if (soter_grant_done(&t->grant, n, start_ns, out_ns)) {
    t->old[n].of = NULL; /* no release is missing */
  }
  if (n == SC) {
    give(d, k);
  }
}

void soter_posix_done(soter_posix* d, uint32_t component, int64_t start_ns, int64_t end_ns) {
  SOTER_CHECK(component < APP_PROGRAM->components && start_ns <= end_ns);
  if (soter_components_of(&d->state)[component].latched != 0U) {
    return; /* a step that failed is not done */
  }
  for (uint32_t k = 0; k < soter_app_lease_count; k++) {
    const soter_posix_lease* const l = &soter_app_leases[k];
    for (uint32_t n = 0; n < l->grant->nodes; n++) {
      if (l->component[n] == component) {
        done(d, k, n, start_ns, n == SC ? soter_posix_clock() : end_ns);
      }
    }
  }
}

static void note_old_read(soter_posix* d, const soter_posix_lease* l, const soter_old_read* old) {
  const char* const node = APP_PROGRAM->component[old->of->component].name;
  const char* const topic = APP_PROGRAM->topic[old->of->topic].name;
  SOTER_CHECK(old->of->topic < APP_PROGRAM->topics);
  if (old->age_ns == SOTER_NEVER) {
    soter_posix_note(d, "leases of %s ended as %s read `%s`, which nobody had published", l->name,
                     node, topic);
  } else {
    soter_posix_note(d, "leases of %s ended as %s read `%s` %.3f ms old, of %.3f ms", l->name, node,
                     topic, (double)old->age_ns / 1e6, (double)old->of->most_ns / 1e6);
  }
}

void soter_posix_note_old_reads(soter_posix* d) {
  for (uint32_t k = 0; k < soter_app_lease_count; k++) {
    const soter_lease_times* const t = &d->lease[k];
    SOTER_CHECK(soter_app_leases[k].grant->nodes <= APP_BUDGETS);
    for (uint32_t n = 0; n < soter_app_leases[k].grant->nodes && t->ended_ns >= 0; n++) {
      if (t->old[n].of != NULL) {
        note_old_read(d, &soter_app_leases[k], &t->old[n]);
      }
    }
  }
}

void soter_posix_tell(soter_posix* d) {
  const int64_t ct = soter_header_of(&d->state)->ct;
  for (uint32_t k = 0; k < soter_app_outside_count; k++) {
    const soter_posix_topic* const t = &soter_app_outside[k];
    soter_outside_times* const o = &d->outside[k];
    const int64_t stamp = soter_stamps_of(APP_PROGRAM, &d->state)[t->topic];
    if (!t->inward && stamp != SOTER_NEVER && (o->told == 0U || stamp != o->stamp || stamp == ct)) {
      const uint8_t* const state = (const uint8_t*)&d->state;
      SOTER_CHECK(o->channel.size == APP_PROGRAM->topic[t->topic].size);
      soter_outside_write(&o->channel, d->origin_ns + stamp,
                          state + APP_PROGRAM->topic[t->topic].offset);
      o->told++;
      o->stamp = stamp;
    }
  }
  for (uint32_t k = 0; k < soter_app_lease_count; k++) {
    give(d, k); /* AC's command comes with the lease that is in force */
  }
}
