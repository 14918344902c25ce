"""How a module is proved of which the program does not say it: grids and `rest` that are found."""
