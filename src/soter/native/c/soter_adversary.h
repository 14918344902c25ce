/* soter_adversary.h: draws that mean harm.
 *
 * Takes the place of soter_draw where SOTER_ADVERSARY is defined: what the environment may choose
 * is chosen at its bounds, in one of several patterns; the seed's top byte says which. The same
 * function stands in src/soter/semantics/adverse_draws.py; both are tested against each other.
 */
#ifndef SOTER_ADVERSARY_H
#define SOTER_ADVERSARY_H

#define SOTER_GOLDEN UINT64_C(0x9e3779b97f4a7c15)

SOTER_INLINE uint64_t soter_spread(uint64_t key, uint64_t index) {
  return soter_mix(key + (index + 1U) * SOTER_GOLDEN);
}

SOTER_INLINE double soter_between(uint64_t bits, double low, double high) {
  const double u = (double)(bits >> 11) * 0x1p-53;
  return soter_min(low + (high - low) * u, high);
}

/* Segments of 2^3 to 2^10 draws: one end, the other, chance once, or chance every time. */
SOTER_INLINE double soter_mixed(uint64_t key, uint64_t index, double low, double high) {
  const uint64_t segment = soter_spread(key, index >> (3U + (key & 7U)));
  switch (segment & 3U) {
    case 0:
      return low;
    case 1:
      return high;
    case 2:
      return soter_between(segment, low, high);
    default:
      return soter_between(soter_spread(key, index), low, high);
  }
}

SOTER_INLINE double soter_draw(const soter_header* h, uint64_t stream, int64_t at, double low,
                               double high) {
  const uint64_t key = soter_mix(h->seed_key ^ stream);
  const uint64_t index = (uint64_t)at;
  uint64_t side = key >> 63;
  switch (h->seed >> 56) {
    case 1: /* one end for ever */
      break;
    case 2: /* one end, then the other */
      side ^= index >= ((key >> 8) & 0xffffU) % (UINT64_C(1) << (key % 14U)) ? 1U : 0U;
      break;
    case 3: /* a random end for 2^k draws at a time */
      side = soter_spread(key, index >> (key % 13U)) >> 63;
      break;
    case 4: /* the same, all streams turning at once */
      side ^= soter_spread(h->seed_key, index >> (h->seed_key % 13U)) >> 63;
      break;
    case 5:
      return soter_mixed(key, index, low, high);
    default:
      return soter_between(soter_spread(key, index), low, high);
  }
  return side != 0U ? high : low;
}

#endif
