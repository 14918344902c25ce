/* soter_cortex_m.c: from reset to main, and words. See soter_cortex_m.h.
 *
 * Purpose: vectors, the floating-point unit, variables; no printf. Non-goals: clocks (a board's),
 * interrupts of devices (none is enabled), what a loop does in its interrupts (soter_loop.c).
 */
#include "soter_cortex_m.h"

#include "soter_board.h"
#include "soter_check.h"

typedef void handler(void);

int main(void);

/* Of the linker script. */
extern uint32_t soter_stack_top, soter_data, soter_data_end, soter_data_load;
extern uint32_t soter_bss, soter_bss_end, soter_stack;
extern uint32_t soter_ac[], soter_ac_data_end[], soter_ac_data_load[], soter_ac_end[];

#define UNUSED_STACK UINT32_C(0x5ca1ab1e)
#define FRAME 64U /* bytes below the variables of on_reset that it may be using */

/* Copies words to `to` .. `end`, or zeros without `from`. */
static void fill(uint32_t* to, const uint32_t* end, const uint32_t* from) {
  while (to < end) {
    *to++ = from != NULL ? *from++ : 0U;
  }
}

static void on_reset(void) {
#if defined(__ARM_FP)
  SCB_CPACR |= 0xFU << 20; /* before the first double */
  __asm volatile("dsb\n isb" ::: "memory");
#endif
  fill(&soter_data, &soter_data_end, &soter_data_load);
  fill(&soter_bss, &soter_bss_end, NULL);
  fill(soter_ac, soter_ac_data_end, soter_ac_data_load);
  fill(soter_ac_data_end, soter_ac_end, NULL);
  const uint32_t here_variable = 0U;
  const uintptr_t here = (uintptr_t)&here_variable;
  for (uint32_t* to = &soter_stack; (uintptr_t)to < here - FRAME; to++) {
    *to = UNUSED_STACK;
  }
  soter_board_start();
  soter_board_end(main());
}

uint32_t soter_stack_used(void) {
  const uint32_t* word = &soter_stack;
  while (word < &soter_stack_top && *word == UNUSED_STACK) {
    word++;
  }
  SOTER_CHECK((uintptr_t)word <= (uintptr_t)&soter_stack_top);
  return (uint32_t)((uintptr_t)&soter_stack_top - (uintptr_t)word);
}

__attribute__((weak)) void HardFault_Handler(void) {
  soter_board_end(SOTER_EXIT_FAULT);
}

__attribute__((weak, alias("HardFault_Handler"))) void SVC_Handler(void);
__attribute__((weak, alias("HardFault_Handler"))) void PendSV_Handler(void);
__attribute__((weak, alias("HardFault_Handler"))) void SysTick_Handler(void);

__attribute__((section(".vectors"), used)) static const struct {
  uint32_t* stack;
  handler* handlers[15];
} vectors = {
    &soter_stack_top,
    {on_reset, HardFault_Handler, HardFault_Handler, HardFault_Handler, HardFault_Handler,
     HardFault_Handler, HardFault_Handler, HardFault_Handler, HardFault_Handler, HardFault_Handler,
     SVC_Handler, HardFault_Handler, HardFault_Handler, PendSV_Handler, SysTick_Handler}};

/* ------------------------------------------------------------------ words */

void soter_say_number(const char* before, uint64_t number, const char* after) {
  char room[21];
  char* digit = &room[20];
  *digit = '\0';
  do {
    digit--;
    *digit = (char)('0' + (char)(number % 10U));
    number /= 10U;
  } while (number > 0U);
  SOTER_CHECK(digit >= room);
  soter_board_say(before);
  soter_board_say(digit);
  soter_board_say(after);
}

static void say_bits(const char* before, uint64_t bits) {
  SOTER_CHECK(before != NULL);
  static const char digits[] = "0123456789abcdef";
  char room[17];
  for (uint32_t i = 0; i < 16U; i++) {
    room[i] = digits[(bits >> (60U - 4U * i)) & 0xFU];
  }
  room[16] = '\0';
  soter_board_say(before);
  soter_board_say(room);
}

bool soter_tested(const soter_program* p) {
  SOTER_CHECK(p != NULL);
  soter_operation o;
  if (!soter_arithmetic_is_right(&o)) {
    soter_board_say("not run: doubles are not IEEE 754 here: ");
    soter_board_say(soter_operation_name(o.kind));
    say_bits(" of a = 0x", o.a);
    say_bits(", b = 0x", o.b);
    say_bits(" is 0x", o.here);
    say_bits(", not 0x", o.right);
    soter_board_say("\n");
    return false;
  }
  const char* const wrong = soter_self_test(p);
  if (wrong != NULL) {
    soter_board_say("not run: ");
    soter_board_say(wrong);
    soter_board_say("\n");
  }
  return wrong == NULL;
}
