"""What of a program in real time meets the world: channels of topics, leases, the actuators.

Purpose: the tables by which the driver of `runtime/posix/` speaks with other programs: a channel
for each external topic, and for each module with a fail-safe law one for its commands with their
leases; the program of the actuators, `NAME_actuator`; and `NAME_channels.h` for who is on the other
side of a topic.
Non-goals: the driver and the actuators themselves (`runtime/posix/`), laws
(`leases_and_lateness.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.codegen.c.names import field_name
from soter.core.layout import size_of
from soter.language.model.durations import show_ns
from soter.targets.channel_document import lasting, layout_number, number_of_layout
from soter.targets.firmware import described, topic_names
from soter.targets.leases_and_lateness import AgeLimit, ages_of, lease_names, lease_times, leased
from soter.targets.package import PackageFile

if TYPE_CHECKING:
    from soter.codegen.unit import Unit
    from soter.language.model.system import Module, System, Topic

OUTSIDE = ("soter_outside.h", "soter_outside.c")
ACTUATOR = ("soter_actuator.h", "soter_actuator.c", "soter_actuator_arm.c")
APP = "soter_actuator_app"
STATUS_TEXT = ("soter_status_text.h", "soter_status_text.c")
"""What the trusted part and the actuators say of themselves, for people: bridges show it, too."""
YOURS = "actuate.c"
HEAD_BYTES = 24
"""Of a message: the stamp and the end of its lease, and until when one may begin with it."""


@dataclass(frozen=True)
class LeasedModule:
    """A module with a fail-safe law: its channel, and the components that its grant watches."""

    module: Module
    name: str
    """What its C names begin with."""
    short: str
    """The same without the program's prefix."""
    components: tuple[int, ...]
    ages: tuple[AgeLimit, ...]

    @property
    def channel(self) -> str:
        """The name of the channel of its commands: no topic is called so."""
        return f"{self.short}.lease"


