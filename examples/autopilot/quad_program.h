/* quad_program.h: the names that Soter gives the types of fence.soter, in whichever program flies.
 *
 * Soter names the header after the main file; each that flies is one line here.
 */
#ifndef QUAD_PROGRAM_H
#define QUAD_PROGRAM_H

#include "autopilot.h"
#define FLY_STEPS 5 /* of LOCKSTEP_STEP_US in a period of the plant */
#define LOCKSTEP_SOURCES "d5fb207c627e8465b89b96bfd3ed42b79ee4dc2d1fab6f1019fe33c3b238d267"

typedef autopilot_Vec3 fly_vec3;
typedef autopilot_Flight fly_state;
typedef autopilot_Fault fly_fault;

#endif
