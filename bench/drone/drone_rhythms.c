/* Flights of the drone's vehicle under rhythms of set-points, many a call.
 *
 * Purpose: the steps that soter generated of drone_vehicle.soter, in their order of an instant; for
 * each 5 ms the least bound on |d| with which the plant of the proof explains what was flown, and
 * what the linear loop of bound.py does not (docs/drone.md). The air is still: wind adds to
 * |d| what it has.
 * Non-goals: which rhythms (rhythms.py).
 */
#include "soter.h"

#include <string.h>

#define soter_draw(header, stream, index, low, high) 0.0
#define soter_drawn(header, answer, stream, index, low, high) 0.0
#include "drone_vehicle.c" /* generated */

#define NS 1e-9

typedef drone_vehicle_Vec3 vector;
typedef drone_vehicle_iris_Reference reference;

/* A rhythm, one row of an array of doubles: for each axis the side that comes first, and the spells
 * after which it changes, in s; then the leg that is flown, the next one, and from when on. */
enum { SPELLS = 8, ROW = 3 * (1 + SPELLS) + 3 };

/* What an axis' filter gives with u held for t: single and double integral of a. */
typedef struct {
  double t, fast, band, ramp, fasts, bands, ramps;
} integrals;

static integrals integrals_of(double t) {
  const double w = drone_vehicle_iris_BAND, f = drone_vehicle_iris_FAST;
  integrals k = {.t = t, .fast = (1.0 - exp(-f * t)) / f, .band = (1.0 - exp(-w * t)) / w};
  k.ramp = (k.band - t * exp(-w * t)) / w;
  k.fasts = (t - k.fast) / f;
  k.bands = (t - k.band) / w;
  k.ramps = (k.bands - k.ramp) / w;
  return k;
}

/* The change of p and v that a_ref leaves unexplained, as gamma and alpha of conformance.py.
 */
static void missed(const integrals* k, const double r[3], double u, const double moved[2],
                   double* gamma, double* alpha) {
  const double c = drone_vehicle_iris_FORCED * (r[2] - u);
  const double free = r[0] - u - c;
  const double slope = r[1] + drone_vehicle_iris_FAST * c + drone_vehicle_iris_BAND * free;
  const double single = u * k->t + c * k->fast + free * k->band + slope * k->ramp;
  const double twice = u * k->t * k->t / 2 + c * k->fasts + free * k->bands + slope * k->ramps;
  *alpha = moved[1] - single;
  *gamma = 2.0 * (moved[0] - twice) - k->t * *alpha;
}

#ifdef LAPS
#define CONTROL laps_control
static vector onto(const drone_vehicle_state* s, vector v) {
  const drone_vehicle_city_Tube* const t =
      &drone_vehicle_city_TUBES.at[s->topics.laps_tubeState.leg];
  return (vector){v.x * t->along.x + v.y * t->along.y + v.z * t->along.z,
                  v.x * t->side.x + v.y * t->side.y + v.z * t->side.z,
                  v.x * t->up.x + v.y * t->up.y + v.z * t->up.z};
}
static vector into_world(const drone_vehicle_state* s, vector v) {
  return drone_vehicle_city_out_of_tube_fn(
      &drone_vehicle_city_TUBES.at[s->topics.laps_tubeState.leg], v);
}
static void fly_leg(drone_vehicle_state* s, const double* row, double now) {
  const double* const legs = row + 3 * (1 + SPELLS);
  s->topics.laps_tubeState.leg = (int32_t)(now < legs[2] ? legs[0] : legs[1]);
}
#else
#define CONTROL corridor_control
static vector onto(const drone_vehicle_state* s, vector v) {
  (void)s;
  return v;
}
#define into_world onto
static void fly_leg(drone_vehicle_state* s, const double* row, double now) {
  (void)s;
  (void)row;
  (void)now;
}
#endif

/* The set-point at `now`: on each axis its bound, to the side that the rhythm has by then. */
static vector asked(const double* row, const double bound[3], double now) {
  double u[3];
  for (int i = 0; i < 3; i++) {
    const double* const axis = row + i * (1 + SPELLS);
    double side = axis[0] < 0.0 ? -1.0 : 1.0, end = 0.0;
    for (int k = 1; k <= SPELLS && (end += axis[k]) <= now; k++) {
      side = -side;
    }
    u[i] = side * bound[i];
  }
  return (vector){u[0], u[1], u[2]};
}

/* The least bound on |d| that explains the step from `v` at `p` to where the vehicle is. */
static vector needed(const drone_vehicle_state* s, const integrals* k, const reference* r, vector u,
                     const drone_vehicle_d_state* from) {
  const double h = k->t;
  const double a[3][3] = {
      {r->a.x, r->j.x, r->s.x}, {r->a.y, r->j.y, r->s.y}, {r->a.z, r->j.z, r->s.z}};
  const double moved[3][2] = {{s->d.p.x - from->p.x - h * from->v.x, s->d.v.x - from->v.x},
                              {s->d.p.y - from->p.y - h * from->v.y, s->d.v.y - from->v.y},
                              {s->d.p.z - from->p.z - h * from->v.z, s->d.v.z - from->v.z}};
  vector gamma, alpha;
  missed(k, a[0], u.x, moved[0], &gamma.x, &alpha.x);
  missed(k, a[1], u.y, moved[1], &gamma.y, &alpha.y);
  missed(k, a[2], u.z, moved[2], &gamma.z, &alpha.z);
  gamma = onto(s, gamma);
  alpha = onto(s, alpha);
#define LEAST(g, x) ((fabs(g) + sqrt((g) * (g) + h * h * (x) * (x))) / (h * h))
  return (vector){LEAST(gamma.x, alpha.x), LEAST(gamma.y, alpha.y), LEAST(gamma.z, alpha.z)};
}

