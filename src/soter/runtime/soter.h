/* soter.h: the run-time of a Soter program.
 *
 * A compiled program is one state struct and a table of step functions; a driver decides which
 * step runs next. The state holds everything that changes, so it can be copied, hashed, saved
 * and forked as bytes. There is no heap, no recursion, no global variable, and nothing here calls
 * out: when a step belongs to a driver, the kernel says so and waits for the answer.
 *
 * The meaning is docs/semantics.md; names of rules and conditions are the paper's.
 */
#ifndef SOTER_H
#define SOTER_H

#include "soter_check.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Gate, decision modules and monitors compare with NaN and infinities, and every operation rounds
 * once, to double. Where a compiler was told otherwise they would be gone without a word. */
#if defined(__FAST_MATH__)
#error "soter: -ffast-math (-Ofast) removes the gate and the monitors: build without it"
#endif
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0
#error "soter: -ffinite-math-only removes the gate and the monitors: build without it"
#endif
#if defined(__RECIPROCAL_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(__NO_SIGNED_ZEROS__)
#error "soter: -funsafe-math-optimizations changes what the program computes: build without it"
#endif
#if !defined(FLT_EVAL_METHOD) || (FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16)
#error "soter: doubles are computed in another precision: on x86 build with -msse2 -mfpmath=sse"
#endif
#if FLT_RADIX != 2 || DBL_MANT_DIG != 53 || DBL_MAX_EXP != 1024
#error "soter: double is not IEEE 754 binary64 here"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define SOTER_UNUSED __attribute__((unused))
#else
#define SOTER_UNUSED
#endif
#define SOTER_INLINE static inline SOTER_UNUSED

/* ------------------------------------------------------------------ faults and modes */

typedef enum {
  SOTER_OK = 0,
  SOTER_OVERFLOW = 1,
  SOTER_INDEX = 2,
  SOTER_DIVIDE = 3,
  SOTER_CONVERT = 4,
  SOTER_ASSERT = 5,
  SOTER_CAPACITY = 6,
  SOTER_NONFINITE = 7,
  SOTER_RANGE = 8,
  SOTER_EXTERN_FAULT = 9,
  SOTER_SHIELD = 10
} soter_fault;

typedef enum { SOTER_SC = 0, SOTER_AC = 1 } soter_mode;

typedef enum {
  SOTER_ROLE_PLANT = 0,
  SOTER_ROLE_DM = 1,
  SOTER_ROLE_SC = 2,
  SOTER_ROLE_AC = 3,
  SOTER_ROLE_NODE = 4
} soter_role;

#define SOTER_ULP 1.1102230246251565e-16 /* 2^-53, exactly; C++ before 17 has no 0x1p-53 */
#define SOTER_NEVER (-(INT64_C(1) << 62))
#define SOTER_LOST INT64_C(0) /* the stamp of a queue that was full and may not be; else NEVER */

/* ------------------------------------------------------------------ the state's fixed part */

typedef struct {
  int64_t ct; /* current time, ns; -1 before the first instant */
  uint64_t seed;
  uint64_t seed_key;   /* mix(seed + golden): half of every stream's key */
  uint32_t violations; /* onsets of properties, plus latched components */
  uint32_t firing;     /* 1 while FN is not empty */
} soter_header;

typedef struct {
  int64_t next; /* next release, ns */
  uint32_t faults;
  uint8_t last_fault;
  uint8_t oe; /* OE: outputs enabled; of a DM: those of its module */
  uint8_t latched;
  uint8_t had_control;
  uint8_t pending; /* member of FN */
  uint8_t reserved[7];
} soter_component;

typedef struct {
  int64_t ac_ns; /* time in AC before mode_since */
  int64_t mode_since;
  uint32_t to_sc;
  uint32_t to_ac;
  uint32_t gate_faults;
  uint32_t clean_needed;
  uint8_t mode;
  uint8_t gate_fault; /* latched by the gate, cleared by the DM */
  uint8_t ttf;        /* what the last DM step saw */
  uint8_t safer;
  uint8_t stale;
  uint8_t saw_gate_fault;
  uint16_t nan_looks; /* DM steps in which ttf or safer compared a NaN; ends at UINT16_MAX */
} soter_module;

