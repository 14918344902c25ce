/* Two threads share the tasks of a round.
 * Purpose: call the task function once for each number, on two threads where there are many tasks.
 * Non-goals: what a task does; its result never depends on who does it. */
#define _POSIX_C_SOURCE 200809L

#include "soter_reach_thread_pool.h"
#include "soter_check.h"

#include <string.h>
#include <time.h>

enum { CHUNK = 4, ALONE = 24, SPINS = 4000 };

double soter_reach_clock(void) {
  struct timespec t;
  (void)clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void do_tasks(soter_crew* crew, int who) {
  for (;;) {
    const int64_t k = __atomic_fetch_add(&crew->next, CHUNK, __ATOMIC_SEQ_CST);
    const int64_t end = __atomic_load_n(&crew->end, __ATOMIC_SEQ_CST);
    const int64_t stop = k + CHUNK < end ? k + CHUNK : end;
    SOTER_CHECK(k >= 0 && (who == 0 || who == 1));
    if (k >= end) {
      return;
    }
    for (int64_t i = k; i < stop; i++) {
      crew->task(crew, who, i);
    }
    if (soter_reach_clock() > crew->until) { /* the rest is for another call */
      (void)pthread_mutex_lock(&crew->lock);
      const int64_t next = __atomic_load_n(&crew->next, __ATOMIC_SEQ_CST);
      if (next < crew->end) { /* what the other one has just taken may be done twice: harmless */
        __atomic_store_n(&crew->end, next, __ATOMIC_SEQ_CST);
      }
      (void)pthread_mutex_unlock(&crew->lock);
      return;
    }
  }
}

static void* run_helper(void* argument) {
  soter_crew* crew = argument;
  int seen = 0;
  for (;;) {
    for (int spin = 0; spin < SPINS && __atomic_load_n(&crew->round, __ATOMIC_ACQUIRE) == seen;
         spin++) {
    }
    (void)pthread_mutex_lock(&crew->lock);
    while (crew->round == seen) {
      (void)pthread_cond_wait(&crew->wake, &crew->lock);
    }
    seen = crew->round;
    (void)pthread_mutex_unlock(&crew->lock);
    if (crew->quit) {
      return 0;
    }
    do_tasks(crew, 1);
    (void)pthread_mutex_lock(&crew->lock);
    SOTER_CHECK(crew->busy == 1 && crew->round == seen); /* nobody begins before this one ended */
    __atomic_store_n(&crew->busy, 0, __ATOMIC_RELEASE);
    (void)pthread_cond_signal(&crew->done);
    (void)pthread_mutex_unlock(&crew->lock);
  }
}

int soter_crew_begin(soter_crew* crew, void (*task)(soter_crew*, int, int64_t), void* job,
                     double seconds, int threads) {
  SOTER_CHECK(threads <= SOTER_REACH_THREADS);
  memset(crew, 0, sizeof *crew);
  crew->task = task;
  crew->job = job;
  crew->until = soter_reach_clock() + seconds;
  crew->threads = threads;
  if (threads > 1) {
    (void)pthread_mutex_init(&crew->lock, 0);
    (void)pthread_cond_init(&crew->wake, 0);
    (void)pthread_cond_init(&crew->done, 0);
    if (pthread_create(&crew->thread, 0, run_helper, crew) != 0) {
      crew->threads = 1;
    }
  }
  return crew->threads;
}

static void start_round(soter_crew* crew) {
  (void)pthread_mutex_lock(&crew->lock);
  SOTER_CHECK(crew->threads > 1 && crew->busy == 0);
  crew->busy = 1;
  __atomic_store_n(&crew->round, crew->round + 1, __ATOMIC_RELEASE);
  (void)pthread_cond_signal(&crew->wake);
  (void)pthread_mutex_unlock(&crew->lock);
}

/* Does the tasks begin..end-1; returns the first one that was not begun. */
int64_t soter_crew_run(soter_crew* crew, int64_t begin, int64_t end) {
  SOTER_CHECK(begin >= 0 && crew->task != 0);
  if (crew->threads < 2 || end - begin < ALONE) {
    int64_t k = begin;
    for (; k < end; k++) {
      crew->task(crew, 0, k);
      if ((k & 3) == 3 && soter_reach_clock() > crew->until) {
        return k + 1;
      }
    }
    return end;
  }
  crew->next = begin;
  crew->end = end;
  start_round(crew);
  do_tasks(crew, 0);
  for (int spin = 0; spin < SPINS && __atomic_load_n(&crew->busy, __ATOMIC_ACQUIRE); spin++) {
  }
  (void)pthread_mutex_lock(&crew->lock);
  while (crew->busy) {
    (void)pthread_cond_wait(&crew->done, &crew->lock);
  }
  (void)pthread_mutex_unlock(&crew->lock);
  SOTER_CHECK(crew->end <= end && crew->next >= crew->end); /* what is below was begun */
  return crew->end;
}

void soter_crew_end(soter_crew* crew) {
  if (crew->threads > 1) {
    crew->quit = 1;
    start_round(crew);
    (void)pthread_join(crew->thread, 0);
    (void)pthread_cond_destroy(&crew->wake);
    (void)pthread_cond_destroy(&crew->done);
    (void)pthread_mutex_destroy(&crew->lock);
  }
}
