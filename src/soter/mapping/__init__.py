"""Which topic of a program is what in the messages of somebody else.

`topic_mapping`: what a mapping says, as records. `read_mapping`: from a file to these, checked
against a system; every mistake is D015. `message_types`: the types of ROS messages. `units`,
`standard_units` and `frames`: what numbers are turned from one convention into another by.
"""
