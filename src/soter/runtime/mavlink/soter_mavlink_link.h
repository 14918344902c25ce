/* soter_mavlink_link.h: bytes in and out, over UDP or a serial line.
 *
 * Purpose: a link by its URL: udpin://ADDRESS:PORT waits there, udpout://ADDRESS:PORT speaks first
 * and hears that address alone, serial:///dev/NAME:BAUD. What is read is frames with a right
 * checksum. Non-goals: who may speak (soter_mavlink_bridge.c).
 */
#ifndef SOTER_MAVLINK_LINK_H
#define SOTER_MAVLINK_LINK_H

#include "soter_mavlink_dialect.h"

#include <netinet/in.h>
#include <stdbool.h>
#include <stdint.h>
#include <sys/socket.h>

typedef struct {
  const char* url;
  int file;
  bool serial;
  bool speaks_first; /* the other side is known before it was heard */
  struct sockaddr_storage peer;
  socklen_t peer_size;
  mavlink_message_t parsed; /* of the parser */
  mavlink_status_t status;
  bool drained;     /* the last read left nothing there */
  int64_t empty_ns; /* when nothing was there, the last time that anybody looked */
  uint64_t bytes, frames, torn, is_signed, short_; /* torn: of a wrong checksum, or no message */
  uint64_t unsent;
} soter_mavlink_link;

/* Where bytes came from. */
typedef struct {
  uint32_t link;
  struct sockaddr_storage address;
  socklen_t size; /* 0 of a serial line */
} soter_mavlink_address;

/* What takes a whole frame. */
typedef void soter_mavlink_taker(void* to, const mavlink_message_t* m,
                                 const soter_mavlink_address* from);

/* NULL, or what is wrong, in words. */
const char* soter_mavlink_link_open(soter_mavlink_link* link, const char* url);
void soter_mavlink_link_close(soter_mavlink_link* link);

/* Reads what is there, at most so much that others have their turn. False: the link has ended. */
bool soter_mavlink_link_read(soter_mavlink_link* link, uint32_t index, soter_mavlink_taker* taker,
                             void* to);

/* Sends a frame; where nobody takes it, it is lost, and counted. */
void soter_mavlink_link_send(soter_mavlink_link* link, const soter_mavlink_address* to,
                             const mavlink_message_t* m);

bool soter_mavlink_same_address(const soter_mavlink_address* a, const soter_mavlink_address* b);

#endif
