/* quad.c: a quadrotor that Betaflight flies, as the extern function behind the plant of
 * fence.soter.
 *
 * Purpose: the autopilot's process (started once, a copy of it a flight), the rigid body with its
 * rotors, what the sensors say, and the adapter between a wanted acceleration and the four sticks.
 * Before the first flight a test on a stand: a firmware that is another one, or a mapping with a
 * wrong sign, is said and nothing takes off.
 * Non-goals: contact with anything but the ground before take-off; an estimator of position; what
 * spinning rotors resist to being tilted, which is next to nothing in sum.
 *
 * The autopilot keeps its own state, so a flight is followed from its first step to its last, one
 * at a time; a flight that starts anew (tick 0) starts a new copy of the autopilot.
 */
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <spawn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include "lockstep.h"
#include "quad_program.h"

extern char** environ;

static const double GRAVITY = 9.80665;
static const double MASS = 1.0;                        /* kg */
static const double INERTIA[3] = {0.006, 0.006, 0.01}; /* kg m^2 */
static const double ARM = 0.12;                        /* m, along x and y */
static const double THRUST = 10.0;                     /* N, of one motor at full power */
static const double YAW = 0.016;                       /* m: moment of a rotor over its thrust */
static const double ROTOR_S = 0.03;                    /* lag of a rotor */
static const double ROTOR_INERTIA = 7e-6;              /* kg m^2: 5 inches and 4 g, and a bell */
static const double FULL_SPEED = 2500.0;               /* rad/s, of a rotor at full power */
static const double DRAG = 0.05;                       /* N s/m */
static const double GYRO_NOISE = 0.002, FORCE_NOISE = 0.05, HEIGHT_NOISE = 0.02;
static const double STEP_S = 1e-6 * LOCKSTEP_STEP_US;
static const double HOVER_M = 3.0; /* where a flight begins, above the ground */

/* The adapter: the reference is two lags of REFERENCE; it leads by what the firmware lags behind.
 */
static const double REFERENCE = 6.0; /* 1/s */
static const double LEAD_S = 0.19, LEAD_UP_S = 0.015;
static const double PULL = 1.0; /* of a tilt that is not what the reference wants */
static const double IDLE =
    0.055; /* the firmware's share of a motor at no throttle, 1050 of a stick */

typedef struct {
  double p[3], v[3], q[4], rate[3], rotor[4], force[3];
  double first[3], reference[3]; /* the two lags between wanted and demanded acceleration */
  double home[3];
  uint64_t draws;
  bool airborne;
  fly_fault fault; /* what is other than the adapter believes */
} vehicle;

/* A campaign flies in threads, each a flight at a time, with an autopilot of its own. */
static _Thread_local vehicle craft;
static _Thread_local int line = -1; /* to the autopilot's process */
static _Thread_local bool stood;    /* the test on the stand was passed */

static int refuse(const char* why) {
  fprintf(stderr, "autopilot: %s\n", why);
  return -1;
}

/* ------------------------------------------------------------------ the autopilot's process */

static int talk(bool out, void* bytes, size_t size) {
  for (size_t done = 0; done < size;) {
    char* const at = (char*)bytes + done;
    const ssize_t n =
        out ? send(line, at, size - done, MSG_NOSIGNAL) : recv(line, at, size - done, 0);
    if (n < 0 && errno == EINTR) {
      continue;
    }
    if (n <= 0) {
      close(line);
      line = -1;
      stood = false;
      return refuse("the autopilot's process is gone");
    }
    done += (size_t)n;
  }
  return 0;
}

