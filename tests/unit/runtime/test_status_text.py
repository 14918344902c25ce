"""What bridges say of a module: the sentence, its level, the margin, who has to be armed.

Non-goals: who writes the words (`tests/correct/test_arming.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from cffi import FFI

import processes
from soter.native.compiler import STRICT, WARNINGS, find_compiler
from soter.native.shared_library import RUNTIME
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

POSIX = RUNTIME / "posix"
NOW = 10**12
OK, WARN, ERROR, STALE = 0, 1, 2, 3
ARMED, HOLDS, ENDED = 1, 2, 3
BEGAN, CHECKED, UNCHECKED = 0, 1, 2
HEAD, MODULE, LEASE = 3, 9, 6
ARM = "rosrun shuttle arm"


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any]:
    """(ffi, library)."""
    made: Path = tmp_path_factory.mktemp("text") / "text.so"
    flags = [*STRICT, *WARNINGS, "-O1", "-fPIC", "-shared", f"-I{RUNTIME}", f"-I{POSIX}"]
    words = [*find_compiler().command, *flags, str(POSIX / "soter_status_text.c"), "-o", str(made)]
    done = processes.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    ffi = FFI()
    ffi.cdef(
        """
        typedef struct { bool alive, ac, safer; int64_t sure_until; uint32_t why;
                         const uint64_t *takeovers; uint64_t missed; bool leased, lease_over;
                         uint64_t given; uint32_t old_topic; int64_t old_ns, old_most_ns;
                         bool actuators_alive; uint32_t state, how, answer;
        } soter_module_facts;
        typedef struct { uint32_t modules, module; int32_t lease; } soter_module_place;
        soter_module_facts soter_module_facts_of(soter_module_place, int64_t, const uint64_t *,
                                                 int64_t, const uint64_t *, int64_t);
        int soter_module_level(const soter_module_facts *);
        void soter_module_message(const soter_module_facts *, const char *, char *, size_t);
        double soter_margin_s(const soter_module_facts *, int64_t);
        const char *soter_armed_text(const soter_module_facts *);
        const char *soter_takeover_text(uint32_t);
        """
    )
    return ffi, ffi.dlopen(str(made))


def told(code: tuple[Any, Any], **changed: int) -> tuple[int, str, float, str]:
    """Level, sentence, margin and how it is armed, of the second of two modules."""
    said = {"mode": 0, "sure": 0, "safer": 1, "over": 0, "age": 0, "lease": 0}
    said |= {"state": HOLDS, "how": BEGAN, "actuators_age": 0, **changed}
    ffi, library = code
    module = [said["mode"], said["sure"], said["safer"], 1, 7, 0, 0, 0, 0]
    words = ffi.new("uint64_t[]", [9, 0, 0, *[77] * MODULE, *module, 5, 0, said["over"], 0, 0, 0])
    actuators = ffi.new("uint64_t[]", [4711, 0, 0, said["state"], said["how"], 0])
    assert len(words) == HEAD + 2 * MODULE + LEASE
    facts = ffi.new("soter_module_facts *")
    facts[0] = library.soter_module_facts_of(
        (2, 1, said["lease"]), NOW, words, NOW - said["age"], actuators, NOW - said["actuators_age"]
    )
    room = ffi.new("char[320]")
    library.soter_module_message(facts, ARM.encode(), room, len(room))
    armed = ffi.string(library.soter_armed_text(facts)).decode()
    margin = library.soter_margin_s(facts, NOW)
    return library.soter_module_level(facts), ffi.string(room).decode(), margin, armed


@all_rows(
    ("changed", "level", "sentence", "armed"),
    [
        ({"mode": 1}, OK, "AC has control", "yes"),
        ({}, WARN, "SC has control", "yes"),
        ({"mode": 1, "how": CHECKED}, OK, "AC has control", "yes, after a look"),
        ({"mode": 1, "how": UNCHECKED}, WARN, "without a look at the state", "yes, without a look"),
        ({"state": ARMED}, WARN, "until a command comes", "yes"),
        ({"state": ENDED}, ERROR, f"until a person arms them: {ARM} (taken now", "no"),
        ({"state": ENDED, "safer": 0}, ERROR, f"{ARM} (refused now: safer does not hold", "no"),
        ({"over": 1, "state": ENDED}, ERROR, "leases have ended: the actuators hold the ", "no"),
        ({"over": 1}, ERROR, ARM, "yes"),
        ({"actuators_age": 10**9}, ERROR, "the actuators are silent", "unknown"),
        ({"age": 10**9}, STALE, "the trusted part is silent", "yes"),
        ({"age": 10**9, "state": ENDED}, STALE, f"wait to be armed: {ARM}", "no"),
        ({"lease": -1, "mode": 1}, OK, "AC has control", "it has no fail-safe law"),
        ({"lease": -1, "mode": 1, "state": ENDED}, OK, "AC has control", "it has no fail-safe law"),
    ],
)
def test_a_person_reads_who_has_control_and_what_has_to_be_done(
    code: tuple[Any, Any], changed: dict[str, int], level: int, sentence: str, armed: str
) -> None:
    found = told(code, **changed)
    assert found[0] == level
    assert sentence in found[1]
    assert found[3].startswith(armed)


@pytest.mark.parametrize(
    ("changed", "margin"),
    [
        ({"mode": 1, "sure": NOW + 85_000_000}, 0.085),
        ({"mode": 1, "sure": NOW - 1}, 0.0),
        ({"mode": 0, "sure": NOW + 85_000_000}, 0.0),
        ({"mode": 1, "sure": NOW + 85_000_000, "age": 10**9}, 0.0),
    ],
)
def test_a_margin_is_what_is_left_now_and_none_where_nobody_is_heard(
    code: tuple[Any, Any], changed: dict[str, int], margin: float
) -> None:
    assert told(code, **changed)[2] == pytest.approx(margin)


def test_every_cause_of_a_takeover_has_its_own_words(code: tuple[Any, Any]) -> None:
    ffi, library = code
    texts = [ffi.string(library.soter_takeover_text(why)) for why in range(7)]
    assert len({*texts[:6]}) == 6
    assert texts[6] == texts[0] == b"never"
