"""The latch: nothing but an operator's new acknowledgement gives control back, and that only once.

Every misuse is told to both engines at once, message by message, and they stay byte for byte
alike; behind it stands a proper acknowledgement, which does give control back. Times are in ms: the
decision module looks every 10 ms, takes over at 100 ms, and a press counts for 50 ms.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from generators.engine_comparison import compile_library, first_difference, subject
from generators.outside_input_driver import Outside
from soter.api.program import load
from soter.api.rechecking import recheck
from soter.cli.main import main
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import next_instant
from soter.simulate.run import state_bytes
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from generators.engine_comparison import Subject

MS = 1_000_000
TAKEOVER = 100
"""When SC takes over."""
AGE = 50
"""For so long a press counts."""
END = 400
"""Until then nothing gives control back; then it is acknowledged properly."""

NODES = """soter 1;
topic {u} : float in [-1.0, 1.0] = 0.0;
node Ac{u} period 10ms {{
  subscribes wrong;
  publishes {u};
  step {{ publish {u} = wrong ? 2.0 : 1.0; }}
}}
node Sc{u} period 10ms {{ publishes {u}; step {{ publish {u} = 0.0; }} }}
"""
INPUTS = """input topic wrong : bool;
input topic danger : int in [0, 2] max_age 10s;
input topic button : bool max_age 50ms;
input topic other : bool max_age 50ms;
"""
MODULE = """rta {name} {{
  ac Ac{u};
  sc Sc{u};
  period 10ms;
  safe true;
  ttf danger == 2;
  safer danger == 0;
  clean 1;
  {returns}
}}
"""
TWO = (
    NODES.format(u="u")
    + INPUTS
    + NODES.format(u="v").removeprefix("soter 1;\n")
    + MODULE.format(name="M", u="u", returns="returns after button;")
    + MODULE.format(name="Other", u="v", returns="returns after other;")
    + "system S { module M; module Other; }\n"
)
NEVER = (
    NODES.format(u="u")
    + INPUTS.replace("input topic button : bool max_age 50ms;\n", "")
    + MODULE.format(name="M", u="u", returns="returns never;")
    + "node Reads period 1s { subscribes other; step { let seen = other; } }\n"
    + "system S { module M; node Reads; }\n"
)


class Robot:
    """One program on both engines, which are told the same and stay alike."""

    def __init__(self, s: Subject, library: Path) -> None:
        self.subject = s
        self.native, self.interpreter = Outside(library, s), Interpreter(s.system, s.seed)
        self.c, self.record = self.interpreter.initial(), self.interpreter.record()

    def until(self, ms: float) -> None:
        """Run every instant up to this time; the engines stay alike after each."""
        while next_instant(self.interpreter.machine, self.c) <= ms * MS:
            assert self.native.instant() is None
            self.c = self.interpreter.instant(self.c, choose_input=lambda _: (), record=self.record)
            s = self.subject
            other = state_bytes(s.system, s.layout, self.c, self.record, s.seed)
            states = (self.native.state.reshape(1, -1), np.frombuffer(other, dtype=np.uint8))
            words = first_difference(s, states[0], states[1].reshape(1, -1))
            assert words is None, f"at {self.c.ct} ns: {words}"

    def tell(self, ms: float, topic: str, value: object, measured: float | None = None) -> bool:
        """A message that arrives at this time; whether it was taken."""
        if ms > 0:
            self.until(ms - 0.5)
        index = self.subject.system.topic(topic).index
        stamp = round((ms if measured is None else measured) * MS)
        kind = self.native.publish(index, value, stamp)
        self.c, refused = self.interpreter.publish_input(self.c, index, value, stamp)
        assert kind == (refused or 0)
        return kind == 0

    def button(self, start: float, values: str, topic: str = "button", every: float = 10) -> None:
        """What a panel shows from a time on, every so often: `-` released, `#` pressed."""
        for i, value in enumerate(values):
            self.tell(start + every * i, topic, value == "#")

    def mode(self, module: str = "M") -> str:
        """Who has control after the last look."""
        found = next(m for m in self.subject.system.modules if m.name == module)
        return ("SC", "AC")[self.c.L[found.dm]]

    @property
    def times_given_back(self) -> int:
        """How often AC of M got control so far."""
        return int(self.native.record["modules"]["to_ac"][0])

    def stays_in_sc(self, ms: float, given_back: int) -> None:
        """AC got control so often before, and not once more up to this time."""
        self.until(ms)
        assert self.mode() == "SC"
        assert self.times_given_back == given_back


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Robot]:
    """Makes a robot at its start."""
    subjects = {"two": subject("two", TWO, 1, 10), "never": subject("never", NEVER, 1, 10)}
    library = compile_library(list(subjects.values()), tmp_path_factory.mktemp("latch"), "-O2")
    return lambda name: Robot(subjects[name], library)


def acknowledged(r: Robot, ms: float) -> None:
    """A proper acknowledgement, from a released button on: control is back."""
    r.button(ms, "-#")
    r.until(ms + 20)
    assert r.mode() == "AC"


def taken_over(r: Robot) -> Robot:
    """AC had control, after an acknowledgement, and lost it at TAKEOVER; it is safer since."""
    r.tell(1, "danger", 0)
    acknowledged(r, 5)
    r.tell(TAKEOVER - 5, "danger", 2)
    r.until(TAKEOVER)
    assert r.mode() == "SC"
    r.tell(TAKEOVER + 1, "danger", 0)
    return r


def nobody(r: Robot) -> None:
    """Nobody comes; the topic keeps the press that gave control back before."""


def old(r: Robot) -> None:
    """It was measured before the takeover, and comes after it."""
    assert r.tell(115, "button", True, measured=95)


def old_after_release(r: Robot) -> None:
    """A press from before the takeover, behind a release from after it: messages changed places."""
    assert r.tell(115, "button", False)
    assert not r.tell(125, "button", True, measured=99)


def repeated(r: Robot) -> None:
    """The message that gave control back once, word for word, again and again."""
    stamp = r.c.stamps[r.subject.system.topic("button").index] / MS
    for ms in range(105, 200, 10):
        assert r.tell(ms, "button", True, measured=stamp)


def replayed_pair(r: Robot) -> None:
    """Release and press, as they were recorded before the takeover."""
    assert not r.tell(115, "button", False, measured=5)
    assert r.tell(125, "button", True, measured=15)


def held(r: Robot) -> None:
    """The button sticks: it is pressed in every message."""
    r.button(105, "#" * 20)


def release_only(r: Robot) -> None:
    """It was held during the takeover, and is let go."""
    r.button(105, "###-----")


def release_at_the_takeover(r: Robot) -> None:
    """The release has the time of the takeover itself."""
    assert r.tell(105, "button", False, measured=TAKEOVER)
    r.button(115, "####")


def of_one_time(r: Robot) -> None:
    """A release and a press of one and the same time."""
    assert r.tell(112, "button", False)
    assert r.tell(125, "button", True, measured=112)


def between_two_looks(r: Robot) -> None:
    """Release and press between two looks: the release was never seen."""
    for ms in range(110, 200, 10):
        r.button(ms + 2, "-#", every=3)


def short_press(r: Robot) -> None:
    """Pressed and released between two looks: the press was never seen."""
    for ms in range(110, 200, 10):
        r.button(ms + 2, "#-", every=3)


def another_topic(r: Robot) -> None:
    """The button of another module, pressed properly."""
    r.button(115, "--##", topic="other")


def forged_future(r: Robot) -> None:
    """A time that has not come yet is refused."""
    r.button(105, "-")
    r.until(115)
    assert not r.tell(116, "button", True, measured=1e6)


def forged_past(r: Robot) -> None:
    """A time before everything is refused."""
    r.button(105, "-")
    r.until(115)
    assert not r.tell(116, "button", True, measured=-1)


def forged_memory(r: Robot) -> None:
    """What the decision module remembers is nobody's to publish."""
    assert not r.tell(115, "M.latch", 2)