typedef struct {
  int64_t first_ns;
  uint32_t count;
  uint8_t active;
  uint8_t reserved[3];
} soter_property;

/* A state starts with a soter_header, then components, modules, properties, one int64_t stamp
 * per topic; topics, locals and plant states follow. */

/* ------------------------------------------------------------------ choices */

/* Whatever a step leaves open is a choice among finitely many alternatives. A driver that wants to
 * decide itself passes soter_answers as the `answer` of a step that is not extern; without, chance
 * decides. Alternative 0 is the default one. */
typedef struct {
  uint64_t stream; /* who asked: FNV-1a of the stream's name */
  uint32_t count;  /* how many alternatives there were */
  uint32_t pick;
} soter_choice;

typedef struct {
  soter_choice* choices; /* [room]: in: the first `given` picks; out: everything that was asked */
  uint32_t room, given;  /* beyond `given` alternative 0 is taken */
  uint32_t* taken;       /* how many were asked for; more than `room` are not written down */
  uint64_t* branches;    /* one bit per branch that was taken, or NULL */
} soter_answers;

/* ------------------------------------------------------------------ the latch of a module */

/* What a DM remembers that gives control back only after an acknowledgement: `since` is when SC
 * took over (WAITS), or the stamp of the release (READY) or of the press (ACKNOWLEDGED) that came
 * after. */
typedef enum {
  SOTER_LATCH_WAITS = 0,
  SOTER_LATCH_READY = 1,
  SOTER_LATCH_ACKNOWLEDGED = 2
} soter_latch;

/* A look at the button in SC, at `ct`: whether AC may have control again. For generated DMs. */
bool soter_acknowledged(int8_t* latch, int64_t* since, bool pressed, int64_t stamp, int64_t ct,
                        int64_t max_age);

/* ------------------------------------------------------------------ the program's tables */

#define SOTER_ENABLED 1U  /* flag: OE of this component */
#define SOTER_TAKEOVER 2U /* flag: control came to this node since its last step */
#define SOTER_FIRST 4U    /* flag: first release of a plant */

/* Runs one step on `state`. `published` gets one bit per output. `answer` is what a driver
 * computed for an extern step, otherwise NULL. Nothing is changed when a fault is returned. */
typedef soter_fault soter_step_fn(void* state, uint32_t flags, uint32_t* published,
                                  const void* answer);

typedef struct {
  const char* name;
  soter_role role;
  int64_t period_ns;
  int64_t phase_ns;
  int32_t module; /* -1 outside modules */
  bool is_extern;
  bool judged;      /* whether it has contracts: `assumes`, `guarantees` */
  uint32_t outputs; /* one bit per output */
  soter_step_fn* step;
  void (*failsafe)(void* state); /* publishes the declared fail-safe values; may be NULL */
  /* A node whose steps may last, between `least_ns` and `most_ns` (where only faults make them
   * last: 0), drawn from `stream`; of others `effect` is NULL. They write what they publish into
   * topic `held`, whose stamp is when it takes effect, SOTER_NEVER where no step lasts. `effect`
   * publishes it, if the outputs are enabled; `exchange` swaps what is held and what the topics
   * have, so that contracts can be judged. */
  int64_t least_ns;
  int64_t most_ns;
  uint64_t stream;
  uint32_t held;
  void (*effect)(void* state);
  void (*exchange)(void* state);
  /* When release number `release` happens, SOTER_NEVER where it is lost: of a component whose
   * releases the faults of the system move; of others NULL. */
  int64_t (*happens)(const void* state, int64_t release);
  /* How much longer a step lasts that begins at ct, where faults of the system make steps overrun;
   * else NULL. */
  int64_t (*overrun)(const void* state);
} soter_component_info;

typedef struct {
  const char* name;
  int64_t period_ns;
  uint32_t dm, ac, sc; /* component indices */
  uint32_t clean;      /* clean outputs AC needs after a gate fault */
  bool forced;
  soter_mode start;
  soter_mode (*decide)(void* state); /* the generated decision module */
} soter_module_info;

