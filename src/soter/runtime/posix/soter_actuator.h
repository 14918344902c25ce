/* soter_actuator.h: the process of the actuators: what they obey, and what they were told.
 *
 * Purpose: the tables that soter generates (soter_actuator_app.c), and the one function that is
 * yours (actuate.c). Non-goals: the program, the kernel: neither is needed.
 */
#ifndef SOTER_ACTUATOR_H
#define SOTER_ACTUATOR_H

#include "soter_lease.h"

#include <stddef.h>

/* An output of a module: a channel of its name. */
typedef struct {
  const char* name;
  uint64_t hash;
  size_t offset; /* in the command */
  size_t size;
} soter_actuator_topic;

typedef struct {
  const char* name;
  const char* channel; /* that commands come in */
  uint64_t hash;
  size_t size; /* of a message: stamp, expiry, the command */
  const soter_lease_info* lease;
  const soter_actuator_topic* topic;
  uint32_t topics;
} soter_actuator_module;

extern const soter_actuator_module soter_actuator_modules[];
extern const uint32_t soter_actuator_count;

/* Yours: give `command`, one of PREFIX_lease.h, to the devices of a module. Called in every turn of
 * the loop, whether it is a command that was taken (`obeys`) or the law. It has to return at once.
 */
void soter_actuate(uint32_t module, const void* command, bool obeys);

/* soter_actuator_arm.c: CLOCK_MONOTONIC; and asks actuators that run to be armed again: the exit
 * code of the command. */
int64_t soter_actuator_clock(void);
int soter_actuator_request(const char* folder, bool unchecked);

#endif
