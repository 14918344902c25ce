/* telling_board.c: a board of QEMU whose sensor, at some tick, does what the test wants.
 *
 * Purpose: who is obeyed, tick by tick: the law or a lease; what KIND does to the trusted part. The
 * watchdog is that of the board: its first alarm is an interrupt, its second a reset.
 * Non-goals: a plant: the position is what each case says.
 */
#define BOARD_CORE "cortex-m7"
#define BOARD_CLOCK_HZ 25000000
#define BOARD_FLASH_AT 0x00000000
#define BOARD_FLASH_BYTES 4194304
#define BOARD_RAM_AT 0x20000000
#define BOARD_RAM_BYTES 4194304
#define BOARD_STACK_BYTES 8192
#define BOARD_AC_BYTES 8192
#define BOARD_QEMU "mps2-an500"

#include "soter_board.h"
#include "soter_cortex_m.h"
#include "soter_semihosting.h"

#define MARK UINT32_C(0x51ab1e)
#define WHEN 1000U
#define LAST 2500U
#define BESIDE_THE_WALL 9.9
#define WATCHDOG(offset) (*(volatile uint32_t*)(0x40008000U + (offset)))

enum { NOTHING = 0, SILENCE = 1, FAULT = 2, HANG = 3, CHECK = 4 };

__attribute__((section(".kept"))) static struct { /* by no start */
  uint32_t mark, starts;
} kept;
static uint32_t ticks, told = 2;
static bool fed;

void soter_board_start(void) {
  kept.starts = kept.mark == MARK ? kept.starts + 1U : 1U;
  kept.mark = MARK;
}

/* The robot moves: after a restart it is beside the wall for a while. */
static double position(void) {
  return kept.starts > 1U && ticks < WHEN / 2U ? BESIDE_THE_WALL : 0.0;
}

bool soter_board_sense(uint32_t topic, void* value, int64_t now, int64_t* measured) {
  const bool now_it_is = ticks > WHEN && kept.starts == 1U;
  (void)topic;
  if (now_it_is && KIND == FAULT) {
    *(volatile uint32_t*)0xF0000000U = 1U;
  }
  while (now_it_is && KIND == HANG) {
  }
  SOTER_CHECK(!now_it_is || KIND != CHECK);
  *(double*)value = position();
  *measured = now;
  return !now_it_is || KIND != SILENCE;
}

void soter_board_actuate(uint32_t module, const void* command, uint32_t size, bool leased) {
  (void)module;
  (void)size;
  ticks++;
  if (told != (leased ? 1U : 0U)) {
    told = leased ? 1U : 0U;
    soter_say_number("start ", kept.starts, ": ");
    soter_say_number(leased ? "a lease from " : "the law from ", ticks, "\n");
  }
  if (!leased && *(const double*)command != 0.0) {
    soter_board_say("another law\n");
  }
  if (ticks >= LAST) {
    soter_semihosting_exit(0);
  }
}

void soter_board_watchdog(void) {
  WATCHDOG(0xC00) = 0x1ACCE551U;
  if (!fed) {
    WATCHDOG(0) = BOARD_CLOCK_HZ / 20; /* 50 ms */
    WATCHDOG(8) = 3U;
    fed = true;
  }
  WATCHDOG(0xC) = 1U;
}

void soter_board_say(const char* text) {
  soter_semihosting_say(text);
}

/* The watchdog ends it. */
void soter_board_end(int code) {
  soter_say_number("ended with ", (uint64_t)code, "\n");
  for (;;) {
  }
}
