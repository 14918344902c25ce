"""Tree -> checked program: names, types, nodes, modules, P1a P1b, composition."""
