/* soter_mavlink_link.c: see soter_mavlink_link.h. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_mavlink_link.h"

#include "soter_check.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

#define DATAGRAM 2048
#define DATAGRAMS_AT_ONCE 64
#define SERIAL_WAIT_MS 20 /* a whole frame at 57600 baud takes about as long */

/* ------------------------------------------------------------------ opening */

static const char no_url[] =
    "it is no udpin://ADDRESS:PORT, udpout://ADDRESS:PORT or serial:///dev/NAME:BAUD";

static const struct {
  long baud;
  speed_t speed;
} speeds[] = {{9600, B9600},       {19200, B19200},     {38400, B38400},    {57600, B57600},
              {115200, B115200},   {230400, B230400},   {460800, B460800},  {921600, B921600},
              {1000000, B1000000}, {2000000, B2000000}, {3000000, B3000000}};

static const char* open_serial(soter_mavlink_link* link, const char* device, long baud) {
  SOTER_CHECK(link->file < 0);
  struct termios t;
  speed_t speed = B0;
  for (size_t k = 0; k < sizeof speeds / sizeof speeds[0]; k++) {
    speed = speeds[k].baud == baud ? speeds[k].speed : speed;
  }
  if (speed == B0) {
    return "no such speed of a serial line";
  }
  link->serial = true;
  link->speaks_first = true;
  link->file = open(device, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (link->file < 0) {
    return strerror(errno);
  }
  if (tcgetattr(link->file, &t) != 0) {
    return "it is no serial line";
  }
  cfmakeraw(&t);
  t.c_cflag |= CLOCAL | CREAD;
  t.c_cflag &= ~(tcflag_t)(CSTOPB | PARENB | CRTSCTS);
  if (cfsetispeed(&t, speed) != 0 || cfsetospeed(&t, speed) != 0 ||
      tcsetattr(link->file, TCSANOW, &t) != 0) {
    return "the serial line does not take its settings";
  }
  (void)tcflush(link->file, TCIOFLUSH);
  return NULL;
}

static const char* address_of(const char* host, long port, struct sockaddr_storage* to,
                              socklen_t* size) {
  SOTER_CHECK(host != NULL && to != NULL && size != NULL);
  struct sockaddr_in* const four = (struct sockaddr_in*)to;
  struct sockaddr_in6* const six = (struct sockaddr_in6*)to;
  (void)memset(to, 0, sizeof *to);
  if (port < 0 || port > 65535) {
    return "no such port";
  }
  if (inet_pton(AF_INET, host, &four->sin_addr) == 1) {
    four->sin_family = AF_INET;
    four->sin_port = htons((uint16_t)port);
    *size = sizeof *four;
    return NULL;
  }
  if (inet_pton(AF_INET6, host, &six->sin6_addr) == 1) {
    six->sin6_family = AF_INET6;
    six->sin6_port = htons((uint16_t)port);
    *size = sizeof *six;
    return NULL;
  }
  return "its address is neither IPv4 nor IPv6";
}

static const char* open_udp(soter_mavlink_link* link, const char* host, long port, bool out) {
  SOTER_CHECK(link->file < 0);
  struct sockaddr_storage address;
  socklen_t size = 0;
  const char* const wrong = address_of(host, port, &address, &size);
  if (wrong != NULL) {
    return wrong;
  }
  link->file = socket(address.ss_family, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (link->file < 0) {
    return strerror(errno);
  }
  link->speaks_first = out;
  link->peer = address;
  link->peer_size = size;
  const int told = out ? connect(link->file, (const struct sockaddr*)&address, size)
                       : bind(link->file, (const struct sockaddr*)&address, size);
  return told == 0 ? NULL : strerror(errno);
}

/* "HOST:NUMBER" taken apart where it stands; false: it is none. */
static bool parts(char* text, char** host, long* number) {
  SOTER_CHECK(text != NULL && host != NULL && number != NULL);
  char* end = NULL;
  char* const colon = strrchr(text, ':');
  if (colon == NULL) {
    return false;
  }
  *colon = '\0';
  *number = strtol(colon + 1, &end, 10);
  *host = text;
  if (text[0] == '[' && colon > text + 1 && colon[-1] == ']') {
    colon[-1] = '\0';
    *host = text + 1;
  }
  return end != colon + 1 && *end == '\0';
}

const char* soter_mavlink_link_open(soter_mavlink_link* link, const char* url) {
  SOTER_CHECK(link != NULL && url != NULL);
  char text[128];
  char* host = NULL;
  long number = 0;
  (void)memset(link, 0, sizeof *link);
  link->url = url;
  link->file = -1;
  const char* const rest = strstr(url, "://");
  if (rest == NULL || strlen(rest + 3) >= sizeof text) {
    return no_url;
  }
  (void)strcpy(text, rest + 3);
  if (!parts(text, &host, &number)) {
    return "it has no port, or no speed, at its end";
  }
  if (strncmp(url, "serial://", 9) == 0) {
    return open_serial(link, host, number);
  }
  if (strncmp(url, "udpin://", 8) == 0 || strncmp(url, "udpout://", 9) == 0) {
    return open_udp(link, host, number, url[3] == 'o');
  }
  return no_url;
}

void soter_mavlink_link_close(soter_mavlink_link* link) {
  SOTER_CHECK(link != NULL);
  if (link->file >= 0) {
    (void)close(link->file);
  }
  link->file = -1;
}

/* ------------------------------------------------------------------ reading */

static void take(soter_mavlink_link* link, const uint8_t* bytes, size_t many,
                 const soter_mavlink_address* from, soter_mavlink_taker* taker, void* to) {
  SOTER_CHECK(many <= DATAGRAM);
  SOTER_CHECK(taker != NULL);
  link->bytes += many;
  for (size_t k = 0; k < many; k++) {
    mavlink_message_t m;
    mavlink_status_t unused;
    const uint8_t told =
        mavlink_frame_char_buffer(&link->parsed, &link->status, bytes[k], &m, &unused);
    if (told == MAVLINK_FRAMING_INCOMPLETE) {
      continue;
    }
    const mavlink_msg_entry_t* const entry = mavlink_get_msg_entry(m.msgid);
    if (told != MAVLINK_FRAMING_OK || entry == NULL) {
      link->torn++;
    } else if (m.magic == MAVLINK_STX && (m.incompat_flags & MAVLINK_IFLAG_SIGNED) != 0) {
      link->is_signed++; /* nobody here can tell a right signature from a wrong one */
    } else if (m.magic != MAVLINK_STX && m.len < entry->min_msg_len) {
      link->short_++; /* only version 2 leaves zeros out */
    } else {
      link->frames++;
      taker(to, &m, from);
    }
  }
}

static bool read_serial(soter_mavlink_link* link, const soter_mavlink_address* from,
                        soter_mavlink_taker* taker, void* to) {
  SOTER_CHECK(link->serial && link->file >= 0);
  uint8_t bytes[DATAGRAM];
  const ssize_t many = read(link->file, bytes, sizeof bytes);
  link->drained = many < (ssize_t)sizeof bytes;
  if (many > 0) {
    take(link, bytes, (size_t)many, from, taker, to);
  }
  return many > 0 || (many < 0 && (errno == EAGAIN || errno == EINTR));
}

bool soter_mavlink_link_read(soter_mavlink_link* link, uint32_t index, soter_mavlink_taker* taker,
                             void* to) {
  SOTER_CHECK(link->file >= 0 && taker != NULL);
  uint8_t bytes[DATAGRAM];
  soter_mavlink_address from;
  (void)memset(&from, 0, sizeof from);
  from.link = index;
  link->drained = false;
  if (link->serial) {
    return read_serial(link, &from, taker, to);
  }
  for (int k = 0; k < DATAGRAMS_AT_ONCE; k++) {
    from.size = sizeof from.address;
    const ssize_t many =
        recvfrom(link->file, bytes, sizeof bytes, 0, (struct sockaddr*)&from.address, &from.size);
    if (many < 0) {
      if (errno == ECONNREFUSED || errno == EINTR) {
        continue; /* nobody is there yet */
      }
      link->drained = errno == EAGAIN || errno == EWOULDBLOCK;
      return link->drained;
    }
    link->status.parse_state = MAVLINK_PARSE_STATE_IDLE; /* no frame goes on in another datagram */
    take(link, bytes, (size_t)many, &from, taker, to);
  }
  return true;
}

/* ------------------------------------------------------------------ sending */

static bool send_serial(int file, const uint8_t* bytes, size_t many) {
  SOTER_CHECK(file >= 0);
  size_t done = 0;
  while (done < many) {
    const ssize_t told = write(file, bytes + done, many - done);
    if (told > 0) {
      done += (size_t)told;
    } else if (told < 0 && errno == EAGAIN) {
      struct pollfd out = {.fd = file, .events = POLLOUT, .revents = 0};
      if (poll(&out, 1, SERIAL_WAIT_MS) <= 0) {
        return false;
      }
    } else if (told == 0 || errno != EINTR) {
      return false;
    }
  }
  return true;
}

void soter_mavlink_link_send(soter_mavlink_link* link, const soter_mavlink_address* to,
                             const mavlink_message_t* m) {
  uint8_t bytes[MAVLINK_MAX_PACKET_LEN];
  const size_t many = mavlink_msg_to_send_buffer(bytes, m);
  SOTER_CHECK(link->file >= 0 && many <= sizeof bytes);
  bool sent = false;
  if (link->serial) {
    sent = send_serial(link->file, bytes, many);
  } else if (link->speaks_first) {
    sent = send(link->file, bytes, many, MSG_NOSIGNAL) == (ssize_t)many;
  } else if (to != NULL && to->size > 0) {
    sent = sendto(link->file, bytes, many, MSG_NOSIGNAL, (const struct sockaddr*)&to->address,
                  to->size) == (ssize_t)many;
  }
  link->unsent += sent ? 0U : 1U;
}

bool soter_mavlink_same_address(const soter_mavlink_address* a, const soter_mavlink_address* b) {
  SOTER_CHECK(a->size <= sizeof a->address && b->size <= sizeof b->address);
  if (a->link != b->link || a->size != b->size) {
    return false;
  }
  if (a->size > 0 && a->address.ss_family == AF_INET) {
    const struct sockaddr_in* const x = (const struct sockaddr_in*)&a->address;
    const struct sockaddr_in* const y = (const struct sockaddr_in*)&b->address;
    return x->sin_port == y->sin_port && x->sin_addr.s_addr == y->sin_addr.s_addr;
  }
  return memcmp(&a->address, &b->address, a->size) == 0;
}
