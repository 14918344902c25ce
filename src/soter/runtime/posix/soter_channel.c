/* soter_channel.c: see soter_channel.h.
 *
 * Purpose: a sequence lock with a sum. The sequence finds what was torn by an honest writer, the
 * sum what was scribbled; neither finds a value that is written whole and is wrong: the gate does.
 * Non-goals: more than one writer; waiting.
 *
 * Ordering: every store of the writer is a release, every load of the reader an acquire, so no
 * fence is needed: a reader that sees a word of a new value sees the odd sequence before it.
 */
#include "soter_channel.h"

#include "soter_check.h"

#define HEAD_WORDS (sizeof(soter_channel_head) / 8U)
#define PRIME UINT64_C(0x100000001b3)
#define BASIS UINT64_C(0xcbf29ce484222325)

size_t soter_channel_bytes(size_t size) {
  return sizeof(soter_channel_head) + 8U * SOTER_CHANNEL_WORDS(size);
}

static uint64_t load(const uint64_t* word) {
  return __atomic_load_n(word, __ATOMIC_ACQUIRE);
}

static void store(uint64_t* word, uint64_t value) {
  __atomic_store_n(word, value, __ATOMIC_RELEASE);
}

/* FNV-1a, a word at a time. */
static uint64_t sum_of(const soter_channel_head* h, const uint64_t* value, size_t words) {
  const uint64_t first[6] = {h->hash, h->size, h->number, h->time_ns, h->fault, h->more};
  uint64_t sum = BASIS;
  for (size_t i = 0; i < 6U; i++) {
    sum = (sum ^ first[i]) * PRIME;
  }
  for (size_t i = 0; i < words; i++) {
    sum = (sum ^ value[i]) * PRIME;
  }
  return sum;
}

void soter_channel_write(void* segment, const soter_channel_head* head, size_t size,
                         const uint64_t* value) {
  SOTER_CHECK(segment != NULL && (uintptr_t)segment % sizeof(uint64_t) == 0U);
  SOTER_CHECK(head != NULL && value != NULL);
  soter_channel_head* const there = (soter_channel_head*)segment;
  uint64_t* const words = (uint64_t*)segment + HEAD_WORDS;
  const size_t count = SOTER_CHANNEL_WORDS(size);
  soter_channel_head h = *head;
  h.size = size;
  h.sum = sum_of(&h, value, count);
  const uint64_t odd = load(&there->sequence) | 1U; /* one that died in the middle left it odd */
  store(&there->sequence, odd);
  store(&there->hash, h.hash);
  store(&there->size, h.size);
  store(&there->number, h.number);
  store(&there->time_ns, h.time_ns);
  store(&there->fault, h.fault);
  store(&there->sum, h.sum);
  store(&there->more, h.more);
  for (size_t i = 0; i < count; i++) {
    store(&words[i], value[i]);
  }
  store(&there->sequence, odd + 1U);
}

soter_channel_state soter_channel_read(const void* segment, uint64_t hash, size_t size,
                                       uint64_t number, soter_channel_head* head, uint64_t* value) {
  SOTER_CHECK(segment != NULL && (uintptr_t)segment % sizeof(uint64_t) == 0U);
  SOTER_CHECK(head != NULL && value != NULL);
  const soter_channel_head* const there = (const soter_channel_head*)segment;
  const uint64_t* const words = (const uint64_t*)segment + HEAD_WORDS;
  const size_t count = SOTER_CHANNEL_WORDS(size);
  const uint64_t before = load(&there->sequence);
  head->hash = load(&there->hash);
  head->size = load(&there->size);
  head->number = load(&there->number);
  head->time_ns = load(&there->time_ns);
  head->fault = load(&there->fault);
  head->sum = load(&there->sum);
  head->more = load(&there->more);
  for (size_t i = 0; i < count; i++) {
    value[i] = load(&words[i]);
  }
  const uint64_t after = load(&there->sequence);
  if (before == 0U && after == 0U) {
    return SOTER_CHANNEL_EMPTY;
  }
  if (before != after || (before & 1U) != 0U) {
    return SOTER_CHANNEL_TORN;
  }
  if (head->hash != hash) {
    return SOTER_CHANNEL_LAYOUT;
  }
  if (head->size != size) {
    return SOTER_CHANNEL_SIZE;
  }
  if (head->sum != sum_of(head, value, count)) {
    return SOTER_CHANNEL_TORN;
  }
  return head->number == number ? SOTER_CHANNEL_FRESH : SOTER_CHANNEL_OTHER;
}
