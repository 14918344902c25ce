/* real_time_gaps.c: what a machine takes from a thread that never sleeps (bench/real_time/driver.py).
 *
 * Spins on a processor with the highest real-time priority that is permitted, looks at the clock all
 * the time, and prints how many ns it looked, how many gaps were longer than the limit, their sum, the
 * longest, and how many of instants every `period` would have been late by more than the limit:
 * of a gap of g ns the first g - limit ns. Less than that no driver can reach on this machine.
 */
#define _GNU_SOURCE
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>

#define BURST INT64_C(400000000) /* and a pause: who spins for ever is held up by the kernel */

static int64_t now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

int main(int count, char **words) {
  if (count != 4) {
    return 2;
  }
  cpu_set_t own;
  CPU_ZERO(&own);
  CPU_SET((size_t)atoi(words[1]), &own);
  const int64_t limit = atoll(words[2]) * 1000;
  const struct sched_param most = {.sched_priority = 90};
  const int right = sched_setaffinity(0, sizeof own, &own) == 0 &&
                    sched_setscheduler(0, SCHED_FIFO, &most) == 0;
  mlockall(MCL_CURRENT | MCL_FUTURE);
  int64_t looked = 0, gaps = 0, sum = 0, worst = 0, late = 0;
  for (int burst = atoi(words[3]); burst > 0; burst--) {
    int64_t last = now();
    const int64_t end = last + BURST;
    while (last < end) {
      const int64_t t = now(), gap = t - last;
      if (gap > limit) {
        gaps++;
        sum += gap;
        late += gap - limit;
        worst = gap > worst ? gap : worst;
      }
      last = t;
    }
    looked += BURST;
    const struct timespec pause = {0, 100000000};
    nanosleep(&pause, NULL);
  }
  printf("%d %lld %lld %lld %lld %lld\n", right, (long long)looked, (long long)gaps, (long long)sum,
         (long long)late, (long long)worst);
  return 0;
}
