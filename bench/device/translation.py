"""The generated C of a campaign as one file of C++, which also compiles as device code.

Purpose: `translated`: kernel, virtual driver, batch drivers, SHA-256 and the unit of a system, one
after another, with a kernel that flies a world a thread. All that is changed in the text:

- `#include` lines go; one head stands for the standard headers (NVRTC has none);
- compound literals, `(T){...}`, are written `T{...}`;
- designators stand in the order of the struct, as C++20 wants them (values have no effects);
- `offsetof` is a number there, which g++ checks (NVRTC has none that is constant);
- `void *` is cast where C converts it, as in `cart_state *const s = state`.

Non-goals: compiling and flying (`device_code.py`); externs in C.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from soter.campaign.batch_flights import BATCH
from soter.native.build import RUNTIME

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.codegen.unit import Unit

Structs = dict[str, dict[str, str]]
"""Of each struct its members in order, with their types."""

HEAD = """\
#ifdef __CUDACC_RTC__
typedef signed char int8_t;
typedef unsigned char uint8_t;
typedef short int16_t;
typedef unsigned short uint16_t;
typedef int int32_t;
typedef unsigned int uint32_t;
typedef long int64_t;
typedef unsigned long uint64_t;
typedef unsigned long uintptr_t;
#define INT64_C(x) x##L
#define UINT64_C(x) x##UL
#define INT64_MAX INT64_C(9223372036854775807)
#define INT64_MIN (-INT64_MAX - 1)
#define UINT32_MAX 4294967295U
#define SOTER_AT(type, member, at) at
#define NAN __longlong_as_double(0x7ff8000000000000LL)
#define FLT_EVAL_METHOD 0
#define FLT_RADIX 2
#define DBL_MANT_DIG 53
#define DBL_MAX_EXP 1024
#define DBL_MAX 0x1.fffffffffffffp1023
#define DBL_MIN 0x1p-1022
#define DBL_EPSILON 0x1p-52
static void *memmove(void *to, const void *from, unsigned long size) { /* to what is before it */
  for (unsigned long k = 0; k < size; k++) {
    ((char *)to)[k] = ((const char *)from)[k];
  }
  return to;
}
#else
#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#define SOTER_AT(type, member, at) (sizeof(char[offsetof(type, member) == at ? 1 : -1]) * at)
#endif
#define SOTER_CHECK(condition) ((void)0)
"""
TAIL = """
/* ------------------------------------------------------------------ a world a thread */

typedef struct {
  uint64_t first_seed;
  int64_t until_ns, horizon_ns, episode_ns;
  uint64_t room; /* events of a flight */
  uint8_t *states; /* of each flight its own, and some to work in */
  soter_event *events;
  soter_look *looks;
  uint32_t *histogram, *saves, *precautions;
  soter_flight *flights;
  uint32_t *done; /* 1: flown; 0: more events than room */
} soter_lanes;

static void soter_lane(const soter_lanes *all, uint32_t k) {
  const soter_program *const p = &@_program;
  size_t used = 0;
  soter_order o;
  o.until_ns = all->until_ns;
  o.horizon_ns = all->horizon_ns;
  o.episode_ns = all->episode_ns;
  o.measured = &@_measured;
  o.states = all->states + (size_t)k * 4U * p->state_size;
  o.events = all->events + (size_t)k * all->room;
  o.room = all->room;
  o.looks = all->looks + (size_t)k * @_measured.count;
  o.histogram = all->histogram + (size_t)k * soter_bins(&@_measured);
  o.saves = all->saves + (size_t)k * p->modules;
  o.precautions = all->precautions + (size_t)k * p->modules;
  all->flights[k].seed = all->first_seed + k;
  all->done[k] = soter_batch(p, all->flights + k, 1, &o, &used);
}

