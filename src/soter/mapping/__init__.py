"""Mappings: which topic of a program is what in the messages of somebody else.

`topic_mapping.py` has the records of a mapping; `read_mapping.py` makes them of a file, checked
against a system: `topic_mapping_parser.py` reads what it says of a topic, `leaf_mapping_parser.py`
of the leaves, and `mapping_errors.py` collects all mistakes (D015). `message_types.py` and
`mavlink_dialects.py` know the types of messages, `units.py` and `frames.py` turn numbers and
vectors into another convention.
"""