static int start_process(const char* path) {
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) {
    return refuse("no pipe to the autopilot");
  }
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, ends[1], STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&files, ends[1], STDOUT_FILENO);
  char* const argv[] = {(char*)path, NULL};
  pid_t process;
  const int failed = posix_spawn(&process, path, &files, NULL, argv, environ);
  posix_spawn_file_actions_destroy(&files);
  close(ends[1]);
  line = ends[0];
  const struct timeval patience = {.tv_sec = 60}; /* one that hangs counts as gone */
  setsockopt(line, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  if (failed) {
    close(line);
    line = -1;
    fprintf(stderr, "autopilot: cannot start %s: %s; firmware.py builds it\n", path,
            strerror(failed));
    return -1;
  }
  return 0;
}

static int start_autopilot(void) {
  char path[4096];
  const char* const named = getenv("SOTER_AUTOPILOT");
  const char* const home = getenv("HOME");
  snprintf(path, sizeof path, "%s%s",
           named  ? named
           : home ? home
                  : "",
           named ? "" : "/.cache/soter/autopilot/betaflight");
  lockstep_hello hello;
  if (start_process(path) || talk(false, &hello, sizeof hello)) {
    return -1;
  }
  if (hello.magic != LOCKSTEP_MAGIC || hello.size_of_request != sizeof(lockstep_request)) {
    return refuse("the other end of the pipe speaks another protocol");
  }
  hello.version[sizeof hello.version - 1] = 0;
  hello.sources[sizeof hello.sources - 1] = 0;
  if (strcmp(hello.sources, LOCKSTEP_SOURCES) != 0) {
    fprintf(stderr, "autopilot: Betaflight %s of other sources than those that were identified\n",
            hello.version);
    return -1;
  }
  return 0;
}

static int ask(lockstep_kind kind, lockstep_request* in, lockstep_answer* out) {
  in->magic = LOCKSTEP_MAGIC;
  in->kind = kind;
  if (talk(true, in, sizeof *in) || (out && talk(false, out, sizeof *out))) {
    return -1;
  }
  return out && out->magic != LOCKSTEP_MAGIC ? refuse("an answer that is none") : 0;
}

/* ------------------------------------------------------------------ the body */

static double uniform(void) { /* (0, 1) */
  craft.draws ^= craft.draws << 13;
  craft.draws ^= craft.draws >> 7;
  craft.draws ^= craft.draws << 17;
  return ((double)(craft.draws >> 11) + 0.5) * 0x1p-53;
}

static double normal(void) {
  return sqrt(-2.0 * log(uniform())) * cos(6.283185307179586 * uniform());
}

static double within(double x, double low, double high) {
  return x < low ? low : x > high ? high : x;
}

