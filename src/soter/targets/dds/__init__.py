"""Target `dds`: a bridge to DDS, as ROS 2 speaks it, beside a program in real time.

`dds_package.py` puts it together and says how it is compiled: the trusted part and the actuators
are those of target `posix` and know nothing of DDS. `dds_package.py` writes the types as ROS 2
does, and the C that says which message is which topic. What all bridges have in common is C that
ships: `runtime/dds/`.
"""
