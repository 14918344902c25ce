/* The advanced controller of {{name}} in C: the same as policy.py.
 *
 * {{prefix}}.h is generated from {{name}}.soter; 0 says that the step went well. */
#include "{{prefix}}.h"

int policy_step(const {{prefix}}_Guard_Learned_in *in, {{prefix}}_Guard_Learned_out *out);

int policy_step(const {{prefix}}_Guard_Learned_in *in, {{prefix}}_Guard_Learned_out *out) {
  out->speed = in->depth.z < {{DEEP}} ? {{SPEED}} : 0.0;
  out->has_speed = 1;
  return 0;
}
