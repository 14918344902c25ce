/* soter_unprivileged.c: see soter_unprivileged.h. Registers: Armv7-M Architecture Reference Manual,
 * B1.5, B3.5.
 *
 * The thread has the process stack. An interrupt that wants another step makes a new frame at its
 * top and returns into that; the frame that was there is forgotten.
 */
#include "soter_unprivileged.h"

#include "soter_check.h"

#include <stddef.h>

#define SCB_CCR (*(volatile uint32_t*)0xE000ED14U)
#define SCB_SHPR1 (*(volatile uint32_t*)0xE000ED18U)
#define SCB_SHPR2 (*(volatile uint32_t*)0xE000ED1CU)
#define SCB_SHPR3 (*(volatile uint32_t*)0xE000ED20U)
#define SCB_SHCSR (*(volatile uint32_t*)0xE000ED24U)
#define SCB_CFSR (*(volatile uint32_t*)0xE000ED28U)
#define MPU_TYPE (*(volatile uint32_t*)0xE000ED90U)
#define MPU_CTRL (*(volatile uint32_t*)0xE000ED94U)
#define MPU_RBAR (*(volatile uint32_t*)0xE000ED9CU)
#define MPU_RASR (*(volatile uint32_t*)0xE000EDA0U)
#define FPU_FPCCR (*(volatile uint32_t*)0xE000EF34U)

#define LOWEST 0xF0U
#define TICK_PRIORITY 0x20U /* below faults, above all else */
#define VALID 0x10U
#define ENABLE 1U
#define NORMAL_MEMORY (1U << 17 | 1U << 16) /* TEX 0, C, B */
#define READ_ONLY (6U << 24)
#define READ_WRITE (3U << 24)
#define NEVER_EXECUTED (1U << 28)
#define THREAD_BASIC 0xFFFFFFFDU
#define THUMB_STATE (1U << 24)
#define FRAME_WORDS 8U
#define FROM_THREAD 8U /* of an EXC_RETURN */

extern uint32_t soter_ac[], soter_ac_end[], soter_flash[], soter_flash_end[];

static volatile soter_unprivileged_state now;
static volatile bool replaced; /* there is a new frame to return into */
static int result;

soter_unprivileged_state soter_unprivileged_now(void) {
  return now;
}

int soter_unprivileged_result(void) {
  SOTER_CHECK(now == SOTER_UNPRIVILEGED_DONE);
  return result;
}

#if !defined(__ARM_ARCH_6M__)
/* The exponent of the smallest region that holds so many bytes. */
static uint32_t region_size(uint32_t bytes) {
  SOTER_CHECK(bytes > 0U);
  uint32_t log = 5;
  while (log < 32U && (UINT64_C(1) << log) < bytes) {
    log++;
  }
  return (log - 1U) << 1;
}

static void protect_memory(void) {
  SCB_SHPR1 = 0U;
  SCB_SHCSR |= 7U << 16;        /* faults of memory, bus, use have handlers */
  SCB_CCR |= 1U << 4 | 1U << 9; /* a division by zero is one; frames begin at multiples of 8 */
#if defined(__ARM_FP)
  FPU_FPCCR &= ~(1U << 30); /* registers are saved at once: a frame that is forgotten owes none */
#endif
  if ((MPU_TYPE >> 8 & 0xFFU) < 2U) {
    return;
  }
  const uint32_t flash = (uint32_t)((uintptr_t)soter_flash_end - (uintptr_t)soter_flash);
  const uint32_t own = (uint32_t)((uintptr_t)soter_ac_end - (uintptr_t)soter_ac);
  SOTER_CHECK((own & (own - 1U)) == 0U && ((uintptr_t)soter_ac & (own - 1U)) == 0U);
  MPU_RBAR = (uint32_t)(uintptr_t)soter_flash | VALID | 0U;
  MPU_RASR = READ_ONLY | NORMAL_MEMORY | region_size(flash) | ENABLE;
  MPU_RBAR = (uint32_t)(uintptr_t)soter_ac | VALID | 1U;
  MPU_RASR = READ_WRITE | NEVER_EXECUTED | NORMAL_MEMORY | region_size(own) | ENABLE;
  MPU_CTRL = 1U << 2 | ENABLE; /* whoever is privileged sees all */
  __asm volatile("dsb\n isb" ::: "memory");
}
#endif

