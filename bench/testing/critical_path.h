/* critical_path.h: how long a search on several threads would take on as many free cores.
 *
 * Purpose: before every source of the explorer (`-include`), for size.py: the CPU time of the
 * slowest thread between two waits for all, summed up. On a machine that others use, too, this is
 * told apart from their work; what waking a thread takes is not in it.
 * Non-goals: a measurement in what is shipped.
 */
#ifndef CRITICAL_PATH_H
#define CRITICAL_PATH_H
#define _GNU_SOURCE /* what any of the sources asks the system for */
#include <pthread.h>
#include <time.h>

/* Shared, and only touched under the mutex of the wait. */
__attribute__((weak)) double critical_path_s, slowest_s;
__attribute__((weak)) __thread double began_s;

__attribute__((unused)) static double path_thread_s(void) {
  struct timespec now;
  (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

__attribute__((unused)) static void path_arrive(void) {
  const double took = path_thread_s() - began_s;
  slowest_s = took > slowest_s ? took : slowest_s;
}

__attribute__((unused)) static int wait_told(pthread_cond_t* turn, pthread_mutex_t* mutex) {
  path_arrive();
  const int failed = (pthread_cond_wait)(turn, mutex);
  began_s = path_thread_s();
  return failed;
}

__attribute__((unused)) static int broadcast_told(pthread_cond_t* turn) {
  path_arrive();
  critical_path_s += slowest_s;
  slowest_s = 0.0;
  const int failed = (pthread_cond_broadcast)(turn);
  began_s = path_thread_s();
  return failed;
}

#define pthread_cond_wait(turn, mutex) wait_told(turn, mutex)
#define pthread_cond_broadcast(turn) broadcast_told(turn)
#endif
