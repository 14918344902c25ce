/* A few threads over a list of tasks, for one call.
 * Purpose: declare the threads. Which of them takes which task never matters: tasks read what the
 * last round left and write their own cells only.
 * Non-goals: threads that outlive a call. */
#ifndef SOTER_REACH_THREAD_POOL_H
#define SOTER_REACH_THREAD_POOL_H

#include <pthread.h>
#include <stdint.h>

enum { SOTER_REACH_THREADS = 2 };

typedef struct soter_crew soter_crew;

struct soter_crew {
  pthread_mutex_t lock;
  pthread_cond_t wake, done;
  void (*task)(soter_crew* crew, int who, int64_t k);
  void* job;
  int64_t next, end;
  double until; /* seconds of the monotonic clock; no task is begun later */
  int round, busy, quit, threads;
  pthread_t thread;
};

double soter_reach_clock(void);
int soter_crew_begin(soter_crew* crew, void (*task)(soter_crew*, int, int64_t), void* job,
                     double seconds, int threads);
int64_t soter_crew_run(soter_crew* crew, int64_t begin, int64_t end);
void soter_crew_end(soter_crew* crew);

#endif
