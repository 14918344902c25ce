"""The checked tree and the flat system: data, and walks over it."""
