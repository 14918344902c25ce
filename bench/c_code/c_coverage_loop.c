/* c_coverage_loop.c: a program in a loop that tells wrong times and wrong values, and leases.
 *
 * Purpose: what of soter_firmware.c, soter_grant.c and soter_lease.c is reached when their callers
 * do all that they may, and much that they may not. Nothing here asks whether what comes out is
 * right. Non-goals: tests: those are elsewhere.
 */
#include "soter_firmware.h"
#include "soter_grant.h"
#include "soter_lease.h"

#include <fenv.h>
#include <stdlib.h>
#include <string.h>

#define ROOM 65536U
#define FAR (INT64_C(1) << 62)
#define COMMAND 8U
#define NODES 3U

void covered_loop(const soter_program* p, uint64_t (*next)(void));

/* A time near `at`, or one that no clock has. */
static int64_t some_time(int64_t at, uint64_t (*next)(void)) {
  switch (next() % 12U) {
    case 0U:
      return at - (int64_t)(next() % 60000000U);
    case 1U:
      return next() % 2U == 0U ? FAR : -FAR;
    default:
      return at + (int64_t)(next() % 15000000U);
  }
}

static void publish(soter_firmware* f, void* state, uint64_t (*next)(void)) {
  static double value[ROOM / sizeof(double)];
  static const double numbers[] = {0.0, 1.0, -1.0, 1e9, -40.0};
  for (size_t i = 0; i < sizeof value / sizeof *value; i++) {
    value[i] = numbers[next() % (sizeof numbers / sizeof *numbers)];
  }
  if (next() % 4U == 0U) {
    (void)memset(value, next() % 2U == 0U ? 0xff : 0x7f, 64U);
  }
  const uint32_t topic = f->program == NULL ? 0U : (uint32_t)(next() % f->program->topics);
  const int64_t now = next() % 8U == 0U ? some_time(f->now, next) : f->now;
  const int64_t measured = next() % 3U == 0U ? some_time(now, next) : now;
  if (f->program == NULL || f->program->topic[topic].size <= sizeof value) {
    (void)soter_firmware_publish(f, state, topic, value, measured, now);
  }
}

static void firmware(const soter_program* p, uint64_t (*next)(void)) {
  unsigned char* const state = (unsigned char*)malloc(p->state_size);
  int64_t* const late = (int64_t*)malloc(p->components * sizeof *late);
  uint32_t outside[64];
  soter_read_age ages[16];
  if (state == NULL || late == NULL) {
    abort();
  }
  soter_firmware f;
  (void)memset(&f, 0, sizeof f);
  for (uint32_t i = 0; i < p->components; i++) {
    late[i] = (int64_t)(next() % 3U) * 2000000 - 1;
  }
  for (uint32_t i = 0; i < 64U; i++) {
    outside[i] = i;
  }
  for (uint32_t i = 0; i < 16U; i++) {
    ages[i].component = (uint32_t)(next() % p->components);
    ages[i].topic = p->topics > 0U ? (uint32_t)(next() % p->topics) : 0U;
    ages[i].most = (int64_t)(next() % 40000000U);
  }
  f.ages = ages;
  f.age_count = p->topics > 0U ? 16U : 0U;
  f.late = late;
  f.outside = outside;
  f.outside_count = p->topics < 64U ? p->topics : 64U;
  publish(&f, state, next);
  (void)soter_firmware_step(&f, state, 5);
  (void)soter_firmware_next(&f, state);
  (void)soter_firmware_stamp(&f, 3, NULL);
  (void)soter_firmware_start(&f, p, state, next(), FAR);
  (void)soter_firmware_start(&f, p, state, next(), -FAR);
  (void)fesetround(FE_UPWARD);
  const char* const refused = soter_firmware_start(&f, p, state, next(), 0);
  (void)fesetround(FE_TONEAREST);
  if (refused == NULL) {
    abort();
  }
  if (soter_firmware_start(&f, p, state, next(), (int64_t)(next() % 1000000U)) != NULL) {
    abort();
  }
  for (uint32_t i = 0; i < 2000U; i++) {
    int64_t time = 0;
    (void)soter_firmware_stamp(&f, next() % 2U == 0U ? SOTER_NEVER : 7, &time);
    publish(&f, state, next);
    int64_t now = soter_firmware_next(&f, state) + (int64_t)(next() % 9000000U);
    if (next() % 50U == 0U) {
      now = some_time(f.now, next);
    }
    (void)soter_firmware_step(&f, state, now);
  }
  soter_header_of(state)->ct = INT64_C(1) << 61; /* as after 73 years */
  for (uint32_t i = 0; i < p->components; i++) {
    soter_components_of(state)[i].next = FAR;
    if (p->component[i].effect != NULL) {
      soter_stamps_of(p, state)[p->component[i].held] = SOTER_NEVER;
    }
  }
  (void)soter_firmware_next(&f, state);
  free(late);
  free(state);
}

static void leases(uint64_t (*next)(void)) {
  static const unsigned char law[COMMAND] = {0};
  const soter_lease_info lease_info = {law, COMMAND, 40};
  soter_budget budget[NODES] = {{20, 0, 2, 2}, {10, 0, 3, 2}, {10, 5, 1, 1}};
  budget[0].phase = (int64_t)(next() % 4U) * 4;
  const soter_grant_info grant_info = {budget, NODES};
  unsigned char command[COMMAND];
  unsigned char given[COMMAND] = {1};
  int64_t done[NODES];
  soter_lease lease;
  soter_grant grant;
  soter_lease_init(&lease, &lease_info, command);
  for (uint32_t round = 0; round < 40U; round++) {
    const int64_t origin = (int64_t)(next() % 3U) * 100;
    int64_t now = origin;
    soter_grant_begin(&grant, &grant_info, done, origin);
    if (next() % 2U == 0U) {
      soter_grant_init(&grant, &grant_info, done);
    }
    for (uint32_t i = 0; i < 60U; i++) {
      uint32_t node = 0;
      for (uint32_t k = 1; k < NODES; k++) { /* who is due first */
        if (soter_grant_next(&grant, k) < soter_grant_next(&grant, node)) {
          node = k;
        }
      }
      if (next() % 8U == 0U) {
        node = (uint32_t)(next() % NODES);
      }
      const int64_t release = soter_grant_next(&grant, node);
      const int64_t start = release > now ? release : now;
      const int64_t wrong = (int64_t)(next() % 7U) - 3;
      const int64_t begins = next() % 40U == 0U ? start + wrong : start;
      const int64_t out = next() % 40U == 0U ? begins + wrong : begins + 1;
      (void)soter_grant_done(&grant, node, begins, out);
      now = out > now ? out : now;
      int64_t stamp = 0;
      int64_t expiry = 0;
      if (soter_grant_lease(&grant, now, &stamp, &expiry) || next() % 2U == 0U) {
        const int64_t told = next() % 20U == 0U ? stamp + wrong * 20 : stamp;
        const int64_t until = next() % 20U == 0U ? expiry + wrong * 30 : expiry;
        (void)soter_lease_take(&lease, now, given, told, until);
        (void)soter_lease_take(&lease, now, given, told, until - 1); /* sooner than it was said */
      }
      (void)soter_lease_read(&lease, now + (next() % 25U == 0U ? 100 : wrong), given);
      if (lease.state == SOTER_LEASE_ENDED && next() % 4U == 0U) {
        soter_lease_arm(&lease);
      }
    }
    soter_lease_init(&lease, &lease_info, command);
  }
}

void covered_loop(const soter_program* p, uint64_t (*next)(void)) {
  firmware(p, next);
  leases(next);
}