#ifdef __CUDACC_RTC__
extern "C" __global__ void soter_fly_lanes(soter_lanes all, uint32_t count) {
  const uint32_t k = blockIdx.x * blockDim.x + threadIdx.x;
  if (k < count) {
    soter_lane(&all, k);
  }
}
#else
extern "C" void soter_fly_lanes(const soter_lanes *all, uint32_t count) {
  for (uint32_t k = 0; k < count; k++) {
    soter_lane(all, k);
  }
}
#endif
"""
INCLUDE = re.compile(r"^[ \t]*#[ \t]*include\b.*$", re.MULTILINE)
LITERAL = re.compile(r"\((soter_\w+)\)\s*\{")
STRUCT = re.compile(r"^typedef struct \{\n(.*?)^\} (\w+);", re.MULTILINE | re.DOTALL)
MEMBER = re.compile(r"^\s*(\w+) (\w+)(?:\[\w+\])*;", re.MULTILINE)
FROM_VOID = re.compile(r"((?:const )?\w+) \*const (\w+) = (state|before|given|answer);")
OFFSET = re.compile(r"offsetof\((\w+), topics\.(\w+)\)")
DESIGNATED = re.compile(r"\s*\.\s*(\w+)\s*=\s*")


def translated(unit: Unit) -> str:
    """The file of a unit."""
    before = ("soter.h", "soter_faults.h", "soter_sha256.h")
    after = ("soter_sha256.c", "soter_kernel.c", "soter_virtual.c")
    texts = [(RUNTIME / name).read_text(encoding="utf-8") for name in before]
    texts += [BATCH.with_suffix(".h").read_text(encoding="utf-8"), unit.header]
    texts += [(RUNTIME / name).read_text(encoding="utf-8") for name in after]
    texts += [BATCH.read_text(encoding="utf-8"), _own(unit)]
    body = "\n".join(LITERAL.sub(r"\1{", INCLUDE.sub("", text)) for text in texts)
    return HEAD + body + TAIL.replace("@", unit.prefix)


def _own(unit: Unit) -> str:
    structs = {
        name: {member: type_ for type_, member in MEMBER.findall(body)}
        for body, name in STRUCT.findall(unit.header)
    }
    names = "|".join(sorted(structs, key=len, reverse=True))
    text = re.sub(rf"\(({names})\)\s*\{{", r"\1{", unit.source)
    text = FROM_VOID.sub(r"\1 *const \2 = (\1 *)\3;", text)
    topics = next(g for g in unit.layout.groups if g.owner < 0)
    at = {m.name.replace(".", "_"): topics.offset + m.offset for m in topics.struct.members}
    text = OFFSET.sub(lambda m: f"SOTER_AT({m[1]}, topics.{m[2]}, {at[m[2]]}U)", text)
    return _ordered(text, structs, re.compile(rf"\b({names})(\s+\w+\s*=\s*)?\{{"))


def _ordered(text: str, structs: Structs, of_type: re.Pattern[str]) -> str:
    """Designators of all initialisers in the order of their structs."""
    pieces: list[str] = []
    at = 0
    while (match := of_type.search(text, at)) is not None:
        begin = match.end() - 1
        end = _closing(text, begin)
        inside = _initialiser(text[begin + 1 : end], match[1], structs, of_type)
        pieces += [text[at:begin], "{", inside, "}"]
        at = end + 1
    return "".join([*pieces, text[at:]])


def _initialiser(text: str, type_: str, structs: Structs, of_type: re.Pattern[str]) -> str:
    """What stands between the braces of an initialiser; of an array: of this element type."""
    members = structs.get(type_, {})
    fields: list[tuple[int, str]] = []
    for part in _parts(text):
        named = DESIGNATED.match(part)
        own = members.get(named[1], "") if named else type_
        head, value = (named[0], part[named.end() :]) if named else ("", part)
        if value.lstrip().startswith("{"):
            begin = value.index("{")
            end = _closing(value, begin)
            value = f"{{{_initialiser(value[begin + 1 : end], own, structs, of_type)}}}"
        else:
            value = _ordered(value, structs, of_type)
        place = list(members).index(named[1]) if named and named[1] in members else 0
        fields.append((place, head + value))
    return ",".join(text for _, text in sorted(fields, key=lambda f: f[0]))


def _closing(text: str, begin: int) -> int:
    """Where the brace at `begin` ends."""
    depth = 0
    for k in range(begin, len(text)):
        depth += {"{": 1, "}": -1}.get(text[k], 0)
        if depth == 0:
            return k
    raise ValueError(text[begin : begin + 80])


def _parts(text: str) -> Iterator[str]:
    """What commas separate, outside of all brackets."""
    depth, begin = 0, 0
    for k, letter in enumerate(text):
        depth += {"{": 1, "(": 1, "[": 1, "}": -1, ")": -1, "]": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            yield text[begin:k]
            begin = k + 1
    if text[begin:].strip():
        yield text[begin:]
