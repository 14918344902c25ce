/* soter_semihosting.h: words to, settings and files from, the emulator or debugger of a Cortex-M.
 *
 * Purpose: what the boards that QEMU emulates say and how they end. Non-goals: boards without a
 * debugger, on which a semihosting call is a fault.
 */
#ifndef SOTER_SEMIHOSTING_H
#define SOTER_SEMIHOSTING_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

void soter_semihosting_say(const char* text);

/* What follows the name of the image on its command line; "" where there is none. */
const char* soter_semihosting_words(char* room, size_t size);

/* A file of the host, to be read; negative: there is none. */
int32_t soter_semihosting_open(const char* name);

/* Fills `room`; fewer bytes than `size` at the end of the file. */
uint32_t soter_semihosting_read(int32_t file, char* room, uint32_t size);

#if defined(__GNUC__)
__attribute__((noreturn))
#endif
void soter_semihosting_exit(int code);

#ifdef __cplusplus
}
#endif

#endif
