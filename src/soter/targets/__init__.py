"""What `soter build` writes: a file or a folder for each target, and what targets share.

Each target has its templates (`*.j2`) in a folder of its name, but `ros1` and `ros2` share `ros/`;
C that packages take along as it is lies in `runtime/`. In reading order:

- `package.py` has the table of targets, and writes a package without harming a person's files.
- `c99.py`: target `c`, in virtual time with any C compiler.
- `firmware_interface.py` writes the typed functions for a program in somebody's own loop.
- `leases.py` writes leases of outputs; `late_limits.py` says how late components may be, and
  `takeover_bounds.py` how long SC may take to stand in for an AC that does not answer.
- `posix_package.py`: target `posix`, in real time; `world_interface.py` writes its tables of
  channels and actuators.
- `cortex_m_package.py`: target `cortex-m`, a board without an operating system;
  `cortex_m_board.py` reads the file of the board, `cortex_m_loop.py` writes the tables of its loop,
  and `cortex_m_image.py` makes, runs and measures the image.
- `bridge_base.py`: what the bridges to middlewares share; each is put beside a `posix` package.
- `message_conversion.py` writes code that turns messages into values of topics and back.
- `ros_packages.py`: targets `ros1` and `ros2`; `ros_sources.py` writes their C++.
- `dds_package.py` and `mavlink_package.py`: the targets of these names.
- `programs.cmake.j2` is the part of CMake files that the bridges to ROS and to DDS share.
"""

CHANNELS = "channels.json"
CHANNELS_SCHEMA = 1
TRUSTED = "trusted"
"""The folder of the trusted part in a package of a middleware, which that part knows nothing of."""
