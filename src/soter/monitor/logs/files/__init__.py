"""Files that hold a log, as columns: CSV, MCAP, bags of ROS 1 and 2.

`read_columns` is the way in, `log_columns` what comes out. `csv_log` reads tables; `message_log`
reads messages, of `mcap_messages` or `ros_bags` (over `bounded_rosbag_reader`), whose fields are
found by `message_parts`; `ros_messages` decodes. `other_formats` says what is none of them. All of
it within bounds (`bounded_gzip`, `report/bounded_unpack`).
"""
