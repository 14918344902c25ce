"""An advanced controller for geofence.soter: flies east, and does not stop at the fence.

    python hurry.py [PORT]

A component of MAVLink of its own (1/192), which speaks to the bridge as it would to PX4.
Non-goals: walls.
"""

from __future__ import annotations

import sys
import time

from pymavlink import mavutil

VELOCITIES = 0xDC7
EAST_M_S = 1.5

if __name__ == "__main__":
    port = sys.argv[1] if len(sys.argv) > 1 else "14540"
    link = mavutil.mavlink_connection(
        f"udpout:127.0.0.1:{port}", source_system=1, source_component=192, dialect="common"
    )
    while True:
        link.mav.set_position_target_local_ned_send(
            0, 1, 1, 1, VELOCITIES, *(0.0,) * 3, 0.0, EAST_M_S, 0.0, *(0.0,) * 5
        )
        time.sleep(0.05)
