/* quad_program.h: the names that Soter gives the types of autopilot.soter, in whichever program
 * flies.
 *
 * Soter names the header after the main file, and types of an imported one after both.
 */
#ifndef QUAD_PROGRAM_H
#define QUAD_PROGRAM_H

#if __has_include("flights.h")
#include "flights.h"
#define OF_PROGRAM(name) flights_fence_##name
#define OF_VEC3 flights_Vec3
#elif __has_include("laps.h")
#include "laps.h"
#define OF_PROGRAM(name) laps_fence_##name
#define OF_VEC3 laps_Vec3
#elif __has_include("corridor.h")
#include "corridor.h"
#define OF_PROGRAM(name) corridor_fence_##name
#define OF_VEC3 corridor_Vec3
#elif !__has_include("autopilot.h")
#error "a program that flies this vehicle is called autopilot, flights, laps or corridor.soter"
#else
#include "autopilot.h"
#define OF_PROGRAM(name) autopilot_##name
#define OF_VEC3 autopilot_Vec3
#endif

#define FLY_STEPS 5 /* of LOCKSTEP_STEP_US in a period of the plant */
#define LOCKSTEP_SOURCES "d5fb207c627e8465b89b96bfd3ed42b79ee4dc2d1fab6f1019fe33c3b238d267"

typedef OF_PROGRAM(Flight) fly_state;
typedef OF_PROGRAM(Fault) fly_fault;
typedef OF_VEC3 fly_vec3;

#endif
