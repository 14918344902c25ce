/* firmware_script.c: the firmware interface of the cart, told what to do line by line.
 *
 * Purpose: tests say `motion x v measured now`, `goal g measured now`, `step now`, `jump n` and
 * compare what comes back and every byte of the state.
 * Non-goals: an example (examples/wall/firmware).
 */
#include "Vehicle_firmware.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static Vehicle vehicle;

/* Moves the calendar on by so many ns, as if that time had gone by with nothing heard or decided. */
static void jump(int64_t by) {
  soter_component* const c = soter_components_of(&vehicle.state);
  soter_header_of(&vehicle.state)->ct += by;
  for (uint32_t i = 0; i < vehicle.loop.program->components; i++) {
    c[i].next += by;
  }
}

static void print_state(void) {
  const unsigned char* const bytes = (const unsigned char*)&vehicle.state;
  for (size_t i = 0; i < sizeof vehicle.state; i++) {
    (void)printf("%02x", (unsigned)bytes[i]);
  }
}

static void print_read(void) {
  double accel = 0.0;
  int64_t stamp = 0;
  const bool ever = Vehicle_read_accel(&vehicle, &accel, &stamp);
  (void)printf(" %a %d %" PRId64 " %d %" PRId64, accel, ever ? 1 : 0, stamp,
               (int)Vehicle_mode_SafeCart(&vehicle), Vehicle_next(&vehicle));
}

static void one(const char* word, char** at) {
  double a = 0.0;
  double b = 0.0;
  if (strcmp(word, "motion") == 0 || strcmp(word, "goal") == 0) {
    a = strtod(*at, at);
  }
  if (strcmp(word, "motion") == 0) {
    b = strtod(*at, at);
  }
  const int64_t first = strtoll(*at, at, 10);
  if (strcmp(word, "motion") == 0) {
    Vehicle_motion value;
    (void)memset(&value, 0, sizeof value);
    value.x = a;
    value.v = b;
    (void)printf("%d\n", (int)Vehicle_publish_motion(&vehicle, &value, first, strtoll(*at, at, 10)));
  } else if (strcmp(word, "goal") == 0) {
    (void)printf("%d\n", (int)Vehicle_publish_goal(&vehicle, a, first, strtoll(*at, at, 10)));
  } else if (strcmp(word, "start") == 0) {
    const char* const wrong = Vehicle_start(&vehicle, first);
    (void)printf("%s\n", wrong == NULL ? "started" : wrong);
  } else if (strcmp(word, "older") == 0) {
    (void)printf("%s\n", Vehicle_start_as(&vehicle, "0", sizeof vehicle, 1U, first));
  } else if (strcmp(word, "jump") == 0) {
    jump(first);
    (void)printf("jumped\n");
  } else {
    (void)printf("%" PRIu32 " ", Vehicle_step(&vehicle, first));
    print_state();
    print_read();
    (void)printf(" %" PRId64 " %" PRIu32 " %" PRIu32 "\n", vehicle.loop.lateness,
                 vehicle.loop.late_steps, vehicle.loop.behind_steps);
  }
}

int main(void) {
  char line[256];
  while (fgets(line, sizeof line, stdin) != NULL) {
    char* const space = strchr(line, ' ');
    if (space == NULL) {
      return 2;
    }
    *space = '\0';
    char* at = space + 1;
    one(line, &at);
  }
  return 0;
}
