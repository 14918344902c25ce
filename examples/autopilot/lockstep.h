/* lockstep.h: what the autopilot's process and ours say to each other, a step at a time.
 *
 * Purpose: two packets over a pipe of each direction. Both ends run on one machine and are compiled
 * by one compiler, so the bytes of a struct are the message; MAGIC changes when a struct does.
 *
 * Nothing of the firmware stands here: this file is the project's own, under its MIT licence.
 */
#ifndef LOCKSTEP_H
#define LOCKSTEP_H

#include <stdint.h>

#define LOCKSTEP_MAGIC 0x50414C31u
#define LOCKSTEP_STEP_US 1000 /* of simulated time a step */
#define LOCKSTEP_CHANNELS 6   /* roll, pitch, throttle, yaw, arm, angle mode */

/* What is asked of the autopilot's process. */
typedef enum {
  LOCKSTEP_BEGIN = 1, /* a new flight, from the state after power-up: answers with a copy of it */
  LOCKSTEP_STEP = 2,  /* sensors and sticks in, motors out */
  LOCKSTEP_END = 3    /* the flight is over; no answer */
} lockstep_kind;

/* Frames: x ahead, y left, z up (body); x east, y north, z up (world); quaternion body to world. */
typedef struct {
  uint32_t magic, kind;
  double gyro[3];     /* rad/s, body */
  double force[3];    /* m/s^2, body: acceleration less gravity */
  double attitude[4]; /* w, x, y, z */
  double position[3], velocity[3];
  double pressure; /* Pa */
  uint16_t sticks[LOCKSTEP_CHANNELS], spare[2];
} lockstep_request;

typedef struct {
  uint32_t magic, armed;
  uint32_t arming_disabled; /* the firmware's reasons, a bit each; 0: it may be armed */
  uint32_t angle_mode;
  double motors[4]; /* 0 to 1: rear right, front right, rear left, front left */
} lockstep_answer;

/* First of all the autopilot's process says who it is. */
typedef struct {
  uint32_t magic, size_of_request;
  char version[32]; /* the firmware's own, such as 4.6.0 */
  char sources[72]; /* SHA-256 over the source files that it was compiled from, in hex */
} lockstep_hello;

#endif
