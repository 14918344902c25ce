/* soter_explore_barrier.c: see soter_explore_barrier.h.
 *
 * Purpose: where layers are small the others come within microseconds, and waking a thread takes
 * longer: who waits looks for a while whether they have, and sleeps then. Who has slept a few times
 * on end, because others have the processors, looks rarely.
 * Non-goals: what is done between two waits (soter_explore_bfs.c).
 */
#define _GNU_SOURCE /* the processors that this process may use */
#include "soter_explore_barrier.h"

#include <sched.h>
#include <unistd.h>

#define SPINS 4000U /* looks, some 100 us, before a thread sleeps, */
#define FEW 4U      /* unless so many were in vain: then only at every */
#define RARELY 16U  /* such wait */

/* A thread that waits awake would only keep others from a processor where there are too few. */
static uint32_t spins_of(uint32_t threads) {
  long processors = 1;
#if defined(__linux__)
  cpu_set_t usable;
  processors = sched_getaffinity(0, sizeof usable, &usable) == 0 ? CPU_COUNT(&usable) : 1;
#elif defined(_SC_NPROCESSORS_ONLN)
  processors = sysconf(_SC_NPROCESSORS_ONLN);
#endif
  return (long)threads <= processors ? SPINS : 0U;
}

void soter_barrier_open(soter_barrier* b) {
  b->threads = b->waiting = b->turns = b->spins = 0U;
  (void)pthread_mutex_init(&b->mutex, NULL);
  (void)pthread_cond_init(&b->turn, NULL);
}

void soter_barrier_close(soter_barrier* b) {
  SOTER_CHECK(b->waiting == 0U);
  (void)pthread_cond_destroy(&b->turn);
  (void)pthread_mutex_destroy(&b->mutex);
}

void soter_barrier_begin(soter_barrier* b, uint32_t threads) {
  SOTER_CHECK(threads > 0U);
  (void)pthread_mutex_lock(&b->mutex);
  b->threads = threads;
  b->spins = spins_of(threads);
  __atomic_store_n(&b->turns, 1U, __ATOMIC_RELEASE);
  (void)pthread_cond_broadcast(&b->turn);
  (void)pthread_mutex_unlock(&b->mutex);
}

/* Whether all have come since: written under the mutex, and read by those who look without it. */
static bool turned(const soter_barrier* b, uint32_t turn) {
  return __atomic_load_n(&b->turns, __ATOMIC_ACQUIRE) != turn;
}

static bool spin(const soter_barrier* b, uint32_t turn, uint32_t spins) {
  for (uint32_t k = 0; k < spins && !turned(b, turn); k++) {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    __asm volatile("yield");
#endif
  }
  return turned(b, turn);
}

static void sleep_until(soter_barrier* b, uint32_t turn) {
  (void)pthread_mutex_lock(&b->mutex);
  while (!turned(b, turn)) {
    (void)pthread_cond_wait(&b->turn, &b->mutex);
  }
  (void)pthread_mutex_unlock(&b->mutex);
}

/* Awake at first: the system gave it a processor of its own as it was made. */
void soter_barrier_enter(soter_barrier* b) {
  if (!spin(b, 0U, SPINS)) {
    sleep_until(b, 0U);
  }
}

/* Whether it is the last one that arrives. */
static bool arrive(soter_barrier* b, void (*last)(void* to), void* to) {
  SOTER_CHECK(b->waiting < b->threads);
  if (++b->waiting < b->threads) {
    return false;
  }
  b->waiting = 0U;
  if (last != NULL) {
    last(to);
  }
  __atomic_store_n(&b->turns, b->turns + 1U, __ATOMIC_RELEASE);
  (void)pthread_cond_broadcast(&b->turn);
  return true;
}

void soter_barrier_wait(soter_barrier* b, soter_patience* patience, void (*last)(void* to),
                        void* to) {
  const bool looks = *patience < FEW || *patience % RARELY == 0U;
  (void)pthread_mutex_lock(&b->mutex);
  const uint32_t turn = b->turns;
  const bool was_last = arrive(b, last, to);
  (void)pthread_mutex_unlock(&b->mutex);
  if (was_last) {
    return;
  }
  if (spin(b, turn, looks ? b->spins : 0U)) {
    *patience = looks ? 0U : *patience;
  } else {
    *patience += 1U;
    sleep_until(b, turn);
  }
}
