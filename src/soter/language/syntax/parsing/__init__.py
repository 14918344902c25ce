"""The parts of the parser, from a cursor over tokens up to systems and tests."""
