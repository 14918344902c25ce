"""Target `dds`: a bridge to DDS, with the names, types and QoS of ROS 2, around a real-time program.

`dds_package` puts it together: the trusted part and the actuators are those of target `posix` and
know nothing of DDS; `message_idl` writes the types as ROS 2 does; `bridge_source` the C that says
which message is which topic; `build_files` how it is compiled. What all bridges have in common is
C that ships: `runtime/dds/`.
"""
