/* soter_self_test.c: does this build compute as programs mean it?
 *
 * Purpose: find at start what no compiler tells: flags without a macro, what was linked or set
 * before (start code of -ffast-math that flushes small numbers to zero, another rounding), in the
 * file of the program, too, which another build system may have compiled; and operations that round
 * wrongly, as those of a C library for processors without doubles may (docs/bare-metal.md). The
 * right results are computed with integers alone.
 * Non-goals: flags that soter.h refuses as it compiles; a proof: operands are some ten thousand.
 */
#include "soter.h"

#include <string.h>

#define IMPLICIT (UINT64_C(1) << 52)
#define SIGN (UINT64_C(1) << 63)
#define INFINITE (UINT64_C(0x7ff) << 52)
#define BIAS 1075 /* a double is its significand, an integer, times two to the exponent - BIAS */
#define GUARD 9   /* bits behind the last one of a sum, the last of them sticky */
#define QUOTIENT_BITS 57
#define GAP_MOST 70
#define DRAWS 3 /* of each gap, sign and order */
#define PAIRS 320
#define ROOTS 200

static uint64_t bits_of(double x) {
  uint64_t bits = 0;
  (void)memcpy(&bits, &x, sizeof bits);
  return bits;
}

static double double_of(uint64_t bits) {
  double x = 0.0;
  (void)memcpy(&x, &bits, sizeof x);
  return x;
}

/* ------------------------------------------------------------------ right results, with integers
 */

/* Shifts a number below 2^(bit + 1), if it is not 0, until this bit is set; by how much. */
static int32_t raised(uint64_t* m, uint32_t bit) {
  int32_t by = 0;
  for (uint32_t step = 32; step > 0U && *m != 0U; step /= 2U) {
    while (*m >> (bit + 1U - step) == 0U) {
      *m <<= step;
      by += (int32_t)step;
    }
  }
  return by;
}

/* The double nearest to m times two to the exponent, m below 2^63, its last bit sticky. */
static uint64_t nearest(uint64_t sign, int32_t exponent, uint64_t m) {
  if (m == 0U) {
    return sign;
  }
  exponent -= raised(&m, 62);
  const int32_t biased = exponent + 10 + BIAS;
  if (biased > 2046) {
    return sign | INFINITE;
  }
  const int32_t below = biased < 1 ? 1 - biased : 0; /* subnormal: so many bits fewer */
  const uint32_t drop = below > 52 ? 62U : (uint32_t)(10 + below);
  m = below > 53 ? 1U : m; /* less than half of the least one */
  const uint64_t half = UINT64_C(1) << (drop - 1U);
  const uint64_t rest = m & (2U * half - 1U);
  uint64_t kept = m >> drop;
  kept += rest > half || (rest == half && (kept & 1U) != 0U) ? 1U : 0U;
  return sign | (kept + ((uint64_t)(biased < 1 ? 0 : biased - 1) << 52));
}

static int32_t exponent_of(uint64_t bits) {
  const int32_t e = (int32_t)((bits >> 52) & 0x7ffU);
  return e == 0 ? 1 : e;
}

static uint64_t significand_of(uint64_t bits) {
  const uint64_t m = bits & (IMPLICIT - 1U);
  return (bits & INFINITE) == 0U ? m : m | IMPLICIT;
}

/* The same number with the leading bit of its significand set, if it has one. */
static uint64_t normal(uint64_t bits, int32_t* exponent) {
  uint64_t m = significand_of(bits);
  *exponent = exponent_of(bits) - raised(&m, 52);
  return m;
}

static uint64_t sum_of(uint64_t one, uint64_t other) {
  const bool first = (one & ~SIGN) >= (other & ~SIGN);
  const uint64_t a = first ? one : other; /* the larger one */
  const uint64_t b = first ? other : one;
  const int32_t gap = exponent_of(a) - exponent_of(b);
  const uint64_t x = significand_of(a) << GUARD;
  uint64_t y = significand_of(b) << GUARD;
  if (gap > 62) {
    y = y != 0U ? 1U : 0U;
  } else {
    y = y >> gap | ((y & ((UINT64_C(1) << gap) - 1U)) != 0U ? 1U : 0U);
  }
  const bool same = ((a ^ b) & SIGN) == 0U;
  const uint64_t m = same ? x + y : x - y;
  return nearest(m == 0U && !same ? 0U : a & SIGN, exponent_of(a) - BIAS - GUARD, m);
}