typedef enum {
  SOTER_AT_INSTANT = 0,  /* always, never: at the end of every instant */
  SOTER_BEFORE_STEP = 1, /* assumes: as `component` steps, on what it reads */
  SOTER_AFTER_STEP = 2   /* guarantees: after a step with OE whose `assumes` all held */
} soter_when;

typedef struct {
  const char* text;
  bool (*violated)(const void* state);
  soter_when when;
  uint32_t component;
} soter_property_info;

typedef struct {
  const char* name;
  size_t offset; /* of its value in the state */
  size_t size;
  /* A topic that the environment sets: takes the value at `given`, unless it is refused; of any
   * other topic NULL. Called by soter_publish, which checks the time. */
  soter_fault (*publish)(void* state, const void* given, int64_t time);
} soter_topic_info;

typedef struct {
  int64_t every_ns; /* every multiple is an instant */
  /* Publishes, at ct, a value of the topic's set: by chance, or as soter_answers say. */
  void (*draw)(void* state, const void* answer);
} soter_input_info;

typedef struct {
  const char* name;
  const char* hash; /* SHA-256 of the program, hexadecimal */
  size_t state_size;
  uint32_t components, modules, properties, topics, inputs;
  const soter_component_info* component;
  const soter_module_info* module;
  const soter_property_info* property;
  const soter_topic_info* topic;
  const soter_input_info* input;
  void (*init)(void* state, const void* answer); /* defaults of topics, locals and plants */
  /* Which of so many nodes that wait steps next, where the system leaves that to chance; else NULL:
   * the deployed order. */
  uint32_t (*order)(const void* state, uint32_t waiting);
  const char* (*self_test)(void); /* soter_computes, as the program's own file was compiled */
} soter_program;

/* ------------------------------------------------------------------ the kernel */

typedef enum {
  SOTER_INSTANT_DONE = 0, /* FN is empty: the instant at ct is complete */
  SOTER_EXTERN_DUE = 1    /* *due is an extern component: call soter_answer, then go on */
} soter_status;

/* The initial configuration (L0, OE0, ct0, FN0, Topics0); ct0 is just before 0. */
void soter_start(const soter_program* p, void* state, uint64_t seed);

/* The same; `answer` may be soter_answers, then a driver decides what is drawn at the start. */
void soter_start_with(const soter_program* p, void* state, uint64_t seed, const void* answer);

/* One step of a component at the time ct, by whichever rule it takes; it need not be a member of
 * FN, and leaves it. What a step held and is due takes effect first, or is all there is to do.
 * `next` is not touched. For drivers that choose the order; `answer` may be soter_answers, or for
 * an extern step what the driver computed. Gives the outputs that the step published or, not
 * enabled, would have: one bit each; none for a fault, a latched node or a DM. */
uint32_t soter_fire(const soter_program* p, void* state, uint32_t component, const void* answer);

/* dt2: the time of the next instant, ns. */
int64_t soter_next_instant(const soter_program* p, const void* state);

/* Environment-Input: `topic` takes the value at `given` (p->topic[topic].size bytes, as it lies in
 * the state), measured at `time`; it is stamped so and goes into the topic's queues. After
 * soter_start, between instants or while one waits for an answer. A refused value leaves the topic
 * as it was; what comes back is SOTER_OK, or
 *   SOTER_NONFINITE, SOTER_RANGE   the value is not in the topic's set;
 *   SOTER_EXTERN_FAULT             it is no value of the topic's type, the topic is not the
 *                                  environment's, or `time` is before its stamp or after the next
 *                                  instant (while one waits: after ct): nothing is newer than now.
 * Where nothing came nothing is called: the value grows old, and the DM sees its age. */
soter_fault soter_publish(const soter_program* p, void* state, uint32_t topic, const void* given,
                          int64_t time);

/* dt1-dt3: time moves to the next instant; FN is what is released then. For drivers that set
 * inputs at the very time of an instant: they do it next, and then call soter_instant. */
void soter_progress(const soter_program* p, void* state);

/* Runs one instant, or goes on with it, in the deployed order: plants, DMs, SCs, the rest. */
soter_status soter_instant(const soter_program* p, void* state, uint32_t* due);

/* The driver's answer for the extern step that is due; `fault` other than SOTER_OK says that
 * there is no usable answer. */