class WorldTables:
    """The tables of a system; `unit`: its C."""

    def __init__(self, system: System, unit: Unit) -> None:
        self.system = system
        self.unit = unit
        self.names = topic_names(system)
        self.lease_names = lease_names(system, unit.prefix)
        self.granted: list[LeasedModule] = []
        self.notes: list[str] = []
        for module in leased(system):
            self._grant(module)
        by_lease = {i for g in self.granted for i in g.module.outputs}
        self.topics = [system.topics[e.topic] for e in system.externals if e.topic not in by_lease]

    def _grant(self, module: Module) -> None:
        times = lease_times(self.system, module)
        of = {x.name: x for x in self.system.components}
        parts = [of[b.name] for b in times.budgets]
        if slow := lasting(self.system, module):
            self.notes.append(
                f"{module.name}: no leases in real time: a step of {', '.join(slow)} takes time"
            )
            return
        name = self.lease_names[module.index]
        indices = tuple(x.index for x in parts)
        short = name.removeprefix(f"{self.unit.prefix}_")
        ages = ages_of(self.system, module)
        self.granted.append(LeasedModule(module, name, short, indices, ages))
        text = f"{module.name}: a lease ends {show_ns(times.longest)} after its release at most"
        if times.undeclared:
            zero = ", ".join(times.undeclared)
            text += f"; {zero} not declared: they count as zero, which no clock keeps"
        self.notes.append(text)

    # ------------------------------------------------------------ the driver's side

    def words(self) -> int:
        """Of the longest value that is exchanged: 8 bytes each."""
        sizes = [size_of(t.type) for t in self.topics]
        sizes += [self._message_bytes(g) for g in self.granted]
        return max([1, *((s + 7) // 8 for s in sizes)])

    def defines(self) -> str:
        """What soter_app.h says of it."""
        budgets = max([1, *(len(g.components) for g in self.granted)])
        return f"""\
#define APP_OUTSIDE {len(self.topics)} /* topics that meet the world */
#define APP_LEASES {len(self.granted)} /* modules with a fail-safe law */
#define APP_BUDGETS {budgets} /* of such a module, at most */
#define APP_STATUS_HASH UINT64_C({self.status_number:#018x}) /* soter_status.h */
"""

    @staticmethod
    def number(topic: Topic) -> int:
        """Of the layout of a topic's value: what the head of its channel says."""
        return layout_number(topic)

    @property
    def status_number(self) -> int:
        """Of the layout of what the trusted part says of itself."""
        modules = [m.name for m in self.system.modules]
        leases = [g.module.name for g in self.granted]
        return number_of_layout(
            {
                "status": [modules, leases, [self.names[t.index] for t in self.topics]],
                "words of a module": 9,
                "words of a lease": 6,
            }
        )

    @property
    def actuators_number(self) -> int:
        """Of the layout of what the actuators say of themselves."""
        return number_of_layout({"actuators": [g.module.name for g in self.granted]})

    def include(self) -> str:
        """The header of the laws, where there are any."""
        return f'#include "{self.unit.prefix}_lease.h"\n' if self.granted else ""

    def tables(self) -> str:
        """`soter_app_outside` and `soter_app_leases`."""
        topics = "\n".join(self._topic(t) for t in self.topics) or "    {0}, /* there is none */"
        leases = "\n".join(self._lease(g) for g in self.granted) or "    {0}, /* there is none */"
        functions = "".join(self._functions(g) for g in self.granted)
        return f"""\
const soter_posix_topic soter_app_outside[] = {{
{topics}
}};
const uint32_t soter_app_outside_count = {len(self.topics)};

{functions}const soter_posix_lease soter_app_leases[] = {{
{leases}
}};
const uint32_t soter_app_lease_count = {len(self.granted)};
"""

    def _topic(self, t: Topic) -> str:
        age = -1 if t.max_age_ns is None else t.max_age_ns
        return f"""\
    {{.topic = {t.index}U,
     .name = "{self.names[t.index]}",
     .hash = UINT64_C({layout_number(t):#018x}),
     .max_age_ns = INT64_C({age}),
     .inward = {"true" if t.driver == "input" else "false"},
     .awaited = {"true" if self.is_awaited(t) else "false"}}},"""

    def is_awaited(self, t: Topic) -> bool:
        """Whether anybody but ACs reads it: only then is a start without it one without a proof.

        An acknowledgement is no part of that: without one SC keeps control.
        """
        readers = {
            x.role
            for x in self.system.components
            if x.node is not None
            and t.index in (x.scope.topics[s.topic] for s in x.node.subscribes)
        }
        of_dms = any(t.index in m.inputs for m in self.system.modules)
        acknowledges = any(t.index == m.acknowledgement for m in self.system.modules)
        unasked = readers == {"ac"} or (acknowledges and readers <= {"ac"})
        return t.driver == "input" and (of_dms or not unasked)

    def _functions(self, g: LeasedModule) -> str:
        fields = [
            (field_name(self.system.topics[i].symbol.name.rpartition(".")[2]), i)
            for i in g.module.outputs
        ]
        index = g.module.index
        state = [(f, f"topics.{self.unit.topics[i][1]}") for f, i in fields]
        out = "\n".join(f"  memcpy(&to->{f}, &from->{s}, sizeof to->{f});" for f, s in state)
        back = "\n".join(f"  memcpy(&to->{s}, &from->{f}, sizeof to->{s});" for f, s in state)
        components = ", ".join(f"{i}U" for i in g.components)
        ages = ", ".join(self._age(age) for age in g.ages) or "{0}"
        applied = ""
        if self._moves_plants():
            applied = f"""\
static void apply_{index}(void* state, const void* command) {{
  APP_STATE* const to = (APP_STATE*)state;
  const {g.name}_command* const from = (const {g.name}_command*)command;
{back}
}}
"""
        return f"""\
/* module {g.module.name} */
static void command_{index}(const void* state, void* command) {{
  const APP_STATE* const from = (const APP_STATE*)state;
  {g.name}_command* const to = ({g.name}_command*)command;
{out}
}}
{applied}static const uint32_t watched_{index}[] = {{{components}}};
static const soter_posix_age ages_{index}[] = {{{ages}}};

"""

    def _age(self, age: AgeLimit) -> str:
        outside = "true" if self.system.topics[age.topic].driver == "input" else "false"
        return f"{{{age.component}U, {age.topic}U, INT64_C({age.most_ns}), {outside}}}"

    def _moves_plants(self) -> bool:
        return any(x.plant is not None for x in self.system.components)

    def _lease(self, g: LeasedModule) -> str:
        index = g.module.index
        apply = f"apply_{index}" if self._moves_plants() else "NULL"
        return f"""\
    {{.module = {index}U, /* {g.module.name} */
     .name = "{g.module.name}",
     .channel = "{g.channel}",
     .hash = UINT64_C({self._message_number(g):#018x}),
     .grant = &{g.name}_grant,
     .lease = &{g.name}_lease,
     .component = watched_{index},
     .age = ages_{index},
     .ages = {len(g.ages)}U,
     .size = sizeof(soter_posix_lease_head) + sizeof({g.name}_command),
     .gather = command_{index},
     .apply = {apply}}},"""

    def _message_bytes(self, g: LeasedModule) -> int:
        sizes = [size_of(self.system.topics[i].type) for i in g.module.outputs]
        return HEAD_BYTES + sum(_padded(size) for size in sizes)

    def _message_number(self, g: LeasedModule) -> int:
        topics = [self.system.topics[i] for i in g.module.outputs]
        return number_of_layout(
            {"lease": g.channel, "head": HEAD_BYTES, "of": [described(t.type) for t in topics]}
        )

    # ------------------------------------------------------------ the actuators

    def actuator_files(self) -> list[PackageFile]:
        """The program of the actuators; none where no module has a law."""
        if not self.granted:
            return []
        return [
            PackageFile(f"{APP}.h", self._actuator_header()),
            PackageFile(f"{APP}.c", self._actuator_source()),
            PackageFile(YOURS, self._yours(), yours=True),
        ]

    def actuator_sources(self) -> list[str]:
        """What the program of the actuators is made of."""
        law = f"{self.unit.prefix}_lease.c"
        return [
            *(n for n in (*ACTUATOR, *OUTSIDE, *STATUS_TEXT) if n.endswith(".c")),
            *(f"{APP}.c", YOURS, "soter_lease.c", law, "soter_channel.c"),
        ]

    def _actuator_header(self) -> str:
        topics = max(len(g.module.outputs) for g in self.granted)
        words = max((self._message_bytes(g) + 7) // 8 for g in self.granted)
        return f"""\
/* {APP}.h: how much room the actuators need, generated by soter. */
#ifndef SOTER_ACTUATOR_APP_H
#define SOTER_ACTUATOR_APP_H

#define ACTUATOR_MODULES {len(self.granted)}
#define ACTUATOR_TOPICS {topics} /* of a module, at most */
#define ACTUATOR_WORDS {words} /* of the longest message */
#define ACTUATOR_STATUS_HASH UINT64_C({self.actuators_number:#018x}) /* soter_status.h */

#endif
"""

    def _actuator_source(self) -> str:
        tables = "".join(self._actuator_topics(g) for g in self.granted)
        rows = "\n".join(
            f"""\
    {{.name = "{g.module.name}",
     .channel = "{g.channel}",
     .hash = UINT64_C({self._message_number(g):#018x}),
     .size = {HEAD_BYTES}U + sizeof({g.name}_command),
     .lease = &{g.name}_lease,
     .topic = topics_{g.module.index},
     .topics = {len(g.module.outputs)}U}},"""
            for g in self.granted
        )
        return f"""\
/* {APP}.c: the modules that the actuators belong to, generated by soter. */
#include "soter_actuator.h"

#include "{self.unit.prefix}_lease.h"

{tables}const soter_actuator_module soter_actuator_modules[] = {{
{rows}
}};
const uint32_t soter_actuator_count = {len(self.granted)};
"""

    def _actuator_topics(self, g: LeasedModule) -> str:
        rows = []
        for i in g.module.outputs:
            t = self.system.topics[i]
            field = field_name(t.symbol.name.rpartition(".")[2])
            rows.append(
                f"""\
    {{.name = "{self.names[i]}",
     .hash = UINT64_C({layout_number(t):#018x}),
     .offset = offsetof({g.name}_command, {field}),
     .size = sizeof((({g.name}_command*)0)->{field})}},"""
            )
        listed = "\n".join(rows)
        return f"""\
static const soter_actuator_topic topics_{g.module.index}[] = {{
{listed}
}};

"""

    def _yours(self) -> str:
        cases = "\n".join(
            f"   *   {k}: `const {g.name}_command*`, module {g.module.name}"
            for k, g in enumerate(self.granted)
        )
        return f"""\
/* {YOURS}: what moves the devices, made by soter, yours to fill in. `soter build` does not
 * overwrite it.
 *
 * Called twice a millisecond with what is to be done: a command, or the fail-safe law.
 */
#include "soter_actuator.h"

#include "{self.unit.prefix}_lease.h"

void soter_actuate(uint32_t module, const void* command, bool obeys) {{
  /* `module`, and what `command` is:
{cases}
   */
  (void)module;
  (void)command;
  (void)obeys;
}}
"""

    # ------------------------------------------------------------ the other side

    def channel_files(self) -> list[PackageFile]:
        """The header for programs that speak on a topic, or listen; none where nothing is open."""
        topics = {t.index: t for t in self.topics}
        topics |= {i: self.system.topics[i] for g in self.granted for i in g.module.outputs}
        if not topics:
            return []
        prefix = self.unit.prefix
        entries = "\n".join(self._opener(t, inward=t.driver == "input") for t in topics.values())
        text = f"""\
/* {prefix}_channels.h: the topics by which system {self.system.name} meets the world, generated by
 * soter: a function each that opens its channel in the folder of --channels. With soter_outside.c
 * and soter_channel.c; times are ns on CLOCK_MONOTONIC. NULL, or what is wrong, in words.
 */
#ifndef SOTER_CHANNELS_OF_{prefix.upper()}_H
#define SOTER_CHANNELS_OF_{prefix.upper()}_H

#include "{prefix}.h"
#include "soter_outside.h"

{entries}
#endif
"""
        return [PackageFile(f"{prefix}_channels.h", text)]

    def _opener(self, t: Topic, *, inward: bool) -> str:
        name = self.names[t.index]
        what = "you write" if inward else "you read"
        kind = self.unit.topics[t.index][0]
        number, writes = f"UINT64_C({layout_number(t):#018x})", "true" if inward else "false"
        parameters = "soter_outside* channel, const char* folder"
        return f"""\
/* {t.name}: a `{kind}`, which {what} */
SOTER_INLINE const char* {self.unit.prefix}_open_{name}({parameters}) {{
  return soter_outside_open(channel, folder, "{name}", {number}, sizeof({kind}), {writes});
}}
"""


def _padded(size: int) -> int:
    return (size + 7) // 8 * 8
