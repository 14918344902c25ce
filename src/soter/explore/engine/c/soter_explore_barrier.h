/* soter_explore_barrier.h: where all threads of a search wait for each other.
 *
 * Purpose: a wait of microseconds, of which a search of small layers has thousands.
 * Non-goals: work that is handed to threads (there is none: each has its own).
 */
#ifndef SOTER_EXPLORE_BARRIER_H
#define SOTER_EXPLORE_BARRIER_H

#include <pthread.h>

#include "soter.h"

typedef struct {
  pthread_mutex_t mutex;
  pthread_cond_t turn;
  uint32_t threads; /* 0: it is not known yet how many */
  uint32_t waiting;
  uint32_t turns; /* how often all have come */
  uint32_t spins; /* looks at `turns` before a thread sleeps */
} soter_barrier;

/* How often on end a thread looked in vain, and slept. */
typedef uint32_t soter_patience;

void soter_barrier_open(soter_barrier* b);
void soter_barrier_close(soter_barrier* b);

/* The first thread says how many they are; the others wait until it does. */
void soter_barrier_begin(soter_barrier* b, uint32_t threads);
void soter_barrier_enter(soter_barrier* b);

/* Waits until all have come; the last one calls `last`, if it is not NULL, before anybody goes on.
 * What a thread wrote before, others see afterwards. `patience` is the thread's own, 0 first. */
void soter_barrier_wait(soter_barrier* b, soter_patience* patience, void (*last)(void* to),
                        void* to);

#endif
