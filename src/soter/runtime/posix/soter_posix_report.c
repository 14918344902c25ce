/* soter_posix_report.c: what a run was, in words and as JSON.
 *
 * Purpose: the timing report of docs/real-time.md and docs/json.md.
 * Non-goals: being called before all threads have ended.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_posix.h"

#include <inttypes.h>
#include <signal.h>
#include <string.h>
#include <sys/wait.h>

static const char* const CAUSES[SOTER_CAUSES] = {"ttf", "stale", "gate", "silent", "missed"};
static const char* const SEEN[SOTER_CHANNEL_STATES] = {"fresh", "stale",  "torn",
                                                       "size",  "layout", "empty"};

/* ------------------------------------------------------------------ histograms */

/* 16 bins an octave; below 16 ns a bin each. */
static uint32_t bin_of(int64_t ns) {
  const uint64_t v = ns > 0 ? (uint64_t)ns : 0U;
  if (v < 16U) {
    return (uint32_t)v;
  }
  const uint32_t octave = 63U - (uint32_t)__builtin_clzll(v);
  return (octave - 3U) * 16U + (uint32_t)((v >> (octave - 4U)) & 15U);
}

static int64_t end_of_bin(uint32_t bin) {
  if (bin < 16U) {
    return (int64_t)bin;
  }
  const uint32_t octave = bin / 16U + 3U;
  SOTER_CHECK(octave < 64U);
  return (int64_t)((UINT64_C(16) + bin % 16U + 1U) << (octave - 4U)) - 1;
}

void soter_histogram_add(soter_histogram* h, int64_t ns) {
  const uint32_t bin = bin_of(ns);
  SOTER_CHECK(bin < SOTER_BINS);
  h->count++;
  h->bin[bin]++;
  h->most_ns = ns > h->most_ns ? ns : h->most_ns;
}

int64_t soter_histogram_quantile(const soter_histogram* h, double share) {
  SOTER_CHECK(share >= 0.0 && share <= 1.0);
  const double wanted = share * (double)h->count;
  uint64_t below = 0;
  for (uint32_t i = 0; i < SOTER_BINS; i++) {
    below += h->bin[i];
    if (below > 0U && (double)below >= wanted) {
      const int64_t end = end_of_bin(i);
      return end < h->most_ns ? end : h->most_ns;
    }
  }
  return h->most_ns;
}

/* ------------------------------------------------------------------ words */

static void print_histogram(const char* name, const soter_histogram* h, FILE* out) {
  if (h->count > 0U) {
    (void)fprintf(out, "  %-28s %9" PRIu64 "  %9.1f %9.1f %9.1f %9.1f\n", name, h->count,
                  (double)soter_histogram_quantile(h, 0.5) / 1e3,
                  (double)soter_histogram_quantile(h, 0.99) / 1e3,
                  (double)soter_histogram_quantile(h, 0.999) / 1e3, (double)h->most_ns / 1e3);
  }
}

static void print_nodes(const soter_posix* d, FILE* out) {
  (void)fprintf(out,
                "lateness, us                       count        p50       p99     p99.9"
                "       max\n");
  print_histogram("wake-up, nothing to do", &d->bare, out);
  print_histogram("instants", &d->wake, out);
  for (uint32_t i = 0; i < APP_PROGRAM->components; i++) {
    char name[64];
    const char* const own = APP_PROGRAM->component[i].name;
    (void)snprintf(name, sizeof name, "%.20s released", own);
    print_histogram(name, &d->node[i].late, out);
    (void)snprintf(name, sizeof name, "%.20s complete", own);
    print_histogram(name, &d->node[i].complete, out);
    if (d->node[i].released_late + d->node[i].completed_late > 0U) {
      (void)fprintf(out, "  %s: %" PRIu64 " released late, %" PRIu64 " completed late\n", own,
                    d->node[i].released_late, d->node[i].completed_late);
    }
  }
}

static void print_worker(const soter_posix* d, uint32_t k, FILE* out) {
  const soter_worker_times* const w = &d->worker[k];
  SOTER_CHECK(w->answered + w->missing <= w->asked);
  (void)fprintf(out,
                "worker %s: %" PRIu64 " asked, %" PRIu64 " answered (%" PRIu64
                " after the next instant, %" PRIu64 " failed), %" PRIu64 " missing",
                APP_PROGRAM->component[soter_app_externs[k].component].name, w->asked, w->answered,
                w->later, w->failed, w->missing);
  for (uint32_t s = 1; s < SOTER_CHANNEL_STATES; s++) {
    if (w->seen[s] > 0U) {
      (void)fprintf(out, ", %" PRIu64 " %s", w->seen[s], SEEN[s]);
    }
  }
  if (d->shared) {
    const soter_worker_status* const s = &d->status->worker[k];
    (void)fprintf(out, "; %" PRIu32 " starts, %" PRIu32 " ends", s->starts, s->ends);
    if (s->ends > 0U && WIFSIGNALED(s->status)) {
      (void)fprintf(out, ", the last by %s", strsignal(WTERMSIG(s->status)));
    } else if (s->ends > 0U) {
      (void)fprintf(out, ", the last with status %d", WEXITSTATUS(s->status));
    }
  }
  (void)fprintf(out, "\n");
}

