"""What stands where on the site, after Diátaxis.

Purpose: the doors, then the four kinds of pages, in the order in which people want them.
Non-goals: their content. Every page of `docs/` stands here once: the build is strict about it.
"""

from __future__ import annotations

README, FRONT = "README.md", "site/front.md"
TARGETS = {README: "start.html", FRONT: "index.html"}
"""Pages that are called otherwise on the site; the front page is what a folder opens with."""
NAV: tuple[tuple[str, str, tuple[tuple[str, str], ...]], ...] = (
    (
        "Start",
        "what it did, for whom",
        (
            (FRONT, "Soter"),
            ("for-robotics-engineers.md", "For robotics engineers"),
            ("for-learning-researchers.md", "For learning researchers"),
            ("for-safety-engineers.md", "For safety engineers"),
        ),
    ),
    (
        "Tutorials",
        "learn by doing",
        (
            (README, "Five minutes"),
            ("first-hour.md", "The first hour"),
            ("prove-your-module.md", "Prove your module"),
            ("find-the-bug.md", "Find the bug"),
        ),
    ),
    (
        "How to",
        "get something done",
        (
            ("compose-proved-modules.md", "Compose proved modules"),
            ("externs.md", "Code that is not Soter"),
            ("python.md", "From Python"),
            ("gym.md", "Learning with Gymnasium"),
            ("migrating.md", "From somebody else's filter"),
            ("buffer.md", "How large a buffer"),
            ("companion-dies.md", "When the companion computer dies"),
            ("campaigns.md", "Fly for a hundred hours"),
            ("timing.md", "Execution times"),
            ("deploy.md", "In your firmware"),
            ("ground-robot.md", "A ground robot"),
            ("real-time.md", "Real time"),
            ("remote.md", "A policy in another process"),
            ("ros.md", "On ROS 1"),
            ("dds.md", "On the wire of ROS 2"),
            ("mavlink.md", "MAVLink"),
            ("bare-metal.md", "Bare metal"),
            ("real-logs.md", "Somebody else's logs"),
            ("monitor.md", "The model monitor"),
            ("identify.md", "Fit a program to logs"),
            ("editor.md", "In your editor"),
            ("assure.md", "A safety case"),
        ),
    ),
    (
        "Explanation",
        "understand",
        (
            ("proof.md", "What is proved"),
            ("proof-sets.md", "What SC keeps"),
            ("proof-modules.md", "Modules together"),
            ("proof-flight.md", "Decisions in flight"),
            ("verification.md", "How it is proved"),
            ("recheck.md", "Reading the re-checker"),
            ("testing.md", "What is explored"),
            ("gallery.md", "Four protocols"),
            ("drone.md", "The drone"),
            ("surveillance.md", "The surveillance drone"),
            ("exploration.md", "Safe exploration"),
            ("autopilot.md", "Somebody else's autopilot"),
            ("fleet.md", "Several robots"),
            ("mountain_car.md", "The mountain car"),
            ("results.md", "Results"),
            ("tool-qualification.md", "Tool qualification"),
            ("compared.md", "Beside others"),
            ("what-runs.md", "What each command executes"),
            ("newcomers.md", "Newcomers"),
            ("architecture.md", "The house"),
            ("inside-verify.md", "Inside the prover"),
            ("inside-recheck.md", "Inside the re-checker"),
            ("inside-explore.md", "Inside the explorer"),
            ("inside-codegen.md", "Inside the code generator"),
            ("release.md", "A release"),
            ("decisions.md", "Decisions"),
        ),
    ),
    (
        "Reference",
        "look it up",
        (
            ("language-card.md", "The language on one page"),
            ("language.md", "The controller language"),
            ("evidence.md", "Evidence clauses"),
            ("glossary.md", "Glossary"),
            ("semantics.md", "Semantics"),
            ("prelude.md", "The prelude"),
            ("commands.md", "The command line"),
            ("mapping.md", "The mapping"),
            ("json.md", "JSON documents"),
            ("stability.md", "What stays as it is"),
            ("benchmarks.md", "Benchmarks"),
        ),
    ),
)
"""Kind, what for, and its pages with their names in the menu."""