def delayed(r: Robot) -> None:
    """The press comes when it is too old; that it is still held then is no new press."""
    r.button(105, "-")
    assert r.tell(185, "button", True, measured=120)
    r.button(195, "####")


def dropped_then_late(r: Robot) -> None:
    """The release was lost, and comes after the press: it is older, and refused."""
    r.button(115, "#")
    r.until(125)
    assert not r.tell(126, "button", False, measured=110)
    r.button(135, "##")


def while_it_is_not_safer(r: Robot) -> None:
    """It expires before it is safer, however long the button is held."""
    r.tell(103, "danger", 1)
    r.button(105, "-#######")
    r.until(178)
    r.tell(179, "danger", 0)


def during_danger(r: Robot) -> None:
    """It was pressed while `ttf` held."""
    r.tell(103, "danger", 2)
    r.button(105, "-#")
    r.until(178)
    r.tell(179, "danger", 0)


def while_its_inputs_are_stale(r: Robot) -> None:
    """What `safer` reads is too old all the while that the press counts."""
    r.until(10_250)
    r.button(10_255, "-#")
    r.until(10_400)
    r.tell(10_401, "danger", 0)


def while_ac_owes_clean_outputs(r: Robot) -> None:
    """AC publishes what the gate refuses for as long as the press counts."""
    r.tell(102, "wrong", True)
    r.button(115, "-#")
    r.until(178)
    r.tell(179, "wrong", False)


