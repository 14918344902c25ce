/* dds_harness.c: in the place of the trusted part, behind the bridge.
 *
 * Purpose: reads the channels `odom` and `scan` that the bridge writes, checks every number of each
 * value against its counter, and answers in `echo`; says at SIGTERM what it counted.
 * Non-goals: DDS, of which it knows nothing.
 */
#define _GNU_SOURCE
#include "dds_fields.h"
#include "dds_values.h"
#include "harness_code.h"
#include "soter_outside.h"

#include <pthread.h>
#include <signal.h>
#include <string.h>
#include <time.h>

static volatile sig_atomic_t ending = 0;
static void on_signal(int number) {
  (void)number;
  ending = 1;
}

static pthread_mutex_t held = PTHREAD_MUTEX_INITIALIZER;
static soter_outside odom, scan, echo;
static unsigned long odoms, scans, misread, later, not_finite;
static const char* first = "";

/* Two values with one time are one to a channel's reader: times go up. */
static void answer(int64_t time, uint32_t k) {
  static int64_t last = 0;
  ECHO_VALUE value;
  (void)memset(&value, 0, sizeof value);
  fill_echo(&value, k);
  last = time;
  soter_outside_write(&echo, last, &value);
}

static void counted(unsigned long* many, const char* wrong, int64_t time) {
  struct timespec now;
  (void)clock_gettime(CLOCK_MONOTONIC, &now);
  (*many)++;
  misread += wrong != NULL;
  first = wrong != NULL && first[0] == '\0' ? wrong : first;
  later += time > (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static void* serve_scan(void* given) {
  SCAN_VALUE value;
  int64_t time = 0;
  (void)given;
  while (ending == 0) {
    soter_outside_wait(&scan, 5000000);
    if (soter_outside_read(&scan, &time, &value, NULL)) {
      const uint32_t k = (uint32_t)value.about.at[0];
      (void)pthread_mutex_lock(&held);
      counted(&scans, check_scan_value(&value, k), time);
      answer(time, k);
      (void)pthread_mutex_unlock(&held);
    }
  }
  return NULL;
}

int main(int count, char** words) {
  pthread_t thread;
  ODOM_VALUE value;
  int64_t time = 0;
  (void)signal(SIGTERM, on_signal);
  if (count != 2 ||
      soter_outside_open(&odom, words[1], "odom", ODOM_HASH, sizeof(ODOM_VALUE), false) != NULL ||
      soter_outside_open(&scan, words[1], "scan", SCAN_HASH, sizeof(SCAN_VALUE), false) != NULL ||
      soter_outside_open(&echo, words[1], "echo", ECHO_HASH, sizeof(ECHO_VALUE), true) != NULL ||
      pthread_create(&thread, NULL, serve_scan, NULL) != 0) {
    return 1;
  }
  (void)fprintf(stderr, "harness runs\n");
  while (ending == 0) {
    soter_outside_wait(&odom, 5000000);
    if (soter_outside_read(&odom, &time, &value, NULL)) {
      if (!(value.position.at[0] >= 0.0 && value.position.at[0] < 4.0e9)) {
        not_finite++; /* bits are checked by the bench, from the file of the channel */
        continue;
      }
      const uint32_t k = (uint32_t)value.position.at[0];
      (void)pthread_mutex_lock(&held);
      counted(&odoms, check_odom_value(&value, k), time);
      answer(time, k);
      (void)pthread_mutex_unlock(&held);
    }
  }
  (void)pthread_join(thread, NULL);
  (void)printf("{\"odom\":%lu,\"scan\":%lu,\"misread\":%lu,\"later\":%lu,\"not_finite\":%lu,"
               "\"first\":\"%s\"}\n",
               odoms, scans, misread, later, not_finite, first);
  return 0;
}
