/* betaflight_lockstep.c: Betaflight's simulator target in lock-step, an executable of its own.
 *
 * Purpose: the firmware's own `sitl.c`, unmodified, included with its clock, sleeps, threads and
 * sockets replaced by macros, and a main loop that reads a request from a pipe, lets the firmware's
 * scheduler run for that time, and answers the motors. So a flight is a function of what is sent.
 * A flight is a copy (fork) of the process after power-up: power-up takes 6 s of simulated time.
 *
 * Licence: this file is the project's own and, like all of it, under the MIT licence, which is
 * compatible with the GPL. What is compiled from it together with Betaflight is a derived work of
 * Betaflight: that executable as a whole is under the GNU GPL, version 3 or later. It is built on
 * the machine that flies it, it is not part of this repository, and nothing here is linked to it:
 * both ends speak over a pipe.
 *
 * Non-goals: the firmware's estimator of attitude: its simulator target takes the attitude that it
 * is told (USE_IMU_CALC is not defined there). Radio, GPS, telemetry.
 */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "lockstep.h"
#include "udplink.h"

#define LOCKSTEP_SCHEDULER_NS 50000LL /* of simulated time a call of the firmware's scheduler */
#define LOCKSTEP_POWER_UP_MS 6500     /* the firmware lets nobody arm in its first 6 s */

static long long lockstep_now = 1000000000LL; /* ns of simulated time */

static int lockstep_clock(int which, struct timespec* t) {
  (void)which;
  t->tv_sec = lockstep_now / 1000000000LL;
  t->tv_nsec = lockstep_now % 1000000000LL;
  return 0;
}

static int lockstep_sleep(const struct timespec* time, struct timespec* left) {
  (void)left;
  lockstep_now += time->tv_sec * 1000000000LL + time->tv_nsec;
  return 0;
}

/* The firmware's configuration: never that of an earlier flight, and never a file that stays. */
static FILE* lockstep_open(const char* mode) {
  return mode[0] == 'w' ? tmpfile() : NULL;
}

#define clock_gettime lockstep_clock
#define nanosleep lockstep_sleep
#define pthread_create(a, b, c, d) (0 * sizeof(c))
#define udpInit(a, b, c, d) 0
#define udpSend(a, b, c) 0
#define fopen(path, mode) lockstep_open(mode)
#include "src/platform/SIMULATOR/sitl.c"
#undef clock_gettime
#undef fopen

/* The firmware's own little network library is left out of the link: no port is opened. */
dyad_Stream* dyad_newStream(void) {
  return NULL;
}
int dyad_listenEx(dyad_Stream* s, const char* host, int port, int backlog) {
  (void)s, (void)host, (void)port, (void)backlog;
  return -1;
}
void dyad_addListener(dyad_Stream* s, int event, dyad_Callback f, void* data) {
  (void)s, (void)event, (void)f, (void)data;
}
void dyad_write(dyad_Stream* s, const void* data, int size) {
  (void)s, (void)data, (void)size;
}
void dyad_setTimeout(dyad_Stream* s, double seconds) {
  (void)s, (void)seconds;
}
void dyad_setNoDelay(dyad_Stream* s, int on) {
  (void)s, (void)on;
}
void dyad_close(dyad_Stream* s) {
  (void)s;
}
void dyad_init(void) {}
void dyad_update(void) {}
void dyad_shutdown(void) {}
void dyad_setTickInterval(double seconds) {
  (void)seconds;
}
void dyad_setUpdateTimeout(double seconds) {
  (void)seconds;
}

#include "build/version.h"
#include "fc/core.h"
#include "fc/init.h"
#include "fc/rc_controls.h"
#include "fc/rc_modes.h"
#include "fc/runtime_config.h"
#include "rx/rx.h"

#ifndef LOCKSTEP_SOURCES
#error "LOCKSTEP_SOURCES is the hash of the firmware's sources: build with firmware.py"
#endif

static void lockstep_switch(int at, boxId_e mode, int channel, int from) {
  modeActivationCondition_t* const m = modeActivationConditionsMutable(at);
  m->modeId = mode;
  m->auxChannelIndex = channel;
  m->range.startStep = CHANNEL_VALUE_TO_STEP(from);
  m->range.endStep = CHANNEL_VALUE_TO_STEP(2100);
}

/* A pilot's set-up: arm on the first switch, angle mode on the second; sticks come from our side.
 */
static void lockstep_init(void) {
  init();
  lockstep_switch(0, BOXARM, 0, 1700);
  lockstep_switch(1, BOXANGLE, 1, 900);
  analyzeModeActivationConditions();
  rxRuntimeState.channelCount = SIMULATOR_MAX_RC_CHANNELS;
  rxRuntimeState.rcReadRawFn = readRCSITL;
  rxRuntimeState.rcFrameStatusFn = rxRCFrameStatus;
  rxRuntimeState.rxProvider = RX_PROVIDER_UDP;
}

