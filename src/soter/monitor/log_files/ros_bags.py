"""Reads the messages of bags of ROS 1 (a file) and ROS 2 (a folder, or one of its files).

Purpose: `bag_messages` finds out what kind of bag it is, and that its files are ordinary ones; it
reads a bag of ROS 2 file by file, and its metadata only for what these are.
Non-goals: the files (`bag_files.py`, `message_decoding.py`).
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import SoterError
from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import open_finite_file, read_bytes
from soter.mapping.message_types import require_ros_package
from soter.monitor.log_files.log_columns import (
    REINDEX,
    damaged_log_error,
    remedies_for_file,
    unusable_log_error,
)
from soter.monitor.log_files.message_decoding import UndecodableError, mcap_messages
from soter.report.bounded_unpack import unpack_file

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from soter.monitor.log_files.log_columns import Arrived, FileFacts, Wanted


METADATA = "metadata.yaml"
METADATA_MAX = 4 << 20
MARK = "rosbag2_bagfile_information"
SPLIT = re.compile(r"(.+)_\d+\.(db3|mcap)(\.zstd)?")
"""The names that ROS 2 gives the parts of a bag."""
FILES_MAX = 10_000
STORAGES = {"sqlite3": ".db3", "mcap": ".mcap"}
ROS1_MAGIC = b"#ROSBAG V2.0\n"


@dataclass(frozen=True)
class _Bag2:
    """The files of a ROS 2 bag, from its metadata; `packed` is "", "file" or "message".

    `counts` has the number of messages of each topic, and under None the number of all.
    """

    files: tuple[Path, ...]
    storage: str
    packed: str = ""
    counts: Mapping[str | None, int] = field(default_factory=dict)


def is_bag(path: Path) -> bool:
    """Whether a log is a bag of ROS, by its name."""
    if path.suffix.lower() in (".bag", ".db3") or path.is_dir():
        return True
    return any(
        (each.parent / METADATA).is_file() and _has_bag_metadata(each)
        for each in _paths_of_file(path)
    )


def _paths_of_file(path: Path) -> Iterator[Path]:
    """The path of a file, and the path of its target if the file is a link."""
    yield from dict.fromkeys((path, Path(os.path.realpath(path))))


def _has_bag_metadata(path: Path) -> bool:
    try:
        return MARK.encode() in read_bytes(path.parent / METADATA, METADATA_MAX)
    except OSError:
        return True  # the error is raised when they are read


def bag_messages(path: Path, wanted: dict[str, Wanted], facts: FileFacts) -> Iterator[Arrived]:
    """Gives arrival time, channel and content of each message; content None if unwanted.

    `facts` counts messages of wanted channels, and names others. Raises SoterError D016, D007.
    """
    require_ros_package()
    from soter.monitor.log_files.bag_files import (  # noqa: PLC0415 - an extra
        REMEDY1,
        ContradictionError,
        ros1_messages,
    )

    try:
        if path.suffix.lower() == ".bag" and not path.is_dir():
            _require_ros1(path)
            yield from ros1_messages(path, wanted, facts)
        elif path.is_dir():
            yield from _ros2_messages(_bag_by_metadata(path), wanted, facts)
        else:
            yield from _ros2_messages(_bag_of_file(path), wanted, facts)
    except SoterError:
        raise
    except ContradictionError as error:
        raise damaged_log_error(path, str(error), error.remedy) from error
    except UndecodableError as error:
        raise unusable_log_error(path, str(error)) from error
    except OSError as error:
        raise unusable_log_error(path, reason(error)) from error
    except Exception as error:
        message = str(error)[:200] if _has_text_for_people(error) else ""
        help_ = REMEDY1 if path.suffix.lower() == ".bag" else ""
        raise damaged_log_error(
            path, message or "it is no bag of ROS, or damaged", help_
        ) from error


def _bag_of_file(path: Path) -> _Bag2:
    """The bag of a file given alone; its counts are known where metadata beside it name it.

    SoterError D016 where they name other files: the file is a part, or of another bag.
    """
    require_no_split(path)
    storage = "mcap" if path.suffix.lower() == ".mcap" else "sqlite3"
    for each in _paths_of_file(path):
        if not (each.parent / METADATA).is_file():
            continue
        bag = _bag_by_metadata(each.parent)
        if [file.name for file in bag.files] == [each.name]:
            return bag
        if bag.storage == storage:
            others = [file.name for file in bag.files if file.name != each.name]
            more = f" and {len(others) - 1:,} more" if len(others) > 1 else ""
            raise unusable_log_error(
                path, f"its `{METADATA}` names `{others[0]}`{more}, too", _folder_advice(each)
            )
    return _Bag2((path,), storage)


def _folder_advice(part: Path) -> str:
    """Advice, in words, for someone who gives a part of a bag alone."""
    return f"give the folder, `{part.parent}` ({REINDEX}), or move the part to one of its own"


def require_no_split(path: Path) -> None:
    """Raises SoterError D016 for a single file if other parts of its bag are beside it."""
    for each in _paths_of_file(path):
        split = SPLIT.fullmatch(each.name)
        if split is None:
            continue
        stem, kind = split[1], split[2]
        beside = each.parent.resolve()
        if kind == "mcap" and beside.name != stem and not (beside / METADATA).is_file():
            continue  # without ROS, numbered logs need not be parts of one bag
        others = [
            other.name
            for other in sorted(beside.glob(f"*.{kind}*"))
            if other.name.removesuffix(".zstd") != each.name.removesuffix(".zstd")
            and (m := SPLIT.fullmatch(other.name))
            and m[1] == stem
        ]
        if others:
            more = f" and {len(others) - 1} more" if len(others) > 1 else ""
            why = f"it is a part of a bag: `{others[0]}`{more} beside it is another"
            raise unusable_log_error(path, why, _folder_advice(each))


def _require_ros1(path: Path) -> None:
    with open_finite_file(path, pipes=False) as file:
        if file.read(len(ROS1_MAGIC)) != ROS1_MAGIC:
            raise unusable_log_error(
                path, "it is no bag of ROS 1, version 2.0", *remedies_for_file(path)
            )


def _has_text_for_people(error: Exception) -> bool:
    """Whether the text of an error is meant for people."""
    of_readers = type(error).__module__.startswith(("rosbags.", "soter."))
    return of_readers and not isinstance(error, KeyError)


def _ros2_messages(bag: _Bag2, wanted: dict[str, Wanted], facts: FileFacts) -> Iterator[Arrived]:
    from soter.monitor.log_files.bag_files import (  # noqa: PLC0415 - an extra
        require_counts,
        require_no_journal,
        sqlite_messages,
    )

    for file in bag.files:
        with TemporaryDirectory() as folder:
            plain = file
            if bag.packed == "file":
                require_no_journal(file)
                plain = Path(folder) / f"unpacked.{'db3' if bag.storage == 'sqlite3' else 'mcap'}"
                with open_finite_file(file, pipes=False) as packed, plain.open("wb") as into:
                    unpack_file(packed, into, file.stat().st_size)
            if bag.storage == "mcap":
                yield from mcap_messages(plain, wanted, facts)
            else:
                open_finite_file(plain, pipes=False).close()
                packed_messages = bag.packed == "message"
                yield from sqlite_messages(plain, wanted, facts, packed=packed_messages)
    require_counts(bag.counts, facts.there)


def _bag_by_metadata(path: Path) -> _Bag2:
    """Gives the bag whose files the metadata of a folder name; raises SoterError D016."""
    from ruamel.yaml import YAML  # noqa: PLC0415 - comes with rosbags
    from ruamel.yaml.error import YAMLError  # noqa: PLC0415 - the same

    from soter.monitor.log_files.bag_files import message_counts  # noqa: PLC0415 - an extra

    file = path / METADATA
    try:
        text = read_bytes(file, METADATA_MAX).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = reason(error) if isinstance(error, OSError) else "it is not UTF-8"
        raise unusable_log_error(
            path, f"its `{METADATA}` cannot be read: {why}", REINDEX
        ) from error
    try:
        information = YAML(typ="safe").load(text)[MARK]
        names, storage = information["relative_file_paths"], information["storage_identifier"]
        mode = str(information.get("compression_mode") or "").lower()
        form = str(information.get("compression_format") or "")
        counts = message_counts(information)
    except (YAMLError, KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
        raise unusable_log_error(path, f"its `{METADATA}` is none of a bag", REINDEX) from error
    packed = _packed_unit(path, storage, mode, form)
    if not isinstance(names, list) or not 0 < len(names) <= FILES_MAX:
        raise unusable_log_error(path, f"its `{METADATA}` names no files")
    if not all(isinstance(n, str) and _is_file_name(PurePosixPath(n).name) for n in names):
        raise unusable_log_error(path, f"its `{METADATA}` names a file that can be none of it")
    files = tuple(path / PurePosixPath(n).name for n in names)
    _require_all_named(path, files, STORAGES[storage])
    return _Bag2(files, storage, packed, counts)


def _packed_unit(path: Path, storage: object, mode: str, form: str) -> str:
    """The unit that a bag compresses: "file", "message", or "" for none; raises SoterError D016."""
    if storage not in STORAGES:
        raise unusable_log_error(
            path, f"it is stored as `{str(storage)[:40]}`: {', '.join(STORAGES)} are read"
        )
    packed = "" if mode in ("", "none") else mode
    if packed not in ("", "file", "message") or (packed and form != "zstd"):
        raise unusable_log_error(
            path, f"it is packed by `{form[:40]}`, mode `{mode[:40]}`: zstd is read"
        )
    if (storage, packed) == ("mcap", "message"):
        text = "its messages are packed one by one, which is read of sqlite3 only"
        raise unusable_log_error(path, text, "`ros2 bag convert` writes one that is not")
    return packed


def _require_all_named(path: Path, files: tuple[Path, ...], kind: str) -> None:
    """Raises SoterError D016 where a folder has files of messages that its metadata do not name."""
    named = {file.name for file in files}
    if not all(file.exists() for file in files):
        return  # the error is raised when they are read
    ends = (kind, f"{kind}.zstd")
    for each in sorted(path.iterdir()):
        if each.name.endswith(ends) and each.name not in named:
            why = f"`{each.name}` lies in it, and its `{METADATA}` does not name it"
            raise unusable_log_error(path, why, f"{REINDEX}; or move the file away")


def _is_file_name(name: str) -> bool:
    """Whether a name is a plain file name, not an address with settings for SQLite."""
    return name not in ("", "..") and not set(name) & set("?#%\0\\")