/* One axis of the linear loop of bound.py: its states, and the row of each after a step. */
enum { LINEAR = 7, A = 0, TILT = 3, LIFT = 6 };

static void linear_step(const double* step, double x[LINEAR], double u) {
  double next[LINEAR];
  for (int i = 0; i < LINEAR; i++) {
    next[i] = step[i * (LINEAR + 1) + LINEAR] * u;
    for (int k = 0; k < LINEAR; k++) {
      next[i] += step[i * (LINEAR + 1) + k] * x[k];
    }
  }
  memcpy(x, next, sizeof next);
}

static double dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* What the thrust misses of a_ref + g beside the linear part, in the axes of D. */
static vector rest_of(const drone_vehicle_state* s, const double x[3][LINEAR]) {
  const drone_vehicle_Quat q = s->d.q;
  const drone_vehicle_iris_Rotors w = s->d.spin;
  const double lift = drone_vehicle_iris_THRUST / drone_vehicle_iris_MASS *
                      (w.front_right * w.front_right + w.rear_left * w.rear_left +
                       w.front_left * w.front_left + w.rear_right * w.rear_right);
  const double n[3] = {2.0 * (q.x * q.z + q.w * q.y), 2.0 * (q.y * q.z - q.w * q.x),
                       1.0 - 2.0 * (q.x * q.x + q.y * q.y)};
  double t[3], tilt[3], slow[3], rest[3];
  for (int i = 0; i < 3; i++) {
    t[i] = x[i][A] + (i == 2 ? drone_vehicle_iris_GRAVITY : 0.0);
    tilt[i] = x[i][TILT] - x[i][A];
    slow[i] = x[i][LIFT] - x[i][A];
  }
  const double along = (dot(t, slow) - dot(t, tilt)) / dot(t, t);
  for (int i = 0; i < 3; i++) {
    rest[i] = lift * n[i] - t[i] - tilt[i] - along * t[i];
  }
  return onto(s, (vector){rest[0], rest[1], rest[2]});
}

static void keep_most(double most[3], vector v) {
  most[0] = fmax(most[0], fabs(v.x));
  most[1] = fmax(most[1], fabs(v.y));
  most[2] = fmax(most[2], fabs(v.z));
}

/* Flies one rhythm for `steps` steps from `rest`; `most`: |d|, then |rest|, by axis, (6). */
static int fly(const drone_vehicle_state* rest, const double* row, const double* bound,
               const double* linear, long steps, double most[6]) {
  const int64_t period = drone_vehicle_program.component[0].period_ns;
  const int64_t asking = drone_vehicle_program.component[1].period_ns;
  const integrals k = integrals_of((double)period * NS);
  drone_vehicle_state s = *rest;
  uint32_t out = 0;
  vector u = {0.0, 0.0, 0.0};
  reference r = s.topics.iris_reference;
  double x[3][LINEAR] = {{0.0}};
  int refused = 0;
  for (long i = 0; i <= steps; i++) {
    const drone_vehicle_d_state from = s.d;
    s.header.ct = i * period;
    refused |= drone_vehicle_d_step(&s, i == 0 ? SOTER_FIRST : 0U, &out, NULL) != SOTER_OK;
    if (i > 0) {
      keep_most(most, needed(&s, &k, &r, u, &from));
      linear_step(linear, x[0], u.x);
      linear_step(linear, x[1], u.y);
      linear_step(linear, x[2], u.z);
      keep_most(most + 3, rest_of(&s, x));
    }
    if (s.header.ct % asking == 0) {
      const double now = (double)s.header.ct * NS;
      fly_leg(&s, row, now);
      s.topics.CONTROL = asked(row, bound, now);
      u = into_world(&s, s.topics.CONTROL);
    }
    r = s.topics.iris_reference;
    refused |= drone_vehicle_AttitudeLoop_step(&s, 0U, &out, NULL) != SOTER_OK;
    refused |= drone_vehicle_Shaper_step(&s, 0U, &out, NULL) != SOTER_OK;
  }
  return refused;
}

/* Flies `count` rhythms from rest; `linear`: the linear loop's step, (7, 8); `worst`, (count, 6):
 * |d| and |rest| by axis. 0, or 1 where a step of the program refused. */
int drone_rhythms(long count, const double* rows, const double* bound, const double* linear,
                  long steps, double* worst) {
  static drone_vehicle_state rest;
  memset(&rest, 0, sizeof rest);
  memset(worst, 0, (size_t)count * 6 * sizeof *worst);
  drone_vehicle_init(&rest, NULL);
  int refused = 0;
  for (long n = 0; n < count; n++) {
    refused |= fly(&rest, rows + n * ROW, bound, linear, steps, worst + n * 6);
  }
  return refused;
}
