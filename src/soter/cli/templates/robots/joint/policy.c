/* The advanced controller of {{name}} in C: the same as policy.py.
 *
 * {{prefix}}.h is generated from {{name}}.soter; 0 says that the step went well. */
#include "{{prefix}}.h"

int policy_step(const {{prefix}}_Guard_Learned_in *in, {{prefix}}_Guard_Learned_out *out);

int policy_step(const {{prefix}}_Guard_Learned_in *in, {{prefix}}_Guard_Learned_out *out) {
  const double stop = {{STOP}}, a = {{TORQUE}} / {{INERTIA}};
  for (int i = 0; i < 2; i++) {
    out->accel.at[i] = in->joints.q.at[i] < 0.9 * stop ? a : -a;
  }
  out->has_accel = 1;
  return 0;
}
