/* soter_mavlink_bridge.h: between messages of MAVLink and the channels of a trusted part.
 *
 * Purpose: the MAVLink side of a package that `soter build --target mavlink` writes, for a
 * companion computer. Messages that the mapping names are judged (whose, from where, when
 * measured), converted and written into the channel of their topic; what the actuators hold goes to
 * the autopilot. The trusted part is another process, which knows nothing of MAVLink: it judges
 * values, ages and sets by itself, so that nothing here is trusted to be right, or alive.
 * Non-goals: the trusted part and the actuators (soter_posix.h, soter_actuator.h); routing,
 * signing, missions, parameters; arming and changing modes, which a person does.
 *
 * Stamps of messages are on the autopilot's clock, channels on CLOCK_MONOTONIC
 * (soter_mavlink_clock.h says what lies between). C99 and POSIX threads.
 */
#ifndef SOTER_MAVLINK_BRIDGE_H
#define SOTER_MAVLINK_BRIDGE_H

#include "soter_mavlink_dialect.h"
#include "soter_stamp_numbers.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
  uint8_t system, component;
} soter_mavlink_id;

/* A topic that comes in; generated. `value` is one of the channel. */
typedef struct {
  const char* name; /* of the channel */
  uint64_t hash;
  size_t size;
  const char* message; /* what it is called */
  uint32_t id;         /* of the message */
  uint32_t source;     /* whose: index into `sources` */
  bool stamped;
  bool (*fits)(const mavlink_message_t* m); /* whether its constants are those of the mapping */
  /* ns on the autopilot's clock at which it was measured; below 0: none */
  int64_t (*stamp)(const mavlink_message_t* m);
  bool (*convert)(const mavlink_message_t* m, void* value); /* false: a value is not there */
  void* value;                                              /* room for one */
} soter_mavlink_inward;

/* Who writes to whom. */
typedef struct {
  soter_mavlink_id own, to;
  mavlink_status_t* status; /* counts what is sent */
  int64_t written_ns;       /* CLOCK_MONOTONIC, of the value */
} soter_mavlink_envelope;

/* A topic that goes out; generated. */
typedef struct {
  const char* name;
  uint64_t hash;
  size_t size;
  const char* message;
  void (*convert)(const void* value, const soter_mavlink_envelope* envelope, mavlink_message_t* m);
  bool (*law)(void* value); /* the fail-safe law; false: it has none, silence follows silence */
  int64_t silent_ns;        /* without a value for so long, whoever writes the channel is gone */
  void* value;              /* room for one */
  void* last;               /* and for the one before */
} soter_mavlink_outward;

typedef struct {
  const char* program;     /* what it is called */
  const char* const* urls; /* of the links, unless --url says others */
  size_t links;
  const soter_mavlink_id* sources; /* who may speak; the first is the autopilot */
  size_t source_count;
  soter_mavlink_id own;
  int64_t delay_ns;         /* from a measurement to its arrival, at most; below 0: nobody says */
  int64_t resend_ns;        /* what does not change is sent so often */
  int64_t offboard_loss_ns; /* COM_OF_LOSS_T, as the mapping says */
  const soter_mavlink_inward* in;
  size_t ins;
  const soter_mavlink_outward* out;
  size_t outs;
} soter_mavlink_system;

/* The whole program: 0; 1 where it cannot run; 2 where its arguments make no sense. */
int soter_mavlink_main(const soter_mavlink_system* system, int count, char** words);

#endif