void soter_answer(const soter_program* p, void* state, uint32_t component, soter_fault fault,
                  const void* answer);

soter_header* soter_header_of(void* state);
soter_component* soter_components_of(void* state);
soter_module* soter_modules_of(const soter_program* p, void* state);
soter_property* soter_properties_of(const soter_program* p, void* state);
int64_t* soter_stamps_of(const soter_program* p, void* state);

/* NULL where this machine computes as programs mean it, else what is wrong, in words: compilers do
 * not tell of every flag, nor what was linked. It looks at the flags of two files, its own and that
 * of the program, which may be others. A driver's `main` calls it first of all. */
const char* soter_self_test(const soter_program* p);

/* An operation on doubles, as bits: what it gave here, and what IEEE 754 says. */
typedef enum {
  SOTER_SUM = 0,
  SOTER_DIFFERENCE = 1,
  SOTER_PRODUCT = 2,
  SOTER_QUOTIENT = 3,
  SOTER_ROOT = 4,
  SOTER_FROM_INTEGER = 5,
  SOTER_TO_INTEGER = 6,
  SOTER_FLOOR = 7,
  SOTER_LESS = 8,
  SOTER_EQUAL = 9
} soter_operation_kind;

typedef struct {
  soter_operation_kind kind;
  uint64_t a, b;
  uint64_t here, right;
} soter_operation;

/* Whether operations on doubles give here what they should, for operands of all distances and sizes
 * (part of soter_self_test); *wrong is the first one that does not. */
bool soter_arithmetic_is_right(soter_operation* wrong);

/* `a + b`, ...: constant. */
const char* soter_operation_name(soter_operation_kind kind);

/* ------------------------------------------------------------------ the virtual-time driver */

/* One instant, or goes on with it: as soter_instant, but inputs are drawn as it begins, at every
 * multiple of their `every_ns`. */
soter_status soter_virtual_instant(const soter_program* p, void* state, uint32_t* due);

/* Runs such instants up to and including `until_ns`; after each, the state is copied to `trace` if
 * that has room for `room` states. Stops when the trace is full, when an extern is due (*due),
 * or at the end. Returns how many states were written in *written. */
typedef enum { SOTER_RUN_END = 0, SOTER_RUN_EXTERN = 1, SOTER_RUN_FULL = 2 } soter_run_status;
soter_run_status soter_run(const soter_program* p, void* state, int64_t until_ns, void* trace,
                           size_t room, size_t* written, uint32_t* due);

/* ------------------------------------------------------------------ arithmetic */

SOTER_INLINE void soter_raise(soter_fault* fault, soter_fault kind) {
  if (*fault == SOTER_OK) {
    *fault = kind;
  }
}

SOTER_INLINE void soter_guard(bool holds, soter_fault kind, soter_fault* fault) {
  if (!holds) {
    soter_raise(fault, kind);
  }
}

SOTER_INLINE int64_t soter_add(int64_t a, int64_t b, soter_fault* fault) {
  if ((b > 0 && a > INT64_MAX - b) || (b < 0 && a < INT64_MIN - b)) {
    soter_raise(fault, SOTER_OVERFLOW);
    return 0;
  }
  return a + b;
}

SOTER_INLINE int64_t soter_sub(int64_t a, int64_t b, soter_fault* fault) {
  if ((b < 0 && a > INT64_MAX + b) || (b > 0 && a < INT64_MIN + b)) {
    soter_raise(fault, SOTER_OVERFLOW);
    return 0;
  }
  return a - b;
}

SOTER_INLINE int64_t soter_mul(int64_t a, int64_t b, soter_fault* fault) {
  bool over = false;
  if (a > 0) {
    over = b > 0 ? a > INT64_MAX / b : b < INT64_MIN / a;
  } else if (a < 0) {
    over = b > 0 ? a < INT64_MIN / b : (b < 0 && b < INT64_MAX / a);
  }
  if (over) {
    soter_raise(fault, SOTER_OVERFLOW);
    return 0;
  }
  return a * b;
}

SOTER_INLINE int64_t soter_neg(int64_t a, soter_fault* fault) {
  return soter_sub(0, a, fault);
}

SOTER_INLINE int64_t soter_abs(int64_t a, soter_fault* fault) {
  return a < 0 ? soter_neg(a, fault) : a;
}

