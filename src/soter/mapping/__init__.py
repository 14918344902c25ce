"""Mappings: where the topics of a program lie in the messages of other software.

`topic_mapping.py` has the records of a mapping; `read_mapping.py` makes them of a file, checked
against a system. `topic_mapping_parser.py` reads the table of a topic, `leaf_mapping_parser.py`
its leaves, and `mapping_errors.py` collects all mistakes (D015). `message_types.py` and
`mavlink_dialects.py` know the types of messages, `units.py` and `frames.py` turn numbers and
vectors into another convention.
"""
