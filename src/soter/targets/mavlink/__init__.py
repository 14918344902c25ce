"""Target `mavlink`: a program in real time on a companion computer, beside an autopilot.

`mavlink_package.py` puts it together: the trusted part and the actuators are those of target
`posix` and know nothing of MAVLink. It also checks what a set-point has to say, and adds the C of
MAVLink, which pymavlink generates. `mavlink_package.py` writes the tables of the bridge. What
bridges have in common is C that ships: `runtime/mavlink/`.
"""