SOTER_INLINE int64_t soter_div(int64_t a, int64_t b, soter_fault* fault) {
  if (b == 0) {
    soter_raise(fault, SOTER_DIVIDE);
    return 0;
  }
  if (a == INT64_MIN && b == -1) {
    soter_raise(fault, SOTER_OVERFLOW);
    return 0;
  }
  return a / b;
}

SOTER_INLINE int64_t soter_mod(int64_t a, int64_t b, soter_fault* fault) {
  if (b == 0) {
    soter_raise(fault, SOTER_DIVIDE);
    return 0;
  }
  return b == -1 ? 0 : a % b;
}

SOTER_INLINE int64_t soter_narrow(int64_t a, int64_t low, int64_t high, soter_fault* fault) {
  if (a < low || a > high) {
    soter_raise(fault, SOTER_OVERFLOW);
    return low;
  }
  return a;
}

SOTER_INLINE int64_t soter_index(int64_t i, int64_t limit, soter_fault* fault) {
  if (i < 0 || i >= limit) {
    soter_raise(fault, SOTER_INDEX);
    return 0;
  }
  return i;
}

SOTER_INLINE int64_t soter_to_int(double x, soter_fault* fault) {
  if (!(x >= -9223372036854775808.0 && x < 9223372036854775808.0)) {
    soter_raise(fault, SOTER_CONVERT);
    return 0;
  }
  return (int64_t)x;
}

/* An operand that ttf or safer compares. */
SOTER_INLINE double soter_number(double x, soter_fault* fault) {
  soter_guard(x == x, SOTER_NONFINITE, fault);
  return x;
}

/* min(a, b) = b < a ? b : a, max(a, b) = b > a ? b : a, as docs/semantics.md says. */
SOTER_INLINE double soter_min(double a, double b) {
  return b < a ? b : a;
}
SOTER_INLINE double soter_max(double a, double b) {
  return b > a ? b : a;
}
SOTER_INLINE int64_t soter_min_int(int64_t a, int64_t b) {
  return b < a ? b : a;
}
SOTER_INLINE int64_t soter_max_int(int64_t a, int64_t b) {
  return b > a ? b : a;
}

/* The same number. Generated code writes it where a comparison always has the same result, which a
 * program may say (`x == x`) and on which compilers remark. */
SOTER_INLINE int64_t soter_plain(int64_t x) {
  return x;
}

/* A NaN is stored in one form only. */
SOTER_INLINE double soter_canonical(double x) {
  return x == x ? x : (double)NAN;
}

/* Checks one float on its way to a topic: finite, then inside [low, high]. */
SOTER_INLINE void soter_check_finite(double x, soter_fault* fault) {
  if (!(x - x == 0.0)) {
    soter_raise(fault, SOTER_NONFINITE);
  }
}

SOTER_INLINE void soter_check_float(double x, double low, double high, soter_fault* fault) {
  soter_check_finite(x, fault);
  if (!(x >= low && x <= high)) {
    soter_raise(fault, SOTER_RANGE);
  }
}

SOTER_INLINE void soter_check_int(int64_t x, int64_t low, int64_t high, soter_fault* fault) {
  if (x < low || x > high) {
    soter_raise(fault, SOTER_RANGE);
  }
}

SOTER_INLINE double soter_seconds(int64_t ns) {
  return (double)ns / 1e9;
}

/* ------------------------------------------------------------------ does this file compute? */

/* The same number; what is made of it is computed when it runs, not by the compiler. */
SOTER_INLINE double soter_at_run_time(double x) {
  volatile double kept = x;
  return kept;
}

SOTER_INLINE bool soter_catches(double x) {
  soter_fault fault = SOTER_OK;
  soter_check_finite(x, &fault);
  return fault == SOTER_NONFINITE;
}

