"""Which topic of a program is what in the messages of somebody else.

`topic_mapping.py`: what a mapping says, as records. `read_mapping.py`: from a file to these,
checked against a system; every mistake is D015. `message_types.py`: the types of ROS messages.
`units.py`: units and frames, by which numbers are turned from one convention into another.
"""