static uint64_t product_of(uint64_t a, uint64_t b) {
  int32_t i = 0;
  int32_t k = 0;
  const uint64_t x = normal(a, &i);
  const uint64_t y = normal(b, &k);
  const uint64_t low = (x & UINT32_MAX) * (y & UINT32_MAX);
  const uint64_t middle = (x >> 32) * (y & UINT32_MAX) + (x & UINT32_MAX) * (y >> 32) + (low >> 32);
  const uint64_t rest = (middle & 0xfffU) | (low & UINT32_MAX);
  const uint64_t m = ((x >> 32) * (y >> 32) << 20) + (middle >> 12);
  return nearest((a ^ b) & SIGN, i + k - 2 * BIAS + 44, m | (rest != 0U ? 1U : 0U));
}

static uint64_t quotient_of(uint64_t a, uint64_t b) {
  int32_t i = 0;
  int32_t k = 0;
  uint64_t rest = normal(a, &i);
  const uint64_t y = normal(b, &k);
  uint64_t m = 0;
  for (uint32_t bit = 0; bit < QUOTIENT_BITS; bit++) {
    m = m << 1 | (rest >= y ? 1U : 0U);
    rest = (rest >= y ? rest - y : rest) << 1;
  }
  return nearest((a ^ b) & SIGN, i - k - (QUOTIENT_BITS - 1), m | (rest != 0U ? 1U : 0U));
}

static uint64_t root_of(uint64_t a) {
  int32_t i = 0;
  uint64_t x = normal(a, &i);
  const bool odd = (i & 1) == 0; /* BIAS is odd */
  x <<= odd ? 11 : 10;
  uint64_t m = 0;
  uint64_t rest = 0;
  for (uint32_t bit = 0; bit < QUOTIENT_BITS; bit++) {
    rest = rest << 2 | x >> 62;
    x <<= 2;
    const uint64_t trial = m << 2 | 1U;
    m = m << 1 | (rest >= trial ? 1U : 0U);
    rest -= rest >= trial ? trial : 0U;
  }
  const int32_t half = (i - BIAS - (odd ? 1 : 0)) / 2;
  return nearest(0U, half + 27 - QUOTIENT_BITS, m | (rest != 0U ? 1U : 0U));
}

/* An integer below 2^63 times a sign, as a double, and back: towards zero. */
static uint64_t from_integer(uint64_t a) {
  const uint64_t m = (a & SIGN) != 0U ? ~a + 1U : a;
  if ((m & SIGN) != 0U) {
    return nearest(a & SIGN, 1, m >> 1);
  }
  return nearest(a & SIGN, 0, m);
}

static uint64_t to_integer(uint64_t a) {
  const int32_t shift = exponent_of(a) - BIAS;
  uint64_t m = shift < -63 ? 0U : significand_of(a);
  m = shift < 0 ? m >> (-shift & 63) : m << (shift & 63);
  return (a & SIGN) != 0U ? ~m + 1U : m;
}

/* The largest integer that is no larger. */
static uint64_t floor_of(uint64_t a) {
  const int32_t shift = BIAS - exponent_of(a); /* so many bits are behind the point */
  const bool below = (a & SIGN) != 0U && (a & ~SIGN) != 0U;
  if (shift <= 0) {
    return a;
  }
  if (shift > 52) {
    return below ? SIGN | (uint64_t)1023 << 52 : a & SIGN;
  }
  const uint64_t fraction = (UINT64_C(1) << shift) - 1U;
  return (below ? a + fraction : a) & ~fraction;
}

/* A number as an integer that is ordered as numbers are. */
static int64_t ordered(uint64_t bits) {
  return (bits & SIGN) != 0U ? -(int64_t)(bits & ~SIGN) : (int64_t)bits;
}

/* ------------------------------------------------------------------ one operation */

