/* soter_explore_coverage_guided.c: executions guided by what they cover.
 *
 * Purpose: an execution is a list of decisions. One that meets configurations or covers things that
 * were new is kept; the next one repeats a kept one up to a random place, changes a decision there
 * and goes on by chance, as coverage-guided fuzzers do.
 */
#include "soter_explore_sampled_walk.h"

#define KEPT 256U
#define LONGEST 65536U

typedef struct {
  uint32_t* decision;
  uint32_t count;
} input;

typedef struct {
  input kept[KEPT];
  uint32_t count;
  uint32_t now[LONGEST]; /* decisions of this execution */
  uint32_t made;
  const input* base; /* repeated up to `until` */
  uint32_t until;
  uint64_t states, covered; /* before this execution */
} corpus;

static uint64_t covered(const soter_search* s) {
  const soter_explore_coverage* const c = s->coverage;
  uint64_t n = 0U;
  for (uint32_t i = 0; i < (s->m->branches + 63U) / 64U; i++) {
    n += (uint64_t)__builtin_popcountll(c->branches[i]);
  }
  for (size_t i = 0; i < (size_t)s->m->leaves * 256U; i++) {
    n += c->classes[i];
  }
  for (uint32_t i = 0; i < s->m->program->modules * 2U; i++) {
    n += (uint64_t)c->modes[i] + c->switches[i];
  }
  return n;
}

static uint32_t decide(soter_walk* w, uint32_t kind, uint32_t count) {
  corpus* const c = w->own;
  (void)kind;
  uint32_t d = soter_walk_random(w, count);
  if (c->base != NULL && c->made < c->until && c->made < c->base->count) {
    d = count > 0U ? c->base->decision[c->made] % count : 0U;
  }
  if (c->made < LONGEST) {
    c->now[c->made] = d;
  }
  SOTER_CHECK(count == 0U || d < count);
  c->made++;
  return d;
}

static void begin(soter_walk* w, uint64_t run) {
  corpus* const c = w->own;
  w->random = soter_mix(w->s->o->seed ^ soter_mix(run + 1U));
  c->made = 0U;
  c->base = NULL;
  c->states = w->states;
  c->covered = covered(w->s);
  if (c->count > 0U && soter_walk_random(w, 8U) != 0U) {
    c->base = &c->kept[soter_walk_random(w, c->count)];
    SOTER_CHECK(c->base->count > 0U && c->base->count <= LONGEST);
    c->until = soter_walk_random(w, c->base->count);
  }
}

static void end(soter_walk* w, uint64_t run) {
  corpus* const c = w->own;
  (void)run;
  const bool more = covered(w->s) > c->covered;
  const bool many = (w->states - c->states) * 2U > w->steps; /* most configurations were new */
  if ((!more && !many) || c->made == 0U) {
    return;
  }
  const uint32_t made = c->made < LONGEST ? c->made : LONGEST;
  uint32_t* const decision = malloc(made * sizeof *decision);
  if (decision == NULL) {
    return;
  }
  (void)memcpy(decision, c->now, made * sizeof *decision);
  const uint32_t at = c->count < KEPT ? c->count++ : soter_walk_random(w, KEPT);
  free(c->kept[at].decision);
  SOTER_CHECK(at < KEPT && c->count <= KEPT && made > 0U);
  c->kept[at].decision = decision;
  c->kept[at].count = made;
}

void soter_search_coverage(soter_search* s) {
  const soter_sampling by_coverage = {.decide = decide, .begin = begin, .end = end};
  corpus* const own = calloc(1U, sizeof *own);
  soter_walk_all(s, &by_coverage, own, own != NULL);
  for (uint32_t i = 0; own != NULL && i < own->count; i++) {
    free(own->kept[i].decision);
  }
  free(own);
}
