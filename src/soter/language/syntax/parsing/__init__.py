"""The storeys of the parser, from a cursor over tokens to systems."""
