/* microbit.c: a BBC micro:bit (nRF51822, Cortex-M0), as QEMU emulates it (-M microbit).
 *
 * Purpose: a board file (soter_board.h). Sizes are of the emulated board.
 */
#define BOARD_CORE "cortex-m0"
#define BOARD_CLOCK_HZ 16000000 /* SysTick counts it */
#define BOARD_FLASH_AT 0x00000000
#define BOARD_FLASH_BYTES 262144
#define BOARD_RAM_AT 0x20000000
#define BOARD_RAM_BYTES 16384
#define BOARD_STACK_BYTES 4096
#define BOARD_AC_BYTES 2048 /* of what is not trusted; no MPU guards the rest from it */
#define BOARD_QEMU "microbit"

#include "soter_board.h"
#include "soter_semihosting.h"

void soter_board_start(void) {}

bool soter_board_sense(uint32_t topic, void* value, int64_t now, int64_t* measured) {
  (void)topic;
  (void)value;
  (void)now;
  (void)measured;
  return false;
}

void soter_board_actuate(uint32_t module, const void* command, uint32_t size, bool leased) {
  (void)module;
  (void)command;
  (void)size;
  (void)leased;
}

void soter_board_watchdog(void) {}

void soter_board_say(const char* text) {
  soter_semihosting_say(text);
}

void soter_board_end(int code) {
  soter_semihosting_exit(code);
}
