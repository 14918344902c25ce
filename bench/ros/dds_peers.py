"""A bridge to DDS and its peers, on loopback, for the benchmarks of this folder.

Purpose: build the package, the harness behind it and the peers; start and end them.
Non-goals: what is measured (`dds_samples.py`).
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.ros.dds_fields import TYPES, definitions, fields, mapping, numbered, write_code

HERE = Path(__file__).resolve().parent
NEEDED = ("idlc", "fastddsgen", "g++", "gcc", "pkg-config", "make")
LOOPBACK = (
    "<CycloneDDS><Domain>"
    "<General><Interfaces><NetworkInterface name='lo'/></Interfaces></General>"
    "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>30</MaxAutoParticipantIndex>"
    "<Peers><Peer address='localhost'/></Peers></Discovery>"
    "</Domain></CycloneDDS>"
)


def missing() -> str:
    """What this machine lacks; "": nothing."""
    return ", ".join(n for n in NEEDED if shutil.which(n) is None)


def _run(*words: str | Path, where: Path | None = None) -> None:
    text = [str(w) for w in words]
    told = subprocess.run(text, cwd=where, capture_output=True, text=True, check=False)
    if told.returncode != 0:
        sys.exit(f"{words[0]} failed:\n{told.stdout[-2000:]}{told.stderr[-4000:]}")


@dataclass
class Place:
    """A folder with the package, the harness and the peers, built."""

    folder: Path
    python: str
    """The interpreter that has `cyclonedds`."""
    domain: int
    running: list[subprocess.Popen[str]] = field(default_factory=list)

    @property
    def package(self) -> Path:
        """What `soter build` wrote."""
        return self.folder / "package"

    @property
    def environment(self) -> dict[str, str]:
        """Loopback, and a domain of its own."""
        return {
            **os.environ,
            "ROS_DOMAIN_ID": str(self.domain),
            "CYCLONEDDS_URI": LOOPBACK,
            "SKIP_DEFAULT_XML": "1",
        }

    def build(self) -> None:
        """Everything."""
        self.folder.mkdir(parents=True, exist_ok=True)
        map_ = self.folder / "map.toml"
        map_.write_text(mapping(), encoding="utf-8")
        words = ("-m", "soter", "build", HERE / "dds_fields.soter", "--system", "Wire")
        _run(sys.executable, *words, "--target", "dds", "--map", map_, "-o", self.package)
        _run("make", "-C", self.package)
        for key, name in TYPES.items():
            text = json.dumps(definitions(name))
            (self.folder / f"{key}.json").write_text(text, encoding="utf-8")
        both = definitions(TYPES["odom"]) | definitions(TYPES["scan"])
        (self.folder / "types.json").write_text(json.dumps(both), encoding="utf-8")
        write_code(self.folder)
        self._harness()
        made = ["-I", str(HERE), "-I", str(self.folder)]
        build = self.package / "build"
        messages = build / "dds_fields_messages.c"
        own: tuple[str | Path, ...] = ("-o", self.folder / "wire", HERE / "dds_wire.c", messages)
        _run("gcc", "-O1", *made, "-I", build, *own, "-lddsc")
        idl = self.folder / "fast"
        idl.mkdir(exist_ok=True)
        shutil.copy(self.package / "idl" / "dds_fields_messages.idl", idl)
        _run("fastddsgen", "-replace", "-cs", "dds_fields_messages.idl", where=idl)
        own = (
            "-o",
            self.folder / "fast_peer",
            HERE / "dds_fast_peer.cpp",
            *sorted(idl.glob("*.cxx")),
        )
        _run("g++", "-O1", *made, "-I", idl, *own, "-lfastrtps", "-lfastcdr")

    def _harness(self) -> None:
        source = (self.package / "src" / "dds_fields_bridge.c").read_text(encoding="utf-8")
        rows = re.findall(r'\{"(\w+)", (UINT64_C\(\w+\)), sizeof\((\w+)\)', source)
        lines = [
            f"#define {name.upper()}_HASH {hash_}\ntypedef {kind} {name.upper()}_VALUE;"
            for name, hash_, kind in rows
        ]
        lines += [_of_value("odom", "odom"), _of_value("scan", "scan"), _fill_echo()]
        (self.folder / "harness_code.h").write_text("\n".join(lines), encoding="utf-8")
        trusted = self.package / "trusted"
        sources = [
            trusted / n for n in ("soter_outside.c", "soter_channel.c", "soter_posix_check.c")
        ]
        _run("gcc", "-O1", "-I", HERE, "-I", self.folder, "-I", trusted, "-o",
             self.folder / "harness", HERE / "dds_harness.c", *sources, "-pthread")  # fmt: skip

    # ------------------------------------------------------------ processes

    def start(self, *words: str | Path) -> Running:
        """A process."""
        process = subprocess.Popen(
            [str(w) for w in words],
            env=self.environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.running.append(process)
        return Running(process)

    def bridge(self) -> Running:
        """The bridge, until it says that it runs."""
        channels = self.folder / "channels"
        shutil.rmtree(channels, ignore_errors=True)
        channels.mkdir()
        program = self.package / "build" / "dds_fields_bridge"
        made = self.start(program, "--channels", channels, "--status", "json")
        made.wait_for("it runs")
        return made

    def harness(self) -> Running:
        """What stands behind it."""
        made = self.start(self.folder / "harness", self.folder / "channels")
        made.wait_for("harness runs")
        return made

    def peer(self, which: str, *words: str | Path) -> dict[str, Any]:
        """A peer until its end: what it says."""
        if which == "Fast DDS":
            made = self.start(self.folder / "fast_peer", *words)
        else:
            more = [self.folder / "types.json"]
            made = self.start(self.python, HERE / "dds_python_peer.py", *words, *more)
        return made.told()

    def end(self) -> None:
        """All that still runs."""
        for process in self.running:
            if process.poll() is None:
                process.kill()


class Running:
    """A process whose lines on standard error are kept."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        self.said: list[str] = []
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self.process.stderr is not None
        self.said.extend(self.process.stderr)

    def wait_for(self, text: str) -> None:
        """Until it says so."""
        for _ in range(1000):
            if any(text in line for line in [*self.said]):
                return
            if self.process.poll() is not None:
                break
            time.sleep(0.01)
        sys.exit(f"{self.process.args!r} did not say `{text}`: {''.join(self.said)}")

    def told(self) -> dict[str, Any]:
        """The last line of what it says at its end, as JSON."""
        assert self.process.stdout is not None
        lines = self.process.stdout.read().strip().splitlines()
        self.process.wait()
        if not lines:
            sys.exit(f"{self.process.args!r} said nothing: {''.join(self.said)}")
        told = json.loads(lines[-1])
        assert isinstance(told, dict)
        return told

    def end(self) -> dict[str, Any]:
        """Ask it to end; what it says."""
        self.process.send_signal(signal.SIGTERM)
        return self.told()


