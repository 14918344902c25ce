/* soter_recording.h: values of topics from outside, out of a file of the emulator's host.
 *
 * Purpose: what a run in virtual time gives to topics that nobody publishes in it. A line is a
 * value: when it was measured (ns), the number of its topic, and its bytes as they lie in memory,
 * hexadecimal; lines are in order of time. Non-goals: who records (`soter build`).
 */
#ifndef SOTER_RECORDING_H
#define SOTER_RECORDING_H

#include "soter.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
  int32_t file;        /* -1: there is none, or it was read to its end */
  uint32_t at, filled; /* of `room` */
  bool waits;          /* a line was read whose time has not come */
  int64_t measured;    /* of that line */
  uint32_t topic;
  char room[64];
} soter_recording;

void soter_recording_open(soter_recording* r, const char* file);

/* Publishes, before the instant at `next`, what was measured until then. */
void soter_recording_publish(soter_recording* r, const soter_program* p, void* state, int64_t next);

#ifdef __cplusplus
}
#endif

#endif
