/* mps2_an500.c: Arm's MPS2 with the image of Cortex-M7, as QEMU emulates it (-M mps2-an500).
 *
 * Purpose: a board file (soter_board.h). Sizes are of the emulated board.
 */
#define BOARD_CORE "cortex-m7"
#define BOARD_CLOCK_HZ 25000000 /* SysTick counts it */
#define BOARD_FLASH_AT 0x00000000
#define BOARD_FLASH_BYTES 4194304
#define BOARD_RAM_AT 0x20000000
#define BOARD_RAM_BYTES 4194304
#define BOARD_STACK_BYTES 131072
#define BOARD_AC_BYTES 8192 /* memory of what is not trusted */
#define BOARD_QEMU "mps2-an500"

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