static void print_takeovers(const soter_posix* d, uint32_t module, FILE* out) {
  SOTER_CHECK(module < APP_PROGRAM->modules);
  for (uint32_t i = 0; i < SOTER_CAUSES; i++) {
    if (d->takeovers[module][i] > 0U) {
      (void)fprintf(out, "takeovers %s: %" PRIu64 " by %s\n", APP_PROGRAM->module[module].name,
                    d->takeovers[module][i], CAUSES[i]);
    }
  }
}

static void print_world(const soter_posix* d, FILE* out) {
  for (uint32_t k = 0; k < soter_app_outside_count; k++) {
    const soter_outside_times* const o = &d->outside[k];
    (void)fprintf(out,
                  soter_app_outside[k].inward
                      ? "topic %s: %" PRIu64 " values taken, %" PRIu64 " refused, %" PRIu64
                        " older than what was there, %" PRIu64 " from the future, %" PRIu64
                        " not whole\n"
                      : "topic %s: %" PRIu64 " values told\n",
                  soter_app_outside[k].name, soter_app_outside[k].inward ? o->taken : o->told,
                  o->refused, o->older, o->future, o->bad);
  }
  for (uint32_t k = 0; k < soter_app_lease_count; k++) {
    const soter_lease_times* const t = &d->lease[k];
    (void)fprintf(out, "leases %s: %" PRIu64 " given", soter_app_leases[k].name, t->given);
    if (t->ended_ns >= 0) {
      (void)fprintf(out, ", none from %.6f s on: the law", (double)t->ended_ns / 1e9);
    }
    (void)fprintf(out, "\n");
  }
}

static const soter_lease_times* lease_of(const soter_posix* d, uint32_t module) {
  SOTER_CHECK(module < APP_PROGRAM->modules);
  for (uint32_t k = 0; k < soter_app_lease_count; k++) {
    if (soter_app_leases[k].module == module) {
      return &d->lease[k];
    }
  }
  return NULL;
}

/* What was late, and what the actuators did while nobody told them anything. */
static void print_misses(const soter_posix* d, FILE* out) {
  (void)fprintf(out,
                "%" PRIu64 " instants, %" PRIu64 " with misses, %" PRIu64
                " in which only plants or ACs were late; %" PRIu64 " misses\n",
                d->instants, d->late_instants, d->late_untrusted, d->missed);
  if (d->missed > d->options.misses_allowed) {
    (void)fprintf(
        out, "LATE: %" PRIu64 " misses of the trusted part, %" PRIu64 " are allowed (--misses)\n",
        d->missed, d->options.misses_allowed);
  }
  (void)fprintf(out, "longest silence %.3f ms, after the instant at %.6f s\n",
                (double)d->silence_ns / 1e6, (double)d->silence_ct / 1e9);
  for (uint32_t i = 0; d->missed > 0U && i < APP_PROGRAM->modules; i++) {
    const soter_lease_times* const t = lease_of(d, i);
    if (t == NULL) {
      (void)fprintf(out, "  %s: no fail-safe law, its last command stayed\n",
                    APP_PROGRAM->module[i].name);
    } else {
      (void)fprintf(out, "  %s: the law for the last %.3f ms of it\n", APP_PROGRAM->module[i].name,
                    (double)t->silence_law_ns / 1e6);
    }
  }
}

void soter_posix_report(const soter_posix* d, FILE* out) {
  SOTER_CHECK(d->done);
  (void)fprintf(out, "real time: policy %s, memory %s, ", d->policy,
                d->locked ? "locked" : "not locked");
  (void)fprintf(out, d->pinned ? "processor %d\n" : "not pinned\n", d->core);
  print_misses(d, out);
  (void)fprintf(out,
                "%" PRIu64 " page faults (%" PRIu64 " from a disk), %" PRIu64 " records dropped\n",
                d->minor_faults + d->major_faults, d->major_faults, d->ring.dropped);
  print_nodes(d, out);
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    print_histogram("  answered after", &d->worker[k].took, out);
    print_worker(d, k, out);
  }
  for (uint32_t i = 0; i < APP_PROGRAM->modules; i++) {
    print_takeovers(d, i, out);
  }
  print_world(d, out);
}

/* ------------------------------------------------------------------ JSON */

