/* dds_values.h: what stands in which field of the k-th sample.
 *
 * Purpose: one rule that whoever fills samples and whoever checks them knows (dds_fields.py has it
 * in Python): field i, element j. Non-goals: messages.
 */
#ifndef DDS_VALUES_H
#define DDS_VALUES_H

#include <stdint.h>
#include <stdio.h>

static inline uint32_t dds_mixed(uint32_t k, uint32_t i, uint32_t j) {
  return k * 2654435761u + i * 40503u + j * 7919u + 12345u;
}

static inline double dds_double(uint32_t k, uint32_t i, uint32_t j) {
  return (double)dds_mixed(k, i, j) / 1024.0 - 1.0e6;
}

static inline float dds_float(uint32_t k, uint32_t i, uint32_t j) {
  return (float)(dds_mixed(k, i, j) & 0xffffffu) / 256.0f;
}

/* Of a sequence: most are short, some are as long as a scan. */
static inline uint32_t dds_length(uint32_t k, uint32_t i) {
  const uint32_t mixed = dds_mixed(k, i, 0) >> 8;
  return mixed % 64u == 0u ? 360u + mixed % 361u : mixed % 24u;
}

/* `text` has room for 32 bytes. */
static inline const char* dds_text(uint32_t k, uint32_t i, char* text) {
  const uint32_t mixed = dds_mixed(k, i, 0) >> 8;
  const uint32_t length = mixed % 24u;
  uint32_t at = 0;
  for (; at < length; at++) {
    text[at] = (char)('a' + (mixed + at) % 26u);
  }
  text[at] = '\0';
  return text;
}

#endif