static uint64_t right_of_two(soter_operation_kind kind, uint64_t a, uint64_t b) {
  switch (kind) {
    case SOTER_SUM:
      return sum_of(a, b);
    case SOTER_DIFFERENCE:
      return sum_of(a, b ^ SIGN);
    case SOTER_PRODUCT:
      return product_of(a, b);
    case SOTER_QUOTIENT:
      return quotient_of(a, b);
    case SOTER_LESS:
      return ordered(a) < ordered(b) ? 1U : 0U;
    default:
      return ordered(a) == ordered(b) ? 1U : 0U;
  }
}

static uint64_t here_of_two(soter_operation_kind kind, double x, double y) {
  switch (kind) {
    case SOTER_SUM:
      return bits_of(x + y);
    case SOTER_DIFFERENCE:
      return bits_of(x - y);
    case SOTER_PRODUCT:
      return bits_of(x * y);
    case SOTER_QUOTIENT:
      return bits_of(x / y);
    case SOTER_LESS:
      return x < y ? 1U : 0U;
    default:
      return x == y ? 1U : 0U;
  }
}

static uint64_t right_of_one(soter_operation_kind kind, uint64_t a) {
  switch (kind) {
    case SOTER_ROOT:
      return root_of(a);
    case SOTER_FROM_INTEGER:
      return from_integer(a);
    case SOTER_TO_INTEGER:
      return to_integer(a);
    default:
      return floor_of(a);
  }
}

static uint64_t here_of_one(soter_operation_kind kind, uint64_t a) {
  int64_t whole = 0;
  (void)memcpy(&whole, &a, sizeof whole);
  switch (kind) {
    case SOTER_ROOT:
      return bits_of(sqrt(double_of(a)));
    case SOTER_FROM_INTEGER:
      return bits_of((double)whole);
    case SOTER_TO_INTEGER:
      return (uint64_t)(int64_t)double_of(a);
    default:
      return bits_of(floor(double_of(a)));
  }
}

static bool is_right(soter_operation* o, soter_operation_kind kind, uint64_t a, uint64_t b) {
  o->kind = kind;
  o->a = a;
  o->b = b;
  const bool one = kind >= SOTER_ROOT && kind <= SOTER_FLOOR;
  o->here = one ? here_of_one(kind, a) : here_of_two(kind, double_of(a), double_of(b));
  o->right = one ? right_of_one(kind, a) : right_of_two(kind, a, b);
  return o->here == o->right;
}

/* The same in both orders. */
static bool are_right(soter_operation* o, soter_operation_kind kind, uint64_t a, uint64_t b) {
  return is_right(o, kind, a, b) && is_right(o, kind, b, a);
}

static bool are_compared_right(soter_operation* o, uint64_t a, uint64_t b) {
  return are_right(o, SOTER_LESS, a, b) && is_right(o, SOTER_EQUAL, a, b) &&
         is_right(o, SOTER_EQUAL, a, a);
}

/* ------------------------------------------------------------------ operands */

typedef struct {
  uint64_t count;
} draws;

static uint64_t draw(draws* d) {
  d->count++;
  return soter_mix(d->count * UINT64_C(0x9e3779b97f4a7c15));
}

/* A significand: a power of two, one bit more, a run of ones from either side, or anything. */
static uint64_t hard_significand(draws* d) {
  const uint64_t z = draw(d);
  const uint32_t at = (uint32_t)(z >> 58) % 52U;
  const uint64_t run = (UINT64_C(1) << at) - 1U;
  switch (z & 7U) {
    case 0:
      return 0U;
    case 1:
      return UINT64_C(1) << at;
    case 2:
      return run;
    case 3:
      return (IMPLICIT - 1U) & ~run;
    case 4:
      return z >> 12 & ~run;
    default:
      return z >> 12;
  }
}

static uint64_t with_exponent(draws* d, int32_t exponent) {
  const uint64_t m = hard_significand(d);
  return (uint64_t)(exponent < 0 ? 0 : exponent > 2046 ? 2046 : exponent) << 52 | m;
}

/* Exponents of every distance, in both orders: where they begin makes small and large numbers of
 * all that comes out. Every other time the larger one is a power of two: a difference then has one
 * bit fewer, and is rounded by one that was far behind. */