static void rotation(const double q[4], double r[3][3]) {
  const double w = q[0], x = q[1], y = q[2], z = q[3];
  const double m[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                          {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                          {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
  memcpy(r, m, sizeof m);
}

static void sense(lockstep_request* in) {
  for (int i = 0; i < 3; i++) {
    in->gyro[i] = craft.rate[i] + GYRO_NOISE * normal();
    in->force[i] = craft.force[i] + FORCE_NOISE * normal();
    in->position[i] = craft.p[i];
    in->velocity[i] = craft.v[i];
  }
  memcpy(in->attitude, craft.q, sizeof craft.q);
  in->pressure = 101325.0 * exp(-(craft.p[2] + HEIGHT_NOISE * normal()) / 8434.0);
}

/* Rotors, then moments and forces, one step; `wind` in m/s^2. */
static void turn(const double moment[3]) {
  double* const w = craft.rate;
  double* const q = craft.q;
  const double dw[3] = {(moment[0] - (INERTIA[2] - INERTIA[1]) * w[1] * w[2]) / INERTIA[0],
                        (moment[1] - (INERTIA[0] - INERTIA[2]) * w[0] * w[2]) / INERTIA[1],
                        (moment[2] - (INERTIA[1] - INERTIA[0]) * w[0] * w[1]) / INERTIA[2]};
  for (int i = 0; i < 3; i++) {
    w[i] += STEP_S * dw[i];
  }
  const double dq[4] = {
      -q[1] * w[0] - q[2] * w[1] - q[3] * w[2], q[0] * w[0] + q[2] * w[2] - q[3] * w[1],
      q[0] * w[1] - q[1] * w[2] + q[3] * w[0], q[0] * w[2] + q[1] * w[1] - q[2] * w[0]};
  double n = 0.0;
  for (int i = 0; i < 4; i++) {
    q[i] += 0.5 * STEP_S * dq[i];
    n += q[i] * q[i];
  }
  for (int i = 0; i < 4; i++) {
    q[i] /= sqrt(n);
  }
}

static void move(const double motors[4], const double wind[3]) {
  double t[4], about[4], total = 0.0;
  for (int i = 0; i < 4; i++) {
    const double change = (within(motors[i], 0.0, 1.0) - craft.rotor[i]) / ROTOR_S;
    craft.rotor[i] += STEP_S * change;
    t[i] = THRUST * craft.rotor[i] * craft.rotor[i] * (i == 1 ? craft.fault.motor : 1.0);
    about[i] = YAW * t[i] + ROTOR_INERTIA * FULL_SPEED * change; /* its drag, and what speeds it up */
    total += t[i];
  }
  const double mass = MASS * craft.fault.mass;
  double r[3][3], a[3];
  rotation(craft.q, r);
  for (int i = 0; i < 3; i++) {
    a[i] = r[i][2] * total / mass - DRAG * craft.v[i] / mass + wind[i] - (i == 2 ? GRAVITY : 0.0);
  }
  if (!craft.airborne && a[2] < 0.0) { /* it stands on the ground */
    memset(a, 0, sizeof a);
  } else {
    craft.airborne = true;
    const double moment[3] = {ARM * (t[2] + t[3] - t[0] - t[1]), ARM * (t[0] + t[2] - t[1] - t[3]),
                              about[0] + about[3] - about[1] - about[2]};
    turn(moment);
  }
  for (int i = 0; i < 3; i++) {
    craft.p[i] += STEP_S * (craft.v[i] + 0.5 * STEP_S * a[i]);
    craft.v[i] += STEP_S * a[i];
  }
  rotation(craft.q, r);
  for (int i = 0; i < 3; i++) {
    craft.force[i] = r[0][i] * a[0] + r[1][i] * a[1] + r[2][i] * (a[2] + GRAVITY);
  }
}

/* ------------------------------------------------------------------ the adapter */

/* The firmware's default rates: 70 degrees a second at the middle, 670 at the end, over 60 degrees.
 */
static uint16_t stick(double angle) {
  const double part = fabs(within(angle, -0.96, 0.96)) * (180.0 / 3.141592653589793) / 60.0 * 670.0;
  const double d = (sqrt(4900.0 + 2400.0 * part) - 70.0) / 1200.0;
  return (uint16_t)(1500.5 + (angle < 0.0 ? -500.0 : 500.0) * d);
}

/* Sticks for a wanted acceleration, one step; it moves the two lags on. */
static void steer(const double wanted[3], lockstep_request* in) {
  const double e = exp(-REFERENCE * STEP_S);
  double demand[3];
  for (int i = 0; i < 3; i++) {
    const double f = craft.first[i] - wanted[i], s = craft.reference[i] - wanted[i];
    craft.reference[i] = wanted[i] + (s + f * REFERENCE * STEP_S) * e;
    craft.first[i] = wanted[i] + f * e;
    const double lead = i == 2 ? LEAD_UP_S : LEAD_S;
    demand[i] = craft.reference[i] + lead * REFERENCE * (craft.first[i] - craft.reference[i]);
  }
  double r[3][3];
  rotation(craft.q, r);
  for (int i = 0; i < 2; i++) {
    const double now = (GRAVITY + craft.reference[2]) * r[i][2] / r[2][2];
    demand[i] += PULL * (craft.reference[i] - now);
  }
  const double yaw = atan2(r[1][0], r[0][0]);
  const double ahead = cos(yaw) * demand[0] + sin(yaw) * demand[1];
  const double left = cos(yaw) * demand[1] - sin(yaw) * demand[0];
  const double up = GRAVITY + demand[2];
  in->sticks[0] = stick(asin(-left / sqrt(ahead * ahead + left * left + up * up)));
  in->sticks[1] = stick(atan2(ahead, up));
  const double share = sqrt(within(MASS * up / fmax(r[2][2], 0.5) / (4.0 * THRUST), 0.0, 1.0));
  in->sticks[2] = (uint16_t)(1050.5 + 950.0 * within((share - IDLE) / (1.0 - IDLE), 0.0, 1.0));
  in->sticks[3] = 1500;
  in->sticks[4] = in->sticks[5] = 2000;
}

static int step(const double wanted[3], const double wind[3]) {
  lockstep_request in;
  lockstep_answer out;
  memset(&in, 0, sizeof in);
  sense(&in);
  steer(wanted, &in);
  if (ask(LOCKSTEP_STEP, &in, &out)) {
    return -1;
  }
  if (!out.armed) {
    return refuse("the autopilot disarmed in flight");
  }
  move(out.motors, wind);
  return 0;
}

/* ------------------------------------------------------------------ before a flight */

static int arm(void) {
  lockstep_request in;
  lockstep_answer out;
  memset(&in, 0, sizeof in);
  if (ask(LOCKSTEP_BEGIN, &in, &out)) {
    return -1;
  }
  for (int k = 0; k < 1000; k++) {
    sense(&in);
    const uint16_t sticks[LOCKSTEP_CHANNELS] = {1500, 1500, 1000, 1500, k < 100 ? 1000 : 2000,
                                                2000};
    memcpy(in.sticks, sticks, sizeof sticks);
    if (ask(LOCKSTEP_STEP, &in, &out)) {
      return -1;
    }
    if (k > 400 && out.armed && out.angle_mode) {
      return 0;
    }
  }
  fprintf(stderr, "autopilot: it does not arm (reasons %x)\n", out.arming_disabled);
  return -1;
}

static void end_flight(void) {
  lockstep_request in;
  memset(&in, 0, sizeof in);
  if (line >= 0) {
    ask(LOCKSTEP_END, &in, NULL);
  }
}

static void stand_still(uint64_t draws) {
  memset(&craft, 0, sizeof craft);
  craft.q[0] = 1.0;
  craft.force[2] = GRAVITY;
  craft.draws = draws;
  craft.fault.mass = craft.fault.motor = 1.0;
}

/* Up to HOVER_M, until it hovers; that place is home. */
static int take_off(uint64_t draws) {
  static const double calm[3] = {0.0, 0.0, 0.0};
  stand_still(draws);
  if (arm()) {
    return -1;
  }
  for (int k = 0, still = 0; k < 12000; k++) {
    double wanted[3], speed = 0.0;
    for (int i = 0; i < 3; i++) {
      const double to = (i == 2 ? HOVER_M : 0.0) - craft.p[i];
      wanted[i] = within(1.5 * to - 2.2 * craft.v[i], -1.5, 1.5);
      speed = fmax(speed, fmax(fabs(craft.v[i]), 0.2 * fabs(craft.reference[i])));
    }
    if (step(wanted, calm)) {
      return -1;
    }
    still = speed < 0.02 && craft.p[2] > 0.5 * HOVER_M ? still + 1 : 0;
    if (still == 200) {
      /* The middle of the fence, where the flight begins from rest: what was less than 2 cm/s is.
       */
      memcpy(craft.home, craft.p, sizeof craft.p);
      memset(craft.v, 0, sizeof craft.v);
      memset(craft.first, 0, sizeof craft.first);
      memset(craft.reference, 0, sizeof craft.reference);
      return 0;
    }
  }
  return refuse("it does not come to hover");
}

/* One attitude, rate or stick, held for 200 ms on a stand: the sign of the moment that follows. */
static int answer_on_stand(int axis, double angle, double rate, double push, double* moment) {
  static const double none[3] = {0.0, 0.0, 0.0};
  stand_still(0x9E3779B97F4A7C15u);
  if (arm()) {
    return -1;
  }
  craft.q[0] = cos(0.5 * angle);
  craft.q[1 + axis] = sin(0.5 * angle);
  craft.rate[axis] = rate;
  *moment = 0.0;
  for (int k = 0; k < 200; k++) {
    lockstep_request in;
    lockstep_answer out;
    memset(&in, 0, sizeof in);
    sense(&in);
    steer(none, &in);
    in.sticks[axis] = stick(push);
    if (ask(LOCKSTEP_STEP, &in, &out)) {
      return -1;
    }
    const double* const m = out.motors;
    *moment += axis == 0 ? m[2] + m[3] - m[0] - m[1] : m[0] + m[2] - m[1] - m[3];
  }
  end_flight();
  return 0;
}

static int stand_test(void) {
  static const char* const names[] = {"roll", "pitch"};
  static const char* const causes[] = {"attitude", "rate", "stick"};
  for (int axis = 0; axis < 2; axis++) {
    for (int cause = 0; cause < 3; cause++) {
      for (int sign = -1; sign <= 1; sign += 2) {
        double m;
        if (answer_on_stand(axis, cause == 0 ? 0.2 * sign : 0.0, cause == 1 ? 0.5 * sign : 0.0,
                            cause == 2 ? 0.2 * sign : 0.0, &m)) {
          return -1;
        }
        if (!((cause == 2 ? sign : -sign) * m > 1.0)) {
          fprintf(stderr, "autopilot: on the stand %s of %s is answered with the wrong sign (%g)\n",
                  causes[cause], names[axis], m);
          return -1;
        }
      }
    }
  }
  stood = true;
  return 0;
}

static int begin(double start) {
  if (line >= 0) {
    end_flight();
  }
  if ((line < 0 && start_autopilot()) || (!stood && stand_test())) {
    return -1;
  }
  const uint64_t draws = 0x9E3779B97F4A7C15u ^ (uint64_t)(start * 0x1p53);
  return take_off(draws * 0xBF58476D1CE4E5B9u | 1u);
}

/* ------------------------------------------------------------------ what Soter calls */

static fly_vec3 of(const double x[3]) {
  const fly_vec3 v = {x[0], x[1], x[2]};
  return v;
}

fly_state fly(fly_state s, fly_vec3 wanted, fly_vec3 wind, fly_fault fault, double start) {
  const fly_vec3 nowhere = {NAN, NAN, NAN};
  const double u[3] = {wanted.x, wanted.y, wanted.z}, gust[3] = {wind.x, wind.y, wind.z};
  if (s.tick == 0 && begin(start)) {
    s.p = nowhere; /* a step fault: the plant stops, and nothing flies */
    return s;
  }
  if ((double)s.tick * FLY_STEPS * STEP_S >= fault.after) {
    craft.fault = fault;
  }
  double change[3], shown[3];
  for (int i = 0; i < 3; i++) {
    change[i] = -craft.v[i];
  }
  double expected[3] = {0.0, 0.0, 0.0};
  for (int k = 0; k < FLY_STEPS; k++) {
    if (step(u, gust)) {
      s.p = nowhere;
      return s;
    }
    for (int i = 0; i < 3; i++) {
      expected[i] += craft.reference[i] / FLY_STEPS;
    }
  }
  for (int i = 0; i < 3; i++) {
    change[i] = (change[i] + craft.v[i]) / (FLY_STEPS * STEP_S) - expected[i];
    shown[i] = craft.p[i] - craft.home[i];
  }
  s.tick++;
  s.p = of(shown);
  s.v = of(craft.v);
  s.a = of(craft.first);
  s.b = of(craft.reference);
  s.rest = of(change);
  return s;
}
