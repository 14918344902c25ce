"""Traces to look at and to test with: a small one with every kind of step, and as large as wanted.

Purpose: `small()` and `large(lanes, steps)`; no program is behind them.
Non-goals: being right about anything; the numbers are made up.
"""

from __future__ import annotations

from soter.report.sequence_view import (
    Lane,
    Mode,
    ModeSwitch,
    ModuleModes,
    Pick,
    Published,
    SequenceStep,
    SequenceView,
)

MS = 1_000_000
M = "cart.Keep"


def small() -> SequenceView:
    """Return the story of a safe controller that steps too late."""
    s, p = SequenceStep, Published
    steps = (
        s(0, 0, "", "start", published=(p("motion", "{ x: 6.0, v: 0.0 }"), p("push", "0.0"))),
        s(1, 0, "cart.body", release_ns=0, published=(p("motion", "{ x: 6.0, v: 1.5 }"),),
          choices=(Pick("disturbance wind", "0.0"),)),
        s(2, 0, f"{M}.dm", release_ns=0, switch=ModeSwitch(M, "SC", "AC"),
          note="`safer` holds: x = 6.0"),
        s(3, 0, f"{M}.Careful", release_ns=0, gated=True, published=(p("push", "-1.0"),)),
        s(4, 0, f"{M}.Anything", release_ns=0, published=(p("push", "3.0"), p("lamp", "On")),
          choices=(Pick("choose [-3, 3]", "3.0", default=False),), observable=True),
        s(5, 100 * MS, "cart.body", release_ns=100 * MS,
          choices=(Pick("disturbance wind", "0.2", default=False),),
          published=(p("motion", "{ x: 7.9, v: 3.2 }"),)),
        s(6, 100 * MS, f"{M}.Anything", "overrun", release_ns=100 * MS,
          choices=(Pick("choose [-3, 3]", "3.0", default=False),), observable=True),
        s(7, 112 * MS, f"{M}.dm", release_ns=100 * MS, switch=ModeSwitch(M, "AC", "SC"),
          note="`ttf` holds: the wall is nearer than 2Δ"),
        s(8, 112 * MS, f"{M}.Anything", "effect", gated=True, published=(p("push", "3.0"),),
          observable=True),
        s(9, 200 * MS, "cart.body", release_ns=200 * MS, choices=(Pick("disturbance wind", "0.0"),),
          published=(p("motion", "{ x: 9.3, v: 3.5 }"),)),
        s(10, 200 * MS, "guard", release_ns=200 * MS, fault="division by zero"),
        s(11, 200 * MS, f"{M}.dm", release_ns=200 * MS),
        s(12, 200 * MS, f"{M}.Careful", "lost", release_ns=200 * MS, observable=True),
        s(13, 300 * MS, "cart.body", release_ns=300 * MS,
          choices=(Pick("disturbance wind", "0.0"),),
          published=(p("motion", "{ x: 10.4, v: 3.5 }"),), observable=True, violates=True,
          note="SC lost its release at 200 ms and has not braked; x = 10.4, the wall is at 10"),
        s(14, 325 * MS, f"{M}.Careful", release_ns=300 * MS, published=(p("push", "-3.0"),),
          observable=True),
    )  # fmt: skip
    return SequenceView(
        program="examples/testing/late_sc.soter",
        system="Protected",
        test="LateSC",
        property_text="always `motion.x < WALL`: the cart does not touch the wall",
        verdict="The cart hits the wall: SC may lose one release after the DM has switched to it.",
        lanes=(
            Lane("cart.body", "plant"),
            Lane(f"{M}.dm", "dm", M),
            Lane(f"{M}.Anything", "ac", M),
            Lane(f"{M}.Careful", "sc", M),
            Lane("guard", "node"),
        ),
        topics=("motion", "push", "lamp"),
        modes=(ModuleModes(M, ((0, "SC"), (2, "AC"), (7, "SC"))),),
        steps=steps,
        assumptions=(
            "`Learned` was replaced by `Anything`, which may do anything",
            "the wind takes its middle, lowest and highest value only",
        ),
        program_sha256="ab" * 32,
        tool_version="0.1.0",
        provenance={"command": "soter test examples/testing/late_sc.soter"},
    )


def large(lanes: int = 20, steps: int = 200) -> SequenceView:
    """Return a trace of modules of three lanes each, in turn, with plants between them."""
    actors = tuple(_lane(index) for index in range(lanes))
    modules = list(dict.fromkeys(lane.module for lane in actors if lane.module is not None))
    mode: dict[str, Mode] = dict.fromkeys(modules, "SC")
    modes: dict[str, list[tuple[int, Mode]]] = {name: [(0, "SC")] for name in modules}
    made: list[SequenceStep] = [SequenceStep(0, 0, "", "start")]
    for number in range(1, steps):
        lane = actors[(number * 7) % lanes]
        time_ns = number // 8 * 12_500_000
        switch = None
        if lane.role == "dm" and lane.module is not None and number % 3 == 0:
            before = mode[lane.module]
            after: Mode = "AC" if before == "SC" else "SC"
            switch, mode[lane.module] = ModeSwitch(lane.module, before, after), after
            modes[lane.module].append((number, after))
        picks = (Pick("choose", str(number % 3), default=number % 3 == 0),)
        made.append(
            SequenceStep(
                number,
                time_ns,
                lane.name,
                "lost" if number % 31 == 0 else "step",
                release_ns=max(0, time_ns - (number % 5 == 0) * 5_000_000),
                choices=picks if lane.role == "ac" and number % 31 else (),
                published=(Published(f"topic{number % lanes}", str(number / 8)),)
                if lane.role != "dm" and number % 31
                else (),
                gated=lane.role in ("ac", "sc")
                and lane.module is not None
                and mode[lane.module].lower() != lane.role,
                switch=switch if number % 31 else None,
                observable=number % 8 == 7,
                violates=number == steps - 1,
            )
        )
    return SequenceView(
        program="fleet.soter",
        system="Fleet",
        test="Everything",
        property_text="always `invariants`",
        verdict="Two drones come too close.",
        lanes=actors,
        topics=tuple(f"topic{index}" for index in range(lanes)),
        modes=tuple(ModuleModes(name, tuple(changes)) for name, changes in modes.items()),
        steps=tuple(made),
    )


def _lane(index: int) -> Lane:
    group, part = divmod(index, 4)
    module = f"drone{group}.SafeMotionPrimitive"
    if part == 0:
        return Lane(f"drone{group}.body", "plant")
    role, name = (("dm", "dm"), ("ac", "MotionPrimitive"), ("sc", "MotionPrimitiveSC"))[part - 1]
    return Lane(f"{module}.{name}", role, module)  # type: ignore[arg-type]
