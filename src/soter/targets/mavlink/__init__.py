"""Target `mavlink`: a program in real time on a companion computer, beside an autopilot.

`mavlink_package` puts it together: the trusted part and the actuators are those of target `posix`
and know nothing of MAVLink; `bridge_source` the tables of the bridge; `set_point_mask_check` what a
set-point has to say; `dialect_headers` the C of MAVLink, which pymavlink generates. What bridges
have in common is C that ships: `runtime/mavlink/`.
"""