def _rows(name: str) -> dict[str, str]:
    """Of a topic of the mapping: where each leaf comes from."""
    text = mapping().split(f"[topics.{name}.fields]")[1].split("[topics.")[0]
    return dict(re.findall(r'"([^"]+)" = "([^"]+)"', text))


def _leaves(name: str, key: str) -> list[tuple[str, str]]:
    """Each leaf as C writes it, and what stands in it."""
    found = fields(TYPES[key], definitions(TYPES[key]))
    made = []
    for leaf, path in _rows(name).items():
        access = leaf.replace(".[", ".at[")
        if leaf == "child":
            made.append((access, "(k % 3u)"))
        elif (access, key) in (("position.at[0]", "odom"), ("about.at[0]", "scan")):
            made.append((access, "k"))
        else:
            number, j = numbered(path, found)
            kind = "dds_double" if key == "odom" else "dds_float"
            made.append((access, f"{kind}(k, {number}u, {j}u)"))
    return made


def _of_value(name: str, key: str) -> str:
    lines = "\n  ".join(f'if (v->{a} != {b}) return "{a}";' for a, b in _leaves(name, key))
    head = f"static const char* check_{name}_value(const {name.upper()}_VALUE* v, uint32_t k)"
    return f"{head} {{\n  {lines}\n  return NULL;\n}}\n"


def _fill_echo() -> str:
    lines = "\n  ".join(f"v->{a} = {b};" for a, b in _leaves("echo", "odom"))
    return f"static void fill_echo(ECHO_VALUE* v, uint32_t k) {{\n  {lines}\n}}\n"