static bool sums_are_right(soter_operation* o, draws* d) {
  for (uint32_t i = 0; i < (GAP_MOST + 1U) * 2U * DRAWS; i++) {
    const int32_t gap = (int32_t)(i / (2U * DRAWS));
    const uint32_t k = i % (2U * DRAWS);
    const uint64_t z = draw(d);
    const int32_t low = k == 1U ? 2046 - gap : 1000 + (int32_t)(z & 31U);
    const uint64_t any = with_exponent(d, (k == 0U ? 0 : low) + gap);
    const uint64_t a = (k % 2U == 0U ? any : any & INFINITE) | (z & SIGN);
    const uint64_t b = with_exponent(d, k == 0U ? 0 : low);
    if (!are_right(o, SOTER_SUM, a, b) || !are_right(o, SOTER_DIFFERENCE, a, b) ||
        !are_compared_right(o, a, b)) {
      return false;
    }
  }
  return true;
}

/* Products and quotients of all sizes, those that are too large or too small as well. */
static bool products_are_right(soter_operation* o, draws* d) {
  for (uint32_t i = 0; i < PAIRS; i++) {
    const uint64_t z = draw(d);
    const int32_t far = i % 4U == 0U ? (int32_t)(z >> 40) % 1022 : (int32_t)(z & 3U);
    const int32_t near = (int32_t)(z >> 20 & 127U) - 64 - (i % 8U == 0U ? 1023 : 0);
    const uint64_t a = with_exponent(d, 1023 + far) | (z & SIGN);
    const uint64_t b = with_exponent(d, i % 4U == 1U ? 1023 + far : 1023 - far + near);
    if (!is_right(o, SOTER_PRODUCT, a, b) ||
        !are_right(o, SOTER_QUOTIENT, a | UINT64_C(1), b | UINT64_C(1))) {
      return false;
    }
  }
  return true;
}

/* Roots of every exponent, of squares and of their neighbours. */
static bool roots_are_right(soter_operation* o, draws* d) {
  for (uint32_t i = 0; i < ROOTS; i++) {
    const uint64_t z = draw(d);
    const uint64_t any =
        with_exponent(d, i % 4U == 0U ? (int32_t)(z % 2047U) : 1022 + (int32_t)(z & 3U));
    const uint64_t square = from_integer((z >> 38) * (z >> 38)) + (i % 3U) - 1U;
    if (!is_right(o, SOTER_ROOT, any, 0U) || !is_right(o, SOTER_ROOT, square & ~SIGN, 0U)) {
      return false;
    }
  }
  return true;
}

static bool conversions_are_right(soter_operation* o, draws* d) {
  for (uint32_t i = 0; i < 4U * 64U; i++) {
    const uint64_t z = draw(d);
    const uint64_t whole = (i % 4U < 2U ? z : UINT64_MAX << (z & 63U)) >> (i / 4U);
    const uint64_t number = with_exponent(d, 1015 + (int32_t)(i / 4U)) | (z & SIGN);
    if (!is_right(o, SOTER_FROM_INTEGER, whole, 0U) ||
        !is_right(o, SOTER_FROM_INTEGER, ~whole, 0U) ||
        !is_right(o, SOTER_TO_INTEGER, number, 0U) || !is_right(o, SOTER_FLOOR, number, 0U)) {
      return false;
    }
  }
  return is_right(o, SOTER_FROM_INTEGER, SIGN, 0U) && is_right(o, SOTER_FROM_INTEGER, ~SIGN, 0U);
}

bool soter_arithmetic_is_right(soter_operation* wrong) {
  draws d = {0};
  return sums_are_right(wrong, &d) && products_are_right(wrong, &d) && roots_are_right(wrong, &d) &&
         conversions_are_right(wrong, &d);
}

const char* soter_operation_name(soter_operation_kind kind) {
  static const char* const names[] = {"a + b",     "a - b",      "a * b",    "a / b", "sqrt(a)",
                                      "(double)a", "(int64_t)a", "floor(a)", "a < b", "a == b"};
  return names[kind];
}

const char* soter_self_test(const soter_program* p) {
  const char* wrong = soter_computes();
  wrong = wrong != NULL || p == NULL ? wrong : p->self_test();
  soter_operation operation;
  if (wrong == NULL && !soter_arithmetic_is_right(&operation)) {
    wrong = "an operation on doubles is not rounded as IEEE 754 says (soter_arithmetic_is_right)";
  }
  return wrong;
}