SOTER_INLINE const char* soter_compares(void) {
  const double zero = soter_at_run_time(0.0);
  const double nan = zero / zero;
  const double inf = soter_at_run_time(1.0) / zero;
  if (nan == nan || nan < 1.0 || nan >= 1.0 || !(nan != nan) || !(inf > DBL_MAX)) {
    return "comparisons with NaN or infinity are wrong (-ffast-math, -ffinite-math-only?)";
  }
  if (!soter_catches(nan) || !soter_catches(inf) || !soter_catches(-inf) || soter_catches(zero)) {
    return "the gate does not see NaN or infinity (-ffast-math, -ffinite-math-only?)";
  }
  if (!(soter_at_run_time(1.0) / -zero < 0.0)) {
    return "the sign of zero is lost (-fno-signed-zeros?)";
  }
  return NULL;
}

SOTER_INLINE const char* soter_rounds(void) {
  const double one = soter_at_run_time(1.0);
  const double half = soter_at_run_time(DBL_EPSILON / 2.0);
  const double odd = soter_at_run_time(1.0 + DBL_EPSILON);
  const double large = soter_at_run_time(1e16);
  if (sizeof(1.0) != sizeof(double)) {
    return "constants are of single precision (-fsingle-precision-constant?)";
  }
  if (soter_at_run_time(one + half) != 1.0 || soter_at_run_time(odd + half) - odd != DBL_EPSILON ||
      soter_at_run_time(-one - half) != -1.0) {
    return "sums are not rounded to the nearest double, once (fesetround, x87?)";
  }
  if (odd * odd - (one + 2.0 * DBL_EPSILON) != 0.0) {
    return "a product and a sum are rounded together (-ffp-contract=fast?)";
  }
  const double small = soter_at_run_time(soter_at_run_time(DBL_MIN) / 2.0);
  if (!(small > 0.0) || soter_at_run_time(small * 2.0) != DBL_MIN) {
    return "small numbers are flushed to zero (linked with -ffast-math or -Ofast?)";
  }
  const double two = one + one;
  if ((one + large) - large != 0.0 || (two + one) / 10.0 == (two + one) * 0.1 ||
      sqrt(two) * sqrt(two) == two) {
    return "operations are replaced by others (-funsafe-math-optimizations?)";
  }
  return NULL;
}

/* NULL where the file that this is compiled in computes as programs mean it, else what is wrong. */
SOTER_INLINE const char* soter_computes(void) {
  const char* const wrong = soter_compares();
  return wrong != NULL ? wrong : soter_rounds();
}

/* ------------------------------------------------------------------ random draws */

SOTER_INLINE uint64_t soter_mix(uint64_t z) {
  z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
  z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
  return z ^ (z >> 31);
}

/* 64 random bits of the stream whose name hashes to `stream`, at `index`. */
SOTER_INLINE uint64_t soter_bits(const soter_header* h, uint64_t stream, int64_t index) {
  const uint64_t key = soter_mix(h->seed_key ^ stream);
  return soter_mix(key + ((uint64_t)index + 1U) * UINT64_C(0x9e3779b97f4a7c15));
}

#ifdef SOTER_ADVERSARY
#include "soter_adversary.h" /* draws that mean harm, for `soter verify`; never in a package */
#else
/* Uniform in [low, high]; rounding never leads outside. */
SOTER_INLINE double soter_draw(const soter_header* h, uint64_t stream, int64_t index, double low,
                               double high) {
  const double u = (double)(soter_bits(h, stream, index) >> 11) * SOTER_ULP;
  return soter_min(low + (high - low) * u, high);
}
#endif

SOTER_INLINE int64_t soter_draw_int(const soter_header* h, uint64_t stream, int64_t index,
                                    int64_t low, int64_t high) {
  const uint64_t span = (uint64_t)high - (uint64_t)low + 1U;
  const uint64_t bits = soter_bits(h, stream, index);
  return (int64_t)((uint64_t)low + (span == 0U ? bits : bits % span));
}

/* ------------------------------------------------------------------ what is left open */

/* Asks the driver which of `count` alternatives; where there is only one, nobody. */
SOTER_INLINE uint32_t soter_ask(const void* answer, uint64_t stream, uint32_t count) {
  const soter_answers* const a = (const soter_answers*)answer;
  if (count < 2U) {
    return 0U;
  }
  const uint32_t at = *a->taken;
  const bool known = at < a->given && at < a->room && a->choices[at].pick < count;
  const uint32_t pick = known ? a->choices[at].pick : 0U;
  if (at < a->room) {
    a->choices[at].stream = stream; /* one by one: C++ has no compound literals */
    a->choices[at].count = count;
    a->choices[at].pick = pick;
  }
  (*a->taken)++;
  return pick;
}

