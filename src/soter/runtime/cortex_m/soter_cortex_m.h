/* soter_cortex_m.h: what all Cortex-M have in common.
 *
 * Purpose: registers of the core (Armv7-M Architecture Reference Manual, B3), the start, words
 * without printf, the self-test of the arithmetic told in words. Non-goals: boards (soter_board.h).
 */
#ifndef SOTER_CORTEX_M_H
#define SOTER_CORTEX_M_H

#include "soter.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SYST_CSR (*(volatile uint32_t*)0xE000E010U)
#define SYST_RVR (*(volatile uint32_t*)0xE000E014U)
#define SYST_CVR (*(volatile uint32_t*)0xE000E018U)
#define SCB_CPACR (*(volatile uint32_t*)0xE000ED88U)

#define SYST_MOST UINT32_C(0xFFFFFF) /* it counts 24 bits, down */

enum { SOTER_EXIT_ARITHMETIC = 1, SOTER_EXIT_VIOLATED = 3, SOTER_EXIT_DEFECT = 70 };
enum { SOTER_EXIT_FAULT = 71 };

/* Bytes of the stack that were ever written to since the reset. */
uint32_t soter_stack_used(void);

void soter_say_number(const char* before, uint64_t number, const char* after);

/* Whether this build computes as programs mean it; else says what is wrong, with its operands. */
bool soter_tested(const soter_program* p);

#ifdef __cplusplus
}
#endif

#endif