MISUSES = [
    nobody, old, old_after_release, repeated, replayed_pair, held, release_only,
    release_at_the_takeover, of_one_time, between_two_looks, short_press, another_topic,
    forged_future, forged_past, forged_memory, delayed, dropped_then_late, while_it_is_not_safer,
    during_danger, while_its_inputs_are_stale, while_ac_owes_clean_outputs,
]  # fmt: skip


@all_rows("misuse", MISUSES)
def test_misuse_gives_no_control_back(
    misuse: Callable[[Robot], None], robots: Callable[[str], Robot]
) -> None:
    r = taken_over(robots("two"))
    misuse(r)
    ms = max(END, r.c.ct / MS + AGE + 20)
    r.stays_in_sc(ms, 1)
    acknowledged(r, ms + 5)


def pressed_before_the_takeover(r: Robot) -> None:
    """It is pressed while AC has control, and held."""
    r.tell(93, "button", False)
    r.tell(94, "button", True)


def seen_pressed_before_the_takeover(r: Robot) -> None:
    """The same, and the decision module saw both."""
    r.button(72, "-#")


def at_the_instant_of_the_takeover(r: Robot) -> None:
    """The press has the time of the takeover itself."""
    r.tell(85, "button", False)
    r.tell(TAKEOVER, "button", True)


@pytest.mark.parametrize(
    "early",
    [
        pressed_before_the_takeover,
        seen_pressed_before_the_takeover,
        at_the_instant_of_the_takeover,
    ],
)
def test_an_early_press_gives_no_control_back(
    early: Callable[[Robot], None], robots: Callable[[str], Robot]
) -> None:
    r = robots("two")
    r.tell(1, "danger", 0)
    acknowledged(r, 5)
    early(r)
    r.tell(max(r.c.ct / MS, 95), "danger", 2, measured=95)
    r.until(TAKEOVER)
    assert r.mode() == "SC"
    r.tell(TAKEOVER + 1, "danger", 0)
    r.stays_in_sc(END, 1)
    acknowledged(r, END + 5)


def before_the_start(r: Robot) -> None:
    """Released and pressed before the first instant, by the clock of whoever sends it."""
    assert r.tell(0, "button", False, measured=-20)
    assert r.tell(0, "button", True, measured=-10)


def at_the_start(r: Robot) -> None:
    """The first look sees a press of its own time."""
    assert r.tell(0, "button", False, measured=-1)
    assert r.tell(0, "button", True, measured=0)


def held_at_the_start(r: Robot) -> None:
    """The button sticks while the robot starts."""
    r.button(0, "#" * 20)


def released_before_the_start(r: Robot) -> None:
    """Only the press comes after the start."""
    assert r.tell(0, "button", False, measured=-1)
    r.button(5, "####")


def released_at_the_start(r: Robot) -> None:
    """The release has the time of the first look."""
    assert r.tell(0, "button", False, measured=0)
    r.button(5, "####")