/* A float of [low, high]: by chance, or the middle, low or high as the driver picks. */
SOTER_INLINE double soter_drawn(const soter_header* h, const void* answer, uint64_t stream,
                                int64_t index, double low, double high) {
  if (answer == NULL) {
    return soter_draw(h, stream, index, low, high);
  }
  const uint32_t pick = soter_ask(answer, stream, low < high ? 3U : 1U);
  if (pick != 0U) {
    return pick == 1U ? low : high;
  }
  return low <= 0.0 && high >= 0.0 ? 0.0 : low + (high - low) / 2.0;
}

/* An int of [low, high]. */
SOTER_INLINE int64_t soter_drawn_int(const soter_header* h, const void* answer, uint64_t stream,
                                     int64_t index, int64_t low, int64_t high) {
  if (answer == NULL) {
    return soter_draw_int(h, stream, index, low, high);
  }
  const uint64_t last = (uint64_t)high - (uint64_t)low;
  const uint32_t count = last < UINT32_MAX ? (uint32_t)last + 1U : UINT32_MAX;
  return (int64_t)((uint64_t)low + soter_ask(answer, stream, count));
}

SOTER_INLINE bool soter_drawn_bool(const soter_header* h, const void* answer, uint64_t stream,
                                   int64_t index) {
  return (answer == NULL ? soter_bits(h, stream, index) >> 63 : soter_ask(answer, stream, 2U)) !=
         0U;
}

/* `choose`: number `*made` of the step whose release has this index; one of `count`. */
SOTER_INLINE uint32_t soter_choose(const soter_header* h, const void* answer, uint64_t stream,
                                   int64_t release, uint32_t* made, uint32_t count) {
  const int64_t index = release * 4096 + (int64_t)*made;
  (*made)++;
  if (answer != NULL) {
    return soter_ask(answer, stream, count);
  }
  return (uint32_t)(soter_bits(h, stream, index) % count);
}

/* Whether a fair choice of n may take alternative i, whose ages say how many times in a row each
 * was not taken: every other one must still get its turn within 2n choices in a row. */
SOTER_INLINE bool soter_is_fair(const uint8_t* ages, uint32_t n, uint32_t i) {
  for (uint32_t left = 0; left < 2U * n; left++) { /* choices until it is too late for some */
    uint32_t urgent = 0;
    for (uint32_t j = 0; j < n; j++) {
      urgent += j != i && (uint32_t)ages[j] + left >= 2U * n - 1U ? 1U : 0U;
    }
    if (urgent > left) {
      return false;
    }
  }
  return true;
}

/* `fair choose`: picks among the alternatives that are allowed, and keeps the ages. */
SOTER_INLINE uint32_t soter_choose_fair(const soter_header* h, const void* answer, uint64_t stream,
                                        int64_t release, uint32_t* made, uint8_t* ages,
                                        uint32_t n) {
  uint32_t allowed = 0;
  for (uint32_t i = 0; i < n; i++) {
    allowed += soter_is_fair(ages, n, i) ? 1U : 0U;
  }
  uint32_t left = soter_choose(h, answer, stream, release, made, allowed > 0U ? allowed : 1U);
  uint32_t taken = 0;
  for (uint32_t i = 0; i < n; i++) {
    if (soter_is_fair(ages, n, i)) {
      if (left == 0U) {
        taken = i;
        break;
      }
      left--;
    }
  }
  for (uint32_t i = 0; i < n; i++) {
    ages[i] = i == taken ? 0U : (uint8_t)(ages[i] + 1U);
  }
  return taken;
}

/* Coverage: this branch was taken. */
SOTER_INLINE void soter_branch(const void* answer, const soter_fault* fault, uint32_t branch) {
  const soter_answers* const a = (const soter_answers*)answer;
  if (a != NULL && a->branches != NULL && *fault == SOTER_OK) {
    a->branches[branch / 64U] |= UINT64_C(1) << (branch % 64U);
  }
}

#ifdef __cplusplus
}
#endif

#endif
