"""Commands about the tool itself, its texts and pictures: they neither run nor prove anything."""