/* Names and notes: everything but printable ASCII becomes `?`. */
static void json_text(const char* text, FILE* out) {
  SOTER_CHECK(text != NULL);
  (void)fputc('"', out);
  for (const char* c = text; *c != '\0'; c++) {
    if (*c == '"' || *c == '\\') {
      (void)fputc('\\', out);
    }
    (void)fputc(*c >= ' ' && *c <= '~' ? *c : '?', out);
  }
  (void)fputc('"', out);
}

static void json_histogram(const char* name, const soter_histogram* h, FILE* out) {
  (void)fprintf(out,
                "\"%s\": {\"count\": %" PRIu64 ", \"p50_ns\": %" PRId64 ", \"p99_ns\": %" PRId64
                ", \"p999_ns\": %" PRId64 ", \"max_ns\": %" PRId64 ", \"bins\": [",
                name, h->count, soter_histogram_quantile(h, 0.5), soter_histogram_quantile(h, 0.99),
                soter_histogram_quantile(h, 0.999), h->most_ns);
  const char* comma = "";
  for (uint32_t i = 0; i < SOTER_BINS; i++) {
    if (h->bin[i] > 0U) {
      (void)fprintf(out, "%s[%" PRId64 ", %" PRIu32 "]", comma, end_of_bin(i), h->bin[i]);
      comma = ", ";
    }
  }
  (void)fprintf(out, "]}");
}

static void json_nodes(const soter_posix* d, FILE* out) {
  (void)fprintf(out, ",\n \"nodes\": {");
  for (uint32_t i = 0; i < APP_PROGRAM->components; i++) {
    (void)fprintf(out, "%s\n  ", i > 0U ? "," : "");
    json_text(APP_PROGRAM->component[i].name, out);
    (void)fprintf(out, ": {\"released_late\": %" PRIu64 ", \"completed_late\": %" PRIu64 ", ",
                  d->node[i].released_late, d->node[i].completed_late);
    json_histogram("release", &d->node[i].late, out);
    (void)fprintf(out, ", ");
    json_histogram("completion", &d->node[i].complete, out);
    (void)fprintf(out, "}");
  }
  (void)fprintf(out, "}");
}

static void json_worker(const soter_posix* d, uint32_t k, FILE* out) {
  const soter_worker_times* const w = &d->worker[k];
  SOTER_CHECK(w->answered + w->missing <= w->asked);
  json_text(APP_PROGRAM->component[soter_app_externs[k].component].name, out);
  (void)fprintf(out,
                ": {\"asked\": %" PRIu64 ", \"answered\": %" PRIu64 ", \"later\": %" PRIu64
                ", \"failed\": %" PRIu64 ", \"missing\": %" PRIu64,
                w->asked, w->answered, w->later, w->failed, w->missing);
  for (uint32_t s = 1; s < SOTER_CHANNEL_STATES; s++) {
    (void)fprintf(out, ", \"%s\": %" PRIu64, SEEN[s], w->seen[s]);
  }
  const uint32_t starts = d->shared ? d->status->worker[k].starts : 0U;
  const uint32_t ends = d->shared ? d->status->worker[k].ends : 0U;
  (void)fprintf(out,
                ", \"starts\": %" PRIu32 ", \"ends\": %" PRIu32 ", \"budget_ns\": %" PRId64 ", ",
                starts, ends, soter_app_externs[k].budget_ns);
  json_histogram("took", &w->took, out);
  (void)fprintf(out, "}");
}

static void json_module(const soter_posix* d, uint32_t i, FILE* out) {
  const soter_module_info* const info = &APP_PROGRAM->module[i];
  const soter_module* const m = soter_modules_of(APP_PROGRAM, (void*)(uintptr_t)&d->state) + i;
  const int64_t end_ns = d->state.header.ct > 0 ? d->state.header.ct : 0; /* -1: it never began */
  SOTER_CHECK(m->mode_since <= end_ns);
  const int64_t ac_ns = m->ac_ns + (m->mode == SOTER_AC ? end_ns - m->mode_since : 0);
  json_text(info->name, out);
  (void)fprintf(out,
                ": {\"ac_share\": %.9g, \"switches_to_sc\": %" PRIu32
                ", \"switches_to_ac\": %" PRIu32 ", \"gate_faults\": %" PRIu32
                ", \"nan_looks\": %u, \"takeovers\": {",
                end_ns > 0 ? (double)ac_ns / (double)end_ns : 0.0, m->to_sc, m->to_ac,
                m->gate_faults, (unsigned)m->nan_looks);
  for (uint32_t c = 0; c < SOTER_CAUSES; c++) {
    (void)fprintf(out, "%s\"%s\": %" PRIu64, c > 0U ? ", " : "", CAUSES[c], d->takeovers[i][c]);
  }
  (void)fprintf(out, "}}");
}

