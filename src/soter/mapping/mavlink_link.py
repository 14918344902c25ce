"""What a mapping says of MAVLink as a whole: the table `[mavlink]`.

Purpose: where messages come from and go to, whose they are, how long they take, and what the
autopilot does when they end.
Non-goals: which topic is which message (`topic_mapping_parser.py`); speaking MAVLink
(`runtime/mavlink/`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from soter.mapping.mapping_errors import unknown
from soter.mapping.mavlink_types import (
    dialect_path,
    read_dialect,
    require_mavlink_package,
    standard_dialects,
)

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from soter.mapping.mapping_errors import MappingProblems
    from soter.mapping.mavlink_types import Dialect

KEYS = (
    *("url", "dialect", "system", "component", "own_system", "own_component"),
    *("delay", "resend", "offboard_loss"),
)
URLS = "udpin://0.0.0.0:14540, udpout://HOST:PORT or serial:///dev/NAME:BAUD"
UDP = re.compile(r"udp(in|out)://(\d{1,3}(?:\.\d{1,3}){3}|\[[0-9a-fA-F:]+\]):(\d{1,5})", re.ASCII)
SERIAL = re.compile(r"serial://(/dev/[A-Za-z0-9_./-]+):(\d{3,7})", re.ASCII)
BAUDS = (9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600, 1000000, 2000000, 3000000)
LINKS_MAX = 4
AUTOPILOT, ONBOARD_COMPUTER = 1, 191
RESEND_NS, OFFBOARD_LOSS_NS = 50_000_000, 1_000_000_000
PROOF_OF_LIFE_NS = 500_000_000
"""PX4 leaves its mode OFFBOARD where set-points come less often than twice a second."""
SOURCE = re.compile(r"(\d{1,3})/(\d{1,3})", re.ASCII)


@dataclass(frozen=True)
class MavlinkLink:
    """The table, with what it does not say filled in.

    `delay_ns`: how old a message may be when it comes, None: nobody says. `resend_ns`: what does
    not change is sent so often. `offboard_loss_ns`: COM_OF_LOSS_T of PX4.
    """

    urls: tuple[str, ...]
    dialect: Dialect
    system: int = 1
    component: int = AUTOPILOT
    own_system: int = 1
    own_component: int = ONBOARD_COMPUTER
    delay_ns: int | None = None
    resend_ns: int = RESEND_NS
    offboard_loss_ns: int = OFFBOARD_LOSS_NS

    @property
    def autopilot(self) -> tuple[int, int]:
        """Whose messages are taken where a topic names no other publisher."""
        return self.system, self.component


def read_link(given: Mapping[str, Any], folder: Path, problems: MappingProblems) -> MavlinkLink:
    """The table; SoterError D007 without pymavlink. Of no use where problems were added."""
    require_mavlink_package()
    problems.only(given, KEYS, "`mavlink`")
    urls = _urls(given.get("url"), problems)
    ids = {
        key: _id(given, key, default, problems)
        for key, default in (
            ("system", 1),
            ("component", AUTOPILOT),
            ("own_system", 1),
            ("own_component", ONBOARD_COMPUTER),
        )
    }
    if (ids["system"], ids["component"]) == (ids["own_system"], ids["own_component"]):
        problems.add("`mavlink`: the bridge cannot be the autopilot: `own_component` is its own")
    times = {
        key: problems.duration(given, key, "mavlink") if key in given else default
        for key, default in (("resend", RESEND_NS), ("offboard_loss", OFFBOARD_LOSS_NS))
    }
    resend, loss = times["resend"], times["offboard_loss"]
    if resend >= PROOF_OF_LIFE_NS:
        problems.add("`resend` of `mavlink` is below 500ms: OFFBOARD needs more than 2 a second")
    elif 3 * resend > loss:
        problems.add(
            "`offboard_loss` of `mavlink` is shorter than three times `resend`: two lost "
            "set-points would end OFFBOARD"
        )
    delay = problems.duration(given, "delay", "mavlink") if "delay" in given else None
    dialect = _dialect(given.get("dialect", "common"), folder, problems)
    return MavlinkLink(
        urls, dialect, **ids, delay_ns=delay, resend_ns=resend, offboard_loss_ns=loss
    )


def source_of(text: str) -> tuple[int, int] | None:
    """`1/191` as a system and a component; None where it is none."""
    match = SOURCE.fullmatch(text)
    ids = (int(match[1]), int(match[2])) if match else (0, 0)
    return ids if all(1 <= n <= 255 for n in ids) else None


def _urls(given: object, problems: MappingProblems) -> tuple[str, ...]:
    urls = [given] if isinstance(given, str) else given
    if not isinstance(urls, list) or not 1 <= len(urls) <= LINKS_MAX:
        problems.add(f"`mavlink` needs a `url`, or up to {LINKS_MAX} of them: {URLS}")
        return ()
    for url in urls:
        if not isinstance(url, str) or not _is_url(url):
            problems.add(f"`url` of `mavlink` is {str(url)[:60]!r}: there are {URLS}")
    if len({str(u) for u in urls}) != len(urls):
        problems.add("`url` of `mavlink` names one twice")
    return tuple(str(u) for u in urls)


def _is_url(url: str) -> bool:
    udp, serial = UDP.fullmatch(url), SERIAL.fullmatch(url)
    if udp is not None:
        numbers = [] if udp[2].startswith("[") else udp[2].split(".")
        return 1 <= int(udp[3]) <= 65535 and all(int(n) <= 255 for n in numbers)
    return serial is not None and int(serial[2]) in BAUDS


def _id(given: Mapping[str, Any], key: str, default: int, problems: MappingProblems) -> int:
    number = given.get(key, default)
    if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= 255:
        problems.add(f"`{key}` of `mavlink` is a number from 1 to 255, not {str(number)[:40]}")
        return default
    return number


def _dialect(given: object, folder: Path, problems: MappingProblems) -> Dialect:
    name = given if isinstance(given, str) and given else "common"
    known = standard_dialects()
    if name is not given:
        problems.add(f"`dialect` of `mavlink` is no name: {given!r}")
    elif name not in known and not name.endswith(".xml"):
        problems.add(unknown("`mavlink` has no dialect", name, known))
        name = "common"
    try:
        return read_dialect(dialect_path(name, folder).resolve())
    except (OSError, ValueError, RuntimeError) as error:  # RuntimeError: links in a circle
        problems.add(f"the dialect `{name}` of `mavlink` cannot be read: {error}")
        return read_dialect(dialect_path("common", folder).resolve())
