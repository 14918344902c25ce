/* The advanced controller of {{name}} in C: the same as policy.py.
 *
 * {{prefix}}.h is generated from {{name}}.soter; 0 says that the step went well. */
#include "{{prefix}}.h"

int policy_step(const {{prefix}}_Guard_Learned_in *in, {{prefix}}_Guard_Learned_out *out);

int policy_step(const {{prefix}}_Guard_Learned_in *in, {{prefix}}_Guard_Learned_out *out) {
  const double push = 3.0 * (in->target - in->motion.p) - 1.0 * in->motion.v;
  out->accel = push < -2.0 ? -2.0 : (push > 2.0 ? 2.0 : push);
  out->has_accel = 1;
  return 0;
}