static void json_world(const soter_posix* d, FILE* out) {
  (void)fprintf(out, ",\n \"topics\": {");
  for (uint32_t k = 0; k < soter_app_outside_count; k++) {
    const soter_outside_times* const o = &d->outside[k];
    (void)fprintf(out, "%s\n  ", k > 0U ? "," : "");
    json_text(soter_app_outside[k].name, out);
    (void)fprintf(out,
                  ": {\"inward\": %s, \"told\": %" PRIu64 ", \"taken\": %" PRIu64
                  ", \"refused\": %" PRIu64 ", \"older\": %" PRIu64 ", \"future\": %" PRIu64
                  ", \"bad\": %" PRIu64 "}",
                  soter_app_outside[k].inward ? "true" : "false", o->told, o->taken, o->refused,
                  o->older, o->future, o->bad);
  }
  (void)fprintf(out, "},\n \"leases\": {");
  for (uint32_t k = 0; k < soter_app_lease_count; k++) {
    const soter_lease_times* const t = &d->lease[k];
    (void)fprintf(out, "%s\n  ", k > 0U ? "," : "");
    json_text(soter_app_leases[k].name, out);
    (void)fprintf(out,
                  ": {\"given\": %" PRIu64 ", \"stale\": %" PRIu64 ", \"law\": %" PRIu64
                  ", \"silence_law_ns\": %" PRId64 ", \"ended_ns\": ",
                  t->given, t->stale, t->law, t->silence_law_ns);
    if (t->ended_ns < 0) {
      (void)fprintf(out, "null}");
    } else {
      (void)fprintf(out, "%" PRId64 "}", t->ended_ns);
    }
  }
  (void)fprintf(out, "}");
}

static void json_head(const soter_posix* d, FILE* out) {
  const soter_header* const h = &d->state.header;
  (void)fprintf(out,
                "{\"violations\": %" PRIu32 ", \"duration_s\": %.9g, \"seed\": %" PRIu64
                ", \"trace_sha256\": ",
                h->violations, (double)d->options.until_ns / 1e9, h->seed);
  if (d->ring.dropped == 0U && d->calendars == 0U && d->digest[0] != '\0') {
    json_text(d->digest, out);
  } else {
    (void)fprintf(out, "null");
  }
  (void)fprintf(out,
                ",\n \"policy\": \"%s\", \"locked\": %s, \"core\": %d, \"instants\": %" PRIu64
                ", \"late_instants\": %" PRIu64 ", \"late_untrusted_instants\": %" PRIu64
                ", \"misses\": %" PRIu64 ", \"misses_allowed\": %" PRIu64
                ", \"calendars\": %" PRIu64 ", \"silence_ns\": %" PRId64
                ", \"silence_after_ns\": %" PRId64 ", \"page_faults\": %" PRIu64
                ", \"major_page_faults\": %" PRIu64 ", \"dropped\": %" PRIu64
                ", \"log_lines_lost\": %" PRIu64 ", \"stopped\": %s, \"origin_ns\": %" PRId64,
                d->policy, d->locked ? "true" : "false", d->pinned ? d->core : -1, d->instants,
                d->late_instants, d->late_untrusted, d->missed, d->options.misses_allowed,
                d->calendars, d->silence_ns, d->silence_ct, d->minor_faults, d->major_faults,
                d->ring.dropped, d->lines_lost, d->stop != 0 ? "true" : "false", d->origin_ns);
}

void soter_posix_json(const soter_posix* d, FILE* out) {
  SOTER_CHECK(d->done);
  json_head(d, out);
  (void)fprintf(out, ",\n \"notes\": [");
  for (uint32_t i = 0; i < d->note_count && i < SOTER_NOTES; i++) {
    (void)fprintf(out, "%s", i > 0U ? ", " : "");
    json_text(d->notes[i], out);
  }
  (void)fprintf(out, "],\n ");
  json_histogram("bare", &d->bare, out);
  (void)fprintf(out, ",\n ");
  json_histogram("wake", &d->wake, out);
  (void)fprintf(out, ",\n ");
  json_histogram("output", &d->output, out);
  json_nodes(d, out);
  (void)fprintf(out, ",\n \"workers\": {");
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    (void)fprintf(out, "%s\n  ", k > 0U ? "," : "");
    json_worker(d, k, out);
  }
  (void)fprintf(out, "},\n \"modules\": {");
  for (uint32_t i = 0; i < APP_PROGRAM->modules; i++) {
    (void)fprintf(out, "%s\n  ", i > 0U ? "," : "");
    json_module(d, i, out);
  }
  (void)fprintf(out, "}");
  json_world(d, out);
  (void)fprintf(out, "}\n");
}
