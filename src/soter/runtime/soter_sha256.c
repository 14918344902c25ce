/* soter_sha256.c: see soter_sha256.h. */
#include "soter_sha256.h"

#include "soter_check.h"

static uint32_t rotate(uint32_t x, uint32_t n) {
  return (x >> n) | (x << (32U - n));
}

static void compress(soter_sha256* s) {
  static const uint32_t k[64] = {
      0x428a2f98U, 0x71374491U, 0xb5c0fbcfU, 0xe9b5dba5U, 0x3956c25bU, 0x59f111f1U, 0x923f82a4U,
      0xab1c5ed5U, 0xd807aa98U, 0x12835b01U, 0x243185beU, 0x550c7dc3U, 0x72be5d74U, 0x80deb1feU,
      0x9bdc06a7U, 0xc19bf174U, 0xe49b69c1U, 0xefbe4786U, 0x0fc19dc6U, 0x240ca1ccU, 0x2de92c6fU,
      0x4a7484aaU, 0x5cb0a9dcU, 0x76f988daU, 0x983e5152U, 0xa831c66dU, 0xb00327c8U, 0xbf597fc7U,
      0xc6e00bf3U, 0xd5a79147U, 0x06ca6351U, 0x14292967U, 0x27b70a85U, 0x2e1b2138U, 0x4d2c6dfcU,
      0x53380d13U, 0x650a7354U, 0x766a0abbU, 0x81c2c92eU, 0x92722c85U, 0xa2bfe8a1U, 0xa81a664bU,
      0xc24b8b70U, 0xc76c51a3U, 0xd192e819U, 0xd6990624U, 0xf40e3585U, 0x106aa070U, 0x19a4c116U,
      0x1e376c08U, 0x2748774cU, 0x34b0bcb5U, 0x391c0cb3U, 0x4ed8aa4aU, 0x5b9cca4fU, 0x682e6ff3U,
      0x748f82eeU, 0x78a5636fU, 0x84c87814U, 0x8cc70208U, 0x90befffaU, 0xa4506cebU, 0xbef9a3f7U,
      0xc67178f2U};
  uint32_t w[64];
  for (uint32_t i = 0; i < 16U; i++) {
    const uint8_t* const b = s->block + 4U * i;
    w[i] = ((uint32_t)b[0] << 24) | ((uint32_t)b[1] << 16) | ((uint32_t)b[2] << 8) | b[3];
  }
  for (uint32_t i = 16; i < 64U; i++) {
    const uint32_t low = rotate(w[i - 15U], 7) ^ rotate(w[i - 15U], 18) ^ (w[i - 15U] >> 3);
    const uint32_t high = rotate(w[i - 2U], 17) ^ rotate(w[i - 2U], 19) ^ (w[i - 2U] >> 10);
    w[i] = w[i - 16U] + low + w[i - 7U] + high;
  }
  uint32_t v[8];
  for (uint32_t i = 0; i < 8U; i++) {
    v[i] = s->h[i];
  }
  for (uint32_t i = 0; i < 64U; i++) {
    const uint32_t sum1 = rotate(v[4], 6) ^ rotate(v[4], 11) ^ rotate(v[4], 25);
    const uint32_t choice = (v[4] & v[5]) ^ (~v[4] & v[6]);
    const uint32_t t1 = v[7] + sum1 + choice + k[i] + w[i];
    const uint32_t sum0 = rotate(v[0], 2) ^ rotate(v[0], 13) ^ rotate(v[0], 22);
    const uint32_t majority = (v[0] & v[1]) ^ (v[0] & v[2]) ^ (v[1] & v[2]);
    for (uint32_t j = 7; j > 0U; j--) {
      v[j] = v[j - 1U];
    }
    v[4] += t1;
    v[0] = t1 + sum0 + majority;
  }
  for (uint32_t i = 0; i < 8U; i++) {
    s->h[i] += v[i];
  }
}

void soter_sha256_start(soter_sha256* s) {
  static const uint32_t h[8] = {0x6a09e667U, 0xbb67ae85U, 0x3c6ef372U, 0xa54ff53aU,
                                0x510e527fU, 0x9b05688cU, 0x1f83d9abU, 0x5be0cd19U};
  SOTER_CHECK(s != NULL);
  for (uint32_t i = 0; i < 8U; i++) {
    s->h[i] = h[i];
  }
  s->length = 0;
}

void soter_sha256_add(soter_sha256* s, const void* data, size_t size) {
  SOTER_CHECK(s != NULL);
  SOTER_CHECK(data != NULL || size == 0U);
  const uint8_t* const bytes = (const uint8_t*)data;
  for (size_t i = 0; i < size; i++) {
    s->block[s->length % SOTER_SHA256_BLOCK] = bytes[i];
    s->length++;
    if (s->length % SOTER_SHA256_BLOCK == 0U) {
      compress(s);
    }
  }
}

void soter_sha256_end(soter_sha256* s, char text[65]) {
  static const char digits[] = "0123456789abcdef";
  static const uint8_t one = 0x80U;
  static const uint8_t zero = 0x00U;
  SOTER_CHECK(s != NULL);
  SOTER_CHECK(text != NULL);
  const uint64_t bits = s->length * 8U;
  soter_sha256_add(s, &one, 1);
  while (s->length % SOTER_SHA256_BLOCK != SOTER_SHA256_BLOCK - 8U) {
    soter_sha256_add(s, &zero, 1);
  }
  for (uint32_t i = 0; i < 8U; i++) {
    const uint8_t byte = (uint8_t)(bits >> (56U - 8U * i));
    soter_sha256_add(s, &byte, 1);
  }
  for (uint32_t i = 0; i < 64U; i++) {
    text[i] = digits[(s->h[i / 8U] >> (28U - 4U * (i % 8U))) & 0xFU];
  }
  text[64] = '\0';
}
