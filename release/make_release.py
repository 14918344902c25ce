"""What would be published, built twice and tried where there is no checkout: build/release.

    make release          (or: .venv/bin/python release/make_release.py [--python PATH ...])

Purpose: sdist and wheel of the last commit, the same bytes from two folders; installed into empty
environments of the oldest and the newest Python that is here, their tests run against what is
installed there; beside them an SBOM of a plain install, checksums, and the changelog's section.
Non-goals: whatever needs a key: publish.sh says what that would be. Needs a package index.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "build" / "release"
EXTRAS = "prove,logs,report"
TOOLS = ("pytest>=8", "hypothesis>=6.100", "lark>=1.2", "mpmath>=1.3")
TESTS = (
    "tests/unit/cli/test_cli_new.py",
    "tests/unit/cli/test_cli_check.py",
    "tests/unit/cli/test_cli_run.py",
    "tests/unit/cli/test_cli_verify.py",
    "tests/unit/api/test_api_run.py",
    "tests/unit/certificate/test_certificates.py",
    "tests/unit/monitor/test_times_of_logs.py",
    "tests/unit/report/test_report_mcap.py",
    "tests/unit/semantics",
    "tests/correct/test_engines_agree.py",
)
"""Quick ones of every part that a stranger meets, which read nothing of src/."""
OLDEST = (3, 10)


def told(*words: str | Path, at: Path = ROOT, env: dict[str, str] | None = None) -> str:
    """What a command prints; where it fails, its words are the end of this program."""
    done = subprocess.run(
        [str(w) for w in words],
        cwd=at,
        env={**os.environ, **(env or {})},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        sys.exit(f"{' '.join(map(str, words))}: exit {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


# ---------------------------------------------------------------- the same bytes


def normal(sdist: bytes, epoch: int) -> bytes:
    """The same archive with nothing in it of the machine: order, times, owners and modes."""
    packed = io.BytesIO()
    with (
        tarfile.open(fileobj=io.BytesIO(sdist)) as old,
        gzip.GzipFile(filename="", fileobj=packed, mode="wb", mtime=epoch) as stream,
        tarfile.open(fileobj=stream, mode="w", format=tarfile.PAX_FORMAT) as new,
    ):
        for member in sorted(old.getmembers(), key=lambda m: m.name):
            plain = tarfile.TarInfo(member.name)
            plain.type, plain.size, plain.mtime = member.type, member.size, epoch
            plain.mode = 0o755 if member.isdir() or member.mode & 0o100 else 0o644
            new.addfile(plain, old.extractfile(member) if member.isfile() else None)
    return packed.getvalue()


def built(revision: str, epoch: int, folder: Path) -> dict[str, bytes]:
    """Both archives of a revision by name, made in a folder that has nothing else."""
    source, made = folder / "source", folder / "made"
    os.umask(0o022)
    source.mkdir(parents=True)
    archive = subprocess.run(
        ["git", "archive", revision], cwd=ROOT, capture_output=True, check=True
    ).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        files.extractall(source, filter="data")
    env = {"SOURCE_DATE_EPOCH": str(epoch), "PYTHONHASHSEED": "0", "LC_ALL": "C.UTF-8"}
    told(sys.executable, "-m", "build", "--no-isolation", "-o", made, source, env=env)
    return {
        p.name: normal(p.read_bytes(), epoch) if p.name.endswith(".tar.gz") else p.read_bytes()
        for p in sorted(made.iterdir())
    }


def built_twice(revision: str, epoch: int, at: Path) -> dict[str, bytes]:
    """The same from two folders."""
    first = built(revision, epoch, at / "a")
    second = built(revision, epoch, at / "another" / "folder")
    if other := [name for name in first.keys() | second if first.get(name) != second.get(name)]:
        sys.exit(f"built twice, and not the same bytes: {', '.join(other)}")
    return first


# ---------------------------------------------------------------- where there is no checkout


def version_of(python: Path) -> tuple[int, int]:
    """What `python` is."""
    words = "import sys; print(*sys.version_info[:2])"
    major, minor = told(python, "-c", words).split()
    return int(major), int(minor)


def pythons() -> list[Path]:
    """The oldest Python that Soter admits and the newest one, of those on PATH and of pyenv."""
    folders = [Path(p) for p in os.environ.get("PATH", "").split(os.pathsep)]
    folders += (Path.home() / ".pyenv" / "versions").glob("*/bin")
    found: dict[tuple[int, int], Path] = {version_of(Path(sys.executable)): Path(sys.executable)}
    for path in (p for folder in folders for p in folder.glob("python3.*")):
        if re.fullmatch(r"python3\.\d+", path.name) and os.access(path, os.X_OK):
            works = subprocess.run([path, "-c", ""], capture_output=True, check=False)
            if not works.returncode:
                found.setdefault((3, int(path.suffix[1:])), path)
    kept = sorted(v for v in found if v >= OLDEST)
    if OLDEST not in found:
        print(f"no Python {OLDEST[0]}.{OLDEST[1]} is here; the oldest one is taken in its place")
    return [found[v] for v in dict.fromkeys((kept[0], kept[-1]))]


def size(python: Path) -> int:
    """Bytes of what is installed, without pip and what came with the empty environment."""
    words = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = Path(told(python, "-c", words).strip())
    given = re.compile(r"(pip|setuptools|pkg_resources|_distutils_hack|distutils-precedence)\b")
    return sum(
        p.lstat().st_size
        for top in site.iterdir()
        if not given.match(top.name)
        for p in (top, *top.rglob("*"))
        if not p.is_dir()
    )


def tried(base: Path, wheel: Path, sdist: Path, at: Path) -> Path:
    """The interpreter of an environment in which the wheel works; its tests have been run there."""
    home = at / f"python{'.'.join(map(str, version_of(base)))}"
    told(base, "-m", "venv", home)
    python = home / "bin" / "python"
    pip = (python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    told(*pip, wheel)
    print(f"{home.name}: {told(home / 'bin' / 'soter', '--version', at=at).strip()}, ", end="")
    print(f"{size(python) / 1e6:.0f} MB without pip")
    if base == pythons()[-1]:
        bill(python)
    told(*pip, f"{wheel}[{EXTRAS}]", *TOOLS)
    with tarfile.open(sdist) as files:
        files.extractall(at / home.name / "tests", filter="data")
    (unpacked,) = (at / home.name / "tests").iterdir()
    shutil.rmtree(unpacked / "src")
    where = told(python, "-c", "import soter; print(soter.__file__)", at=unpacked).strip()
    if not Path(where).is_relative_to(home):
        sys.exit(f"tests would be run against {where}")
    words = (python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *TESTS)
    print(f"{home.name}: {told(*words, at=unpacked).strip().splitlines()[-1]}")
    return python


def bill(python: Path) -> None:
    """What a plain install brings along, as CycloneDX."""
    words = ("cyclonedx_py", "environment", "--output-reproducible", "--pyproject")
    text = told(sys.executable, "-m", *words, ROOT / "pyproject.toml", python)
    (OUT / "sbom.cdx.json").write_text(text, encoding="utf-8")
    print(f"sbom.cdx.json: {len(json.loads(text)['components'])} components of a plain install")


# ---------------------------------------------------------------- words


def notes(changelog: str, version: str) -> str:
    """The section of a version, under any heading that ends with it; "" where there is none."""
    sections = re.split(r"^(?=## )", changelog, flags=re.MULTILINE)
    heading = re.compile(rf"## (?:.* )?{re.escape(version)}(?![\w.])[^\n]*\n")
    found = next((s for s in sections if heading.match(s)), "")
    return heading.sub("", found, count=1).strip() + "\n" if found else ""


def main() -> None:
    """Build, try, and write down."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--python", action="append", type=Path, help="to try it with (several)")
    args = parser.parse_args()
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    commit, epoch = told("git", "log", "-1", "--format=%H %ct").split()
    if told("git", "status", "--porcelain"):
        print("what is not committed is not in it")
    with tempfile.TemporaryDirectory() as folder:
        made = built_twice(commit, int(epoch), Path(folder))
        for name, content in made.items():
            (OUT / name).write_bytes(content)
            print(f"{name}: {len(content) / 1e6:.1f} MB, twice the same bytes")
        (wheel,), (sdist,) = OUT.glob("*.whl"), OUT.glob("*.tar.gz")
        text = notes((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), wheel.name.split("-")[1])
        if not text:
            sys.exit("CHANGELOG.md has no section of this version")
        (OUT / "notes.md").write_text(text, encoding="utf-8")
        for base in args.python or pythons():
            tried(base, wheel, sdist, Path(folder))
    sums = [
        f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.name}" for p in sorted(OUT.iterdir())
    ]
    (OUT / "SHA256SUMS").write_text("\n".join(sums) + "\n", encoding="utf-8")
    print(f"{OUT.relative_to(ROOT)}: commit {commit[:12]}; next: release/publish.sh")


if __name__ == "__main__":
    main()
