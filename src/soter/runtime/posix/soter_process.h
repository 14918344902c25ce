/* soter_process.h: descriptors, signals and words of a process that may act.
 *
 * Purpose: no message ends it, or holds it up (docs/deploy.md). Non-goals: SIGKILL, SIGSTOP,
 * faults.
 */
#ifndef SOTER_PROCESS_H
#define SOTER_PROCESS_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

extern int soter_process_stderr; /* where standard error led as the process began */

/* Before there is a thread or an open file: 0, 1 and 2 are opened where they are closed, whoever
 * writes to 1 or 2 never waits: what finds no room is lost; `on_end` is called for every signal
 * that would end the process. False, and said: it cannot run. */
bool soter_process_begin(void (*on_end)(int));

/* A line on standard error, now or never; how many were lost is said with the next one. */
void soter_process_say(const char* format, ...) __attribute__((format(printf, 1, 2)));

/* Nothing acts any more: standard output waits for whoever reads it. Five seconds later the process
 * is gone, whatever holds it up. */
void soter_process_ending(void);

/* The same, and the rest of standard error; `code`, or 1 where the output was not written. */
int soter_process_end(int code);

#ifdef __cplusplus
}
#endif

#endif
