"""`soter build --target mavlink`: what is written, and what is refused before anything is.

Non-goals: programs that run (`tests/correct/test_mavlink.py`), conversions (`tests/unit/targets/`).
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("pymavlink", reason="the extra `robots` is not installed")

import processes

if TYPE_CHECKING:
    from collections.abc import Callable

    Soter = Callable[..., Any]

EXAMPLES = Path(__file__).resolve().parents[3] / "examples" / "mavlink"
LINK = {"url": "udpin://127.0.0.1:14540", "offboard_loss": "500ms"}
MOTION = {
    "type": "mavlink/LOCAL_POSITION_NED",
    "frame": "NED",
    "fields": {"p": ["x", "y", "z"], "v": ["vx", "vy", "vz"]},
}
SET_POINT = {
    "type": "mavlink/SET_POSITION_TARGET_LOCAL_NED",
    "frame": "NED",
    "set": {"coordinate_frame": 1, "type_mask": 0xDC7},
    "fields": {"value": ["vx", "vy", "vz"]},
}
STILL = {f"{k}.{axis}": {"constant": 0.0} for k in "pv" for axis in "xyz"}
WISH = {**SET_POINT, "publisher": "1/192", "stamp": "arrival"}
ALL = {"motion": MOTION, "wish": WISH, "command": SET_POINT}
WORDS = ("geofence.soter", "--system", "Companion", "--target", "mavlink", "-o", "out")


@pytest.fixture
def fence(here: Path) -> Path:
    for name in ("geofence.soter", "geofence.toml"):
        shutil.copy(EXAMPLES / name, here / name)
    return here


def built(soter: Soter, folder: Path, topics: dict[str, Any], **link: Any) -> Any:
    table = {k: v for k, v in {**LINK, **link}.items() if v is not None}
    (folder / "map.json").write_text(json.dumps({"mavlink": table, "topics": topics}))
    return soter("build", *WORDS, "--map", "map.json", "--json")


def test_the_trusted_part_of_a_package_knows_no_mavlink(soter: Soter, fence: Path) -> None:
    done = soter("build", *WORDS, "--map", "geofence.toml", "--json")
    assert done.exit == 0, done.out
    assert done.document["target"] == "mavlink"
    trusted = list((fence / "out" / "trusted").rglob("*.[ch]"))
    assert len(trusted) > 20
    assert not [p for p in trusted if "mavlink" in p.read_text().lower()]
    headers = {p.name for p in (fence / "out" / "mavlink").iterdir()}
    assert {"mavlink_msg_local_position_ned.h", "mavlink_msg_timesync.h"} <= headers
    assert "mavlink_msg_attitude.h" not in headers


def test_a_package_compiles_without_a_warning(soter: Soter, fence: Path) -> None:
    if shutil.which("make") is None or shutil.which("cc") is None:
        pytest.skip("no compiler here")
    assert soter("build", *WORDS, "--map", "geofence.toml").exit == 0
    words = ["make", "-C", str(fence / "out"), "CFLAGS=-O1 -Werror"]
    done = processes.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    bridge = fence / "out" / "build" / "geofence_bridge"
    help_ = processes.run([str(bridge), "--help"], capture_output=True, text=True, check=True)
    assert "COM_OF_LOSS_T to be 0.5 s" in help_.stdout
    for bad in (["--url"], ["--delay", "2"], ["--channel", "x"], []):
        done = processes.run([str(bridge), *bad], capture_output=True, text=True, check=False)
        assert done.returncode == 2, bad
    words = [str(bridge), "--channels", str(fence), "--url", "tcp://127.0.0.1:1"]
    done = processes.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, "udpin://" in done.stderr) == (1, True)


def test_what_follows_the_end_of_the_bridge_is_said(soter: Soter, fence: Path) -> None:
    notes = " ".join(built(soter, fence, ALL, offboard_loss="1s").document["notes"])
    assert "set COM_OF_LOSS_T to 1 s" in notes
    assert "the last set-point outlives its lease" in notes
    assert "wish count as measured when they come" in notes


def test_a_lease_that_lasts_as_long_as_the_autopilot_waits_is_said_to_be_no_shorter(
    soter: Soter, fence: Path
) -> None:
    notes = built(soter, fence, ALL, offboard_loss="60ms", resend="20ms").document["notes"]
    assert not [n for n in notes if "outlives" in n]
    assert any("set COM_OF_LOSS_T to 60 ms" in n for n in notes)


def test_a_program_without_a_law_is_told_that_set_points_end(soter: Soter, fence: Path) -> None:
    text = (fence / "geofence.soter").read_text()
    lines = [x for x in text.splitlines() if not x.strip().startswith("failsafe ")]
    (fence / "geofence.soter").write_text("\n".join(lines))
    notes = " ".join(built(soter, fence, ALL).document["notes"])
    assert "command: no fail-safe law" in notes
    assert "leaves OFFBOARD 500 ms after the last one" in notes


def test_what_the_mapping_leaves_out_is_said(soter: Soter, fence: Path) -> None:
    done = built(soter, fence, {"motion": MOTION, "wish": WISH})
    assert done.exit == 0
    assert any("not published in MAVLink" in n and "command" in n for n in done.document["notes"])


def changed(topic: str, **entries: Any) -> dict[str, Any]:
    """The mapping with other entries of a topic; None takes one away."""
    entry = {**ALL[topic], **entries}
    return {**ALL, topic: {k: v for k, v in entry.items() if v is not None}}


def masked(mask: object, **more: Any) -> dict[str, Any]:
    return changed("command", set={"coordinate_frame": 1, "type_mask": mask, **more})


@pytest.mark.parametrize(
    ("topics", "said"),
    [
        ({"motion": MOTION, "command": SET_POINT}, "`wish` comes from the world"),
        (changed("motion", type=None), "has no `type`"),
        (changed("motion", type="mavlink/LOCAL_POSITION_NEDD"), "did you mean"),
        (changed("motion", type="mavlink/Odometry"), "written as"),
        (
            changed(
                "wish", type="geometry_msgs/Vector3", set=None, fields={"value": ["x", "y", "z"]}
            ),
            "no message of MAVLink",
        ),
        (
            changed(
                "motion",
                type="mavlink/HIGH_LATENCY2",
                frame=None,
                stamp="arrival",
                fields={**STILL, "v.x": "groundspeed"},
            ),
            "is in `m/s*5`",
        ),
        (
            changed(
                "motion",
                type="mavlink/GPS_STATUS",
                frame=None,
                stamp="arrival",
                fields={**STILL, "v.x": "satellite_azimuth.3"},
            ),
            "is in `deg*360/255`",
        ),
        (changed("motion", channel="/odom"), "MAVLink has no channels"),
        (changed("motion", frame_id="map"), "`frame_id`"),
        (changed("motion", fields={"p": ["x", "y", "q"], "v": ["vx", "vy", "vz"]}), "has no `q`"),
        (changed("motion", fields={"p": ["vx", "vy", "vz"], "v": ["x", "y", "z"]}), "a speed"),
        (changed("motion", fields={"p": ["x", "y", "z"]}), "missing"),
        (changed("motion", frame="ESD"), "there are ENU"),
        (changed("motion", stamp={"from": "time_boot_us", "unit": "us"}), "time_boot_us"),
        (changed("motion", stamp="time_boot_ms"), "say its unit"),
        (changed("motion", publisher="1.192"), "a system and a component"),
        (changed("motion", publisher="0/300"), "a system and a component"),
        (changed("wish", stamp={"from": "time_boot_ms", "unit": "ms"}), "nobody synchronises"),
        (changed("wish", stamp=None), "nobody synchronises"),
        (changed("wish", set={"type_mask": 70000}), "takes no 70000"),
        (changed("wish", set={"type_musk": 1}), "type_musk"),
        (changed("command", publisher="1/1"), "goes out"),
        (changed("command", set={}), "`type_mask`, `coordinate_frame`: 0 would be a command"),
        (changed("command", set={"type_mask": 0xDC7}), "`coordinate_frame`"),
        (masked(0xDC0), "commands `x`, which nobody fills"),
        (masked(0xDCF), "ignores `vx`, which is filled"),
        (masked(0x9C7), "commands `yaw`, which nobody fills"),
        (masked(0xDC7, yaw=0.5), "ignores `yaw`, which is filled"),
        (masked(1.5), "takes no 1.5"),
        (changed("command", type="mavlink/TIMESYNC", fields={"value": ["tc1", "ts1", "ts1"]}), ""),
    ],
)
def test_a_mapping_that_does_not_fit_is_d015_before_anything_is_written(
    soter: Soter, fence: Path, topics: Any, said: str
) -> None:
    refused(built(soter, fence, topics), said, fence)


def refused(done: Any, said: str, folder: Path) -> None:
    assert done.exit == 1
    assert set(done.codes) == {"D015"}, done.codes
    assert said in " ".join(d["message"] for d in done.document["diagnostics"])
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    ("link", "said"),
    [
        ({"url": None}, "needs a `url`"),
        ({"url": []}, "needs a `url`"),
        ({"url": "tcp://127.0.0.1:5760"}, "there are udpin"),
        ({"url": "udpin://127.0.0.1:99999"}, "there are udpin"),
        ({"url": "udpin://127.0.0.999:14540"}, "there are udpin"),
        ({"url": 'udpin://127.0.0.1:1"; x'}, "there are udpin"),
        ({"url": "serial:///dev/ttyACM0:57601"}, "there are udpin"),
        ({"url": ["udpin://127.0.0.1:1", "udpin://127.0.0.1:1"]}, "twice"),
        ({"system": 0}, "from 1 to 255"),
        ({"component": 256}, "from 1 to 255"),
        ({"system": True}, "from 1 to 255"),
        ({"own_component": 1}, "cannot be the autopilot"),
        ({"resend": "500ms"}, "more than 2 a second"),
        ({"resend": "200ms", "offboard_loss": "500ms"}, "two lost set-points"),
        ({"resend": "0s"}, "no time above 0"),
        ({"delay": "soon"}, "`delay`"),
        ({"delay": 60}, "`delay` of `mavlink` is 60 of what? It needs a unit"),
        ({"resend": 0.05}, "`resend` of `mavlink` is 0.05 of what?"),
        ({"offboard_loss": 1}, "`offboard_loss` of `mavlink` is 1 of what?"),
        ({"offboard_loss": "60ms", "resend": "30ms"}, "two lost set-points"),
        ({"dialect": "comon"}, "no dialect"),
        ({"dialect": "mine.xml"}, "cannot be read"),
        ({"dialect": 7}, "no name"),
        ({"baud": 57600}, "`baud`"),
    ],
)
def test_a_link_that_makes_no_sense_is_d015(
    soter: Soter, fence: Path, link: dict[str, Any], said: str
) -> None:
    refused(built(soter, fence, ALL, **link), said, fence)


def test_mistakes_of_a_mapping_are_told_all_at_once_and_before_anything_is_rechecked(
    soter: Soter, fence: Path
) -> None:
    """There is no certificate: who looked at it first would say so (D009)."""
    text = (fence / "geofence.toml").read_text()
    unframed = text.replace('frame = "NED"\n', "", 1).replace('delay = "60ms"', "delay = 60")
    (fence / "map.toml").write_text(unframed)
    done = soter("build", *WORDS, "--map", "map.toml", "--cert", "none", "--json")
    messages = [d["message"] for d in done.document["diagnostics"] if d["severity"] == "error"]
    assert done.errors == ["D015"] * 3
    assert "`delay` of `mavlink` is 60 of what?" in messages[0]
    assert "`motion.p` is in NED, the program in ENU" in messages[1]
    other = text.replace("[topics.wish]", '[topics.wish]\nchannel = "a"').replace("1/192", "x")
    (fence / "map.toml").write_text(other)
    done = soter("build", *WORDS, "--map", "map.toml", "--cert", "none", "--json")
    assert done.errors == ["D015"] * 2
    assert soter("build", *WORDS, "--map", "geofence.toml", "--cert", "none", "--json").errors == [
        "D009"
    ]


def test_a_law_that_would_come_after_the_autopilots_patience_is_refused(
    soter: Soter, fence: Path
) -> None:
    done = built(soter, fence, ALL, resend="10ms", offboard_loss="35ms")
    refused(done, "the law may come 40 ms after the last set-point", fence)


@pytest.mark.parametrize("text", ["", "<mavlink>", "<mavlink></mavlink>", "\0", "<x><y/></x>"])
def test_a_dialect_of_ones_own_that_is_none_is_refused(
    soter: Soter, fence: Path, text: str
) -> None:
    (fence / "own.xml").write_text(text)
    refused(built(soter, fence, ALL, dialect="own.xml"), "cannot be read", fence)


def test_a_dialect_of_ones_own_is_read(soter: Soter, fence: Path) -> None:
    (fence / "own.xml").write_text(
        """<?xml version="1.0"?><mavlink><include>common.xml</include><messages>