/* What the sensors say. The simulator target wants other signs than ours: see Gazebo's plugin. */
static void lockstep_sense(const lockstep_request* in) {
  fdm_packet p;
  memset(&p, 0, sizeof p);
  p.timestamp = (double)lockstep_now * 1e-9;
  for (int i = 0; i < 3; i++) {
    p.imu_angular_velocity_rpy[i] = i == 0 ? in->gyro[i] : -in->gyro[i];
    p.imu_linear_acceleration_xyz[i] = -in->force[i];
    p.position_xyz[i] = in->position[i];
    p.velocity_xyz[i] = in->velocity[i];
  }
  for (int i = 0; i < 4; i++) {
    p.imu_orientation_quat[i] = i < 2 ? in->attitude[i] : -in->attitude[i];
  }
  p.pressure = in->pressure;
  updateState(&p);
}

static void lockstep_step(const lockstep_request* in, lockstep_answer* out) {
  for (int i = 0; i < SIMULATOR_MAX_RC_CHANNELS; i++) {
    rcPkt.channels[i] = i < LOCKSTEP_CHANNELS ? in->sticks[i] : 1000;
  }
  lockstep_sense(in);
  simRate = 1.0; /* the simulator's time is the firmware's */
  const long long until = lockstep_now + LOCKSTEP_STEP_US * 1000LL;
  while (lockstep_now < until) {
    scheduler();
    lockstep_now += LOCKSTEP_SCHEDULER_NS;
  }
  out->magic = LOCKSTEP_MAGIC;
  out->armed = ARMING_FLAG(ARMED) ? 1 : 0;
  out->arming_disabled = getArmingDisableFlags();
  out->angle_mode = FLIGHT_MODE(ANGLE_MODE) ? 1 : 0;
  for (int i = 0; i < 4; i++) {
    out->motors[i] = motorsPwm[i] / 1000.0;
  }
}

/* Level and still on the ground, sticks down, disarmed. */
static void lockstep_power_up(void) {
  lockstep_request in = {.force = {0.0, 0.0, 9.80665},
                         .attitude = {1.0, 0.0, 0.0, 0.0},
                         .pressure = 101325.0,
                         .sticks = {1500, 1500, 1000, 1500, 1000, 2000}};
  lockstep_answer out;
  for (int i = 0; i < LOCKSTEP_POWER_UP_MS; i++) {
    lockstep_step(&in, &out);
  }
}

static int lockstep_whole(int (*move)(int, void*, size_t), int fd, void* bytes, size_t size) {
  for (size_t done = 0; done < size;) {
    const int n = move(fd, (char*)bytes + done, size - done);
    if (n <= 0) {
      return 0;
    }
    done += (size_t)n;
  }
  return 1;
}

static int lockstep_read(int fd, void* bytes, size_t size) {
  return (int)read(fd, bytes, size);
}
static int lockstep_write(int fd, void* bytes, size_t size) {
  return (int)write(fd, bytes, size);
}

/* Serves requests until the flight is over, or the other end is gone. */
static void lockstep_fly(int from, int to) {
  lockstep_request in;
  lockstep_answer out;
  memset(&out, 0, sizeof out);
  while (lockstep_whole(lockstep_read, from, &in, sizeof in) && in.magic == LOCKSTEP_MAGIC &&
         in.kind == LOCKSTEP_STEP) {
    lockstep_step(&in, &out);
    if (!lockstep_whole(lockstep_write, to, &out, sizeof out)) {
      return;
    }
  }
}

int main(void) {
  const int from = dup(STDIN_FILENO), to = dup(STDOUT_FILENO);
  if (freopen("/dev/null", "w", stdout) == NULL || freopen("/dev/null", "w", stderr) == NULL) {
    return 1; /* the firmware prints */
  }
  lockstep_hello hello = {.magic = LOCKSTEP_MAGIC, .size_of_request = sizeof(lockstep_request)};
  snprintf(hello.version, sizeof hello.version, "%s", FC_VERSION_STRING);
  snprintf(hello.sources, sizeof hello.sources, "%s", LOCKSTEP_SOURCES);
  if (!lockstep_whole(lockstep_write, to, &hello, sizeof hello)) {
    return 1;
  }
  lockstep_init();
  lockstep_power_up();
  lockstep_request in;
  while (lockstep_whole(lockstep_read, from, &in, sizeof in) && in.magic == LOCKSTEP_MAGIC) {
    if (in.kind != LOCKSTEP_BEGIN) {
      continue; /* the end of a flight whose process is gone */
    }
    const pid_t flight = fork();
    if (flight < 0) {
      return 1;
    }
    if (flight == 0) {
      lockstep_answer out;
      memset(&out, 0, sizeof out);
      out.magic = LOCKSTEP_MAGIC;
      out.arming_disabled = getArmingDisableFlags();
      if (lockstep_whole(lockstep_write, to, &out, sizeof out)) {
        lockstep_fly(from, to);
      }
      _exit(0);
    }
    waitpid(flight, NULL, 0);
  }
  return 0;
}