void soter_unprivileged_protect(void) {
  SCB_SHPR2 = LOWEST << 24;
  SCB_SHPR3 = TICK_PRIORITY << 24 | LOWEST << 16;
#if !defined(__ARM_ARCH_6M__) /* it has one fault, and neither an MPU of this layout nor traps */
  protect_memory();
#endif
}

/* ------------------------------------------------------------------ the thread */

static void wait(void) {
  for (;;) {
    __asm volatile("wfi");
  }
}

static void compute(soter_unprivileged_step* step, const void* in, void* out) {
  register int code __asm("r0") = step(in, out);
  __asm volatile("svc 0" : : "r"(code) : "memory");
  wait();
}

static void set_process_stack(const uint32_t* top) {
  SOTER_CHECK(((uintptr_t)top & 7U) == 0U);
  __asm volatile("msr psp, %0" : : "r"(top) : "memory");
}

/* What the thread does from the next return on. */
static void replace(uintptr_t code, uintptr_t r0, uintptr_t r1, uintptr_t r2) {
  uint32_t* const frame = (uint32_t*)((uintptr_t)soter_ac_end - 4U * FRAME_WORDS);
  SOTER_CHECK((uintptr_t)frame > (uintptr_t)soter_ac);
  for (uint32_t i = 0; i < FRAME_WORDS; i++) {
    frame[i] = 0U;
  }
  frame[0] = (uint32_t)r0;
  frame[1] = (uint32_t)r1;
  frame[2] = (uint32_t)r2;
  frame[6] = (uint32_t)code & ~UINT32_C(1);
  frame[7] = THUMB_STATE;
  set_process_stack(frame);
  replaced = true;
}

void soter_unprivileged_begin(soter_unprivileged_step* step, const void* in, void* out) {
  SOTER_CHECK(step != NULL && in != NULL && out != NULL);
  SOTER_CHECK(now != SOTER_UNPRIVILEGED_RUNS);
  now = SOTER_UNPRIVILEGED_RUNS;
  replace((uintptr_t)compute, (uintptr_t)step, (uintptr_t)in, (uintptr_t)out);
}

void soter_unprivileged_end(void) {
  now = SOTER_UNPRIVILEGED_IDLE;
  replace((uintptr_t)wait, 0U, 0U, 0U);
}

uint32_t soter_unprivileged_return(uint32_t from) {
  const bool other = replaced;
  replaced = false;
  return other ? THREAD_BASIC : from;
}

void soter_unprivileged_become(void) {
  SOTER_CHECK((uintptr_t)soter_ac < (uintptr_t)soter_ac_end);
  set_process_stack(soter_ac_end);
  __asm volatile("msr control, %0\n isb" : : "r"(3U) : "memory"); /* no way back */
  for (;;) {
    wait();
  }
}

/* ------------------------------------------------------------------ its ends */

/* The thread says that its step is done; r0 of its frame is the result. */
__attribute__((used)) static uint32_t called(const uint32_t* frame, uint32_t from) {
  if (now == SOTER_UNPRIVILEGED_RUNS) {
    result = (int)frame[0];
    now = SOTER_UNPRIVILEGED_DONE;
  }
  replace((uintptr_t)wait, 0U, 0U, 0U);
  return soter_unprivileged_return(from);
}

__attribute__((naked)) void SVC_Handler(void) {
  __asm volatile("mrs r0, psp\n mov r1, lr\n push {r0, lr}\n bl called\n pop {r1, r2}\n bx r0");
}

uint32_t soter_unprivileged_stopped(uint32_t from) {
  SOTER_CHECK((from & FROM_THREAD) != 0U);
#if !defined(__ARM_ARCH_6M__)
  SCB_CFSR = SCB_CFSR;
#endif
  now = SOTER_UNPRIVILEGED_FAULT;
  replace((uintptr_t)wait, 0U, 0U, 0U);
  return soter_unprivileged_return(from);
}
