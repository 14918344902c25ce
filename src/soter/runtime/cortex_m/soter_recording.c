/* soter_recording.c: see soter_recording.h. A file ends where it is spoilt. */
#include "soter_recording.h"

#include "soter_app.h"
#include "soter_check.h"
#include "soter_loop_app.h"
#include "soter_semihosting.h"

#define NOTHING (-1)

void soter_recording_open(soter_recording* r, const char* file) {
  SOTER_CHECK(r != NULL && file != NULL);
  r->file = file[0] != '\0' ? soter_semihosting_open(file) : -1;
  r->at = 0U;
  r->filled = 0U;
  r->waits = false;
}

/* The next character of the file; NOTHING at its end. */
static int character(soter_recording* r) {
  SOTER_CHECK(r->at <= r->filled && r->filled <= sizeof r->room);
  if (r->at == r->filled && r->file >= 0) {
    r->filled = soter_semihosting_read(r->file, r->room, sizeof r->room);
    r->at = 0U;
    r->file = r->filled > 0U ? r->file : -1;
  }
  if (r->file < 0) {
    return NOTHING;
  }
  r->at++;
  return r->room[r->at - 1U];
}

static int64_t number(soter_recording* r) {
  int64_t n = 0;
  int letter = character(r);
  while (letter >= '0' && letter <= '9') {
    n = 10 * n + (letter - '0');
    letter = character(r);
  }
  return n;
}

static uint32_t digit(int letter) {
  return (uint32_t)(letter >= 'a' ? letter - 'a' + 10 : letter - '0');
}

/* The bytes of a value; whether they were all there. */
static bool value(soter_recording* r, uint8_t* to, size_t size) {
  SOTER_CHECK(size <= APP_TOPIC_WORDS * sizeof(uint64_t));
  for (size_t i = 0; i < size; i++) {
    const int high = character(r);
    const int low = character(r);
    to[i] = (uint8_t)(digit(high) << 4 | digit(low));
  }
  return character(r) == '\n';
}

void soter_recording_publish(soter_recording* r, const soter_program* p, void* state,
                             int64_t next) {
  SOTER_CHECK(p != NULL && state != NULL);
  static uint64_t given[APP_TOPIC_WORDS];
  for (;;) {
    if (!r->waits) {
      r->measured = number(r);
      r->topic = (uint32_t)number(r);
      r->waits = true;
    }
    if (r->file < 0 || r->topic >= p->topics || r->measured > next) {
      return;
    }
    if (!value(r, (uint8_t*)given, p->topic[r->topic].size)) {
      r->file = -1; /* spoilt */
      return;
    }
    (void)soter_publish(p, state, r->topic, given, r->measured);
    r->waits = false;
  }
}
