/* soter_explore_symmetry.c: one packed configuration for all that differ by the places of equal
 * instances.
 *
 * Purpose: the blocks of every family are put into order, which is a permutation that maps
 * executions to executions (docs/testing.md, "Equal instances"). Families come with those of small
 * blocks first, so what lies inside of a block is in order when the block is compared.
 * Non-goals: which instances are equal (explore/model/symmetric_blocks.py).
 */
#include "soter_explore_internal.h"
#include "soter_explore_pack.h"

#define BLOCKS SOTER_ACTORS /* each has an actor */

static uint64_t field_of(const soter_family* f, const uint64_t* packed, uint32_t block,
                         uint32_t k) {
  const soter_field* const at = &f->field[(size_t)block * f->fields + k];
  SOTER_CHECK(block < f->blocks && at->width >= 1U && at->width <= 64U);
  return soter_get(packed, at->at, at->width);
}

static void set_field(const soter_field* at, uint64_t* packed, uint64_t value) {
  const uint64_t all = at->width < 64U ? (UINT64_C(1) << at->width) - 1U : UINT64_MAX;
  const uint32_t shift = at->at % 64U;
  uint64_t* const word = packed + at->at / 64U;
  SOTER_CHECK((value & ~all) == 0U);
  word[0] = (word[0] & ~(all << shift)) | value << shift;
  if (shift + at->width > 64U) {
    word[1] = (word[1] & ~(all >> (64U - shift))) | value >> (64U - shift);
  }
}

static bool is_less(const soter_family* f, const uint64_t* packed, uint32_t a, uint32_t b) {
  for (uint32_t k = 0; k < f->fields; k++) {
    const uint64_t x = field_of(f, packed, a, k);
    const uint64_t y = field_of(f, packed, b, k);
    if (x != y) {
      return x < y;
    }
  }
  return false;
}

/* Which block comes where; false: each stays where it is. */
static bool sort_blocks(const soter_family* f, const uint64_t* packed, uint32_t* order) {
  bool moves = false;
  SOTER_CHECK(f->blocks >= 2U && f->blocks <= BLOCKS);
  for (uint32_t i = 0; i < f->blocks; i++) {
    uint32_t k = i;
    for (; k > 0U && is_less(f, packed, i, order[k - 1U]); k--) {
      order[k] = order[k - 1U];
    }
    order[k] = i;
    moves = moves || k < i;
  }
  return moves;
}

void soter_fold(const soter_explore_options* o, uint64_t* packed) {
  for (uint32_t n = 0; n < o->families; n++) {
    const soter_family* const f = &o->family[n];
    uint32_t order[BLOCKS];
    if (!sort_blocks(f, packed, order)) {
      continue;
    }
    for (uint32_t k = 0; k < f->fields; k++) {
      uint64_t value[BLOCKS];
      for (uint32_t b = 0; b < f->blocks; b++) {
        value[b] = field_of(f, packed, order[b], k);
      }
      for (uint32_t b = 0; b < f->blocks; b++) {
        set_field(&f->field[(size_t)b * f->fields + k], packed, value[b]);
      }
    }
  }
}
