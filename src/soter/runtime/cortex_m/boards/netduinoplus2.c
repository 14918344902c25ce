/* netduinoplus2.c: an STM32F405 (Cortex-M4, as on Olimex STM32-H405), as QEMU emulates it (-M
 * netduinoplus2).
 *
 * Purpose: a board file (soter_board.h). Sizes are of the emulated board.
 */
#define BOARD_CORE "cortex-m4"
#define BOARD_CLOCK_HZ 168000000 /* SysTick counts it */
#define BOARD_FLASH_AT 0x08000000
#define BOARD_FLASH_BYTES 1048576
#define BOARD_RAM_AT 0x20000000
#define BOARD_RAM_BYTES 131072
#define BOARD_STACK_BYTES 8192
#define BOARD_AC_BYTES 8192 /* memory of what is not trusted */
#define BOARD_QEMU "netduinoplus2"

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
