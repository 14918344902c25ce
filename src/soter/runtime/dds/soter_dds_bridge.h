/* soter_dds_bridge.h: between topics of DDS and the channels of a trusted part.
 *
 * Purpose: the DDS side of a package that `soter build --target dds` writes, over Cyclone DDS.
 * Samples of the topics that the mapping names are judged (writer, size, frame, stamp), converted
 * and written into the channel of their topic; what the actuators hold is published. The trusted
 * part is another process, which knows nothing of DDS: it judges values, ages and sets by itself,
 * so that nothing here is trusted to be right, or alive. Whether a sample is new is said by its
 * stamp, never by what DDS holds of its writer.
 * Non-goals: the trusted part and the actuators (soter_posix.h, soter_actuator.h); nodes, services
 * and parameters of ROS 2.
 *
 * Stamps of samples are on the machine's wall clock, channels on CLOCK_MONOTONIC: a sample of age a
 * was measured a (and --clock-error) before now. C99 and POSIX threads.
 */
#ifndef SOTER_DDS_BRIDGE_H
#define SOTER_DDS_BRIDGE_H

#include "dds/dds.h"
#include "soter_outside.h"
#include "soter_stamp_numbers.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
  bool reliable;
  bool transient_local;
  int32_t depth; /* of the history; 0: all of it */
} soter_dds_qos;

/* A topic that comes in; generated. `m` is a message, `value` one of the channel. */
typedef struct {
  const char* name; /* of the channel */
  uint64_t hash;
  size_t size;
  const char* topic; /* of DDS, such as rt/odom */
  const dds_topic_descriptor_t* type;
  soter_dds_qos qos;
  const char* publisher; /* the name of the entity that may write; "": the first that is heard */
  bool stamped;
  int64_t delay_ns; /* where not: how long before its arrival a message may have been measured */
  bool (*frame)(const void* m);    /* whether it is in the frame of the mapping */
  int64_t (*stamp)(const void* m); /* ns since 1970 at which it was measured; 0 or less: none */
  bool (*convert)(const void* m, void* value); /* false: something that is needed is not there */
} soter_dds_inward;

/* A topic that goes out; generated. */
typedef struct {
  const char* name;
  uint64_t hash;
  size_t size;
  const char* topic;
  const dds_topic_descriptor_t* type;
  soter_dds_qos qos;
  void (*convert)(const void* value, int64_t stamp_ns, void* m);
  bool (*law)(void* value); /* the fail-safe law; false: it has none, silence follows silence */
  int64_t silent_ns;        /* without a value for so long, whoever writes the channel is gone */
} soter_dds_outward;

/* Who says in the folder of the channels how things are; generated. */
typedef struct {
  uint64_t hash, actuators_hash; /* of what they say: soter_status.h */
  const char* const* modules;
  const int32_t* lease_of; /* of each module: the index of its leases; -1: it has none */
  const char* const* topics;
  uint32_t module_count, lease_count, topic_count;
  const char* actuator; /* the program that a person arms by */
} soter_dds_trusted;

typedef struct {
  const char* program; /* what it is called */
  const soter_dds_inward* in;
  size_t ins;
  const soter_dds_outward* out;
  size_t outs;
  const soter_dds_trusted* trusted;
} soter_dds_system;

/* The whole program: 0; 1 where it cannot run; 2 where its arguments make no sense. */
int soter_dds_main(const soter_dds_system* system, int count, char** words);

/* A stamp in seconds and the ns beyond; 0 where it is none. */
static inline int64_t soter_dds_stamp(int32_t sec, uint32_t nanosec) {
  return nanosec < 1000000000U ? (int64_t)sec * 1000000000 + (int64_t)nanosec : 0;
}

#endif