@pytest.mark.parametrize(
    "early",
    [
        before_the_start,
        at_the_start,
        held_at_the_start,
        released_before_the_start,
        released_at_the_start,
    ],
)
def test_a_robot_that_starts_again_is_latched(
    early: Callable[[Robot], None], robots: Callable[[str], Robot]
) -> None:
    r = robots("two")
    early(r)
    r.tell(max(r.c.ct / MS, 1), "danger", 0)
    r.stays_in_sc(END, 0)
    acknowledged(r, END + 5)


def test_one_press_gives_control_back_once(robots: Callable[[str], Robot]) -> None:
    """A second takeover while the press is young needs another one."""
    r = taken_over(robots("two"))
    acknowledged(r, 125)
    r.tell(146, "danger", 2)
    r.until(150)
    assert r.mode() == "SC"
    r.tell(151, "danger", 0)
    r.stays_in_sc(END, 2)
    acknowledged(r, END + 5)


def test_a_press_counts_until_it_is_too_old_and_no_longer(robots: Callable[[str], Robot]) -> None:
    for late_ms, after in ((0, "AC"), (10, "SC")):
        r = taken_over(robots("two"))
        r.tell(103, "danger", 1)
        r.button(105, "-")
        r.tell(120, "button", True)
        r.until(120 + AGE + late_ms - 1)
        r.tell(120 + AGE + late_ms - 1, "danger", 0)
        r.until(120 + AGE + late_ms)
        assert r.mode() == after
        r.until(END)
        assert r.mode() == after


def test_control_comes_back_at_the_first_look_at_which_it_would_without_a_latch(
    robots: Callable[[str], Robot],
) -> None:
    r = taken_over(robots("two"))
    r.tell(103, "danger", 1)
    r.button(105, "-#")
    r.tell(131, "danger", 0)
    r.until(139)
    assert r.mode() == "SC"
    r.until(140)
    assert r.mode() == "AC"


def test_each_module_has_a_button_of_its_own(robots: Callable[[str], Robot]) -> None:
    r = taken_over(robots("two"))
    r.button(115, "-#", topic="other")
    r.until(END)
    assert (r.mode(), r.mode("Other")) == ("SC", "AC")
    acknowledged(r, END + 5)


def test_a_dm_that_returns_never_gives_control_once(robots: Callable[[str], Robot]) -> None:
    r = robots("never")
    r.tell(1, "danger", 1)
    r.until(20)
    assert r.mode() == "SC"
    r.tell(21, "danger", 0)
    r.until(30)
    assert r.mode() == "AC"
    r.tell(TAKEOVER - 5, "danger", 2)
    r.until(TAKEOVER)
    assert r.mode() == "SC"
    r.tell(TAKEOVER + 1, "danger", 0)
    r.button(115, "-#", topic="other")
    r.stays_in_sc(END, 1)


EXAMPLE = Path(__file__).parents[2] / "examples" / "wall" / "acknowledge.soter"


def test_the_example_is_proved_and_deployed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (module,) = load(EXAMPLE).verify(cert=tmp_path / "cert", refute=False).modules
    said = {name: f.verdict for name, f in module.findings.items()}
    assert said.pop("failsafe") == "assumed"
    assert set(said.values()) == {"proved"}
    report = recheck(tmp_path / "cert")
    assert report.accepted
    assert report.has_return
    told = ["--system", "Vehicle", "--cert", str(tmp_path / "cert"), "--target", "posix"]
    assert main(["build", str(EXAMPLE), *told, "-o", str(tmp_path / "package")]) == 0
    assert "inherits  Guard" in capsys.readouterr().out
    app = (tmp_path / "package" / "soter_posix_app.c").read_text(encoding="utf-8")
    waits = dict(re.findall(r'\.name = "(\w+)",.*?\.awaited = (\w+)', app, re.DOTALL))
    assert waits == {"position": "true", "speed": "false", "reset": "false"}, "none is needed"
    inherited = (tmp_path / "package" / "inherited.json").read_text(encoding="utf-8")
    assert "a press of reset is in force" in inherited
