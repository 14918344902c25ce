"""What an extern does to its process never becomes a verdict, nor two of them."""

from __future__ import annotations

import json
import os
import re
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from mcap.reader import make_reader

import processes
from json_documents import problems_of

if TYPE_CHECKING:
    from processes import Done

SOTER = (sys.executable, "-m", "soter.cli.main")
ROBOT = """
soter 1;
topic u: float in [-1.0, 1.0];
extern node Learned period 20ms { publishes u; failsafe u = 0.0; }
system S { node Learned; until 1s; always abs(u) < 0.9; }
"""
POLICIES = """
import atexit, os, sys, threading, time

calls = []

def leaves(inputs):
    os._exit(0)

def execs(inputs):
    os.execv("/bin/true", ["true"])

def crashes(inputs):
    os.kill(os.getpid(), 11)

def later(inputs):
    threading.Timer(0.0, os._exit, (0,)).start()
    time.sleep(600)

def hangs(inputs):
    time.sleep(600)

def spins(inputs):
    while True:
        pass

def side():
    import socket
    for n in os.listdir("/proc/self/fd"):
        try:
            return socket.socket(fileno=os.dup(int(n)))
        except OSError:
            continue

def floods(inputs):
    side().sendall(bytes([255]) * 4096)
    time.sleep(600)

def forges(inputs):
    side().sendall((9).to_bytes(8, "little") + b'["u", 1]x')
    time.sleep(600)

def answers_for_another(inputs):
    text = b'{"values": [[1.0]]}'
    side().sendall(len(text).to_bytes(8, "little") + text)
    time.sleep(600)

def at_the_end(inputs):
    atexit.register(os._exit, 0)
    return 1.0

def closes(inputs):
    os.closerange(3, 100)
    return 1.0

def forks(inputs):
    if not calls:
        calls.append(os.fork())
    return 0.5

def lives_on(inputs):
    if not calls:
        calls.append(threading.Thread(target=time.sleep, args=(600,)))
        calls[0].start()
    return 0.5

def moves(inputs):
    os.chdir("/")
    return 0.5

def shallow(inputs):
    for limit in range(20, 1000):
        try:
            sys.setrecursionlimit(limit)
        except RecursionError:
            continue
        return 0.5

def stops(inputs):
    if not calls:
        calls.append(os.getpid())
        for _ in range(int(os.environ["UP"])):
            stat = open(f"/proc/{calls[0]}/stat").read()
            calls[0] = int(stat.rpartition(")")[2].split()[1])
        os.kill(calls[0], 19)
    return 0.5

def colours(inputs):
    raise ValueError("\x1b[2J\x1b[31mred")
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "robot.soter").write_text(ROBOT)
    (tmp_path / "recovery.py").write_text(POLICIES)
    return tmp_path


def run(folder: Path, policy: str, *options: str) -> Done:
    command = [*SOTER, "run", "robot.soter", "--bind", f"Learned=python:recovery.py:{policy}"]
    done = processes.run([*command, *options], cwd=folder, capture_output=True, text=True)
    assert "Traceback" not in done.stderr
    return done


@pytest.mark.parametrize(
    ("policy", "why"),
    [
        ("leaves", "its process ended by itself, with exit status 0"),
        ("execs", "its process ended by itself, with exit status 0"),
        ("crashes", "its process was ended by SIGSEGV"),
        ("later", "its process ended by itself, with exit status 0"),
        ("hangs", "it did not answer for 0.5 s: ended"),
        ("spins", "it did not answer for 0.5 s: ended"),
        ("floods", "it answered with too much"),
        ("forges", "its process answered"),
        ("answers_for_another", "its process answered"),
    ],
)
@pytest.mark.parametrize("engine", ["native", "interp"])
def test_a_policy_that_ends_its_process_is_a_step_fault(
    folder: Path, policy: str, why: str, engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "did not answer" in why:
        monkeypatch.setenv("SOTER_EXTERN_PATIENCE_S", "0.5")
    done = run(folder, policy, "--engine", engine)
    assert done.returncode == 3
    assert re.search(r"Learned: 1 . `extern`", done.stdout)
    assert why in done.stdout


@pytest.mark.parametrize(
    ("first", "why"),
    [
        ("import os\nos._exit(0)\n", "ended by itself, with exit status 0"),
        ("import os\nos.kill(os.getpid(), 11)\n", "was ended by SIGSEGV"),
    ],
)
def test_a_policy_that_ends_its_process_while_it_is_loaded_is_told(
    folder: Path, first: str, why: str
) -> None:
    (folder / "recovery.py").write_text(first + POLICIES)
    done = run(folder, "forks")
    assert done.returncode == 1
    assert "X003" in done.stderr
    assert "`Learned` cannot be loaded" in done.stderr
    assert why in done.stderr


def test_a_policy_is_started_again_and_again_but_not_for_ever(folder: Path) -> None:
    text = (folder / "robot.soter").read_text()
    text = text.replace(
        "extern node Learned period 20ms { publishes u; failsafe u = 0.0; }",
        "extern node Learned period 20ms { publishes u; }\n"
        "node Safe period 20ms { publishes u; step { publish u = 0.0; } }\n"
        "rta Guard { ac Learned; sc Safe; period 20ms; safe abs(u) <= 1.0;"
        " ttf false; safer true; }",
    ).replace("system S { node Learned;", "system S { module Guard;")
    (folder / "robot.soter").write_text(text)
    report = json.loads(run(folder, "leaves", "--json").stdout)
    assert report["violations"] == 0
    assert report["modules"]["Guard"]["gate_faults"] == 51
    assert "exit status 0" in report["extern_failures"]["Guard.Learned"]


@pytest.mark.skipif(sys.platform != "linux", reason="it reads /proc")
@pytest.mark.parametrize("up", ["1", "2", "3"])
def test_a_policy_that_stops_who_started_it_gets_a_verdict_all_the_same(
    folder: Path, monkeypatch: pytest.MonkeyPatch, up: str
) -> None:
    """Who keeps its process, the command's child, and the command."""
    monkeypatch.setenv("UP", up)
    done = run(folder, "stops")
    assert (done.returncode, "no violation" in done.stdout.lower()) == (0, True), done.stdout


