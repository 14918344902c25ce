/* soter_sha256.h: SHA-256 (FIPS 180-4) over bytes that come in pieces.
 *
 * Purpose: a target computes the same `trace_sha256` as `soter run`, so that a person sees that
 * it computes the same thing.
 * Non-goals: speed, secrets.
 */
#ifndef SOTER_SHA256_H
#define SOTER_SHA256_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SOTER_SHA256_BLOCK 64U

typedef struct {
  uint32_t h[8];
  uint64_t length; /* bytes so far */
  uint8_t block[SOTER_SHA256_BLOCK];
} soter_sha256;

void soter_sha256_start(soter_sha256* s);
void soter_sha256_add(soter_sha256* s, const void* data, size_t size);

/* Ends the hash and writes it as 64 lower-case digits and a zero byte. */
void soter_sha256_end(soter_sha256* s, char text[65]);

#ifdef __cplusplus
}
#endif

#endif