<message id="54000" name="MY_PLACE"><description>d</description>
<field type="uint32_t" name="time_boot_ms" units="ms">t</field>
<field type="float" name="x" units="m">x</field><field type="float" name="y" units="m">y</field>
<field type="float" name="z" units="m">z</field>
<field type="float" name="vx" units="m/s">x</field>
<field type="float" name="vy" units="m/s">y</field>
<field type="float" name="vz" units="m/s">z</field>
</message></messages></mavlink>"""
    )
    from soter.mapping.mavlink_dialects import dialect_path

    for name in ("common", "standard", "minimal"):
        shutil.copy(dialect_path(name, fence), fence / f"{name}.xml")
    done = built(soter, fence, {**ALL, "motion": {**MOTION, "type": "mavlink/MY_PLACE"}},
                 dialect="own.xml")  # fmt: skip
    assert done.exit == 0, done.out
    assert (fence / "out" / "mavlink" / "mavlink_msg_my_place.h").exists()


def test_a_dialect_without_what_every_bridge_sends_is_refused(soter: Soter, fence: Path) -> None:
    from soter.mapping.mavlink_dialects import dialect_path

    text = dialect_path("common", fence).read_text()
    kept = text.replace("<include>standard.xml</include>", "").replace('"TIMESYNC"', '"OTHER"')
    (fence / "own.xml").write_text(kept)
    refused(built(soter, fence, ALL, dialect="own.xml"), "no message HEARTBEAT", fence)


def test_a_strangers_dialect_runs_nothing(soter: Soter, fence: Path) -> None:
    runs = "__import__('pathlib').Path('ran').touch() or 7"
    (fence / "own.xml").write_text(
        f"""<mavlink><enums><enum name="E"><entry name="A" value="{runs}"/></enum></enums>
<include>minimal.xml</include><messages/></mavlink>"""
    )
    (fence / "minimal.xml").write_text((fence / "own.xml").read_text().replace("minimal", "own"))
    refused(built(soter, fence, ALL, dialect="own.xml"), "it has no messages", fence)
    assert not (fence / "ran").exists()


def test_without_the_package_the_extra_is_named(
    soter: Soter, fence: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from soter.mapping import mavlink_dialects

    monkeypatch.setattr(mavlink_dialects, "find_spec", lambda _name: None)
    done = built(soter, fence, ALL)
    assert (done.exit, done.codes) == (1, ["D007"])
    assert "soter-rta[robots]" in str(done.document)


def test_the_other_middlewares_do_not_take_its_messages(soter: Soter, fence: Path) -> None:
    table = {"mavlink": LINK, "topics": {k: {**v, "channel": "/a"} for k, v in ALL.items()}}
    (fence / "map.json").write_text(json.dumps(table))
    for target in ("ros1", "dds"):
        words = [target if w == "mavlink" else w for w in WORDS]
        done = soter("build", *words, "--map", "map.json", "--json")
        assert (done.exit, set(done.codes)) == (1, {"D015"}), target
