/* soter_semihosting.c: see soter_semihosting.h. Numbers: Arm's "Semihosting for AArch32". */
#include "soter_semihosting.h"

#include "soter_check.h"

#include <string.h>

#define SYS_OPEN 0x01U
#define SYS_WRITE0 0x04U
#define SYS_READ 0x06U
#define SYS_GET_CMDLINE 0x15U
#define SYS_EXIT_EXTENDED 0x20U
#define APPLICATION_EXIT 0x20026U

static uint32_t call(uint32_t operation, const void* argument) {
  register uint32_t r0 __asm("r0") = operation;
  register const void* r1 __asm("r1") = argument;
  __asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
  return r0;
}

void soter_semihosting_say(const char* text) {
  (void)call(SYS_WRITE0, text);
}

const char* soter_semihosting_words(char* room, size_t size) {
  SOTER_CHECK(room != NULL && size > 0U);
  const struct {
    char* room;
    uint32_t size;
  } block = {room, (uint32_t)size};
  if (call(SYS_GET_CMDLINE, &block) != 0U) {
    return "";
  }
  while (*room != '\0' && *room != ' ') {
    room++;
  }
  return *room == ' ' ? room + 1 : room;
}

int32_t soter_semihosting_open(const char* name) {
  SOTER_CHECK(name != NULL);
  const struct {
    const char* name;
    uint32_t mode, length;
  } block = {name, 1U, (uint32_t)strlen(name)}; /* "rb" */
  return (int32_t)call(SYS_OPEN, &block);
}

uint32_t soter_semihosting_read(int32_t file, char* room, uint32_t size) {
  SOTER_CHECK(file >= 0 && room != NULL);
  const struct {
    int32_t file;
    char* room;
    uint32_t size;
  } block = {file, room, size};
  const uint32_t left = call(SYS_READ, &block);
  return left <= size ? size - left : 0U;
}

void soter_semihosting_exit(int code) {
  const uint32_t block[2] = {APPLICATION_EXIT, (uint32_t)code};
  for (;;) {
    (void)call(SYS_EXIT_EXTENDED, block);
  }
}
