"""Systems whose C keeps something from one call to the next, each kind in a place of its own.

Purpose: `write`: program and C file number n of a kind, into a folder. The plant is moved by a
function in C, and the module's AC is a node in C; both remember what they were called for, so a
flight that finds what another one left there ends elsewhere.
Non-goals: C that keeps nothing (`KINDS["nothing"]` is the one of it, to compare with).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.front_end import check_file, system_of

if TYPE_CHECKING:
    from pathlib import Path

    from soter.language.model.system import System

MEMORY = "typedef struct { double sum; int64_t calls; } memory;\n"
OF_FILE = MEMORY + "static OF memory kept;\nstatic memory *own(void) { return &kept; }\n"
KINDS = {
    "static": OF_FILE.replace("OF", ""),
    "thread": OF_FILE.replace("OF", "_Thread_local"),
    "global": MEMORY + "memory kept_for_all;\nstatic memory *own(void) { return &kept_for_all; }\n",
    "started": MEMORY
    + "static memory kept = {0.25, 3};\nstatic memory *own(void) { return &kept; }\n",
    "function": MEMORY + "static memory *own(void) { static memory kept; return &kept; }\n",
    "heap": MEMORY
    + "static memory *kept;\n"
    + "static memory *own(void) { return kept ? kept : (kept = calloc(1, sizeof *kept)); }\n",
    "header": '#include "kept.h"\n',
    "libc": MEMORY
    + "static memory *own(void) {\n"
    + '  static _Thread_local memory shown;\n  const char *const had = getenv("SOTER_TEST_KEPT");\n'
    + "  shown.calls = had ? atoll(had) : 0;\n  return &shown;\n}\n"
    + "static void keep(const memory *m) {\n  char said[32];\n"
    + '  snprintf(said, sizeof said, "%lld", (long long)m->calls);\n'
    + '  setenv("SOTER_TEST_KEPT", said, 1);\n}\n',
    "drawn": MEMORY
    + "static memory *own(void) {\n  static _Thread_local memory shown;\n"
    + "  shown.calls = rand() % 1000;\n  return &shown;\n}\n",
    "section": OF_FILE.replace("OF", '__attribute__((section(".init_array_of_mine")))'),
    "loaded": MEMORY
    + "#include <sys/mman.h>\nstatic memory *kept;\nstatic memory *own(void) { return kept; }\n"
    + "__attribute__((constructor)) static void made(void) {\n"
    + "  kept = mmap(0, sizeof *kept, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);\n"
    + "}\n",
    "nothing": MEMORY + "#define own() (&(memory){0})\n",
}
HEADER = OF_FILE.replace("OF", "")
PROGRAM = """soter 1;
input topic wind: float in [-3.0, 3.0];
topic y: float in [-40.0, 40.0];
topic u: float in [-1.0, 1.0];
extern fun moved(s: float, push: float, gust: float): float from "c:body.c:moved";
plant Body period 10ms {{
  reads u;
  drives y = s;
  state s: float;
  disturbance gust: float in [-1.0, 1.0];
  next s = moved(s, u, gust);
}}
extern node Learned period 20ms from "c:body.c:learned" {{ subscribes y, wind; publishes u; }}
node Calm period 20ms {{ subscribes y; publishes u; step {{ publish u = clamp(-y, -1.0, 1.0); }} }}
rta Guard {{
  ac Learned; sc Calm; period 20ms; safe abs(y) < 30.0; ttf abs(y) > {ttf}; safer abs(y) < {safer};
}}
system Whole default {{
  body: Body;
  module Guard;
  input wind every 30ms;
  until 1s;
  always abs(body.truth.s) < {always};
  measure far = abs(body.truth.s) in [0.0, 3.0] / 6 every 100ms;
  {faults}
}}
"""
C = """/* features of the system come before all headers */
#define _GNU_SOURCE 1
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
{own}
#include "stateful.h"
#ifndef {keeps}
#define keep(m) ((void)(m))
#endif

static double gone_on(double x) {{
  memory *const m = own();
  m->calls += 1;
  m->sum = 0.5 * m->sum + x;
  keep(m);
  return {gain} * sin(m->sum + 0.1 * (double)(m->calls % 97));
}}

double moved(double s, double push, double gust) {{
  return 0.9 * s + 0.3 * push + 0.1 * gust + gone_on(s);
}}

int learned(const stateful_Guard_Learned_in *in, stateful_Guard_Learned_out *out) {{
  out->u = fmin(fmax(0.4 * in->wind + gone_on(in->y), -1.0), 1.0);
  out->has_u = 1;
  return {fault};
}}
"""
FAULTS = """faults {
    nan Guard.Learned at 9000 per 1h for 60ms; late Guard.dm by 2ms;
  }"""


def write(folder: Path, kind: str, number: int) -> Path:
    """The program's file; `body.c` lies beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    text = C.format(
        own=KINDS[kind],
        keeps="_GNU_SOURCE" if kind == "libc" else "NOBODY_KEEPS",
        gain=0.05 + 0.01 * (number % 7),
        fault="in->wind > 2.9" if number % 3 == 1 else "0",
    )
    (folder / "body.c").write_text(text, encoding="utf-8")
    (folder / "kept.h").write_text(HEADER, encoding="utf-8")
    file = folder / "stateful.soter"
    said = PROGRAM.format(
        ttf=0.3 + 0.1 * (number % 5),
        safer=0.2 + 0.1 * (number % 3),
        always=0.5 + 0.1 * (number % 4),
        faults=FAULTS if number % 2 else "",
    )
    file.write_text(said, encoding="utf-8")
    return file


def system(folder: Path, kind: str, number: int) -> System:
    """The system of `write`."""
    return system_of(check_file(str(write(folder, kind, number))), "Whole")
