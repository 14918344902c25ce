/* The advanced controller of {{name}} in C: the same as policy.py.
 *
 * {{prefix}}.h is generated from {{name}}.soter; 0 says that the step went well. */
#include "{{prefix}}.h"

int policy_step(const {{prefix}}_Guard_Learned_in *in, {{prefix}}_Guard_Learned_out *out);

int policy_step(const {{prefix}}_Guard_Learned_in *in, {{prefix}}_Guard_Learned_out *out) {
  out->turn = in->pose.heading < 0.1 ? {{LATERAL}} / {{SPEED}} : 0.0;
  out->has_turn = 1;
  return 0;
}