def test_a_missing_verdict_is_no_success(folder: Path) -> None:
    (folder / "leaves.c").write_text(C_LEAVES)
    done = run_c(folder)
    assert done.returncode == 1
    assert "error[X011]" in done.stderr
    assert done.stdout == ""


def test_a_missing_verdict_is_one_document(folder: Path) -> None:
    (folder / "leaves.c").write_text(C_LEAVES)
    done = run_c(folder, "--json")
    document = json.loads(done.stdout)
    assert problems_of(document) == []
    assert document["exit"] == done.returncode == 1
    assert [d["code"] for d in document["diagnostics"]] == ["X011"]


C_LEAVES = """
#include "robot.h"
#include <unistd.h>
int leaves(const robot_Learned_in *in, robot_Learned_out *out) {
  static long steps;
  (void)in;
  if (++steps > STEPS) { _exit(0); }
  out->u = 0.001 * (double)(steps % 500);
  out->has_u = 1;
  return 0;
}
""".replace("STEPS", "60000")


def run_c(folder: Path, *options: str) -> Done:
    command = [*SOTER, "run", "robot.soter", "--bind", "Learned=c:leaves.c:leaves"]
    return processes.run(
        [*command, "--until", "9h", *options],
        cwd=folder,
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize("policy", ["at_the_end", "closes"])
def test_a_violation_stays_one(folder: Path, policy: str) -> None:
    done = run(folder, policy)
    assert done.returncode == 3
    assert "VIOLATED" in done.stdout


HARMLESS = ["forks", "lives_on", "moves", "shallow"]


@pytest.mark.parametrize("engine", ["native", "interp"])
@pytest.mark.parametrize("policy", HARMLESS)
def test_one_summary_and_the_log_is_saved(folder: Path, policy: str, engine: str) -> None:
    done = run(folder, policy, "--engine", engine, "--log")
    assert done.returncode == 0
    assert done.stdout.count("no violation in this run") == 1
    assert [p.name for p in (folder / ".soter").iterdir()] == ["robot-S-1.mcap"]


def test_no_escape_sequence_reaches_the_terminal(folder: Path) -> None:
    done = run(folder, "colours")
    assert done.returncode == 3
    assert r"ValueError: \x1b[2J\x1b[31mred" in done.stdout
    assert "\x1b" not in done.stdout + done.stderr


C_FORKS = """
#include "robot.h"
#include <unistd.h>
int forks(const robot_Learned_in *in, robot_Learned_out *out) {
  static int done;
  (void)in;
  if (!done++) { (void)!fork(); }
  out->u = 0.5;
  out->has_u = 1;
  return 0;
}
"""


@pytest.mark.parametrize("engine", ["native", "interp"])
def test_a_copy_made_in_c_tells_nothing(folder: Path, engine: str) -> None:
    (folder / "forks.c").write_text(C_FORKS)
    command = [*SOTER, "run", "robot.soter", "--bind", "Learned=c:forks.c:forks"]
    done = processes.run([*command, "--engine", engine], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0
    assert done.stdout.count("no violation in this run") == 1


def test_a_program_without_externs_runs_in_the_process_itself(folder: Path) -> None:
    (folder / "plain.soter").write_text(
        "soter 1;\ntopic n: int in [0, 9];\n"
        "node N period 10ms { publishes n; step { publish n = 1; } }\n"
        "system S { node N; until 1s; always n < 9; }\n"
    )
    code = (
        "import os, sys; os.fork = None\n"
        "from soter.cli.main import main\n"
        "sys.argv = ['soter', 'run', 'plain.soter']\n"
        "sys.exit(main())"
    )
    done = processes.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_page_says_what_is_not_guarded(folder: Path) -> None:
    command = [*SOTER, "explain", "X011"]
    done = processes.run(command, cwd=folder, capture_output=True, text=True, env=dict(os.environ))
    assert "os._exit" in done.stdout


# ---------------------------------------------------------------- logs of runs that were broken off


SLOW = """
import os, time

def slow(inputs):
    time.sleep(0.0005)
    return 0.5
"""


def logged(path: Path) -> tuple[int, dict[str, str]]:
    """Last time in the log, ns, and what its end says."""
    with path.open("rb") as stream:
        reader = make_reader(stream)
        ends = [m.metadata for m in reader.iter_metadata() if m.name == "soter.end"]
        times = [m.log_time for _, _, m in reader.iter_messages()]
    assert times == sorted(times)
    (end,) = ends
    return times[-1], end


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_closes_the_log(folder: Path, number: signal.Signals) -> None:
    (folder / "slow.py").write_text(SLOW)
    command = [*SOTER, "run", "robot.soter", "--bind", "Learned=python:slow.py:slow"]
    command += ["--until", "9h", "--log", "a.mcap"]
    with processes.started(
        command, cwd=folder, stdout=processes.PIPE, stderr=processes.PIPE, text=True
    ) as process:
        processes.until(lambda: list(folder.glob(".a.mcap.*.part")), process)
        process.send_signal(number)
        out, err = process.communicate(timeout=processes.TIMEOUT_S)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert out.count("INTERRUPTED  stopped at ") == 1
    last_ns, end = logged(folder / "a.mcap")
    assert end["ended"] == f"abnormally: {number.name}"
    assert f"{last_ns / 1e9:.3f} s of" in out
    assert list(folder.glob(".a.mcap.*")) == []


def test_a_log_of_a_process_that_died_is_kept_up_to_its_last_chunk(folder: Path) -> None:
    (folder / "leaves.c").write_text(C_LEAVES)
    done = run_c(folder, "--log", "a.mcap")
    assert done.returncode == 1
    assert "the log until then is `a.mcap`" in done.stderr
    last_ns, end = logged(folder / "a.mcap")
    assert 500e9 < last_ns < 60_000 * 20e6
    assert end["ended"] == "abnormally: the process died"


@pytest.mark.parametrize("where", [["--log", "a.mcap"], ["--log"]])
@pytest.mark.long
def test_what_both_processes_left_of_a_log_is_named_by_the_next_run(
    folder: Path, where: list[str]
) -> None:
    (folder / "slow.py").write_text(SLOW)
    command = [*SOTER, "run", "robot.soter", "--bind", "Learned=python:slow.py:slow", *where]
    with processes.started([*command, "--until", "9h"], cwd=folder) as process:
        processes.until(lambda: list(folder.rglob(".*.mcap.*.part")), process)
        parts = list(folder.rglob(".*.mcap.*.part"))
        running = run(folder, "moves", *where)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    (part,) = parts
    wait_for_the_end_of(int(part.name.split(".")[-2].split("-")[0]))
    content = part.read_bytes()
    done = run(folder, "moves", *where)
    assert "unfinished" not in running.stderr
    assert f"unfinished log of an earlier run: `{part.relative_to(folder)}`" in done.stderr
    assert done.returncode == 0
    assert part.read_bytes() == content


def wait_for_the_end_of(process: int) -> None:
    end = time.monotonic() + processes.TIMEOUT_S
    while time.monotonic() < end:
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    raise AssertionError(process)


def test_a_run_to_the_end_says_so_in_its_log(folder: Path) -> None:
    done = run(folder, "moves", "--log", "a.mcap", "--json")
    last_ns, end = logged(folder / "a.mcap")
    assert last_ns == 1e9
    assert end == {"ended": "at its end", "trace_sha256": json.loads(done.stdout)["trace_sha256"]}


def test_sigterm_closes_the_log_of_a_script_and_ends_it(folder: Path) -> None:
    (folder / "slow.py").write_text(SLOW)
    code = (
        "import soter, slow; program = soter.load('robot.soter').bind('Learned', slow.slow)\n"
        "program.simulate(until='9h', log='a.mcap')"
    )
    with processes.started([sys.executable, "-c", code], cwd=folder) as process:
        processes.until(lambda: list(folder.glob(".a.mcap.*.part")), process)
        process.terminate()
        assert process.wait(processes.TIMEOUT_S) == -signal.SIGTERM
    assert logged(folder / "a.mcap")[1]["ended"] == "abnormally: SIGTERM"


C_HANGS = """
#include "robot.h"
#include <stdio.h>
int hangs(const robot_Learned_in *in, robot_Learned_out *out) {
  volatile int going = 1;
  (void)fclose(fopen("called", "w"));
  (void)in;
  (void)out;
  while (going) { }
  return 0;
}
"""


@pytest.mark.long
def test_a_second_ctrl_c_ends_code_that_hears_no_signals(folder: Path) -> None:
    (folder / "hangs.c").write_text(C_HANGS)
    command = [*SOTER, "run", "robot.soter", "--bind", "Learned=c:hangs.c:hangs", "--json"]
    with processes.started(
        command, cwd=folder, stdout=processes.PIPE, stderr=processes.PIPE, text=True
    ) as process:
        processes.until((folder / "called").exists, process)
        process.send_signal(signal.SIGINT)
        time.sleep(1.5)  # two that come at once are one
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=processes.TIMEOUT_S)
    assert process.returncode == json.loads(out)["exit"] == 130


# ---------------------------------------------------------------- what an extern leaves behind

FORKS = """
import os, time

started = []

def leave(again):
    if os.fork() == 0:
        again()
        with open("left.txt", "a") as file:
            file.write(f"{os.getpid()}\\n")
        time.sleep(600)

def forks(inputs):
    if not started:
        started.append(True)
        leave(lambda: None)
        leave(os.setsid)
        while not os.path.exists("left.txt") or open("left.txt").read().count("\\n") < 2:
            time.sleep(0.01)
    return 0.5
"""
C_FORKS = """
#include "robot.h"
#include <stdio.h>
#include <unistd.h>
int forks(const robot_Learned_in *in, robot_Learned_out *out) {
  static int started = 0;
  (void)in;
  if (started++ == 0 && fork() == 0) {
    FILE *file = fopen("left.txt", "a");
    if (file != NULL) { fprintf(file, "%d\\n", (int)getpid()); fclose(file); }
    sleep(600);
    _exit(0);
  }
  while (access("left.txt", F_OK) != 0) { }
  out->u = 0.5;
  out->has_u = 1;
  return 0;
}
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere only their session is ended")
@pytest.mark.parametrize("source", ["python:forks.py:forks", "c:forks.c:forks"])
def test_what_an_extern_forks_ends_with_the_run(folder: Path, source: str) -> None:
    (folder / "forks.py").write_text(FORKS)
    (folder / "forks.c").write_text(C_FORKS)
    command = [*SOTER, "run", "robot.soter", "--bind", f"Learned={source}", "--json"]
    done = processes.run(command, cwd=folder, capture_output=True, text=True)
    assert json.loads(done.stdout)["exit"] == done.returncode == 0
    left = [int(line) for line in (folder / "left.txt").read_text().split()]
    assert len(left) == (2 if source.startswith("python") else 1)
    for process in left:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere only their session is ended")
@pytest.mark.parametrize("more", [(), ("--real-time",)])
def test_what_python_forks_ends_when_the_command_is_killed(
    folder: Path, more: tuple[str, ...]
) -> None:
    (folder / "forks.py").write_text(FORKS)
    bound = f"Learned=python:{folder / 'forks.py'}:forks"
    left = folder / "left.txt"
    command = [*SOTER, "run", "robot.soter", "--bind", bound, "--until", "600s", *more]
    environment = {**os.environ, "TMPDIR": str(folder)}
    with processes.started(
        command, cwd=folder, env=environment, stdout=processes.DEVNULL
    ) as process:
        written = lambda: left.exists() and left.read_text().count("\n") == 2  # noqa: E731
        processes.until(written, process)
        process.kill()
    for number in left.read_text().split():
        wait_for_the_end_of(int(number))


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_one_signal_ends_code_that_hears_none(folder: Path) -> None:
    """SIGTERM to the command ends both of its processes, and so does SIGKILL to it alone."""
    began = 'FILE *file = fopen("began.txt", "w"); if (file != NULL) { fclose(file); }'
    text = "#include <stdio.h>\n" + C_HANGS.replace("(void)in;", f"{began} (void)in;")
    (folder / "hangs.c").write_text(text)
    command = [*SOTER, "run", "robot.soter", "--bind", "Learned=c:hangs.c:hangs", "--json"]
    for number in (signal.SIGKILL, signal.SIGTERM):
        with processes.started(command, cwd=folder, stdout=processes.PIPE, text=True) as process:
            while not (folder / "began.txt").exists():
                assert process.poll() is None
                time.sleep(0.05)
            (child,) = children(process.pid)
            process.send_signal(number)
            out, _ = process.communicate(timeout=processes.TIMEOUT_S)
            wait_for_the_end_of(child)
        (folder / "began.txt").unlink()
    assert process.returncode == json.loads(out)["exit"] == 130


def children(process: int) -> list[int]:
    """Those that run: what watched a compiler has ended, and is collected with the command."""
    numbers = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    stats = {int(n): Path(f"/proc/{n}/stat").read_text() for n in numbers}
    return [n for n, stat in stats.items() if stat.rpartition(")")[2].split()[0] != "Z"]
