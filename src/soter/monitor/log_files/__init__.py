"""Reads files that hold a log, as columns: CSV, MCAP, bags of ROS 1 and 2, logs of autopilots.

`read_columns.py` is the way in, and finds fields in messages; `log_columns.py` is what comes out.
`csv_log.py` reads tables, `message_decoding.py`, `ros_bags.py` (over `bag_files.py`, which says
whether a bag is whole), `ulog_log.py`, `dataflash_log.py` and `mavlink_log.py` read messages;
`message_decoding.py` decodes. All of them read within bounds (`csv_log.py`,
`report/bounded_unpack.py`).
"""
