"""Files that hold a log, as columns: CSV, MCAP, bags of ROS 1 and 2.

`read_columns.py` is the way in, `log_columns.py` what comes out. `csv_log.py` reads tables;
`message_log.py` reads messages, of `mcap_messages.py` or `ros_bags.py` (over
`bag_files.py`), and finds their fields; `ros_messages.py` decodes; `bag_files.py` says
whether a bag is whole. All of it within bounds (`csv_log.py`, `report/bounded_unpack.py`).
"""
