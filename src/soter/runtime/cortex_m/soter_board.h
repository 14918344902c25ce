/* soter_board.h: what a board gives a program: six functions, and a memory map.
 *
 * Purpose: the contract of a board file (docs/bare-metal.md). The file defines what lies where, as
 * numbers, each on a line of its own, which `soter build` reads (`#define BOARD_...`), and the six
 * functions below. Nothing else knows a board. Non-goals: what all Cortex-M have in common: start,
 * faults, SysTick, MPU (soter_cortex_m.h).
 */
#ifndef SOTER_BOARD_H
#define SOTER_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Clocks, pins, ports; actuators do what is safe without a command. Called once, interrupts off. */
void soter_board_start(void);

/* A new value of `topic`, as it lies in memory, and when it was measured (ns since the start, at
 * most `now`); false: nothing came since the last call. Never waits. */
bool soter_board_sense(uint32_t topic, void* value, int64_t now, int64_t* measured);

/* Applies the outputs of `module`, `size` bytes. In an interrupt, every tick: never waits.
 * `leased`: a command with a lease in force, else the fail-safe law. */
void soter_board_actuate(uint32_t module, const void* command, uint32_t size, bool leased);

/* Feeds the watchdog; the first call starts it. It resets the processor if it is not called for
 * several ticks. */
void soter_board_watchdog(void);

/* A line for a person, or a part of one. May do nothing. Not called while actuators are obeyed. */
void soter_board_say(const char* text);

/* There is no way on: the processor is reset, or stands still. `code`: 0 where all was well. Does
 * not return. */
#if defined(__GNUC__)
__attribute__((noreturn))
#endif
void soter_board_end(int code);

#ifdef __cplusplus
}
#endif

#endif
